"""Interference: which faces are lit by two or more projectors that disturb each other.

Sensors whose ``emits`` is one group light the scene for themselves and spoil each other's depths
where their light meets. What a projector lights is what is seen from where it stands, in its own
field, whatever side the faces are looked at from up to 90 degrees, and from the lens up to maxD.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from glvis.problem.scene import Model
from glvis.problem.sensor import Sensor
from glvis.problem.study import Study
from glvis.visibility.context import rasterising_in_this_thread
from glvis.visibility.maps import LocalMaps, MapScene

Floats = NDArray[np.float64]
Integers = NDArray[np.int64]


@dataclass(frozen=True, eq=False)
class Interference:
    """How many projectors of each group light each face.

    Attributes
    ----------
    groups : tuple of str
        G groups of two sensors and more.
    members : tuple of tuple of int
        Sensors of each group.
    lit : tuple of (G, F) int64
        One a model: how many projectors of each group light each face.
    """

    groups: tuple[str, ...]
    members: tuple[tuple[int, ...], ...]
    lit: tuple[Integers, ...]

    def most(self, m: int) -> Integers:
        """Return how many projectors of one group light each face of a model at most, (F,)."""
        return self.lit[m].max(axis=0)

    def disturbed_share(self, m: int, model: Model, group: int | None = None) -> float:
        """Return the share of a model's area that two or more projectors of one group light.

        Parameters
        ----------
        m : int
            Index of the model in the study.
        model : Model
            That one.
        group : int, optional
            Index of the group; without it any.
        """
        counts = self.most(m) if group is None else self.lit[m][group]
        return float(model.areas[counts >= 2].sum() / model.areas.sum())


def rival_groups(sensors: Sequence[Sensor]) -> dict[str, tuple[int, ...]]:
    """Return the sensors of each group of two and more that emit into one another, by name."""
    found: dict[str, list[int]] = {}
    for s, sensor in enumerate(sensors):
        if sensor.emits:
            found.setdefault(sensor.emits, []).append(s)
    return {group: tuple(members) for group, members in found.items() if len(members) > 1}


def projector_of(sensor: Sensor) -> Sensor:
    """Return what a sensor lights the scene with, as a sensor that sees what it lights.

    Its partner where that is the projector, else the light stands where the sensor does.
    """
    partner = sensor.partner
    lens = partner.lens if partner and partner.role == "projector" else sensor.lens
    return replace(
        sensor, lens=lens, partner=None, noise=None, min_distance=0.0, max_incidence=math.pi / 2
    )


def projector_pose(sensor: Sensor, camera_to_world: Floats) -> Floats:
    """Return where the light of a sensor at a pose (4, 4) comes from, (4, 4)."""
    partner = sensor.partner
    if partner and partner.role == "projector":
        return partner.poses(camera_to_world)
    return camera_to_world


def find_interference(study: Study, camera_to_world: Floats) -> Interference | None:
    """Return how the projectors of a study disturb each other; None where no two could.

    Parameters
    ----------
    study : Study
        Models, obstacles, S sensors, and what counts as visible.
    camera_to_world : (S, 4, 4) float64
        Poses.

    Raises
    ------
    MachineError
        Where there is no OpenGL.
    """
    groups = rival_groups(study.sensors)
    if not groups:
        return None
    lit = tuple(np.zeros((len(groups), model.n_faces), dtype=np.int64) for model in study.models)
    lights = {sensor: projector_of(sensor) for sensor in dict.fromkeys(study.sensors)}
    scene = MapScene(study.models, study.obstacles, tuple(lights.values()), study.visibility)
    with rasterising_in_this_thread():
        maps = LocalMaps(scene)
    try:
        for g, members in enumerate(groups.values()):
            for sensor in dict.fromkeys(study.sensors[s] for s in members):
                own = [s for s in members if study.sensors[s] == sensor]
                poses = np.stack([projector_pose(sensor, camera_to_world[s]) for s in own])
                seen = maps.visible(poses, lights[sensor])
                for counts, visible in zip(lit, seen, strict=True):
                    counts[g] += visible.sum(axis=0)
    finally:
        maps.release()
    return Interference(tuple(groups), tuple(groups.values()), lit)
