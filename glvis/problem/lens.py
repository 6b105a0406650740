"""Lenses: which directions of the camera frame fall into the image, and where.

Whether something hides a point from an optical centre does not depend on the lens; the boundary of
the image and the size of a pixel do. Directions are given as x right, y up and depth along the
optical axis, of any length. Places in the image are shares of its width and height, from the left
and from the top, so that a lens holds at any resolution. Angles are radians.
"""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import ArrayLike, NDArray

Floats = NDArray[np.float64]
Bools = NDArray[np.bool_]

# The widest half angle that one window shows: beyond it the size of a pinhole image, which goes
# with the tangent, runs away.
WIDEST = math.radians(75)
_SECTOR = math.radians(90)  # of azimuth, at most, that one window of a spherical lens holds
_STEEPEST = math.radians(60)  # elevation up to which sectors do; beyond, a cube
_OVERLAP = 1e-5  # share by which windows reach over what they hold, and so over each other
_ON_CUBE = 65  # samples a side of a cube's face, to find the faces that an image needs
_STEP = 1e-5  # radians, of central differences: their error is its square


@dataclass(frozen=True, eq=False)
class Windows:
    """Pinhole images about one optical centre that hold all of a lens's image together, K of them.

    Attributes
    ----------
    window_to_camera : (K, 3, 3) float64
        Rotations, in frames of right, up and back.
    tan_half : (2,) float64
        Tangents of the half opening angles, of all alike.
    """

    window_to_camera: Floats
    tan_half: Floats

    def __len__(self) -> int:
        return len(self.window_to_camera)

    @property
    def is_straight(self) -> bool:
        """Whether there is but one, along the optical axis."""
        return len(self) == 1 and bool((self.window_to_camera[0] == np.eye(3)).all())

    def places(
        self, x: ArrayLike, y: ArrayLike, depth: ArrayLike
    ) -> tuple[NDArray[np.intp], Floats, Floats]:
        """Return in which window directions (...) lie, and where in it.

        Returns
        -------
        window : (...) int
            The one whose middle is nearest; -1 where there is none.
        u, v : (...) float64
            Shares of its width and height, from the left and from the top.
        """
        along = np.stack(np.broadcast_arrays(x, y, np.negative(depth)))
        tan_x, tan_y = self.tan_half.tolist()
        window = np.full(along.shape[1:], -1, dtype=np.intp)
        best = np.full(along.shape[1:], np.inf)
        u, v = np.zeros((2, *along.shape[1:]))
        for number, turn in enumerate(self.window_to_camera):
            right, up, back = np.tensordot(turn.T, along, axes=1)
            with np.errstate(divide="ignore", invalid="ignore"):
                a, b = right / -back / tan_x, up / -back / tan_y
                off_axis = np.maximum(np.abs(a), np.abs(b))
                nearer = (back < 0) & (off_axis <= 1) & (off_axis < best)
            window[nearer], best[nearer] = number, off_axis[nearer]
            u[nearer], v[nearer] = (1 + a[nearer]) / 2, (1 - b[nearer]) / 2
        return window, u, v


