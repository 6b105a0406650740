"""Rotations in the shapes that other tools ask for: quaternions, roll-pitch-yaw, other axes."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import ArrayLike, NDArray

Floats = NDArray[np.float64]

# Columns: axes of OpenCV's and COLMAP's camera (x right, y down, z ahead) in ours.
OPTICAL = np.diag([1.0, -1.0, -1.0])
# Columns: axes of a body after REP 103 (x ahead, y left, z up) in our camera frame.
BODY = np.array([[0.0, -1.0, 0.0], [0.0, 0.0, 1.0], [-1.0, 0.0, 0.0]])


def quaternion(rotation: ArrayLike) -> Floats:
    """Return the unit quaternion (w, x, y, z), w >= 0, of a proper rotation (3, 3).

    References
    ----------
    Shepperd, "Quaternion from rotation matrix" (1978): the largest of four numbers divides.
    """
    r = np.asarray(rotation, dtype=float)
    trace = float(np.trace(r))
    squares = np.array([trace, r[0, 0], r[1, 1], r[2, 2]])
    k = int(squares.argmax())
    q = np.zeros(4)
    if k == 0:
        q[:] = 1 + trace, r[2, 1] - r[1, 2], r[0, 2] - r[2, 0], r[1, 0] - r[0, 1]
    else:
        i, j, m = k - 1, k % 3, (k + 1) % 3
        q[0] = r[m, j] - r[j, m]
        q[1 + i] = 1 + 2 * r[i, i] - trace
        q[1 + j] = r[j, i] + r[i, j]
        q[1 + m] = r[m, i] + r[i, m]
    q /= np.linalg.norm(q)
    return -q if q[0] < 0 else q


def rotation(wxyz: ArrayLike) -> Floats:
    """Return the rotation (3, 3) of a quaternion (w, x, y, z) of any length > 0.

    Raises
    ------
    ValueError
        If all four are 0.
    """
    q = np.asarray(wxyz, dtype=float)
    if not q.any():
        raise ValueError("a quaternion of zeros is no rotation")
    w, x, y, z = q / np.abs(q).max() / np.linalg.norm(q / np.abs(q).max())
    return np.array(
        [
            [1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)],
            [2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)],
            [2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)],
        ]
    )


def roll_pitch_yaw(rotation: ArrayLike) -> tuple[float, float, float]:
    """Return URDF's angles, radians: turns about the fixed axes x, then y, then z."""
    r = np.asarray(rotation, dtype=float)
    level = math.hypot(r[0, 0], r[1, 0])
    pitch = math.atan2(-r[2, 0], level)
    if level < 1e-9:  # straight up or down: roll and yaw are one turn
        return math.atan2(-r[1, 2], r[1, 1]), pitch, 0.0
    return math.atan2(r[2, 1], r[2, 2]), pitch, math.atan2(r[1, 0], r[0, 0])


def rotation_between(start: ArrayLike, end: ArrayLike) -> Floats:
    """Return the shortest rotation (3, 3) that turns one direction (3,) into another."""
    a = np.asarray(start, dtype=float) / np.linalg.norm(start)
    b = np.asarray(end, dtype=float) / np.linalg.norm(end)
    cos = float(a @ b)
    if cos < -1 + 1e-12:  # half a turn about any axis square to both
        across = np.eye(3)[np.argmin(np.abs(a))]
        axis = np.cross(a, across)
        axis /= np.linalg.norm(axis)
        return 2 * np.outer(axis, axis) - np.eye(3)
    x, y, z = np.cross(a, b)
    cross = np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]])
    return np.eye(3) + cross + cross @ cross / (1 + cos)
