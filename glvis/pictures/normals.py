"""Normals for shading: smooth over what is round, sharp at creases, even on what is flat.

Arrays in, arrays out; draws nothing. A flat side of many triangles beside a fillet is as even as
if it were one polygon: at a vertex each face weighs by the area of all that lies flat with it.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components

Floats = NDArray[np.float64]
Integers = NDArray[np.int64]

_CREASE = float(np.cos(np.radians(40.0)))  # faces that meet more sharply do not share a normal
# Faces around a vertex that all lean less than half a crease from their mean need no pairs.
_GENTLE = float(np.cos(np.radians(20.0)))
_FLAT = float(np.cos(np.radians(0.1)))  # neighbours that lean less lie in one plane
_PAIRS = 2_000_000  # of faces at a vertex that are looked at together: what memory allows


def corner_normals(vertices: ArrayLike, faces: ArrayLike) -> Floats:
    """Return unit normals (F, 3, 3) of the corners.

    Parameters
    ----------
    vertices, faces : (V, 3) float, (F, 3) int
        A corner takes the mean normal of those faces around its vertex that lean away from its
        own face less than a crease. Faces without area take that of all.
    """
    points, corners = np.asarray(vertices, dtype=float), np.asarray(faces, dtype=np.int64)
    a, b, c = (points[corners[:, i]] for i in range(3))
    doubled: Floats = np.cross(b - a, c - a).astype(float)
    own = _unit(doubled)
    weighted = own * _flat_areas(corners, own, doubled)[:, None]
    flat, n = corners.ravel(), len(points)
    total = np.stack(
        [np.bincount(flat, np.repeat(weighted[:, k], 3), minlength=n) for k in range(3)], axis=1
    )
    normals = _unit(total)[flat]
    own = np.repeat(own, 3, axis=0)
    leans = (normals * own).sum(axis=1) < _GENTLE
    leans &= (own != 0).any(axis=1)
    is_sharp = np.zeros(n, dtype=bool)
    is_sharp[flat[leans]] = True
    at = np.flatnonzero(is_sharp[flat] & (own != 0).any(axis=1))
    normals[at] = _within_crease(flat, at, own, weighted)
    return normals.reshape(-1, 3, 3)


def _within_crease(flat: Integers, at: Integers, own: Floats, weighted: Floats) -> Floats:
    """Return normals (N, 3) of some corners, each from the faces within a crease of its own."""
    order = np.argsort(flat, kind="stable")  # corners by vertex
    first = np.searchsorted(flat[order], flat[at])
    many = np.searchsorted(flat[order], flat[at], side="right") - first
    found = np.zeros((len(at), 3))
    ends = np.cumsum(many)
    start = 0
    while start < len(at):
        done = ends[start - 1] if start else 0
        stop = max(start + 1, int(np.searchsorted(ends, done + _PAIRS)))
        counts = many[start:stop]
        mine = np.repeat(np.arange(start, stop), counts)
        step = np.arange(len(mine)) - np.repeat(np.cumsum(counts) - counts, counts)
        other = order[np.repeat(first[start:stop], counts) + step]
        near = (own[at[mine]] * own[other]).sum(axis=1) >= _CREASE
        rows, parts = mine[near] - start, weighted[other[near] // 3]
        for k in range(3):
            found[start:stop, k] = np.bincount(rows, parts[:, k], minlength=stop - start)
        start = stop
    return _unit(found)


def _flat_areas(corners: Integers, normals: Floats, doubled: Floats) -> Floats:
    """Return for each face the area (twice) of the connected faces in its plane, (F,)."""
    area = np.linalg.norm(doubled, axis=1)
    n = len(corners)
    edges = np.sort(np.stack([corners, np.roll(corners, -1, axis=1)], axis=2), axis=2)
    key = (edges[..., 0] * (int(corners.max(initial=0)) + 1) + edges[..., 1]).ravel()
    order = np.argsort(key, kind="stable")
    same = key[order][1:] == key[order][:-1]
    a, b = order[:-1][same] // 3, order[1:][same] // 3
    flat = (normals[a] * normals[b]).sum(axis=1) > _FLAT
    graph = coo_array((np.ones(int(flat.sum()), dtype=bool), (a[flat], b[flat])), shape=(n, n))
    _, label = connected_components(graph, directed=False)
    return np.bincount(label, area)[label]


def _unit(vectors: NDArray[Any]) -> Floats:
    """Return vectors (N, 3) at unit length, zeros left as they are."""
    length = np.linalg.norm(vectors, axis=1, keepdims=True)
    return np.divide(vectors, length, out=np.zeros_like(vectors), where=length > 0)
