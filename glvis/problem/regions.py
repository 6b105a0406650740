"""Connected pieces of a surface: where what nobody sees lies, largest first."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components

from glvis.problem.scene import Model

Floats = NDArray[np.float64]
Bools = NDArray[np.bool_]
Integers = NDArray[np.int64]

_MOST = 4  # told about a model
_WORTH_TELLING = 0.001  # of a model's area


@dataclass(frozen=True)
class Region:
    """A connected piece of surface.

    Attributes
    ----------
    n_faces : int
        Faces that share edges.
    area : float
        Scene unit squared.
    centre : (3,) float64
        Mean of the surface, world frame.
    facing : (3,) float64
        Mean unit normal; zero where normals cancel out.
    faces : (n,) int64
        Indices into the model's faces.
    """

    n_faces: int
    area: float
    centre: Floats
    facing: Floats
    faces: Integers


def regions(model: Model, chosen: Bools, most: int | None = None) -> list[Region]:
    """Return the connected pieces of some faces (F,) bool, the largest first; ``most`` of them."""
    index = np.flatnonzero(chosen)
    if not len(index):
        return []
    faces = model.faces[index].astype(np.int64)
    edges = np.sort(np.stack([faces, np.roll(faces, -1, axis=1)], axis=2), axis=2).reshape(-1, 2)
    owner = np.repeat(np.arange(len(index)), 3)
    order = np.lexsort(edges.T)
    same = (edges[order][1:] == edges[order][:-1]).all(axis=1)
    a, b = owner[order][:-1][same], owner[order][1:][same]
    graph = coo_array((np.ones(len(a)), (a, b)), shape=(len(index), len(index)))
    n, label = connected_components(graph, directed=False)
    area = np.bincount(label, model.areas[index], minlength=n)
    pieces = []
    for piece in np.argsort(-area, kind="stable")[:most]:
        own = index[label == piece]
        weights = model.areas[own, None]
        facing = (model.normals[own] * weights).sum(axis=0)
        length = float(np.linalg.norm(facing))
        total = float(weights.sum())
        centre = model.centroids[own].mean(axis=0)
        if total > 0:
            centre = (model.centroids[own] * weights).sum(axis=0) / total
            facing = facing / length if length > 0.1 * total else np.zeros(3)
        pieces.append(Region(len(own), total, centre, facing, own))
    return pieces


def largest_regions(model: Model, chosen: Bools) -> list[Region]:
    """Return those pieces of some faces (F,) bool that people are told of, the largest first."""
    least = _WORTH_TELLING * model.areas.sum()
    return [region for region in regions(model, chosen, _MOST) if region.area >= least]
