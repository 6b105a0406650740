"""From poses to visibility maps, in this process: cull, then the engine that the options call for.

| options | engine | how |
| --- | --- | --- |
| ``semantics = "paper"`` | ``paper`` | the paper's filters in order, then rays in NumPy |
| pixels, several or at a stated resolution | ``draw`` | ID buffers, any OpenGL 3.3 |
| all else, the default | ``cast`` | points of faces in compute shaders, OpenGL 4.3 |
| the same, no compute shaders or ``occlusion = "paper"`` | ``rays`` | these points in NumPy |

All answer alike: ``visible(scene, views, culled, options)``, one (N, F) bool a model. A job is a
few poses of one sensor, for every model: what follows from the poses alone is worked out once.
Maps come back one bit a face, so that they can be kept and sent; ``evaluation.workers`` and
``evaluation.cluster`` make the same ones elsewhere.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Protocol

import numpy as np
from numpy.typing import NDArray

from glvis.problem.scene import Model
from glvis.problem.sensor import Sensor
from glvis.problem.visibility_options import VisibilityOptions, asks_about_points
from glvis.visibility import paper, rays
from glvis.visibility.cast import Caster, can_hold
from glvis.visibility.context import GlInfo, gl_info
from glvis.visibility.culling import Culled, cull
from glvis.visibility.draw import Drawer
from glvis.visibility.gpu_scene import GpuScene
from glvis.visibility.selftest import can_cast, check_driver
from glvis.visibility.views import Views

if TYPE_CHECKING:
    from glvis.problem.study import Study

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
        return [self[first : first + most] for first in range(0, len(self) or 1, most)]


@dataclass(frozen=True, eq=False)
class MapScene:
    """The part of a study that decides its maps; the other half is the poses.

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

    def __post_init__(self) -> None:
        if self.visibility.semantics == "paper":
            for sensor in self.sensors:
                if not sensor.is_ideal:
                    raise ValueError(
                        f"sensor '{sensor.name}': semantics = 'paper' knows one ideal pinhole "
                        "whose range is depth, no other lens and no partner; take semantics out"
                    )

    @classmethod
    def of(cls, study: Study) -> MapScene:
        """Return the scene of a study."""
        return cls(study.models, study.obstacles, study.sensors, study.visibility)


class MapMaker(Protocol):
    """A backend that turns map jobs into packed visibility maps."""

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
    casts : bool, optional
        Whether points of faces may be judged by compute shaders; by default where they can.
    origin : (3,) float64, optional
        World point that float32 positions are relative to; see ``GpuScene``.

    Attributes
    ----------
    gl : GlInfo
        The OpenGL driver in use.

    Raises
    ------
    MachineError
        Where there is no OpenGL, or a driver that fails the self-test.
    """

    workers = 1
    names: Sequence[str] = ()

    def __init__(
        self,
        scene: MapScene,
        tiles: int | None = None,
        *,
        casts: bool | None = None,
        origin: NDArray[np.float64] | None = None,
    ) -> None:
        self.gl = gl_info()
        check_driver()
        self.warnings: list[str] = []
        self._sensors, self._options = scene.sensors, scene.visibility
        self._scene = GpuScene(scene.models, scene.obstacles, origin)
        self._drawer, self._caster = Drawer(tiles), Caster()
        most = max(model.n_faces for model in (*scene.models, *scene.obstacles))
        self._casts = can_cast() and can_hold(most) if casts is None else casts
        fitting = max(1, _MOST_MASKED // max(1, self._scene.n_clusters))
        self._at_once = min(fitting, _AT_ONCE_ON_CPU) if self.gl.is_software else fitting

    def make(self, jobs: Sequence[MapJob]) -> Iterator[Bits]:
        """Yield the maps of each job, in their order."""
        for job in jobs:
            yield np.concatenate([self._bits(part) for part in job.parts(self._at_once)])

    def visible(
        self, camera_to_world: NDArray[np.float64], sensor: Sensor
    ) -> list[NDArray[np.bool_]]:
        """Return which faces of each model poses (N, 4, 4) of a sensor see, (N, F) bool each."""
        views = Views.of(camera_to_world, sensor, self._scene.corners, self._options)
        culled = cull(self._scene, views)
        return self._engine()(self._scene, views, culled, self._options)

    def release(self) -> None:
        """Give the GPU's memory back."""
        self._scene.release()
        self._caster.release()
        self._drawer.release()

    def _engine(
        self,
    ) -> Callable[[GpuScene, Views, Culled, VisibilityOptions], list[NDArray[np.bool_]]]:
        """Return what makes maps under the options; all answer in the same way."""
        if self._options.semantics == "paper":
            return paper.visible
        if not asks_about_points(self._options):
            return self._drawer.visible
        # the compute shaders cannot leave refused faces out of the occluders
        if self._casts and self._options.occlusion == "physical":
            return self._caster.visible
        return rays.visible

    def _bits(self, job: MapJob) -> Bits:
        """Return the maps of poses that are looked at together."""
        visible = self.visible(job.camera_to_world, self._sensors[job.sensor])
        return np.concatenate([np.packbits(seen, axis=1) for seen in visible], axis=1)
