"""The pictures of a result: which sensor sees what, how often, how well, and what nobody sees."""

from __future__ import annotations

import re
from collections.abc import Iterator, Sequence
from concurrent.futures import Future, ThreadPoolExecutor
from dataclasses import replace
from pathlib import Path

from numpy.typing import ArrayLike

from glvis.evaluation.interference import Interference, find_interference, rival_groups
from glvis.pictures.coloring import KINDS, Coloring, coloring
from glvis.pictures.modelsheets import MODELS_A_SHEET, models_sheet
from glvis.pictures.plots import write_convergence
from glvis.pictures.qualitycolors import (
    INTERFERENCE,
    QUALITIES,
    check_kinds,
    interference_coloring,
    quality_coloring,
    quality_scale,
)
from glvis.pictures.scenesheets import (
    SIZE,
    close_sheet,
    perspective_sheet,
    sides_sheet,
    unseen_sheet,
)
from glvis.pictures.selection import Chosen, chosen_pictures, worst_models
from glvis.pictures.sensorsheets import contact_sheet, depth_sheet, sensor_sheet
from glvis.pictures.sheet import Sheet
from glvis.pictures.stage import Stage
from glvis.problem.study import Study
from glvis.search.trace import TraceRow
from glvis.visibility.visibility_map import VisibilityMap

_SURROUNDED = ("sensor", "overlap")  # colours that are also shown with the rig, from four sides
_SHEETS = {"unseen": unseen_sheet, INTERFERENCE: perspective_sheet}  # of others close_sheet
_SMALLEST = 200  # pixels of a sheet's side; less has no room for words
_WAITING = 4  # sheets that may wait to be packed: they are large


def write_views(
    study: Study,
    camera_to_world: ArrayLike,
    maps: Sequence[VisibilityMap],
    directory: Path,
    *,
    trace: Sequence[TraceRow] = (),
    start_value: float | None = None,
    size: tuple[int, int] = SIZE,
    view: tuple[float, float] | None = None,
    color: str | None = None,
    also: Sequence[str] = (),
    all_pictures: bool = False,
    interference: Interference | None = None,
) -> list[Path]:
    """Write the pictures of placed sensors as PNG.

    For each model MODEL: ``MODEL-sensor-perspective``, ``MODEL-sensor-sides``,
    ``MODEL-overlap-perspective``, ``MODEL-overlap-sides``, ``MODEL-incidence``,
    ``MODEL-distance``, ``MODEL-unseen`` and ``MODEL-contact``. For each sensor NAME, looking at
    the first of them: ``sensor-NAME`` and ``sensor-NAME-depth``. With a trace: ``convergence``.
    Where sensors emit in one group: ``MODEL-interference``.
    Of many models or sensors only some are shown one by one, see ``selection``; then
    ``models-1``, ``models-2`` ... show all models, the least seen first.

    Parameters
    ----------
    study : Study
        What was run.
    camera_to_world : (S, 4, 4) float64
        Poses of the sensors.
    maps : sequence of VisibilityMap
        One a model.
    directory : Path
        An existing folder.
    trace : sequence of TraceRow
        Steps of the search; may be empty.
    start_value : float, optional
        Value of the user's start, for the plot.
    size : tuple of int
        Pixels (width, height).
    view : (float, float), optional
        Azimuth and elevation, degrees, that pictures in perspective are taken from; see
        ``framing``.
    color : str, optional
        Only the pictures of the scene with this colouring, one of ``qualitycolors.EVERY_KIND``.
    also : sequence of str
        Further colourings, beside those made anyway.
    all_pictures : bool
        Whether every model and every sensor is shown, however many there are.
    interference : Interference, optional
        What the projectors light, if it is known already.

    Returns
    -------
    list of Path
        The files, in the order made.

    Raises
    ------
    ValueError
        If a colouring is none or the sensors do not state what it tells, there is not one map a
        model, or the size is too small.
    """
    usual = [*KINDS, *([INTERFERENCE] if rival_groups(study.sensors) else [])]
    kinds = [color] if color else list(dict.fromkeys([*usual, *also]))
    check_kinds(kinds, study.sensors)
    if len(maps) != len(study.models):
        raise ValueError(f"{len(study.models)} models need as many maps, got {len(maps)}")
    if min(size) < _SMALLEST:
        raise ValueError(
            f"size = {size[0]} x {size[1]} must be at least {_SMALLEST} x {_SMALLEST} pixels"
        )
    chosen = chosen_pictures(study, maps, all_pictures=all_pictures)
    paths: list[Path] = []
    # One thread draws while another packs what is drawn.
    with Stage(study, camera_to_world) as stage, ThreadPoolExecutor(max_workers=1) as pool:
        pending: list[Future[None]] = []
        if INTERFERENCE in kinds and interference is None:
            interference = find_interference(study, stage.poses)
        painter = _Painter(stage, maps, kinds, interference)
        for name, sheet in _sheets(painter, chosen, size, view, is_whole=color is None):
            paths.append(_unused(directory, name, paths))
            pending.append(pool.submit(sheet.save, paths[-1]))
            while len(pending) > _WAITING:
                pending.pop(0).result()
        for future in pending:
            future.result()
    if trace and color is None:
        objective, over = study.objective, ""
        if len(study.models) > 1:
            over = f", {objective.aggregate} over {len(study.models)} models"
        paths.append(_unused(directory, "convergence", paths))
        write_convergence(
            paths[-1],
            trace,
            title=study.title or "Search",
            quantity=f"objective {objective.label}{over}",
            start_value=start_value,
            upper_bound=objective.upper_bound,
            size=size,
        )
    return paths


