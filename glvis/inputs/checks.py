"""What a study allows and the user will regret: wrong units, broken windings, blind sensors.

Sentences only; nothing here stops a run.
"""

from __future__ import annotations

import numpy as np

from glvis.camera import rigid_inverse
from glvis.inputs.mounts import Array
from glvis.inputs.scene import Model
from glvis.inputs.study import Study

_SAMPLE = 20_000  # faces or vertices a model, enough to say where it lies
# Sizes of a model, in longest working ranges, beyond which the unit is in doubt.
_TINY, _HUGE = 0.05, 50.0


def study_warnings(study: Study) -> list[str]:
    """Return what will disappoint, one sentence each; an empty list is good news."""
    poses = study.rig.poses(study.rig.start)
    warnings: list[str] = []
    for model in study.models:
        warnings += [*_surface(model.file, poses), _distance(model, poses, study)]
    return [*filter(None, warnings), *_blind(poses, study)]


def _surface(model: Model, poses: Array) -> list[str]:
    """Return what is wrong with the faces of a model themselves."""
    found = []
    without_area = int(np.count_nonzero(model.areas == 0))
    if without_area:
        found.append(
            f"{model.name}: {without_area} of {model.n_faces} faces have no area; "
            "they are counted and can never be seen"
        )
    if not model.is_consistent:
        found.append(
            f"{model.name}: two faces walk {model.inconsistent_edges} edges in the same direction; "
            "some normals point inwards and their faces count as seen from behind"
        )
    elif model.is_closed and _volume(model) < 0:
        low, high = model.bounds
        places = poses[:, :3, 3]
        if not ((places > low) & (places < high)).all(axis=1).any():  # a room is seen from inside
            found.append(
                f"{model.name}: its normals point inwards; from outside no face can be seen"
            )
    return found


def _distance(model: Model, poses: Array, study: Study) -> str:
    """Return what in the size or distance of a model speaks for another unit, or ""."""
    reach = max(sensor.max_distance for sensor in study.sensors)
    size = float(np.linalg.norm(model.bounds[1] - model.bounds[0]))
    doubt = f"is unit = '{study.unit}' right?"
    if not _TINY * reach <= size <= _HUGE * reach:
        return (
            f"{model.name}: is {size:.3g} {study.unit} across, the sensors reach {reach:.3g} "
            f"{study.unit}; {doubt}"
        )
    points = model.vertices[:: -(-len(model.vertices) // _SAMPLE)]
    depths = np.stack([-_in_camera(points, pose)[:, 2] for pose in poses])
    nearest = np.array([sensor.min_distance for sensor in study.sensors])
    farthest = np.array([sensor.max_distance for sensor in study.sensors])
    if (depths > farthest[:, None]).all():
        return (
            f"{model.name}: at the start all of it lies beyond max_distance of every sensor "
            f"(nearest depth {depths.min():.4g} {study.unit}); {doubt}"
        )
    if ((depths >= 0) & (depths < nearest[:, None])).all():
        return (
            f"{model.name}: at the start all of it lies nearer than min_distance of every sensor "
            f"(largest depth {depths.max():.4g} {study.unit}); {doubt}"
        )
    return ""


def _blind(poses: Array, study: Study) -> list[str]:
    """Return the sensors that have nothing in view and range at the start."""
    is_blind = np.ones(len(poses), dtype=bool)
    for model in study.models:
        faces = model.faces[:: -(-model.n_faces // _SAMPLE)]
        corners = model.vertices[faces]
        for index, sensor in enumerate(study.sensors):
            points = _in_camera(corners, poses[index])
            depth = -points[..., 2]
            edge = sensor.intrinsics.tan_half * depth[..., None]
            # How far each corner lies outside of each plane; a face that has all its corners
            # outside of one plane is out of view, however large it is.
            outside = np.stack(
                [
                    sensor.min_distance - depth,
                    depth - sensor.max_distance,
                    *np.moveaxis(points[..., :2] - edge, -1, 0),
                    *np.moveaxis(-points[..., :2] - edge, -1, 0),
                ]
            )
            is_blind[index] &= bool((outside > 0).all(axis=-1).any(axis=0).all())
    if is_blind.all():
        return ["at the start no sensor has any part of a model in view and range"]
    blind = [name for name, alone in zip(study.sensor_names, is_blind, strict=True) if alone]
    return [f"{name}: has no part of a model in view and range at the start" for name in blind]


def _in_camera(points: Array, pose: Array) -> Array:
    """Return points (..., 3) of the world in a camera's frame."""
    to_camera = rigid_inverse(pose)
    return np.asarray(points @ to_camera[:3, :3].T + to_camera[:3, 3])


def _volume(model: Model) -> float:
    """Return the volume inside a closed model, negative where its normals point inwards."""
    from_middle = model.centroids - model.bounds.mean(axis=0)
    return float(np.einsum("ij,ij,i->", from_middle, model.normals, model.areas)) / 3
