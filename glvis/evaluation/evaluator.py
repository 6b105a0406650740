"""The evaluator: from positions of the variables to values of the objective.

Maps are kept by pose: a sensor that did not move, or a mount that is fixed, is rendered once.
Maps are made by this process or by others (``maps``, ``workers``, ``cluster``); values are the
same to the last bit.
"""

from __future__ import annotations

import hashlib
from collections import OrderedDict
from collections.abc import Callable, Iterator, Sequence
from typing import cast

import numpy as np
from numpy.typing import ArrayLike, NDArray

from glvis.problem.study import Study
from glvis.visibility.context import GlInfo, Held
from glvis.visibility.maps import Bits, LocalMaps, MapJob, MapMaker, MapScene
from glvis.visibility.visibility_map import VisibilityMap

Floats = NDArray[np.float64]

_CACHE_BYTES = 256 << 20  # of maps, one bit a face
_ENTRY_BYTES = 400  # about what Python keeps beside the bits: key, array, links
_MOST_POSES = 1 << 14  # kept at most: enough for any search, and their keys fit a checkpoint
_BATCH_BYTES = 64 << 20  # of maps asked for at once, one bit a face
_JOB_BYTES, _JOB_MAPS = 8 << 20, 128  # of maps made at once, one byte a face
POSE_BYTES = 16  # of the key of a pose


