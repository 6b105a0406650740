"""Layouts side by side: numbers, how far apart sensors stand, what only one of them sees."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from glvis.common.palette import OKABE_ITO, SEEN_COLOR, UNSEEN_COLOR, rgb
from glvis.pictures.coloring import STRIPED, Coloring, Swatch, coloring, share
from glvis.pictures.scenesheets import close_sheet, perspective_sheet
from glvis.pictures.sheet import Sheet
from glvis.pictures.stage import Stage
from glvis.problem.camera import distance_and_angle
from glvis.problem.pieces import noun_of_shares, share_of
from glvis.problem.scene import Model
from glvis.problem.units import MM_PER_UNIT
from glvis.search.placement import Placement, evaluate_poses

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
    if not have_one_unit(layouts):
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
    if not have_one_unit(layouts):
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
    model, noun = model_of(first, model_name), noun_of(first, [model_name])
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


def percentages(first: Layout, second: Layout, model_name: str, noun: str) -> list[float]:
    """Return the shares of a model that both see, one alone, or neither, in percent."""
    found = difference(first.placement, second.placement, model_name)
    model = model_of(first, model_name)
    return [100 * share_of(model, found == k, noun) for k in (BOTH, FIRST, SECOND, NEITHER)]


def model_of(layout: Layout, name: str) -> Model:
    """Return a model of a layout by its name."""
    return next(model for model in layout.placement.study.models if model.name == name)


def noun_of(layout: Layout, names: Sequence[str]) -> str:
    """Return of what the shares of some models are: faces or area."""
    by_area = layout.placement.study.objective.by_area
    return noun_of_shares([model_of(layout, name) for name in names], by_area)


def have_one_unit(layouts: Sequence[Layout]) -> bool:
    """Return whether numbers of all layouts are lengths in the same unit."""
    return len({MM_PER_UNIT[layout.placement.study.unit] for layout in layouts}) == 1


def _same(a: Model, b: Model) -> bool:
    if a is b:
        return True
    return np.array_equal(a.faces, b.faces) and np.array_equal(a.vertices, b.vertices)