class Lens(ABC):
    """What an optical centre sees of the directions about it, and onto which pixel."""

    @abstractmethod
    def project(self, x: ArrayLike, y: ArrayLike, depth: ArrayLike) -> tuple[Floats, Floats]:
        """Return where directions (...) fall into the image: shares of its width and height.

        From the left and from the top; NaN where the lens has no image of a direction. Between 0
        and 1 lies what is in the image.
        """

    @abstractmethod
    def directions(self, u: ArrayLike, v: ArrayLike) -> Floats:
        """Return unit directions (3, ...) of places in the image (...): x right, y up, depth.

        The inverse of ``project``; NaN where nothing falls onto a place.
        """

    @property
    @abstractmethod
    def windows(self) -> Windows:
        """The pinhole images that hold the image."""

    @property
    @abstractmethod
    def tan_half(self) -> Floats:
        """Tangents of the half angles of the pinhole that pictures of the view are drawn by, (2,).

        It holds the image, or its middle where the field is wider than 150 degrees.
        """

    kind = ""  # as studies call it

    @property
    @abstractmethod
    def focal(self) -> tuple[float, float]:
        """Focal lengths along x and y at the axis: shares of the image's width and height."""

    @property
    def opening(self) -> tuple[float, float]:
        """Full opening angles along the middle row and the middle column."""
        ends = np.array([0, 1, 0.5, 0.5]), np.array([0.5, 0.5, 0, 1])
        left, right, top, bottom = self._reached(*ends).T
        across = math.atan2(right[0], right[2]) - math.atan2(left[0], left[2])
        up = math.atan2(top[1], top[2]) - math.atan2(bottom[1], bottom[2])
        return across, up

    def contains(self, x: ArrayLike, y: ArrayLike, depth: ArrayLike) -> Bools:
        """Return which directions (...) fall into the image."""
        u, v = self.project(x, y, depth)
        with np.errstate(invalid="ignore"):
            inside: Bools = (u >= 0) & (u <= 1) & (v >= 0) & (v <= 1)
        return inside

    def image_a_steradian(self, x: ArrayLike, y: ArrayLike, depth: ArrayLike) -> Floats:
        """Return the share of the image that a steradian takes at directions (...).

        Times the pixels of the image, these are pixels a steradian: |d pixels / d solid angle|.
        """
        along = np.stack(np.broadcast_arrays(x, y, depth)).astype(float)
        along /= np.linalg.norm(along, axis=0)
        # two directions at right angles to it, from the world axis that it is least along
        other = np.zeros_like(along)
        np.put_along_axis(other, np.argmin(np.abs(along), axis=0)[None], 1.0, axis=0)
        first = np.cross(along, other, axis=0)
        first /= np.linalg.norm(first, axis=0)
        second = np.cross(along, first, axis=0)
        slopes = []
        for tangent in (first, second):
            ahead = self.project(*(along + _STEP * tangent))
            behind = self.project(*(along - _STEP * tangent))
            slopes.append([(a - b) / (2 * _STEP) for a, b in zip(ahead, behind, strict=True)])
        (ux, vx), (uy, vy) = slopes
        return np.abs(ux * vy - uy * vx)

    def outline(self, n: int = 32) -> Floats:
        """Return unit directions around the image's border, n a side from the top left, (4 n, 3).

        Places without a ray give way to the last one before them towards the middle.
        """
        share = np.arange(n) / n
        u = np.concatenate([share, np.ones(n), 1 - share, np.zeros(n)])
        v = np.concatenate([np.zeros(n), share, np.ones(n), 1 - share])
        return np.ascontiguousarray(self._reached(u, v).T)

    def _reached(self, u: Floats, v: Floats) -> Floats:
        """Return unit directions (3, n) of places (n,), or of the last before them with a ray."""
        low, high = np.zeros_like(u), np.ones_like(u)
        has_ray = np.isfinite(self.directions(u, v)[0])
        for _ in range(0 if has_ray.all() else 30):  # a billionth of the way
            middle = (low + high) / 2
            found = np.isfinite(self.directions(*_towards_middle(u, v, middle))[0])
            low, high = np.where(found, middle, low), np.where(found, high, middle)
        return self.directions(*_towards_middle(u, v, np.where(has_ray, 1.0, low)))

    @property
    def has_blind_corners(self) -> bool:
        """Whether some pixels have no ray: the lens ends inside its own image."""
        return False


def _towards_middle(u: Floats, v: Floats, share: Floats) -> tuple[Floats, Floats]:
    """Return places between the image's middle and others, at a share of the way."""
    return 0.5 + share * (u - 0.5), 0.5 + share * (v - 0.5)


