"""Coarser occluders for meshes whose faces are hardly larger than a pixel.

Where a mesh of many faces hides centres of mass, what matters is where its surface lies to about
a pixel, not each of its faces. So vertices are merged within cells of a grid, some pixels wide,
and the few larger faces that are left hide instead. Merging may not close gaps or lose thin parts:
only vertices are merged that edges within the cell join and whose surroundings face alike, so that
a rod or a plate thinner than a cell keeps its sides. Vertices on a boundary stay as they are, and
so do those of sheets that are modelled from both sides.

A view's level follows from its pose alone, so that a map is the same whatever was made before.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components

from glvis.inputs.scene import Model
from glvis.sight.clusters import Clusters
from glvis.sight.culling import Culling
from glvis.sight.renderer import Selection
from glvis.sight.surface import Surface
from glvis.sight.views import Views

Bools = NDArray[np.bool_]
Floats = NDArray[np.float64]

# Width of a cell in pixels. With cells of 2, 3 and 4 pixels, maps by centre of a mesh of 416,000
# faces agree with centroid rays to 0.9994, 0.9993 and 0.9987, with the faces themselves to 0.9995.
# That mesh is smooth; on waves of 2 pixels height and 12 length, seen at 60 degrees, cells of 3
# agree to 0.951 and the faces themselves to 0.959.
_PIXELS = 3.0
_FROM_FACES = 100_000  # models of fewer cost little as they are
_LEVELS_AN_OCTAVE = 2
_CLUSTER = 8  # faces; few, for they are large and their directions far apart
# No cell may be so large that a model is lost in it, nor a part near the eye hide too coarsely:
# shares of the model's size and of the nearest depth.
_MOST_OF_SIZE, _MOST_OF_NEAREST = 1 / 64, 2.0
_MOST_CELLS = 2**19  # along an axis: their numbers, six bins each, fit into 64 bits
# Length of the mean of the normals around a vertex below which it stays: sheets whose both sides
# are modelled cancel to 0, a right-angled edge has 0.7.
_AGREE = 0.5
# Of the faces; where more are left, the faces themselves hide: they cost as little and are exact.
_MOST_LEFT = 0.7
# Turns the six bins of direction away from the axes, which flat parts often face.
_TURN = ((0.54, -0.64, 0.55), (0.80, 0.60, -0.08), (-0.28, 0.48, 0.83))


def merged(model: Model, boundary: NDArray[np.intp], cell: float) -> Model:
    """Return a model whose vertices that face alike are merged within cells of a grid.

    Parameters
    ----------
    model : Model
        F faces, V vertices.
    boundary : (B,) int
        Vertices that stay as they are.
    cell : float
        Width of a cell, scene unit, > 0.
    """
    n = len(model.vertices)
    place = np.floor((model.vertices - model.bounds[0]) / cell).astype(np.int64)
    width = place.max(axis=0) + 1
    key = (place[:, 0] * width[1] + place[:, 1]) * width[2] + place[:, 2]
    direction, agrees = _directions(model)
    key = 6 * key + direction
    stays = ~agrees
    stays[boundary] = True
    # along edges only, so that both sides of a gap stay apart
    start, end = model.faces.ravel(), np.roll(model.faces, -1, axis=1).ravel()
    joined = (key[start] == key[end]) & ~stays[start] & ~stays[end]
    edges = (np.ones(np.count_nonzero(joined), dtype=bool), (start[joined], end[joined]))
    _, group = connected_components(coo_array(edges, shape=(n, n)), directed=False)
    weight = np.bincount(group)
    sums = [np.bincount(group, model.vertices[:, axis]) for axis in range(3)]
    faces = group[model.faces]
    ends = np.roll(faces, 1, axis=1)
    faces = faces[(faces != ends).all(axis=1)].astype(np.int32)
    return Model(model.name, np.stack(sums, axis=1) / weight[:, None], faces)


def _directions(model: Model) -> tuple[NDArray[np.int64], Bools]:
    """Return which of six ways each vertex faces, and whether its faces agree, (V,) each."""
    sums = np.zeros((4, len(model.vertices)))
    for corner in range(3):
        at = model.faces[:, corner]
        sums[3] += np.bincount(at, model.areas, len(model.vertices))
        for axis in range(3):
            sums[axis] += np.bincount(at, model.areas * model.normals[:, axis], sums.shape[1])
    # no matrix product, whose last bits depend on the machine
    turned = np.stack([row[0] * sums[0] + row[1] * sums[1] + row[2] * sums[2] for row in _TURN])
    axis = np.abs(turned).argmax(axis=0)
    towards = np.take_along_axis(turned, axis[None], axis=0)[0] > 0
    return 2 * axis + towards, np.sum(sums[:3] ** 2, axis=0) >= (_AGREE * sums[3]) ** 2


class StandIns:
    """The coarser surfaces of a scene, each made when first needed.

    Parameters
    ----------
    origin : (3,) float64
        As the surfaces themselves were made with.
    """

    def __init__(self, origin: Floats) -> None:
        self._origin = origin
        self._made: dict[tuple[Surface, int], tuple[Surface, Culling] | None] = {}

    def release(self) -> None:
        """Give the GPU's memory back."""
        for made in self._made.values():
            if made:
                made[0].release()
        self._made.clear()

    def instead_of(
        self, selection: Selection, views: Views, resolution: tuple[int, int]
    ) -> list[Selection]:
        """Return what may hide in place of a selection, itself where nothing coarser may."""
        surface = selection.surface
        if surface.clusters.model.n_faces < _FROM_FACES:
            return [selection]
        levels = _levels(surface, views, resolution)
        instead = []
        for level in np.unique(levels[levels > 0]).tolist():
            made = self._coarse(surface, level)
            if not made:
                levels[levels == level] = 0
                continue
            coarse, culling = made
            mask = culling.in_frustum(views.planes) & (levels == level)[:, None]
            mask &= (culling.most_height(views.eye) >= 0) | ~selection.cull_backs[:, None]
            instead.append(Selection(coarse, mask, selection.cull_backs))
        return [replace(selection, mask=selection.mask & (levels == 0)[:, None]), *instead]

    def _coarse(self, surface: Surface, level: int) -> tuple[Surface, Culling] | None:
        """Return a level of a surface, or None where it is not worth having."""
        if (surface, level) not in self._made:
            clusters = surface.clusters
            model = merged(clusters.model, clusters.boundary_vertices, _cell(surface, level))
            self._made[surface, level] = None
            if 0 < model.n_faces <= _MOST_LEFT * clusters.model.n_faces:
                made = Surface(Clusters.of(model, _CLUSTER), self._origin, is_target=False)
                self._made[surface, level] = made, Culling([made])
        return self._made[surface, level]


def _cell(surface: Surface, level: int) -> float:
    """Return the width of a level's cells; level 0 stands for the faces themselves."""
    return float(surface.clusters.model.mean_edge * 2 ** (level / _LEVELS_AN_OCTAVE))


def _levels(surface: Surface, views: Views, resolution: tuple[int, int]) -> NDArray[np.intp]:
    """Return the level that each view may use, (N,)."""
    clusters = surface.clusters
    # summed row by row, so that it does not depend on the others
    depth = views.depth_plane[:, None, 3] + np.sum(
        views.depth_plane[:, None, :3] * clusters.corners, axis=2
    )
    depth = np.minimum(depth.mean(axis=1), _MOST_OF_NEAREST * depth.min(axis=1))
    pixel = (2 * views.tan_half / np.array(resolution)).min(axis=1)
    size = float(np.ptp(clusters.corners, axis=0).max())
    cell = np.minimum(_PIXELS * pixel * np.maximum(depth, 0), _MOST_OF_SIZE * size)
    cell[cell < size / _MOST_CELLS] = 0
    ratio = np.maximum(cell / clusters.model.mean_edge, 1)
    return np.rint(_LEVELS_AN_OCTAVE * np.log2(ratio)).astype(np.intp)
