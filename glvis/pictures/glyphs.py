"""What a sensor looks like in a picture: body, optical centre, image plane, axis, field of view.

A second viewpoint has a smaller body of its own, in the sensor's second tone, and broken lines.
Arrays in, arrays out: a mesh of all bodies and the lines of all sensors, in the world frame.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from glvis.common.palette import second_tones
from glvis.problem.field import Field, body_tangents, common_border, field_of, partner_field
from glvis.problem.lens import Lens
from glvis.problem.sensor import Sensor

Floats = NDArray[np.float64]
Colors = NDArray[np.uint8]

# Shape of the body in units of its size: half width, half height and depth of the box behind
# the optical centre; the image plane's distance in front of it follows from its half width.
_BOX = (0.42, 0.30, 0.55)
_PLANE = 0.55  # half of the image plane's longer side
_BOX_SHADE = 0.45  # the box is this much darker than the sensor's colour

# A frustum is drawn as far as this share of the way to what the sensor aims at, fading, and at
# least so many sizes of a body: whole ones run out of the picture and into a ball of thread.
_SHARE, _LEAST = 0.3, 2.0
_FADING = ((0.0, 0.4, 0.6), (0.4, 0.75, 0.42), (0.75, 1.0, 0.28))  # from, to, opacity
_RIB = 0.5  # opacity of what crosses a bent end, of that of its border
_PARTNER = 0.6  # size of the second viewpoint's body, of the first's
_APART = 0.9  # sizes of a body that a baseline must have for two bodies
_DASH = 0.5  # sizes of a body, of a broken line and the gap behind it
_DASHES = 200  # at most in one segment
_CLEAR = 8  # sensors whose frusta can be told apart; those of more are drawn fainter

_CORNERS = np.array([(-1, -1), (1, -1), (1, 1), (-1, 1)])


def sensor_points(camera_to_world: Floats, local: Floats) -> Floats:
    """Return world points (S, N, 3) of camera-frame points (S, N, 3)."""
    rotation, centre = camera_to_world[:, :3, :3], camera_to_world[:, :3, 3]
    return local @ np.swapaxes(rotation, 1, 2) + centre[:, None]


def sensor_bodies(
    camera_to_world: Floats, sensors: Sequence[Sensor], colors: Colors, size: float
) -> tuple[Floats, NDArray[np.int32], Colors]:
    """Return vertices, faces and face colours of all sensors' bodies.

    Parameters
    ----------
    camera_to_world : (S, 4, 4) float64
        Poses.
    sensors : sequence of Sensor
        S of them; the image plane has the shape of the field of view.
    colors : (S, 3) uint8
        sRGB.
    size : float
        Of a body, scene unit.

    Returns
    -------
    vertices : (V, 3) float64
        A box behind the optical centre, and a pyramid from there to the image plane; the same,
        smaller, of second viewpoints that stand clear of the first.
    faces : (F, 3) int32
        Counter-clockwise seen from outside.
    colors : (F, 3) uint8
        sRGB.
    """
    x, y, deep = _BOX
    box = np.array([(i * x, j * y, z) for z in (deep, 0.0) for i, j in _CORNERS])
    bodies: list[tuple[Floats, Lens, Colors, float]] = [
        (pose, sensor.lens, color, size)
        for pose, sensor, color in zip(camera_to_world, sensors, colors, strict=True)
    ]
    for pose, sensor, tone in zip(camera_to_world, sensors, second_tones(colors), strict=True):
        if sensor.partner and sensor.partner.baseline > _APART * size:
            bodies.append((sensor.partner.poses(pose), sensor.partner.lens, tone, _PARTNER * size))
    local = np.zeros((len(bodies), 13, 3))
    for body, (_, lens, _, its_size) in zip(local, bodies, strict=True):
        body[:8] = box
        body[9:] = _image_plane(lens)
        body *= its_size
    quads = [(0, 1, 2, 3), (5, 4, 7, 6), (9, 12, 11, 10)]  # back, front, image plane
    quads += [(4 + i, 4 + (i + 1) % 4, (i + 1) % 4, i) for i in range(4)]
    faces = [face for a, b, c, d in quads for face in ((a, b, c), (a, c, d))]
    faces += [(8, 9 + i, 9 + (i + 1) % 4) for i in range(4)]
    one = np.array(faces, dtype=np.int32)
    is_box = (one < 8).all(axis=1)
    shade = np.where(is_box, 1 - _BOX_SHADE, 1.0)[None, :, None]
    poses = np.array([pose for pose, *_ in bodies]).reshape(-1, 4, 4)
    tints = np.array([color for _, _, color, _ in bodies]).reshape(-1, 1, 3)
    vertices = sensor_points(poses, local).reshape(-1, 3)
    all_faces = (one + 13 * np.arange(len(bodies), dtype=np.int32)[:, None, None]).reshape(-1, 3)
    return vertices, all_faces, (tints * shade).astype(np.uint8).reshape(-1, 3)


def sensor_lines(
    camera_to_world: Floats,
    sensors: Sequence[Sensor],
    colors: Colors,
    size: float,
    aims: Floats,
    *,
    with_frusta: bool,
) -> tuple[Floats, Colors, Floats]:
    """Return ends (N, 2, 3), colours (N, 4) and widths (N,) of the lines of all sensors.

    An axis from the image plane to what the sensor aims at, no farther than maxD; a roof over the
    image plane that says where its up is; and with ``with_frusta`` the edges of the field of view
    for the first part of that way. Of a second viewpoint the baseline and, with the frusta, its
    own field in broken lines, and where they end the border of what both see.

    Parameters
    ----------
    camera_to_world, sensors, colors, size
        As for ``sensor_bodies``.
    aims : (S,) float
        Distance along each axis to the first surface, scene unit; inf where there is none.
    with_frusta : bool
        Whether to draw the frusta.
    """
    made = _Segments()
    faint = min(1.0, _CLEAR / max(1, len(sensors)))
    lengths, dark = _frustum_lengths(sensors, size, aims), _darkened(colors)
    for pose, sensor, color, tone, length, aim in zip(
        camera_to_world, sensors, dark, _darkened(second_tones(colors)), lengths, aims, strict=True
    ):
        plane = _image_plane(sensor.lens) * size
        end = min(aim, sensor.max_distance) if np.isfinite(aim) else length
        axis = np.array([[0, 0, plane[0, 2]], [0, 0, -max(end, -plane[0, 2])]])
        made.add(axis[None], pose, color, 0.85, 1.6)
        top = plane[3:1:-1]
        ridge = (top[0] + top[1]) / 2
        ridge[1] += 0.3 * size
        made.add(np.array([[top[0], ridge], [ridge, top[1]]]), pose, color, 1.0, 2.0)
        second = partner_field(sensor)
        if second:
            made.add(np.array([[np.zeros(3), second.centre]]), pose, tone, 1.0, 1.6)
        if with_frusta:
            made.add_field(field_of(sensor), length, pose, color, faint)
        if with_frusta and second:
            made.add_field(second, length, pose, tone, faint, dash=_DASH * size)
            if len(shared := common_border(sensor, length)):
                made.add(_joined(shared, is_closed=True), pose, color, 0.9 * faint, 2.6)
    return made.arrays()


class _Segments:
    """Lines as they come together: ends in the world, colours, widths."""

    def __init__(self) -> None:
        self._ends: list[Floats] = []
        self._colors: list[NDArray[np.float64]] = []
        self._widths: list[Floats] = []

    def add(
        self, segments: Floats, pose: Floats, color: Colors, opacity: float, width: float
    ) -> None:
        """Add segments (N, 2, 3) of a camera's frame."""
        world = sensor_points(pose[None], segments.reshape(1, -1, 3)).reshape(-1, 2, 3)
        self._ends.append(world)
        self._colors.append(np.tile([*color, round(255 * opacity)], (len(segments), 1)))
        self._widths.append(np.full(len(segments), width))

    def add_field(
        self,
        field: Field,
        reach: float,
        pose: Floats,
        color: Colors,
        faint: float,
        dash: float = 0.0,
    ) -> None:
        """Add rays that fade, and the borders where they end; broken where ``dash`` is a length."""

        def put(lines: Floats, opacity: float) -> None:
            lines = _broken(lines, dash) if dash else lines
            self.add(lines, pose, color, opacity * faint, 1.3)

        ends = field.at(field.rays, reach)
        for begin, stop, opacity in _FADING:
            along = [field.centre + share * (ends - field.centre) for share in (begin, stop)]
            put(np.stack(along, axis=1), opacity)
        last = _FADING[-1][2]
        for border in field.borders:
            put(_joined(field.at(border, reach)), last)
        for rib in field.ribs:
            put(_joined(field.at(rib, reach)), _RIB * last)

    def arrays(self) -> tuple[Floats, Colors, Floats]:
        """Return ends (N, 2, 3), colours (N, 4) and widths (N,)."""
        colors = np.concatenate(self._colors).astype(np.uint8)
        return np.concatenate(self._ends), colors, np.concatenate(self._widths)


