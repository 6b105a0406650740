"""The paper's filters on faces, Sec. 2.1.1: CropFOV, CropBack, CropNorm and CropNear.

Whatever asks if a sensor may see a face, before anything can hide it, asks here; for shaders
``filters.glsl`` has the same without the paper's own CropBack, and ``culling`` and ``may_pass``
bound it. A face is judged by its centre of mass, or other points of it one by one; by the paper's
rules at its three corners.

Coordinates are kept one row each, (rows, n): taking columns of long rows, and multiplying them
by a 3 x 3 matrix, is many times faster than the same on rows of three.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from enum import IntEnum

import numpy as np
from numpy.typing import ArrayLike, NDArray

from glvis.problem.camera import rigid_inverse
from glvis.problem.lens import Lens
from glvis.problem.scene import Model
from glvis.problem.sensor import Partner, Sensor
from glvis.problem.visibility_options import VisibilityOptions

Array = NDArray[np.floating]
Floats = NDArray[np.float64]
Bools = NDArray[np.bool_]

# CropBack by the paper's rules: back faces are tolerated up to 20 degrees past edge on.
_BACK_TOLERANCE = math.radians(20)
_ANY_RAY, _ANY_AXIS = 0.0, -2.0  # cosines that refuse nothing
_ANY_DISTANCE = 1e30  # scene unit; float32 holds it, and nothing lies beyond
_BEYOND = 1e-5  # share by which a bound is farther than what it bounds, for float32


class Refusal(IntEnum):
    """Which filter refuses a face first, from the farthest from being seen to the nearest."""

    OUTSIDE = 0  # CropFOV: beside the image, or behind the camera
    TURNED_AWAY = 1  # CropBack
    TOO_FAR = 2  # CropFOV: beyond maxD
    TOO_NEAR = 3  # CropNear
    TOO_OBLIQUE = 4  # CropNorm
    OUTSIDE_PARTNER = 5  # CropFOV of the second viewpoint
    TURNED_FROM_PARTNER = 6  # its CropBack or CropNorm
    NONE = 7  # all let it pass: it is seen unless something hides it


@dataclass(frozen=True)
class Limits:
    """The limits of one viewpoint that the filters hold faces against.

    Attributes
    ----------
    lens : Lens
        Which directions are in the image.
    min_distance, max_distance : float
        minD and maxD, scene unit.
    min_ray_cos : float
        Cosine of the largest incidence by the true ray; 0: any.
    min_axis_cos : float
        Cosine of the largest incidence by the optical axis; -2: any.
    tolerates_backs : bool
        Whether CropBack is the paper's: by the optical axis, up to 20 degrees past edge on.
    by_range : bool
        Whether minD and maxD are distances from the optical centre, not along its axis.
    """

    lens: Lens
    min_distance: float
    max_distance: float
    min_ray_cos: float = _ANY_RAY
    min_axis_cos: float = _ANY_AXIS
    tolerates_backs: bool = False
    by_range: bool = False

    @classmethod
    def of(cls, sensor: Sensor, options: VisibilityOptions) -> Limits:
        """Return the limits of a sensor's own viewpoint under a study's options.

        A largest incidence of 90 degrees means that CropNorm, which the paper calls optional, is
        off.
        """
        by_axis = options.incidence == "axis"
        min_cos = math.cos(sensor.max_incidence)
        if sensor.max_incidence >= math.pi / 2:
            min_cos = _ANY_AXIS if options.semantics == "paper" else 0.0  # no rounding of pi / 2
        return cls(
            sensor.lens,
            sensor.min_distance,
            sensor.max_distance,
            _ANY_RAY if by_axis else min_cos,
            min_cos if by_axis else _ANY_AXIS,
            options.semantics == "paper",
            sensor.distance == "range",
        )

    def of_partner(self, partner: Partner) -> Limits:
        """Return the limits of the second viewpoint: its own image, the same incidence, no range.

        The working range is that of the first: its farthest point bounds what the second is asked
        about, and no more.
        """
        farthest, windows = self.max_distance, self.lens.windows
        if not self.by_range:
            farthest *= math.hypot(1.0, *windows.tan_half) if windows.is_straight else math.inf
        farthest = min((1 + _BEYOND) * (farthest + partner.baseline), _ANY_DISTANCE)
        return replace(self, lens=partner.lens, min_distance=0.0, max_distance=farthest)

    @property
    def needs_axis(self) -> bool:
        """Whether the angle to the optical axis matters."""
        return self.tolerates_backs or self.min_axis_cos > _ANY_AXIS


def crop_fov(x: Array, y: Array, depth: Array, limits: Limits) -> Bools:
    """Return which points lie in the image up to maxD (CropFOV); any one shape.

    Parameters
    ----------
    x, y, depth : (...) float
        In the camera frame: to the right, up, and along the optical axis, scene unit.
    limits : Limits
        Of the sensor.
    """
    inside: Bools = measured(x, y, depth, limits) <= limits.max_distance
    inside &= limits.lens.contains(x, y, depth)
    return inside


def measured(x: Array, y: Array, depth: Array, limits: Limits) -> Array:
    """Return what minD and maxD are compared with: depth, or range from the optical centre."""
    if not limits.by_range:
        return depth
    distance: Array = np.sqrt(x * x + y * y + depth * depth)
    return distance


def crop_back(height: Array, axis_cos: Array, limits: Limits) -> Bools:
    """Return which faces look at the sensor (CropBack); any one shape.

    Parameters
    ----------
    height : (...) float
        Of the optical centre above the face's plane, scene unit; negative behind it.
    axis_cos : (...) float
        Cosine of the angle between the face's normal and the way back along the optical axis.
    limits : Limits
        Of the sensor.
    """
    if limits.tolerates_backs:
        return axis_cos >= math.cos(math.pi / 2 + _BACK_TOLERANCE)
    return height > 0


def crop_norm(height: Array, distance_squared: Array, axis_cos: Array, limits: Limits) -> Bools:
    """Return which faces are within the largest incidence (CropNorm), of those CropBack keeps.

    Any one shape.

    Parameters
    ----------
    height, axis_cos : (...) float
        As for ``crop_back``.
    distance_squared : (...) float
        From the optical centre to the point of the face, scene unit, squared.
    limits : Limits
        Of the sensor.
    """
    within: Bools = height * height >= limits.min_ray_cos**2 * distance_squared
    if limits.needs_axis:
        within &= axis_cos >= limits.min_axis_cos
    return within


def crop_near(distance: Array, limits: Limits) -> Bools:
    """Return which points lie no nearer than minD (CropNear), (...) bool; see ``measured``."""
    return distance >= limits.min_distance


@dataclass(frozen=True, eq=False)
class CameraFaces:
    """n faces in the frame of one camera: x right, y up, and depth along the optical axis.

    Attributes
    ----------
    index : (n,) int
        Face indices of the model; a face may stand several times, each time with another point.
    points : (3, k, n) float64
        x, y and depth of k points of each, by which it is judged; scene unit.
    normals : (3, n) float64
        Unit normals: x, y, and along the way back, against the optical axis.
    """

    index: NDArray[np.integer]
    points: Floats
    normals: Floats

    def moved(self, camera_to_other: Floats) -> CameraFaces:
        """Return the same faces in the frame of another camera, by a rigid (4, 4)."""
        turn, flip = camera_to_other[:3, :3], np.array([1.0, 1.0, -1.0])
        points = np.tensordot(turn, flip[:, None, None] * self.points, axes=1)
        points = flip[:, None, None] * (points + camera_to_other[:3, 3, None, None])
        return CameraFaces(self.index, points, turn @ self.normals)

    def __getitem__(self, chosen: Bools) -> CameraFaces:
        columns = np.flatnonzero(chosen)
        return CameraFaces(
            self.index.take(columns),
            self.points.take(columns, axis=2),
            self.normals.take(columns, axis=1),
        )

    @property
    def heights(self) -> Floats:
        """Of the optical centre above each face's plane, (n,)."""
        (x, y, depth), (across, up, back) = self.points[:, 0], self.normals
        return back * depth - across * x - up * y

    @property
    def distances_squared(self) -> Floats:
        """From the optical centre to the first point of each, (n,)."""
        squared: Floats = np.sum(self.points[:, 0] ** 2, axis=0)
        return squared


