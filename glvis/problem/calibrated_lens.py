"""Lenses as calibrations state them: focal lengths, centre and distortion in pixels."""

from __future__ import annotations

import math
from abc import abstractmethod
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Self

import numpy as np
from numpy.typing import ArrayLike, NDArray

from glvis.problem.lens import WIDEST, Lens, Windows, cube_windows, tangents_of, unit_length

Floats = NDArray[np.float64]

_BORDER = 256  # samples a side of the image's border
_AROUND = 1e-3  # share by which a window reaches over the border, for what lies between samples
_HALVINGS, _NEWTON = 60, 12  # steps of the inverse: float64 has 53 bits; quadratic from there
_ROUND_TRIP = 1e-9  # share of the image by which a pixel's ray may miss the pixel


@dataclass(frozen=True)
class CalibratedLens(Lens):
    """A lens as calibrations state it, in pixels.

    Attributes
    ----------
    size : tuple of int
        Pixels (width, height) of the image that was calibrated.
    focal_px : tuple of float
        fx and fy, pixels.
    centre_px : tuple of float
        cx and cy, pixels; centres of pixels have whole numbers, as in OpenCV.
    coefficients : tuple of float
        Of the distortion.
    max_angle : float
        Half angle of the cone about the optical axis beyond which the lens has no image.
    """

    size: tuple[int, int]
    focal_px: tuple[float, float]
    centre_px: tuple[float, float]
    coefficients: tuple[float, ...]
    max_angle: float = math.pi

    def __post_init__(self) -> None:
        if min(self.size) < 1:
            raise ValueError(f"size = {list(self.size)} must be at least [1, 1] pixels")
        if min(self.focal_px) <= 0:
            raise ValueError(f"focal_px = {list(self.focal_px)} must be above 0")
        if not all(map(math.isfinite, (*self.focal_px, *self.centre_px, *self.coefficients))):
            raise ValueError("focal_px, centre_px and distortion must be finite")
        if not 0 < self.max_angle <= math.pi:
            raise ValueError(
                f"max_angle_deg = {math.degrees(self.max_angle):g} must lie in (0, 180]"
            )

    @property
    def focal(self) -> tuple[float, float]:
        """Focal lengths along x and y at the axis: shares of the image's width and height."""
        return self.focal_px[0] / self.size[0], self.focal_px[1] / self.size[1]

    def at_size(self, size: tuple[int, int]) -> Self:
        """Return the same lens in pixels of another size: of the same image, more or fewer."""
        across, down = size[0] / self.size[0], size[1] / self.size[1]
        focal_px = (self.focal_px[0] * across, self.focal_px[1] * down)
        # corners of the image stay where they are, not the centres of its pixels
        x, y = (self.centre_px[0] + 0.5) * across - 0.5, (self.centre_px[1] + 0.5) * down - 0.5
        return replace(self, size=size, focal_px=focal_px, centre_px=(x, y))

    @abstractmethod
    def _inverse(self, x: Floats, y: Floats) -> Floats:
        """Return directions (3, n) of distorted tangents (n,), y up; NaN where there is none."""

    @property
    @abstractmethod
    def end(self) -> float:
        """Half angle at which the lens ends: its first fold, or ``max_angle``."""

    def _in_image(self, x: Floats, y: Floats) -> tuple[Floats, Floats]:
        """Return shares of the image for distorted tangents, y up."""
        u = (self.focal_px[0] * x + self.centre_px[0] + 0.5) / self.size[0]
        v = (self.centre_px[1] + 0.5 - self.focal_px[1] * y) / self.size[1]
        return u, v

    def directions(self, u: ArrayLike, v: ArrayLike) -> Floats:
        """Return unit directions (3, ...) of places in the image (...); NaN where there is none."""
        u, v = np.broadcast_arrays(np.asarray(u, dtype=float), np.asarray(v, dtype=float))
        x = (u * self.size[0] - 0.5 - self.centre_px[0]) / self.focal_px[0]
        y = (self.centre_px[1] + 0.5 - v * self.size[1]) / self.focal_px[1]
        found = self._inverse(x.ravel(), y.ravel())
        again = self.project(*found)
        off = np.maximum(np.abs(again[0] - u.ravel()), np.abs(again[1] - v.ravel()))
        found[:, ~(off <= _ROUND_TRIP)] = np.nan
        return found.reshape(3, *u.shape)

    @cached_property
    def _border(self) -> tuple[Floats, bool]:
        """Directions (3, n) of the image's border, and whether every place of it has one."""
        share = np.linspace(0, 1, _BORDER)
        zero, one = np.zeros(_BORDER), np.ones(_BORDER)
        u = np.concatenate([share, share, zero, one])
        v = np.concatenate([zero, one, share, share])
        found = self.directions(u, v)
        has = np.isfinite(found[0])
        return found[:, has], bool(has.all())

    @property
    def has_blind_corners(self) -> bool:
        """Whether some pixels have no ray: the lens ends inside its own image."""
        return not self._border[1]

    @cached_property
    def windows(self) -> Windows:
        """One pinhole that holds the image, up to 150 degrees; else faces of a cube."""
        tangents = self._widest_tangents()
        if np.arctan(tangents).max() <= WIDEST:
            return Windows(np.eye(3)[None], tangents * (1 + _AROUND))
        return cube_windows(self)

    @cached_property
    def tan_half(self) -> Floats:
        """Tangents of a pinhole that holds the image, or of its middle; see ``Lens``."""
        return np.minimum(self._widest_tangents(), math.tan(WIDEST))

    def _widest_tangents(self) -> Floats:
        """Return the largest tangents along x and y in the image, (2,); infinite beyond 90 deg."""
        found, is_whole = self._border
        with np.errstate(divide="ignore", invalid="ignore"):
            tangents = np.where(found[2] > 0, np.abs(found[:2]) / found[2], np.inf)
        widest = tangents.max(axis=1, initial=0.0)
        if not is_whole:  # there it reaches to the lens's end
            end = math.tan(self.end) if self.end < math.pi / 2 else math.inf
            widest = np.maximum(widest, end)
        return widest


