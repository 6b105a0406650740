"""What a study allows and the user will regret: wrong units, broken windings, blind sensors.

Sentences only; nothing here stops a run.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from glvis.evaluation.lens_checks import lens_warnings
from glvis.problem.camera import rigid_inverse
from glvis.problem.lens import Pinhole
from glvis.problem.mounts import Array
from glvis.problem.scene import Model
from glvis.problem.sensor import Sensor
from glvis.problem.study import Study
from glvis.problem.units import (
    MM_PER_UNIT,
    guess_words,
    mm_per_own_unit,
    own_scale,
    short,
    unit_guess,
)
from glvis.problem.winding import Winding, is_in_solid, winding
from glvis.visibility.filters import may_pass
from glvis.visibility.points import corners_in_camera
from glvis.visibility.views import Views

_SAMPLE = 20_000  # faces or vertices a model, enough to say where it lies
# Sizes of a model, in longest working ranges, beyond which the unit is in doubt.
_TINY, _HUGE = 0.05, 50.0
_ALL = 0.9  # of a model's area that is inside out: then the model is
_UNEVEN = 0.1  # of the area that half of the faces hold; of even ones it is above 0.35
_INSIDE_OUT = "is inside out: its normals point inwards, and from outside no face counts as seen"
_MEND = (
    "let the program that made the mesh recalculate its normals (Blender: Recalculate Outside, "
    "MeshLab: Re-Orient all faces coherently)"
)
_MOST_NAMES = 3  # of models in a line
_TRIES = 4  # positions at which sensors are held against each other, beside the start
_SAME = 1e-6  # of a model's diagonal
_SQUARE = 0.03  # by which fx and fy of one pinhole may differ: angles are rounded


@dataclass(frozen=True)
class Told:
    """A sentence about a model, and its kind: models share kinds, and people read one of each."""

    kind: str
    model: str
    sentence: str


def study_warnings(study: Study) -> list[str]:
    """Return what will disappoint, one sentence each; an empty list is good news."""
    poses = study.rig.poses(study.rig.start)
    windings = [winding(model.file) for model in study.models]
    shares = [
        _share_inside_out(model.file, wound, poses)
        for model, wound in zip(study.models, windings, strict=True)
    ]
    turned = [m.name for m, share in zip(study.models, shares, strict=True) if share > _ALL]
    found: list[Told] = []
    flip = "true" if len(turned) == len(study.models) else str(turned)
    for model, wound, share in zip(study.models, windings, shares, strict=True):
        found += _surface(model.file, wound)
        if share > _ALL:
            found += _told("inside out", model, f"{_INSIDE_OUT}; set [scene] flip = {flip}")
        elif share:
            part = f"{_share(wound.inside_out)} of the faces belong to bodies that are inside out"
            found += _told(
                "bodies", model, f"{part}, and from outside none counts as seen; {_MEND}"
            )
        found += _told("distance", model, _distance(model, poses, study))
        found += _told("count", model, _counted(model, study))
    return [
        *said_once(found),
        *no_pinholes(study.sensors),
        *lens_warnings(study),
        *_blind(poses, study),
        *_misplaced(poses, study),
    ]


def no_pinholes(sensors: Sequence[Sensor]) -> list[str]:
    """Return the sensors whose two opening angles are no one pinhole, a sentence each.

    Pixels are square: the focal lengths that follow from the width and from the height agree, or
    the angles are those of a distorted lens, of two fields that overlap, or mistyped.
    """
    lines = []
    for sensor in dict.fromkeys(sensors):
        if not isinstance(sensor.lens, Pinhole):
            continue
        fx, fy = sensor.focal_pixels()
        if max(fx, fy) <= (1 + _SQUARE) * min(fx, fy):
            continue
        hfov, vfov = (f"{math.degrees(angle):.4g}" for angle in sensor.lens.opening)
        width, height = sensor.resolution
        square = math.degrees(2 * math.atan(height / (2 * fx)))
        lines.append(
            f"{sensor.name}: {hfov} x {vfov} deg are no one pinhole of {width} x {height} pixels: "
            f"their focal lengths are {fx:.0f} and {fy:.0f} pixels, {hfov} deg go with "
            f"{square:.4g}; give focal_px and the lens, or a calibration"
        )
    return lines


def size_doubts(study: Study) -> list[str]:
    """Return the models whose size makes another unit likelier, one sentence of all.

    Sensors that were made to measure fit whatever the unit is: only the size can tell.
    """
    found: list[Told] = []
    for model in study.models:
        size = float(np.linalg.norm(model.bounds[1] - model.bounds[0]))
        guess = unit_guess(size, study.unit)
        words = f"is {short(size)} {study.unit} across; {guess_words(size, guess)}"
        if guess and _is_in_reach(size, study):  # else ``study_warnings`` says so
            found += _told("size", model, f"{words} {_remedy(model, guess, study.unit)}")
    return said_once(found)


def said_once(found: Sequence[Told]) -> list[str]:
    """Return sentences of models, each kind once: that of the first, and the others' names."""
    kinds: dict[str, list[Told]] = {}
    for one in found:
        kinds.setdefault(one.kind, []).append(one)
    lines = []
    for first, *others in kinds.values():
        names = [one.model for one in others]
        if len(names) > _MOST_NAMES:
            names = [*names[: _MOST_NAMES - 1], f"{len(names) - _MOST_NAMES + 1} more"]
        likewise = f" (likewise {', '.join(names)}: {len(others) + 1} models)" if others else ""
        lines.append(f"{first.model}: {first.sentence}{likewise}")
    return lines


