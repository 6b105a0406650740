"""Frames and calibrations for ROS: static transforms, URDF, camera_info; metres.

REP 103 and REP 105; optical frames are x right, y down, z ahead, bodies x ahead, y left, z up.
"""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np

from glvis.common.files import in_one_line
from glvis.problem.lens import Pinhole
from glvis.problem.rotations import BODY, OPTICAL, quaternion, roll_pitch_yaw
from glvis.problem.study import Study
from glvis.problem.units import MM_PER_UNIT
from glvis.results.calibrations import HALF, Calibration, calibration, partner_size
from glvis.search.placement import Placement

# COLMAP's models as ROS calls them, and how many coefficients they have there.
_MODELS = {
    "PINHOLE": ("plumb_bob", 5),
    "OPENCV": ("plumb_bob", 5),
    "FULL_OPENCV": ("rational_polynomial", 8),
    "OPENCV_FISHEYE": ("equidistant", 4),
}


def write_ros(placement: Placement, directory: Path) -> None:
    """Write static transforms in metres, for the shell and as URDF; REP 103, REP 105."""
    study = placement.study
    directory.mkdir()
    to_metres = MM_PER_UNIT[study.unit] / 1000
    shell = ["#!/bin/sh", f"# {in_one_line(study.title)}: poses of the sensors, metres"]
    urdf = ['<?xml version="1.0"?>', '<robot name="sensors">', '  <link name="world"/>']
    for name, sensor, pose in zip(
        study.sensor_names, study.sensors, placement.camera_to_world, strict=True
    ):
        frame = _ros_name(name)
        place = (to_metres * pose[:3, 3]).tolist()
        w, x, y, z = quaternion(pose[:3, :3] @ OPTICAL).tolist()
        shell.append(_publisher("world", f"{frame}_optical_frame", place, [x, y, z, w]))
        body, optical = pose[:3, :3] @ BODY, BODY.T @ OPTICAL
        urdf += _fixed_joint("world", f"{frame}_link", place, body)
        urdf += _fixed_joint(f"{frame}_link", f"{frame}_optical_frame", [0.0, 0.0, 0.0], optical)
        if partner := sensor.partner:
            second, its_pose = f"{frame}_{partner.role}", partner.partner_to_sensor
            place = to_metres * its_pose[:3, 3]
            turn = OPTICAL.T @ its_pose[:3, :3] @ OPTICAL
            w, x, y, z = quaternion(turn).tolist()
            child = f"{second}_optical_frame"
            moved = (OPTICAL.T @ place).tolist()
            shell.append(_publisher(f"{frame}_optical_frame", child, moved, [x, y, z, w]))
            body = BODY.T @ its_pose[:3, :3] @ BODY
            urdf += _fixed_joint(f"{frame}_link", f"{second}_link", (BODY.T @ place).tolist(), body)
            urdf += _fixed_joint(f"{second}_link", child, [0.0, 0.0, 0.0], optical)
    text = "\n".join([*shell, "wait"]) + "\n"
    (directory / "static_transforms.sh").write_text(text, encoding="utf-8")
    (directory / "sensors.urdf").write_text("\n".join([*urdf, "</robot>"]) + "\n", encoding="utf-8")
    _write_camera_info(study, directory / "camera_info")


def _publisher(parent: str, child: str, place: list[float], xyzw: list[float]) -> str:
    """Return the command that publishes where a frame stands in its parent."""
    numbers = zip(("x", "y", "z", "qx", "qy", "qz", "qw"), [*place, *xyzw], strict=True)
    return (
        "ros2 run tf2_ros static_transform_publisher "
        + " ".join(f"--{key} {value!r}" for key, value in numbers)
        + f" --frame-id {parent} --child-frame-id {child} &"
    )


def _write_camera_info(study: Study, directory: Path) -> None:
    """Write the calibrations of sensors that are no plain pinholes, a file a viewpoint."""
    files: dict[str, str] = {}
    for sensor in dict.fromkeys(study.sensors):
        if isinstance(sensor.lens, Pinhole) and sensor.partner is None:
            continue
        name = _ros_name(sensor.name)
        if pixels := calibration(sensor.lens, sensor.resolution):
            files[name] = _camera_info(name, pixels, 0.0)
        if not sensor.partner:
            continue
        second = f"{name}_{sensor.partner.role}"
        if pixels := calibration(sensor.partner.lens, partner_size(sensor)):
            x, *others = sensor.partner.offset
            is_beside = not any(others) and not any(sensor.partner.turn)
            baseline = MM_PER_UNIT[study.unit] / 1000 * x if is_beside else 0.0
            files[second] = _camera_info(second, pixels, baseline)
    if files:
        directory.mkdir()
    for name, text in files.items():
        (directory / f"{name}.yaml").write_text(text, encoding="utf-8")


def _camera_info(name: str, pixels: Calibration, baseline: float) -> str:
    """Return a calibration as camera_info_manager reads it; the baseline is along x, metres.

    References
    ----------
    sensor_msgs/CameraInfo: P[3] of the second camera of a stereo pair is -fx baseline.
    """
    (fx, fy), (cx, cy) = pixels.focal, (c - HALF for c in pixels.centre)
    model, n = _MODELS[pixels.model]
    distortion = [*pixels.coefficients, *[0.0] * (n - len(pixels.coefficients))]
    matrix = [fx, 0.0, cx, 0.0, fy, cy, 0.0, 0.0, 1.0]
    projection = [fx, 0.0, cx, 0.0 - fx * baseline, 0.0, fy, cy, 0.0, 0.0, 0.0, 1.0, 0.0]
    lines = [
        "# Whole numbers are the middles of pixels, as in OpenCV: half a pixel less than COLMAP's.",
        f"image_width: {pixels.size[0]}",
        f"image_height: {pixels.size[1]}",
        f"camera_name: {name}",
        *_matrix("camera_matrix", 3, matrix),
        f"distortion_model: {model}",
        *_matrix("distortion_coefficients", 1, distortion),
        *_matrix("rectification_matrix", 3, np.eye(3).ravel().tolist()),
        *_matrix("projection_matrix", 3, projection),
    ]
    return "\n".join(lines) + "\n"


def _matrix(key: str, rows: int, values: list[float]) -> list[str]:
    return [
        f"{key}:",
        f"  rows: {rows}",
        f"  cols: {len(values) // rows}",
        f"  data: [{', '.join(map(repr, values))}]",
    ]


def _fixed_joint(parent: str, child: str, place: list[float], rotation: np.ndarray) -> list[str]:
    xyz = " ".join(map(repr, place))
    rpy = " ".join(repr(angle) for angle in roll_pitch_yaw(rotation))
    return [
        f'  <link name="{child}"/>',
        f'  <joint name="{child}_joint" type="fixed">',
        f'    <parent link="{parent}"/>',
        f'    <child link="{child}"/>',
        f'    <origin xyz="{xyz}" rpy="{rpy}"/>',
        "  </joint>",
    ]


def _ros_name(name: str) -> str:
    """Return a name that ROS takes for a frame."""
    return re.sub(r"\W", "_", name, flags=re.ASCII)
