"""Six arm-wrist-hand models and the hand holder, as smooth unions of round cones.

Frame, millimetres: Z is the forearm's axis with the fingers towards +Z and the wrist at
x = z = 0, Y points up out of the back of the hand, YZ is the mirror plane. Seen from +Y the
thumb of a right hand lies towards +X. Proportions are read off common hand-breadth and
hand-length tables, and every length is a multiple of the hand's length.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from scenery.implicit import (
    Array,
    Field,
    length,
    onto_zero,
    round_cone,
    rounded_box,
    smooth_union,
    zero_surface,
)
from scenery.remesh import Remesher, double_area_normals

N_FACES = 8600  # aimed at; about 8,500 come out
PAD_TOP = -15.0  # y of the holder's pad; palms lie 1 mm above it
GAP = 1.0
PAD_X, PAD_Z = 18.0, (14.0, 58.0)  # half width and z range of the pad


@dataclass(frozen=True)
class ArmShape:
    """What makes one arm differ from another; lengths in mm, angles in degrees.

    Attributes
    ----------
    hand : float
        From the wrist to the tip of the middle finger: 115 a child of five, 190 a tall man.
    forearm : float
        From the wrist to the open elbow end.
    girth : float
        Thickness of the forearm, 1 for slim.
    right : bool
        Side.
    flexion, deviation : float
        Hand turned at the wrist, towards the palm and towards the little finger.
    curl : float
        Bend of each finger joint.
    spread : float
        Angle between neighbouring fingers, beyond their natural fan.
    thumb : float
        Angle of the thumb away from the palm, beyond its rest.
    """

    name: str
    hand: float
    forearm: float
    girth: float
    right: bool
    flexion: float
    deviation: float
    curl: float
    spread: float
    thumb: float


ARMS = (
    ArmShape("arm1", 118, 140, 1.10, False, -4, 2, 6, 3.0, 4),
    ArmShape("arm2", 130, 160, 1.02, True, 3, -3, 9, 2.0, 0),
    ArmShape("arm3", 143, 172, 1.06, False, -7, 4, 11, 2.0, -3),
    ArmShape("arm4", 160, 190, 0.98, True, 0, 0, 5, 4.0, 6),
    ArmShape("arm5", 172, 205, 1.00, False, 5, -2, 8, 2.5, 2),
    ArmShape("arm6", 192, 240, 1.08, True, -5, 3, 4, 3.5, -2),
)


def _turn(points: Array, axis: int, degrees: float) -> Array:
    """Return points turned about a coordinate axis by the right-hand rule."""
    # Rounded, so that the last bit of a machine's sine never shows.
    c, s = round(math.cos(math.radians(degrees)), 12), round(math.sin(math.radians(degrees)), 12)
    p, q = (axis + 1) % 3, (axis + 2) % 3
    turned = np.array(points, dtype=float)
    turned[..., p] = c * points[..., p] - s * points[..., q]
    turned[..., q] = s * points[..., p] + c * points[..., q]
    return turned


@dataclass(frozen=True)
class _Finger:
    """Knuckle place, lengths of the phalanges, radii at the four joints, and fan angle."""

    knuckle: tuple[float, float, float]
    phalanges: tuple[float, float, float]
    radii: tuple[float, float, float, float]
    fan: float


# In hand lengths, for a right hand: index, middle, ring, little.
_FINGERS = (
    _Finger((0.148, 0.012, 0.480), (0.225, 0.140, 0.105), (0.051, 0.047, 0.043, 0.036), 4.5),
    _Finger((0.050, 0.020, 0.500), (0.240, 0.155, 0.105), (0.052, 0.048, 0.044, 0.037), 1.0),
    _Finger((-0.048, 0.014, 0.480), (0.225, 0.145, 0.105), (0.050, 0.046, 0.042, 0.0355), -3.0),
    _Finger((-0.136, 0.000, 0.440), (0.175, 0.105, 0.090), (0.046, 0.040, 0.037, 0.032), -8.5),
)
# Carpal end and radius of the ray that leads to each knuckle.
_CARPALS = ((0.058, 0.0, 0.09), (0.02, 0.008, 0.08), (-0.02, 0.006, 0.08), (-0.055, 0.0, 0.09))
_THUMB = (  # place and radius along the thumb: root, ball, knuckle, joint, tip
    ((0.070, -0.024, 0.110), 0.056),
    ((0.160, -0.060, 0.220), 0.072),
    ((0.245, -0.085, 0.330), 0.057),
    ((0.315, -0.100, 0.430), 0.050),
    ((0.365, -0.105, 0.520), 0.040),
)


class Arm:
    """The field of one arm (a callable) and the box that holds it."""

    def __init__(self, shape: ArmShape) -> None:
        self.shape = shape
        self._side = 1.0 if shape.right else -1.0
        self._palm = [(a, b, ra, rb) for a, b, ra, rb in self._palm_rays()]
        self._fingers = [self._finger_bones(finger) for finger in _FINGERS]
        self._thumb_bones = self._thumb()

    def _place(self, point: Array) -> Array:
        """Return a point of the resting right hand, in hand lengths, where this hand has it."""
        turned = _turn(_turn(point, 0, self.shape.flexion), 1, -self.shape.deviation)
        return turned * self.shape.hand

    def _palm_rays(self) -> list[tuple[Array, Array, float, float]]:
        h = self.shape.hand
        rays = []
        for carpal, finger, radius in zip(_CARPALS, _FINGERS, (0.068,) * 3 + (0.064,), strict=True):
            head = np.array(finger.knuckle)
            rays.append((self._place(np.array(carpal)), self._place(head), 0.056 * h, radius * h))
        # The heel of the hand on the little finger's side.
        a, b = np.array([-0.068, -0.026, 0.12]), np.array([-0.120, -0.030, 0.30])
        rays.append((self._place(a), self._place(b), 0.054 * h, 0.060 * h))
        return rays

    def _finger_bones(self, finger: _Finger) -> list[tuple[Array, Array, float, float]]:
        h, joint = self.shape.hand, np.array(finger.knuckle)
        angle = finger.fan + self.shape.spread * finger.fan / 3.0
        bones, bend = [], 0.3 * self.shape.curl
        for bone, ra, rb in zip(finger.phalanges, finger.radii, finger.radii[1:], strict=False):
            way = _turn(_turn(np.array([0.0, 0.0, bone]), 0, bend), 1, angle)
            end = joint + way
            bones.append((self._place(joint), self._place(end), ra * h, rb * h))
            joint, bend = end, bend + self.shape.curl
        return bones

    def _thumb(self) -> list[tuple[Array, Array, float, float]]:
        h, root = self.shape.hand, np.array(_THUMB[0][0])
        points = [root + _turn(np.array(p) - root, 1, self.shape.thumb) for p, _ in _THUMB]
        radii = [r * h for _, r in _THUMB]
        return [
            (self._place(points[i]), self._place(points[i + 1]), radii[i], radii[i + 1])
            for i in range(len(points) - 1)
        ]

    def _forearm(self, p: Array) -> Array:
        """Return about the distance to an elliptic taper with the muscles' belly."""
        h, long = self.shape.hand, self.shape.forearm
        t = np.clip(-p[:, 2] / long, 0.0, 1.0)  # 0 at the wrist, 1 at the elbow end
        swell = t * t * (3.0 - 2.0 * t)
        belly = 4.0 * t * (1.0 - t) * t
        wide = h * (0.138 + self.shape.girth * (0.085 * swell + 0.045 * belly))
        high = h * (0.100 + self.shape.girth * (0.095 * swell + 0.045 * belly))
        # The bones bow a little towards the thumb, the belly hangs towards the palm.
        x = (p[:, 0] - h * 0.05 * t * (1.0 - t)) / wide
        y = (p[:, 1] + h * (0.01 + 0.06 * swell)) / high
        z = np.maximum(p[:, 2], 0.0) / (0.28 * h)  # it ends as an ellipsoid inside the hand
        return (np.sqrt(x * x + y * y + z * z) - 1.0) * np.minimum(wide, high)

    def __call__(self, points: Array) -> Array:
        """Return about the distance of points (N, 3), mm, to the skin; negative inside."""
        h = self.shape.hand
        p = points * np.array([self._side, 1.0, 1.0])
        palm = round_cone(p, *self._palm[0])
        for ray in self._palm[1:]:
            palm = smooth_union(palm, round_cone(p, *ray), 0.075 * h)
        thumb = round_cone(p, *self._thumb_bones[0])
        for bone in self._thumb_bones[1:]:
            thumb = smooth_union(thumb, round_cone(p, *bone), 0.012 * h)
        fingers = None
        for bones in self._fingers:
            finger = round_cone(p, *bones[0])
            for bone in bones[1:]:
                finger = smooth_union(finger, round_cone(p, *bone), 0.003 * h)
            fingers = finger if fingers is None else smooth_union(fingers, finger, 0.008 * h)
        hand = smooth_union(smooth_union(palm, thumb, 0.06 * h), fingers, 0.035 * h)
        return smooth_union(hand, self._forearm(p), 0.06 * h)

    @property
    def box(self) -> tuple[Array, Array]:
        """Lower and upper corner; the elbow's open end lies on the lower one's z."""
        h = self.shape.hand
        half = np.array([0.55 * h, 0.45 * h])
        return (
            np.array([-half[0], -half[1], -self.shape.forearm]),
            np.array([half[0], half[1], 1.12 * h]),
        )


