"""The worker's side of ``cluster``: makes maps on a dask worker, in an OpenGL context of its own.

The scene is a plugin of the worker. dask hands a plugin once to every worker, also to one that
comes later, and before any task. As data that tasks depend on it would be sent again and again:
dask drops copies of data that no task is waiting for.
"""

from __future__ import annotations

import os
import time
from collections.abc import Mapping
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from typing import Any

import numpy as np
from distributed import WorkerPlugin, get_worker

from glvis import __version__
from glvis.errors import MachineError
from glvis.visibility.context import GlInfo
from glvis.visibility.maps import Bits, LocalMaps, MapJob, MapScene

# Address of the worker, its OpenGL driver, maps, the seconds they took.
Answer = tuple[str, GlInfo, Bits, float]


@dataclass(frozen=True)
class Unfit:
    """A worker that can make no maps: its address, and why."""

    address: str
    reason: str


DISTRIBUTION = "glvis-placement"  # what pip and dask know the package by
VERSIONS = {DISTRIBUTION: __version__, "numpy": np.__version__}  # what decides the bits of maps
_PREFIX = "glvis-scene-"

# A context belongs to the thread that made it, and dask has several. One core a worker: the
# rasteriser shall start no threads of its own; it reads the variable when the context is made.
_thread = ThreadPoolExecutor(
    1, "glvis-gl", initializer=lambda: os.environ.setdefault("LP_NUM_THREADS", "0")
)


class SceneThere(WorkerPlugin):
    """A scene on a worker, with what draws it there.

    Parameters
    ----------
    scene : MapScene
        Models, obstacles and sensors.
    client : str
        Identity of the client whose search it is for.
    """

    def __init__(self, scene: MapScene, client: str) -> None:
        self.name = _PREFIX + client
        self._scene = scene
        self._maps: LocalMaps | None = None

    def teardown(self, worker: Any) -> None:
        """Free what was held; dask calls this."""
        _thread.submit(self._release)

    def draw(self, job: MapJob | None) -> tuple[GlInfo, Bits]:
        """Return the OpenGL driver, and the maps of a job if there is one."""
        return _thread.submit(self._draw, job).result()

    def _draw(self, job: MapJob | None) -> tuple[GlInfo, Bits]:
        self._maps = self._maps or LocalMaps(self._scene)
        bits = next(self._maps.make([job])) if job is not None else np.zeros((0, 0), np.uint8)
        return self._maps.gl, bits

    def _release(self) -> None:
        if self._maps:
            self._maps.release()


def draw(job: MapJob | None, scene: str, versions: Mapping[str, str]) -> Answer | Unfit:
    """Return the maps of a job, or without one only the OpenGL driver; or why this worker cannot.

    A worker may come late, with other packages or without OpenGL, and the others go on.

    Parameters
    ----------
    job : MapJob or None
        Poses to draw.
    scene : str
        Name of a ``SceneThere``.
    versions : mapping
        Of packages, where the search runs.
    """
    worker = get_worker()
    who = f"worker {worker.name}"
    try:
        compare_versions(who, VERSIONS, versions)
    except MachineError as error:
        return Unfit(worker.address, str(error))
    began = time.monotonic()
    try:
        gl, bits = worker.plugins[scene].draw(job)
    except (MachineError, OSError) as error:
        return Unfit(worker.address, f"{who}: {error}")
    return worker.address, gl, bits, time.monotonic() - began


def compare_versions(
    who: str, theirs: Mapping[str, str | None], ours: Mapping[str, str | None]
) -> None:
    """Raise MachineError unless ``who`` has our versions of packages."""
    for name, version in ours.items():
        if theirs[name] != version:
            raise MachineError(
                f"{who} has {name} {theirs[name] or 'not at all'}, this process {version}; "
                "install the same on all, or results may differ"
            )


def orphans(dask_scheduler: Any) -> list[str]:
    """Return names of scenes whose client is gone without a word; runs on the scheduler."""
    return [
        name
        for name in dask_scheduler.worker_plugins
        if name.startswith(_PREFIX) and name.removeprefix(_PREFIX) not in dask_scheduler.clients
    ]
