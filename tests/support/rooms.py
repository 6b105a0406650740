"""A furnished room made of boxes, and the closed-form truth of what sensors see in it.

Floor, walls and ceiling are two triangles each, as rooms come from CAD: nothing is further from
small faces. Everything is a box along the axes, so whether a point is free is a test of slabs
for each box (Kay and Kajiya 1986): no triangle, no product code, exact to rounding. Lengths in
metres.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from support.shapes import Shape, merged, write_off

SIZE = (6.0, 5.0, 2.7)

# Lower and upper corner of each piece of furniture; none touches another or a wall.
FURNITURE = (
    # table: top and four legs
    ((2.2, 1.9, 0.70), (3.8, 2.8, 0.74)),
    *(
        ((x, y, 0.0), (x + 0.06, y + 0.06, 0.69))
        for x in (2.25, 3.69)
        for y in (1.95, 2.69)
    ),
    # chairs
    ((2.6, 1.2, 0.0), (3.05, 1.65, 0.45)),
    ((3.1, 3.0, 0.0), (3.55, 3.45, 0.45)),
    # cabinets, wardrobe
    ((0.02, 0.3, 0.0), (0.62, 2.0, 0.9)),
    ((0.02, 2.2, 0.0), (0.45, 3.2, 2.0)),
    ((5.3, 3.3, 0.0), (5.95, 4.9, 2.2)),
    # bed: mattress and head
    ((4.0, 0.3, 0.0), (5.9, 1.7, 0.5)),
    ((5.92, 0.3, 0.0), (5.97, 1.7, 1.1)),
    # shelf: sides and boards
    ((1.0, 4.6, 0.0), (1.03, 4.95, 1.8)),
    ((2.4, 4.6, 0.0), (2.43, 4.95, 1.8)),
    *(((1.04, 4.6, z), (2.39, 4.95, z + 0.03)) for z in (0.3, 0.8, 1.3, 1.75)),
    # pillar, stool
    ((4.4, 2.5, 0.0), (4.6, 2.7, 2.65)),
    ((1.5, 0.9, 0.0), (1.8, 1.2, 0.5)),
)  # fmt: skip


@dataclass(frozen=True)
class Depth:
    """A Kinect v2: opening angles and incidence in degrees, depths in metres."""

    hfov_deg: float = 70.6
    vfov_deg: float = 60.0
    min_distance: float = 0.5
    max_distance: float = 4.5
    max_incidence_deg: float = 80.0


def box(low, high, *, inward: bool = False) -> Shape:
    """Return a box of twelve faces, two a side."""
    low, high = np.asarray(low, dtype=float), np.asarray(high, dtype=float)
    bits = np.array([[x, y, z] for x in (0, 1) for y in (0, 1) for z in (0, 1)])
    quads = [(0, 1, 3, 2), (4, 6, 7, 5), (0, 4, 5, 1), (2, 3, 7, 6), (0, 2, 6, 4), (1, 5, 7, 3)]
    faces = np.array([f for a, b, c, d in quads for f in ((a, b, c), (a, c, d))], dtype=np.int32)
    return low + bits * (high - low), faces[:, ::-1] if inward else faces


def room() -> Shape:
    """Return the room: twelve faces that look inwards, then twelve for each piece."""
    return merged(box((0, 0, 0), SIZE, inward=True), *(box(*piece) for piece in FURNITURE))


STUDY = """\
title = "A furnished room"
unit = "m"

[scene]
models = ["room.off"]
{scene}

[sensor.depth]
hfov_deg = 70.6
vfov_deg = 60
resolution = [512, 424]
min_distance = 0.5
max_distance = 4.5
max_incidence_deg = 80

[visibility]
criterion = "{criterion}"

{mounts}
[objective]
kind = "of1"
by_area = false

