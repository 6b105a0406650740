"""The paper's filters on single faces (Sec. 2.1.1), in NumPy, for the criterion "centroid".

The pixels criterion has the same filters in its shader; here they act on centres of mass.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from glvis.scene import Model
from glvis.sensor import Sensor

Floats = NDArray[np.float64]
Bools = NDArray[np.bool_]

# Sec. 2.1.1, CropBack: back faces are tolerated up to 20 degrees past edge on.
_BACK_TOLERANCE = math.radians(20)


@dataclass(frozen=True, eq=False)
class CameraFaces:
    """Some faces as one camera has them: n faces in the camera frame, depths positive.

    Attributes
    ----------
    index : (n,) int
        Face indices of the model.
    tangent : (n, 2) float64
        x and y of the centre of mass over its depth.
    depth : (n,) float64
        Distance of the centre of mass along the optical axis, scene unit.
    normal : (n, 3) float64
        Unit normals, camera frame.
    """

    index: NDArray[np.integer]
    tangent: Floats
    depth: Floats
    normal: Floats

    def __getitem__(self, chosen: Bools) -> CameraFaces:
        return CameraFaces(
            self.index[chosen], self.tangent[chosen], self.depth[chosen], self.normal[chosen]
        )


def in_camera(model: Model, index: NDArray[np.integer], camera_to_world: Floats) -> CameraFaces:
    """Return those of some faces whose centres lie before a camera, in its frame.

    Parameters
    ----------
    model : Model
        In the world frame.
    index : (n,) int
        Face indices.
    camera_to_world : (4, 4) float64
        The pose.
    """
    rotation = camera_to_world[:3, :3]
    centre = (model.centroids[index] - camera_to_world[:3, 3]) @ rotation
    depth = -centre[:, 2]
    before = depth > 0
    if not before.all():
        index, centre, depth = index[before], centre[before], depth[before]
    return CameraFaces(
        index, centre[:, :2] / depth[:, None], depth, model.normals[index] @ rotation
    )


def crop_centroids(faces: CameraFaces, sensor: Sensor, *, by_axis: bool) -> Bools:
    """Return which faces pass CropFOV, CropBack, CropNorm and CropNear by their centre, (n,).

    The incidence is that of the true ray to the centre, or of the optical axis.
    """
    tan_x, tan_y = sensor.intrinsics.tan_half
    x, y = faces.tangent.T
    passes = (faces.depth >= sensor.min_distance) & (faces.depth <= sensor.max_distance)
    passes &= (np.abs(x) <= tan_x) & (np.abs(y) <= tan_y)
    return passes & faces_sensor(faces, sensor, by_axis=by_axis)


def faces_sensor(faces: CameraFaces, sensor: Sensor, *, by_axis: bool) -> Bools:
    """Return which faces look at the sensor within its limit of incidence, (n,)."""
    x, y = faces.tangent.T
    n_x, n_y, n_z = faces.normal.T
    towards = n_z - n_x * x - n_y * y  # normal . way back to the eye, over the depth
    if by_axis:
        return (towards > 0) & (n_z >= math.cos(sensor.max_incidence))
    min_cos = math.cos(sensor.max_incidence)
    return (towards > 0) & (towards >= min_cos * np.sqrt(1 + x * x + y * y))


def crop_as_paper(model: Model, camera_to_world: Floats, sensor: Sensor) -> tuple[Bools, Bools]:
    """Return which faces are left before ray tracing, and which CropNear leaves, (F,) each.

    The paper's own rules: CropFOV keeps a face with any vertex inside the frustum up to maxD;
    CropBack tolerates 20 degrees past edge on, CropNorm limits the incidence, both by the
    optical axis; CropNear drops a face with any vertex nearer than minD. A limit of 90 degrees
    means that CropNorm, which the paper calls optional, is off.
    """
    rotation = camera_to_world[:3, :3]
    points = (model.vertices - camera_to_world[:3, 3]) @ rotation
    depth = -points[:, 2]
    tan_x, tan_y = sensor.intrinsics.tan_half
    inside = (depth > 0) & (depth <= sensor.max_distance)
    inside &= (np.abs(points[:, 0]) <= tan_x * depth) & (np.abs(points[:, 1]) <= tan_y * depth)
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
    tolerance: float,
) -> Bools:
    """Return which centres nothing hides, (n,) bool, by a depth buffer.

    The depth at the centre's pixel is that of the pixel's own middle, so it is compared with the
    face's plane there, not with the centre: a slanted face does not hide itself.

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
    tolerance : float
        How much nearer than the plane something must be to hide it, scene unit.
    """
    height, width = depth_buffer.shape
    scale = np.array([width, -height]) / (2 * tan_half)  # row 0 is the top row
    middle = np.array([width, height]) / 2
    pixel = (faces.tangent * scale + middle).astype(np.int32)
    column = np.clip(pixel[:, 0], 0, width - 1)
    row = np.clip(pixel[:, 1], 0, height - 1)
    x = (column + 0.5 - middle[0]) / scale[0]
    y = (row + 0.5 - middle[1]) / scale[1]
    n_x, n_y, n_z = faces.normal.T
    at_centre = n_z - n_x * faces.tangent[:, 0] - n_y * faces.tangent[:, 1]
    at_pixel = n_z - n_x * x - n_y * y
    # Edge on, the plane runs away within the pixel: at most half the depth is believed.
    ratio = at_centre / np.where(np.abs(at_pixel) > 1e-12, at_pixel, 1e-12)
    plane = faces.depth * np.clip(ratio, 0.5, 1.5)
    return along_axis(depth_buffer[row, column]) >= np.minimum(plane, faces.depth) - tolerance