def frustum_corners(
    camera_to_world: Floats, sensors: Sequence[Sensor], size: float, aims: Floats
) -> list[Floats]:
    """Return where the drawn frusta end, world points (N, 3) a sensor; see ``sensor_lines``."""
    lengths = _frustum_lengths(sensors, size, aims)
    corners = []
    for pose, sensor, length in zip(camera_to_world, sensors, lengths, strict=True):
        fields = [field_of(sensor), partner_field(sensor)]
        ends = np.concatenate([field.corners(length) for field in fields if field])
        corners.append(sensor_points(pose[None], ends[None])[0])
    return corners


def _frustum_lengths(sensors: Sequence[Sensor], size: float, aims: Floats) -> Floats:
    """Return how deep each frustum is drawn, (S,) scene unit."""
    most = np.array([sensor.max_distance for sensor in sensors], dtype=float)
    return np.minimum(np.maximum(_SHARE * np.minimum(aims, most), _LEAST * size), most)


def _image_plane(lens: Lens) -> Floats:
    """Return the corners (4, 3) of the image plane of a body of size 1, camera frame."""
    tan = body_tangents(lens)
    distance = min(_PLANE / float(tan.max()), 1.6)  # a narrow view gets no spike
    return np.column_stack([_CORNERS * tan * distance, np.full(4, -distance)])


def _joined(points: Floats, *, is_closed: bool = False) -> Floats:
    """Return the segments (N, 2, 3) from each point (N, 3) to the next."""
    following = np.roll(points, -1, axis=0)
    segments = np.stack([points, following], axis=1)
    return segments if is_closed else segments[:-1]


def _broken(segments: Floats, dash: float) -> Floats:
    """Return segments (M, 2, 3) that leave every second ``dash`` of segments (N, 2, 3) out."""
    parts = []
    for start, end in segments:
        length = float(np.linalg.norm(end - start))
        n = min(_DASHES, max(1, round(length / dash)))
        share = np.arange(n)[:, None] / n
        half = share + 0.55 / n
        parts.append(np.stack([start + s * (end - start) for s in (share, half)], axis=1))
    return np.concatenate(parts)


def _darkened(colors: Colors) -> Colors:
    """Return colours that a thin line can have on white: light ones are made darker."""
    c = colors.astype(float)
    light = c @ [0.2126, 0.7152, 0.0722] / 255
    return np.round(c * np.where(light > 0.55, 0.55 / np.maximum(light, 0.55), 1)[:, None]).astype(
        np.uint8
    )