def even_surface(
    field: Field, lower: Array, upper: Array, step: float, n_faces: int
) -> tuple[Array, NDArray[np.int64]]:
    """Return the zero surface of a field with about ``n_faces`` even faces.

    ``step`` is the grid that the surface is first found on: no wider than the narrowest gap.
    """
    vertices, faces = zero_surface(field, lower, upper, step)
    area = math.fsum(length(double_area_normals(vertices, faces))) / 2

    def project(points: Array, on_loop: NDArray[np.bool_]) -> Array:
        return onto_zero(field, points, on_loop, 1e-3 * step)

    remesher = Remesher(vertices, faces, math.sqrt(area / n_faces * 4 / math.sqrt(3)), project)
    remesher.run(4)
    for _ in range(4):
        remesher.target *= math.sqrt(len(remesher.faces) / n_faces)
        remesher.run(2)
    return remesher.vertices, remesher.faces


def make_arms() -> dict[str, tuple[Array, NDArray[np.int64]]]:
    """Return the meshes of all arms by name, each lying on the holder's pad."""
    return {shape.name: make_arm(shape) for shape in ARMS}


def make_arm(shape: ArmShape) -> tuple[Array, NDArray[np.int64]]:
    """Return one arm, shifted along y so that its palm lies ``GAP`` above the pad."""
    arm = Arm(shape)
    vertices, faces = even_surface(arm, *arm.box, 0.024 * shape.hand, N_FACES)
    for _ in range(8):
        vertices[:, 1] += GAP - float(holder_field(vertices).min())
    return vertices, faces


