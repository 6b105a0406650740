"""A scene on the GPU: surfaces of its models and obstacles, their clusters numbered through."""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np
from numpy.typing import NDArray

from glvis.problem.scene import Model
from glvis.visibility.clusters import Clusters
from glvis.visibility.surface import Surface

Floats = NDArray[np.float64]


class GpuScene:
    """Models that are counted and obstacles that hide, C clusters of faces in all.

    Parameters
    ----------
    models, obstacles : iterable of Model
        At least one model.
    origin : (3,) float64, optional
        World point that float32 positions are relative to; the first model's middle by default.

    Attributes
    ----------
    targets, obstacles : list of Surface
        One a model, in their order.
    origin : (3,) float64
        As above.
    columns : dict
        The slice of the C clusters that each surface has.
    corners : (8 M, 3) float64
        Of the boxes of all M surfaces.
    middle : (3,) float64
        Of the corners: what ``plane_box`` is relative to.
    centre, radius : (4, C) and (C,) float64
        Bounding spheres, homogeneous centres.
    plane_box : (8, C) float64
        Boxes around the faces' planes, see ``Clusters.plane_box``.
    slack : (C,) float64
        How far float32 may move a boundary, scene unit.
    """

    def __init__(
        self, models: Iterable[Model], obstacles: Iterable[Model], origin: Floats | None = None
    ) -> None:
        models = list(models)
        self.origin = models[0].bounds.mean(axis=0) if origin is None else origin
        self.obstacles = [
            Surface(Clusters.of(obstacle), self.origin, is_target=False) for obstacle in obstacles
        ]
        self.targets = [
            Surface(Clusters.of(model), self.origin, is_target=True) for model in models
        ]
        surfaces = [*self.targets, *self.obstacles]
        clusters = [surface.clusters for surface in surfaces]
        ends = np.cumsum([len(one) for one in clusters]).tolist()
        self.columns = {
            surface: slice(end - len(surface.clusters), end)
            for surface, end in zip(surfaces, ends, strict=True)
        }
        self.corners = np.concatenate([one.corners for one in clusters])
        self.middle = self.corners.mean(axis=0)
        self.centre = np.concatenate([one.sphere[0] for one in clusters], axis=1)
        self.radius = np.concatenate([one.sphere[1] for one in clusters])
        self.plane_box = np.concatenate([one.plane_box(self.middle) for one in clusters], axis=1)
        self.slack = np.repeat([one.slack for one in clusters], [len(one) for one in clusters])

    @property
    def n_clusters(self) -> int:
        """C, of all surfaces."""
        return len(self.radius)

    def release(self) -> None:
        """Give the GPU's memory back."""
        for surface in self.columns:
            surface.release()
