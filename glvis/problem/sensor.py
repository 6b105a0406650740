"""Sensors one can buy: field of view, working range, incidence limit and pixels."""

from __future__ import annotations

import math
import operator
from dataclasses import dataclass, replace

from glvis.problem.camera import Intrinsics
from glvis.problem.units import MM_PER_UNIT


@dataclass(frozen=True)
class Sensor:
    """A camera or depth sensor model, Sec. 2.1 of the paper.

    Attributes
    ----------
    name : str
        As the study calls it.
    intrinsics : Intrinsics
        Opening angles.
    resolution : tuple of int
        Pixels (width, height).
    min_distance, max_distance : float
        The paper's minD and maxD: the working range as depth along the optical axis, in the
        study's unit. Not the clip planes: what is nearer than ``min_distance`` still hides
        what lies behind it.
    max_incidence : float
        Largest angle between a face's normal and the way back to the sensor, radians;
        0 is a face that looks at the sensor, pi/2 one seen edge on.
    """

    name: str
    intrinsics: Intrinsics
    resolution: tuple[int, int]
    min_distance: float
    max_distance: float
    max_incidence: float = math.pi / 2

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
            Intrinsics.from_degrees(hfov_deg, vfov_deg),
            (width, height),
            min_distance,
            max_distance,
            math.radians(max_incidence_deg),
        )

    def __repr__(self) -> str:
        opening = (self.intrinsics.hfov, self.intrinsics.vfov)
        return (
            f"Sensor('{self.name}', {' x '.join(f'{math.degrees(a):.4g}' for a in opening)} deg, "
            f"{self.resolution[0]} x {self.resolution[1]} pixels, {self.min_distance:g} to "
            f"{self.max_distance:g}, incidence up to {math.degrees(self.max_incidence):.4g} deg)"
        )

    def focal_pixels(self, resolution: tuple[int, int] | None = None) -> tuple[float, float]:
        """Return the focal length along x and y in pixels, at the sensor's or a given size."""
        width, height = resolution or self.resolution
        tan_x, tan_y = self.intrinsics.tan_half
        return width / 2 / float(tan_x), height / 2 / float(tan_y)


def working_distance(sensor: Sensor) -> float:
    """Return the middle of a sensor's working range, the study's unit."""
    return (sensor.min_distance + sensor.max_distance) / 2


# Sensors that a study may name without describing them; ranges in millimetres.
CATALOGUE = {
    sensor.name: sensor
    for sensor in (
        # Table 3, with the paper's conservative field of view and measured working range.
        Sensor(
            "d415",
            Intrinsics.from_degrees(66.4, 39.5),
            (1280, 720),
            160,
            350,
            math.radians(70),
        ),
        # Sec. 3.2 takes "literature parameters": depth camera 70.6 x 60 deg, 512 x 424, 0.5..4.5 m
        # (Microsoft's data sheet); 80 deg is the incidence limit of the kitchen study.
        Sensor(
            "kinect-v2",
            Intrinsics.from_degrees(70.6, 60.0),
            (512, 424),
            500,
            4500,
            math.radians(80),
        ),
    )
}


def catalogue(unit: str) -> dict[str, Sensor]:
    """Return the sensors that need no table, their ranges in a study's unit."""
    factor = 1 / MM_PER_UNIT.get(unit, 1.0)
    return {
        name: replace(
            sensor,
            min_distance=sensor.min_distance * factor,
            max_distance=sensor.max_distance * factor,
        )
        for name, sensor in CATALOGUE.items()
    }
