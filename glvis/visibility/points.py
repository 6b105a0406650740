"""The points of faces by which they are judged: centres of mass, and parts of large faces.

A face counts where its centre of mass is free; by the criterion "pixels", where a face is large in
the image, where any of several points of it is.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from glvis.problem.scene import Model
from glvis.problem.visibility_options import VisibilityOptions
from glvis.visibility.clusters import Clusters, FaceTable
from glvis.visibility.filters import CameraFaces, in_camera_frame
from glvis.visibility.occlusion import join_runs

Floats = NDArray[np.float64]
Bools = NDArray[np.bool_]
Indices = NDArray[np.integer]

# Cells that a typical face's side spans at maxD, and cells along the longer side of the image, at
# least and at most. Maps do not depend on them; their time does, and least here, by tools/bench.
_CELLS_A_SIDE, _FEWEST, _MOST = 1.1, 56, 1024


@dataclass(frozen=True)
class Large:
    """When a face is large in the image: it is looked at in points if its centre is not free.

    Points are the centres of mass of its congruent parts, n x n of them. First all large faces are
    looked at in few; then in many those that still show none, but touch a face that does: mostly
    they show a little, too.

    Attributes
    ----------
    least : float
        Share of the image's width or height from which a face is large.
    most : float
        Share from which it is looked at in many points whatever it touches.
    few, many : int
        Parts along a side.
    """

    least: float
    most: float
    few: int = 2
    many: int = 8

    def are_looked_at(self, n: int, shares: Floats, touches: Bools) -> Bools:
        """Return which faces that span some shares of the image are looked at in n x n points."""
        touches = touches | (n == self.few)
        limit: Floats = np.where(touches, self.least, self.most)
        return shares >= limit


# Of faces of which one of 64 points shows, "pixels" leaves out those that are smaller, or touch
# none that shows, and show none of their points: tools/bench.py prints how many.
LARGE = Large(1 / 96, 1 / 16)


def large_faces(options: VisibilityOptions) -> Large | None:
    """Return when a face is large enough for several points; None where only its centre counts."""
    return LARGE if options.criterion == "pixels" else None


def beside(clusters: Clusters, seen: Bools, view: Indices, face: Indices) -> Bools:
    """Return which faces (K,) share a corner with one that the same view sees, (K,) bool.

    Parameters
    ----------
    clusters : Clusters
        Of a model of F faces.
    seen : (N, F) bool
        What N views see.
    view, face : (K,) int
        Which view is asked about which face.
    """
    faces, begin = clusters.around
    corners = clusters.model.faces.take(face, axis=0)
    first = begin.take(corners)
    number = begin.take(corners + 1) - first  # no less than 1: the face itself
    neighbours = faces.take(join_runs(first.ravel(), number.ravel()))
    number = number.sum(axis=1)
    sees = seen[np.repeat(view, number), neighbours]
    shared: Bools = np.logical_or.reduceat(sees, np.cumsum(number) - number) if len(face) else sees
    return shared


def spans(corners: Floats, tan_half: Floats, near: Floats | float) -> Floats:
    """Return the shares of the image's width or height that faces span, the larger one, (n,).

    Infinite for a face that reaches nearer than anything can be seen.

    Parameters
    ----------
    corners : (3, 3, n) float64
        Corner, coordinate, face: x right, y up, and depth along the optical axis, scene unit.
    tan_half : (2, n) or (2, 1) float64
        Tangents of the image's half angles.
    near : float, or (n,) float64
        Depth before which nothing is seen, scene unit.
    """
    depth = corners[:, 2]
    is_before = depth.min(axis=0) >= near
    tangents = corners[:, :2] / np.where(is_before, depth, 1.0)[:, None]
    shares = (np.ptp(tangents, axis=0) / (2 * tan_half)).max(axis=0)
    return np.where(is_before, shares, np.inf)


def grid_size(tan_half: ArrayLike, model: Model, far: float) -> tuple[int, int]:
    """Return cells (columns, rows) about as large as a model's faces at a depth.

    Parameters
    ----------
    tan_half : (2,) float
        Tangents of the half angles of the image that they divide.
    model : Model
        The faces.
    far : float
        The depth, scene unit.
    """
    tan_x, tan_y = np.asarray(tan_half).tolist()
    longer = max(tan_x, tan_y)
    areas = model.areas[model.areas > 0]
    # of needles, many lie side by side where one edge reaches
    side = min(model.mean_edge, math.sqrt(2 * float(np.median(areas))))
    focal = _CELLS_A_SIDE * far / side
    focal = min(max(focal, _FEWEST / 2 / longer), _MOST / 2 / longer)
    return math.ceil(2 * focal * tan_x), math.ceil(2 * focal * tan_y)


def centres_in_camera(table: FaceTable, columns: Indices, camera_to_world: Floats) -> CameraFaces:
    """Return some faces by their centres.

    Parameters
    ----------
    table : FaceTable
        Faces in the world frame.
    columns : (n,) int
        Which of the table.
    camera_to_world : (4, 4) float64
        The pose.
    """
    centres = in_camera_frame(table.centroids.take(columns, axis=1), camera_to_world)
    normals = camera_to_world[:3, :3].T @ table.normals.take(columns, axis=1)
    return CameraFaces(table.index.take(columns), centres[:, None], normals)


def corners_in_camera(model: Model, index: Indices, camera_to_world: Floats) -> Floats:
    """Return the corners of some faces (n,) of a model: corner, coordinate, face, (3, 3, n).

    Coordinates are x right, y up, and depth along the optical axis, scene unit.
    """
    faces: NDArray[np.integer] = model.faces[index]
    vertices = model.vertices
    if len(index) < model.n_faces // 4:  # else all are worth moving
        used, faces = np.unique(faces, return_inverse=True)
        vertices, faces = vertices[used], faces.reshape(-1, 3)
    places = in_camera_frame(vertices.T, camera_to_world)
    return np.moveaxis(places[:, faces.T], 0, 1)


def parts_in_camera(
    table: FaceTable, model: Model, columns: Indices, camera_to_world: Floats, n: int
) -> CameraFaces:
    """Return some faces by the centres of mass of their n x n congruent parts.

    Parameters
    ----------
    table : FaceTable
        Faces of the model in the world frame.
    model : Model
        The faces' corners.
    columns : (K,) int
        Which of the table.
    camera_to_world : (4, 4) float64
        The pose.
    n : int
        Parts along a side.
    """
    corners = corners_in_camera(model, table.index.take(columns), camera_to_world)
    normals = camera_to_world[:3, :3].T @ table.normals.take(columns, axis=1)
    parts = np.einsum("pk,kcn->cnp", part_weights(n), corners).reshape(3, 1, -1)
    index = np.repeat(table.index.take(columns), n * n)
    return CameraFaces(index, parts, np.repeat(normals, n * n, axis=1))


def part_weights(n: int) -> Floats:
    """Return the centres of mass of a triangle's n x n congruent parts, (n * n, 3) barycentric."""
    v, u = np.divmod(np.arange(n * n), n)
    uv = np.stack([u, v], axis=1).astype(float)
    # parts of a parallelogram; the half beyond the face folds back into it
    uv = np.where((u + v < n)[:, None], uv + 1 / 3, n - 1 - uv + 2 / 3) / n
    return np.concatenate([1 - uv.sum(axis=1, keepdims=True), uv], axis=1)
