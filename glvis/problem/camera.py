"""Poses of cameras, and the matrices that follow from them.

World is the frame of the mesh files. The camera frame is OpenGL's: x right, y up, looking
along -z. Matrices are named ``a_to_b`` and multiply column vectors. Angles are radians.
Nothing here knows of lenses, meshes, sensors or OpenGL.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import ArrayLike, NDArray

Array = NDArray[np.float64]

_PARALLEL = 1e-9  # sine below which the optical axis counts as parallel to ``up``


def direction_from_angles(azimuth: ArrayLike, elevation: ArrayLike) -> Array:
    """Return unit directions, (..., 3), for azimuth and elevation in radians.

    Azimuth turns from +X towards +Y in the XY plane, elevation rises from it towards +Z.
    Table 10 of the paper reads so (theta = azimuth, gamma = elevation modulo 2 pi).
    """
    azimuth, elevation = np.broadcast_arrays(azimuth, elevation)
    return np.stack(
        [
            np.cos(azimuth) * np.cos(elevation),
            np.sin(azimuth) * np.cos(elevation),
            np.sin(elevation),
        ],
        axis=-1,
    )


def angles_from_direction(direction: ArrayLike) -> tuple[Array, Array]:
    """Return azimuth and elevation, radians, of directions (..., 3) of any length > 0."""
    d = np.asarray(direction, dtype=float)
    return np.arctan2(d[..., 1], d[..., 0]), np.arctan2(d[..., 2], np.hypot(d[..., 0], d[..., 1]))


def _normalized(vector: ArrayLike) -> Array:
    """Return vectors (..., 3) at unit length; a zero vector is an error."""
    v = np.asarray(vector, dtype=float)
    length = np.linalg.norm(v, axis=-1, keepdims=True)
    if not np.all(np.isfinite(v)) or np.any(length == 0):
        raise ValueError("a direction must be finite and not zero")
    return v / length


def _unrolled_axes(direction: Array, up: Array) -> tuple[Array, Array]:
    """Return right and up of the unrolled image for unit directions (..., 3).

    Image up is the projection of ``up``. Where the direction is parallel to ``up`` the
    world axis least aligned with ``up`` (x before y before z) stands in for it.
    """
    fallback = np.eye(3)[np.argmin(np.abs(np.round(up, 12)))]
    right = np.cross(direction, up)
    length = np.linalg.norm(right, axis=-1, keepdims=True)
    parallel = length <= _PARALLEL
    right = np.where(parallel, np.cross(direction, fallback), right)
    right = right / np.where(parallel, np.linalg.norm(right, axis=-1, keepdims=True), length)
    return right, np.cross(right, direction)


def look_along(
    position: ArrayLike, direction: ArrayLike, roll: ArrayLike = 0.0, up: ArrayLike = (0, 0, 1)
) -> Array:
    """Return poses of cameras at ``position`` that look along ``direction``.

    Parameters
    ----------
    position, direction : (..., 3) float
        Optical centre and optical axis in the world; the axis may have any length > 0.
    roll : (...) float
        Rotation about the optical axis by the right-hand rule, radians.
        Roll 0 puts the image's up along the projection of ``up``.
    up : (3,) float
        World direction that an unrolled image shows upright. An optical axis parallel to it
        takes, in its stead, the world axis least aligned with ``up``.

    Returns
    -------
    camera_to_world : (..., 4, 4) float64
        Proper rigid transforms: the columns are right, up, -direction and position.

    Raises
    ------
    ValueError
        If a direction or ``up`` is zero or not finite.

    References
    ----------
    Sec. 2.1 (optimisation variables) and Sec. 3.1 (roll by the right-hand rule).
    """
    d = _normalized(direction)
    right0, up0 = _unrolled_axes(d, _normalized(up))
    cos, sin = np.cos(roll)[..., None], np.sin(roll)[..., None]
    right = right0 * cos - up0 * sin
    image_up = right0 * sin + up0 * cos
    shape = np.broadcast_shapes(right.shape, np.shape(position))
    pose = np.zeros((*shape[:-1], 4, 4))
    pose[..., :3, 0] = right
    pose[..., :3, 1] = image_up
    pose[..., :3, 2] = -d
    pose[..., :3, 3] = position
    pose[..., 3, 3] = 1.0
    return pose


def look_at(
    position: ArrayLike, target: ArrayLike, up: ArrayLike = (0, 0, 1), roll_deg: ArrayLike = 0.0
) -> Array:
    """Return poses of cameras at ``position`` whose optical axes go through ``target``.

    Parameters
    ----------
    position, target : (..., 3) float
        Optical centre, and a point that is in the middle of the image; world frame.
    up : (3,) float
        World direction that an unrolled image shows upright.
    roll_deg : (...) float
        Rotation about the optical axis by the right-hand rule, degrees.

    Returns
    -------
    camera_to_world : (..., 4, 4) float64
        Rigid poses: columns right, up, against the optical axis, and position.

    Raises
    ------
    ValueError
        If a target is its position, or ``up`` is zero.

    Examples
    --------
    >>> import glvis
    >>> glvis.look_at([0, -10, 0], [0, 0, 0]).round(3) + 0.0
    array([[  1.,   0.,   0.,   0.],
           [  0.,   0.,  -1., -10.],
           [  0.,   1.,   0.,   0.],
           [  0.,   0.,   0.,   1.]])
    """
    position, target = np.asarray(position, dtype=float), np.asarray(target, dtype=float)
    for name, points in (("position", position), ("target", target)):
        if points.shape[-1:] != (3,) or not np.isfinite(points).all():
            raise ValueError(f"{name} must be finite and of shape (..., 3), got {points.shape}")
    if not np.isfinite(roll_deg).all():
        raise ValueError("roll_deg must be finite")
    if (position == target).all(axis=-1).any():
        raise ValueError("target must not be where the camera stands")
    return look_along(position, target - position, np.radians(roll_deg), up)


def position_direction_roll(
    pose: ArrayLike, up: ArrayLike = (0, 0, 1)
) -> tuple[Array, Array, Array]:
    """Return position (..., 3), unit direction (..., 3) and roll (...), the inverse of a pose."""
    m = np.asarray(pose, dtype=float)
    direction = -m[..., :3, 2]
    right0, up0 = _unrolled_axes(direction, _normalized(up))
    right = m[..., :3, 0]
    roll = np.arctan2(-np.sum(right * up0, axis=-1), np.sum(right * right0, axis=-1))
    return m[..., :3, 3], direction, roll


def mirrored_pose(pose: ArrayLike, point: ArrayLike, normal: ArrayLike) -> Array:
    """Return poses (..., 4, 4) mirrored over a plane: the twin sees the mirrored scene.

    Position, direction and image up are reflected and right is turned back, so the result is
    a proper rotation. Where the study's ``up`` lies in the plane, that is the same sensor with
    reflected position and direction and the opposite roll; where ``up`` is the plane's normal,
    it is half a turn about the optical axis away from that.
    """
    m = np.asarray(pose, dtype=float)
    n = _normalized(normal)
    reflection = np.eye(3) - 2 * np.outer(n, n)
    twin = m.copy()
    twin[..., :3, :3] = reflection @ m[..., :3, :3] @ np.diag([-1.0, 1.0, 1.0])
    offset = m[..., :3, 3] - np.asarray(point, dtype=float)
    twin[..., :3, 3] = offset @ reflection + np.asarray(point, dtype=float)
    return twin


def rigid_inverse(pose: ArrayLike) -> Array:
    """Return ``world_to_camera`` (..., 4, 4) of ``camera_to_world``, and the other way round."""
    m = np.asarray(pose, dtype=float)
    inverse = np.zeros_like(m)
    rotation = np.swapaxes(m[..., :3, :3], -1, -2)
    inverse[..., :3, :3] = rotation
    inverse[..., :3, 3] = -(rotation @ m[..., :3, 3:])[..., 0]
    inverse[..., 3, 3] = 1.0
    return inverse


def distance_and_angle(first: ArrayLike, second: ArrayLike) -> tuple[Array, Array]:
    """Return how far apart poses lie: distance of the places, angle of the turn, radians.

    Parameters
    ----------
    first, second : (..., 4, 4) float
        Rigid camera-to-world matrices; shapes broadcast.
    """
    a, b = np.asarray(first, dtype=float), np.asarray(second, dtype=float)
    distance = np.linalg.norm(a[..., :3, 3] - b[..., :3, 3], axis=-1)
    # from the chord: exact for small angles, where the trace is not
    chord = np.linalg.norm(a[..., :3, :3] - b[..., :3, :3], axis=(-2, -1)) / math.sqrt(8)
    return distance, 2 * np.arcsin(np.minimum(chord, 1.0))


def projection_matrix(tan_half: ArrayLike, clip_near: ArrayLike, clip_far: ArrayLike) -> Array:
    """Return OpenGL perspective projections of pinhole cameras.

    Parameters
    ----------
    tan_half : (..., 2) float
        Tangents of the half angles along x and y; see ``Pinhole.tan_half``.
    clip_near, clip_far : (...) float
        Distances of the clip planes along the optical axis, in scene units, with
        ``0 < clip_near < clip_far``. Not the sensor's working range.

    Returns
    -------
    camera_to_clip : (..., 4, 4) float64
        Maps camera-frame column vectors to clip space; z/w is -1 at ``clip_near`` and
        +1 at ``clip_far``.

    Raises
    ------
    ValueError
        Unless ``0 < clip_near < clip_far``.
    """
    tan = np.asarray(tan_half, dtype=float)
    near, far = np.asarray(clip_near, dtype=float), np.asarray(clip_far, dtype=float)
    if not np.all((near > 0) & (near < far)):
        raise ValueError(f"clip planes must satisfy 0 < near < far, got {near} and {far}")
    shape = np.broadcast_shapes(tan.shape[:-1], near.shape, far.shape)
    matrix = np.zeros((*shape, 4, 4))
    matrix[..., 0, 0] = 1 / tan[..., 0]
    matrix[..., 1, 1] = 1 / tan[..., 1]
    matrix[..., 2, 2] = -(far + near) / (far - near)
    matrix[..., 2, 3] = -2 * far * near / (far - near)
    matrix[..., 3, 2] = -1.0
    return matrix
