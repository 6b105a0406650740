"""How good a view is: pixel size, pixel density, depth error and blur of faces seen by sensors.

Numbers of a face's centre, its normal, a pose and a sensor: nothing is looked up in a mesh or
drawn. Whether a face is seen at all is another question; numbers are told of any face before the
sensor. NaN stands where a number does not exist; see method.md, section 9.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from glvis.problem.calibrated_lens import OpenCVLens
from glvis.problem.lens import Pinhole
from glvis.problem.sensor import Focus, Sensor
from glvis.problem.units import MM_PER_UNIT
from glvis.visibility.filters import in_camera_frame

Floats = NDArray[np.float64]
Bools = NDArray[np.bool_]
Integers = NDArray[np.int64]

NAMES = ("pixel_size", "density", "depth_error", "blur")
LARGEST_IS_BEST = ("density",)

# Lenses with an image plane, so that a wall square to the axis is the same size everywhere in it.
_FLAT = (Pinhole, OpenCVLens)


@dataclass(frozen=True, eq=False)
class ViewQuality:
    """How well sensors see n faces; fields are (n,) of one sensor or (S, n) of several.

    Attributes
    ----------
    pixel_size : (..., n) float64
        Square root of the area of the surface that one pixel covers: length a pixel, study's unit.
    density : (..., n) float64
        Pixels a unit of length, without incidence (EN 62676-4): of a pinhole f / z on a plane
        square to the axis, the same for OpenCV's lens by its local pixels; of a fisheye and a
        spherical lens, which have no such plane, the local pixels a radian over the distance.
    depth_error : (..., n) float64
        1 sigma along the axis, study's unit; NaN where the sensor states no noise.
    blur : (..., n) float64
        Diameter of the circle that a point becomes, pixels; NaN where it states no focus.
    """

    pixel_size: Floats
    density: Floats
    depth_error: Floats
    blur: Floats

    def of(self, name: str) -> Floats:
        """Return one of ``NAMES``."""
        found: Floats = getattr(self, name)
        return found

    def best(self, name: str, visible: ArrayLike) -> tuple[Floats, Integers]:
        """Return the best of a number over the sensors that see a face, and which one.

        Parameters
        ----------
        name : str
            One of ``NAMES``; the largest density is best, and the smallest of all else.
        visible : (S, n) bool
            Which sensor sees which face.

        Returns
        -------
        value : (n,) float64
            NaN where no sensor that sees the face has one.
        sensor : (n,) int64
            Index, -1 where none.
        """
        sign = -1.0 if name in LARGEST_IS_BEST else 1.0
        values = np.where(visible, sign * self.of(name), np.nan)
        ranked = np.where(np.isnan(values), np.inf, values)
        which = np.argmin(ranked, axis=0)
        found = np.take_along_axis(ranked, which[None], axis=0)[0]
        known = np.isfinite(found)
        return np.where(known, sign * found, np.nan), np.where(known, which, -1)


def view_quality(
    points: ArrayLike, normals: ArrayLike, camera_to_world: Floats, sensor: Sensor
) -> ViewQuality:
    """Return how well a sensor sees faces.

    Parameters
    ----------
    points : (n, 3) float
        Centres, world frame, study's unit.
    normals : (n, 3) float
        Unit normals, outwards.
    camera_to_world : (4, 4) float64
        Pose of the sensor.
    sensor : Sensor
        Its lens, resolution, noise and focus.

    Returns
    -------
    ViewQuality
        Of (n,); NaN where a face looks away or the lens has no image of it.
    """
    x, y, depth = in_camera_frame(np.asarray(points, dtype=float).T, camera_to_world)
    across, up, back = camera_to_world[:3, :3].T @ np.asarray(normals, dtype=float).T
    distance = np.sqrt(x * x + y * y + depth * depth)
    over = 1 / np.where(distance > 0, distance, np.nan)
    incidence = (back * depth - across * x - up * y) * over  # cosines: to the ray, off the axis
    incidence = np.where(incidence > 0, incidence, np.nan)
    off_axis = depth * over
    width, height = sensor.resolution
    ahead = np.where(distance > 0, depth, 1.0)  # of what lies in the optical centre: any direction
    pixels = width * height * sensor.lens.image_a_steradian(x, y, ahead)  # a steradian
    pixels = np.where((pixels > 0) & np.isfinite(incidence), pixels, np.nan)
    if isinstance(sensor.lens, _FLAT):
        density = over * np.sqrt(np.where(off_axis > 0, pixels * off_axis, np.nan))
    else:
        density = over * np.sqrt(pixels)
    before = np.where(np.isfinite(pixels), depth, np.nan)
    measured = np.where(np.isfinite(pixels), distance, np.nan)
    error = _depth_error(before, measured, incidence, sensor)
    return ViewQuality(
        pixel_size=1 / (over * np.sqrt(pixels * incidence)),
        density=density,
        depth_error=error,
        blur=_blur(before, sensor.focus),
    )


def quality_of_views(
    points: ArrayLike,
    normals: ArrayLike,
    camera_to_world: Floats,
    sensors: Sequence[Sensor],
) -> ViewQuality:
    """Return how well each of S sensors at poses (S, 4, 4) sees faces, (S, n); see above."""
    views = [
        view_quality(points, normals, pose, sensor)
        for pose, sensor in zip(camera_to_world, sensors, strict=True)
    ]
    shape = (len(views), len(np.asarray(points)))
    return ViewQuality(*(np.array([v.of(name) for v in views]).reshape(shape) for name in NAMES))


def a_metre(density: Floats, unit: str) -> Floats:
    """Return pixels a metre of pixels a unit of length."""
    return density * (MM_PER_UNIT["m"] / MM_PER_UNIT.get(unit, 1.0))


def is_known(name: str, sensors: Sequence[Sensor]) -> bool:
    """Return whether any of the sensors states what one of ``NAMES`` follows from."""
    if name == "depth_error":
        return any(sensor.noise for sensor in sensors)
    return name != "blur" or any(sensor.focus for sensor in sensors)


def focal_along_baseline(sensor: Sensor) -> float:
    """Return the focal length along the image direction of the partner's offset, pixels.

    fx for a partner beside, fy for one above; NaN for one straight ahead or behind.
    """
    assert sensor.partner
    right, above, _ = sensor.partner.offset
    aside = float(np.hypot(right, above))
    fx, fy = sensor.focal_pixels()
    return float(np.hypot(fx * right, fy * above)) / aside if aside else np.nan


def _depth_error(depth: Floats, distance: Floats, incidence: Floats, sensor: Sensor) -> Floats:
    """Return 1 sigma of faces at some depth and distance, at cosines of their incidence, (n,)."""
    noise = sensor.noise
    if noise is None:
        return np.full_like(depth, np.nan)
    if noise.subpixel is not None and sensor.partner is not None:
        parallax = focal_along_baseline(sensor) * sensor.partner.baseline
        error = np.where(depth > 0, depth, np.nan) ** 2 * noise.subpixel / parallax
    else:
        # z is what the sensor's own distances measure: a lidar's data sheet tells of ranges
        along = distance if sensor.distance == "range" else np.where(depth > 0, depth, np.nan)
        error = np.asarray(np.polynomial.polynomial.polyval(along, noise.polynomial), np.float64)
        error = np.where(error >= 0, error, np.nan)  # a polynomial beyond what it was fitted to
    return error / incidence if noise.by_incidence else error


def _blur(depth: Floats, focus: Focus | None) -> Floats:
    """Return the diameter of the circle of confusion of points at some depth, pixels, (n,)."""
    if focus is None:
        return np.full_like(depth, np.nan)
    z = np.where(depth > 0, depth, np.nan)
    length, sharp = focus.focal_length, focus.distance
    circle = length**2 * np.abs(z - sharp) / (focus.f_number * z * (sharp - length))
    found: Floats = circle / focus.pixel_pitch
    return found
