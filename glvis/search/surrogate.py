"""The surrogate: a cheap prediction of a layout's value, for which no map is rendered.

Sampled faces of each model are put through the sensors' filters (field of view, working range,
incidence) by their centres of mass. Of the faces that pass, those are left out that `Occlusion`
predicts to be hidden, as maps rendered before from near by found them. Searches rank candidates
by the surrogate; only rendered maps decide.

Plain arithmetic of NumPy, no matrix products: predictions must be the same on every machine that
a search may be resumed on.

References
----------
Shepard, "A Two-dimensional Interpolation Function for Irregularly-spaced Data", ACM National
Conference, 1968: weights that fall with the square of the distance.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from glvis.problem.lens import Pinhole
from glvis.problem.sensor import Sensor
from glvis.problem.study import Study
from glvis.search.auto_options import AutoOptions
from glvis.visibility.filters import (
    Limits,
    crop_back,
    crop_fov,
    crop_near,
    crop_norm,
    measured,
)

if TYPE_CHECKING:
    from scipy.spatial import KDTree

Floats = NDArray[np.float64]
Singles = NDArray[np.float32]
Bools = NDArray[np.bool_]

# So that what is computed of them stays in a core's cache.
_POSITIONS_AT_ONCE, _POSES_AT_ONCE = 256, 64
_ZERO = np.zeros(1, dtype=np.float32)
_SQUARE = Pinhole.from_tangents(1.0, 1.0)  # an image of tangents up to 1
_WEIGHT = 1000  # of the nearest viewpoint's vote; votes are small integers, 16 of them fit 16 bits
_ROOM = 256  # rows that are allocated at first
_LATEST = 128  # viewpoints in a tree of their own, quickly made anew as viewpoints are learned


class Surrogate:
    """A surrogate of the objective that learns from rendered maps; larger is better.

    Parameters
    ----------
    study : Study
        Models, sensors, variables, objective.
    options : AutoOptions, optional
    """

    def __init__(self, study: Study, options: AutoOptions | None = None) -> None:
        options = options or AutoOptions()
        self._study = study
        rng = np.random.default_rng(0)  # of its own: which faces is no matter of the search
        self._sampled: list[NDArray[np.intp]] = []
        each = max(options.faces // len(study.models), options.faces_least)
        for model in study.models:
            proper = np.flatnonzero(model.areas)
            self._sampled.append(np.sort(rng.permutation(proper)[:each]))
        sampled = list(zip(study.models, self._sampled, strict=True))
        # of all models, coordinate by coordinate; single precision is plenty for ranks
        self._points = np.concatenate([m.centroids[f] for m, f in sampled]).T.astype(np.float32)
        self._normals = np.concatenate([m.normals[f] for m, f in sampled]).T.astype(np.float32)
        self._areas = [model.areas[faces] for model, faces in sampled]
        self._ends = np.cumsum([len(faces) for faces in self._sampled])
        self._scale = np.ones(len(sampled))  # from the sampled faces' values to the models'
        if not study.objective.is_share:
            whole = [m.areas.sum() if study.objective.by_area else m.n_faces for m, _ in sampled]
            parts = [a.sum() if study.objective.by_area else len(a) for a in self._areas]
            self._scale = np.array(whole) / np.array(parts)
        self._occlusion = Occlusion(self.faces, options)
        self._known: set[bytes] = set()
        self._most = min(options.poses, options.pose_bytes // ((self.faces + 7) // 8))

    def __call__(self, positions: Floats, sensors: Sequence[int] | None = None) -> Floats:
        """Return predicted values (P,) of positions (P, D), by all or only some sensors."""
        active = list(range(len(self._study.sensors)) if sensors is None else sensors)
        poses = self._study.rig.poses(positions)[:, active]
        parts = [
            self._values(poses[first : first + _POSITIONS_AT_ONCE], active)
            for first in range(0, len(poses), _POSITIONS_AT_ONCE)
        ]
        return np.concatenate([np.zeros(0), *parts])

    def _values(self, poses: Floats, active: Sequence[int]) -> Floats:
        """Return predicted values (P,) for the active sensors at poses (P, L, 4, 4)."""
        study = self._study
        counts = np.zeros((len(poses), self.faces), dtype=np.min_scalar_type(len(active)))
        for sensor in dict.fromkeys(study.sensors[s] for s in active):
            columns = [c for c, s in enumerate(active) if study.sensors[s] == sensor]
            different, which = _unique_poses(poses[:, columns])
            seen = np.concatenate(
                [
                    self._predict_seen(different[first : first + _POSES_AT_ONCE], sensor)
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
        """Number of sampled faces, n, of all models."""
        return int(self._ends[-1])

    @property
    def is_full(self) -> bool:
        """Whether no more can be remembered."""
        return len(self._known) >= self._most

    def sample(self, maps: Sequence[NDArray[np.uint8]]) -> Bools:
        """Return the sampled faces (S, n) of maps (S, F), 0 or 1, one a model."""
        parts = [seen[:, faces] for seen, faces in zip(maps, self._sampled, strict=True)]
        return np.concatenate(parts, axis=1).astype(bool)

    def unknown(self, positions: Floats, sensors: Sequence[int] | None) -> NDArray[np.intp]:
        """Return which poses can still be learned: rows of (position, place in ``sensors``)."""
        active = list(range(len(self._study.sensors)) if sensors is None else sensors)
        found: dict[bytes, tuple[int, int]] = {}
        for p, row in enumerate(self._study.rig.poses(positions)[:, active]):
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
        """Remember which faces were ``seen`` (K, n) from the poses (K, 2) that `unknown` named."""
        study = self._study
        active = np.array(list(range(len(study.sensors)) if sensors is None else sensors))
        poses = study.rig.poses(positions)[:, active][which[:, 0], which[:, 1]]
        self._known |= {pose.tobytes() for pose in poses}
        whose = active[which[:, 1]]
        in_view = np.zeros(seen.shape, dtype=bool)
        for s in np.unique(whose):
            in_view[whose == s] = self._filter(poses[whose == s], study.sensors[s])
        self._occlusion.learn(poses[:, :3, 3], in_view, seen)

    def _predict_seen(self, poses: Floats, sensor: Sensor) -> Bools:
        """Return which faces a sensor probably sees from poses (P, 4, 4): (P, n)."""
        return self._filter(poses, sensor) & self._occlusion.predict_free(poses[:, :3, 3])

    def _filter(self, poses: Floats, sensor: Sensor) -> Bools:
        """Return which faces pass a sensor's filters at poses (P, 4, 4): (P, n)."""
        limits = Limits.of(sensor, self._study.visibility)
        passes = self._pass(poses, limits)
        if sensor.partner:
            second = sensor.partner.poses(poses)
            passes &= self._pass(second, limits.of_partner(sensor.partner))
        return passes

    def _pass(self, poses: Floats, limits: Limits) -> Bools:
        """Return which faces pass the filters of viewpoints at poses (P, 4, 4): (P, n)."""
        axes = poses.astype(np.float32).transpose(2, 1, 0)[..., None]  # (4, 4, P, 1)
        shape = (len(poses), self.faces)
        ray = np.zeros((3, *shape), dtype=np.float32)
        np.subtract(self._points[:, None], axes[3, :3], out=ray)
        spare, across, up, depth = np.zeros((4, *shape), dtype=np.float32)
        is_own = isinstance(limits.lens, Pinhole) and not limits.by_range
        half = limits.lens.tan_half if is_own else np.ones(2)
        tan_x, tan_y = (np.float32(tangent) for tangent in half.tolist())
        _dot(axes[0, :3] / tan_x, ray, across, spare)
        _dot(axes[1, :3] / tan_y, ray, up, spare)
        _dot(-axes[2, :3], ray, depth, spare)
        if is_own:
            # in half images already, so that the farther one out decides
            np.maximum(np.abs(across, out=across), np.abs(up, out=up), out=up)
            passes = crop_fov(up, _ZERO, depth, replace(limits, lens=_SQUARE))
        else:
            passes = crop_fov(across, up, depth, limits)
        passes &= crop_near(measured(across, up, depth, limits), limits)
        height = np.negative(_dot(self._normals, ray, across, spare), out=across)
        squared = _dot(ray, ray, up, spare)
        axis_cos = _ZERO
        if limits.needs_axis:
            axis_cos = _dot(axes[2, :3], self._normals, depth, spare)
        passes &= crop_back(height, axis_cos, limits)
        return passes & crop_norm(height, squared, axis_cos, limits)


