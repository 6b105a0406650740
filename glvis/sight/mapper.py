"""From poses to visibility maps: the steps of Sec. 2.1 in order, for one model.

CropFOV, CropBack and CropNear leave clusters of faces out; then either points of faces are asked
about, each decided by the planes of what may hide it (``caster`` on the GPU, ``points`` in NumPy),
or the ID buffer of a render is the map: its depth test is the ray tracing, and its shader refuses
by incidence and distance (CropNorm, CropNear).
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from glvis.inputs.scene import Model
from glvis.inputs.sensor import Sensor
from glvis.sight.clusters import Clusters
from glvis.sight.coincident import Coincident
from glvis.sight.crops import (
    CameraFaces,
    corners_in_camera,
    crop_as_paper,
    crop_points,
    faces_sensor,
    in_camera,
    parts_in_camera,
)
from glvis.sight.culling import Chosen
from glvis.sight.points import LARGE, Question, beside, grid_size, reaches, spans, unhidden
from glvis.sight.renderer import Renderer, Selection, pixels_of_faces
from glvis.sight.surface import Surface
from glvis.sight.views import NEAREST, Views
from glvis.sight.visibility import VisibilityOptions, asks_about_points, render_resolution

Floats = NDArray[np.float64]
Bools = NDArray[np.bool_]


class Mapper:
    """Makes the visibility maps of one model.

    Parameters
    ----------
    model : Model
        What is counted.
    obstacles : sequence of Surface
        What only hides, on the GPU already; made with the same ``origin``.
    options : VisibilityOptions
        What counts as visible.
    origin : (3,) float64
        World point near the scene that float32 positions are relative to.
    renderer_of : callable
        Returns the renderer of a resolution (width, height).
    casts : bool
        Whether points are asked about on the GPU; see ``selftest.can_cast``.
    """

    def __init__(
        self,
        model: Model,
        obstacles: Sequence[Surface],
        options: VisibilityOptions,
        origin: Floats,
        renderer_of: Callable[[tuple[int, int]], Renderer],
        *,
        casts: bool,
    ) -> None:
        self.model, self.options, self.origin = model, options, origin
        self.surface = Surface(Clusters.of(model), origin, is_target=True)
        self._table = self.surface.clusters.table
        self._obstacles = obstacles
        self._renderer_of = renderer_of
        # the paper's semantics drops faces one by one before they can hide anything
        self._casts = casts and asks_about_points(options) and options.occlusion == "physical"
        self._large = LARGE if options.criterion == "pixels" else None
        self._questions: dict[Sensor, Question] = {}

    def release(self) -> None:
        """Give the GPU's memory back."""
        self.surface.release()

    def question(self, sensor: Sensor) -> Question | None:
        """Return what a ``Caster`` is asked; None where ``visible`` makes a sensor's maps."""
        if not self._casts:
            return None
        if sensor not in self._questions:
            self._questions[sensor] = Question(
                self.surface,
                [self.surface, *self._obstacles],
                grid_size(sensor, self.model),
                self._large,
            )
        return self._questions[sensor]

    def visible(self, views: Views, sensor: Sensor, chosen: Mapping[Surface, Chosen]) -> Bools:
        """Return which faces each view sees, (N, F) bool.

        Parameters
        ----------
        views : Views
            Of N poses, their clip planes around all that is drawn.
        sensor : Sensor
            Whose views they are.
        chosen : mapping
            What the views keep of this model and the obstacles.
        """
        if self.options.semantics == "paper":
            return self._by_paper(views, sensor)
        if asks_about_points(self.options):
            return self._by_points(views, sensor, chosen)
        return self._by_pixels(views, sensor, chosen)

    def _by_pixels(self, views: Views, sensor: Sensor, chosen: Mapping[Surface, Chosen]) -> Bools:
        """Return the faces whose ID shows in enough pixels (the paper's sweeping strategy)."""
        options = self.options
        targets, candidates = chosen[self.surface]
        if options.occlusion == "paper":  # backs hide nothing
            targets = Selection(self.surface, candidates)
        resolution = render_resolution(options, sensor)
        assert resolution is not None
        renderer = self._renderer_of(resolution)
        selections = [targets]
        if self._coincident.is_two_sided:
            selections = [
                replace(targets, sides="front"),
                replace(targets, sides="back", recedes=True),
            ]
        selections += [replace(chosen[one].to_draw, recedes=True) for one in self._obstacles]
        visible = np.zeros((len(views), self.model.n_faces), dtype=bool)
        hides = options.occlusion == "physical"
        for first, images in renderer.id_images(
            views, selections, origin=self.origin, refused_hide=hides
        ):
            for view, image in enumerate(images, start=first):
                pixels = pixels_of_faces(image, self.model.n_faces)
                if len(self._coincident):
                    pose = views.camera_to_world[view]
                    pixels += self._coincident.pixels_shared(image, self.model, sensor, pose)
                visible[view] = pixels >= options.min_pixels
        return visible

    @cached_property
    def _coincident(self) -> Coincident:
        return Coincident.of(self.model)

    def _by_points(self, views: Views, sensor: Sensor, chosen: Mapping[Surface, Chosen]) -> Bools:
        """Return the faces of which a point passes every filter and is hidden by nothing."""
        clusters = self.surface.clusters
        by_axis = self.options.incidence == "axis"
        visible = np.zeros((len(views), self.model.n_faces), dtype=bool)
        for view, (seen, pose) in enumerate(zip(visible, views.camera_to_world, strict=True)):
            places = clusters.places_in(chosen[self.surface].candidates[view])
            faces = in_camera(self._table, places, pose)
            hiding: NDArray[np.integer] = clusters.order[
                clusters.places_in(chosen[self.surface].to_draw.mask[view])
            ]
            if self.options.occlusion == "paper":
                # what CropBack and CropNorm refuse is gone before anything is hidden
                hiding = faces.index[faces_sensor(faces, sensor, by_axis=by_axis)]
            triangles = [corners_in_camera(self.model, hiding, pose)]
            for obstacle in self._obstacles:
                order = obstacle.clusters.order
                some = obstacle.clusters.places_in(chosen[obstacle].to_draw.mask[view])
                triangles.append(corners_in_camera(obstacle.clusters.model, order[some], pose))
            occluders = np.concatenate(triangles, axis=2)
            _mark(seen, faces[crop_points(faces, sensor, by_axis=by_axis)], occluders, sensor)
            for n in (self._large.few, self._large.many) if self._large else ():
                closer = self._closer(n, places, seen, pose, sensor)
                parts = parts_in_camera(self._table, self.model, closer, pose, n)
                _mark(seen, parts[crop_points(parts, sensor, by_axis=by_axis)], occluders, sensor)
        return visible

    def _closer(
        self, n: int, places: NDArray[np.integer], seen: Bools, pose: Floats, sensor: Sensor
    ) -> NDArray[np.integer]:
        """Return which of some faces that are not seen (F,) are looked at in n x n points."""
        assert self._large is not None
        index = self._table.index.take(places)
        looks = pose[:3, 3] @ self._table.normals.take(places, axis=1) > self._table.offsets[places]
        looks &= ~seen[index]
        places, index = places[looks], index[looks]
        corners = corners_in_camera(self.model, index, pose)
        tan_half = np.array(sensor.intrinsics.tan_half)[:, None]
        working_range = np.array([[sensor.min_distance], [sensor.max_distance]])
        kept = reaches(corners, tan_half, working_range)
        places, index, corners = places[kept], index[kept], corners[..., kept]
        shares = spans(corners, tan_half, NEAREST * sensor.max_distance)
        touches = beside(self.surface.clusters, seen[None], np.zeros(len(index), dtype=int), index)
        return places[self._large.are_looked_at(n, shares, touches)]

    def _by_paper(self, views: Views, sensor: Sensor) -> Bools:
        """Return the paper's own map: its filters, then one ray to each centre that is left."""
        visible = np.zeros((len(views), self.model.n_faces), dtype=bool)
        for seen, pose in zip(visible, views.camera_to_world, strict=True):
            kept, far_enough = crop_as_paper(self.model, pose, sensor)
            faces = in_camera(self._table, np.flatnonzero(kept[self._table.index]), pose)
            triangles = [corners_in_camera(self.model, np.flatnonzero(kept), pose)]
            for obstacle in self._obstacles:
                clusters = obstacle.clusters
                triangles.append(corners_in_camera(clusters.model, clusters.order, pose))
            _mark(seen, faces, np.concatenate(triangles, axis=2), sensor)
            seen &= far_enough
        return visible


def _mark(seen: Bools, faces: CameraFaces, occluders: Floats, sensor: Sensor) -> None:
    """Mark the faces (F,) bool, in place, of which a point is not hidden by (3, 3, T) triangles."""
    points = np.concatenate([faces.tangent * faces.depth, faces.depth[None]])
    seen[faces.index[unhidden(points, occluders, NEAREST * sensor.max_distance)]] = True
