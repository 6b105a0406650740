"""The faces of a model in clusters, with what bounds each: what is culled is clusters.

Faces are sorted once by direction and place and cut into clusters of equal size. Every cluster
keeps a bounding sphere and a box around its faces' planes; ``culling`` uses both.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components

from glvis.inputs.scene import Model

# Faces a cluster, measured by tools/bench: powers of two, at most the 32 bits of a word.
_SIZE_SMALL, _SIZE_LARGE, _LARGE = 8, 32, 100_000
_SLACK = 1e-5  # of the scene's extent: float32 on the GPU may round a boundary the other way
_MORTON_BITS = 10

Bools = NDArray[np.bool_]
Floats = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class Clusters:
    """The faces of one model in clusters, C of them, each of ``size`` faces (the last padded).

    Attributes
    ----------
    model : Model
        The faces themselves.
    order : (C * size,) int32
        Face indices by cluster; the last cluster is padded by its own last face. Faces
        without area are left out, no pixel ever shows them.
    size : int
        Faces a cluster.
    """

    model: Model
    order: NDArray[np.int32]
    size: int

    @classmethod
    def of(cls, model: Model, size: int | None = None) -> Clusters:
        """Return the clusters of a model; ``size`` faces each, chosen by the number of faces."""
        faces = np.flatnonzero(model.areas > 0)
        size = size or (_SIZE_SMALL if len(faces) < _LARGE else _SIZE_LARGE)
        key = _morton_code(model.centroids[faces])
        if model.is_consistent:
            # six bins of direction above the place: a cluster's faces turn away together
            axis = np.argmax(np.abs(model.normals[faces]), axis=1)
            towards = np.take_along_axis(model.normals[faces], axis[:, None], axis=1)[:, 0] > 0
            key |= (2 * axis + towards).astype(np.uint64) << np.uint64(3 * _MORTON_BITS)
        order = faces[np.argsort(key, kind="stable")]
        padding = np.full(-len(order) % size, order[-1] if len(order) else 0)
        return cls(model, np.concatenate([order, padding]).astype(np.int32), size)

    def __len__(self) -> int:
        return len(self.order) // self.size

    @cached_property
    def corners(self) -> Floats:
        """Of the model's box, (8, 3)."""
        return self.model.bounds[np.array(list(np.ndindex(2, 2, 2))), np.arange(3)]

    def places_in(self, mask: Bools) -> NDArray[np.intp]:
        """Return the places in ``order`` of chosen clusters (C,) bool; padding repeats faces."""
        return np.flatnonzero(np.repeat(mask, self.size))

    @cached_property
    def slack(self) -> float:
        """How far float32 may move a boundary, scene unit."""
        bounds = self.model.bounds
        return _SLACK * float(np.max(np.ptp(bounds, axis=0)) + np.abs(bounds).max())

    @cached_property
    def middle(self) -> Floats:
        """Of the model's box, (3,)."""
        return self.model.bounds.mean(axis=0)

    @cached_property
    def sphere(self) -> tuple[Floats, Floats]:
        """Bounding spheres: homogeneous centres (4, C) and radii (C,)."""
        faces = self.model.faces[self.order]
        low = np.full((len(self), 3), np.inf)
        high = np.full((len(self), 3), -np.inf)
        for corner in range(3):
            points = self.model.vertices[faces[:, corner]].reshape(len(self), self.size, 3)
            low = np.minimum(low, points.min(axis=1))
            high = np.maximum(high, points.max(axis=1))
        centre = np.ones((4, len(self)))
        centre[:3] = (low + high).T / 2
        return centre, np.linalg.norm(high - low, axis=1) / 2 + self.slack

    @cached_property
    def longest_edge(self) -> Floats:
        """Of any face of each cluster, (C,)."""
        faces = self.model.faces[self.order]
        longest = np.zeros(len(faces))
        for corner in range(3):
            ends = self.model.vertices[faces[:, [corner, corner - 1]]]
            np.maximum(longest, np.linalg.norm(ends[:, 0] - ends[:, 1], axis=1), out=longest)
        return longest.reshape(len(self), self.size).max(axis=1)

    def plane_box(self, middle: Floats) -> Floats:
        """Return the largest, and then least, (n, -n . p) over each cluster's faces, (8, C).

        Parameters
        ----------
        middle : (3,) float64
            World point that places p are relative to.
        """
        normals = self.model.normals[self.order]
        points = self.model.centroids[self.order] - middle
        offset = -np.sum(normals * points, axis=1, keepdims=True)
        planes = np.concatenate([normals, offset], axis=1).reshape(len(self), self.size, 4)
        box = np.concatenate([planes.max(axis=1), planes.min(axis=1)], axis=1)
        return np.ascontiguousarray(box.T)

    @cached_property
    def encloses(self) -> bool:
        """Whether the surface, holes capped, is wound outwards around every part of it."""
        model = self.model
        if not model.is_consistent or not len(self):
            return False
        faces, n = model.faces, len(model.vertices)
        edges = (np.concatenate([faces[:, 0], faces[:, 1]]), faces[:, [1, 2]].T.ravel())
        graph = coo_array((np.ones(len(edges[0]), dtype=bool), edges), shape=(n, n))
        parts, part_of_vertex = connected_components(graph, directed=False)
        triangles = model.vertices[faces]
        part_of_face = part_of_vertex[faces[:, 0]]
        if len(self.caps):
            triangles = np.concatenate([triangles, self.caps])
            part_of_face = np.concatenate([part_of_face, part_of_vertex[self._boundary[:, 0]]])
        triangles = triangles - self.middle
        volume = np.sum(triangles[:, 0] * np.cross(triangles[:, 1], triangles[:, 2]), axis=1)
        volumes = np.bincount(part_of_face, weights=volume, minlength=parts)
        used = np.bincount(part_of_face, minlength=parts) > 0
        return bool(np.all(volumes[used] > 0))

    @property
    def boundary_vertices(self) -> NDArray[np.intp]:
        """Vertices at edges that one face alone has, (B,)."""
        return np.unique(self._boundary)

    @cached_property
    def _boundary(self) -> NDArray[np.int64]:
        """Edges that one face alone has, against that face's direction, (B, 2)."""
        if self.model.is_closed:
            return np.zeros((0, 2), dtype=np.int64)
        start = self.model.faces.astype(np.int64).ravel()
        end = np.roll(self.model.faces, -1, axis=1).astype(np.int64).ravel()
        key = np.minimum(start, end) * len(self.model.vertices) + np.maximum(start, end)
        _, first, uses = np.unique(key, return_index=True, return_counts=True)
        alone = first[(uses == 1) & (start[first] != end[first])]
        return np.stack([end[alone], start[alone]], axis=1)

    @cached_property
    def caps(self) -> Floats:
        """Triangles that close the holes: a fan around the middle of each loop, (B, 3, 3)."""
        edges = self._boundary
        if not len(edges):
            return np.zeros((0, 3, 3))
        vertices, local = np.unique(edges, return_inverse=True)
        local = local.reshape(edges.shape)
        shape = (len(vertices), len(vertices))
        graph = coo_array((np.ones(len(edges), dtype=bool), (local[:, 0], local[:, 1])), shape)
        loops, loop_of_vertex = connected_components(graph, directed=False)
        points = self.model.vertices[vertices]
        weight = np.bincount(loop_of_vertex, minlength=loops)
        middle = np.stack(
            [np.bincount(loop_of_vertex, points[:, k], loops) / weight for k in range(3)], axis=1
        )
        a, b = points[local[:, 0]], points[local[:, 1]]
        return np.stack([a, b, middle[loop_of_vertex[local[:, 0]]]], axis=1)


