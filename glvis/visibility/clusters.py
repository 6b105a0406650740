"""The faces of a model in clusters, with what bounds each: what is culled is clusters.

Faces are sorted once by direction and place and cut into clusters of equal size. Every cluster
keeps a bounding sphere and a box around its faces' planes; ``culling`` uses both.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from glvis.problem.scene import Model

# Faces a cluster, measured by tools/bench.py: powers of two, at most the 32 bits of a word.
_SIZE_SMALL, _SIZE_LARGE, _LARGE = 8, 32, 100_000
_SLACK = 1e-5  # of the scene's extent: float32 on the GPU may round a boundary the other way
_MORTON_BITS = 10

Bools = NDArray[np.bool_]
Floats = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class FaceTable:
    """Faces of a model in an order in which neighbours lie side by side, T of them.

    Attributes
    ----------
    index : (T,) int
        Face indices of the model; a face may stand twice.
    centroids, normals : (3, T) float64
        Centres of mass and unit normals by coordinate.
    offsets : (T,) float64
        normal . x of each face's plane.
    longest : (T,) float64
        Longest edges.
    """

    index: NDArray[np.integer]
    centroids: Floats
    normals: Floats
    offsets: Floats
    longest: Floats

    @classmethod
    def of(cls, model: Model, index: NDArray[np.integer]) -> FaceTable:
        """Return the table of some faces of a model, in their order."""
        centroids = np.ascontiguousarray(model.centroids[index].T)
        normals = np.ascontiguousarray(model.normals[index].T)
        corners = model.vertices[model.faces[index]]
        edges = corners - np.roll(corners, 1, axis=1)
        longest = np.sqrt(np.sum(edges**2, axis=2).max(axis=1, initial=0))
        return cls(index, centroids, normals, np.sum(normals * centroids, axis=0), longest)


@dataclass(frozen=True, eq=False)
class Clusters:
    """The faces of one model in clusters, C of them, each of ``size`` faces (the last padded).

    Attributes
    ----------
    model : Model
        The faces themselves.
    order : (C * size,) int32
        Face indices by cluster; the last cluster is padded by its own last face. Faces
        without area are left out: nothing ever shows of them.
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
    def box(self) -> tuple[Floats, Floats]:
        """Lowest and highest coordinates of each cluster, (C, 3) each."""
        faces = self.model.faces[self.order]
        low = np.full((len(self), 3), np.inf)
        high = np.full((len(self), 3), -np.inf)
        for corner in range(3):
            points = self.model.vertices[faces[:, corner]].reshape(len(self), self.size, 3)
            low = np.minimum(low, points.min(axis=1))
            high = np.maximum(high, points.max(axis=1))
        return low, high

    @cached_property
    def sphere(self) -> tuple[Floats, Floats]:
        """Bounding spheres: homogeneous centres (4, C) and radii (C,)."""
        low, high = self.box
        centre = np.ones((4, len(self)))
        centre[:3] = (low + high).T / 2
        return centre, np.linalg.norm(high - low, axis=1) / 2 + self.slack

    @cached_property
    def table(self) -> FaceTable:
        """The faces in the clusters' order."""
        return FaceTable.of(self.model, self.order)

    @cached_property
    def around(self) -> tuple[NDArray[np.int32], NDArray[np.intp]]:
        """Faces by corner, vertex after vertex (3F,), and where each vertex begins (V + 1,)."""
        corners = self.model.faces.ravel()
        order = np.argsort(corners, kind="stable")
        begin = np.searchsorted(corners[order], np.arange(len(self.model.vertices) + 1))
        return (order // 3).astype(np.int32), begin

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
