"""Signed distances of simple bodies, their smooth unions, and the surface where they are zero.

Distances are negative inside. A field is a function from points (N, 3) to values (N,).
"""

from __future__ import annotations

import itertools
from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
Field = Callable[[Array], Array]


def dot(a: Array, b: Array) -> Array:
    """Return the scalar products of vectors (..., 3), added in a fixed order."""
    return a[..., 0] * b[..., 0] + a[..., 1] * b[..., 1] + a[..., 2] * b[..., 2]


def length(a: Array) -> Array:
    """Return the lengths of vectors (..., 3)."""
    return np.sqrt(dot(a, a))


def smooth_union(a: Array, b: Array, radius: float) -> Array:
    """Return the union of two distances with a fillet of about ``radius`` (polynomial blend)."""
    near = np.maximum(radius - np.abs(a - b), 0.0) / radius
    return np.minimum(a, b) - near * near * radius * 0.25


def round_cone(points: Array, a: Array, b: Array, radius_a: float, radius_b: float) -> Array:
    """Return the distance to the convex hull of two balls, about ``a`` and about ``b``."""
    axis = b - a
    l2 = float(dot(axis, axis))
    taper = radius_a - radius_b
    a2 = l2 - taper * taper
    if a2 <= 0:
        raise ValueError("one ball of a round cone holds the other")
    pa = points - a
    y = dot(pa, axis)
    z = y - l2
    y2, z2 = y * y * l2, z * z * l2
    x2 = np.maximum(dot(pa, pa) * (l2 * l2) - y2, 0.0)  # Pythagoras, all times l2 squared
    k = np.sign(taper) * taper * taper * x2
    side = (np.sqrt(x2 * a2 / l2) + y * taper) / l2 - radius_a
    head = np.sqrt(x2 + z2) / l2 - radius_b
    foot = np.sqrt(x2 + y2) / l2 - radius_a
    return np.where(np.sign(z) * a2 * z2 > k, head, np.where(np.sign(y) * a2 * y2 < k, foot, side))


def rounded_box(points: Array, centre: Array, half: Array, radius: float) -> Array:
    """Return the distance to a box of half sizes ``half`` whose edges are rounded."""
    q = np.abs(points - centre) - (half - radius)
    return length(np.maximum(q, 0.0)) + np.minimum(q.max(axis=1), 0.0) - radius


def onto_zero(field: Field, points: Array, in_plane: NDArray[np.bool_], step: float) -> Array:
    """Return points moved onto the zero surface by Newton steps; some keep their z."""
    points = points.copy()
    for _ in range(2):
        here = field(points)
        slope = np.zeros_like(points)
        for axis in range(3):
            ahead = points.copy()
            ahead[:, axis] += step
            slope[:, axis] = (field(ahead) - here) / step
        slope[in_plane, 2] = 0.0
        points -= slope * (here / np.maximum(dot(slope, slope), 0.05))[:, None]
    return points


def zero_surface(
    field: Field, lower: Array, upper: Array, step: float
) -> tuple[Array, NDArray[np.int64]]:
    """Return vertices (V, 3) and faces (F, 3) of the zero surface, by marching tetrahedra.

    Two-manifold and outward by construction, with an open loop where the surface leaves the
    box through ``lower`` or ``upper``. The triangles are uneven: remesh them.
    """
    axes = [lower[i] + step * np.arange(int((upper[i] - lower[i]) / step) + 2) for i in range(3)]
    shape = np.array([len(axis) for axis in axes])
    grid = np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1).reshape(-1, 3)
    values = field(grid)
    values[values == 0] = 1e-12  # a corner is inside or outside, never on the surface
    strides = np.array([shape[1] * shape[2], shape[2], 1])
    cells = np.stack(
        np.meshgrid(*[np.arange(n - 1) for n in shape], indexing="ij"), axis=-1
    ).reshape(-1, 3)
    base = dot(cells, strides)
    triangles = []
    for order in itertools.permutations(range(3)):
        # Kuhn: each order of the axes is one tetrahedron along the cell's diagonal.
        path = np.cumsum([0, *(strides[axis] for axis in order)])
        even = order in ((0, 1, 2), (1, 2, 0), (2, 0, 1))
        corners = base[:, None] + (path if even else path[[0, 2, 1, 3]])
        triangles.append(_cut_tetrahedra(corners, values))
    pairs = np.concatenate(triangles)  # (F, 3, 2) grid indices of the cut edges
    lo, hi = pairs.min(axis=2), pairs.max(axis=2)
    keys, faces = np.unique(lo * len(grid) + hi, return_inverse=True)
    a, b = keys // len(grid), keys % len(grid)
    t = values[a] / (values[a] - values[b])
    vertices = grid[a] + (grid[b] - grid[a]) * t[:, None]
    return vertices, faces.reshape(-1, 3)


# Positively oriented tetrahedron 0 1 2 3: for each set of inside corners (bit i = corner i) the
# cut edges of its outward triangles.
_ONE_INSIDE = {0: (1, 2, 3), 1: (0, 3, 2), 2: (0, 1, 3), 3: (0, 2, 1)}
_TWO_INSIDE = {
    (0, 1): ((0, 2), (0, 3), (1, 3), (1, 2)),
    (0, 2): ((0, 3), (0, 1), (2, 1), (2, 3)),
    (0, 3): ((0, 1), (0, 2), (3, 2), (3, 1)),
    (2, 3): ((2, 0), (2, 1), (3, 1), (3, 0)),
    (1, 3): ((1, 2), (1, 0), (3, 0), (3, 2)),
    (1, 2): ((1, 0), (1, 3), (2, 3), (2, 0)),
}


def _cut_tetrahedra(corners: NDArray[np.int64], values: Array) -> NDArray[np.int64]:
    """Return the cut edges, (F, 3, 2) grid indices, of tetrahedra (T, 4)."""
    inside = values[corners] < 0
    case = inside[:, 0] * 1 + inside[:, 1] * 2 + inside[:, 2] * 4 + inside[:, 3] * 8
    found = []

    def add(rows: NDArray[np.int64], edges: tuple[tuple[int, int], ...]) -> None:
        found.append(np.stack([rows[:, list(edge)] for edge in edges], axis=1))

    for corner, (p, q, r) in _ONE_INSIDE.items():
        add(corners[case == 1 << corner], ((corner, p), (corner, q), (corner, r)))
        add(corners[case == 15 - (1 << corner)], ((corner, p), (corner, r), (corner, q)))
    for (i, j), (e0, e1, e2, e3) in _TWO_INSIDE.items():
        rows = corners[case == (1 << i) + (1 << j)]
        add(rows, (e0, e1, e2))
        add(rows, (e0, e2, e3))
    return np.concatenate(found)
