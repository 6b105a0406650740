"""Fields of view as lines: borders of images and rays to them, for pictures, page and exports.

All in the camera frame of the sensor: x right, y up, looking along -z. A lens of less than 150
degrees whose range is depth ends in a plane; any other ends on a ball about its optical centre.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from glvis.problem.lens import WIDEST, Lens, Pinhole, SphericalLens
from glvis.problem.sensor import Sensor

Floats = NDArray[np.float64]

_CORNERS = np.array([(-1, -1), (1, -1), (1, 1), (-1, 1)])
_A_SIDE = 16  # places a side of a border that is drawn bent
_STEP = math.radians(5)  # along a line of azimuth or elevation
_MERIDIAN = math.radians(45)  # at least so many lines of azimuth on a band
_POLE = math.radians(89)  # elevation beyond which a row of the image is a point


_LENSES = {
    "pinhole": "",
    "opencv": "with distortion",
    "fisheye": "fisheye",
    "spherical": "by azimuth and elevation",
}
_ROLES = {"imager": "second imager"}


def lens_words(lens: Lens) -> str:
    """Return what follows the opening angles of a lens in a line; nothing for a pinhole."""
    return _LENSES.get(lens.kind, lens.kind)


def partner_words(sensor: Sensor) -> str:
    """Return what the second viewpoint of a sensor is called; nothing where there is none."""
    return _ROLES.get(sensor.partner.role, sensor.partner.role) if sensor.partner else ""


@dataclass(frozen=True, eq=False)
class Field:
    """The lines of what one optical centre sees, as directions (N, 3) of any length.

    Attributes
    ----------
    centre : (3,) float64
        The optical centre, study's unit.
    borders : tuple of (N, 3) float64
        Around the image; closed where the last direction is the first.
    ribs : tuple of (N, 3) float64
        Across it, where it ends on a ball: they show that it is bent.
    rays : (K, 3) float64
        From the centre to the border.
    is_flat : bool
        Whether it ends in a plane at right angles to the sensor's optical axis.
    """

    centre: Floats
    borders: tuple[Floats, ...]
    ribs: tuple[Floats, ...]
    rays: Floats
    is_flat: bool

    def at(self, directions: Floats, reach: float) -> Floats:
        """Return where directions (N, 3) end, (N, 3): at a depth of the sensor, or a range."""
        if self.is_flat:
            along = np.maximum(reach + self.centre[2], 0.0)  # never behind the centre
            ends = directions * (along / -directions[:, 2:])
        else:
            ends = directions * (reach / np.linalg.norm(directions, axis=1)[:, None])
        return ends + self.centre if self.centre.any() else ends  # -0.0 stays what it is

    def corners(self, reach: float) -> Floats:
        """Return all points (N, 3) of the borders at a reach."""
        return np.concatenate([self.at(border, reach) for border in self.borders])


@lru_cache(maxsize=256)
def field_of(sensor: Sensor) -> Field:
    """Return the field of view of a sensor's own lens."""
    return _field(sensor.lens, np.eye(4), sensor.distance == "range")


@lru_cache(maxsize=256)
def partner_field(sensor: Sensor) -> Field | None:
    """Return the field of view of the second viewpoint, None where there is none."""
    if sensor.partner is None:
        return None
    pose = sensor.partner.partner_to_sensor
    return _field(sensor.partner.lens, pose, sensor.distance == "range")


def common_border(sensor: Sensor, reach: float) -> Floats:
    """Return the border (N, 3) of what both viewpoints see at a depth; (0, 3) where there is none.

    None is told either where a field ends on a ball, or where both borders are bent inwards.
    """
    first, second = field_of(sensor), partner_field(sensor)
    nothing = np.zeros((0, 3))
    if second is None or not (first.is_flat and second.is_flat):
        return nothing
    planes = [field.at(field.borders[0][:-1], reach)[:, :2] for field in (first, second)]
    one, other = (_counter_clockwise(plane) for plane in planes)
    if not _is_convex(other):
        one, other = other, one
        if not _is_convex(other):
            return nothing
    shared = _clipped(one, other)
    if len(shared) < 3:
        return nothing
    return np.column_stack([shared, np.full(len(shared), -reach)])


def image_aspect(lens: Lens) -> float:
    """Return width over height of a lens's image, drawn with the scale of its middle."""
    if isinstance(lens, Pinhole):
        tan_x, tan_y = lens.tan_half.tolist()
        return float(tan_x / tan_y)
    across, up = lens.focal
    return up / across


def body_tangents(lens: Lens) -> Floats:
    """Return tangents (2,) of a short pyramid that stands for a lens: a wide one is no plate."""
    if isinstance(lens, Pinhole):
        return lens.tan_half
    aspect = image_aspect(lens)
    across = min(1.2, float(lens.tan_half[0]))
    return np.array([across, np.clip(across / aspect, 0.25 * across, 1.2)])