class Occlusion:
    """A predictor of occlusion: a distance-weighted vote of the nearest viewpoints rendered.

    Whether something hides a face depends on where a sensor's optical centre is, not on where its
    axis points. A third of the votes suffices for free: optimism is corrected by the next render,
    pessimism never.

    Parameters
    ----------
    faces : int
        Number of faces, n.
    options : AutoOptions, optional
    """

    def __init__(self, faces: int, options: AutoOptions | None = None) -> None:
        self._options = options or AutoOptions()
        self._known = 0
        # rows of viewpoints, room for more at the end: places, and how they vote, 0 for faces
        # that they did not have in view
        self._viewpoints = np.zeros((_ROOM, 3))
        self._votes = np.zeros((_ROOM, faces), dtype=np.int16)
        # of most viewpoints, of the latest; the row where each begins
        self._trees: list[tuple[int, KDTree]] = []

    def learn(self, viewpoints: Floats, in_view: Bools, seen: Bools) -> None:
        """Remember which faces were hidden from some viewpoints.

        Parameters
        ----------
        viewpoints : (N, 3) float64
            Optical centres, world frame.
        in_view : (N, n) bool
            Faces that would be seen if nothing hid them.
        seen : (N, n) bool
            Faces that are seen.
        """
        end = self._known + len(viewpoints)
        while end > len(self._viewpoints):
            self._viewpoints = np.concatenate([self._viewpoints, np.zeros_like(self._viewpoints)])
            self._votes = np.concatenate([self._votes, np.zeros_like(self._votes)])
        self._viewpoints[self._known : end] = viewpoints
        if_hidden = self._options.vote_hidden * in_view
        self._votes[self._known : end] = np.where(seen, self._options.vote_seen, if_hidden)
        self._known = end

    def predict_free(self, viewpoints: Floats) -> Bools:
        """Return which faces nothing hides, probably, from viewpoints (P, 3): (P, n).

        A face that none of the nearest viewpoints had in view is taken for free.
        """
        if self._known == 0:
            return np.ones((len(viewpoints), self._votes.shape[1]), dtype=bool)
        distance, nearest = self._find_nearest(viewpoints)
        flat = self._options.flat_share * distance.max(axis=1, keepdims=True)
        flat = np.maximum(flat, np.finfo(np.float32).tiny)
        weight = (_WEIGHT * (flat / np.maximum(distance, flat)) ** 2).astype(np.int16)
        return np.einsum("pk,pkn->pn", weight, self._votes[nearest]) >= 0

    def _find_nearest(self, viewpoints: Floats) -> tuple[Floats, NDArray[np.intp]]:
        """Return distances (P, k) from viewpoints (P, 3) to the nearest known, and their rows."""
        most = self._options.viewpoints
        distances, places = [], []
        for first, tree in self._update_trees():
            distance, place = tree.query(viewpoints, k=np.arange(1, min(most, tree.n) + 1))
            distances.append(distance)
            places.append(place + first)
        distance, place = np.concatenate(distances, axis=1), np.concatenate(places, axis=1)
        order = np.argsort(distance, axis=1, kind="stable")[:, :most]
        return np.take_along_axis(distance, order, 1), np.take_along_axis(place, order, 1)

    def _update_trees(self) -> list[tuple[int, KDTree]]:
        """Return trees of all viewpoints, and the row where those of each begin."""
        from scipy.spatial import KDTree  # slow to import, and only a search needs it

        if sum(tree.n for _, tree in self._trees) < self._known:
            begin = self._trees[0][1].n if self._trees else 0
            if self._known - begin > _LATEST:
                self._trees = [(0, KDTree(self._viewpoints[: self._known]))]
            else:
                latest = KDTree(self._viewpoints[begin : self._known])
                self._trees = [*self._trees[: begin > 0], (begin, latest)]
        return self._trees


def _unique_poses(poses: Floats) -> tuple[Floats, NDArray[np.intp]]:
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
