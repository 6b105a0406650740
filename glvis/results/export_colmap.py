"""A sparse model without points for COLMAP, and the rigs of sensors with two viewpoints.

Format: https://colmap.github.io/format.html and rigs.html; camera axes x right, y down, z ahead.
"""

from __future__ import annotations

import json
import math
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from glvis.problem.calibrated_lens import CalibratedLens
from glvis.problem.camera import rigid_inverse
from glvis.problem.lens import Lens
from glvis.problem.rotations import OPTICAL, quaternion
from glvis.problem.sensor import Sensor
from glvis.results.calibrations import Calibration, calibration, partner_size
from glvis.search.placement import Placement

Floats = NDArray[np.float64]

# Folders of images of sensors with two viewpoints: COLMAP tells a rig's cameras by them.
FIRST, SECOND = "first", "second"


@dataclass(frozen=True)
class _Camera:
    """A line of ``cameras.txt``."""

    number: int
    pixels: Calibration


def write_colmap(placement: Placement, directory: Path) -> None:
    """Write cameras, images and, where sensors have two viewpoints, rigs into a new folder."""
    study = placement.study
    directory.mkdir()
    kinds = list(dict.fromkeys(study.sensors))
    cameras, seconds, lines = _cameras(kinds)
    images, frames = [], []
    to_cameras = _to_camera(placement.camera_to_world)
    for s, (sensor, to_camera) in enumerate(zip(study.sensors, to_cameras, strict=True)):
        camera, second = cameras.get(sensor), seconds.get(sensor)
        if camera is None:
            continue
        name = _no_space(study.sensor_names[s])  # the name ends at a space
        data = [("CAMERA", camera.number, s + 1)]
        folder = f"{_no_space(sensor.name)}/{FIRST}/" if second else ""
        images += [_image(s + 1, to_camera, camera.number, f"{folder}{name}.png"), ""]
        if second and sensor.partner:
            number, file = len(study.sensors) + s + 1, f"{_no_space(sensor.name)}/{SECOND}/{name}"
            its_own = _to_camera(sensor.partner.poses(placement.camera_to_world[s]))
            images += [_image(number, its_own, second.number, f"{file}.png"), ""]
            data.append(("CAMERA", second.number, number))
        rig = kinds.index(sensor) + 1
        frames.append(_line(s + 1, rig, *_pose(to_camera), len(data), *_flat(data)))
    head = "# IMAGE_ID QW QX QY QZ TX TY TZ CAMERA_ID NAME, then a line of points (none)"
    files = {"cameras": lines, "images": [head, *images], "points3D": ["# no points"]}
    if seconds:
        files["rigs"] = _rigs(kinds, cameras, seconds)
        files["frames"] = [
            "# FRAME_ID RIG_ID QW QX QY QZ TX TY TZ (rig from world) NUM_DATA (TYPE CAMERA IMAGE)",
            *frames,
        ]
        (directory / "rig_config.json").write_text(
            json.dumps(_rig_config(kinds, cameras, seconds), indent=2) + "\n", encoding="utf-8"
        )
    for name, content in files.items():
        (directory / f"{name}.txt").write_text("\n".join(content) + "\n", encoding="utf-8")


def _cameras(
    kinds: list[Sensor],
) -> tuple[dict[Sensor, _Camera], dict[Sensor, _Camera], list[str]]:
    """Return the cameras of sensors, those of their second viewpoints, and ``cameras.txt``."""
    first: dict[Sensor, _Camera] = {}
    second: dict[Sensor, _Camera] = {}
    notes: list[str] = []
    for number, kind in enumerate(kinds, start=1):
        if pixels := calibration(kind.lens, kind.resolution):
            first[kind] = _Camera(number, pixels)
            notes += _lost(number, kind.lens)
        else:
            notes.append(
                f"# {number} is left out: COLMAP has no model for the {kind.lens.kind} lens of "
                f"'{kind.name}'"
            )
    number = len(kinds)
    for kind in first:
        partner = kind.partner
        beside = calibration(partner.lens, partner_size(kind)) if partner else None
        if partner and beside:
            number += 1
            second[kind] = _Camera(number, beside)
            notes.append(f"# {number} is the {partner.role} beside {first[kind].number}")
            notes += _lost(number, partner.lens)
    cameras = [*first.values(), *second.values()]
    head = "# CAMERA_ID MODEL WIDTH HEIGHT fx fy cx cy"
    if any(camera.pixels.model != "PINHOLE" for camera in cameras):
        head = (
            "# CAMERA_ID MODEL WIDTH HEIGHT fx fy cx cy, then coefficients as OpenCV orders them; "
            "cx, cy = OpenCV's + 0.5"
        )
    lines = [
        _line(one.number, one.pixels.model, *one.pixels.size, *one.pixels.params) for one in cameras
    ]
    return first, second, [head, *notes, *lines]


