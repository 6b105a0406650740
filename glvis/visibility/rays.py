"""Maps by exact rays to points of faces, in NumPy and float64: the reference of ``cast``.

Used where the driver has no compute shaders or gives up on a face, and for ``occlusion = "paper"``.
"""

from __future__ import annotations

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
        near = views.near[view]
        places = clusters.places_in(culled.countable[view, scene.columns[target]])
        faces = centres_in_camera(table, places, pose)
        triangles = []
        for surface in (target, *scene.obstacles):
            some = surface.clusters.places_in(culled.occludes[view, scene.columns[surface]])
            hiding: Indices = surface.clusters.order[some]
            if surface is target and options.occlusion == "paper":
                # what CropBack and CropNorm refuse is gone before anything is hidden
                hiding = faces.index[face_camera(faces, views.limits)]
            triangles.append(corners_in_camera(surface.clusters.model, hiding, pose))
        occluders = np.concatenate(triangles, axis=2)
        _mark(seen, faces[pass_filters(faces, views.limits)], occluders, near)
        if large is None:
            continue
        for n in (large.few, large.many):
            several = _unseen_large(large, n, places, target, seen, pose, views, near)
            parts = parts_in_camera(table, model, several, pose, n)
            _mark(seen, parts[pass_filters(parts, views.limits)], occluders, near)
    return visible


def _unseen_large(
    large: Large,
    n: int,
    places: Indices,
    target: Surface,
    seen: Bools,
    pose: Floats,
    views: Views,
    near: float,
) -> Indices:
    """Return which of some faces that are not seen (F,) are judged by n x n points."""
    table, model = target.clusters.table, target.clusters.model
    index = table.index.take(places)
    looks = pose[:3, 3] @ table.normals.take(places, axis=1) > table.offsets[places]
    looks &= ~seen[index]
    places, index = places[looks], index[looks]
    corners = corners_in_camera(model, index, pose)
    tan_half, limits = views.tan_half[:, None], views.limits
    kept = may_pass(corners, tan_half, [[limits.min_distance], [limits.max_distance]])
    places, index, corners = places[kept], index[kept], corners[..., kept]
    shares = spans(corners, tan_half, near)
    touches = beside(target.clusters, seen[None], np.zeros(len(index), dtype=int), index)
    return places[large.are_looked_at(n, shares, touches)]


def _mark(seen: Bools, faces: CameraFaces, occluders: Floats, near: float) -> None:
    """Mark the faces (F,) bool, in place, of which a point is not hidden by (3, 3, T) triangles."""
    seen[faces.index[unhidden(faces.points[:, 0], occluders, near)]] = True
