"""From poses to visibility maps: the steps of Sec. 2.1 in order, for one model.

CropFOV and CropBack leave clusters of faces out of the draw; the draw's depth test is the ray
tracing; the shader refuses by incidence and distance (CropNorm, CropNear); what is left in the
ID buffer is the map. The criterion "centroid" draws depth alone and tests every face's centre
against it.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from glvis.inputs.scene import Model
from glvis.inputs.sensor import Sensor
from glvis.sight.caster import Look, can_hold
from glvis.sight.clusters import Clusters
from glvis.sight.coarser import StandIns
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
from glvis.sight.culling import Chosen, Culling
from glvis.sight.renderer import Renderer, Selection, depth_along_axis, faces_in_images
from glvis.sight.surface import Surface
from glvis.sight.views import Views
from glvis.sight.visibility import VisibilityOptions, render_resolution, takes_second_look
from glvis.sight.worklist import Rules

Floats = NDArray[np.float64]
Bools = NDArray[np.bool_]

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
    renderer_of : callable
        Returns the renderer of a resolution (width, height).
    casts : bool
        Whether small faces are cast; see ``Caster`` and ``selftest.can_cast``.
    stand_ins : StandIns
        What hides centres in place of surfaces of many faces.
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
        stand_ins: StandIns,
    ) -> None:
        self._casts, self._stand_ins = casts, stand_ins
        self.model, self.options, self.origin = model, options, origin
        self.surface = Surface(Clusters.of(model), origin, is_target=True)
        self._table = FaceTable.of(model, self.surface.clusters.order)
        self._obstacles = obstacles
        self._renderer_of = renderer_of
        self._asked: dict[Sensor, tuple[tuple[int, int], Rules]] = {}

    def release(self) -> None:
        """Give the GPU's memory back."""
        self.surface.release()

    def look(self, views: Views, sensor: Sensor, chosen: Mapping[Surface, Chosen]) -> Look | None:
        """Return what a caster is asked, or None where all must be drawn.

        Parameters are those of ``visible``. The paper's semantics mean its occlusion, and that
        only a draw has.
        """
        if not self._casts or self.options.occlusion != "physical":
            return None
        size, rules = self._asked_by(sensor)
        if not can_hold(size):
            return None
        targets, candidates = chosen[self.surface]
        hiding = self._hiding(chosen)
        if self.options.criterion == "centroid":
            targets, *hiding = self._coarser([targets, *hiding], views, size)
        return Look(targets, candidates, hiding, rules, self._renderer_of(size))

    def _asked_by(self, sensor: Sensor) -> tuple[tuple[int, int], Rules]:
        """Return the resolution of a sensor's views and what counts in them, worked out once."""
        if sensor not in self._asked:
            options = self.options
            size = render_resolution(options, sensor, self.model)
            by_pixels = options.criterion == "pixels"
            self._asked[sensor] = (
                size,
                Rules(
                    min_pixels=options.min_pixels if by_pixels else 0,
                    by_centre=not by_pixels or takes_second_look(options),
                    tolerance=centre_tolerance(size, sensor.intrinsics.tan_half),
                ),
            )
        return self._asked[sensor]

    def visible(self, views: Views, sensor: Sensor, chosen: Mapping[Surface, Chosen]) -> Bools:
        """Return which faces each view sees where all is drawn, (N, F) bool.

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
        if self.options.criterion == "centroid":
            return self._by_centroid(views, sensor, chosen)
        return self._by_pixels(views, sensor, chosen)

    def _coarser(
        self, selections: Sequence[Selection], views: Views, size: tuple[int, int]
    ) -> list[Selection]:
        """Return what hides centres; what is left of the selections themselves comes first."""
        instead = [self._stand_ins.instead_of(one, views, size) for one in selections]
        return [one[0] for one in instead] + [coarse for one in instead for coarse in one[1:]]

    def _by_pixels(self, views: Views, sensor: Sensor, chosen: Mapping[Surface, Chosen]) -> Bools:
        """Return the faces whose ID shows in enough pixels (the paper's sweeping strategy)."""
        options = self.options
        targets, candidates = chosen[self.surface]
        if options.occlusion == "paper":  # backs hide nothing
            targets = Selection(self.surface, candidates, np.ones(len(views), dtype=bool))
        renderer = self._renderer_of(render_resolution(options, sensor, self.model))
        visible = np.zeros((len(views), self.model.n_faces), dtype=bool)
        second_look = takes_second_look(options)
        for first, images in renderer.id_images(
            views,
            [targets, *self._hiding(chosen)],
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

    def _by_centroid(self, views: Views, sensor: Sensor, chosen: Mapping[Surface, Chosen]) -> Bools:
        """Return the faces whose centre passes every filter and is hidden by nothing."""
        occluders, candidates = chosen[self.surface]
        size = render_resolution(self.options, sensor, self.model)
        if self.options.occlusion == "paper":
            # what CropBack and CropNorm refuse is gone before anything is hidden
            kept = np.zeros((len(views), self.model.n_faces), dtype=bool)
            for view, pose in enumerate(views.camera_to_world):
                places = self.surface.clusters.places_in(candidates[view])
                faces = in_camera(self._table, places, pose)
                kept[view, faces.index] = faces_sensor(faces, sensor, by_axis=self._by_axis)
            hiding = [_selection_of_faces(self.surface, kept), *self._hiding(chosen)]
        else:
            hiding = self._coarser([occluders, *self._hiding(chosen)], views, size)
        visible = np.zeros((len(views), self.model.n_faces), dtype=bool)
        renderer = self._renderer_of(size)
        for first, images in renderer.depth_images(views, hiding, origin=self.origin):
            self._look_again(visible, first, images, views, candidates, sensor)
        return visible

    def _by_paper(self, views: Views, sensor: Sensor) -> Bools:
        """Return the paper's own map: its filters, then one ray to each centre that is left."""
        n = len(views)
        kept = np.zeros((n, self.model.n_faces), dtype=bool)
        far_enough = np.zeros_like(kept)
        tan_half = views.tan_half.copy()
        in_view = []
        for view, pose in enumerate(views.camera_to_world):
            kept[view], far_enough[view] = crop_as_paper(self.model, pose, sensor)
            faces = in_camera(self._table, np.flatnonzero(kept[view, self._table.index]), pose)
            in_view.append(faces)
            # a face is kept for one vertex in the frustum: its centre may lie outside
            reach = np.abs(faces.tangent).max(axis=1, initial=0) * _MARGIN
            tan_half[view] = np.minimum(np.maximum(tan_half[view], reach), _WIDEST)
        views = replace(views, tan_half=tan_half)
        hiding = self._hiding(Culling(self._obstacles).chosen(views)) if self._obstacles else []
        renderer = self._renderer_of(render_resolution(self.options, sensor, self.model))
        visible = np.zeros_like(kept)
        for first, images in renderer.depth_images(
            views,
            [_selection_of_faces(self.surface, kept), *hiding],
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

    def _hiding(self, chosen: Mapping[Surface, Chosen]) -> list[Selection]:
        """Return what to draw of the obstacles."""
        return [chosen[obstacle].to_draw for obstacle in self._obstacles]


def _selection_of_faces(surface: Surface, mask: Bools) -> Selection:
    """Return the draw of single faces (N, F) bool, both their sides."""
    return Selection(surface, mask, np.zeros(len(mask), dtype=bool), by_face=True)