def _morton_code(points: Floats) -> NDArray[np.uint64]:
    """Return the place of points along a Z-order curve, (N,) uint64 of 30 bits."""
    low = points.min(axis=0, initial=np.inf) if len(points) else np.zeros(3)
    extent = max(float(np.ptp(points, axis=0).max()) if len(points) else 0.0, 1e-300)
    cells = ((points - low) / extent * (2**_MORTON_BITS - 1)).astype(np.uint64)
    code = np.zeros(len(points), dtype=np.uint64)
    for bit in range(_MORTON_BITS):
        for axis in range(3):
            chosen = (cells[:, axis] >> np.uint64(bit)) & np.uint64(1)
            code |= chosen << np.uint64(3 * bit + axis)
    return code


class Joined:
    """The clusters of M models side by side, to be looked at together.

    Parameters
    ----------
    clusters : sequence of Clusters
        M of them, C clusters in all.

    Attributes
    ----------
    columns : list of slice
        Where those of each model are.
    """

    def __init__(self, clusters: Sequence[Clusters]) -> None:
        self.clusters = clusters
        self._sizes = list(map(len, clusters))
        ends = np.cumsum(self._sizes).tolist()
        self.columns = [slice(end - n, end) for end, n in zip(ends, self._sizes, strict=True)]
        self._centre = np.concatenate([one.sphere[0] for one in clusters], axis=1)
        self._radius = np.concatenate([one.sphere[1] for one in clusters])
        self._longest_edge = np.concatenate([one.longest_edge for one in clusters])

    def seen_small(self, depth: Floats, near: Floats, share: Floats) -> Bools:
        """Return whose faces all lie before the eye and look small from there, (N, C) bool.

        Parameters
        ----------
        depth : (N, 4) float64
            ``depth @ (p, 1)`` is the distance of a point p along the optical axis.
        near : (N,) float64
            Least distance along it.
        share : (M, N) float64
            Longest edge as a share of that distance, by model.
        """
        # sums row by row: a matrix product's last bits depend on the other rows
        nearest = np.einsum("nk,kc->nc", depth, self._centre)
        nearest -= self._radius
        is_small = nearest >= near[:, None]
        nearest *= np.repeat(share.T, self._sizes, axis=1)
        is_small &= nearest >= self._longest_edge
        return is_small
