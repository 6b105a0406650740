"""Exact rays in NumPy: which points no triangle hides from the eye, in float64.

What ``cast`` finds on the GPU is found here wherever it cannot, and by the paper's own semantics:
the same points, the same planes.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]
Bools = NDArray[np.bool_]
Indices = NDArray[np.integer]

# Share of the way by which an occluder must be nearer than a point to hide it, for what float32
# cannot tell apart is one place, as on the GPU; and share of an edge's reach by which a ray may
# pass beside it, some steps of float64.
_NEARER, _BESIDE = 1e-7, 1e-13
_PAIRS = 1 << 22  # of points and triangles tested at once, at most


def join_runs(first: Indices, number: Indices) -> Indices:
    """Return first, first + 1, ... of each run, so many, one run after the other."""
    runs: Indices = np.repeat(first - (np.cumsum(number) - number), number)
    runs += np.arange(len(runs))
    return runs


def meets(corners: Floats, rays: Floats) -> Bools:
    """Return which triangles the rays beside them meet, on either side of the eye, (n,) bool.

    Parameters
    ----------
    corners : (3, 3, n) float64
        Corner, coordinate, triangle; x right, y up, and depth along the optical axis, the eye at 0.
    rays : (3, n) float64
        Directions in the same frame, of any length.
    """
    # a ray is within where it lies on one side of the planes through the eye and the edges
    planes = np.cross(corners, np.roll(corners, -1, axis=0), axis=1)
    side = np.einsum("kcn,cn->kn", planes, rays)
    within: Bools = (side >= 0).all(axis=0) | (side <= 0).all(axis=0)
    return within


def unhidden(points: Floats, triangles: Floats, near: float) -> Bools:
    """Return which points nothing hides from the eye, (P,) bool.

    Both sides of a triangle hide. One hides a point where the ray to the point meets it earlier by
    more than a ten millionth of the way, so triangles that coincide do not hide each other. Without
    area, or seen edge on, it hides nothing.

    Parameters
    ----------
    points : (3, P) float64
        x right, y up, and depth along the optical axis, above 0; scene unit, the eye at 0.
    triangles : (3, 3, T) float64
        Corner, coordinate, triangle; the same frame.
    near : float
        Depth before which nothing hides, scene unit.
    """
    free = np.ones(points.shape[1], dtype=bool)
    depth = triangles[:, 2]
    reach = (depth.max(axis=0, initial=-np.inf) > near) & (
        depth.min(axis=0, initial=np.inf) < points[2].max(initial=-np.inf)
    )
    triangles = np.ascontiguousarray(triangles[..., reach])
    if not points.size or not triangles.size:
        return free
    tangent = points[:2] / points[2]
    planes = _Planes.of(triangles, np.abs(tangent).max(axis=1))
    cells = _Cells.of(tangent)
    at_once = max(1, _PAIRS // points.shape[1])
    for first in range(0, triangles.shape[2], at_once):
        point, triangle = cells.pairs(triangles[..., first : first + at_once], near)
        hidden = planes.hide(first + triangle, points.take(point, axis=1), near)
        free[point[hidden]] = False
    return free


@dataclass(frozen=True, eq=False)
class _Planes:
    """Of T triangles: their own planes n . x = d, and those through the eye and their edges.

    Attributes
    ----------
    normal : (3, T) float64
        Turned so that the eye lies at n . x <= d.
    offset : (T,) float64
        d; 0, with the normal, where the eye lies in the plane.
    edges : (3, 3, T) float64
        Coordinate, edge, triangle: no product is negative of a point within.
    """

    normal: Floats
    offset: Floats
    edges: Floats

    @classmethod
    def of(cls, triangles: Floats, tangents: Floats) -> _Planes:
        """Return the planes of triangles (3, 3, T) for points up to some tangents (2,)."""
        sides = np.roll(triangles, -1, axis=0) - triangles
        normal = np.cross(sides[0], sides[1], axis=0)
        offset = np.sum(normal * triangles[0], axis=0)
        side = np.sign(offset)
        edges = np.moveaxis(np.cross(triangles, sides, axis=1), 1, 0) * side
        x, y, z = np.abs(edges)
        # a ray to where two triangles meet meets one of them at least
        edges[2] += _BESIDE * (x * tangents[0] + y * tangents[1] + z)
        return cls(normal * side, np.abs(offset), edges)

    def hide(self, triangle: Indices, points: Floats, near: float) -> Bools:
        """Return which triangles (n,) hide the points (3, n) beside them, (n,) bool."""
        beyond = np.sum(self.normal.take(triangle, axis=1) * points, axis=0)
        offset = self.offset.take(triangle)
        hides: Bools = (beyond * (1 - _NEARER) > offset) & (near * beyond < offset * points[2])
        some = np.flatnonzero(hides)
        edges = self.edges.take(triangle[some], axis=2)
        inside = np.sum(edges * points.take(some, axis=1)[:, None], axis=0).min(axis=0)
        hides[some] = inside >= 0
        return hides


@dataclass(frozen=True, eq=False)
class _Cells:
    """P points in the cells of a square grid.

    Attributes
    ----------
    order : (P,) int
        The points, row by row and cell by cell.
    begin : (n * n + 1,) int
        Where each cell's points begin in that order.
    low, scale : (2, 1) float64
        From tangents to cells.
    n : int
        Cells along a side.
    """

    order: Indices
    begin: Indices
    low: Floats
    scale: Floats
    n: int

    @classmethod
    def of(cls, tangent: Floats) -> _Cells:
        """Return the cells of points (2, P) in the image plane at unit depth."""
        n = max(1, math.isqrt(tangent.shape[1]))
        low = tangent.min(axis=1, keepdims=True)
        extent = np.ptp(tangent, axis=1, keepdims=True)
        scale = n / np.where(extent > 0, extent, 1.0)
        column, row = np.minimum(((tangent - low) * scale).astype(np.intp), n - 1)
        cell = row * n + column
        counts = np.bincount(cell, minlength=n * n)
        return cls(
            np.argsort(cell, kind="stable"), np.concatenate([[0], np.cumsum(counts)]), low, scale, n
        )

    def pairs(self, triangles: Floats, near: float) -> tuple[Indices, Indices]:
        """Return points and the triangles (3, 3, T) whose boxes hold their cells, (n,) each."""
        depth = triangles[:, 2]
        is_before = depth.min(axis=0) > near
        place = triangles[:, :2] / np.where(is_before, depth, 1.0)[:, None]
        place = (place - self.low) * self.scale
        margin = 1e-9 * (self.n + np.abs(place).max(axis=0))
        low = np.where(is_before, place.min(axis=0) - margin, 0)
        high = np.where(is_before, place.max(axis=0) + margin, self.n)
        some = np.flatnonzero(np.all((high >= 0) & (low <= self.n), axis=0))
        first, last = np.clip(np.stack([low, high]).take(some, axis=2), 0, self.n - 1).astype(int)
        # points of one row that one triangle covers follow each other
        rows = last[1] - first[1] + 1
        of = np.repeat(np.arange(len(some)), rows)
        row = join_runs(first[1], rows)
        begin = self.begin[row * self.n + first[0][of]]
        number = self.begin[row * self.n + last[0][of] + 1] - begin
        return self.order[join_runs(begin, number)], np.repeat(some[of], number)