@dataclass(frozen=True)
class OpenCVLens(CalibratedLens):
    """OpenCV's lens with radial and tangential distortion.

    Attributes
    ----------
    coefficients : (8,) tuple of float
        k1, k2, p1, p2, k3, k4, k5, k6 as OpenCV orders them.

    References
    ----------
    OpenCV, calib3d: x' = x (1 + k1 r^2 + k2 r^4 + k3 r^6) / (1 + k4 r^2 + k5 r^4 + k6 r^6)
    + 2 p1 x y + p2 (r^2 + 2 x^2), in its frame of x right, y down, z forward.
    """

    kind = "opencv"

    def __post_init__(self) -> None:
        super().__post_init__()
        if len(self.coefficients) not in (0, 4, 5, 8):
            raise ValueError(
                f"distortion has {len(self.coefficients)} numbers; it takes k1, k2, p1, p2, then "
                "none, k3, or k3, k4, k5, k6 (thin prisms and tilt are not known)"
            )
        filled = (*self.coefficients, *[0.0] * (8 - len(self.coefficients)))
        object.__setattr__(self, "coefficients", filled)

    @cached_property
    def fold(self) -> float:
        """Tangent at which the radial polynomial stops growing, or has its pole; may be inf."""
        k1, k2, _, _, k3, k4, k5, k6 = self.coefficients
        top, bottom = np.array([k3, k2, k1, 1.0]), np.array([k6, k5, k4, 1.0])  # in r^2
        # d/dr [r top/bottom] = 0: (top + 2 s top') bottom = 2 s top bottom', s = r^2
        s = np.array([2.0, 0.0])
        growth: Floats = np.polysub(
            np.polymul(np.polyadd(top, np.polymul(s, np.polyder(top))), bottom),
            np.polymul(np.polymul(s, top), np.polyder(bottom)),
        )
        roots = np.concatenate([np.roots(growth), np.roots(bottom)])
        real = roots.real[(np.abs(roots.imag) < 1e-12 * np.abs(roots)) & (roots.real > 0)]
        return math.sqrt(real.min()) if len(real) else math.inf

    @property
    def end(self) -> float:
        """Half angle at which the lens ends: its first fold, or ``max_angle``."""
        return min(math.atan(self.fold), self.max_angle)

    def project(self, x: ArrayLike, y: ArrayLike, depth: ArrayLike) -> tuple[Floats, Floats]:
        """Return where directions (...) fall into the image; NaN behind and beyond the fold."""
        x, y = tangents_of(x, y, depth)
        with np.errstate(invalid="ignore"):
            beyond = ~(np.hypot(x, y) < math.tan(min(self.end, math.pi / 2)))
        x, y = self._distorted(x, y)
        return self._in_image(np.where(beyond, np.nan, x), np.where(beyond, np.nan, y))

    def _radial(self, squared: Floats) -> Floats:
        k1, k2, _, _, k3, k4, k5, k6 = self.coefficients
        top = 1 + squared * (k1 + squared * (k2 + squared * k3))
        bottom = 1 + squared * (k4 + squared * (k5 + squared * k6))
        return top / bottom

    def _distorted(self, x: Floats, y: Floats) -> tuple[Floats, Floats]:
        """Return distorted tangents, y up."""
        p1, p2 = self.coefficients[2:4]
        squared = x * x + y * y
        radial = self._radial(squared)
        # OpenCV's y points down: -y in its formula
        return (
            x * radial - 2 * p1 * x * y + p2 * (squared + 2 * x * x),
            y * radial - p1 * (squared + 2 * y * y) + 2 * p2 * x * y,
        )

    def _inverse(self, x: Floats, y: Floats) -> Floats:
        """Return directions of distorted tangents: bisection of the radius, then Newton."""
        radius = np.hypot(x, y)
        end = math.tan(min(self.end, math.radians(89.9)))
        low, high = np.zeros_like(radius), np.full_like(radius, end)
        for _ in range(_HALVINGS):
            middle = (low + high) / 2
            is_short = middle * self._radial(middle * middle) < radius
            low, high = np.where(is_short, middle, low), np.where(is_short, high, middle)
        scale = np.where(radius > 0, low / np.where(radius > 0, radius, 1.0), 1.0)
        a, b = x * scale, y * scale
        step = 1e-7
        with np.errstate(all="ignore"):
            for _ in range(_NEWTON):
                fx, fy = self._distorted(a, b)
                ax, ay = self._distorted(a + step, b)
                cx, cy = self._distorted(a - step, b)
                bx, by = self._distorted(a, b + step)
                dx, dy = self._distorted(a, b - step)
                xx, yx = (ax - cx) / (2 * step), (ay - cy) / (2 * step)
                xy, yy = (bx - dx) / (2 * step), (by - dy) / (2 * step)
                det = xx * yy - xy * yx
                ex, ey = x - fx, y - fy
                a, b = a + (yy * ex - xy * ey) / det, b + (xx * ey - yx * ex) / det
        return unit_length(np.stack([a, b, np.ones_like(a)]))


