"""Vertices that are one: bitwise identical ones everywhere, near ones where surfaces are judged."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components
from scipy.spatial import cKDTree

# Of a model's diagonal: single precision and texts of six digits are off by a tenth of that.
_NEAR = 1e-5

# Odd numbers that spread the bits of a coordinate over a word; any others would do.
_MIX = tuple(
    np.uint64(factor)
    for factor in (0x9E3779B97F4A7C15, 0xBF58476D1CE4E5B9, 0x94D049BB133111EB, 0xD6E8FEB86659FD93)
)


def merged_where_identical(
    vertices: NDArray[Any], faces: NDArray[Any]
) -> tuple[NDArray[Any], NDArray[np.int32]]:
    """Return vertices and faces with bitwise identical vertices merged, unused ones dropped.

    Kept vertices stay in the order of their first appearance, so a mesh that repeats none
    keeps its numbers.
    """
    is_used = np.zeros(len(vertices), dtype=bool)
    is_used[faces] = True
    # Most files use all they have; adding 0 makes -0.0 the same bits as 0.0.
    points = (vertices if is_used.all() else vertices[is_used]) + vertices.dtype.type(0)
    first = _first_of_each(points)
    is_kept = first == np.arange(len(points))
    number = (np.cumsum(is_kept, dtype=np.int32) - np.int32(1))[first]
    if len(points) < len(vertices):
        number = number[np.cumsum(is_used) - 1]
    return points[is_kept], number[faces]


def _first_of_each(points: NDArray[Any]) -> NDArray[np.int32]:
    """Return, for each point (V, 3), the first index that holds the same point, (V,).

    A hash table with a slot a point: all copies of a point fall into one slot, and the first
    point there takes it. Who finds another point in its slot tries again among the losers with
    another hash. No sort, so 12 million corners take seconds; always exact.
    """
    bits = max(4, len(points).bit_length())
    table = np.zeros(1 << bits, dtype=np.int32)
    first = np.zeros(len(points), dtype=np.int32)
    left: NDArray[np.int32] = np.arange(len(points), dtype=np.int32)
    left_points, turn = points, 0
    while len(left):
        slot = _hashes(left_points, turn, bits)
        table[slot[::-1]] = left[::-1]  # of many that write, the last one stays
        winner = table[slot]
        is_same = (points[winner] == left_points).all(axis=1)
        first[left[is_same]] = winner[is_same]
        left, left_points, turn = left[~is_same], left_points[~is_same], turn + 1
    return first


def _hashes(points: NDArray[Any], turn: int, bits: int) -> NDArray[np.int64]:
    """Return a number of so many bits for each point, equal for equal points, another each turn."""
    words: NDArray[Any] = points.view(np.uint32 if points.dtype == np.float32 else np.uint64)
    key = np.full(len(points), turn, dtype=np.uint64)
    for column, factor in zip(words.T, _MIX, strict=False):
        key += column.astype(np.uint64)
        key *= factor
        key ^= key >> np.uint64(29)
    key *= _MIX[3]
    return (key >> np.uint64(64 - bits)).astype(np.int64)


def welded_faces(vertices: NDArray[np.float64], faces: NDArray[np.int32]) -> NDArray[np.int64]:
    """Return faces (F, 3) whose vertices are one where the rim of a gap meets itself.

    Programs write a point that two faces share with other last digits for each. Only vertices of
    edges with one face are looked at: what is joined already stays as it is, and a wall, however
    thin, is no rim. For judging surfaces only; maps are made of the vertices as they are.
    """
    start = faces.astype(np.int64).ravel()
    end = np.roll(faces, -1, axis=1).astype(np.int64).ravel()
    keys = np.minimum(start, end) * len(vertices) + np.maximum(start, end)
    _, which, count = np.unique(keys, return_inverse=True, return_counts=True)
    single = count[which.reshape(-1)] == 1
    rim = np.unique(np.concatenate([start[single], end[single]]))
    number = np.arange(len(vertices))
    if len(rim):
        size = float(np.linalg.norm(np.ptp(vertices, axis=0)))
        pairs = cKDTree(vertices[rim]).query_pairs(_NEAR * size, output_type="ndarray")
        graph = coo_array((np.ones(len(pairs)), (pairs[:, 0], pairs[:, 1])), shape=(len(rim),) * 2)
        n, label = connected_components(graph, directed=False)
        first = np.full(n, len(vertices), dtype=np.int64)
        np.minimum.at(first, label, rim)
        number[rim] = first[label]
    return np.asarray(number[faces])
