"""What a sensor looks like in a picture: body, optical centre, image plane, axis, frustum.

Arrays in, arrays out: a mesh of all bodies and the lines of all sensors, in the world frame.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

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
        A box behind the optical centre, and a pyramid from there to the image plane.
    faces : (F, 3) int32
        Counter-clockwise seen from outside.
    colors : (F, 3) uint8
        sRGB.
    """
    x, y, deep = _BOX
    box = np.array([(i * x, j * y, z) for z in (deep, 0.0) for i, j in _CORNERS])
    local = np.zeros((len(sensors), 13, 3))
    for body, sensor in zip(local, sensors, strict=True):
        body[:8] = box
        body[9:] = _image_plane(sensor)
    quads = [(0, 1, 2, 3), (5, 4, 7, 6), (9, 12, 11, 10)]  # back, front, image plane
    quads += [(4 + i, 4 + (i + 1) % 4, (i + 1) % 4, i) for i in range(4)]
    faces = [face for a, b, c, d in quads for face in ((a, b, c), (a, c, d))]
    faces += [(8, 9 + i, 9 + (i + 1) % 4) for i in range(4)]
    one = np.array(faces, dtype=np.int32)
    is_box = (one < 8).all(axis=1)
    shade = np.where(is_box, 1 - _BOX_SHADE, 1.0)[None, :, None]
    vertices = sensor_points(camera_to_world, local * size).reshape(-1, 3)
    all_faces = (one + 13 * np.arange(len(sensors), dtype=np.int32)[:, None, None]).reshape(-1, 3)
    return vertices, all_faces, (colors[:, None] * shade).astype(np.uint8).reshape(-1, 3)


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
    for the first part of that way.

    Parameters
    ----------
    camera_to_world, sensors, colors, size
        As for ``sensor_bodies``.
    aims : (S,) float
        Distance along each axis to the first surface, scene unit; inf where there is none.
    with_frusta : bool
        Whether to draw the frusta.
    """
    ends, tints, widths = [], [], []
    faint = min(1.0, _CLEAR / max(1, len(sensors)))

    def add(segments: Floats, pose: Floats, color: Colors, opacity: float, width: float) -> None:
        ends.append(sensor_points(pose[None], segments.reshape(1, -1, 3)).reshape(-1, 2, 3))
        tints.append(np.tile([*color, round(255 * opacity)], (len(segments), 1)))
        widths.append(np.full(len(segments), width))

    lengths = _frustum_lengths(sensors, size, aims)
    for pose, sensor, color, length, aim in zip(
        camera_to_world, sensors, _darkened(colors), lengths, aims, strict=True
    ):
        plane = _image_plane(sensor) * size
        end = min(aim, sensor.max_distance) if np.isfinite(aim) else length
        axis = np.array([[0, 0, plane[0, 2]], [0, 0, -max(end, -plane[0, 2])]])
        add(axis[None], pose, color, 0.85, 1.6)
        top = plane[3:1:-1]
        ridge = (top[0] + top[1]) / 2
        ridge[1] += 0.3 * size
        add(np.array([[top[0], ridge], [ridge, top[1]]]), pose, color, 1.0, 2.0)
        if with_frusta:
            far = _section(sensor, length)
            for begin, stop, opacity in _FADING:
                edges = np.stack([begin * far, stop * far], axis=1)
                add(edges, pose, color, opacity * faint, 1.3)
            add(_loop(far), pose, color, _FADING[-1][2] * faint, 1.3)
    return np.concatenate(ends), np.concatenate(tints).astype(np.uint8), np.concatenate(widths)


def frustum_corners(
    camera_to_world: Floats, sensors: Sequence[Sensor], size: float, aims: Floats
) -> Floats:
    """Return where the drawn frusta end, world points (S, 4, 3); see ``sensor_lines``."""
    lengths = _frustum_lengths(sensors, size, aims)
    local = [_section(sensor, length) for sensor, length in zip(sensors, lengths, strict=True)]
    return sensor_points(camera_to_world, np.array(local).reshape(-1, 4, 3))


def _frustum_lengths(sensors: Sequence[Sensor], size: float, aims: Floats) -> Floats:
    """Return how deep each frustum is drawn, (S,) scene unit."""
    most = np.array([sensor.max_distance for sensor in sensors], dtype=float)
    return np.minimum(np.maximum(_SHARE * np.minimum(aims, most), _LEAST * size), most)


def _image_plane(sensor: Sensor) -> Floats:
    """Return the corners (4, 3) of the image plane of a body of size 1, camera frame."""
    tan = sensor.lens.tan_half
    distance = min(_PLANE / float(tan.max()), 1.6)  # a narrow view gets no spike
    return np.column_stack([_CORNERS * tan * distance, np.full(4, -distance)])


def _section(sensor: Sensor, depth: float) -> Floats:
    """Return the corners (4, 3) of the field of view at a depth, camera frame."""
    return np.column_stack([_CORNERS * sensor.lens.tan_half * depth, np.full(4, -depth)])


def _loop(corners: Floats) -> Floats:
    """Return the closed polygon's segments (N, 2, 3)."""
    return np.stack([corners, np.roll(corners, -1, axis=0)], axis=1)


def _darkened(colors: Colors) -> Colors:
    """Return colours that a thin line can have on white: light ones are made darker."""
    c = colors.astype(float)
    light = c @ [0.2126, 0.7152, 0.0722] / 255
    return np.round(c * np.where(light > 0.55, 0.55 / np.maximum(light, 0.55), 1)[:, None]).astype(
        np.uint8
    )