def holder_field(points: Array) -> Array:
    """Return the distance to the holder: pad under the palm, post and foot, softly joined."""
    middle = (PAD_Z[0] + PAD_Z[1]) / 2
    long = (PAD_Z[1] - PAD_Z[0]) / 2
    pad = rounded_box(
        points, np.array([0.0, PAD_TOP - 5.0, middle]), np.array([PAD_X, 5.0, long]), 4.0
    )
    post = round_cone(
        points,
        np.array([0.0, PAD_TOP - 82.0, middle]),
        np.array([0.0, PAD_TOP - 15.0, middle]),
        12.0,
        9.0,
    )
    foot = rounded_box(
        points, np.array([0.0, PAD_TOP - 96.0, middle]), np.array([30.0, 5.0, 31.0]), 4.0
    )
    return smooth_union(smooth_union(pad, post, 8.0), foot, 8.0)


def make_holder() -> tuple[Array, NDArray[np.int64]]:
    """Return the holder, closed, symmetric about YZ but for its triangulation."""
    lower = np.array([-36.0, PAD_TOP - 106.0, PAD_Z[0] - 14.0])
    upper = np.array([36.0, PAD_TOP + 4.0, PAD_Z[1] + 14.0])
    return even_surface(holder_field, lower, upper, 3.0, 2060)
