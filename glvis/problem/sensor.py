"""Sensors one can buy: lens, working range, incidence limit, pixels and second viewpoint."""

from __future__ import annotations

import math
import operator
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from glvis.problem.lens import Lens, Pinhole

Floats = NDArray[np.float64]
Triple = tuple[float, float, float]

ROLES = ("imager", "projector")  # of a partner
DISTANCES = ("depth", "range")  # what minD and maxD measure


@dataclass(frozen=True)
class Partner:
    """The second viewpoint of a sensor, fixed to the first: an imager or a projector.

    A point counts where both see it; see method.md, section 8.

    Attributes
    ----------
    offset : tuple of float
        Its optical centre in the camera frame of the first: right, up, back; study's unit.
    lens : Lens
        Its own.
    turn : tuple of float
        Yaw to the right and pitch up of its optical axis against that of the first, radians.
    role : str
        "imager" or "projector".
    """

    offset: Triple
    lens: Lens
    turn: tuple[float, float] = (0.0, 0.0)
    role: str = "imager"

    def __post_init__(self) -> None:
        if not all(map(math.isfinite, (*self.offset, *self.turn))):
            raise ValueError("offset and turn_deg of a partner must be finite")
        if self.role not in ROLES:
            raise ValueError(f"role = '{self.role}' must be {' or '.join(map(repr, ROLES))}")

    @property
    def baseline(self) -> float:
        """Distance of the two optical centres, study's unit."""
        return math.hypot(*self.offset)

    @cached_property
    def partner_to_sensor(self) -> Floats:
        """Its pose in the camera frame of the first, (4, 4)."""
        (sin_yaw, sin_pitch), (cos_yaw, cos_pitch) = np.sin(self.turn), np.cos(self.turn)
        # frames of right, up, back: yaw to the right turns the way back to the left
        yaw = np.array([[cos_yaw, 0, -sin_yaw], [0, 1, 0], [sin_yaw, 0, cos_yaw]])
        pitch = np.array([[1, 0, 0], [0, cos_pitch, -sin_pitch], [0, sin_pitch, cos_pitch]])
        pose = np.eye(4)
        pose[:3, :3] = yaw @ pitch
        pose[:3, 3] = self.offset
        pose.flags.writeable = False
        return pose

    def poses(self, camera_to_world: Floats) -> Floats:
        """Return its poses (..., 4, 4) where the first's are ``camera_to_world`` (..., 4, 4)."""
        return camera_to_world @ self.partner_to_sensor


@dataclass(frozen=True)
class Noise:
    """How far a depth may be off, 1 sigma along the optical axis; one of the two.

    Attributes
    ----------
    subpixel : float, optional
        Error of a disparity in pixels: stereo and structured light, z^2 subpixel / (f baseline).
    polynomial : tuple of float
        Coefficients of 1, z, z^2 ... in the study's unit, from a data sheet or a fit.
    by_incidence : bool
        Whether the error is divided by the cosine of the incidence.
    """

    subpixel: float | None = None
    polynomial: tuple[float, ...] = ()
    by_incidence: bool = False

    def __post_init__(self) -> None:
        if (self.subpixel is None) == (not self.polynomial):
            raise ValueError("noise takes either subpixel or polynomial")
        if self.subpixel is not None and not 0 < self.subpixel < math.inf:
            raise ValueError(f"subpixel = {self.subpixel:g} must be above 0 pixels")
        if not all(map(math.isfinite, self.polynomial)):
            raise ValueError("polynomial must be finite numbers")


@dataclass(frozen=True)
class Focus:
    """What decides how sharp a view is: the blur of a thin lens.

    Attributes
    ----------
    focal_length : float
        Of the lens, study's unit.
    f_number : float
        Focal length by the diameter of the aperture.
    distance : float
        What is in focus, from the optical centre along the axis; study's unit.
    pixel_pitch : float
        Width of a pixel on the sensor, study's unit.
    """

    focal_length: float
    f_number: float
    distance: float
    pixel_pitch: float

    def __post_init__(self) -> None:
        for name in ("focal_length", "f_number", "distance", "pixel_pitch"):
            if not 0 < getattr(self, name) < math.inf:
                raise ValueError(f"{name} = {getattr(self, name):g} must be above 0")
        if self.distance <= self.focal_length:
            raise ValueError(
                f"distance = {self.distance:g} in focus must be more than the focal length, "
                f"{self.focal_length:g}"
            )


