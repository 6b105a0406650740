"""Maps by exact rays to points of faces, in NumPy and float64: the reference of ``cast``.

Used where the driver has no compute shaders or gives up on a face, and for ``occlusion = "paper"``.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from glvis.problem.visibility_options import VisibilityOptions
from glvis.visibility.culling import Culled
from glvis.visibility.filters import CameraFaces, face_camera, may_pass, pass_filters
from glvis.visibility.gpu_scene import GpuScene
from glvis.visibility.occlusion import unhidden
from glvis.visibility.points import (
    Large,
    beside,
    centres_in_camera,
    corners_in_camera,
    large_faces,
    parts_in_camera,
    spans,
)
from glvis.visibility.surface import Surface
from glvis.visibility.views import Views

Floats = NDArray[np.float64]
Bools = NDArray[np.bool_]
Indices = NDArray[np.integer]


def visible(
    scene: GpuScene, views: Views, culled: Culled, options: VisibilityOptions
) -> list[Bools]:
    """Return which faces of each model views see, (N, F) bool each.

    Parameters
    ----------
    scene : GpuScene
        Models and what hides them.
    views : Views
        N poses of a sensor.
    culled : Culled
        What they keep of the scene.
    options : VisibilityOptions
        What counts as visible.
    """
    return [visible_of(scene, target, views, culled, options) for target in scene.targets]


def visible_of(
    scene: GpuScene, target: Surface, views: Views, culled: Culled, options: VisibilityOptions
) -> Bools:
    """Return the faces of one model of which a point passes every filter and nothing hides it."""
    clusters = target.clusters
    model, table = clusters.model, clusters.table
    large = large_faces(options)
    visible = np.zeros((len(views), model.n_faces), dtype=bool)
    for view, (seen, pose) in enumerate(zip(visible, views.camera_to_world, strict=True)):
        places = clusters.places_in(culled.countable[view, scene.columns[target]])
        eyes = [
            _Eye.of(scene, target, one, kept, view, options)
            for one, kept in zip(views.viewpoints, culled.viewpoints, strict=True)
        ]
        faces = centres_in_camera(table, places, pose)
        _mark(seen, faces, eyes)
        if large is None:
            continue
        for n in (large.few, large.many):
            several = _unseen_large(large, n, places, target, seen, view, views)
            _mark(seen, parts_in_camera(table, model, several, pose, n), eyes)
    return visible


@dataclass(frozen=True, eq=False)
class _Eye:
    """One optical centre of one view, and what hides from it.

    Attributes
    ----------
    views : Views
        The view is one of them.
    triangles : list of (3, 3, T) float64
        What may hide something in each window, in its frame: see ``unhidden``.
    near : float
        Depth before which nothing hides, scene unit.
    """

    views: Views
    triangles: list[Floats]
    near: float

    @classmethod
    def of(
        cls,
        scene: GpuScene,
        target: Surface,
        views: Views,
        culled: Culled,
        view: int,
        options: VisibilityOptions,
    ) -> _Eye:
        """Return the optical centre of one of some views."""
        clusters = target.clusters
        kept: Indices | None = None
        if options.occlusion == "paper":
            # what CropBack and CropNorm refuse is gone before anything is hidden
            places = clusters.places_in(culled.countable[view, scene.columns[target]])
            faces = centres_in_camera(clusters.table, places, views.camera_to_world[view])
            may_hide = face_camera(faces, views.limits)
            if views.is_straight:
                may_hide &= faces.points[2, 0] > 0
            kept = faces.index[may_hide]
        triangles = []
        first = view * views.per_view
        for row in range(first, first + views.per_view):
            pose, in_window = views.windows.camera_to_world[row], []
            for surface in (target, *scene.obstacles):
                some = surface.clusters.places_in(culled.occludes[row, scene.columns[surface]])
                hiding: Indices = surface.clusters.order[some]
                if surface is target and kept is not None:
                    hiding = kept
                in_window.append(corners_in_camera(surface.clusters.model, hiding, pose))
            triangles.append(np.concatenate(in_window, axis=2))
        return cls(views, triangles, float(views.windows.near[first]))

    def sees(self, faces: CameraFaces) -> Bools:
        """Return of which faces, in the sensor's own camera frame, the point is seen, (n,)."""
        if self.views.first_to_camera is not None:
            faces = faces.moved(self.views.first_to_camera)
        some = np.flatnonzero(pass_filters(faces, self.views.limits))
        seen = np.zeros(len(faces.index), dtype=bool)
        turns = self.views.limits.lens.windows.window_to_camera
        tan_x, tan_y = self.views.windows.tan_half
        flip = np.array([[1.0], [1.0], [-1.0]])  # between depth and the way back
        for turn, triangles in zip(turns, self.triangles, strict=True):
            x, y, depth = points = flip * (turn.T @ (flip * faces.points[:, 0, some]))
            inside = (depth > 0) & (np.abs(x) <= tan_x * depth) & (np.abs(y) <= tan_y * depth)
            inside = np.flatnonzero(inside)
            seen[some[inside]] = unhidden(points.take(inside, axis=1), triangles, self.near)
        return seen


