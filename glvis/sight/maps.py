"""Makes visibility maps of many poses, in this process: the one thing that needs OpenGL.

A job is a few poses of one sensor, looked at on every model: what follows from the poses alone
is worked out once. Maps come back one bit a face, so that they can be kept and sent. ``workers``
makes the same maps in other processes.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Protocol

import numpy as np
from numpy.typing import NDArray

from glvis.sight.caster import Caster, can_hold
from glvis.sight.clusters import Clusters
from glvis.sight.context import GlInfo, gl_info
from glvis.sight.culling import Culling
from glvis.sight.mapper import Mapper
from glvis.sight.renderer import Renderer
from glvis.sight.selftest import can_cast, check_driver
from glvis.sight.surface import Surface
from glvis.sight.views import Views

if TYPE_CHECKING:
    from glvis.inputs.scene import Model
    from glvis.inputs.sensor import Sensor
    from glvis.inputs.study import Study
    from glvis.sight.visibility import VisibilityOptions

# Poses that are looked at together: on a CPU few, so that their masks stay in its cache. Hardware
# wants many; masks of so many clusters take as much memory in NumPy as there is to spare.
_AT_ONCE_ON_CPU, _MOST_MASKED = 16, 1 << 24

Bits = NDArray[np.uint8]  # (N, sum of ceil(F / 8) over models), as numpy.packbits has them


@dataclass(frozen=True, eq=False)
class MapJob:
    """Some maps to make, of every model.

    Attributes
    ----------
    sensor : int
        Index of the sensor, in the order of the study.
    camera_to_world : (N, 4, 4) float64
        Poses of that sensor.
    """

    sensor: int
    camera_to_world: NDArray[np.float64]

    def __len__(self) -> int:
        return len(self.camera_to_world)

    def __getitem__(self, some: slice) -> MapJob:
        return MapJob(self.sensor, self.camera_to_world[some])

    def parts(self, most: int) -> list[MapJob]:
        """Return the same maps as jobs of at most ``most`` poses."""
        return [self[first : first + most] for first in range(0, len(self), most)]


@dataclass(frozen=True, eq=False)
class MapScene:
    """What of a study decides its maps; the other half is the poses.

    Attributes
    ----------
    models, obstacles : tuple of Model
        What is counted, what only hides.
    sensors : tuple of Sensor
        S of them.
    visibility : VisibilityOptions
        What counts as visible.
    """

    models: tuple[Model, ...]
    obstacles: tuple[Model, ...]
    sensors: tuple[Sensor, ...]
    visibility: VisibilityOptions

    @classmethod
    def of(cls, study: Study) -> MapScene:
        """Return the scene of a study."""
        return cls(study.models, study.obstacles, study.sensors, study.visibility)


class MapMaker(Protocol):
    """Who makes maps."""

    gl: GlInfo
    workers: int
    names: Sequence[str]  # of workers on other machines
    warnings: list[str]

    def make(self, jobs: Sequence[MapJob]) -> Iterator[Bits]:
        """Yield the maps of each job, in their order."""

    def release(self) -> None:
        """Give back what was held."""


class LocalMaps:
    """Makes maps in this process, with its OpenGL context.

    Parameters
    ----------
    scene : MapScene
        What there is to see, and by which sensors.
    tiles : int, optional
        Views that share a framebuffer; see ``Renderer``.

    Attributes
    ----------
    gl : GlInfo
        Who draws.

    Raises
    ------
    MachineError
        Where there is no OpenGL, or a driver that fails the self-test.
    """

    workers = 1
    names: Sequence[str] = ()

    def __init__(self, scene: MapScene, tiles: int | None = None) -> None:
        self.gl = gl_info()
        check_driver()
        self.warnings: list[str] = []
        self._sensors = scene.sensors
        self._tiles = tiles
        self._renderers: dict[tuple[int, int], Renderer] = {}
        self._caster = Caster()
        origin = self._origin = scene.models[0].bounds.mean(axis=0)
        self._obstacles = [
            Surface(Clusters.of(obstacle), origin, is_target=False) for obstacle in scene.obstacles
        ]
        self._by_axis = scene.visibility.incidence == "axis"
        most = max(model.n_faces for model in (*scene.models, *scene.obstacles))
        casts = can_cast() and can_hold(most)
        self._mappers = [
            Mapper(model, self._obstacles, scene.visibility, origin, self._renderer_of, casts=casts)
            for model in scene.models
        ]
        surfaces = [*(mapper.surface for mapper in self._mappers), *self._obstacles]
        self._culling = Culling(surfaces)
        fitting = max(1, _MOST_MASKED // max(1, sum(map(len, (s.clusters for s in surfaces)))))
        self._at_once = min(fitting, _AT_ONCE_ON_CPU) if self.gl.is_software else fitting

    def make(self, jobs: Sequence[MapJob]) -> Iterator[Bits]:
        """Yield the maps of each job, in their order."""
        for job in jobs:
            yield np.concatenate([self._bits(part) for part in job.parts(self._at_once)])

    def _bits(self, job: MapJob) -> Bits:
        """Return the maps of poses that are looked at together."""
        sensor = self._sensors[job.sensor]
        corners = self._culling.corners
        views = Views.of(job.camera_to_world, sensor, corners, by_axis=self._by_axis)
        chosen = self._culling.chosen(views)
        found = []
        for mapper in self._mappers:
            question = mapper.question(sensor)
            visible = None
            if question:
                visible = self._caster.visible(views, question, chosen, self._origin)
            if visible is None:
                visible = mapper.visible(views, sensor, chosen)
            found.append(np.packbits(visible, axis=1))
        return np.concatenate(found, axis=1)

    def release(self) -> None:
        """Give the GPU's memory back."""
        for mapper in self._mappers:
            mapper.release()
        for surface in self._obstacles:
            surface.release()
        self._caster.release()
        for renderer in self._renderers.values():
            renderer.release()
        self._renderers.clear()

    def _renderer_of(self, resolution: tuple[int, int]) -> Renderer:
        if resolution not in self._renderers:
            self._renderers[resolution] = Renderer(resolution, self._tiles)
        return self._renderers[resolution]
