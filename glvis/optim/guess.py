"""What a layout may be worth: a guess that renders no map.

Some faces of each model are put through the sensors' filters (field of view, working range,
incidence) by their centres of mass. Of those that pass the ones are left out that maps rendered
before found to be hidden from near by, see ``memory.py``. Methods rank what they might try by it;
only rendered maps decide.

In a kitchen of 6,508 faces a guess at a layout took 0.014 of the time of a map, on six arms with
eight sensors 0.2 of a map, of which a layout has 48 (in searches by ``auto``, software GL). All
guesses of a search took 1.15 times as long as its maps there, 0.35 times here: they are what does
not get quicker with more workers.

Plain arithmetic of NumPy, no matrix products: the guess must be the same on every machine that
a search may be resumed on.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from glvis.inputs.sensor import Sensor
from glvis.inputs.study import Study
from glvis.optim.memory import Memory

Floats = NDArray[np.float64]
Singles = NDArray[np.float32]
Bools = NDArray[np.bool_]

# Faces looked at, of all models together, but some of each; more made climbing no quicker (from
# three layouts of six arms, 8,000 maps led to 14.19, 14.11, 14.04 of 15 with 300 faces, to 14.19,
# 14.10, 14.09 with 1,200; a kitchen came to 67.3 and 67.1 % with 300, 67.0 and 68.8 with 600). In a
# kitchen of 6,508 faces, of what each of 4,000 random poses would add to two others, the ranks
# agree with those by maps to 0.70 (Spearman) where no map is known, 0.92 where 500 random ones are,
# 0.96 with 1,800 or 6,000, 0.97 with 20,000, and 0.98 by the true maps (800 faces, 16 eyes; one eye
# 0.87, four 0.94, thirty-two no more than sixteen; eyes weighed by rank, the majority won).
_FACES, _LEAST = 600, 100
# What is remembered: poses, and bytes in a checkpoint, one bit a face.
_MOST_POSES, _MOST_BYTES = 1 << 14, 1 << 20
# So that what is computed of them stays in a core's cache.
_POSITIONS_AT_ONCE, _POSES_AT_ONCE = 256, 64


class Guess:
    """Guesses the objective of positions; larger is better.

    Parameters
    ----------
    study : Study
        Models, sensors, variables, objective.
    """

    def __init__(self, study: Study) -> None:
        self._study = study
        rng = np.random.default_rng(0)  # of its own: which faces is no matter of the search
        self._chosen: list[NDArray[np.intp]] = []
        each = max(_FACES // len(study.models), _LEAST)
        for model in study.models:
            proper = np.flatnonzero(model.areas)
            self._chosen.append(np.sort(rng.permutation(proper)[:each]))
        chosen = list(zip(study.models, self._chosen, strict=True))
        # of all models, coordinate by coordinate; single precision is plenty for ranks
        self._points = np.concatenate([m.centroids[f] for m, f in chosen]).T.astype(np.float32)
        self._normals = np.concatenate([m.normals[f] for m, f in chosen]).T.astype(np.float32)
        self._areas = [model.areas[faces] for model, faces in chosen]
        self._ends = np.cumsum([len(faces) for faces in self._chosen])
        self._scale = np.ones(len(chosen))  # from the chosen faces' values to those of the models
        if not study.objective.is_share:
            whole = [m.areas.sum() if study.objective.by_area else m.n_faces for m, _ in chosen]
            parts = [a.sum() if study.objective.by_area else len(a) for a in self._areas]
            self._scale = np.array(whole) / np.array(parts)
        self._memory = Memory(self.faces)
        self._known: set[bytes] = set()
        self._most = min(_MOST_POSES, _MOST_BYTES // ((self.faces + 7) // 8))

    def __call__(self, positions: Floats, sensors: Sequence[int] | None = None) -> Floats:
        """Return the guesses (P,) for positions (P, D), of all or only some sensors."""
        looking = list(range(len(self._study.sensors)) if sensors is None else sensors)
        poses = self._study.rig.poses(positions)[:, looking]
        parts = [
            self._values(poses[first : first + _POSITIONS_AT_ONCE], looking)
            for first in range(0, len(poses), _POSITIONS_AT_ONCE)
        ]
        return np.concatenate([np.zeros(0), *parts])

    def _values(self, poses: Floats, looking: Sequence[int]) -> Floats:
        """Return the guesses (P,) for some of the sensors at poses (P, L, 4, 4)."""
        study = self._study
        counts = np.zeros((len(poses), self.faces), dtype=np.min_scalar_type(len(looking)))
        for sensor in dict.fromkeys(study.sensors[s] for s in looking):
            columns = [c for c, s in enumerate(looking) if study.sensors[s] == sensor]
            different, which = _different(poses[:, columns])
            seen = np.concatenate(
                [
                    self._seen(different[first : first + _POSES_AT_ONCE], sensor)
                    for first in range(0, len(different), _POSES_AT_ONCE)
                ]
            )
            for rows in which.T:
                counts += seen[rows[0]] if (rows == rows[0]).all() else seen[rows]
        by_model = [
            study.objective.values(part, areas)
            for part, areas in zip(
                np.split(counts, self._ends[:-1], axis=1), self._areas, strict=True
            )
        ]
        return study.objective.aggregated(np.stack(by_model, axis=1) * self._scale)

    @property
    def faces(self) -> int:
        """Faces looked at, of all models."""
        return int(self._ends[-1])

    @property
    def is_full(self) -> bool:
        """Whether no more can be remembered."""
        return len(self._known) >= self._most

    def sample(self, maps: Sequence[NDArray[np.uint8]]) -> Bools:
        """Return what is worth remembering (S, n) of maps (S, F), 0 or 1, one a model."""
        parts = [seen[:, faces] for seen, faces in zip(maps, self._chosen, strict=True)]
        return np.concatenate(parts, axis=1).astype(bool)

    def unknown(self, positions: Floats, sensors: Sequence[int] | None) -> NDArray[np.intp]:
        """Return which poses can still be learned: rows of (position, place in ``sensors``)."""
        looking = list(range(len(self._study.sensors)) if sensors is None else sensors)
        found: dict[bytes, tuple[int, int]] = {}
        for p, row in enumerate(self._study.rig.poses(positions)[:, looking]):
            for column, pose in enumerate(row):
                key = pose.tobytes()
                if key not in self._known:
                    found.setdefault(key, (p, column))
        left = self._most - len(self._known)
        return np.array(list(found.values())[:left], dtype=np.intp).reshape(-1, 2)

    def learn(
        self,
        positions: Floats,
        sensors: Sequence[int] | None,
        which: NDArray[np.intp],
        seen: Bools,
    ) -> None:
        """Remember what was ``seen`` (K, n) from the poses (K, 2) that ``unknown`` named."""
        study = self._study
        looking = np.array(list(range(len(study.sensors)) if sensors is None else sensors))
        poses = study.rig.poses(positions)[:, looking][which[:, 0], which[:, 1]]
        self._known |= {pose.tobytes() for pose in poses}
        whose = looking[which[:, 1]]
        in_view = np.zeros(seen.shape, dtype=bool)
        for s in np.unique(whose):
            in_view[whose == s] = self._in_view(poses[whose == s], study.sensors[s])
        self._memory.learn(poses[:, :3, 3], in_view, seen)

    def _seen(self, poses: Floats, sensor: Sensor) -> Bools:
        """Return which faces a sensor probably sees from poses (P, 4, 4): (P, n)."""
        return self._in_view(poses, sensor) & self._memory.free(poses[:, :3, 3])

    def _in_view(self, poses: Floats, sensor: Sensor) -> Bools:
        """Return which faces pass a sensor's filters at poses (P, 4, 4): (P, n)."""
        axes = poses.astype(np.float32).transpose(2, 1, 0)[..., None]  # (4, 4, P, 1)
        shape = (len(poses), self.faces)
        ray = np.zeros((3, *shape), dtype=np.float32)
        np.subtract(self._points[:, None], axes[3, :3], out=ray)
        spare, across, up, depth = np.zeros((4, *shape), dtype=np.float32)
        tan_x, tan_y = (np.float32(tangent) for tangent in sensor.intrinsics.tan_half)
        _dot(axes[0, :3] / tan_x, ray, across, spare)
        _dot(axes[1, :3] / tan_y, ray, up, spare)
        _dot(-axes[2, :3], ray, depth, spare)
        np.maximum(np.abs(across, out=across), np.abs(up, out=up), out=up)
        passes = up <= depth
        passes &= depth >= sensor.min_distance
        passes &= depth <= sensor.max_distance
        away = _dot(self._normals, ray, across, spare)
        passes &= away < 0
        least = _dot(ray, ray, up, spare)
        least *= np.float32(np.cos(sensor.max_incidence) ** 2)
        away *= away
        return passes & (away >= least)


def _different(poses: Floats) -> tuple[Floats, NDArray[np.intp]]:
    """Return the different ones (U, 4, 4) of poses (P, L, 4, 4), and which each is (P, L)."""
    keys = np.ascontiguousarray(poses).reshape(-1, 16).view("V128").reshape(-1).tolist()
    place: dict[bytes, int] = {}
    which = [place.setdefault(key, len(place)) for key in keys]
    different = np.frombuffer(b"".join(place), dtype=np.float64).reshape(-1, 4, 4)
    return different, np.array(which, dtype=np.intp).reshape(poses.shape[:2])


def _dot(one: Singles, other: Singles, out: Singles, spare: Singles) -> Singles:
    """Return ``out``, the sum of products over the first axis, of length 3, always in one order."""
    np.multiply(one[0], other[0], out=out)
    for i in (1, 2):
        out += np.multiply(one[i], other[i], out=spare)
    return out
