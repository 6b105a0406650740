"""Lenses in pixels, as calibrations that other tools read: focal lengths, centre, distortion.

Pixels are counted from the upper left corner of the image, as COLMAP does: the middle of the
first one is (0.5, 0.5), and a centre is OpenCV's plus 0.5.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from glvis.problem.calibrated_lens import CalibratedLens, FisheyeLens
from glvis.problem.lens import Lens, Pinhole
from glvis.problem.sensor import Sensor

_COEFFICIENTS = {"PINHOLE": 0, "OPENCV": 4, "OPENCV_FISHEYE": 4, "FULL_OPENCV": 8}
HALF = 0.5  # of a pixel, from OpenCV's centre to COLMAP's


@dataclass(frozen=True)
class Calibration:
    """A lens in pixels of an image.

    Attributes
    ----------
    model : str
        COLMAP's word: PINHOLE, OPENCV, FULL_OPENCV or OPENCV_FISHEYE.
    size : tuple of int
        Pixels (width, height).
    focal : tuple of float
        fx and fy.
    centre : tuple of float
        cx and cy, from the corner of the image.
    coefficients : tuple of float
        Those of the model, none of PINHOLE; OpenCV orders them so, too.
    """

    model: str
    size: tuple[int, int]
    focal: tuple[float, float]
    centre: tuple[float, float]
    coefficients: tuple[float, ...] = ()

    @property
    def params(self) -> list[float]:
        """Focal lengths, centre and coefficients, as COLMAP lists them."""
        return [*self.focal, *self.centre, *self.coefficients]


def calibration(lens: Lens, size: tuple[int, int]) -> Calibration | None:
    """Return a lens in pixels of an image (width, height); None where it has no focal length."""
    width, height = size
    if isinstance(lens, Pinhole):
        across, up = lens.focal
        return Calibration("PINHOLE", size, (width * across, height * up), (width / 2, height / 2))
    if not isinstance(lens, CalibratedLens):
        return None
    scale = width / lens.size[0], height / lens.size[1]
    fx, fy = (f * k for f, k in zip(lens.focal_px, scale, strict=True))
    cx, cy = ((c + HALF) * k for c, k in zip(lens.centre_px, scale, strict=True))
    model = _model(lens)
    return Calibration(model, size, (fx, fy), (cx, cy), lens.coefficients[: _COEFFICIENTS[model]])


def partner_size(sensor: Sensor) -> tuple[int, int]:
    """Return the pixels (width, height) of a second viewpoint: those of its calibration, if any."""
    if sensor.partner and isinstance(sensor.partner.lens, CalibratedLens):
        return sensor.partner.lens.size
    return sensor.resolution


def unknown_elsewhere(sensors: Sequence[Sensor]) -> list[str]:
    """Return in a sentence which sensors COLMAP and ROS have no camera model for, if any."""
    names: dict[str, None] = {}
    for sensor in sensors:
        lenses = [sensor.lens, *([sensor.partner.lens] if sensor.partner else [])]
        if any(calibration(lens, sensor.resolution) is None for lens in lenses):
            names[f"'{sensor.name}'"] = None
    if not names:
        return []
    where = "colmap/ and ros/camera_info/ have no camera model for a spherical lens"
    return [f"exports: {where}, so {', '.join(names)} is not in them; it is in all else"]


def _model(lens: CalibratedLens) -> str:
    """Return the plainest model of COLMAP that holds a lens."""
    if isinstance(lens, FisheyeLens):
        return "OPENCV_FISHEYE"
    if any(lens.coefficients[4:]):
        return "FULL_OPENCV"
    return "OPENCV" if any(lens.coefficients) else "PINHOLE"
