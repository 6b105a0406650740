"""Layouts side by side: numbers, how far apart sensors stand, what only one of them sees."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from glvis.camera import distance_and_angle
from glvis.drawing.coloring import STRIPED, Coloring, Swatch, coloring, share
from glvis.drawing.palette import OKABE_ITO, SEEN_COLOR, UNSEEN_COLOR, rgb
from glvis.drawing.scenesheets import close_sheet, perspective_sheet
from glvis.drawing.sheet import Sheet
from glvis.drawing.stage import Stage
from glvis.inputs.pieces import noun_of_shares, share_of
from glvis.inputs.scene import Model
from glvis.inputs.schema import MM_PER_UNIT
from glvis.optim.placement import Placement, evaluate_poses
from glvis.outputs.tables import mean_row, model_rows
from glvis.terminal import duration, table

# What each face of two maps is: seen by both, by the first or the second alone, by neither.
BOTH, FIRST, SECOND, NEITHER = range(4)
_SIZE = (1000, 1000)  # pixels of one layout in a row of them


@dataclass(frozen=True, eq=False)
class Layout:
    """A result and what it is called among others."""

    name: str
    placement: Placement


def named(directories: Sequence[Path], placements: Sequence[Placement]) -> list[Layout]:
    """Return layouts named by their folders, by more of the path where names are the same."""
    paths = [directory.resolve() for directory in directories]
    length = 1
    while True:
        names = [Path(*path.parts[-length:]).as_posix() for path in paths]
        if len(set(names)) == len(names) or length >= max(len(p.parts) for p in paths):
            break
        length += 1
    times: Counter[str] = Counter()
    layouts = []
    for name, placement in zip(names, placements, strict=True):
        times[name] += 1
        again = f" ({times[name]})" if times[name] > 1 else ""
        layouts.append(Layout(name + again, placement))
    return layouts


def cut_alike(layouts: Sequence[Layout]) -> list[Layout]:
    """Return layouts with the same pieces where only the cuts of shared meshes differ.

    Sensors that see less at a time cut more finely: the finest cut is taken, and the poses of the
    other layouts are looked at once more.

    Raises
    ------
    MachineError
        Where that needs OpenGL and there is none.
    """
    if not _have_one_unit(layouts):
        return list(layouts)
    by_name: list[dict[str, Model]] = [
        {model.name: model for model in layout.placement.study.models} for layout in layouts
    ]
    finest = {}
    for name, model in by_name[0].items():
        cuts = [models[name] for models in by_name if name in models]
        if len(cuts) == len(layouts) and all(_same(model.file, other.file) for other in cuts):
            finest[name] = max(cuts, key=lambda one: one.n_faces)
    return [replace(one, placement=_as_cut(one.placement, finest)) for one in layouts]


def _as_cut(placement: Placement, finest: dict[str, Model]) -> Placement:
    """Return a placement with other pieces of some models, its poses looked at again if need be."""
    study = placement.study
    models = tuple(finest.get(model.name, model) for model in study.models)
    if all(_same(one, other) for one, other in zip(models, study.models, strict=True)):
        return placement
    study = replace(study, models=models)
    again = evaluate_poses(study, placement.camera_to_world)
    return replace(placement, study=study, maps=again.maps, value=again.value)


def shared_models(layouts: Sequence[Layout]) -> list[str]:
    """Return the names of the models that are the same mesh, in one unit, in all layouts."""
    if not _have_one_unit(layouts):
        return []
    first, *others = ({m.name: m for m in layout.placement.study.models} for layout in layouts)
    return [
        name
        for name, model in first.items()
        if all(name in other and _same(model, other[name]) for other in others)
    ]


def difference(first: Placement, second: Placement, model_name: str) -> NDArray[np.int64]:
    """Return what each face of a shared model is: BOTH, FIRST, SECOND or NEITHER, (F,)."""
    a, b = (
        next(one for one in placement.maps if one.model_name == model_name).counts > 0
        for placement in (first, second)
    )
    return np.where(a, np.where(b, BOTH, FIRST), np.where(b, SECOND, NEITHER))


def comparison_rows(layouts: Sequence[Layout]) -> list[list[str]]:
    """Return the table of numbers: what it is, then one column a layout."""
    placements = [layout.placement for layout in layouts]
    studies = [placement.study for placement in placements]
    models = [
        model_rows(study.models, placement.maps, study.objective)
        for study, placement in zip(studies, placements, strict=True)
    ]
    means = [mean_row(rows) for rows in models]
    kinds = [study.objective.label for study in studies]
    label = kinds[0] if len(set(kinds)) == 1 else "objective"
    rows = [["sensors", *(str(len(study.sensors)) for study in studies)]]
    rows.append(
        [label]
        + [
            f"{placement.value:.4f}" + ("" if len(set(kinds)) == 1 else f" ({kind})")
            for placement, kind in zip(placements, kinds, strict=True)
        ]
    )
    rows.append(["seen, mean %", *(f"{mean['percentage']:.2f}" for mean in means)])
    rows.append(["area seen, mean %", *(f"{mean['area_percentage']:.2f}" for mean in means)])
    for n in range(2, min(4, max(len(study.sensors) for study in studies)) + 1):
        shares = [mean.get(f"share_seen_by_{n}") for mean in means]
        rows.append([f"by {n}+, mean %", *("" if s is None else f"{100 * s:.2f}" for s in shares)])
    names = list(dict.fromkeys(row.name for found in models for row in found))
    for name in names if len(names) > 1 else []:
        seen = [{row.name: row.percentage for row in found}.get(name) for found in models]
        rows.append([f"{name} seen %", *("" if s is None else f"{s:.2f}" for s in seen)])
    rows.append(["evaluations", *(f"{placement.evaluations:,}" for placement in placements)])
    rows.append(["time", *(duration(placement.seconds) for placement in placements)])
    return rows


def comparison_lines(layouts: Sequence[Layout]) -> Iterator[str]:
    """Yield the table, and against the first layout: gains, losses, how far sensors moved."""
    given, layouts = layouts, cut_alike(layouts)
    first, *others = layouts
    yield from table(["", *(layout.name for layout in layouts)], comparison_rows(layouts))
    for one, before in zip(layouts, given, strict=True):
        if one.placement is not before.placement:
            yield (
                f"{one.name} is told by the finer pieces of others; by its own its objective was "
                f"{before.placement.value:.4f}"
            )
    models = shared_models(layouts)
    for other in others:
        if models:
            yield ""
            yield f"{other.name} against {first.name}, % of the {_noun(first, models)}"
            yield from table(
                ("model", "both see", f"only {first.name}", f"only {other.name}", "neither"),
                [
                    (name, *(f"{value:.2f}" for value in percentages))
                    for name in models
                    for percentages in [_percentages(first, other, name, _noun(first, models))]
                ],
            )
        moved = sensor_moves(first.placement, other.placement)
        if moved:
            unit = first.placement.study.unit
            yield ""
            yield f"Sensors of {other.name} against those of {first.name}"
            yield from table(
                ("sensor", f"moved [{unit}]", "turned [deg]"),
                [
                    (name, f"{round(far, 6):.4g}", f"{round(turn, 4):.3g}")
                    for name, far, turn in moved
                ],
            )
    if not models:
        yield ""
        units = "" if _have_one_unit(layouts) else " in one unit"
        yield f"No model is the same mesh{units} in all layouts: what they see cannot be compared"


def sensor_moves(first: Placement, second: Placement) -> list[tuple[str, float, float]]:
    """Return name, distance and angle between sensors of the same name.

    Distances are in the unit of the first, whatever the unit of the second; angles in degrees.
    """
    poses = second.camera_to_world.copy()
    poses[:, :3, 3] *= MM_PER_UNIT[second.study.unit] / MM_PER_UNIT[first.study.unit]
    places = dict(zip(second.study.sensor_names, poses, strict=True))
    moves = []
    for name, a in zip(first.study.sensor_names, first.camera_to_world, strict=True):
        if name in places:
            far, turn = distance_and_angle(a, places[name])
            moves.append((name, float(far), math.degrees(turn)))
    return moves


def write_comparison(layouts: Sequence[Layout], directory: Path) -> list[Path]:
    """Write each shared model's layouts side by side, and what differs from the first.

    Raises
    ------
    MachineError
        Where there is no OpenGL.
    """
    paths, layouts = [], cut_alike(layouts)
    for name in shared_models(layouts):
        paths.append(directory / f"{name}-side-by-side.png")
        _side_by_side(layouts, name).save(paths[-1])
        for number, other in enumerate(layouts[1:], start=2):
            suffix = f"-{number}" if len(layouts) > 2 else ""
            paths.append(directory / f"{name}-difference{suffix}.png")
            _difference_sheet(layouts[0], other, name).save(paths[-1])
    return paths


def difference_coloring(first: Layout, second: Layout, model_name: str) -> Coloring:
    """Return the colours of a shared model by who sees what."""
    found = difference(first.placement, second.placement, model_name)
    tints = np.array([SEEN_COLOR, rgb(OKABE_ITO[0]), rgb(OKABE_ITO[1]), UNSEEN_COLOR])
    colors = np.full((len(found), 4), 255, dtype=np.uint8)
    colors[:, :3] = tints[found]
    colors[found == NEITHER, 3] = STRIPED
    model, noun = _model(first, model_name), _noun(first, [model_name])
    shares = {k: share_of(model, found == k, noun) for k in (BOTH, FIRST, SECOND, NEITHER)}
    whole = "the area" if noun == "area" else f"{model.n_faces:,} faces"
    labels = ("both", f"only {first.name}", f"only {second.name}", "neither")
    return Coloring(
        f"{first.name} and {second.name}: who sees what",
        colors,
        [
            Swatch(tints[k], label, share(shares[k]), is_striped=k == NEITHER)
            for k, label in enumerate(labels)
        ],
        heading=noun,
        facts=f"of {whole} {first.name} sees {share(shares[BOTH] + shares[FIRST])}, "
        f"{second.name} {share(shares[BOTH] + shares[SECOND])}",
    )


def _side_by_side(layouts: Sequence[Layout], model_name: str) -> Sheet:
    width, height = _SIZE
    sheet = Sheet((width * len(layouts), height))
    for column, layout in enumerate(layouts):
        placement = layout.placement
        m = [model.name for model in placement.study.models].index(model_name)
        with Stage(placement.study, placement.camera_to_world) as stage:
            seen = stage.show(m, placement.maps[m])
            painted = coloring("sensor", seen)
            painted = replace(painted, title=f"{layout.name}: which sensor sees which face")
            stage.paint(painted.colors)
            # the view follows from the model alone, so the model is drawn alike for all
            one = perspective_sheet(stage, painted, _SIZE, is_fixed=True)
        sheet.paste(one.pixels(), column * width, 0)
    return sheet


def _difference_sheet(first: Layout, second: Layout, model_name: str) -> Sheet:
    placement = second.placement
    # what the sheet says below its title is about the second alone
    study = replace(placement.study, title=second.name)
    m = [model.name for model in placement.study.models].index(model_name)
    with Stage(study, placement.camera_to_world) as stage:
        stage.show(m, placement.maps[m])
        painted = difference_coloring(first, second, model_name)
        stage.paint(painted.colors)
        return close_sheet(stage, painted)


def _percentages(first: Layout, second: Layout, model_name: str, noun: str) -> list[float]:
    found = difference(first.placement, second.placement, model_name)
    model = _model(first, model_name)
    return [100 * share_of(model, found == k, noun) for k in (BOTH, FIRST, SECOND, NEITHER)]


def _model(layout: Layout, name: str) -> Model:
    return next(model for model in layout.placement.study.models if model.name == name)


def _noun(layout: Layout, names: Sequence[str]) -> str:
    """Return of what the shares of some models are: faces or area."""
    by_area = layout.placement.study.objective.by_area
    return noun_of_shares([_model(layout, name) for name in names], by_area)


def _have_one_unit(layouts: Sequence[Layout]) -> bool:
    """Return whether numbers of all layouts are lengths in the same unit."""
    return len({MM_PER_UNIT[layout.placement.study.unit] for layout in layouts}) == 1


def _same(a: Model, b: Model) -> bool:
    if a is b:
        return True
    return np.array_equal(a.faces, b.faces) and np.array_equal(a.vertices, b.vertices)
