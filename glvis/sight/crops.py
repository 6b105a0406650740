"""The paper's filters on single points of faces (Sec. 2.1.1), in NumPy.

Shaders have the same filters for pixels, and for points where they are asked about on the GPU.
Coordinates are kept one row each, (rows, n): taking columns of long rows, and multiplying them
by a 3 x 3 matrix, is many times faster than the same on rows of three.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from glvis.inputs.scene import Model
from glvis.inputs.sensor import Sensor
from glvis.sight.clusters import FaceTable

Floats = NDArray[np.float64]
Bools = NDArray[np.bool_]
Indices = NDArray[np.integer]

# Sec. 2.1.1, CropBack: back faces are tolerated up to 20 degrees past edge on.
_BACK_TOLERANCE = math.radians(20)


@dataclass(frozen=True, eq=False)
class CameraFaces:
    """Points of some faces as one camera has them: n points before it, in the camera frame.

    Attributes
    ----------
    index : (n,) int
        Face indices of the model; the points are centres of mass, or several a face.
    rows : (6, n) float64
        x and y of the point over its depth; its depth, the distance along the optical axis in
        scene units; x, y and z of the face's unit normal.
    """

    index: Indices
    rows: Floats

    def __getitem__(self, chosen: Bools) -> CameraFaces:
        columns = np.flatnonzero(chosen)
        return CameraFaces(self.index.take(columns), self.rows.take(columns, axis=1))

    @property
    def tangent(self) -> Floats:
        """The points in the image plane at unit distance, (2, n)."""
        return self.rows[:2]

    @property
    def depth(self) -> Floats:
        """Distances of the points along the optical axis, (n,)."""
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


def corners_in_camera(model: Model, index: Indices, camera_to_world: Floats) -> Floats:
    """Return the corners of some faces (n,) of a model: corner, coordinate, face, (3, 3, n).

    Coordinates are x right, y up, and depth along the optical axis, scene unit.
    """
    faces: NDArray[np.integer] = model.faces[index]
    to_camera = camera_to_world[:3, :3].T * np.array([[1.0], [1.0], [-1.0]])
    vertices = model.vertices
    if len(index) < model.n_faces // 4:  # else all are worth moving
        used, faces = np.unique(faces, return_inverse=True)
        vertices, faces = vertices[used], faces.reshape(-1, 3)
    places = to_camera @ (vertices - camera_to_world[:3, 3]).T
    return np.moveaxis(places[:, faces.T], 0, 1)


def parts_in_camera(
    table: FaceTable,
    model: Model,
    columns: Indices,
    camera_to_world: Floats,
    n: int,
) -> CameraFaces:
    """Return the centres of mass of the n x n congruent parts of some faces.

    Those before the camera, in its frame.

    Parameters
    ----------
    table : FaceTable
        Faces of the model in the world frame.
    model : Model
        The faces' corners.
    columns : (n,) int
        Which of the table.
    camera_to_world : (4, 4) float64
        The pose.
    n : int
        Parts along a side.
    """
    corners = corners_in_camera(model, table.index.take(columns), camera_to_world)
    normals = camera_to_world[:3, :3].T @ table.normals.take(columns, axis=1)
    points = np.einsum("pk,kcn->cnp", part_weights(n), corners).reshape(3, -1)
    rows = np.concatenate([points, np.repeat(normals, n * n, axis=1)])
    index = np.repeat(table.index.take(columns), n * n)
    before = np.flatnonzero(rows[2] > 0)
    index, rows = index[before], rows[:, before]
    rows[:2] /= rows[2]
    return CameraFaces(index, rows)


def part_weights(n: int) -> Floats:
    """Return the centres of mass of a triangle's n x n congruent parts, (n * n, 3) barycentric."""
    v, u = np.divmod(np.arange(n * n), n)
    uv = np.stack([u, v], axis=1).astype(float)
    # parts of a parallelogram; the half beyond the face folds back into it
    uv = np.where((u + v < n)[:, None], uv + 1 / 3, n - 1 - uv + 2 / 3) / n
    return np.concatenate([1 - uv.sum(axis=1, keepdims=True), uv], axis=1)


def crop_points(faces: CameraFaces, sensor: Sensor, *, by_axis: bool) -> Bools:
    """Return which faces pass CropFOV, CropBack, CropNorm and CropNear by their point, (n,).

    The incidence is that of the true ray to the point, or of the optical axis.
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