class _Painter:
    """Puts models on the stage one by one, and paints them in the colours that are wanted."""

    def __init__(
        self,
        stage: Stage,
        maps: Sequence[VisibilityMap],
        kinds: Sequence[str],
        interference: Interference | None,
    ) -> None:
        self.stage, self.maps, self.kinds = stage, maps, kinds
        self._interference = interference
        self._most = max(int(seen_map.counts.max(initial=0)) for seen_map in maps)
        every = [stage.seen_of(m, found) for m, found in enumerate(maps)]
        # one bar for all models, so that their pictures can be laid side by side
        self._scales = {kind: quality_scale(kind, every) for kind in kinds if kind in QUALITIES}

    def colorings(self, m: int) -> Iterator[tuple[str, Coloring]]:
        """Show a model; yield its colourings by kind, each painted."""
        seen = replace(self.stage.show(m, self.maps[m]), most=self._most)
        for kind in self.kinds:
            if kind in self._scales:
                painted = quality_coloring(kind, seen, self._scales[kind])
            elif kind == INTERFERENCE and self._interference:
                painted = interference_coloring(seen, self._interference, m)
            else:
                painted = coloring(kind, seen)
            self.stage.paint(painted.colors)
            yield kind, painted


def _sheets(
    painter: _Painter,
    chosen: Chosen,
    size: tuple[int, int],
    view: tuple[float, float] | None,
    *,
    is_whole: bool,
) -> Iterator[tuple[str, Sheet]]:
    """Yield the sheets with their names, each ready to be saved; whole: not of one colour only."""
    stage, maps = painter.stage, painter.maps
    for m in chosen.models:
        model = stage.study.models[m].name
        for kind, painted in painter.colorings(m):
            if kind in _SURROUNDED:
                yield f"{model}-{kind}-perspective", perspective_sheet(stage, painted, size, view)
                yield f"{model}-{kind}-sides", sides_sheet(stage, painted, size, view)
            else:
                lay_out = _SHEETS.get(kind, close_sheet)
                yield f"{model}-{kind}", lay_out(stage, painted, size, view)
        if is_whole:
            yield f"{model}-contact", contact_sheet(stage, size)
            for s in chosen.sensors if m == chosen.models[0] else ():
                name = stage.study.sensor_names[s]
                yield f"sensor-{name}", sensor_sheet(stage, s, size)
                yield f"sensor-{name}-depth", depth_sheet(stage, s, size)
    if is_whole and len(chosen.models) < len(maps):
        order = worst_models(stage.study, maps)
        starts = range(0, len(order), MODELS_A_SHEET)
        for page, start in enumerate(starts, start=1):
            some = order[start : start + MODELS_A_SHEET]
            yield f"models-{page}", models_sheet(stage, maps, some, (page, len(starts)), size)


def _unused(directory: Path, name: str, taken: Sequence[Path]) -> Path:
    """Return the path of a picture, without what no file name may hold."""
    stem = re.sub(r"[^\w.+-]", "_", name)
    while (path := directory / f"{stem}.png") in taken:
        stem += "_"
    return path