@dataclass(frozen=True)
class Pinhole(Lens):
    """An ideal pinhole, its image centred on the optical axis.

    Attributes
    ----------
    hfov, vfov : float
        Full opening angles along the image's x and y, each in (0, pi).
    """

    hfov: float
    vfov: float
    kind = "pinhole"

    def __post_init__(self) -> None:
        for name, value in (("hfov", self.hfov), ("vfov", self.vfov)):
            if not 0 < value < math.pi:
                raise ValueError(f"{name} = {math.degrees(value):g} deg must lie in (0, 180)")

    @classmethod
    def from_degrees(cls, hfov_deg: float, vfov_deg: float) -> Pinhole:
        """Return the pinhole of opening angles in degrees."""
        return cls(math.radians(hfov_deg), math.radians(vfov_deg))

    @classmethod
    def from_tangents(cls, tan_x: float, tan_y: float) -> Pinhole:
        """Return the pinhole of tangents of the half opening angles."""
        return cls(2 * math.atan(tan_x), 2 * math.atan(tan_y))

    @cached_property
    def tan_half(self) -> Floats:
        """Tangents of the half angles along x and y, (2,) float64, read-only."""
        tan_half = np.tan([self.hfov / 2, self.vfov / 2])
        tan_half.flags.writeable = False
        return tan_half

    @property
    def opening(self) -> tuple[float, float]:
        """Full opening angles along x and y."""
        return self.hfov, self.vfov

    @property
    def focal(self) -> tuple[float, float]:
        """Focal lengths along x and y: shares of the image's width and height."""
        tan_x, tan_y = self.tan_half.tolist()
        return 1 / (2 * tan_x), 1 / (2 * tan_y)

    @cached_property
    def windows(self) -> Windows:
        """The image itself."""
        return Windows(np.eye(3)[None], self.tan_half)

    def contains(self, x: ArrayLike, y: ArrayLike, depth: ArrayLike) -> Bools:
        """Return which directions (...) fall into the image, by products alone."""
        tan_x, tan_y = self.tan_half.tolist()
        x, y, depth = np.asarray(x), np.asarray(y), np.asarray(depth)
        inside: Bools = np.abs(x) <= tan_x * depth  # never behind, where the depth is negative
        inside &= np.abs(y) <= tan_y * depth
        return inside

    def project(self, x: ArrayLike, y: ArrayLike, depth: ArrayLike) -> tuple[Floats, Floats]:
        """Return where directions (...) fall into the image; NaN of what is behind."""
        x, y = tangents_of(x, y, depth)
        tan_x, tan_y = self.tan_half.tolist()
        return 0.5 + x / (2 * tan_x), 0.5 - y / (2 * tan_y)

    def directions(self, u: ArrayLike, v: ArrayLike) -> Floats:
        """Return unit directions (3, ...) of places in the image (...)."""
        tan_x, tan_y = self.tan_half.tolist()
        x, y = 2 * np.asarray(u, dtype=float) - 1, 1 - 2 * np.asarray(v, dtype=float)
        return unit_length(np.stack(np.broadcast_arrays(tan_x * x, tan_y * y, 1.0)))

    def image_a_steradian(self, x: ArrayLike, y: ArrayLike, depth: ArrayLike) -> Floats:
        """Return the share of the image that a steradian takes, fx fy / cos^3 off the axis."""
        x, y = tangents_of(x, y, depth)
        of_axis = self.focal[0] * self.focal[1]
        return of_axis * (1 + x * x + y * y) ** 1.5