@dataclass(frozen=True)
class FisheyeLens(CalibratedLens):
    """OpenCV's fisheye: the angle to the axis gives the distance from the centre.

    Attributes
    ----------
    coefficients : (4,) tuple of float
        k1 to k4.

    References
    ----------
    Kannala and Brandt, 2006; OpenCV, calib3d::fisheye: theta_d = theta (1 + k1 theta^2 +
    k2 theta^4 + k3 theta^6 + k4 theta^8).
    """

    kind = "fisheye"

    def __post_init__(self) -> None:
        super().__post_init__()
        if len(self.coefficients) not in (0, 4):
            raise ValueError(
                f"distortion has {len(self.coefficients)} numbers; a fisheye takes k1, k2, k3, k4"
            )
        filled = (*self.coefficients, *[0.0] * (4 - len(self.coefficients)))
        object.__setattr__(self, "coefficients", filled)

    @cached_property
    def fold(self) -> float:
        """Angle at which the polynomial stops growing; may be infinite."""
        k1, k2, k3, k4 = self.coefficients
        roots = np.roots([9 * k4, 7 * k3, 5 * k2, 3 * k1, 1.0])  # in theta^2
        real = roots.real[(np.abs(roots.imag) < 1e-12 * np.abs(roots)) & (roots.real > 0)]
        return math.sqrt(real.min()) if len(real) else math.inf

    @property
    def end(self) -> float:
        """Half angle at which the lens ends: its first fold, or ``max_angle``."""
        return min(self.fold, self.max_angle)

    def _radius(self, theta: Floats) -> Floats:
        k1, k2, k3, k4 = self.coefficients
        s = theta * theta
        return theta * (1 + s * (k1 + s * (k2 + s * (k3 + s * k4))))

    def project(self, x: ArrayLike, y: ArrayLike, depth: ArrayLike) -> tuple[Floats, Floats]:
        """Return where directions (...) fall into the image; NaN beyond the fold."""
        x, y, depth = (np.asarray(one, dtype=float) for one in (x, y, depth))
        aside = np.hypot(x, y)
        theta = np.arctan2(aside, depth)
        with np.errstate(invalid="ignore", divide="ignore"):
            scale = np.where(aside > 0, self._radius(theta) / aside, 0.0)
        # straight behind there is no one place; OpenCV takes theta just below its fold, too
        scale = np.where((theta < self.end) & (theta < math.pi), scale, np.nan)
        return self._in_image(x * scale, y * scale)

    def _inverse(self, x: Floats, y: Floats) -> Floats:
        """Return directions of distorted tangents, by bisection of the angle."""
        radius = np.hypot(x, y)
        low, high = np.zeros_like(radius), np.full_like(radius, min(self.end, math.pi))
        for _ in range(_HALVINGS):
            middle = (low + high) / 2
            is_short = self._radius(middle) < radius
            low, high = np.where(is_short, middle, low), np.where(is_short, high, middle)
        scale = np.sin(low) / np.where(radius > 0, radius, 1.0)
        return np.stack([x * scale, y * scale, np.cos(low)])