def _told(kind: str, model: Model, sentence: str) -> list[Told]:
    return [Told(kind, model.name, sentence)] if sentence else []


def _share_inside_out(model: Model, found: Winding, poses: Array) -> float:
    """Return the share of a model's area that is inside out; a room seen from within is not."""
    places = poses[:, :3, 3]
    low, high = model.bounds
    is_room = ((places > low) & (places < high)).all(axis=1).any()
    return 0.0 if is_room else float(model.areas[found.inside_out].sum() / model.areas.sum())


def _surface(model: Model, found: Winding) -> Iterator[Told]:
    """Yield what is wrong with the faces of a model themselves."""
    without_area = int(np.count_nonzero(model.areas == 0))
    if without_area:
        yield Told(
            "no area",
            model.name,
            f"{without_area} of {model.n_faces} faces have no area; "
            "they are counted and can never be seen",
        )
    if found.disputed_edges:
        yield Told(
            "against",
            model.name,
            f"{_share(found.against)} of the faces are wound against their neighbours (two faces "
            f"walk {found.disputed_edges} edges in the same direction) and count as seen from "
            f"behind; {_MEND}",
        )
    if found.doubled.any():
        yield Told(
            "doubled",
            model.name,
            f"{_share(found.doubled)} of the faces lie on another one that looks the other way "
            "(sheets modelled from both sides); each counts by itself, also where no sensor can "
            "get behind",
        )


def _share(chosen: NDArray[np.bool_]) -> str:
    percent = 100 * float(chosen.mean())
    return f"{percent:.0f} %" if percent >= 1 else f"{np.count_nonzero(chosen)} of {len(chosen)}"