@dataclass(frozen=True)
class SphericalLens(Lens):
    """Azimuth and elevation as columns and rows: a spinning lidar, or a 360 degree camera.

    Attributes
    ----------
    azimuth : float
        Range about the optical axis, radians, up to 2 pi.
    elevation : tuple of float
        Lowest and highest angle from the plane normal to the camera's y axis, radians.
    """

    azimuth: float
    elevation: tuple[float, float]
    kind = "spherical"

    def __post_init__(self) -> None:
        low, high = self.elevation
        if not 0 < self.azimuth <= 2 * math.pi:
            raise ValueError(f"azimuth_deg = {math.degrees(self.azimuth):g} must lie in (0, 360]")
        if not -math.pi / 2 <= low < high <= math.pi / 2:
            raise ValueError(
                f"elevation_deg = [{math.degrees(low):g}, {math.degrees(high):g}] must rise and "
                "lie in [-90, 90]"
            )

    @property
    def opening(self) -> tuple[float, float]:
        """Range of azimuth, and of elevation."""
        return self.azimuth, self.elevation[1] - self.elevation[0]

    @property
    def focal(self) -> tuple[float, float]:
        """Shares of the image's width and height that a radian takes."""
        return 1 / self.azimuth, 1 / (self.elevation[1] - self.elevation[0])

    def project(self, x: ArrayLike, y: ArrayLike, depth: ArrayLike) -> tuple[Floats, Floats]:
        """Return where directions (...) fall into the image; every one has a place."""
        low, high = self.elevation
        x, y, depth = (np.asarray(one, dtype=float) for one in (x, y, depth))
        u = 0.5 + np.arctan2(x, depth) / self.azimuth
        v = (high - np.arctan2(y, np.hypot(x, depth))) / (high - low)
        return u, v

    def directions(self, u: ArrayLike, v: ArrayLike) -> Floats:
        """Return unit directions (3, ...) of places in the image (...)."""
        low, high = self.elevation
        azimuth = (np.asarray(u, dtype=float) - 0.5) * self.azimuth
        elevation = high - np.asarray(v, dtype=float) * (high - low)
        azimuth, elevation = np.broadcast_arrays(azimuth, elevation)
        level = np.cos(elevation)
        return np.stack([np.sin(azimuth) * level, np.sin(elevation), np.cos(azimuth) * level])

    def image_a_steradian(self, x: ArrayLike, y: ArrayLike, depth: ArrayLike) -> Floats:
        """Return the share of the image that a steradian takes: rows crowd towards the poles."""
        x, y, depth = (np.asarray(one, dtype=float) for one in (x, y, depth))
        level = np.hypot(x, depth)
        level = level / np.where(level > 0, np.hypot(level, y), np.nan)  # cosine of the elevation
        across, up = self.focal
        return across * up / level

    @cached_property
    def windows(self) -> Windows:
        """Sectors of azimuth, or a cube where the elevation is steep."""
        steepest = max(map(abs, self.elevation))
        if steepest > _STEEPEST:
            return cube_windows(self)
        n = math.ceil(self.azimuth / _SECTOR - 1e-9)
        half = self.azimuth / n / 2
        turns = (2 * np.arange(n) + 1) * half - self.azimuth / 2  # to the right
        rotation = np.zeros((n, 3, 3))
        rotation[:, 0, 0] = rotation[:, 2, 2] = np.cos(turns)
        rotation[:, 0, 2], rotation[:, 2, 0] = -np.sin(turns), np.sin(turns)
        rotation[:, 1, 1] = 1.0
        tangents = np.array([math.tan(half), math.tan(steepest) / math.cos(half)])
        return Windows(rotation, tangents * (1 + _OVERLAP))

    @cached_property
    def tan_half(self) -> Floats:
        """Tangents of a pinhole that holds the image, or of its middle; see ``Lens``."""
        half = min(self.azimuth / 2, WIDEST)
        steepest = min(max(map(abs, self.elevation)), WIDEST)
        tangent = min(math.tan(steepest) / math.cos(half), math.tan(WIDEST))
        return np.array([math.tan(half), tangent])


def tangents_of(x: ArrayLike, y: ArrayLike, depth: ArrayLike) -> tuple[Floats, Floats]:
    """Return x and y of directions at depth 1; NaN of what is not before the camera."""
    depth = np.asarray(depth, dtype=float)
    with np.errstate(divide="ignore", invalid="ignore"):
        over = np.where(depth > 0, 1 / depth, np.nan)
    return np.asarray(x) * over, np.asarray(y) * over


def unit_length(directions: Floats) -> Floats:
    """Return directions (3, ...) at length 1."""
    unit: Floats = directions / np.linalg.norm(directions, axis=0)
    return unit


def cube_windows(lens: Lens) -> Windows:
    """Return the faces of a cube about the camera that a lens's image needs."""
    x, y, z = np.eye(3)
    # columns: right, up and back of each
    faces = np.stack(
        [
            np.stack(axes, axis=1)
            for axes in (
                (x, y, z), (z, y, -x), (-z, y, x), (x, z, -y), (x, -z, y), (-x, y, -z)
            )
        ]
    )  # fmt: skip
    across, up = np.meshgrid(*[np.linspace(-1, 1, _ON_CUBE)] * 2)
    on_face = np.stack([across.ravel(), up.ravel(), np.full(across.size, -1.0)])
    # the image asks for faces, too: a corner of it may lie between the samples of a face
    places = np.linspace(0, 1, _ON_CUBE)
    x, y, depth = lens.directions(*np.meshgrid(places, places)).reshape(3, -1)
    needed = []
    for face in faces:
        right, above, back = face @ on_face
        aside, over, behind = face.T @ [x, y, -depth]
        is_here = np.maximum(np.abs(aside), np.abs(over)) <= -behind
        if is_here.any() or lens.contains(right, above, -back).any():
            needed.append(face)
    tangents = np.full(2, 1 + _OVERLAP)
    return Windows(np.stack(needed), tangents)
