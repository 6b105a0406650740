"""What a layout may be worth: a guess that renders no map.

Some faces of each model are put through the sensors' filters (field of view, working range,
incidence) by their centres of mass. Of those that pass the ones are left out that maps rendered
before found to be hidden from near by, see ``memory.py``. A guess takes a twentieth of the time of
a map or so. Methods rank what they might try by it; only rendered maps decide.

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

# Faces looked at, of all models together, but some of each; more made climbing no quicker. In a
# kitchen of 6,508 faces, of what each of 4,000 random poses would add to two others, the ranks
# agree with those by maps to 0.70 (Spearman) where no map is known, 0.92 where 500 random ones are,
# 0.96 with 1,800 or 6,000, 0.97 with 20,000, and 0.98 by the true maps (800 faces, 16 eyes; one eye
# 0.87, four 0.94, thirty-two no more than sixteen; eyes weighed by rank, the majority won).
_FACES, _LEAST = 600, 100
# What is remembered: poses, and bytes in a checkpoint, one bit a face.
_MOST_POSES, _MOST_BYTES = 1 << 14, 1 << 20
_POSES_AT_ONCE = 64  # so that what is computed of them stays in a core's cache


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
        # coordinate by coordinate; single precision is plenty for ranks
        self._points = [model.centroids[faces].T.astype(np.float32) for model, faces in chosen]
        self._normals = [model.normals[faces].T.astype(np.float32) for model, faces in chosen]
        self._areas = [model.areas[faces] for model, faces in chosen]
        self._memories = [Memory(len(faces)) for faces in self._chosen]
        self._ends = np.cumsum([len(faces) for faces in self._chosen])
        self._known: set[bytes] = set()
        self._most = min(_MOST_POSES, _MOST_BYTES // ((self.faces + 7) // 8))

    def __call__(self, positions: Floats, sensors: Sequence[int] | None = None) -> Floats:
        """Return the guesses (P,) for positions (P, D), of all or only some sensors."""
        study = self._study
        looking = list(range(len(study.sensors)) if sensors is None else sensors)
        poses = study.rig.poses(positions)[:, looking]
        by_model = np.zeros((len(positions), len(study.models)))
        for m, areas in enumerate(self._areas):
            counts = np.zeros((len(positions), len(areas)), dtype=np.intp)
            for column, s in enumerate(looking):
                counts += self._seen(m, poses[:, column], study.sensors[s])
            by_model[:, m] = study.objective.values(counts, areas)
        return study.objective.aggregated(by_model)

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
        for m, part in enumerate(np.split(seen, self._ends[:-1], axis=1)):
            in_view = np.zeros(part.shape, dtype=bool)
            for s in np.unique(whose):
                in_view[whose == s] = self._in_view(m, poses[whose == s], study.sensors[s])
            self._memories[m].learn(poses[:, :3, 3], in_view, part)

    def _seen(self, m: int, poses: Floats, sensor: Sensor) -> Bools:
        """Return which faces of a model a sensor probably sees from poses (P, 4, 4): (P, n)."""
        different, which = np.unique(poses.reshape(len(poses), 16), axis=0, return_inverse=True)
        parts = []
        for first in range(0, len(different), _POSES_AT_ONCE):
            some = different[first : first + _POSES_AT_ONCE].reshape(-1, 4, 4)
            parts.append(self._in_view(m, some, sensor) & self._memories[m].free(some[:, :3, 3]))
        return np.concatenate(parts)[which.reshape(-1)]

    def _in_view(self, m: int, poses: Floats, sensor: Sensor) -> Bools:
        """Return which faces of a model pass a sensor's filters at poses (P, 4, 4), (P, n)."""
        single = poses.astype(np.float32)
        ray = [self._points[m][i] - single[:, i, 3, None] for i in range(3)]
        x, y, back = (_dot(single[:, :3, i, None].swapaxes(0, 1), ray) for i in range(3))
        tan_x, tan_y = sensor.intrinsics.tan_half
        depth, towards = -back, -_dot(self._normals[m], ray)
        passes = (depth >= sensor.min_distance) & (depth <= sensor.max_distance)
        passes &= (np.abs(x) <= tan_x * depth) & (np.abs(y) <= tan_y * depth) & (towards > 0)
        min_cos = np.cos(sensor.max_incidence)
        return passes & (towards * towards >= min_cos * min_cos * _dot(ray, ray))


def _dot(one: Sequence[Singles] | Singles, other: Sequence[Singles] | Singles) -> Singles:
    """Return the sum of products over the first axis, of length 3, always in the same order."""
    return one[0] * other[0] + one[1] * other[1] + one[2] * other[2]
