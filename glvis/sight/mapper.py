"""From poses to visibility maps: the steps of Sec. 2.1 in order, for one model.

CropFOV and CropBack leave clusters of faces out of the draw; the draw's depth test is the ray
tracing; the shader refuses by incidence and distance (CropNorm, CropNear); what is left in the
ID buffer is the map. The criterion "centroid" draws depth alone and tests every face's centre
against it.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence

import numpy as np
from numpy.typing import NDArray

from glvis.inputs.scene import Model
from glvis.inputs.sensor import Sensor
from glvis.sight.caster import Caster, Rules, can_hold
from glvis.sight.clusters import Clusters
from glvis.sight.crops import (
    CameraFaces,
    FaceTable,
    centre_tolerance,
    crop_as_paper,
    crop_centroids,
    faces_sensor,
    in_camera,
    unhidden,
)
from glvis.sight.renderer import (
    NEAREST,
    Selection,
    Views,
    depth_along_axis,
    faces_in_images,
)
from glvis.sight.surface import Surface
from glvis.sight.visibility import VisibilityOptions, render_resolution, takes_second_look

Floats = NDArray[np.float64]
Bools = NDArray[np.bool_]

# Far plane as a share of maxD: nothing that is in range is hidden by what lies beyond.
_FARTHEST = 2.0
# Centres looked at together: so many that NumPy's own overhead does not count, and so few that
# what is computed of them stays in a core's cache.
_AT_ONCE = 8192
# In the paper's semantics the image is widened to the centres of all faces that are left,
# with a margin against rounding; wider than this tangent (87 degrees) no image is drawn.
_MARGIN, _WIDEST = 1.001, 20.0


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
    caster_of : callable
        Returns the caster of a resolution (width, height), with its renderer.
    casts : bool
        Whether small faces are cast; see ``Caster`` and ``selftest.can_cast``.
    """

    def __init__(
        self,
        model: Model,
        obstacles: Sequence[Surface],
        options: VisibilityOptions,
        origin: Floats,
        caster_of: Callable[[tuple[int, int]], Caster],
        *,
        casts: bool,
    ) -> None:
        self._casts = casts
        self.model, self.options, self.origin = model, options, origin
        self.surface = Surface(Clusters.of(model), origin, is_target=True)
        self._table = FaceTable.of(model, self.surface.clusters.order)
        self._obstacles = obstacles
        self._caster_of = caster_of
        self._corners = np.concatenate(  # of all boxes, (8 B, 3)
            [surface.clusters.corners for surface in (self.surface, *obstacles)]
        )

    def release(self) -> None:
        """Give the GPU's memory back."""
        self.surface.release()

    def visible(self, camera_to_world: Floats, sensor: Sensor) -> Bools:
        """Return which faces each pose of a sensor sees, (N, F) bool.

        Parameters
        ----------
        camera_to_world : (N, 4, 4) float64
            Poses.
        sensor : Sensor
            The model of all N.
        """
        if self.options.semantics == "paper":
            return self._by_paper(camera_to_world, sensor)
        size = render_resolution(self.options, sensor, self.model)
        if self._casts and self.options.occlusion == "physical" and can_hold(size):
            return self._by_casting(camera_to_world, sensor, size)
        if self.options.criterion == "centroid":
            return self._by_centroid(camera_to_world, sensor)
        return self._by_pixels(camera_to_world, sensor)

    def _by_casting(self, camera_to_world: Floats, sensor: Sensor, size: tuple[int, int]) -> Bools:
        """Return the faces that either criterion counts, where compute shaders are at hand."""
        options = self.options
        views = self._views(camera_to_world, sensor)
        targets, candidates = _selection(self.surface, views)
        by_pixels = options.criterion == "pixels"
        rules = Rules(
            min_pixels=options.min_pixels if by_pixels else 0,
            by_centre=not by_pixels or takes_second_look(options),
            tolerance=centre_tolerance(size, sensor.intrinsics.tan_half),
        )
        return self._caster_of(size).visible(
            views, targets, candidates, self._hiding(views), rules, origin=self.origin
        )

    def _by_pixels(self, camera_to_world: Floats, sensor: Sensor) -> Bools:
        """Return the faces whose ID shows in enough pixels (the paper's sweeping strategy)."""
        options = self.options
        views = self._views(camera_to_world, sensor)
        faces_only = options.occlusion == "paper"  # then backs hide nothing
        targets, candidates = _selection(self.surface, views, faces_only=faces_only)
        renderer = self._caster_of(render_resolution(options, sensor, self.model)).renderer
        visible = np.zeros((len(views), self.model.n_faces), dtype=bool)
        second_look = takes_second_look(options)
        for first, images in renderer.id_images(
            views,
            [targets, *self._hiding(views)],
            origin=self.origin,
            refused_hide=options.occlusion == "physical",
        ):
            n = len(images)
            visible[first : first + n] = faces_in_images(
                images, self.model.n_faces, options.min_pixels
            )
            if second_look:
                depths = renderer.read_depths(n)
                self._look_again(visible, first, depths, views, candidates, sensor)
        return visible

    def _by_centroid(self, camera_to_world: Floats, sensor: Sensor) -> Bools:
        """Return the faces whose centre passes every filter and is hidden by nothing."""
        views = self._views(camera_to_world, sensor)
        occluders, candidates = _selection(self.surface, views)
        if self.options.occlusion == "paper":
            # what CropBack and CropNorm refuse is gone before anything is hidden
            kept = np.zeros((len(views), self.model.n_faces), dtype=bool)
            for view, pose in enumerate(camera_to_world):
                places = self.surface.clusters.places_in(candidates[view])
                faces = in_camera(self._table, places, pose)
                kept[view, faces.index] = faces_sensor(faces, sensor, by_axis=self._by_axis)
            occluders = _selection_of_faces(self.surface, kept)
        visible = np.zeros((len(views), self.model.n_faces), dtype=bool)
        renderer = self._caster_of(render_resolution(self.options, sensor, self.model)).renderer
        for first, images in renderer.depth_images(
            views, [occluders, *self._hiding(views)], origin=self.origin
        ):
            self._look_again(visible, first, images, views, candidates, sensor)
        return visible

    def _by_paper(self, camera_to_world: Floats, sensor: Sensor) -> Bools:
        """Return the paper's own map: its filters, then one ray to each centre that is left."""
        n = len(camera_to_world)
        kept = np.zeros((n, self.model.n_faces), dtype=bool)
        far_enough = np.zeros_like(kept)
        tan_half = np.tile(sensor.intrinsics.tan_half, (n, 1))
        in_view = []
        for view, pose in enumerate(camera_to_world):
            kept[view], far_enough[view] = crop_as_paper(self.model, pose, sensor)
            faces = in_camera(self._table, np.flatnonzero(kept[view, self._table.index]), pose)
            in_view.append(faces)
            # a face is kept for one vertex in the frustum: its centre may lie outside
            reach = np.abs(faces.tangent).max(axis=1, initial=0) * _MARGIN
            tan_half[view] = np.minimum(np.maximum(tan_half[view], reach), _WIDEST)
        views = self._views(camera_to_world, sensor, tan_half=tan_half)
        renderer = self._caster_of(render_resolution(self.options, sensor, self.model)).renderer
        visible = np.zeros_like(kept)
        for first, images in renderer.depth_images(
            views,
            [_selection_of_faces(self.surface, kept), *self._hiding(views)],
            origin=self.origin,
        ):
            for view, image in enumerate(images, start=first):
                faces = in_view[view]
                visible[view, faces.index] = self._free(faces, image, views, view)
        return visible & far_enough

    def _look_again(
        self,
        visible: Bools,
        first: int,
        depths: NDArray[np.float32],
        views: Views,
        candidates: Bools,
        sensor: Sensor,
    ) -> None:
        """Mark, in place, further faces whose centre is free in view ``first`` and following."""
        for view, depth in enumerate(depths, start=first):
            places = self.surface.clusters.places_in(candidates[view])
            places = places[~visible[view, self._table.index.take(places)]]
            for some in np.array_split(places, len(places) // _AT_ONCE + 1):
                faces = in_camera(self._table, some, views.camera_to_world[view])
                faces = faces[crop_centroids(faces, sensor, by_axis=self._by_axis)]
                free = self._free(faces, depth, views, view)
                visible[view, faces.index[free]] = True

    def _free(
        self, faces: CameraFaces, depth: NDArray[np.float32], views: Views, view: int
    ) -> Bools:
        """Return which centres nothing hides in one view, (n,) bool."""
        return unhidden(
            faces,
            depth,
            lambda d: depth_along_axis(d, views.clip_near[view], views.clip_far[view]),
            views.tan_half[view],
        )

    @property
    def _by_axis(self) -> bool:
        return self.options.incidence == "axis"

    def _views(
        self, camera_to_world: Floats, sensor: Sensor, *, tan_half: Floats | None = None
    ) -> Views:
        """Return what the renderer must know of some poses of a sensor."""
        n = len(camera_to_world)
        if tan_half is None:
            tan_half = np.tile(sensor.intrinsics.tan_half, (n, 1))
        backwards = camera_to_world[:, :3, 2]
        eye = np.sum(backwards * camera_to_world[:, :3, 3], axis=1)
        # of the scene's boxes; summed row by row, so that it does not depend on the others
        depth = eye[:, None] - np.sum(backwards[:, None] * self._corners, axis=2)
        # Planes beyond the scene on both sides cut no face and leave the depth buffer its bits.
        clip_far = np.clip(depth.max(axis=1), sensor.max_distance, _FARTHEST * sensor.max_distance)
        clip_near = np.clip(depth.min(axis=1), NEAREST * sensor.max_distance, clip_far / 2)
        reach = np.full(n, sensor.max_distance)
        min_cos = np.full(n, math.cos(sensor.max_incidence))
        return Views(
            camera_to_world,
            tan_half,
            clip_near / _MARGIN,
            clip_far * _MARGIN,
            np.full(n, sensor.min_distance),
            reach,
            0 * min_cos if self._by_axis else min_cos,
            min_cos if self._by_axis else 0 * min_cos - 2,
        )

    def _hiding(self, views: Views) -> list[Selection]:
        """Return what to draw of the obstacles."""
        return [_selection(obstacle, views)[0] for obstacle in self._obstacles]


def _selection(
    surface: Surface, views: Views, *, faces_only: bool = False
) -> tuple[Selection, Bools]:
    """Return what views draw of a surface, and which clusters (N, C) may have a face to count.

    Drawn is what is in the frusta and can matter. Backs are left out where they hide nothing
    that is not hidden anyway, or with ``faces_only``.
    """
    clusters, planes = surface.clusters, views.planes
    mask = clusters.in_frustum(planes)
    candidates = mask & clusters.may_face(views.eye)
    if faces_only:
        cull_backs = np.ones(len(views), dtype=bool)
    else:
        cull_backs = clusters.hides_back_faces(views.eye, planes)
    mask = np.where(cull_backs[:, None], candidates, mask)
    return Selection(surface, mask, cull_backs), candidates


def _selection_of_faces(surface: Surface, mask: Bools) -> Selection:
    """Return the draw of single faces (N, F) bool, both their sides."""
    return Selection(surface, mask, np.zeros(len(mask), dtype=bool), by_face=True)
