"""The judge of maps by any lens and by two viewpoints: rays in float64 to points of faces.

As ``judge.py`` it is plain NumPy and imports nothing of glvis: the formulas of the lenses stand
here once more, in OpenCV's words, and a lens's end is found by a walk outwards where the product
solves a polynomial. A point is seen by a viewpoint when it is in the image of its lens, within the
incidence limit and hidden by nothing; by a sensor with a partner when both see it, and within the
working range of the first. What counts as hidden, and what rounding leaves open, is as in
``judge.py``; a point is open as well where the border of an image is nearer than rounding.

Frames are of right, up and back. Names: F faces, T triangles that hide, R rays.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from support.judge import (
    DEEPEST,
    NEAREST,
    Fan,
    Hiding,
    Judge,
    Verdict,
    has_area,
    roundings,
)
from support.oracle import Eye, part_centroids

_SHARE = 1e-6  # of the distance: rounding of directions and depths
_LENS = 4.0  # times that: a lens's polynomial in float32 loses some digits more
# What is nearer than NEAREST of the reach may hide or not, by depth along any of a lens's pinhole
# images; they reach to 75 degrees along x and y, where a range is this many depths.
_ASLANT = math.hypot(1, math.tan(math.radians(75)), math.tan(math.radians(75)))
_LEAST = 0.01  # share of NEAREST before which surely nothing hides
_SCAN = 20_000  # steps of the walk to a lens's end
_ALL_AROUND = 360 - 1e-9  # degrees of azimuth from which on there is no border

# right, up and back of frames that look along the six axes, as columns
_SIX = [
    np.stack(axes, axis=1)
    for x, y, z in [np.eye(3)]
    for axes in ((x, y, z), (-x, y, -z), (z, y, -x), (-z, y, x), (x, z, -y), (x, -z, y))
]


@dataclass(frozen=True)
class LensEye:
    """A lens in plain numbers: ``kind`` and what it has of pixels and degrees.

    Pinholes have ``opening`` (across, up), spheres ``azimuth`` and ``elevation`` (low, high), the
    others a ``size`` in pixels, ``focal``, ``centre`` (of whole numbers at the middles of pixels),
    ``k`` (k1, k2, p1, p2, k3, k4, k5, k6 of "opencv", k1 to k4 of "fisheye") and ``cone``, the
    half angle that bounds the field.
    """

    kind: str
    opening: tuple[float, float] = (90.0, 90.0)
    azimuth: float = 360.0
    elevation: tuple[float, float] = (-90.0, 90.0)
    size: tuple[int, int] = (1, 1)
    focal: tuple[float, float] = (1.0, 1.0)
    centre: tuple[float, float] = (0.0, 0.0)
    k: tuple[float, ...] = ()
    cone: float = 180.0

    @classmethod
    def of(cls, lens) -> LensEye:
        """Read a ``glvis`` lens by its attributes."""
        if lens.kind == "pinhole":
            return cls("pinhole", opening=(math.degrees(lens.hfov), math.degrees(lens.vfov)))
        if lens.kind == "spherical":
            low, high = map(math.degrees, lens.elevation)
            return cls("spherical", azimuth=math.degrees(lens.azimuth), elevation=(low, high))
        return cls(
            lens.kind,
            size=lens.size,
            focal=lens.focal_px,
            centre=lens.centre_px,
            k=tuple(lens.coefficients),
            cone=math.degrees(lens.max_angle),
        )

    @cached_property
    def end(self) -> float:
        """Angle to the axis, radians, at which the image stops moving outwards, or the cone."""
        most = math.radians(self.cone)
        if self.kind not in ("opencv", "fisheye"):
            return most
        if self.kind == "opencv":
            most = min(most, math.radians(89.99))
        angles = np.linspace(0, most, _SCAN)
        turns = np.flatnonzero(~self._grows(angles))
        if not len(turns):
            return most
        low, high = angles[turns[0] - 1], angles[turns[0]]
        for _ in range(60):
            middle = (low + high) / 2
            low, high = (middle, high) if self._grows(middle) else (low, middle)
        return float(low)

    def _grows(self, angle):
        """Return whether the distance from the centre grows with the angle to the axis."""
        if self.kind == "fisheye":
            k1, k2, k3, k4 = self.k
            slope = 1 + sum(
                (2 * n + 1) * k * angle ** (2 * n) for n, k in enumerate((k1, k2, k3, k4), 1)
            )
            return slope > 0
        r = np.tan(angle)
        k1, k2, _, _, k3, k4, k5, k6 = self.k
        top = 1 + k1 * r**2 + k2 * r**4 + k3 * r**6
        bottom = 1 + k4 * r**2 + k5 * r**4 + k6 * r**6
        of_top = 1 + 3 * k1 * r**2 + 5 * k2 * r**4 + 7 * k3 * r**6  # of r top
        of_bottom = 2 * k4 * r + 4 * k5 * r**3 + 6 * k6 * r**5
        return (of_top * bottom > r * top * of_bottom) & (bottom > 0)

    def project(self, points: np.ndarray) -> np.ndarray:
        """Return where points (R, 3) fall: pixels (R, 2), or shares of the image where it has none.

        Whole pixels are their middles, OpenCV's; shares are from the left and from the top. NaN
        where the lens has no image.
        """
        x, y, z = points[:, 0], -points[:, 1], -points[:, 2]  # OpenCV's: right, down, forward
        if self.kind == "spherical":
            low, high = self.elevation
            across = np.degrees(np.arctan2(x, z)) / self.azimuth + 0.5
            up = np.degrees(np.arctan2(-y, np.sqrt(x * x + z * z)))
            return np.stack([across, (high - up) / (high - low)], axis=1)
        angle = np.arctan2(np.sqrt(x * x + y * y), z)
        has_image = angle < self.end
        if self.kind == "fisheye":
            k1, k2, k3, k4 = self.k
            aside = np.sqrt(x * x + y * y)
            distorted = angle * (1 + k1 * angle**2 + k2 * angle**4 + k3 * angle**6 + k4 * angle**8)
            scale = distorted / np.where(aside > 0, aside, 1)
            plane = np.stack([x * scale, y * scale], axis=1)
        else:
            has_image &= z > 0
            x, y = (np.where(has_image, one / np.where(has_image, z, 1), 0) for one in (x, y))
            plane = np.stack([x, y], axis=1)
            if self.kind == "opencv":
                k1, k2, p1, p2, k3, k4, k5, k6 = self.k
                r2 = x**2 + y**2
                radial = 1 + k1 * r2 + k2 * r2**2 + k3 * r2**3
                radial /= 1 + k4 * r2 + k5 * r2**2 + k6 * r2**3
                plane = np.stack(
                    [
                        x * radial + 2 * p1 * x * y + p2 * (r2 + 2 * x**2),
                        y * radial + p1 * (r2 + 2 * y**2) + 2 * p2 * x * y,
                    ],
                    axis=1,
                )
        if self.kind == "pinhole":
            plane = 0.5 + plane / (2 * np.tan(np.radians(self.opening) / 2))
        else:
            plane = plane * self.focal + self.centre
        plane[~has_image] = np.nan
        return plane

    def holds(self, points: np.ndarray) -> np.ndarray:
        """Return which points (R, 3) are strictly inside the image."""
        place = self.project(points)
        low, high = np.zeros(2), np.ones(2)
        if self.kind in ("opencv", "fisheye"):
            low, high = low - 0.5, np.array(self.size) - 0.5
        if self.kind == "spherical":  # a full turn has no border, nor has a pole
            around = self.azimuth > _ALL_AROUND
            low = low - np.array([around, self.elevation[1] > 90 - 1e-9])
            high = high + np.array([around, self.elevation[0] < -90 + 1e-9])
        with np.errstate(invalid="ignore"):
            return ((place > low) & (place < high)).all(axis=1)

    def margin(self, points: np.ndarray, rounding: np.ndarray) -> np.ndarray:
        """Return 2 or -2 where points (R, 3) are surely in the image or not, 0.5 or -0.5 else.

        Sure is what stays so when its direction turns by ``rounding`` (R,) radians.
        """
        inside = self.holds(points)
        length = np.linalg.norm(points, axis=1)
        along = points / length[:, None]
        least = np.eye(3)[np.argmin(np.abs(along), axis=1)]
        first = np.cross(along, least)
        first /= np.linalg.norm(first, axis=1)[:, None]
        second = np.cross(along, first)
        all_in, any_in = inside.copy(), inside.copy()
        for n in range(8):
            turn = math.cos(n * math.pi / 4) * first + math.sin(n * math.pi / 4) * second
            beside = self.holds(along + rounding[:, None] * turn)
            all_in &= beside
            any_in |= beside
        sure = np.where(inside, all_in, ~any_in)
        return np.where(inside, 1, -1) * np.where(sure, 2.0, 0.5)


@dataclass(frozen=True)
class Device:
    """A sensor in plain numbers; ``of`` reads a ``glvis.Sensor`` by its attributes.

    ``second_to_first`` (4, 4) is the pose of the ``second`` lens, if any, in the first's frame.
    ``rays`` gives directions (R, 3) through the middles of an image's pixels, where they are asked
    for; ``of`` takes the product's own, and holds them to the formula here.
    """

    first: LensEye
    second: LensEye | None = None
    second_to_first: np.ndarray | None = None
    min_distance: float = 0.0
    max_distance: float = math.inf
    max_incidence_deg: float = 90.0
    by_range: bool = False
    rays: Callable[[tuple[int, int]], np.ndarray] | None = None

    @classmethod
    def of(cls, sensor) -> Device:
        partner = sensor.partner

        def rays(resolution: tuple[int, int]) -> np.ndarray:
            share = [(np.arange(n) + 0.5) / n for n in resolution]
            u, v = map(np.ravel, np.meshgrid(*share))
            x, y, depth = sensor.lens.directions(u, v)
            some = np.isfinite(x)
            found, eye = np.stack([x, y, -depth], axis=1)[some], LensEye.of(sensor.lens)
            place = eye.project(found)
            if eye.kind in ("opencv", "fisheye"):
                place = (place + 0.5) / eye.size
            elsewhere = np.abs(place - np.stack([u, v], axis=1)[some]) > 1e-7
            assert not elsewhere.any(), "a pixel's ray that falls elsewhere"
            return found

        return cls(
            LensEye.of(sensor.lens),
            None if partner is None else LensEye.of(partner.lens),
            None if partner is None else pose_of(partner.offset, *map(math.degrees, partner.turn)),
            sensor.min_distance,
            sensor.max_distance,
            math.degrees(sensor.max_incidence),
            sensor.distance == "range",
            rays,
        )


def pose_of(offset, yaw_deg: float = 0.0, pitch_deg: float = 0.0) -> np.ndarray:
    """Return the pose of a second viewpoint: turned to the right, then up, and moved."""
    yaw, pitch = math.radians(yaw_deg), math.radians(pitch_deg)
    forward = np.array(
        [math.sin(yaw) * math.cos(pitch), math.sin(pitch), -math.cos(yaw) * math.cos(pitch)]
    )
    right = np.array([math.cos(yaw), 0, math.sin(yaw)])  # level, whatever the pitch
    pose = np.eye(4)
    pose[:3] = np.stack([right, np.cross(right, forward), -forward, offset], axis=1)
    return pose


class _Viewpoint:
    """One optical centre before the scene: in its image, not too oblique, free."""

    def __init__(self, pose, lens: LensEye, everything, rounding, limits: Device) -> None:
        self.pose, self._lens, self._limits = pose, lens, limits
        self.corners = (everything - pose[:3, 3]) @ pose[:3, :3]
        self.roundings, self._rounding = rounding, float(rounding.max())
        farthest = float(np.linalg.norm(self.corners, axis=2).max())
        near = NEAREST * min(limits.max_distance, DEEPEST * farthest)
        self._nearest, self._certain = _LEAST * near, _ASLANT * near
        edge, other = (self.corners[:, k] - self.corners[:, 0] for k in (1, 2))
        cross = np.cross(edge, other)
        double = np.linalg.norm(cross, axis=1)
        normal = cross / np.where(double > 0, double, 1)[:, None]
        self.height = -np.sum(normal * self.corners[:, 0], axis=1)
        longest = np.maximum(np.linalg.norm(edge, axis=1), np.linalg.norm(other, axis=1))
        longest = np.maximum(longest, np.linalg.norm(other - edge, axis=1))
        self._turning = rounding * longest / np.maximum(double, 1e-300)
        self._hiding: dict[int, Hiding] = {}

    def points(self, world: np.ndarray) -> np.ndarray:
        """Return points (R, 3) of the world in this frame."""
        return (world - self.pose[:3, 3]) @ self.pose[:3, :3]

    def passing(self, points: np.ndarray, own: np.ndarray, *, in_range: bool) -> np.ndarray:
        """Return by how many roundings points (R, 3) pass all filters, (R,); below 0 not."""
        limits = self._limits
        length = np.maximum(np.linalg.norm(points, axis=1), 1e-300)
        rounding = _SHARE + self._rounding / length
        turning = rounding + self._turning[own]
        cosine = self.height[own] / length
        passes = cosine / turning
        limit = math.cos(math.radians(min(limits.max_incidence_deg, 90.0)))
        np.minimum(passes, (cosine - limit) / turning, out=passes)
        if in_range:
            far = length if limits.by_range else -points[:, 2]
            np.minimum(passes, (far - limits.min_distance) / length / rounding, out=passes)
            if math.isfinite(limits.max_distance):
                np.minimum(passes, (limits.max_distance - far) / length / rounding, out=passes)
        # what is as near as what may hide or not is left open
        near = np.where(length < self._certain, 0.5, 2.0)
        passes = np.minimum(passes, near)
        some = np.flatnonzero(passes > -1)
        lens = self._lens.margin(points[some], _LENS * rounding[some])
        passes[some] = np.minimum(passes[some], lens)
        return passes

    def look(self, points: np.ndarray, own: np.ndarray, *, in_range: bool) -> Verdict:
        """Return the verdict on points (R, 3) of faces ``own`` (R,), seen from here alone."""
        passes = self.passing(points, own, in_range=in_range)
        free, doubtful = np.zeros(len(own), dtype=bool), np.zeros(len(own), dtype=bool)
        some = np.flatnonzero(passes > -1)
        hidden, unsure = self._hidden(points[some], own[some])
        free[some] = ~hidden & (passes[some] > 0)
        doubtful[some] = unsure | ((passes[some] < 1) & ~hidden)
        return Verdict(free, doubtful)

    def _hidden(self, points: np.ndarray, own: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return which points something hides, and of which rounding leaves that open."""
        hidden, doubtful = np.zeros(len(own), dtype=bool), np.zeros(len(own), dtype=bool)
        towards = np.stack([points @ -turn[:, 2] for turn in _SIX])
        nearest = towards.argmax(axis=0)
        for n, turn in enumerate(_SIX):
            some = np.flatnonzero(nearest == n)
            if not len(some):
                continue
            hidden[some], doubtful[some] = self._along(n).hidden(points[some] @ turn, own[some])
        return hidden, doubtful

    def _along(self, n: int) -> Hiding:
        """Return what hides along one of six axes."""
        if n not in self._hiding:
            fan = Fan(self.corners @ _SIX[n], self._nearest)
            self._hiding[n] = Hiding(fan, self._rounding, self._nearest, self._certain)
        return self._hiding[n]

    def shown(
        self, rays: np.ndarray, n: int
    ) -> Iterator[tuple[np.ndarray, np.ndarray, np.ndarray]]:
        """Yield what rays (R, 3) may meet first: points (P, 3), which of ``n`` faces, and surely.

        As of ``Hiding``; before any filter.
        """
        towards = np.stack([rays @ -turn[:, 2] for turn in _SIX])
        nearest, depth = towards.argmax(axis=0), towards.max(axis=0)
        for nth, turn in enumerate(_SIX):
            some = np.flatnonzero(nearest == nth)
            if len(some):
                mine = rays[some] / depth[some, None]
                ray, face, near, surely = self._along(nth).shown(mine @ turn, n)
                yield mine[ray] / near[:, None], face, surely


