"""Culls clusters of faces: bounds of CropFOV, CropBack and CropNorm (Sec. 2.1.1).

All surfaces of a scene are culled together: the filters for all poses and all clusters are a
few matrix products with each cluster's bounding sphere and the box around its faces' planes.
The cull is conservative: it never changes a map. Clusters that look away are kept where they may
hide something, for nothing proves of an ordinary mesh that no ray meets a back face first.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from glvis.visibility.gpu_scene import GpuScene
from glvis.visibility.views import Views

Bools = NDArray[np.bool_]
Floats = NDArray[np.float64]

_SLACK = 1e-5  # of the cosine of the largest incidence, which float32 may round


@dataclass(frozen=True, eq=False)
class Culled:
    """The cull result: what N views keep of the C clusters of a scene.

    Attributes
    ----------
    occludes : (R, C) bool
        Clusters in the frusta of the views' windows: they can hide or be seen.
    countable : (N, C) bool
        Those that may have a face to count: one that looks at the eye, within the largest
        incidence (CropNorm) where that is by the ray; at both eyes where there are two.
    partner : Culled, optional
        The same of the second viewpoint.
    """

    occludes: Bools
    countable: Bools
    partner: Culled | None = None

    @property
    def viewpoints(self) -> list[Culled]:
        """What each optical centre keeps."""
        return [self, *([self.partner] if self.partner else [])]


def cull(scene: GpuScene, views: Views) -> Culled:
    """Return what views keep of the clusters of a scene."""
    occludes = clusters_in_frustum(scene, views.planes)
    height = most_height(scene, views.eye)
    in_frustum: Bools = occludes
    if views.per_view > 1:
        in_frustum = np.any(occludes.reshape(len(views), views.per_view, -1), axis=1)
    countable = in_frustum & (height >= 0)
    min_cos = views.limits.min_ray_cos * (1 - _SLACK)
    countable &= height >= min_cos * least_distance(scene, views.eye)
    if views.partner is None:
        return Culled(occludes, countable)
    second = cull(scene, views.partner)
    return Culled(occludes, countable & second.countable, second)


def clusters_in_frustum(scene: GpuScene, planes: Floats) -> Bools:
    """Return which clusters may show inside frusta, (R, C) bool (CropFOV).

    Parameters
    ----------
    scene : GpuScene
        C clusters.
    planes : (R, K, 4) float64
        Inward unit planes of R frusta in the world: ``planes @ (p, 1) >= 0`` inside.
    """
    above = planes[:, 0] @ scene.centre
    for k in range(1, planes.shape[1]):
        np.minimum(above, planes[:, k] @ scene.centre, out=above)
    return above >= -scene.radius


def most_height(scene: GpuScene, eye: Floats) -> Floats:
    """Return how high eyes may be above the plane of any face of each cluster, (N, C).

    Never too small; negative where no face of the cluster looks at the eye (CropBack).

    Parameters
    ----------
    scene : GpuScene
        C clusters.
    eye : (N, 3) float64
        Optical centres in the world.
    """
    e = np.ones((len(eye), 8))
    e[:, :3] = e[:, 4:7] = eye - scene.middle
    # the largest n . eye - n . p over the cluster's box of planes (n, -n . p)
    np.maximum(e[:, :4], 0, out=e[:, :4])
    np.minimum(e[:, 4:], 0, out=e[:, 4:])
    return e @ scene.plane_box + scene.slack


def least_distance(scene: GpuScene, eye: Floats) -> Floats:
    """Return how near eyes (N, 3) may be to any face of each cluster, (N, C); never too large."""
    squared = np.zeros((len(eye), scene.n_clusters))
    for axis in range(3):
        offset = eye[:, axis : axis + 1] - scene.centre[axis]
        squared += np.square(offset, out=offset)
    return np.subtract(np.sqrt(squared, out=squared), scene.radius, out=squared)