def _lost(number: int, lens: Lens) -> list[str]:
    """Return in a line what of a lens COLMAP's models do not say."""
    if not isinstance(lens, CalibratedLens) or lens.max_angle >= math.pi:
        return []
    end = f"{math.degrees(lens.max_angle):.6g}"
    return [f"# {number} sees nothing beyond {end} degrees off its axis, which is not said here"]


def _rigs(
    kinds: list[Sensor], cameras: dict[Sensor, _Camera], seconds: dict[Sensor, _Camera]
) -> list[str]:
    """Return ``rigs.txt``: a rig a sensor kind, the first viewpoint its reference."""
    lines = ["# RIG_ID NUM_SENSORS REF_TYPE REF_ID, then TYPE ID HAS_POSE and sensor from rig"]
    for rig, kind in enumerate(kinds, start=1):
        if kind not in cameras:
            continue
        other: list[Any] = []
        if kind in seconds:
            other = ["CAMERA", seconds[kind].number, 1, *_pose(_from_first(kind))]
        lines.append(_line(rig, 2 if other else 1, "CAMERA", cameras[kind].number, *other))
    return lines


def _rig_config(
    kinds: list[Sensor], cameras: dict[Sensor, _Camera], seconds: dict[Sensor, _Camera]
) -> list[dict[str, Any]]:
    """Return ``rig_config.json``, for images in folders KIND/first and KIND/second."""
    rigs = []
    for kind in kinds:
        if kind not in seconds:
            continue
        numbers = _pose(_from_first(kind))
        name = _no_space(kind.name)
        rigs.append(
            {
                "cameras": [
                    {
                        "image_prefix": f"{name}/{FIRST}/",
                        "ref_sensor": True,
                        **_config(cameras[kind].pixels),
                    },
                    {
                        "image_prefix": f"{name}/{SECOND}/",
                        "cam_from_rig_rotation": numbers[:4],
                        "cam_from_rig_translation": numbers[4:],
                        **_config(seconds[kind].pixels),
                    },
                ]
            }
        )
    return rigs


def _config(pixels: Calibration) -> dict[str, Any]:
    return {"camera_model_name": pixels.model, "camera_params": pixels.params}


def _from_first(sensor: Sensor) -> Floats:
    """Return the transform (4, 4) from the first optical frame into the second's."""
    assert sensor.partner
    return _to_camera(sensor.partner.partner_to_sensor) @ _optical(np.eye(4))


def _to_camera(camera_to_world: Floats) -> Floats:
    """Return world to optical frame, (..., 4, 4)."""
    return rigid_inverse(_optical(camera_to_world))


def _optical(camera_to_world: Floats) -> Floats:
    """Return the poses (..., 4, 4) of the optical frames of cameras."""
    pose = camera_to_world.copy()
    pose[..., :3, :3] = pose[..., :3, :3] @ OPTICAL
    return pose


def _pose(transform: Floats) -> list[float]:
    """Return a rigid transform as QW QX QY QZ TX TY TZ."""
    return [*quaternion(transform[:3, :3]).tolist(), *transform[:3, 3].tolist()]


def _image(number: int, to_camera: Floats, camera: int, file: str) -> str:
    return _line(number, *_pose(to_camera), camera, file)


def _flat(data: list[tuple[str, int, int]]) -> list[Any]:
    return [value for one in data for value in one]


def _line(*values: Any) -> str:
    return " ".join(map(str, values))


def _no_space(name: str) -> str:
    return name.replace(" ", "_")