@dataclass(frozen=True)
class Sensor:
    """A camera or depth sensor model, Sec. 2.1 of the paper.

    Attributes
    ----------
    name : str
        As the study calls it.
    lens : Lens
        Which directions are in the image.
    resolution : tuple of int
        Pixels (width, height).
    min_distance, max_distance : float
        The paper's minD and maxD: the working range, in the study's unit. Not the clip planes:
        what is nearer than ``min_distance`` still hides what lies behind it.
    max_incidence : float
        Largest angle between a face's normal and the way back to the sensor, radians;
        0 is a face that looks at the sensor, pi/2 one seen edge on.
    distance : str
        What the working range measures: "depth" along the optical axis, as the paper's planes
        do, or "range" from the optical centre.
    partner : Partner, optional
        The second viewpoint, by which a point must be seen as well.
    noise : Noise, optional
        Of its depths.
    focus : Focus, optional
        What is sharp.
    emits : str
        Name of the group of projectors that disturb each other; "": it emits nothing.
    cost : float, optional
        In any one currency.
    """

    name: str
    lens: Lens
    resolution: tuple[int, int]
    min_distance: float
    max_distance: float
    max_incidence: float = math.pi / 2
    distance: str = "depth"
    partner: Partner | None = None
    noise: Noise | None = None
    focus: Focus | None = None
    emits: str = ""
    cost: float | None = None

    def __post_init__(self) -> None:
        if not 0 <= self.min_distance < self.max_distance < math.inf:
            raise ValueError(
                f"min_distance = {self.min_distance:g} and max_distance = {self.max_distance:g} "
                "must satisfy 0 <= min_distance < max_distance"
            )
        if not 0 < self.max_incidence <= math.pi / 2:
            raise ValueError(
                f"max_incidence_deg = {math.degrees(self.max_incidence):g} must lie in (0, 90]"
            )
        if min(self.resolution) < 1:
            raise ValueError(f"resolution = {list(self.resolution)} must be at least [1, 1]")
        if self.distance not in DISTANCES:
            choice = " or ".join(map(repr, DISTANCES))
            raise ValueError(f"distance = '{self.distance}' must be {choice}")
        if self.cost is not None and not 0 <= self.cost < math.inf:
            raise ValueError(f"cost = {self.cost:g} must be at least 0")
        if self.noise and self.noise.subpixel and not self.partner:
            raise ValueError("noise.subpixel needs the baseline of a partner")

    @property
    def is_ideal(self) -> bool:
        """Whether it is the paper's own: one pinhole whose range is depth."""
        is_pinhole = isinstance(self.lens, Pinhole)
        return is_pinhole and self.distance == "depth" and self.partner is None

    @classmethod
    def from_degrees(
        cls,
        *,
        hfov_deg: float,
        vfov_deg: float,
        resolution: tuple[int, int],
        min_distance: float,
        max_distance: float,
        max_incidence_deg: float = 90.0,
        name: str = "sensor",
    ) -> Sensor:
        """Return a sensor from its data sheet: angles in degrees, all else as the attributes.

        Raises
        ------
        ValueError
            If an angle, a distance or the resolution is out of range.

        Examples
        --------
        >>> import glvis
        >>> glvis.Sensor.from_degrees(
        ...     hfov_deg=66.4, vfov_deg=39.5, resolution=(1280, 720), min_distance=160,
        ...     max_distance=350, max_incidence_deg=70)
        Sensor('sensor', 66.4 x 39.5 deg, 1280 x 720 pixels, 160 to 350, incidence up to 70 deg)
        """
        try:
            width, height = (operator.index(n) for n in resolution)
        except (TypeError, ValueError):
            raise ValueError(
                f"resolution = {resolution} must be pixels (width, height), two whole numbers"
            ) from None
        return cls(
            name,
            Pinhole.from_degrees(hfov_deg, vfov_deg),
            (width, height),
            min_distance,
            max_distance,
            math.radians(max_incidence_deg),
        )

    def __repr__(self) -> str:
        opening = " x ".join(f"{math.degrees(angle):.4g}" for angle in self.lens.opening)
        kind = "" if isinstance(self.lens, Pinhole) else f"{self.lens.kind} "
        second = f", with {self.partner.role}" if self.partner else ""
        return (
            f"Sensor('{self.name}', {kind}{opening} deg, "
            f"{self.resolution[0]} x {self.resolution[1]} pixels, {self.min_distance:g} to "
            f"{self.max_distance:g}, incidence up to {math.degrees(self.max_incidence):.4g} deg"
            f"{second})"
        )

    def focal_pixels(self, resolution: tuple[int, int] | None = None) -> tuple[float, float]:
        """Return the focal length along x and y in pixels, at the sensor's or a given size."""
        width, height = resolution or self.resolution
        x, y = self.lens.focal
        return width * x, height * y


def working_distance(sensor: Sensor) -> float:
    """Return the middle of a sensor's working range, the study's unit."""
    return (sensor.min_distance + sensor.max_distance) / 2
