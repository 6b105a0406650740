"""Sensors of every kind of lens, and with partners, that maps are held against rays by.

Lengths are those of things a few hundred units large, as arms in millimetres are.
"""

from __future__ import annotations

import math
from dataclasses import replace

from glvis.problem.calibrated_lens import FisheyeLens, OpenCVLens
from glvis.problem.lens import Lens, Pinhole, SphericalLens
from glvis.problem.sensor import Partner, Sensor

# Coefficients of a published calibration of an Azure Kinect's depth camera, 1024 x 1024 pixels:
# github.com/microsoft/Azure-Kinect-Sensor-SDK, issue 1488; its field ends at 60 degrees.
_AZURE = OpenCVLens(
    (1024, 1024),
    (503.8, 503.8),
    (511.5, 511.5),
    (4.72474, 3.20922, 0.0, 0.0, 0.170596, 5.05586, 4.77578, 0.886494),
    math.radians(60),
)
_BARREL = OpenCVLens((1280, 720), (750, 745), (650.3, 352.1), (-0.35, 0.12, 0.0015, -0.001))
# k1 alone folds at 44.3 degrees, inside this image: its left and right ends have no ray
_FOLDED = OpenCVLens((1280, 720), (850, 850), (630, 365), (-0.35, 0.0, -0.002, 0.0015))


def _fisheye(degrees: float) -> FisheyeLens:
    """Return a fisheye whose round image just fits 1,000 pixels."""
    half = math.radians(degrees / 2)
    k = (0.02, -0.006, 0.001, -0.0001)
    radius = half * (1 + sum(one * half ** (2 * n) for n, one in enumerate(k, 1)))
    return FisheyeLens((1000, 1000), (500 / radius,) * 2, (499.5, 499.5), k, half)


def _spherical(azimuth: float, low: float, high: float) -> SphericalLens:
    return SphericalLens(math.radians(azimuth), (math.radians(low), math.radians(high)))


_PAIR = Pinhole.from_degrees(69, 42)


def _sensor(
    lens: Lens,
    partner: Partner | None = None,
    *,
    near: float = 20.0,
    limit_deg: float = 80.0,
    distance: str = "depth",
) -> Sensor:
    return Sensor(
        "test", lens, (1024, 1024), near, 500.0, math.radians(limit_deg), distance, partner
    )


SENSORS: dict[str, Sensor] = {
    "opencv": _sensor(_BARREL),
    "opencv that folds": _sensor(_FOLDED, near=0.0),
    "rational": _sensor(_AZURE, limit_deg=70),
    "fisheye 180": _sensor(_fisheye(180), near=0.0, distance="range"),
    "fisheye 220": _sensor(_fisheye(220), near=5.0, distance="range"),
    "spherical 360 x 30": _sensor(_spherical(360, -15, 15), near=0.0, distance="range"),
    "spherical 360 x 180": _sensor(_spherical(360, -90, 90), near=5.0, distance="range"),
    "spherical 120 x 60": _sensor(_spherical(120, -20, 40), distance="range"),
    "pinhole by range": _sensor(_PAIR, distance="range"),
    "pair 50": _sensor(_PAIR, Partner((50, 0, 0), _PAIR)),
    "pair 200": _sensor(_PAIR, Partner((200, 0, 0), _PAIR), near=0.0),
    "projector": _sensor(
        Pinhole.from_degrees(60, 45),
        Partner(
            (-120, 10, -5),
            Pinhole.from_degrees(50, 40),
            (math.radians(14), math.radians(-4)),
            "projector",
        ),
        limit_deg=70,
    ),
    "two lenses": _sensor(
        _BARREL,
        Partner((60, -20, 10), _fisheye(180), (math.radians(-10), math.radians(5))),
        near=0.0,
        distance="range",
    ),
}


def enlarged(sensor: Sensor, times: float, near: float) -> Sensor:
    """Return the sensor for things some times as large, whose partner stays where it is."""
    return replace(
        sensor, min_distance=sensor.min_distance * near, max_distance=sensor.max_distance * times
    )
