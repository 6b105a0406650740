"""Isotropic remeshing: split, collapse, flip and smooth until the edges of a mesh are even.

Works on arrays, in rounds of edits that do not touch each other. Meshes are two-manifold with
consistent winding, and stay so; open loops and sharp creases keep their place.

References
----------
M. Botsch and L. Kobbelt, "A remeshing approach to multiresolution modeling", 2004.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from scenery.implicit import Array, dot, length

Ints = NDArray[np.int64]
Bools = NDArray[np.bool_]
Project = Callable[[Array, Bools], Array]

SMOOTH, LINE, CORNER = 0, 1, 2  # what a vertex may do: move freely, along its line, not at all
_CREASE = 0.7  # cosine between normals below which an edge is a crease (about 45 degrees)
_STRAIGHT = -0.9  # cosine between the two ways along a line above which it turns a corner


def cross(a: Array, b: Array) -> Array:
    """Return the vector products of vectors (N, 3)."""
    return np.stack(
        [
            a[:, 1] * b[:, 2] - a[:, 2] * b[:, 1],
            a[:, 2] * b[:, 0] - a[:, 0] * b[:, 2],
            a[:, 0] * b[:, 1] - a[:, 1] * b[:, 0],
        ],
        axis=1,
    )


def double_area_normals(vertices: Array, faces: Ints) -> Array:
    """Return outward normals (F, 3) as long as twice the area of their face."""
    a, b, c = (vertices[faces[:, i]] for i in range(3))
    return cross(b - a, c - a)


@dataclass(frozen=True)
class Edges:
    """The edges of a mesh and what they join.

    Attributes
    ----------
    ends : (E, 2) int
        Vertices, the smaller first, in lexical order.
    sides : (E, 2) int
        Faces at each edge, the second -1 on an open loop.
    apexes : (E, 2) int
        The third vertex of each of these faces, or -1.
    """

    ends: Ints
    sides: Ints
    apexes: Ints

    @classmethod
    def of(cls, faces: Ints) -> Edges:
        """Return the edges of faces (F, 3); more than two faces at one is an error."""
        half = np.concatenate([faces[:, [0, 1]], faces[:, [1, 2]], faces[:, [2, 0]]])
        apex = np.concatenate([faces[:, 2], faces[:, 0], faces[:, 1]])
        face = np.tile(np.arange(len(faces)), 3)
        half = np.sort(half, axis=1)
        order = np.lexsort((half[:, 1], half[:, 0]))
        half, apex, face = half[order], apex[order], face[order]
        first = np.ones(len(half), dtype=bool)
        first[1:] = (half[1:] != half[:-1]).any(axis=1)
        start = np.flatnonzero(first)
        count = np.diff(np.append(start, len(half)))
        if count.max() > 2:
            raise ValueError(f"{(count > 2).sum()} edges have more than two faces")
        second = np.where(count == 2, start + 1, start)
        none = count == 1
        sides = np.stack([face[start], np.where(none, -1, face[second])], axis=1)
        apexes = np.stack([apex[start], np.where(none, -1, apex[second])], axis=1)
        return cls(half[start], sides, apexes)

    @cached_property
    def is_open(self) -> Bools:
        """Which edges have one face only."""
        return self.sides[:, 1] < 0

    def lines(self, vertices: Array, faces: Ints) -> Bools:
        """Return which edges are kept as lines: open loops and sharp creases."""
        normals = double_area_normals(vertices, faces)
        a, b = normals[self.sides[:, 0]], normals[self.sides[:, 1]]
        return self.is_open | (dot(a, b) < _CREASE * length(a) * length(b))


class Remesher:
    """A mesh on its way to even edges of length ``target``.

    Parameters
    ----------
    vertices, faces : (V, 3) float, (F, 3) int
        Two-manifold, consistently wound.
    target : float
        Wanted edge length.
    project : callable, optional
        Takes points (N, 3) and which of them lie on an open loop, returns them on the surface.
        Without it the surface is taken to be made of planes, and its creases are kept.
    """

    def __init__(
        self, vertices: Array, faces: Ints, target: float, project: Project | None = None
    ) -> None:
        self.vertices = vertices.copy()
        self.faces = faces.copy()
        self.target = target
        self.project = project

    def run(self, iterations: int) -> None:
        """Do ``iterations`` passes of split, collapse, flip and smooth."""
        for _ in range(iterations):
            while self._split():
                pass
            while self._collapse() > len(self.faces) // 50:
                pass
            while self._flip():
                pass
            self._smooth()

    def _state(self) -> tuple[Edges, Bools, NDArray[np.int8]]:
        """Return the edges, which of them are lines, and what each vertex may do."""
        edges = Edges.of(self.faces)
        line = edges.lines(self.vertices, self.faces) if self.project is None else edges.is_open
        n = len(self.vertices)
        ends = edges.ends[line]
        valence = np.bincount(ends.ravel(), minlength=n)
        kind = np.where(valence == 0, SMOOTH, np.where(valence == 2, LINE, CORNER)).astype(np.int8)
        if self.project is None:
            way = self.vertices[ends[:, 1]] - self.vertices[ends[:, 0]]
            way = way / length(way)[:, None]
            total = np.zeros((n, 3))
            for axis in range(3):
                total[:, axis] = np.bincount(ends[:, 0], way[:, axis], n) - np.bincount(
                    ends[:, 1], way[:, axis], n
                )
            # |u + v|^2 = 2 + 2 cos of the angle between the two ways out of a vertex
            kind[(kind == LINE) & (dot(total, total) > 2 + 2 * _STRAIGHT)] = CORNER
        return edges, line, kind

    def _lengths(self, edges: Edges) -> Array:
        return length(self.vertices[edges.ends[:, 0]] - self.vertices[edges.ends[:, 1]])

    def _split(self) -> bool:
        """Halve the edges longer than 4/3 of the target that are the longest of their faces."""
        edges = Edges.of(self.faces)
        long = self._lengths(edges)
        rank = np.zeros(len(long), dtype=np.int64)
        rank[np.lexsort((np.arange(len(long)), long))] = np.arange(len(long))
        longest = np.zeros(len(self.faces), dtype=np.int64)
        for side in range(2):
            present = edges.sides[:, side] >= 0
            np.maximum.at(longest, edges.sides[present, side], rank[present])
        chosen = long > self.target * 4 / 3
        for side in range(2):
            chosen &= (longest[edges.sides[:, side]] == rank) | (edges.sides[:, side] < 0)
        if not chosen.any():
            return False
        ends = edges.ends[chosen]
        middle = len(self.vertices) + np.arange(len(ends))
        self.vertices = np.concatenate(
            [self.vertices, (self.vertices[ends[:, 0]] + self.vertices[ends[:, 1]]) / 2]
        )
        new = []
        for side in range(2):
            face = edges.sides[chosen, side]
            here = face >= 0
            face, (a, b), m = face[here], ends[here].T, middle[here]
            old = self.faces[face]
            new.append(np.where(old == a[:, None], m[:, None], old))
            self.faces[face] = np.where(old == b[:, None], m[:, None], old)
        self.faces = np.concatenate([self.faces, *new])
        return True

    def _collapse(self) -> int:
        """Merge the ends of edges shorter than 4/5 of the target; return how many."""
        edges, line, kind = self._state()
        long = self._lengths(edges)
        u, v = edges.ends.T  # v goes, u stays
        swap = kind[v] > kind[u]
        u, v = np.where(swap, v, u), np.where(swap, u, v)
        wanted = (long < self.target * 4 / 5) & (kind[v] < CORNER)
        wanted &= line | (kind[v] == SMOOTH)  # a line shrinks along itself only
        index = np.flatnonzero(wanted)
        index = index[np.lexsort((index, long[index]))]
        u, v = u[index], v[index]
        place = np.where(
            (kind[u] == kind[v])[:, None],
            (self.vertices[u] + self.vertices[v]) / 2,
            self.vertices[u],
        )
        stars = _Stars(self.faces, len(self.vertices))
        allowed = stars.common_neighbours(edges, u, v) == np.where(edges.is_open[index], 1, 2)
        allowed &= self._stays_sound(stars, u, v, place) & self._stays_sound(stars, v, u, place)
        u, v, place = u[allowed], v[allowed], place[allowed]
        moved = np.arange(len(self.vertices))
        chosen = stars.apart(u, v)
        moved[v[chosen]] = u[chosen]
        self.vertices[u[chosen]] = place[chosen]
        self.faces = moved[self.faces]
        i, j, k = self.faces.T
        self.faces = self.faces[(i != j) & (j != k) & (k != i)]
        self._drop_unused()
        return int(chosen.sum())

    def _stays_sound(self, stars: _Stars, goer: Ints, other: Ints, place: Array) -> Bools:
        """Return where moving ``goer`` to ``place`` turns no face over and makes no long edge.

        Faces that also hold ``other`` vanish and are not asked.
        """
        row, face = stars.expand(goer)
        corners = self.faces[face]
        keep = ~(corners == other[row][:, None]).any(axis=1)
        row, face, corners = row[keep], face[keep], corners[keep]
        before = self.vertices[corners]
        at = corners == goer[row][:, None]
        after = np.where(at[:, :, None], place[row][:, None, :], before)
        old = cross(before[:, 1] - before[:, 0], before[:, 2] - before[:, 0])
        new = cross(after[:, 1] - after[:, 0], after[:, 2] - after[:, 0])
        bad = dot(old, new) <= 0.5 * length(old) * length(new)
        bad |= length(new) < 1e-3 * self.target * self.target
        for i in range(3):
            side = length(after[:, i] - after[:, i - 1])
            bad |= (side > self.target * 4 / 3) & (side > length(before[:, i] - before[:, i - 1]))
        return np.bincount(row[bad], minlength=len(goer)) == 0

    def _drop_unused(self) -> None:
        used = np.zeros(len(self.vertices), dtype=bool)
        used[self.faces] = True
        self.faces = (np.cumsum(used) - 1)[self.faces]
        self.vertices = self.vertices[used]

    def _flip(self) -> bool:
        """Turn the edges whose two opposite angles sum to more than 180 degrees (Delaunay)."""
        edges, line, _ = self._state()
        index = np.flatnonzero(~line)
        (a, b), (c, d) = edges.ends[index].T, edges.apexes[index].T
        p, q, r, s = (self.vertices[i] for i in (a, b, c, d))
        gain = -(_cotangent(p - r, q - r) + _cotangent(p - s, q - s))
        good = gain > 1e-6
        existing = edges.ends[:, 0] * len(self.vertices) + edges.ends[:, 1]
        good &= ~np.isin(np.minimum(c, d) * len(self.vertices) + np.maximum(c, d), existing)
        normals = double_area_normals(self.vertices, self.faces)
        old = normals[edges.sides[index, 0]] + normals[edges.sides[index, 1]]
        # The first face walks a to b or b to a; the new ones keep that sense.
        first = self.faces[edges.sides[index, 0]]
        ahead = (
            ((first[:, 0] == a) & (first[:, 1] == b))
            | ((first[:, 1] == a) & (first[:, 2] == b))
            | ((first[:, 2] == a) & (first[:, 0] == b))
        )
        a, b = np.where(ahead, a, b), np.where(ahead, b, a)
        one, two = np.stack([a, d, c], axis=1), np.stack([b, c, d], axis=1)
        for face in (one, two):
            new = double_area_normals(self.vertices, face)
            good &= dot(old, new) > 0.7 * length(old) * length(new)
        order = np.flatnonzero(good)
        order = order[np.lexsort((order, -gain[order]))]
        locked = np.zeros(len(self.faces), dtype=bool)
        made = set()
        for i in order:
            f, g = edges.sides[index[i]]
            joined = (min(c[i], d[i]), max(c[i], d[i]))  # two flips may ask for one new edge
            if locked[f] or locked[g] or joined in made:
                continue
            locked[[f, g]] = True
            made.add(joined)
            self.faces[f], self.faces[g] = one[i], two[i]
        return bool(made)

    def _smooth(self) -> None:
        """Move each vertex towards the middle of its neighbours, along the surface."""
        edges, line, kind = self._state()
        n = len(self.vertices)
        normals = double_area_normals(self.vertices, self.faces)
        normal = np.zeros((n, 3))
        target = np.zeros((n, 3))
        a, b = edges.ends.T
        # A vertex on a line listens to its neighbours on that line only.
        hears_b = line | (kind[a] == SMOOTH)
        hears_a = line | (kind[b] == SMOOTH)
        count = np.bincount(a[hears_b], minlength=n) + np.bincount(b[hears_a], minlength=n)
        for axis in range(3):
            for corner in range(3):
                normal[:, axis] += np.bincount(self.faces[:, corner], normals[:, axis], n)
            at = self.vertices[:, axis]
            target[:, axis] = np.bincount(a[hears_b], at[b[hears_b]], n)
            target[:, axis] += np.bincount(b[hears_a], at[a[hears_a]], n)
        step = (target / np.maximum(count, 1)[:, None] - self.vertices) * 0.7
        along = dot(step, normal) / np.maximum(dot(normal, normal), 1e-300)
        step = np.where((kind == SMOOTH)[:, None], step - normal * along[:, None], step)
        self.vertices = self.vertices + np.where((kind == CORNER)[:, None], 0.0, step)
        if self.project is not None:
            self.vertices = self.project(self.vertices, kind == LINE)


def _cotangent(a: Array, b: Array) -> Array:
    """Return the cotangents of the angles between vectors (N, 3)."""
    return dot(a, b) / np.maximum(length(cross(a, b)), 1e-300)


class _Stars:
    """Which faces lie around each vertex."""

    def __init__(self, faces: Ints, n_vertices: int) -> None:
        flat = faces.ravel()
        self._faces = np.argsort(flat, kind="stable") // 3
        self._start = np.concatenate([[0], np.cumsum(np.bincount(flat, minlength=n_vertices))])
        self._corners = faces

    def expand(self, vertices: Ints) -> tuple[Ints, Ints]:
        """Return (row, face) for each face around each of ``vertices``."""
        count = self._start[vertices + 1] - self._start[vertices]
        row = np.repeat(np.arange(len(vertices)), count)
        first = np.repeat(self._start[vertices] - (np.cumsum(count) - count), count)
        return row, self._faces[first + np.arange(count.sum())]

    def apart(self, u: Ints, v: Ints) -> Bools:
        """Return which pairs to take, the first ones first, so that no two touch one face."""
        (row_u, face_u), (row_v, face_v) = self.expand(u), self.expand(v)
        rows, faces = np.concatenate([row_u, row_v]), np.concatenate([face_u, face_v])
        order = np.argsort(rows, kind="stable")
        rings = self._corners[faces[order]].ravel().tolist()
        ends = (3 * np.cumsum(np.bincount(rows, minlength=len(u)))).tolist()
        locked = bytearray(len(self._start))
        chosen = np.zeros(len(u), dtype=bool)
        start = 0
        for pair, end in enumerate(ends):
            ring, start = rings[start:end], end
            if not any(locked[vertex] for vertex in ring):
                chosen[pair] = True
                for vertex in ring:
                    locked[vertex] = 1
        return chosen

    def common_neighbours(self, edges: Edges, u: Ints, v: Ints) -> Ints:
        """Return how many vertices are joined to both ``u`` and ``v``, pair by pair."""
        n = len(self._start)
        keys = edges.ends[:, 0] * n + edges.ends[:, 1]  # ascending
        row, face = self.expand(u)
        pairs = np.sort(np.repeat(row, 3) * n + self._corners[face].ravel())
        pairs = pairs[np.append(True, pairs[1:] != pairs[:-1])] if len(pairs) else pairs
        row, w = pairs // n, pairs % n
        x = v[row]
        query = np.minimum(w, x) * n + np.maximum(w, x)
        place = np.minimum(np.searchsorted(keys, query), len(keys) - 1)
        joined = (keys[place] == query) & (w != u[row]) & (w != x)
        return np.bincount(row[joined], minlength=len(u))
