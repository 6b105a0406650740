"""The paper's own visibility analysis, Figs. 2 and 9 from top to bottom, in NumPy and float64.

``semantics = "paper"``: what each step refuses is gone before the next one looks, so that it hides
nothing either. One ray goes to the centre of mass of each face that is left: the paper's centroid
strategy.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from glvis.problem.scene import Model
from glvis.problem.visibility_options import VisibilityOptions
from glvis.visibility.culling import Culled
from glvis.visibility.filters import (
    Limits,
    crop_back,
    crop_fov,
    crop_near,
    crop_norm,
    faces_in_camera,
    in_camera_frame,
)
from glvis.visibility.gpu_scene import GpuScene
from glvis.visibility.occlusion import unhidden
from glvis.visibility.points import corners_in_camera
from glvis.visibility.views import Views

Floats = NDArray[np.float64]
Bools = NDArray[np.bool_]


def paper_map(
    model: Model,
    obstacles: Sequence[Model],
    camera_to_world: Floats,
    limits: Limits,
    near: float = 0.0,
) -> Bools:
    """Return which faces of a model a sensor sees by the paper's rules, (F,) bool: a row of the VM.

    Parameters
    ----------
    model : Model
        F faces that are counted.
    obstacles : sequence of Model
        What only hides (the paper's obstacle model).
    camera_to_world : (4, 4) float64
        The pose.
    limits : Limits
        Of the sensor, under ``VisibilityOptions.paper()``.
    near : float
        Depth before which nothing hides, scene unit; the paper has no such plane.
    """
    faces = faces_in_camera(model, camera_to_world, VisibilityOptions.paper())
    x, y, depth = faces.points  # of the corners
    heights, axis_cos = faces.heights, faces.normals[2]
    # 1. CropFOV: a face stays that has any vertex in the frustum, up to maxD
    kept = crop_fov(x, y, depth, limits).any(axis=0) & (model.areas > 0)
    # 2. CropBack: and does not look away
    kept &= crop_back(heights, axis_cos, limits)
    # 3. CropNorm: and is not too oblique for the sensor, which makes it the RGB-D filter, too
    kept &= crop_norm(heights, faces.distances_squared, axis_cos, limits)
    # 4. Ray tracing to the centres, among what is left and all obstacles
    seen = np.zeros(model.n_faces, dtype=bool)
    left = np.flatnonzero(kept)
    corners = corners_in_camera(model, left, camera_to_world)
    centres = in_camera_frame(model.centroids[left].T, camera_to_world)
    before = centres[2] > 0
    triangles = [corners]
    for obstacle in obstacles:
        triangles.append(corners_in_camera(obstacle, np.arange(obstacle.n_faces), camera_to_world))
    seen[left[before]] = unhidden(centres[:, before], np.concatenate(triangles, axis=2), near)
    # 5. CropNear: what has a vertex nearer than minD is not seen, though it did hide
    return seen & crop_near(depth, limits).all(axis=0)


def visible(
    scene: GpuScene, views: Views, culled: Culled, options: VisibilityOptions
) -> list[Bools]:
    """Return which faces of each model views see, (N, F) bool each; nothing needs the cull."""
    obstacles = [obstacle.clusters.model for obstacle in scene.obstacles]
    found = []
    for target in scene.targets:
        model = target.clusters.model
        visible = np.zeros((len(views), model.n_faces), dtype=bool)
        for seen, pose, near in zip(
            visible, views.camera_to_world, views.windows.near, strict=True
        ):
            seen[:] = paper_map(model, obstacles, pose, views.limits, near)
        found.append(visible)
    return found
