"""Maps by pixels: the ID buffer of a render is the map (the paper's sweep strategy).

The depth test is the ray tracing, the clip volume is CropFOV, and the fragment shader refuses by
incidence and distance (CropBack, CropNorm, CropNear). Works on any OpenGL 3.3.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from glvis.problem.lens import Pinhole
from glvis.problem.visibility_options import VisibilityOptions, render_resolution
from glvis.visibility.coincident import Coincident
from glvis.visibility.culling import Culled
from glvis.visibility.gpu_scene import GpuScene
from glvis.visibility.lookup import ids_by_rays, lookup_of
from glvis.visibility.rays import seen_by_partner
from glvis.visibility.renderer import Renderer, Selection, pixels_of_faces
from glvis.visibility.surface import Surface
from glvis.visibility.views import Views

Bools = NDArray[np.bool_]


class Drawer:
    """Draws ID buffers of a scene; holds a renderer for each resolution.

    Parameters
    ----------
    tiles : int, optional
        Views that are drawn before they are read back; see ``Renderer``.
    """

    def __init__(self, tiles: int | None = None) -> None:
        self._tiles = tiles
        self._renderers: dict[tuple[int, int], Renderer] = {}
        self._coincident: dict[Surface, Coincident] = {}

    def release(self) -> None:
        """Give the GPU's memory back."""
        for renderer in self._renderers.values():
            renderer.release()
        self._renderers.clear()

    def visible(
        self, scene: GpuScene, views: Views, culled: Culled, options: VisibilityOptions
    ) -> list[Bools]:
        """Return the faces of each model whose ID shows in enough pixels, (N, F) bool each.

        Parameters
        ----------
        scene : GpuScene
            Models and what hides them.
        views : Views
            N poses of a sensor.
        culled : Culled
            What they keep of the scene.
        options : VisibilityOptions
            At a stated resolution, or of several pixels.
        """
        return [self._visible(scene, target, views, culled, options) for target in scene.targets]

    def _visible(
        self,
        scene: GpuScene,
        target: Surface,
        views: Views,
        culled: Culled,
        options: VisibilityOptions,
    ) -> Bools:
        model = target.clusters.model
        coincident = self._coincident_of(target)
        hides = options.occlusion == "physical"  # by the paper, backs hide nothing
        mask = culled.occludes if hides else np.repeat(culled.countable, views.per_view, axis=0)
        targets = Selection(target, mask[:, scene.columns[target]])
        selections = [targets]
        if coincident.is_two_sided:
            selections = [
                replace(targets, sides="front"),
                replace(targets, sides="back", recedes=True),
            ]
        selections += [
            Selection(one, culled.occludes[:, scene.columns[one]], recedes=True)
            for one in scene.obstacles
        ]
        visible = np.zeros((len(views), model.n_faces), dtype=bool)
        images = self._images(views, selections, target, scene, options)
        for view, (seen, (image, rays)) in enumerate(zip(visible, images, strict=True)):
            if views.partner:
                image = seen_by_partner(image, rays, scene, target, views, culled, view, options)
            pixels = pixels_of_faces(image, model.n_faces)
            if len(coincident):
                pose = views.camera_to_world[view]
                pixels += coincident.pixels_shared(image, model, views.sensor, pose)
            seen[:] = pixels >= options.min_pixels
        return visible

    def _images(
        self,
        views: Views,
        selections: Sequence[Selection],
        target: Surface,
        scene: GpuScene,
        options: VisibilityOptions,
    ) -> Iterator[tuple[NDArray[np.uint32], NDArray[np.float64] | None]]:
        """Yield the ID image of each view as its lens has it, (H, W) uint32.

        With the directions (3, H * W) of its pixels where the lens is no pinhole.
        """
        size = render_resolution(options, views.sensor) or views.sensor.resolution
        hides = options.occlusion == "physical"
        lens = views.limits.lens
        lookup = None if isinstance(lens, Pinhole) else lookup_of(lens, size)
        renderer = self._renderer(lookup.window_size if lookup else size)
        windows: list[NDArray[np.uint32]] = []
        view = 0
        for _, images in renderer.id_images(
            views, selections, origin=scene.origin, refused_hide=hides
        ):
            if lookup is None:
                yield from ((image, None) for image in images)
                continue
            for image in images:
                windows.append(np.array(image))
                if len(windows) == views.per_view:
                    pose, model = views.camera_to_world[view], target.clusters.model
                    yield ids_by_rays(lookup, windows, lens, model, pose)
                    windows, view = [], view + 1

    def _coincident_of(self, target: Surface) -> Coincident:
        if target not in self._coincident:
            self._coincident[target] = Coincident.of(target.clusters.model)
        return self._coincident[target]

    def _renderer(self, size: tuple[int, int]) -> Renderer:
        if size not in self._renderers:
            self._renderers[size] = Renderer(size, self._tiles)
        return self._renderers[size]