def face_camera(faces: CameraFaces, limits: Limits) -> Bools:
    """Return which faces pass CropBack and CropNorm, (n,): all that depends on the normal."""
    heights, axis_cos = faces.heights, faces.normals[2]
    passes = crop_back(heights, axis_cos, limits)
    return passes & crop_norm(heights, faces.distances_squared, axis_cos, limits)


def pass_filters(faces: CameraFaces, limits: Limits) -> Bools:
    """Return which faces pass all four filters, (n,) bool; see ``refusal`` for why not."""
    x, y, depth = faces.points
    distance = measured(x, y, depth, limits)
    passes = crop_fov(x, y, depth, limits).any(axis=0) & crop_near(distance, limits).all(axis=0)
    return passes & face_camera(faces, limits)


def refusal(faces: CameraFaces, limits: Limits) -> NDArray[np.uint8]:
    """Return the filter that refuses each face first, (n,) of ``Refusal``.

    With several points a face is inside if one of them is, and far enough if all are: so the
    paper judges corners.
    """
    x, y, depth = faces.points
    heights, axis_cos = faces.heights, faces.normals[2]
    refused = {
        Refusal.OUTSIDE: ~crop_fov(x, y, depth, replace(limits, max_distance=math.inf)).any(axis=0),
        Refusal.TURNED_AWAY: ~crop_back(heights, axis_cos, limits),
        Refusal.TOO_FAR: ~crop_fov(x, y, depth, limits).any(axis=0),
        Refusal.TOO_NEAR: ~crop_near(measured(x, y, depth, limits), limits).all(axis=0),
        Refusal.TOO_OBLIQUE: ~crop_norm(heights, faces.distances_squared, axis_cos, limits),
    }
    words = [np.uint8(reason) for reason in refused]
    return np.select(list(refused.values()), words, default=np.uint8(Refusal.NONE))


