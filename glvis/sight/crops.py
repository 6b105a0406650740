"""The paper's filters on single faces (Sec. 2.1.1), in NumPy, for the criterion "centroid".

The pixels criterion has the same filters in its shader; here they act on centres of mass.
Coordinates are kept one row each, (rows, n): taking columns of long rows, and multiplying them
by a 3 x 3 matrix, is many times faster than the same on rows of three.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from glvis.inputs.scene import Model
from glvis.inputs.sensor import Sensor

Floats = NDArray[np.float64]
Bools = NDArray[np.bool_]
Indices = NDArray[np.integer]

# Sec. 2.1.1, CropBack: back faces are tolerated up to 20 degrees past edge on.
_BACK_TOLERANCE = math.radians(20)
# Pixel widths by which something must be nearer than a face to hide its centre. From 0.5 to 2
# the agreement with centroid rays on six arms changes by 0.0001 (tools/bench prints it).
_TOLERANCE = 1.0


@dataclass(frozen=True, eq=False)
class FaceTable:
    """Faces of a model in an order in which neighbours lie side by side, T of them.

    Attributes
    ----------
    index : (T,) int
        Face indices of the model; a face may stand twice.
    centroids, normals : (3, T) float64
        Centres of mass and unit normals by coordinate.
    """

    index: Indices
    centroids: Floats
    normals: Floats

    @classmethod
    def of(cls, model: Model, index: Indices) -> FaceTable:
        """Return the table of some faces of a model, in their order."""
        return cls(
            index,
            np.ascontiguousarray(model.centroids[index].T),
            np.ascontiguousarray(model.normals[index].T),
        )


@dataclass(frozen=True, eq=False)
class CameraFaces:
    """Some faces as one camera has them: n faces before it, in the camera frame.

    Attributes
    ----------
    index : (n,) int
        Face indices of the model.
    rows : (6, n) float64
        x and y of the centre of mass over its depth; its depth, the distance along the optical
        axis in scene units; x, y and z of the unit normal.
    """

    index: Indices
    rows: Floats

    def __getitem__(self, chosen: Bools) -> CameraFaces:
        columns = np.flatnonzero(chosen)
        return CameraFaces(self.index.take(columns), self.rows.take(columns, axis=1))

    @property
    def tangent(self) -> Floats:
        """Centres of mass in the image plane at unit distance, (2, n)."""
        return self.rows[:2]

    @property
    def depth(self) -> Floats:
        """Distances of the centres along the optical axis, (n,)."""
        return self.rows[2]

    def towards(self, x: Floats, y: Floats) -> Floats:
        """Return normal . way back along the rays through (x, y) at unit distance, (n,)."""
        return self.rows[5] - self.rows[3] * x - self.rows[4] * y


def in_camera(table: FaceTable, columns: Indices, camera_to_world: Floats) -> CameraFaces:
    """Return those of some faces whose centres lie before a camera, in its frame.

    Parameters
    ----------
    table : FaceTable
        Faces in the world frame.
    columns : (n,) int
        Which of the table.
    camera_to_world : (4, 4) float64
        The pose.
    """
    to_camera = camera_to_world[:3, :3].T
    centre = to_camera @ table.centroids.take(columns, axis=1)
    centre -= (to_camera @ camera_to_world[:3, 3])[:, None]
    depth = -centre[2]
    if depth.min(initial=1) <= 0:
        before = np.flatnonzero(depth > 0)
        columns, centre, depth = columns[before], centre[:, before], depth[before]
    rows = np.zeros((6, len(columns)))
    rows[:2] = centre[:2] / depth
    rows[2] = depth
    rows[3:] = to_camera @ table.normals.take(columns, axis=1)
    return CameraFaces(table.index.take(columns), rows)


def crop_centroids(faces: CameraFaces, sensor: Sensor, *, by_axis: bool) -> Bools:
    """Return which faces pass CropFOV, CropBack, CropNorm and CropNear by their centre, (n,).

    The incidence is that of the true ray to the centre, or of the optical axis.
    """
    tan_x, tan_y = sensor.intrinsics.tan_half
    x, y = faces.tangent
    passes = (faces.depth >= sensor.min_distance) & (faces.depth <= sensor.max_distance)
    passes &= (np.abs(x) <= tan_x) & (np.abs(y) <= tan_y)
    return passes & faces_sensor(faces, sensor, by_axis=by_axis)


def faces_sensor(faces: CameraFaces, sensor: Sensor, *, by_axis: bool) -> Bools:
    """Return which faces look at the sensor within its limit of incidence, (n,) bool."""
    x, y = faces.tangent
    towards = faces.towards(x, y)
    min_cos = math.cos(sensor.max_incidence)
    if by_axis:
        return (towards > 0) & (faces.rows[5] >= min_cos)
    return (towards > 0) & (towards >= min_cos * np.sqrt(1 + x * x + y * y))


def crop_as_paper(model: Model, camera_to_world: Floats, sensor: Sensor) -> tuple[Bools, Bools]:
    """Return which faces are left before ray tracing, and which CropNear leaves, (F,) each.

    The paper's own rules: CropFOV keeps a face with any vertex inside the frustum up to maxD;
    CropBack tolerates 20 degrees past edge on, CropNorm limits the incidence, both by the
    optical axis; CropNear drops a face with any vertex nearer than minD. A limit of 90 degrees
    means that CropNorm, which the paper calls optional, is off.
    """
    rotation = camera_to_world[:3, :3]
    x, y, z = rotation.T @ (model.vertices - camera_to_world[:3, 3]).T
    tan_x, tan_y = sensor.intrinsics.tan_half
    depth = -z
    inside = (depth > 0) & (depth <= sensor.max_distance)
    inside &= (np.abs(x) <= tan_x * depth) & (np.abs(y) <= tan_y * depth)
    limit = sensor.max_incidence
    if limit >= math.pi / 2:
        limit = math.pi / 2 + _BACK_TOLERANCE
    turned: Bools = model.normals @ camera_to_world[:3, 2] >= math.cos(limit)
    kept = inside[model.faces].any(axis=1) & turned & (model.areas > 0)
    far_enough = (depth >= sensor.min_distance)[model.faces]
    return kept, np.all(far_enough, axis=1)


def unhidden(
    faces: CameraFaces,
    depth_buffer: NDArray[np.float32],
    along_axis: Callable[[NDArray[np.float32]], Floats],
    tan_half: Floats,
) -> Bools:
    """Return which centres nothing hides, (n,) bool, by a depth buffer.

    The depth at the centre's pixel is that of the pixel's own middle, so it is compared with the
    face's plane there, not with the centre: a slanted face does not hide itself. Something hides
    a centre when it is nearer by more than a pixel is wide there, the bulge of a neighbour that
    the pixel may show instead; so the map comes closer to the truth with every pixel.

    Parameters
    ----------
    faces : CameraFaces
        Faces whose centres lie inside the image.
    depth_buffer : (H, W) float32
        Of the same camera, row 0 at the top.
    along_axis : callable
        Turns values of the buffer into distances along the optical axis, scene unit.
    tan_half : (2,) float64
        Tangents of the image's half angles.
    """
    height, width = depth_buffer.shape
    scale_x, scale_y = width / (2 * tan_half[0]), -height / (2 * tan_half[1])  # row 0 on top
    x, y = faces.tangent
    column = np.clip(x * scale_x + width / 2, 0, width - 1).astype(np.intp)
    row = np.clip(y * scale_y + height / 2, 0, height - 1).astype(np.intp)
    at_centre = faces.towards(x, y)
    at_pixel = faces.towards(
        (column + (0.5 - width / 2)) / scale_x, (row + (0.5 - height / 2)) / scale_y
    )
    # Nearly edge on, the plane runs away within the pixel: it is believed to half the depth.
    at_pixel = np.where(np.abs(at_pixel) > 0.5 * np.abs(at_centre), at_pixel, 2 * at_centre)
    at_pixel[at_pixel == 0] = 1.0  # edge on from the centre itself
    plane = faces.depth * np.clip(at_centre / at_pixel, 0.5, 1.0)
    pixel = faces.depth * centre_tolerance((width, height), tan_half)
    return along_axis(depth_buffer[row, column]) >= plane - pixel


def centre_tolerance(resolution: tuple[int, int], tan_half: Floats) -> float:
    """Return the share of its depth by which something must be nearer to hide a centre."""
    return 2 * _TOLERANCE * max(float(tan_half[k]) / resolution[k] for k in range(2))
