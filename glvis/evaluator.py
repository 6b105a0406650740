"""From positions of the variables to values of the objective: the cost of the search.

An evaluator belongs to the process that made it, with its OpenGL context. Maps are kept by pose:
a sensor that did not move, or a mount that is fixed, is rendered once.
"""

from __future__ import annotations

from collections import OrderedDict
from collections.abc import Iterator

import numpy as np
from numpy.typing import ArrayLike, NDArray

from glvis.clusters import Clusters
from glvis.context import GlInfo, gl_info
from glvis.mapper import Mapper
from glvis.renderer import Renderer, Surface
from glvis.study import Study
from glvis.visibility import VisibilityMap

Floats = NDArray[np.float64]

_CACHE_BYTES = 256 << 20  # of maps, one bit a face
_ENTRY_BYTES = 600  # about what Python keeps beside the bits: key, pose, array, links
_CHUNK_BYTES = 8 << 20  # of maps made at once, one byte a face


class Evaluator:
    """Renders the sensors of positions on every model; a context manager.

    Parameters
    ----------
    study : Study
        Models, obstacles, sensors, variables, objective.
    cache_bytes : int
        Memory for maps of poses met before, bytes; 0 keeps none.
    tiles : int, optional
        Views that share a framebuffer; see ``Renderer``.

    Attributes
    ----------
    maps_rendered : int
        Maps made so far, those found in the cache not counted.

    Raises
    ------
    MachineError
        Where there is no OpenGL, or a driver that fails the self-test.

    Examples
    --------
    >>> with Evaluator(load_study("arm.toml")) as evaluator:  # doctest: +SKIP
    ...     values = evaluator(positions)  # (P, D) -> (P,), larger is better
    """

    def __init__(
        self, study: Study, *, cache_bytes: int = _CACHE_BYTES, tiles: int | None = None
    ) -> None:
        self.study = study
        self.gl: GlInfo = gl_info()
        self.maps_rendered = 0
        self._tiles = tiles
        self._renderers: dict[tuple[int, int], Renderer] = {}
        origin = study.models[0].bounds.mean(axis=0)
        self._obstacles = [
            Surface(Clusters.of(obstacle), origin, is_target=False) for obstacle in study.obstacles
        ]
        self._mappers = [
            Mapper(model, self._obstacles, study.visibility, origin, self._renderer_of)
            for model in study.models
        ]
        self._cache = _MapCache(cache_bytes)

    def __enter__(self) -> Evaluator:
        return self

    def __exit__(self, *exception: object) -> None:
        self.release()

    def release(self) -> None:
        """Give the GPU's memory back."""
        for mapper in self._mappers:
            mapper.release()
        for surface in self._obstacles:
            surface.release()
        for renderer in self._renderers.values():
            renderer.release()
        self._renderers.clear()

    def __call__(self, positions: ArrayLike) -> Floats:
        """Return the objective of positions (P, D) or (D,), as (P,) float64; larger is better."""
        x = np.atleast_2d(np.asarray(positions, dtype=float))
        return self.study.objective.aggregated(self.values_by_model(x))

    def values_by_model(self, positions: ArrayLike) -> Floats:
        """Return the objective on each model, (P, M) float64."""
        poses = self.study.rig.poses(np.atleast_2d(np.asarray(positions, dtype=float)))
        objective = self.study.objective
        values = np.zeros((len(poses), len(self._mappers)))
        for m, model in enumerate(self.study.models):
            for p, visible in enumerate(self._maps(m, poses)):
                values[p, m] = objective.terms(visible.sum(axis=0), model.areas)["value"]
        return values

    def visibility(self, position: ArrayLike) -> list[VisibilityMap]:
        """Return the visibility maps of one position (D,), one a model."""
        return self.visibility_of_poses(self.study.rig.poses(np.asarray(position, float)[None])[0])

    def visibility_of_poses(self, camera_to_world: Floats) -> list[VisibilityMap]:
        """Return the visibility maps of given poses (S, 4, 4) of the sensors, one a model."""
        names = self.study.rig.sensor_names
        return [
            VisibilityMap(model.name, names, next(self._maps(m, camera_to_world[None])))
            for m, model in enumerate(self.study.models)
        ]

    def _renderer_of(self, resolution: tuple[int, int]) -> Renderer:
        if resolution not in self._renderers:
            self._renderers[resolution] = Renderer(resolution, self._tiles)
        return self._renderers[resolution]

    def _maps(self, m: int, poses: Floats) -> Iterator[NDArray[np.bool_]]:
        """Yield the maps (S, F) of model ``m`` for poses (P, S, 4, 4), position by position."""
        map_bytes = poses.shape[1] * self.study.models[m].n_faces
        at_once = max(1, _CHUNK_BYTES // map_bytes)
        for first in range(0, len(poses), at_once):
            yield from self._chunk(m, poses[first : first + at_once])

    def _chunk(self, m: int, poses: Floats) -> NDArray[np.bool_]:
        """Return the maps (P, S, F) of model ``m``; each pose is rendered once."""
        study, mapper = self.study, self._mappers[m]
        visible = np.zeros((*poses.shape[:2], study.models[m].n_faces), dtype=bool)
        for sensor in dict.fromkeys(study.sensors):
            slots = [s for s, other in enumerate(study.sensors) if other is sensor]
            missing: dict[_Key, list[tuple[int, int]]] = {}
            for place in ((p, s) for p in range(len(poses)) for s in slots):
                key = (m, sensor.name, poses[place].tobytes())
                found = self._cache.get(key)
                if found is None:
                    missing.setdefault(key, []).append(place)
                else:
                    visible[place] = np.unpackbits(found, count=visible.shape[2])
            if missing:
                new = np.stack([poses[places[0]] for places in missing.values()])
                self.maps_rendered += len(new)
                maps = mapper.visible(new, sensor)
                for (key, places), seen in zip(missing.items(), maps, strict=True):
                    self._cache.put(key, np.packbits(seen))
                    for place in places:
                        visible[place] = seen
        return visible


_Key = tuple[int, str, bytes]  # model, sensor kind, pose


class _MapCache:
    """Maps by model, sensor and pose; the one not asked for longest leaves first."""

    def __init__(self, max_bytes: int) -> None:
        self._max_bytes, self._bytes = max_bytes, 0
        self._maps: OrderedDict[_Key, NDArray[np.uint8]] = OrderedDict()

    def get(self, key: _Key) -> NDArray[np.uint8] | None:
        found = self._maps.get(key)
        if found is not None:
            self._maps.move_to_end(key)
        return found

    def put(self, key: _Key, bits: NDArray[np.uint8]) -> None:
        self._maps[key] = bits
        self._bytes += bits.nbytes + _ENTRY_BYTES
        while self._bytes > self._max_bytes:
            _, oldest = self._maps.popitem(last=False)
            self._bytes -= oldest.nbytes + _ENTRY_BYTES