def _field(lens: Lens, pose: Floats, by_range: bool) -> Field:
    """Return the field of a lens whose camera stands at ``pose`` in the sensor's frame."""
    if isinstance(lens, SphericalLens):
        return _turned(_band(lens), pose, is_flat=False)
    if isinstance(lens, Pinhole):
        corners = np.column_stack([_CORNERS * lens.tan_half, np.full(4, -1.0)])
        flat = _turned(((_closed(corners),), (), corners), pose, is_flat=True)
        if not by_range and (flat.borders[0][:, 2] < 0).all():
            return flat
    border = _to_camera(lens.outline(_A_SIDE)[::-1].T)  # as corners go: from below left
    is_narrow = bool((-border[:, 2] > math.cos(WIDEST)).all())
    step = _A_SIDE // 2 if lens.has_blind_corners else _A_SIDE  # a round field has no corners
    rays = border[step - 1 :: step]
    lines = ((_closed(border),), () if is_narrow and not by_range else _cross(lens), rays)
    field = _turned(lines, pose, is_flat=is_narrow and not by_range)
    if field.is_flat and not (field.borders[0][:, 2] < 0).all():
        return _turned(lines, pose, is_flat=False)  # it looks too far aside for a plane
    return field


Lines = tuple[tuple[Floats, ...], tuple[Floats, ...], Floats]


def _turned(lines: Lines, pose: Floats, *, is_flat: bool) -> Field:
    """Return a field of lines in the frame of a camera at ``pose``."""
    borders, ribs, rays = lines
    turn = pose[:3, :3].T
    return Field(
        pose[:3, 3].copy(),
        tuple(line @ turn for line in borders),
        tuple(line @ turn for line in ribs),
        rays @ turn,
        is_flat,
    )


def _cross(lens: Lens) -> tuple[Floats, ...]:
    """Return the middle row and column of an image, as far as they have rays."""
    share, middle = np.linspace(0, 1, 2 * _A_SIDE + 1), np.full(2 * _A_SIDE + 1, 0.5)
    lines = (lens.directions(share, middle), lens.directions(middle, share))
    return tuple(_to_camera(line[:, np.isfinite(line[0])]) for line in lines)


def _band(lens: SphericalLens) -> Lines:
    """Return rows and columns of a spherical image: a ring where it goes all around."""
    low, high = lens.elevation
    is_ring = lens.azimuth > 2 * math.pi - 1e-9
    n_across, n_up = (max(2, math.ceil(angle / _STEP) + 1) for angle in lens.opening)
    u, v = np.linspace(0, 1, n_across), np.linspace(0, 1, n_up)
    n_columns = math.ceil(lens.azimuth / _MERIDIAN - 1e-9)
    columns = np.linspace(0, 1, n_columns + 1)

    def row(elevation: float) -> Floats:
        share = (high - elevation) / (high - low)
        return _to_camera(lens.directions(u, np.full(n_across, share)))

    def column(at: float) -> Floats:
        return _to_camera(lens.directions(np.full(n_up, at), v))

    borders = [row(edge) for edge in (low, high) if abs(edge) < _POLE]
    borders += [] if is_ring else [column(0.0), column(1.0)]
    inner = columns[1:] if is_ring else columns[1:-1]
    ribs = [column(at) for at in inner]
    if not borders:  # a whole ball: its equator
        borders = [row(0.0)]
    elif low < 0 < high and high - low > math.radians(60):
        ribs.append(row(0.0))
    ends = columns[:-1:2] if is_ring else columns[[0, -1]]
    edges = [share for share, edge in ((0.0, high), (1.0, low)) if abs(edge) < _POLE] or [0.5]
    places = np.array([(at, edge) for at in ends for edge in edges])
    return tuple(borders), tuple(ribs), _to_camera(lens.directions(*places.T))


def _to_camera(directions: Floats) -> Floats:
    """Return directions (3, N) of right, up, depth as (N, 3) of the camera frame."""
    return directions.T * [1.0, 1.0, -1.0]


def _closed(points: Floats) -> Floats:
    return np.concatenate([points, points[:1]])


def _edges(polygon: Floats) -> Floats:
    return np.roll(polygon, -1, axis=0) - polygon


def _cross_2d(a: Floats, b: Floats) -> Floats:
    return np.asarray(a[..., 0] * b[..., 1] - a[..., 1] * b[..., 0])


def _counter_clockwise(polygon: Floats) -> Floats:
    area = _cross_2d(polygon, np.roll(polygon, -1, axis=0)).sum()
    return polygon if area >= 0 else polygon[::-1]


def _is_convex(polygon: Floats) -> bool:
    edges = _edges(polygon)
    lengths = np.linalg.norm(edges, axis=1)
    turns = _cross_2d(edges, np.roll(edges, -1, axis=0))
    return bool((turns >= -1e-9 * lengths.max(initial=0.0) ** 2).all())


def _clipped(subject: Floats, convex: Floats) -> Floats:
    """Return the part (N, 2) of a polygon that lies in a convex one, counter-clockwise.

    References
    ----------
    Sutherland and Hodgman, "Reentrant polygon clipping" (1974).
    """
    for start, edge in zip(convex, _edges(convex), strict=True):
        if not len(subject):
            break
        side = _cross_2d(edge, subject - start)
        kept: list[Floats] = []
        for k, (point, here) in enumerate(zip(subject, side, strict=True)):
            before, there = subject[k - 1], side[k - 1]
            if (here >= 0) != (there >= 0):
                kept.append(before + (point - before) * there / (there - here))
            if here >= 0:
                kept.append(point)
        subject = np.array(kept).reshape(-1, 2)
    return subject
