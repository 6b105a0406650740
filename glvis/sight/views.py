"""From where a scene is looked at: poses of a sensor, and what follows from them alone.

All models of a scene are looked at from the same poses, between clip planes that hold the whole
scene, so that what is worked out here is worked out once for all of them.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from glvis.camera import rigid_inverse
from glvis.inputs.sensor import Sensor

Floats = NDArray[np.float64]

NEAREST = 1e-3  # share of maxD: what is nearer to the eye hides nothing
# Far plane as a share of maxD: nothing that is in range is hidden by what lies beyond.
_FARTHEST = 2.0
_MARGIN = 1.001  # against rounding, around the clip planes


@dataclass(frozen=True, eq=False)
class Views:
    """N cameras, ready to draw.

    Attributes
    ----------
    camera_to_world : (N, 4, 4) float64
        Poses.
    tan_half : (N, 2) float64
        Tangents of the half opening angles.
    clip_near, clip_far : (N,) float64
        Clip planes, beyond both ends of what can show.
    min_distance, max_distance : (N,) float64
        Working range, the paper's minD and maxD.
    min_ray_cos, min_axis_cos : (N,) float64
        Cosine of the largest incidence by the true ray, 0 for any, and by the optical axis,
        -2 for any.
    """

    camera_to_world: Floats
    tan_half: Floats
    clip_near: Floats
    clip_far: Floats
    min_distance: Floats
    max_distance: Floats
    min_ray_cos: Floats
    min_axis_cos: Floats

    @classmethod
    def of(
        cls, camera_to_world: Floats, sensor: Sensor, corners: Floats, *, by_axis: bool = False
    ) -> Views:
        """Return the views of a sensor at some poses.

        Parameters
        ----------
        camera_to_world : (N, 4, 4) float64
            Poses.
        sensor : Sensor
            The model of all N.
        corners : (K, 3) float64
            Of boxes that hold the whole scene.
        by_axis : bool
            Whether the incidence is measured to the optical axis.
        """
        n = len(camera_to_world)
        backwards = camera_to_world[:, :3, 2]
        eye = np.sum(backwards * camera_to_world[:, :3, 3], axis=1)
        # of the boxes; summed row by row, so that it does not depend on the others
        depth = eye[:, None] - np.sum(backwards[:, None] * corners, axis=2)
        # Planes beyond the scene on both sides cut no face and leave the depth buffer its bits.
        most = sensor.max_distance
        clip_far = np.minimum(np.maximum(depth.max(axis=1), most), _FARTHEST * most)
        clip_near = np.minimum(np.maximum(depth.min(axis=1), NEAREST * most), clip_far / 2)
        min_cos = math.cos(sensor.max_incidence)
        return cls(
            camera_to_world,
            np.tile(sensor.intrinsics.tan_half, (n, 1)),
            clip_near / _MARGIN,
            clip_far * _MARGIN,
            np.full(n, sensor.min_distance),
            np.full(n, most),
            np.full(n, 0.0 if by_axis else min_cos),
            np.full(n, min_cos if by_axis else -2.0),
        )

    def __len__(self) -> int:
        return len(self.camera_to_world)

    @property
    def eye(self) -> Floats:
        """Optical centres in the world, (N, 3)."""
        return self.camera_to_world[:, :3, 3]

    @cached_property
    def world_to_camera(self) -> Floats:
        """The poses' inverses, (N, 4, 4)."""
        return rigid_inverse(self.camera_to_world)

    @cached_property
    def planes(self) -> Floats:
        """Inward unit planes of the frusta: left, right, bottom, top, maxD; (N, 5, 4)."""
        planes = np.zeros((len(self), 5, 4))
        tan = self.tan_half
        length = np.sqrt(1 + tan**2)
        for axis in range(2):  # x >= -tan depth, x <= tan depth, where depth is -z
            first = 2 * axis
            planes[:, first, axis] = 1 / length[:, axis]
            planes[:, first + 1, axis] = -1 / length[:, axis]
            planes[:, first : first + 2, 2] = (-tan / length)[:, axis : axis + 1]
        planes[:, 4, 2] = 1.0  # z >= -maxD
        planes[:, 4, 3] = self.max_distance
        return planes @ self.world_to_camera
