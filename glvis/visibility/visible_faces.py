"""From Python to a map in one call: a mesh, poses and a sensor in, the faces that are seen out."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any, TypeAlias

import numpy as np
from numpy.typing import ArrayLike, NDArray

from glvis.problem.scene import Model, load_model
from glvis.problem.sensor import Sensor
from glvis.problem.visibility_options import VisibilityOptions
from glvis.visibility.maps import LocalMaps, MapJob, MapScene

# A path, a trimesh.Trimesh (whatever has vertices and faces), or (vertices, faces).
Mesh: TypeAlias = Any

_RIGID = 1e-6  # largest error of a rotation's entries


def visible_faces(
    mesh: Mesh,
    camera_to_world: ArrayLike,
    sensor: Sensor,
    obstacles: Sequence[Mesh] = (),
    options: VisibilityOptions | None = None,
) -> NDArray[np.bool_]:
    """Return which faces of a mesh a sensor sees from some poses.

    Parameters
    ----------
    mesh : path, trimesh.Trimesh, or (vertices (V, 3), faces (F, 3))
        What is looked at; a path is read in the unit of the file. Lengths are in any one unit.
    camera_to_world : (..., 4, 4) float
        Poses: right, up, against the optical axis, and optical centre; see ``look_at``.
    sensor : Sensor
        Whose views they are; distances in the mesh's unit.
    obstacles : sequence of meshes
        What hides, but is not counted.
    options : VisibilityOptions, optional
        What counts as seen; by default a face does of which a point is free, its centre or, where
        it is large in the image, any of several.

    Returns
    -------
    visible : (..., F) bool
        One row a pose, in the face order of the mesh.

    Raises
    ------
    ValueError
        If a mesh is none, or a pose is not rigid.
    MachineError
        Where there is no OpenGL without a display.

    Examples
    --------
    >>> import glvis, trimesh
    >>> ball = trimesh.creation.icosphere(subdivisions=3, radius=50.0)
    >>> camera = glvis.Sensor.from_degrees(
    ...     hfov_deg=60, vfov_deg=45, resolution=(1280, 960), min_distance=100, max_distance=400)
    >>> poses = glvis.look_at([[300, 0, 0], [0, 0, 300]], [0, 0, 0])
    >>> glvis.visible_faces(ball, poses, camera).shape
    (2, 1280)

    Notes
    -----
    Each call sends the mesh to the GPU anew; give it many poses at a time, or use ``Evaluator``.
    Large faces are not cut into pieces, as studies do: a floor of two triangles counts whole.
    """
    poses = _checked_poses(camera_to_world)
    model = _model_of(mesh, "mesh")
    if isinstance(obstacles, str | Path) or not isinstance(obstacles, Sequence):
        raise ValueError("obstacles must be a sequence of meshes, such as [fixture]")
    hiding = tuple(_model_of(one, f"obstacles[{k}]") for k, one in enumerate(obstacles))
    maps = LocalMaps(MapScene((model,), hiding, (sensor,), options or VisibilityOptions()))
    try:
        (bits,) = maps.make([MapJob(0, poses.reshape(-1, 4, 4))])
    finally:
        maps.release()
    visible = np.unpackbits(bits, axis=1, count=model.n_faces).astype(bool)
    return visible.reshape(*poses.shape[:-2], model.n_faces)


def _model_of(mesh: Mesh, name: str) -> Model:
    """Return a mesh as a model; a ValueError says which one is none, and why."""
    try:
        if isinstance(mesh, Model):
            return mesh
        if isinstance(mesh, str | Path):
            return load_model(mesh)
        if hasattr(mesh, "vertices") and hasattr(mesh, "faces"):
            return Model.from_arrays(name, mesh.vertices, mesh.faces)
        if isinstance(mesh, tuple | list) and len(mesh) == 2:
            return Model.from_arrays(name, *mesh)
    except ValueError as error:
        where = f"{name} '{mesh}'" if isinstance(mesh, str | Path) else name
        raise ValueError(f"{where} {error}") from error
    raise ValueError(
        f"{name} must be a path, a trimesh.Trimesh or (vertices, faces), got {type(mesh).__name__}"
    )


def _checked_poses(camera_to_world: ArrayLike) -> NDArray[np.float64]:
    """Return poses (..., 4, 4); a ValueError says which one is not rigid."""
    poses = np.asarray(camera_to_world, dtype=float)
    if poses.shape[-2:] != (4, 4):
        raise ValueError(f"camera_to_world must have shape (..., 4, 4), got {poses.shape}")
    rotation = poses[..., :3, :3]
    finite = np.isfinite(poses).all(axis=(-2, -1))
    rotation = np.where(finite[..., None, None], rotation, 0.0)
    off = np.abs(rotation @ np.swapaxes(rotation, -2, -1) - np.eye(3)).max(axis=(-2, -1))
    last = np.abs(poses[..., 3, :] - [0, 0, 0, 1]).max(axis=-1)
    is_rigid = finite & (off <= _RIGID) & (last <= _RIGID) & (np.linalg.det(rotation) > 0)
    if not is_rigid.all():
        first = ", ".join(str(k) for k in np.argwhere(~is_rigid)[0].tolist())
        raise ValueError(
            f"camera_to_world{f'[{first}]' if first else ''} is no rigid pose: columns right, up, "
            "against the optical axis (unit vectors, right-handed) and position, last row "
            "0 0 0 1; see look_at"
        )
    return poses
