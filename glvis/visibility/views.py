"""From where a scene is looked at: poses of a sensor, and what follows from them alone.

All models of a scene are looked at from the same poses, between clip planes that hold the whole
scene, so that what is worked out here is worked out once for all of them.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from glvis.problem.camera import rigid_inverse
from glvis.problem.sensor import Sensor
from glvis.problem.visibility_options import VisibilityOptions
from glvis.visibility.filters import Limits

Floats = NDArray[np.float64]

NEAREST = 1e-3  # share of a view's reach: what is nearer to the eye hides nothing
# A view reaches to maxD, or to so many times the depth of the scene where that is less: a maxD
# beyond all things ("no limit") must not move the near plane among them.
_DEEPEST = 4.0
# Far plane as a share of the reach: nothing that is in range is hidden by what lies beyond.
_FARTHEST = 2.0
_MARGIN = 1.001  # against rounding, around the clip planes


@dataclass(frozen=True, eq=False)
class Views:
    """N poses of one sensor, ready to draw.

    Attributes
    ----------
    camera_to_world : (N, 4, 4) float64
        Poses.
    sensor : Sensor
        Whose.
    limits : Limits
        What its filters hold faces against.
    reach : (N,) float64
        Depth up to which anything is seen, or there is nothing; scene unit.
    clip_near, clip_far : (N,) float64
        Clip planes, beyond both ends of what can show.
    """

    camera_to_world: Floats
    sensor: Sensor
    limits: Limits
    reach: Floats
    clip_near: Floats
    clip_far: Floats

    @classmethod
    def of(
        cls, camera_to_world: Floats, sensor: Sensor, corners: Floats, options: VisibilityOptions
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
        options : VisibilityOptions
            What counts as visible.
        """
        backwards = camera_to_world[:, :3, 2]
        eye = np.sum(backwards * camera_to_world[:, :3, 3], axis=1)
        # of the boxes; summed row by row, so that it does not depend on the others
        depth = eye[:, None] - np.sum(backwards[:, None] * corners, axis=2)
        deepest, most = depth.max(axis=1), sensor.max_distance
        reach = np.where(deepest > 0, np.minimum(most, _DEEPEST * deepest), most)
        # Planes beyond the scene on both sides cut no face and leave the depth buffer its bits.
        clip_far = np.minimum(np.maximum(deepest, reach), _FARTHEST * reach)
        clip_near = np.minimum(np.maximum(depth.min(axis=1), NEAREST * reach), clip_far / 2)
        return cls(
            camera_to_world,
            sensor,
            Limits.of(sensor, options),
            reach,
            clip_near / _MARGIN,
            clip_far * _MARGIN,
        )

    def __len__(self) -> int:
        return len(self.camera_to_world)

    @property
    def near(self) -> Floats:
        """Depths before which nothing hides, (N,), scene unit."""
        return NEAREST * self.reach

    @property
    def tan_half(self) -> Floats:
        """Tangents of the half opening angles, (2,)."""
        return np.array(self.limits.tan_half)

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
            planes[:, first, axis] = 1 / length[axis]
            planes[:, first + 1, axis] = -1 / length[axis]
            planes[:, first : first + 2, 2] = -tan[axis] / length[axis]
        planes[:, 4, 2] = 1.0  # z >= -maxD
        planes[:, 4, 3] = self.limits.max_distance
        return planes @ self.world_to_camera