def _counted(model: Model, study: Study) -> str:
    """Return that faces are no measure of the surface, if the objective counts them, or ""."""
    if study.objective.by_area:
        return ""
    areas = np.sort(model.areas)
    half = float(areas[: len(areas) // 2].sum() / areas.sum())
    if half > _UNEVEN:
        return ""
    return (
        f"the smaller half of the faces holds {100 * half:.1f} % of the area, and the objective "
        "counts faces; [objective] by_area = true counts area"
    )


def _distance(model: Model, poses: Array, study: Study) -> str:
    """Return what in the size or distance of a model speaks for another unit, or ""."""
    size = float(np.linalg.norm(model.bounds[1] - model.bounds[0]))
    guess = unit_guess(size, study.unit)
    doubt = f"is unit = '{study.unit}' right?"
    if guess:
        doubt = f"{guess_words(size, guess)} {_remedy(model, guess, study.unit)}"
    if not _is_in_reach(size, study):
        reach = max(sensor.max_distance for sensor in study.sensors)
        return (
            f"is {short(size)} {study.unit} across, the sensors reach {short(reach)} {study.unit}; "
            f"{doubt}"
        )
    points = model.vertices[:: -(-len(model.vertices) // _SAMPLE)]
    depths = np.stack(
        [
            np.linalg.norm(points - pose[:3, 3], axis=1)
            if sensor.distance == "range"
            else -_in_camera(points, pose)[:, 2]
            for sensor, pose in zip(study.sensors, poses, strict=True)
        ]
    )
    nearest = np.array([sensor.min_distance for sensor in study.sensors])
    farthest = np.array([sensor.max_distance for sensor in study.sensors])
    if (depths > farthest[:, None]).all():
        return (
            f"at the start all of it lies beyond max_distance of every sensor "
            f"(nearest distance {depths.min():.4g} {study.unit}); {doubt}"
        )
    if ((depths >= 0) & (depths < nearest[:, None])).all():
        return (
            f"at the start all of it lies nearer than min_distance of every sensor "
            f"(largest distance {depths.max():.4g} {study.unit}); {doubt}"
        )
    return ""


def _is_in_reach(size: float, study: Study) -> bool:
    """Return whether a model of some size is about as large as the sensors see far."""
    reach = max(sensor.max_distance for sensor in study.sensors)
    return _TINY * reach <= size <= _HUGE * reach


def _remedy(model: Model, guess: Sequence[str], unit: str) -> str:
    """Return what to write where a unit is another; a format that says its own needs a factor."""
    if model.path is None or mm_per_own_unit(model.path) is None:
        return "unit = " + " or ".join(f"'{other}'" for other in guess)
    factors = [MM_PER_UNIT[other] / MM_PER_UNIT[unit] for other in guess]
    return "[scene] scale = " + " or ".join(f"{own_scale(model.path, unit) * f:g}" for f in factors)


def _blind(poses: Array, study: Study) -> list[str]:
    """Return the sensors that have nothing in view and range at the start."""
    is_blind = np.ones(len(poses), dtype=bool)
    for model in study.models:
        sampled = np.arange(0, model.n_faces, -(-model.n_faces // _SAMPLE))
        for index, sensor in enumerate(study.sensors):
            views = Views.of(poses[index][None], sensor, model.bounds, study.visibility)
            is_blind[index] &= not all(_may_show(model, sampled, eye) for eye in views.viewpoints)
    if is_blind.all():
        return ["at the start no sensor has any part of a model in view and range"]
    blind = [name for name, alone in zip(study.sensor_names, is_blind, strict=True) if alone]
    return [f"{name}: has no part of a model in view and range at the start" for name in blind]


def _may_show(model: Model, sampled: NDArray[np.integer], views: Views) -> bool:
    """Return whether one of some faces may lie in a window of a viewpoint, and in range."""
    tan_half, depth_range = views.windows.tan_half[:, None], np.array(views.depth_range)[:, None]
    return any(
        may_pass(corners_in_camera(model, sampled, pose), tan_half, depth_range).any()
        for pose in views.windows.camera_to_world
    )


def _misplaced(poses: Array, study: Study) -> Iterator[str]:
    """Yield the sensors that stand in solid material at the start, and those that always meet."""
    places, names = poses[:, :3, 3], study.sensor_names
    for mesh in dict.fromkeys([m.file for m in (*study.models, *study.obstacles)]):
        inside = [
            name for name, is_in in zip(names, is_in_solid(mesh, places), strict=True) if is_in
        ]
        if inside:
            yield (
                f"{', '.join(inside)}: at the start in solid material of {mesh.name}, or behind "
                "its walls; nothing is seen from there"
            )
    others = np.random.default_rng(0).uniform(
        study.rig.bounds[:, 0], study.rig.bounds[:, 1], (_TRIES, len(study.variables))
    )
    anywhere = np.concatenate([places[None], study.rig.poses(others)[:, :, :3, 3]])
    size = max(float(np.linalg.norm(np.ptp(model.bounds, axis=0))) for model in study.models)
    for s in range(len(names)):
        gaps = np.linalg.norm(anywhere - anywhere[:, s : s + 1], axis=2).max(axis=0)
        together = [names[k] for k in np.flatnonzero(gaps <= _SAME * size)]
        if len(together) > 1 and together[0] == names[s]:
            yield f"{', '.join(together)}: stand at the same point, wherever the search puts them"


def _in_camera(points: Array, pose: Array) -> Array:
    """Return points (..., 3) of the world in a camera's frame."""
    to_camera = rigid_inverse(pose)
    return np.asarray(points @ to_camera[:3, :3].T + to_camera[:3, 3])
