"""The pictures of a result: which sensor sees what, how often, how well, and what nobody sees."""

from __future__ import annotations

import re
from collections.abc import Iterator, Sequence
from concurrent.futures import Future, ThreadPoolExecutor
from dataclasses import replace
from pathlib import Path

from numpy.typing import ArrayLike

from glvis.pictures.coloring import KINDS, coloring
from glvis.pictures.modelsheets import MODELS_A_SHEET, models_sheet
from glvis.pictures.plots import write_convergence
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
    all_pictures: bool = False,
) -> list[Path]:
    """Write the pictures of placed sensors as PNG.

    For each model MODEL: ``MODEL-sensor-perspective``, ``MODEL-sensor-sides``,
    ``MODEL-overlap-perspective``, ``MODEL-overlap-sides``, ``MODEL-incidence``,
    ``MODEL-distance``, ``MODEL-unseen`` and ``MODEL-contact``. For each sensor NAME, looking at
    the first of them: ``sensor-NAME`` and ``sensor-NAME-depth``. With a trace: ``convergence``.
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
        Only the pictures of the scene with this colouring, one of ``coloring.KINDS``.
    all_pictures : bool
        Whether every model and every sensor is shown, however many there are.

    Returns
    -------
    list of Path
        The files, in the order made.

    Raises
    ------
    ValueError
        If ``color`` is none of them, there is not one map a model, or the size is too small.
    """
    if color is not None and color not in KINDS:
        raise ValueError(f"color = '{color}' must be one of {', '.join(KINDS)}")
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
        for name, sheet in _sheets(stage, maps, chosen, size, view, color):
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


def _sheets(
    stage: Stage,
    maps: Sequence[VisibilityMap],
    chosen: Chosen,
    size: tuple[int, int],
    view: tuple[float, float] | None,
    color: str | None,
) -> Iterator[tuple[str, Sheet]]:
    """Yield the sheets with their names, each ready to be saved."""
    most = max(int(seen_map.counts.max(initial=0)) for seen_map in maps)
    for m in chosen.models:
        seen = replace(stage.show(m, maps[m]), most=most)
        model = seen.model.name
        for kind in [color] if color else KINDS:
            painted = coloring(kind, seen)
            stage.paint(painted.colors)
            if kind in _SURROUNDED:
                yield f"{model}-{kind}-perspective", perspective_sheet(stage, painted, size, view)
                yield f"{model}-{kind}-sides", sides_sheet(stage, painted, size, view)
            else:
                lay_out = unseen_sheet if kind == "unseen" else close_sheet
                yield f"{model}-{kind}", lay_out(stage, painted, size, view)
        if color is None:
            yield f"{model}-contact", contact_sheet(stage, size)
            for s in chosen.sensors if m == chosen.models[0] else ():
                name = stage.study.sensor_names[s]
                yield f"sensor-{name}", sensor_sheet(stage, s, size)
                yield f"sensor-{name}-depth", depth_sheet(stage, s, size)
    if color is None and len(chosen.models) < len(maps):
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
