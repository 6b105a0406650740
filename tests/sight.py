"""Shortcuts for tests of visibility: shapes in, maps out, one sensor at the origin by default."""

from __future__ import annotations

from contextlib import contextmanager
from functools import cached_property

import numpy as np

from glvis.camera import Intrinsics, camera_to_world
from glvis.inputs.scene import Model
from glvis.inputs.sensor import Sensor
from glvis.sight.caster import Caster
from glvis.sight.clusters import Clusters
from glvis.sight.culling import Culling
from glvis.sight.mapper import Mapper
from glvis.sight.renderer import Renderer
from glvis.sight.selftest import can_cast
from glvis.sight.surface import Surface
from glvis.sight.views import Views
from glvis.sight.visibility import VisibilityOptions

# Looks down -z from the origin: shapes.plate with its normal +z looks back at it.
DOWN = camera_to_world([0, 0, 0], [0, 0, -1], up=(0, 1, 0))


def sensor(
    *,
    hfov_deg=60.0,
    vfov_deg=60.0,
    resolution=(64, 64),
    near=0.0,
    far=100.0,
    max_incidence_deg=90.0,
) -> Sensor:
    return Sensor(
        "test",
        Intrinsics.from_degrees(hfov_deg, vfov_deg),
        resolution,
        near,
        far,
        np.radians(max_incidence_deg),
    )


def d415() -> Sensor:
    """Return the arm study's sensor."""
    return sensor(
        hfov_deg=66.4,
        vfov_deg=39.5,
        resolution=(1280, 720),
        near=160,
        far=350,
        max_incidence_deg=70,
    )


def kinect() -> Sensor:
    """Return the kitchen study's sensor."""
    return sensor(
        hfov_deg=70.6,
        vfov_deg=60.0,
        resolution=(512, 424),
        near=500,
        far=4500,
        max_incidence_deg=80,
    )


def random_poses(rng: np.random.Generator, n: int, distance: float = 3.0) -> np.ndarray:
    """Return n poses (n, 4, 4) about ``distance`` from the origin that look near it."""
    position = rng.normal(size=(n, 3))
    position *= (
        distance
        * rng.uniform(0.7, 1.3, size=(n, 1))
        / np.linalg.norm(position, axis=1, keepdims=True)
    )
    target = rng.uniform(-0.5, 0.5, size=(n, 3))
    return camera_to_world(position, target - position, rng.uniform(-np.pi, np.pi, size=n))


class Looking(Mapper):
    """A mapper that is asked by poses: all that it draws is its model and the obstacles."""

    @cached_property
    def culling(self) -> Culling:
        return Culling([self.surface, *self._obstacles])

    def views(self, poses: np.ndarray, device: Sensor) -> Views:
        by_axis = self.options.incidence == "axis"
        return Views.of(poses, device, self.culling.corners, by_axis=by_axis)

    def looks(self, poses: np.ndarray, device: Sensor) -> np.ndarray:
        views = self.views(poses, device)
        question = self.question(device)
        chosen = self.culling.chosen(views)
        caster = Caster()
        try:
            cast = question and caster.visible(views, question, chosen, self.origin)
        finally:
            caster.release()
        return self.visible(views, device, chosen) if cast is None else cast


@contextmanager
def mapper(shape, obstacles=(), *, tiles=None, origin=(0, 0, 0), casts=None, **options):
    """Yield the mapper of a shape (vertices, faces) among obstacles, released afterwards."""
    origin = np.asarray(origin, dtype=float)
    casts = can_cast() if casts is None else casts
    renderers: dict[tuple[int, int], Renderer] = {}

    def renderer_of(resolution):
        if resolution not in renderers:
            renderers[resolution] = Renderer(resolution, tiles)
        return renderers[resolution]

    surfaces = [
        Surface(Clusters.of(Model.from_arrays(f"obstacle{i}", *o)), origin, is_target=False)
        for i, o in enumerate(obstacles)
    ]
    model = Model.from_arrays("target", *shape)
    made = Looking(
        model,
        surfaces,
        VisibilityOptions(**options),
        origin,
        renderer_of,
        casts=casts,
    )
    try:
        yield made
    finally:
        for part in (made, *surfaces, *renderers.values()):
            part.release()


def seen(shape, poses=DOWN, device=None, obstacles=(), *, tiles=None, **options) -> np.ndarray:
    """Return which faces poses (N, 4, 4) see, (N, F) bool; one pose (4, 4) gives (F,)."""
    many = np.asarray(poses).reshape(-1, 4, 4)
    with mapper(shape, obstacles, tiles=tiles, **options) as made:
        visible = made.looks(many, device or sensor())
    return visible if np.ndim(poses) == 3 else visible[0]