[search]
max_maps = 1500
"""

MOUNT = """\
[[mount]]
name = "{name}"
sensor = "depth"
position = [{{ min = 0.1, max = 5.9, start = {x} }}, {{ min = 0.1, max = 4.9, start = {y} }}, \
{{ min = 2.2, max = 2.6 }}]
direction = {{ azimuth_deg = {{ min = 0, max = 360, start = {azimuth}, periodic = true }}, \
elevation_deg = {{ min = -70, max = 10, start = -25 }} }}
"""


def write_room_study(folder: Path, scene: str = "", criterion: str = "pixels") -> Path:
    """Write the room and a study of three sensors in it; ``scene`` is put into its table."""
    write_off(folder / "room.off", room())
    starts = (("A", 0.3, 0.3, 45), ("B", 5.7, 0.3, 135), ("C", 3.0, 4.7, 270))
    mounts = "\n".join(
        MOUNT.format(name=name, x=x, y=y, azimuth=azimuth) for name, x, y, azimuth in starts
    )
    path = folder / "room.toml"
    path.write_text(STUDY.format(scene=scene, criterion=criterion, mounts=mounts))
    return path


def surface_points(pitch: float) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return points (R, 3) of a grid on every surface, their normals (R, 3) and areas (R,)."""
    found = []
    for low, high, inward in (((0, 0, 0), SIZE, True), *((*piece, False) for piece in FURNITURE)):
        low, high = np.asarray(low, dtype=float), np.asarray(high, dtype=float)
        for axis in range(3):
            u, v = (k for k in range(3) if k != axis)
            n = [max(1, math.ceil((high[k] - low[k]) / pitch - 1e-9)) for k in (u, v)]
            at = [low[k] + (high[k] - low[k]) * (np.arange(m) + 0.5) / m
                  for k, m in zip((u, v), n, strict=True)]  # fmt: skip
            a, b = (grid.ravel() for grid in np.meshgrid(*at))
            for end, outward in ((low, -1.0), (high, 1.0)):
                points, normals = np.zeros((len(a), 3)), np.zeros((len(a), 3))
                points[:, u], points[:, v], points[:, axis] = a, b, end[axis]
                normals[:, axis] = -outward if inward else outward
                area = (high[u] - low[u]) * (high[v] - low[v]) / len(a)
                found.append((points, normals, np.full(len(a), area)))
    points, normals, areas = zip(*found, strict=True)
    return np.concatenate(points), np.concatenate(normals), np.concatenate(areas)


def sees(pose: np.ndarray, points: np.ndarray, normals: np.ndarray, depth=Depth()) -> np.ndarray:
    """Return (R,) bool: points in view, in range, not too oblique, and with a free way to them."""
    eye = pose[:3, 3]
    local = (points - eye) @ pose[:3, :3] * [1, 1, -1]  # x, y, depth
    tan_x, tan_y = (math.tan(math.radians(a / 2)) for a in (depth.hfov_deg, depth.vfov_deg))
    back = eye - points
    cosine = np.sum(normals * back, axis=1) / np.linalg.norm(back, axis=1)
    passed = (
        (local[:, 2] >= depth.min_distance)
        & (local[:, 2] <= depth.max_distance)
        & (np.abs(local[:, 0]) <= tan_x * local[:, 2])
        & (np.abs(local[:, 1]) <= tan_y * local[:, 2])
        & (cosine >= math.cos(math.radians(depth.max_incidence_deg)))
    )
    rows = np.flatnonzero(passed)
    way = points[rows] - eye
    way[way == 0] = 1e-300
    free = np.ones(len(rows), dtype=bool)
    for low, high in FURNITURE:
        # the stretch of each way, 0 at the eye and 1 at the point, that lies inside the box
        first, last = (np.asarray(low) - eye) / way, (np.asarray(high) - eye) / way
        enter = np.minimum(first, last).max(axis=1)
        leave = np.maximum(first, last).min(axis=1)
        free &= np.minimum(leave, 1 - 1e-9) <= np.maximum(enter, 0)
    passed[rows] = free
    return passed


def true_area_share(poses: np.ndarray, pitch: float = 0.02) -> float:
    """Return the share of all surface that at least one of the poses (S, 4, 4) sees."""
    points, normals, areas = surface_points(pitch)
    seen = np.zeros(len(points), dtype=bool)
    for pose in poses:
        seen |= sees(pose, points, normals)
    return float(areas[seen].sum() / areas.sum())
