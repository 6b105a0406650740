"""Small scenes made by formula, in millimetres, for studies that start from nothing."""

from __future__ import annotations

import math
from collections.abc import Sequence
from pathlib import Path

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.interpolate import PchipInterpolator

Floats = NDArray[np.float64]
Triangles = NDArray[np.float64]  # (F, 3, 3) corners, counter-clockwise seen from outside

_CELL = 130.0  # side of a square of two faces in rooms
# An arm from the elbow to the fingertips, along z: place, half width, half thickness, bend.
_ARM = np.array(
    [
        (-150, 38, 38, 0),
        (-110, 43, 41, 0),
        (-40, 36, 34, 0),
        (20, 28, 21, 2),
        (45, 31, 17, 4),
        (80, 41, 15, 6),
        (110, 40, 12, 4),
        (150, 33, 9, -4),
        (175, 26, 8, -10),
        (190, 14, 6, -14),
    ]
)
ROOM = (3000.0, 3000.0, 2600.0)
# Boxes by lower and upper corner, in a room of 3000 x 3000 with a corner at the origin.
_KITCHEN = [
    ((0, 900, 0), (600, 3000, 900)),  # counter along one wall
    ((600, 2400, 0), (2200, 3000, 900)),  # and along the next
    ((0, 150, 0), (650, 800, 1800)),  # fridge
    ((0, 1100, 1450), (350, 2700, 2150)),  # cupboards above the counter
    ((1500, 700, 700), (2500, 1500, 750)),  # table top
    *(((x, y, 0), (x + 60, y + 60, 700)) for x in (1520, 2420) for y in (720, 1420)),
    ((1750, 1620, 400), (2200, 2050, 450)),  # a chair's seat
    ((1750, 2050, 0), (2200, 2100, 900)),  # and its back
]
_LIVING_ROOM = [
    ((700, 2100, 0), (2700, 2900, 420)),  # sofa
    ((700, 2650, 420), (2700, 2900, 850)),  # and its back
    ((1200, 1100, 380), (2100, 1700, 430)),  # low table
    ((1550, 1300, 0), (1750, 1500, 380)),  # and its foot
    ((0, 300, 0), (400, 1800, 1900)),  # shelf
    ((2200, 200, 0), (2900, 600, 700)),  # chest
]


def arm() -> Triangles:
    """Return a forearm with a flat hand along z, closed, about 380 mm long."""
    along, around = 90, 56
    z = np.linspace(_ARM[0, 0], _ARM[-1, 0], along)
    width, thickness, bend = PchipInterpolator(_ARM[:, 0], _ARM[:, 1:])(z).T
    angle = 2 * math.pi * np.arange(around) / around
    rings = np.stack(
        [
            width[:, None] * np.cos(angle),
            thickness[:, None] * np.sin(angle) + bend[:, None],
            np.broadcast_to(z[:, None], (along, around)),
        ],
        axis=2,
    )
    left, right = rings, np.roll(rings, -1, axis=1)
    lower = np.stack([left[:-1], right[:-1], right[1:]], axis=2)
    upper = np.stack([left[:-1], right[1:], left[1:]], axis=2)
    caps = [
        np.stack([right[0], left[0], np.broadcast_to(rings[0].mean(axis=0), left[0].shape)], 1),
        np.stack([left[-1], right[-1], np.broadcast_to(rings[-1].mean(axis=0), left[0].shape)], 1),
    ]
    return np.concatenate([lower.reshape(-1, 3, 3), upper.reshape(-1, 3, 3), *caps])


def room(furniture: str) -> Triangles:
    """Return floor, two walls and furniture of a room: "kitchen" or "room".

    The other walls are left out, so that pictures look into the room.
    """
    boxes = _KITCHEN if furniture == "kitchen" else _LIVING_ROOM
    walls = box((0, 0, 0), ROOM, skip=(1, 2, 5))[:, ::-1]  # normals inwards
    # a hair apart, so that no edge of one is an edge of another
    gap = np.ones(3)
    return np.concatenate([walls, *(box(low + gap, high - gap) for low, high in boxes)])


def box(low: ArrayLike, high: ArrayLike, skip: Sequence[int] = ()) -> Triangles:
    """Return a box of even faces; sides in the order -x, +x, -y, +y, -z, +z may be left out."""
    a, b = np.asarray(low, dtype=float), np.asarray(high, dtype=float)
    parts = []
    for side in range(6):
        axis, is_upper = divmod(side, 2)
        if side in skip:
            continue
        u, v = (axis + 1) % 3, (axis + 2) % 3
        steps = [max(1, math.ceil((b[k] - a[k]) / _CELL)) for k in (u, v)]
        i, j = np.mgrid[: steps[0] + 1, : steps[1] + 1]
        grid = np.zeros((*i.shape, 3))
        grid[..., axis] = b[axis] if is_upper else a[axis]
        grid[..., u] = a[u] + (b[u] - a[u]) * i / steps[0]
        grid[..., v] = a[v] + (b[v] - a[v]) * j / steps[1]
        p, q, r, s = grid[:-1, :-1], grid[1:, :-1], grid[1:, 1:], grid[:-1, 1:]
        faces = np.stack([np.stack([p, q, r], 2), np.stack([p, r, s], 2)]).reshape(-1, 3, 3)
        parts.append(faces if is_upper else faces[:, ::-1])
    return np.concatenate(parts)


def write_stl(path: Path, triangles: Triangles) -> None:
    """Write triangles as binary STL."""
    rows = np.zeros(
        len(triangles), [("normal", "<f4", 3), ("corners", "<f4", (3, 3)), ("n", "<u2")]
    )
    normal = np.cross(triangles[:, 1] - triangles[:, 0], triangles[:, 2] - triangles[:, 0])
    rows["normal"] = normal / np.linalg.norm(normal, axis=1, keepdims=True)
    rows["corners"] = triangles
    count = np.array([len(triangles)], dtype="<u4").tobytes()
    path.write_bytes(b"made by glvis init".ljust(80) + count + rows.tobytes())
