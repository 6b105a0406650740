"""Which clusters of faces views leave out: CropFOV, CropBack and CropNorm (Sec. 2.1.1).

All surfaces of a scene are culled together: the filters for all poses and all clusters are a
few matrix products with each cluster's bounding sphere and the box around its faces' planes.
The cull is conservative: it never changes a map. Clusters that look away are kept where they may
hide something, for nothing proves of an ordinary mesh that no ray meets a back face first.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from glvis.sight.renderer import Selection
from glvis.sight.surface import Surface
from glvis.sight.views import Views

Bools = NDArray[np.bool_]
Floats = NDArray[np.float64]

_SLACK = 1e-5  # of the cosine of the largest incidence, which float32 may round


class Chosen(NamedTuple):
    """What is left of a surface of C clusters.

    Attributes
    ----------
    to_draw : Selection
        What is in the frusta and can hide or be seen.
    candidates : (N, C) bool
        Clusters that may have a face to count: one that looks at the eye, within the largest
        incidence (CropNorm) where that is by the ray.
    """

    to_draw: Selection
    candidates: Bools


class Culling:
    """The clusters of some surfaces, C in all, culled together.

    Parameters
    ----------
    surfaces : sequence of Surface
        M of them.

    Attributes
    ----------
    corners : (8 M, 3) float64
        Of the surfaces' boxes.
    """

    def __init__(self, surfaces: Sequence[Surface]) -> None:
        self._surfaces = surfaces
        clusters = [surface.clusters for surface in surfaces]
        self._sizes = [len(one) for one in clusters]
        self.corners = np.concatenate([one.corners for one in clusters])
        self._middle = self.corners.mean(axis=0)
        self._centre = np.concatenate([one.sphere[0] for one in clusters], axis=1)
        self._radius = np.concatenate([one.sphere[1] for one in clusters])
        self._plane_box = np.concatenate([one.plane_box(self._middle) for one in clusters], axis=1)
        slack = np.array([one.slack for one in clusters])
        self._slack = np.repeat(slack, self._sizes)

    def chosen(self, views: Views) -> dict[Surface, Chosen]:
        """Return what views keep of each surface."""
        planes, eye = views.planes, views.eye
        mask = self.in_frustum(planes)
        height = self.most_height(eye)
        faces = mask & (height >= 0)
        min_cos = views.min_ray_cos[:, None] * (1 - _SLACK)
        candidates = faces & (height >= min_cos * self.least_distance(eye))
        kept, begin = {}, 0
        for surface, size in zip(self._surfaces, self._sizes, strict=True):
            mine = slice(begin, begin + size)
            kept[surface] = Chosen(Selection(surface, mask[:, mine]), candidates[:, mine])
            begin += size
        return kept

    def in_frustum(self, planes: Floats) -> Bools:
        """Return which clusters may show inside frusta, (N, C) bool (CropFOV).

        Parameters
        ----------
        planes : (N, K, 4) float64
            Inward unit planes of N frusta in the world: ``planes @ (p, 1) >= 0`` inside.
        """
        above = planes[:, 0] @ self._centre
        for k in range(1, planes.shape[1]):
            np.minimum(above, planes[:, k] @ self._centre, out=above)
        return above >= -self._radius

    def most_height(self, eye: Floats) -> Floats:
        """Return how high eyes may be above the plane of any face of each cluster, (N, C).

        Never too small; negative where no face of the cluster looks at the eye (CropBack).

        Parameters
        ----------
        eye : (N, 3) float64
            Optical centres in the world.
        """
        e = np.ones((len(eye), 8))
        e[:, :3] = e[:, 4:7] = eye - self._middle
        # the largest n . eye - n . p over the cluster's box of planes (n, -n . p)
        np.maximum(e[:, :4], 0, out=e[:, :4])
        np.minimum(e[:, 4:], 0, out=e[:, 4:])
        return e @ self._plane_box + self._slack

    def least_distance(self, eye: Floats) -> Floats:
        """Return how near eyes may be to any face of each cluster, (N, C); never too large."""
        squared = np.zeros((len(eye), len(self._radius)))
        for axis in range(3):
            offset = eye[:, axis : axis + 1] - self._centre[axis]
            squared += np.square(offset, out=offset)
        return np.subtract(np.sqrt(squared, out=squared), self._radius, out=squared)