class Evaluator(Held):
    """An evaluator of positions, which renders all sensors on every model; a context manager.

    Parameters
    ----------
    study : Study
        Models, obstacles, sensors, variables, objective.
    maps : MapMaker, optional
        Maker of the maps; released with the evaluator. Without it, this process makes them.
    cache_bytes : int
        Memory for maps of poses met before, bytes; 0 keeps none.

    Attributes
    ----------
    gl : GlInfo
        The OpenGL driver in use.
    maps_rendered : int
        Maps made so far, those found in the cache not counted.
    most_poses : int
        Poses whose maps are kept.

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
        self,
        study: Study,
        *,
        maps: MapMaker | None = None,
        cache_bytes: int = _CACHE_BYTES,
    ) -> None:
        self.study = study
        self._maps = maps or LocalMaps(MapScene.of(study))
        self.gl: GlInfo = self._maps.gl
        self.maps_rendered = 0
        # where the bits of each model begin in those of a pose
        widths = [(model.n_faces + 7) // 8 for model in study.models]
        self._begin = np.cumsum([0, *widths])
        self._pose_bytes = int(self._begin[-1])
        self.most_poses = min(_MOST_POSES, cache_bytes // (self._pose_bytes + _ENTRY_BYTES))
        self._cache = _PoseCache(self.most_poses)

    def __repr__(self) -> str:
        return f"Evaluator({self.study!r}, by {self.gl.renderer})"

    def release(self) -> None:
        """Give back the GPU's memory, or other processes."""
        self._maps.release()

    def __call__(self, positions: ArrayLike) -> Floats:
        """Return the objective of positions (P, D) or (D,), as (P,) float64; larger is better."""
        return self.study.objective.aggregated(self.values_by_model(positions))

    def values_by_model(self, positions: ArrayLike, sensors: Sequence[int] | None = None) -> Floats:
        """Return the objective on each model, (P, M) float64; see ``each``."""
        rows = list(self.each(positions, sensors))
        return np.array(rows).reshape(len(rows), len(self.study.models))

    def each(
        self,
        positions: ArrayLike,
        sensors: Sequence[int] | None = None,
        note: Callable[[list[NDArray[np.uint8]]], None] | None = None,
    ) -> Iterator[Floats]:
        """Yield the objective on each model (M,), position by position.

        Parameters
        ----------
        positions : (P, D) or (D,) float
            In the units of the study file.
        sensors : sequence of int, optional
            Active sensors; without it all S.
        note : callable, optional
            Takes the maps of each position, (S, F) of 0 and 1, one a model.
        """
        study = self.study
        x = np.atleast_2d(np.asarray(positions, dtype=float))
        active = list(range(len(study.sensors))) if sensors is None else list(sensors)
        areas = [model.areas for model in study.models]
        kind = np.min_scalar_type(len(active))
        for bits in self._bits(study.rig.poses(x)[:, active], active):
            maps = [self._visible(bits, m) for m in range(len(study.models))]
            if note is not None:
                note(maps)
            counts = [np.add.reduce(seen, axis=0, dtype=kind) for seen in maps]
            yield study.objective.value_by_model(counts, areas)

    def visibility(self, position: ArrayLike) -> list[VisibilityMap]:
        """Return the visibility maps of one position (D,), one a model."""
        return next(self.each_visibility(np.asarray(position, float)[None]))

    def visibility_of_poses(self, camera_to_world: Floats) -> list[VisibilityMap]:
        """Return the visibility maps of given poses (S, 4, 4) of the sensors, one a model."""
        return next(self._each_map(camera_to_world[None]))

    def each_visibility(self, positions: ArrayLike) -> Iterator[list[VisibilityMap]]:
        """Yield the visibility maps, one a model, position by position of (P, D)."""
        return self._each_map(self.study.rig.poses(positions))

    def _each_map(self, poses: Floats) -> Iterator[list[VisibilityMap]]:
        """Yield the maps of poses (P, S, 4, 4), one a model."""
        names = self.study.rig.sensor_names
        for bits in self._bits(poses, range(len(names))):
            yield [
                VisibilityMap(model.name, names, self._visible(bits, m).view(bool))
                for m, model in enumerate(self.study.models)
            ]

    @property
    def workers(self) -> int:
        """How many processes render."""
        return self._maps.workers

    @property
    def worker_names(self) -> Sequence[str]:
        """Who renders on other machines, at the moment."""
        return self._maps.names

    @property
    def warnings(self) -> list[str]:
        """What went wrong without harm to the values, such as a worker that was replaced."""
        return self._maps.warnings

    @property
    def known_poses(self) -> NDArray[np.uint8]:
        """Keys of the poses whose maps are kept, (K, 16), the one not used for longest first."""
        keys = b"".join(self._cache.keys())
        return np.frombuffer(keys, dtype=np.uint8).reshape(-1, POSE_BYTES)

    def recall(self, known_poses: NDArray[np.uint8]) -> None:
        """Count as another run did: ``known_poses`` were rendered there.

        Their maps are made again when asked for, and not counted.
        """
        for key in known_poses:
            self._cache.put(key.tobytes(), None)

    def _visible(self, bits: Bits, m: int) -> NDArray[np.uint8]:
        """Return one model's map (S, F), 0 or 1, out of the bits of all (S, B)."""
        mine = bits[:, self._begin[m] : self._begin[m + 1]]
        return np.unpackbits(mine, axis=1, count=self.study.models[m].n_faces)

    def _bits(self, poses: Floats, active: Sequence[int]) -> Iterator[Bits]:
        """Yield the maps of all models (S, B), one bit a face, for poses (P, S, 4, 4)."""
        at_once = max(1, _BATCH_BYTES // (len(active) * self._pose_bytes))
        for first in range(0, len(poses), at_once):
            yield from self._batch(poses[first : first + at_once], active)

    def _batch(self, poses: Floats, active: Sequence[int]) -> Iterator[Bits]:
        """Do the same for as many as are held at once; each pose is rendered once."""
        sensors = self.study.sensors
        # one representative a kind: the same object is the same kind
        first_of = {id(sensors[s]): s for s in reversed(active)}
        kinds = [first_of[id(sensors[s])] for s in active]
        keys: list[list[bytes]] = []
        held: dict[bytes, Bits | None] = {}  # of this batch, so that no pose is lost before use
        missing: list[dict[bytes, tuple[int, int]]] = []  # where each new pose stands
        counted = []  # maps of each position that were never made before
        for places in poses:
            keys.append(
                [_key(sensors[kind].name, pose) for kind, pose in zip(kinds, places, strict=True)]
            )
            new = {}
            counted.append(0)
            for s, key in enumerate(keys[-1]):
                if key not in held:
                    is_known, held[key] = self._cache.get(key)
                    counted[-1] += 0 if is_known else len(self.study.models)
                    if held[key] is None:
                        new[key] = (kinds[s], s)
            missing.append(new)
        blocks = self._blocks([len(new) for new in missing])
        jobs, wanted = self._jobs(poses, missing, blocks)
        made = self._maps.make(jobs)
        for block, by_kind in zip(blocks, wanted, strict=True):
            for new_keys in by_kind:
                held.update(zip(new_keys, next(made), strict=True))
            for p in block:
                self.maps_rendered += counted[p]
                for key in keys[p]:
                    self._cache.put(key, held[key])
                yield np.stack([cast(Bits, held[key]) for key in keys[p]])

    def _blocks(self, new_poses: Sequence[int]) -> list[range]:
        """Return runs of positions whose new poses make jobs of a good size."""
        widest = max(model.n_faces for model in self.study.models)
        most = max(1, min(_JOB_MAPS, _JOB_BYTES // widest))
        blocks, first, n = [], 0, 0
        for p, new in enumerate(new_poses):
            if n and n + new > most:
                blocks.append(range(first, p))
                first, n = p, 0
            n += new
        return [*blocks, range(first, len(new_poses))]

    def _jobs(
        self,
        poses: Floats,
        missing: Sequence[dict[bytes, tuple[int, int]]],
        blocks: Sequence[range],
    ) -> tuple[list[MapJob], list[list[list[bytes]]]]:
        """Return what to render, and by block and kind of sensor the keys it is for."""
        jobs: list[MapJob] = []
        wanted: list[list[list[bytes]]] = []
        for block in blocks:
            by_kind: dict[int, list[tuple[bytes, int, int]]] = {}
            for p in block:
                for key, (kind, s) in missing[p].items():
                    by_kind.setdefault(kind, []).append((key, p, s))
            for kind, found in by_kind.items():
                stack = np.stack([poses[p, s] for _, p, s in found])
                jobs.append(MapJob(kind, stack))
            wanted.append([[key for key, _, _ in found] for found in by_kind.values()])
        return jobs, wanted


def _key(kind: str, pose: Floats) -> bytes:
    """Return what stands for a sensor at a pose."""
    text = pose.tobytes() + kind.encode()
    return hashlib.blake2b(text, digest_size=POSE_BYTES).digest()


class _PoseCache:
    """Maps by pose; the one not asked for longest leaves first. A pose may be known without."""

    def __init__(self, most: int) -> None:
        self._most = most
        self._bits: OrderedDict[bytes, Bits | None] = OrderedDict()

    def keys(self) -> Iterator[bytes]:
        return iter(self._bits)

    def get(self, key: bytes) -> tuple[bool, Bits | None]:
        """Return whether the pose is known, and its maps if they are there."""
        return key in self._bits, self._bits.get(key)

    def put(self, key: bytes, bits: Bits | None) -> None:
        """Keep the maps of a pose, as the one asked for last."""
        self._bits[key] = bits
        self._bits.move_to_end(key)
        while len(self._bits) > self._most:
            self._bits.popitem(last=False)
