"""Where and how to mount the sensors, in the words of whoever holds the drill.

Pan, tilt and roll are about the study's ``up``, as a tripod has them: pan is the compass
direction of the view in the level plane, tilt its angle from level, roll the turn of the image.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from glvis.problem.camera import look_along, position_direction_roll
from glvis.search.placement import Placement

Floats = NDArray[np.float64]

_VERTICAL = 1e-6  # sine from which on a view counts as straight up or down
# Places behind the point that a length is told with: a tenth of a millimetre or so.
DECIMALS = {"mm": 1, "cm": 2, "m": 4, "in": 2, "inch": 2, "ft": 3}


@dataclass(frozen=True)
class Setting:
    """How a tripod head would have to be set.

    Attributes
    ----------
    pan_deg : float
        Angle in the level plane from the reference direction to the view, counter-clockwise
        seen from above, in (-180, 180]. Of a view straight up or down: of the image's upper
        edge.
    tilt_deg : float
        Angle of the view above level, negative below.
    roll_deg : float
        Turn of the sensor about its view, clockwise seen from behind; 0 is a level image. Of a
        view straight up or down: 0, as pan tells it all.
    """

    pan_deg: float
    tilt_deg: float
    roll_deg: float

    @property
    def is_vertical(self) -> bool:
        """Whether the view is straight up or down."""
        return math.cos(math.radians(self.tilt_deg)) < _VERTICAL


def level_axes(up: ArrayLike) -> tuple[Floats, Floats, str]:
    """Return the reference direction of pan, the direction of pan 90, and the first's name.

    The reference is world X; where ``up`` is along X, it is Y.
    """
    axis = np.asarray(up, dtype=float) / np.linalg.norm(up)
    name, reference = ("+Y", [0.0, 1.0, 0.0]) if abs(axis[0]) > 0.8 else ("+X", [1.0, 0.0, 0.0])
    level = np.array(reference) - np.dot(reference, axis) * axis
    level /= np.linalg.norm(level)
    return level, np.cross(axis, level), name


def setting_of_pose(pose: ArrayLike, up: ArrayLike) -> Setting:
    """Return pan, tilt and roll of a pose (4, 4); the inverse of ``pose_of_setting``."""
    axis = np.asarray(up, dtype=float) / np.linalg.norm(up)
    ahead, left, _ = level_axes(axis)
    matrix = np.asarray(pose, dtype=float)
    _, direction, roll = position_direction_roll(matrix, axis)
    rise = float(np.clip(direction @ axis, -1, 1))
    across = math.hypot(direction @ ahead, direction @ left)
    if across < _VERTICAL:
        heading = matrix[:3, 1]  # the image's upper edge
        return Setting(_angle(heading, ahead, left), math.copysign(90.0, rise), 0.0)
    tilt = math.degrees(math.atan2(rise, across))
    return Setting(_angle(direction, ahead, left), tilt, math.degrees(float(roll)) + 0.0)


def pose_of_setting(position: ArrayLike, setting: Setting, up: ArrayLike) -> Floats:
    """Return the pose (4, 4) of a sensor at a place (3,), set to pan, tilt and roll."""
    axis = np.asarray(up, dtype=float) / np.linalg.norm(up)
    ahead, left, _ = level_axes(axis)
    pan, tilt = math.radians(setting.pan_deg), math.radians(setting.tilt_deg)
    heading = ahead * math.cos(pan) + left * math.sin(pan)
    if setting.is_vertical:
        backwards = -math.copysign(1.0, tilt) * axis
        pose = np.eye(4)
        pose[:3, :3] = np.stack([np.cross(heading, backwards), heading, backwards], axis=1)
        pose[:3, 3] = position
        return pose
    direction = heading * math.cos(tilt) + axis * math.sin(tilt)
    return look_along(position, direction, math.radians(setting.roll_deg), axis)


def mounting_lines(placement: Placement) -> list[str]:
    """Return the instructions: what is measured from where, then each sensor."""
    study = placement.study
    unit, places = study.unit, DECIMALS.get(study.unit, 2)
    has_pairs = any(sensor.partner for sensor in study.sensors)
    positions = placement.camera_to_world[:, :3, 3]
    reference = level_axes(study.up)[2]
    lines = [
        f"{study.title}: where and how to mount the sensors",
        "",
        f"Position: of the optical centre, {unit} from the origin of the mesh files.",
        *(["Of two viewpoints the first, and the second on its own line."] if has_pairs else []),
        f"Up: {_axis_name(study.up)}.",
        f"Pan: from {reference} in the level plane; left is counter-clockwise seen from above.",
        "Tilt: from level.",
        "Roll: from a level image, seen from behind the sensor.",
    ]
    for s, (name, sensor) in enumerate(zip(study.sensor_names, study.sensors, strict=True)):
        x, y, z = (f"{value + 0.0:.{places}f}" for value in np.round(positions[s], places))
        setting = setting_of_pose(placement.camera_to_world[s], study.up)
        lines += [
            "",
            f"{name} ({sensor.name})",
            f"  position   x {x}   y {y}   z {z} {unit}",
            *(f"  {line}" for line in setting_words(setting, reference)),
        ]
        if sensor.partner:
            beside = sensor.partner.poses(placement.camera_to_world[s])[:3, 3]
            x, y, z = (f"{value + 0.0:.{places}f}" for value in np.round(beside, places))
            lines.append(f"  {sensor.partner.role:<10} x {x}   y {y}   z {z} {unit}")
        others = np.linalg.norm(positions - positions[s], axis=1)
        others[s] = math.inf
        if len(others) > 1:
            nearest = int(others.argmin())
            lines.append(
                f"  nearest    {study.sensor_names[nearest]}, {others[nearest]:.{places}f} {unit} "
                "away"
            )
    return lines


def setting_words(setting: Setting, reference: str) -> list[str]:
    """Return pan, tilt and roll in words, a line each."""
    pan, tilt, roll = (round(v, 1) for v in (setting.pan_deg, setting.tilt_deg, setting.roll_deg))
    if pan in (0.0, 180.0, -180.0):
        turn = f"{abs(pan):.1f} deg: along {reference if pan == 0 else _opposite(reference)}"
    else:
        turn = f"{abs(pan):.1f} deg to the {'left' if pan > 0 else 'right'} of {reference}"
    if setting.is_vertical:
        return [
            f"looks      straight {'up' if tilt > 0 else 'down'}",
            f"image top  {turn}",
        ]
    slope = f"{abs(tilt):.1f} deg {'up' if tilt > 0 else 'down'}" if tilt else "level"
    twist = f"{abs(roll):.1f} deg {'clockwise' if roll > 0 else 'counter-clockwise'}"
    return [f"pan        {turn}", f"tilt       {slope}", f"roll       {twist if roll else 'none'}"]


def _angle(vector: Floats, ahead: Floats, left: Floats) -> float:
    return math.degrees(math.atan2(vector @ left, vector @ ahead)) + 0.0


def _opposite(name: str) -> str:
    return name.replace("+", "-")


def _axis_name(up: Sequence[float] | Floats) -> str:
    """Return "+Y" for [0, 1, 0], else the numbers."""
    for k, letter in enumerate("XYZ"):
        if abs(abs(up[k]) - 1) < 1e-9:
            return f"{'+' if up[k] > 0 else '-'}{letter}"
    return "(" + ", ".join(f"{value:.3g}" for value in up) + ")"
