"""Why surface stays unseen, where it lies, and what each sensor is good for.

Every unseen face gets one reason: that of the sensor that came closest to seeing it. So the
areas of the reasons add up to the unseen area. Judged at the face's centre of mass, as the
criterion "centroid" does; with the paper's semantics by its rules for vertices. What no allowed
pose sees is out of reach, whatever else kept a sensor from seeing it. A face whose back a sensor
would see is seen from behind before all that: a mesh that is inside out has no other fault.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from glvis.problem.scene import Model
from glvis.problem.study import Study
from glvis.problem.visibility_options import asks_about_points
from glvis.search.placement import Placement, evaluate_poses
from glvis.visibility.filters import Refusal, refusals_of_sensor

Floats = NDArray[np.float64]
Bools = NDArray[np.bool_]
Integers = NDArray[np.int64]

# From the farthest from being seen to the nearest: first as ``filters.Refusal`` has them. The last
# four stand above them all.
REASONS = (
    "nothing looks there",
    "turned away",
    "too far",
    "too near",
    "too oblique",
    "outside the partner's image",
    "turned from the partner",
    "hidden by the model",
    "hidden by an obstacle",
    "smaller than a pixel",
    "no area",
    "out of reach",
    "seen from behind",
    "hidden from the partner",
)
_HIDDEN = int(Refusal.NONE)
_OBSTRUCTED, _TINY, _NO_AREA, _NOWHERE, _BEHIND, _FROM_PARTNER = range(_HIDDEN + 1, len(REASONS))
SEEN = -1
_OTHERWISE = (SEEN, _OBSTRUCTED, _TINY, _NO_AREA)  # what no look from behind changes


def unseen_reasons(placement: Placement) -> list[Integers]:
    """Return for each model why each face is unseen, (F,) index into REASONS, or SEEN.

    Raises
    ------
    MachineError
        Where there is no OpenGL; hiding by obstacles is told by a second look without them,
        backs by one at the models turned inside out.
    """
    study, poses = placement.study, placement.camera_to_world
    found = []
    for model, seen_map in zip(study.models, placement.maps, strict=True):
        closest = refusals_of(model, study, poses).max(axis=0).astype(int)
        closest[model.areas == 0] = _NO_AREA
        closest[seen_map.counts > 0] = SEEN
        found.append(closest)
    if any(sensor.partner for sensor in study.sensors):
        alone = tuple(replace(sensor, partner=None, noise=None) for sensor in study.sensors)
        _tell_from_hidden(placement, found, _FROM_PARTNER, replace(study, sensors=alone))
    if study.obstacles and any((reason == _HIDDEN).any() for reason in found):
        _tell_from_hidden(placement, found, _OBSTRUCTED, replace(study, obstacles=()))
    options = study.visibility
    if not asks_about_points(options):
        by_centre = replace(options, criterion="centroid", min_pixels=1)
        _tell_from_hidden(placement, found, _TINY, replace(study, visibility=by_centre))
    if placement.reach:
        for reasons, by in zip(found, placement.reach.sensors, strict=True):
            reasons[(by == 0) & (reasons != _NO_AREA)] = _NOWHERE
    turned = replace(study, models=tuple(model.flipped() for model in study.models))
    backs = evaluate_poses(turned, poses).maps
    for reasons, seen_map in zip(found, backs, strict=True):
        reasons[(seen_map.counts > 0) & ~np.isin(reasons, _OTHERWISE)] = _BEHIND
    return found


def values_without(placement: Placement) -> Floats:
    """Return the value of the objective without each sensor in turn, (S,) float64."""
    study = placement.study
    areas = [model.areas for model in study.models]
    values = [
        study.objective.value_by_model([m.counts - m.visible[s] for m in placement.maps], areas)
        for s in range(len(study.sensors))
    ]
    return study.objective.aggregated(values)


def refusals_of(model: Model, study: Study, camera_to_world: Floats) -> NDArray[np.uint8]:
    """Return which filter of each sensor refuses each face first, (S, F) by ``Refusal``.

    Parameters
    ----------
    model : Model
        F faces.
    study : Study
        S sensors, and what counts as visible.
    camera_to_world : (S, 4, 4) float64
        Poses.
    """
    options = study.visibility
    refused = np.zeros((len(study.sensors), model.n_faces), dtype=np.uint8)
    for row, sensor, pose in zip(refused, study.sensors, camera_to_world, strict=True):
        row[:] = refusals_of_sensor(model, pose, sensor, options)
    return refused


def _tell_from_hidden(
    placement: Placement, found: list[Integers], reason: int, study: Study
) -> None:
    """Give hidden faces another reason where another study with the same poses sees them."""
    again = evaluate_poses(study, placement.camera_to_world)
    for reasons, seen_map in zip(found, again.maps, strict=True):
        reasons[(reasons == _HIDDEN) & (seen_map.counts > 0)] = reason