class LensJudge:
    """One sensor, of any lens and with or without a partner, before one model.

    Parameters
    ----------
    pose : (4, 4) float64
        Camera to world, of the first viewpoint.
    device : Device
        The lenses and limits.
    triangles, obstacles : (F, 3, 3), (O, 3, 3) float64
        The model, and what only hides.
    """

    def __init__(
        self,
        pose: np.ndarray,
        device: Device,
        triangles: np.ndarray,
        obstacles: np.ndarray | None = None,
    ) -> None:
        pose, self._own = np.asarray(pose, dtype=float), np.asarray(triangles, dtype=float)
        others = np.zeros((0, 3, 3)) if obstacles is None else np.asarray(obstacles, dtype=float)
        everything = np.concatenate([self._own, others])
        self.device, self.n = device, len(self._own)
        rounding = roundings(self._own, everything)
        self._has_area = has_area(self._own)
        views = [(pose, device.first)]
        if device.second is not None:
            views.append((pose @ device.second_to_first, device.second))
        self._views = [_Viewpoint(*view, everything, rounding, device) for view in views]
        self._pixels: dict[tuple[int, int], tuple[np.ndarray, np.ndarray]] = {}

    def centroids(self) -> Verdict:
        """Return the verdict on each face's centre of mass, (F,)."""
        return self.look(self._own.mean(axis=1), np.arange(self.n))

    def shares(self, n: int = 8, faces: np.ndarray | None = None) -> tuple[np.ndarray, np.ndarray]:
        """Return the shares of n * n points of faces that are surely and possibly seen, (f,) each.

        As of ``Judge``.
        """
        faces = np.arange(self.n) if faces is None else faces
        weights = part_centroids(n)
        surely, possibly = np.zeros(len(faces)), np.zeros(len(faces))
        some = np.flatnonzero(self._may_look(faces))
        step = max(1, (1 << 20) // len(weights))
        for first in range(0, len(some), step):
            part = some[first : first + step]
            points = np.einsum("pk,fkx->fpx", weights, self._own[faces[part]])
            verdict = self.look(points.reshape(-1, 3), np.repeat(faces[part], len(weights)))
            surely[part] = verdict.surely.reshape(len(part), -1).mean(axis=1)
            possibly[part] = verdict.possibly.reshape(len(part), -1).mean(axis=1)
        return surely, possibly

    def look(self, points: np.ndarray, own: np.ndarray) -> Verdict:
        """Return the verdict on points (R, 3) of the world, of faces ``own`` (R,)."""
        free, possibly = self._has_area[own].copy(), self._has_area[own].copy()
        surely = free.copy()
        for nth, view in enumerate(self._views):
            some = np.flatnonzero(possibly)
            verdict = view.look(view.points(points[some]), own[some], in_range=nth == 0)
            free[some] &= verdict.free
            surely[some] &= verdict.surely
            possibly[some] = verdict.possibly
        free &= possibly
        return Verdict(free, possibly & ~surely)

    def one_by_one(self, points: np.ndarray, own: np.ndarray) -> list[Verdict]:
        """Return the verdicts of the viewpoints, each by itself."""
        return [
            view.look(view.points(points), own, in_range=nth == 0)
            for nth, view in enumerate(self._views)
        ]

    def _may_look(self, faces: np.ndarray) -> np.ndarray:
        """Return which faces (f,) may look at every viewpoint, (f,) bool."""
        may = self._has_area[faces].copy()
        for view in self._views:
            reach = np.linalg.norm(view.corners[faces], axis=2).max(axis=1)
            slack = view.roundings[faces] + (_SHARE + view._turning[faces]) * reach
            may &= view.height[faces] > -slack
        return may

    def pixels(self, resolution: tuple[int, int]) -> tuple[np.ndarray, np.ndarray]:
        """Return in how many pixels of the first image each face is surely and possibly seen.

        As of ``Judge``; a pixel counts where the partner, if any, sees the point that it shows.
        """
        if resolution not in self._pixels:
            assert self.device.rays is not None, "a device without rays of its pixels"
            rays = self.device.rays(resolution)
            counts = np.zeros((2, self.n), dtype=np.int64)
            for point, face, surely in self._views[0].shown(rays, self.n):
                passes = self._views[0].passing(point, face, in_range=True)
                possibly = passes > -1
                surely = surely & (passes > 1) & self._has_area[face]
                if len(self._views) == 2:
                    world = point @ self._views[0].pose[:3, :3].T + self._views[0].pose[:3, 3]
                    some = np.flatnonzero(possibly)
                    there = self._views[1].points(world[some])
                    second = self._views[1].look(there, face[some], in_range=False)
                    surely[some] &= second.surely
                    possibly[some] = second.possibly
                for one, kept in zip(counts, (surely, possibly), strict=True):
                    one += np.bincount(face[kept], minlength=self.n)
            self._pixels[resolution] = counts[0], counts[1]
        return self._pixels[resolution]


def judge_of(
    pose: np.ndarray, sensor, triangles: np.ndarray, obstacles: np.ndarray | None = None
) -> Judge | LensJudge:
    """Return the judge of a ``glvis.Sensor``: of a plain pinhole the one that counts pixels too."""
    if sensor.lens.kind == "pinhole" and sensor.distance == "depth" and sensor.partner is None:
        return Judge(pose, Eye.of(sensor), triangles, obstacles)
    return LensJudge(pose, Device.of(sensor), triangles, obstacles)
