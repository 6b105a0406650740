"""From where a scene is looked at: poses of a sensor, and what follows from them alone.

All models of a scene are looked at from the same poses, between clip planes that hold the whole
scene, so that what is worked out here is worked out once for all of them.

A viewpoint is an optical centre; a sensor has one, or two that must both see a point. Whatever its
lens, what it sees lies in one or several windows: pinhole images about the same centre.
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
class WindowViews:
    """The pinhole images of N views through a lens, K each, view by view; R = N K rows.

    Attributes
    ----------
    camera_to_world : (R, 4, 4) float64
        Poses of the windows.
    tan_half : (2,) float64
        Tangents of the half opening angles.
    reach : (R,) float64
        Of the view, by which the near plane is measured; at least ``farthest``; scene unit.
    clip_near, clip_far : (R,) float64
        Clip planes, beyond both ends of what can show.
    farthest : (R,) float64
        Distance beyond which nothing is seen: out of range, or there is nothing; scene unit.
    """

    camera_to_world: Floats
    tan_half: Floats
    reach: Floats
    clip_near: Floats
    clip_far: Floats
    farthest: Floats

    def __len__(self) -> int:
        return len(self.camera_to_world)

    @property
    def near(self) -> Floats:
        """Depths before which nothing hides, (R,), scene unit."""
        return NEAREST * self.reach

    @cached_property
    def world_to_camera(self) -> Floats:
        """The poses' inverses, (R, 4, 4)."""
        return rigid_inverse(self.camera_to_world)


@dataclass(frozen=True, eq=False)
class Views:
    """N poses of one viewpoint of a sensor, ready to look.

    Attributes
    ----------
    camera_to_world : (N, 4, 4) float64
        Poses.
    sensor : Sensor
        Whose.
    limits : Limits
        What its filters hold faces against.
    windows : WindowViews
        What is looked at, K of each view.
    partner : Views, optional
        The same poses' second viewpoint.
    is_partner : bool
        Whether they are that second viewpoint themselves.
    """

    camera_to_world: Floats
    sensor: Sensor
    limits: Limits
    windows: WindowViews
    partner: Views | None = None
    is_partner: bool = False

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
        limits, partner = Limits.of(sensor, options), None
        if sensor.partner:
            second = limits.of_partner(sensor.partner)
            poses = sensor.partner.poses(camera_to_world)
            windows = _windows_of(poses, second, corners)
            partner = cls(poses, sensor, second, windows, is_partner=True)
        return cls(
            camera_to_world, sensor, limits, _windows_of(camera_to_world, limits, corners), partner
        )

    def __len__(self) -> int:
        return len(self.camera_to_world)

    @property
    def per_view(self) -> int:
        """Windows of each view, K."""
        return len(self.limits.lens.windows)

    @property
    def is_straight(self) -> bool:
        """Whether the only window looks along the optical axis, so that its depths are depths."""
        return self.limits.lens.windows.is_straight

    @property
    def viewpoints(self) -> list[Views]:
        """The views of the optical centres that must all see a point."""
        return [self, *([self.partner] if self.partner else [])]

    @cached_property
    def first_to_camera(self) -> Floats | None:
        """From the camera frame of the sensor's own viewpoint, (4, 4); None where it is that."""
        partner = self.sensor.partner
        if not self.is_partner or partner is None:
            return None
        return rigid_inverse(partner.partner_to_sensor)

    @property
    def depth_range(self) -> tuple[float, float]:
        """Depths in a window between which a point of a face may lie that is in range."""
        limits = self.limits
        if self.is_straight:
            return (0.0 if limits.by_range else limits.min_distance), limits.max_distance
        return 0.0, (limits.max_distance if limits.by_range else np.inf)

    @property
    def eye(self) -> Floats:
        """Optical centres in the world, (N, 3)."""
        return self.camera_to_world[:, :3, 3]

    @cached_property
    def planes(self) -> Floats:
        """Inward unit planes of the windows: left, right, bottom, top, maxD; (R, 5, 4)."""
        windows = self.windows
        planes = np.zeros((len(windows), 5, 4))
        tan = windows.tan_half
        length = np.sqrt(1 + tan**2)
        for axis in range(2):  # x >= -tan depth, x <= tan depth, where depth is -z
            first = 2 * axis
            planes[:, first, axis] = 1 / length[axis]
            planes[:, first + 1, axis] = -1 / length[axis]
            planes[:, first : first + 2, 2] = -tan[axis] / length[axis]
        planes[:, 4, 2] = 1.0  # z >= -maxD
        planes[:, 4, 3] = self.limits.max_distance
        planes = planes @ windows.world_to_camera
        if not (self.is_straight or self.limits.by_range):  # along the sensor's own axis
            beyond = np.array([0.0, 0.0, 1.0, self.limits.max_distance])
            own = beyond @ rigid_inverse(self.camera_to_world)
            planes[:, 4] = np.repeat(own, self.per_view, axis=0)
        return planes


def _windows_of(camera_to_world: Floats, limits: Limits, corners: Floats) -> WindowViews:
    """Return the windows of poses (N, 4, 4), with clip planes that hold boxes' corners (K, 3)."""
    lens = limits.lens.windows
    if lens.is_straight:
        poses = camera_to_world
    else:
        poses = np.repeat(camera_to_world, len(lens), axis=0)
        turns = np.tile(lens.window_to_camera, (len(camera_to_world), 1, 1))
        poses[:, :3, :3] = poses[:, :3, :3] @ turns
    backwards = poses[:, :3, 2]
    eye = np.sum(backwards * poses[:, :3, 3], axis=1)
    # of the boxes; summed row by row, so that it does not depend on the others
    depth = eye[:, None] - np.sum(backwards[:, None] * corners, axis=2)
    deepest, most = depth.max(axis=1), limits.max_distance
    if not lens.is_straight:  # the same for all windows of a view
        deepest = np.linalg.norm(corners - poses[:, None, :3, 3], axis=2).max(axis=1)
        most = most if limits.by_range else np.inf
    reach = np.where(deepest > 0, np.minimum(most, _DEEPEST * deepest), most)
    # Planes beyond the scene on both sides cut no face and leave the depth buffer its bits.
    clip_far = np.minimum(np.maximum(deepest, reach), _FARTHEST * reach)
    clip_near = np.minimum(np.maximum(depth.min(axis=1), NEAREST * reach), clip_far / 2)
    farthest = np.where(deepest > 0, np.minimum(most, deepest), most)
    return WindowViews(
        poses, lens.tan_half, reach, clip_near / _MARGIN, clip_far * _MARGIN, farthest
    )