def _unseen_large(
    large: Large,
    n: int,
    places: Indices,
    target: Surface,
    seen: Bools,
    view: int,
    views: Views,
) -> Indices:
    """Return which of some faces that are not seen (F,) are judged by n x n points."""
    table, model = target.clusters.table, target.clusters.model
    index = table.index.take(places)
    eye = views.eye[view]
    looks = eye @ table.normals.take(places, axis=1) > table.offsets[places]
    looks &= ~seen[index]
    places, index = places[looks], index[looks]
    shares = np.zeros(len(index))
    windows, first = views.windows, view * views.per_view
    for row in range(first, first + views.per_view):
        corners = corners_in_camera(model, index, windows.camera_to_world[row])
        tan_half = windows.tan_half[:, None]
        kept = np.flatnonzero(may_pass(corners, tan_half, np.array(views.depth_range)[:, None]))
        some = spans(corners[..., kept], tan_half, windows.near[row])
        shares[kept] = np.maximum(shares[kept], some)
    touches = beside(target.clusters, seen[None], np.zeros(len(index), dtype=int), index)
    return places[large.are_looked_at(n, shares, touches)]


def _mark(seen: Bools, faces: CameraFaces, eyes: Sequence[_Eye]) -> None:
    """Mark the faces (F,) bool, in place, of which all optical centres see a point."""
    for eye in eyes:
        faces = faces[eye.sees(faces)]
    seen[faces.index] = True


def seen_by_partner(
    image: NDArray[np.uint32],
    rays: Floats | None,
    scene: GpuScene,
    target: Surface,
    views: Views,
    culled: Culled,
    view: int,
    options: VisibilityOptions,
) -> NDArray[np.uint32]:
    """Return an ID image (H, W) without the pixels whose point the second viewpoint does not see.

    A pixel's point is where its ray meets the plane of the face that shows: by the middle of the
    pixel, or by ``rays`` (3, H * W). Of faces that enough pixels show already, some pixels are left
    unasked.
    """
    partner, kept = views.viewpoints[1], culled.viewpoints[1]
    model = target.clusters.model
    height, width = image.shape
    ids = image.ravel().astype(np.intp)
    pixels = np.flatnonzero(ids)
    faces, pose = ids[pixels] - 1, views.camera_to_world[view]
    if rays is None:
        row, column = np.divmod(pixels, width)
        ray = views.limits.lens.directions((column + 0.5) / width, (row + 0.5) / height)
    else:
        ray = rays[:, pixels]
    normals = pose[:3, :3].T @ model.normals[faces].T
    centres = pose[:3, :3].T @ (model.centroids[faces] - pose[:3, 3]).T
    flip = np.array([[1.0], [1.0], [-1.0]])
    along = np.sum(normals * centres, axis=0) / np.sum(normals * flip * ray, axis=0)
    shown = CameraFaces(faces, (along * ray)[:, None], normals)
    eye = _Eye.of(scene, target, partner, kept, view, options)
    # first so many pixels of each face as must show it, then all of those that still want some
    order = np.argsort(faces, kind="stable")
    rank = np.zeros(len(faces), dtype=np.intp)
    starts = np.flatnonzero(np.diff(faces[order], prepend=-1))
    rank[order] = np.arange(len(faces)) - np.repeat(starts, np.diff(starts, append=len(faces)))
    free = np.zeros(len(faces), dtype=bool)
    first = rank < options.min_pixels
    free[first] = eye.sees(shown[first])
    found = np.bincount(faces[free], minlength=model.n_faces) >= options.min_pixels
    rest = ~first & ~found[faces]
    free[rest] = eye.sees(shown[rest])
    left = np.zeros_like(image)
    left.reshape(-1)[pixels[free]] = ids[pixels[free]]
    return left