def refusals_of_sensor(
    model: Model, camera_to_world: Floats, sensor: Sensor, options: VisibilityOptions
) -> NDArray[np.uint8]:
    """Return the filter of a sensor's viewpoints that refuses each face of a model first, (F,).

    Parameters
    ----------
    model : Model
        F faces in the world.
    camera_to_world : (4, 4) float64
        The pose.
    sensor : Sensor
        Whose filters.
    options : VisibilityOptions
        What counts as visible.
    """
    faces, limits = faces_in_camera(model, camera_to_world, options), Limits.of(sensor, options)
    refused = refusal(faces, limits)
    if sensor.partner:
        first_to_partner = rigid_inverse(sensor.partner.partner_to_sensor)
        second = refusal(faces.moved(first_to_partner), limits.of_partner(sensor.partner))
        passes = refused == Refusal.NONE
        turned = np.isin(second, (Refusal.TURNED_AWAY, Refusal.TOO_OBLIQUE))
        refused[passes & (second == Refusal.OUTSIDE)] = Refusal.OUTSIDE_PARTNER
        refused[passes & turned] = Refusal.TURNED_FROM_PARTNER
    return refused


def faces_in_camera(
    model: Model, camera_to_world: Floats, options: VisibilityOptions
) -> CameraFaces:
    """Return all faces of a model as the filters judge them under some options.

    Parameters
    ----------
    model : Model
        F faces in the world.
    camera_to_world : (4, 4) float64
        The pose.
    options : VisibilityOptions
        With the paper's semantics faces are judged at their corners, else at their centres.
    """
    by_corners = options.semantics == "paper"
    points = in_camera_frame((model.vertices if by_corners else model.centroids).T, camera_to_world)
    corners = model.faces.T if by_corners else np.arange(model.n_faces)[None]
    normals = camera_to_world[:3, :3].T @ model.normals.T
    return CameraFaces(np.arange(model.n_faces), points[:, corners], normals)


def in_camera_frame(points: Floats, camera_to_world: Floats) -> Floats:
    """Return points (3, n) of the world as x right, y up and depth, (3, n), scene unit."""
    to_camera = camera_to_world[:3, :3].T
    moved: Floats = to_camera @ (points - camera_to_world[:3, 3:])
    moved[2] *= -1
    return moved


def incidence_cos(
    normals: Floats, points: Floats, camera_to_world: Floats, options: VisibilityOptions
) -> Floats:
    """Return cosines of the incidence, by the ray or the optical axis as options say, (n,).

    Parameters
    ----------
    normals, points : (n, 3) float64
        Unit normals, and where they are, in the world.
    camera_to_world : (4, 4) float64
        The pose.
    options : VisibilityOptions
        What incidence is measured to.
    """
    if options.incidence == "axis":
        along: Floats = normals @ camera_to_world[:3, 2]
        return along
    back = camera_to_world[:3, 3] - points
    height: Floats = np.sum(normals * back, axis=1)
    return height / np.maximum(np.linalg.norm(back, axis=1), 1e-300)


def may_pass(corners: Floats, tan_half: ArrayLike, working_range: ArrayLike) -> Bools:
    """Return which faces may have a point in the frustum, no nearer than minD, (n,) bool.

    A bound of CropFOV and CropNear: false only where all corners lie beyond one plane.

    Parameters
    ----------
    corners : (3, 3, n) float64
        Corner, coordinate, face: x right, y up, and depth along the optical axis, scene unit.
    tan_half : (2, n) or (2, 1) float64
        Tangents of the image's half angles.
    working_range : (2, n) or (2, 1) float64
        minD and maxD.
    """
    depth = corners[:, 2]
    tan_half, (nearest, farthest) = np.asarray(tan_half), np.asarray(working_range)
    inside: Bools = (depth.max(axis=0) >= nearest) & (depth.min(axis=0) <= farthest)
    for axis in range(2):
        limit = tan_half[axis] * depth
        inside &= (corners[:, axis] <= limit).any(axis=0) & (corners[:, axis] >= -limit).any(axis=0)
    return inside
