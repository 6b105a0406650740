"""Shortcuts for tests of visibility: shapes in, maps out, one sensor at the origin by default."""

from __future__ import annotations

from contextlib import contextmanager

import numpy as np

from glvis.problem.camera import look_along
from glvis.problem.lens import Pinhole
from glvis.problem.scene import Model
from glvis.problem.sensor import Sensor
from glvis.problem.visibility_options import VisibilityOptions
from glvis.visibility.batch import Question
from glvis.visibility.gpu_scene import GpuScene
from glvis.visibility.maps import LocalMaps, MapScene
from glvis.visibility.points import grid_size, large_faces
from glvis.visibility.views import Views

# Looks down -z from the origin: shapes.plate with its normal +z looks back at it.
DOWN = look_along([0, 0, 0], [0, 0, -1], up=(0, 1, 0))


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
        Pinhole.from_degrees(hfov_deg, vfov_deg),
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
    return look_along(position, target - position, rng.uniform(-np.pi, np.pi, size=n))


class Looking:
    """A shape among obstacles, looked at from poses by any sensor, made by one engine."""

    def __init__(self, shape, obstacles, *, tiles, origin, casts, **options):
        self.model = Model.from_arrays("target", *shape)
        self.options = VisibilityOptions(**options)
        hiding = [Model.from_arrays(f"obstacle{i}", *o) for i, o in enumerate(obstacles)]
        self.scene = GpuScene([self.model], hiding, np.asarray(origin, dtype=float))
        parts = MapScene((self.model,), tuple(hiding), (), self.options)
        self.maps = LocalMaps(parts, tiles, casts=casts, origin=self.scene.origin)

    @property
    def surface(self):
        return self.scene.targets[0]

    def views(self, poses: np.ndarray, device: Sensor) -> Views:
        return Views.of(poses, device, self.scene.corners, self.options)

    def looks(self, poses: np.ndarray, device: Sensor) -> np.ndarray:
        (visible,) = self.maps.visible(poses, device)
        return visible

    def question(self, device: Sensor) -> Question:
        grid = grid_size(device.lens.windows.tan_half, self.model, device.max_distance)
        return Question(self.scene, self.surface, [grid], large_faces(self.options))

    def release(self):
        self.maps.release()
        self.scene.release()


@contextmanager
def looking(shape, obstacles=(), *, tiles=None, origin=(0, 0, 0), casts=None, **options):
    """Yield a shape (vertices, faces) among obstacles to be looked at, released afterwards."""
    made = Looking(shape, obstacles, tiles=tiles, origin=origin, casts=casts, **options)
    try:
        yield made
    finally:
        made.release()


def seen(shape, poses=DOWN, device=None, obstacles=(), *, tiles=None, **options) -> np.ndarray:
    """Return which faces poses (N, 4, 4) see, (N, F) bool; one pose (4, 4) gives (F,)."""
    many = np.asarray(poses).reshape(-1, 4, 4)
    with looking(shape, obstacles, tiles=tiles, **options) as made:
        visible = made.looks(many, device or sensor())
    return visible if np.ndim(poses) == 3 else visible[0]
