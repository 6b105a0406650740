"""Poses as other tools read them: a table, COLMAP, ROS, Blender.

Pixels are counted from the upper left corner of the image, whose first pixel has its middle at
(0.5, 0.5), as COLMAP does.
"""

from __future__ import annotations

import math
import re
from pathlib import Path
from typing import Any

import numpy as np

from glvis.common.files import in_one_line
from glvis.common.palette import sensor_colors
from glvis.problem.camera import rigid_inverse
from glvis.problem.rotations import BODY, OPTICAL, quaternion, roll_pitch_yaw
from glvis.problem.study import Study
from glvis.problem.units import MM_PER_UNIT
from glvis.results.mounting import setting_of_pose
from glvis.results.result import sensor_poses, write_csv
from glvis.search.placement import Placement

_README = """\
For other tools. Lengths are in {unit} unless a line says otherwise; the world
is the frame of the mesh files.

../poses.csv           position, unit direction, angles and quaternion of the camera axes (x right,
                       y up, looking along -z), pan and tilt about the study's up ({up}),
                       and the intrinsics in pixels of the sensor's resolution
colmap/                a model for COLMAP (File > Import model): PINHOLE cameras, world to camera
ros/static_transforms.sh  ros2 static_transform_publisher, metres, to optical frames (x right,
                       y down, z ahead)
ros/sensors.urdf       the same as fixed joints, with body frames (x ahead, y left, z up)
blender_scene.py       blender --python blender_scene.py: surfaces, cameras, look_through("NAME")
"""
_README_MESHES = """\
scene.glb              glTF, metres and +Y up: models coloured by sensor, cameras, frusta;
                       one glTF scene a model
*.ply                  each surface with a colour a face: that of the sensor that sees it most
                       squarely
"""
_README_PIECES = """\
                       of a model whose large faces were cut it shows the file's own faces, each
                       in the colour of most of it, with seen_share, the share of its area that
                       any sensor sees
pieces/*.ply           the pieces of such a model; piece_of is the number of the file's face
"""
PIECES = "pieces"  # folder of the surfaces of models whose faces were cut


def write_poses(placement: Placement, path: Path) -> None:
    """Write the poses as a table, a row a sensor."""
    up = placement.study.up
    rows: list[dict[str, Any]] = []
    for s, pose in enumerate(sensor_poses(placement)):
        matrix = placement.camera_to_world[s]
        setting = setting_of_pose(matrix, up)
        intrinsics = pinhole(placement.study, s)
        rows.append(
            {
                "name": pose["name"],
                "sensor": pose["sensor"],
                **dict(zip("xyz", pose["position"], strict=True)),
                **dict(zip(("dx", "dy", "dz"), pose["direction"], strict=True)),
                "azimuth_deg": pose["azimuth_deg"],
                "elevation_deg": pose["elevation_deg"],
                "roll_deg": pose["roll_deg"],
                "pan_deg": setting.pan_deg,
                "tilt_deg": setting.tilt_deg,
                **dict(
                    zip(("qw", "qx", "qy", "qz"), quaternion(matrix[:3, :3]).tolist(), strict=True)
                ),
                **intrinsics,
            }
        )
    write_csv(path, list(rows[0]), [list(row.values()) for row in rows])


def write_exports(placement: Placement, directory: Path, *, meshes: bool = True) -> None:
    """Write what COLMAP, ROS and Blender read into an existing folder, for meshes or without."""
    study = placement.study
    up = ", ".join(f"{value:g}" for value in study.up)
    text = _README.format(unit=study.unit, up=up) + (_README_MESHES if meshes else "")
    if meshes and any(model.pieces for model in study.models):
        text += _README_PIECES
    (directory / "README.txt").write_text(text, encoding="utf-8")
    _write_colmap(placement, directory / "colmap")
    _write_ros(placement, directory / "ros")
    (directory / "blender_scene.py").write_text(
        _blender_script(placement, _surface_files(study) if meshes else []), encoding="utf-8"
    )


def pinhole(study: Study, s: int) -> dict[str, float]:
    """Return width, height, fx, fy, cx, cy of sensor ``s``, pixels of its resolution."""
    sensor = study.sensors[s]
    width, height = sensor.resolution
    fx, fy = sensor.focal_pixels()
    return {"width": width, "height": height, "fx": fx, "fy": fy, "cx": width / 2, "cy": height / 2}


def _write_colmap(placement: Placement, directory: Path) -> None:
    """Write a sparse model without points; https://colmap.github.io/format.html."""
    study = placement.study
    directory.mkdir()
    kinds = list(dict.fromkeys(study.sensors))
    cameras = ["# CAMERA_ID MODEL WIDTH HEIGHT fx fy cx cy"]
    for number, kind in enumerate(kinds, start=1):
        values = pinhole(study, study.sensors.index(kind))
        cameras.append(" ".join(map(str, [number, "PINHOLE", *values.values()])))
    images = ["# IMAGE_ID QW QX QY QZ TX TY TZ CAMERA_ID NAME, then a line of points (none)"]
    optical = placement.camera_to_world.copy()
    optical[:, :3, :3] = optical[:, :3, :3] @ OPTICAL
    for s, matrix in enumerate(rigid_inverse(optical)):
        numbers = [*quaternion(matrix[:3, :3]).tolist(), *matrix[:3, 3].tolist()]
        camera = kinds.index(study.sensors[s]) + 1
        name = study.sensor_names[s].replace(" ", "_")  # the name ends at a space
        images += [" ".join(map(str, [s + 1, *numbers, camera, f"{name}.png"])), ""]
    for name, lines in (("cameras", cameras), ("images", images), ("points3D", ["# no points"])):
        (directory / f"{name}.txt").write_text("\n".join(lines) + "\n", encoding="utf-8")


def _write_ros(placement: Placement, directory: Path) -> None:
    """Write static transforms in metres, for the shell and as URDF; REP 103, REP 105."""
    study = placement.study
    directory.mkdir()
    to_metres = MM_PER_UNIT[study.unit] / 1000
    shell = ["#!/bin/sh", f"# {in_one_line(study.title)}: poses of the sensors, metres"]
    urdf = ['<?xml version="1.0"?>', '<robot name="sensors">', '  <link name="world"/>']
    for name, pose in zip(study.sensor_names, placement.camera_to_world, strict=True):
        frame = _ros_name(name)
        place = (to_metres * pose[:3, 3]).tolist()
        w, x, y, z = quaternion(pose[:3, :3] @ OPTICAL).tolist()
        numbers = zip(("x", "y", "z", "qx", "qy", "qz", "qw"), [*place, x, y, z, w], strict=True)
        shell.append(
            "ros2 run tf2_ros static_transform_publisher "
            + " ".join(f"--{key} {value!r}" for key, value in numbers)
            + f" --frame-id world --child-frame-id {frame}_optical_frame &"
        )
        body, optical = pose[:3, :3] @ BODY, BODY.T @ OPTICAL
        urdf += _fixed_joint("world", f"{frame}_link", place, body)
        urdf += _fixed_joint(f"{frame}_link", f"{frame}_optical_frame", [0.0, 0.0, 0.0], optical)
    text = "\n".join([*shell, "wait"]) + "\n"
    (directory / "static_transforms.sh").write_text(text, encoding="utf-8")
    (directory / "sensors.urdf").write_text("\n".join([*urdf, "</robot>"]) + "\n", encoding="utf-8")


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


_BLENDER = '''\
"""{title}: surfaces and sensors. Run it by: blender --python blender_scene.py

One Blender unit is one {unit}. look_through("NAME") makes a sensor's camera the active one and
gives the render its pixels; a render is then what the sensor sees.
"""

from pathlib import Path

import bpy
from mathutils import Matrix

FOLDER = Path(__file__).resolve().parent
UNIT_IN_METRES = {metres!r}
SURFACES = {surfaces!r}
SENSORS = [
{sensors}
]


def add_sensor(sensor):
    data = bpy.data.cameras.new(sensor["name"])
    data.sensor_fit = "HORIZONTAL"
    data.angle_x = sensor["hfov"]
    data.clip_start = sensor["clip_start"]
    data.clip_end = sensor["max_distance"]
    data.display_size = sensor["max_distance"] / 10
    camera = bpy.data.objects.new(sensor["name"], data)
    camera.matrix_world = Matrix(sensor["camera_to_world"])  # both look along -z, y up
    camera.color = [*sensor["color"], 1.0]
    bpy.context.scene.collection.objects.link(camera)


def look_through(name):
    sensor = next(sensor for sensor in SENSORS if sensor["name"] == name)
    scene = bpy.context.scene
    scene.camera = bpy.data.objects[name]
    scene.render.resolution_x, scene.render.resolution_y = sensor["resolution"]
    scene.render.resolution_percentage = 100
    scene.render.pixel_aspect_x, scene.render.pixel_aspect_y = sensor["pixel_aspect"]


def main():
    bpy.context.scene.unit_settings.scale_length = UNIT_IN_METRES
    for name in SURFACES:
        bpy.ops.wm.ply_import(
            filepath=str(FOLDER / (name + ".ply")), forward_axis="Y", up_axis="Z"
        )
    for sensor in SENSORS:
        add_sensor(sensor)
    if SENSORS:
        look_through(SENSORS[0]["name"])


main()
'''


def _blender_script(placement: Placement, surfaces: list[str]) -> str:
    study = placement.study
    sensors = []
    colors = sensor_colors(len(study.sensors)) / 255
    for s, (name, sensor) in enumerate(zip(study.sensor_names, study.sensors, strict=True)):
        width, height = sensor.resolution
        tan_x, tan_y = sensor.lens.tan_half.tolist()
        tall = (tan_y / height) / (tan_x / width)  # of a pixel, in its widths
        sensors.append(
            {
                "name": name,
                "sensor": sensor.name,
                "hfov": sensor.lens.opening[0],
                "resolution": [width, height],
                # Blender wants both at least 1
                "pixel_aspect": [max(1.0, 1 / tall), max(1.0, tall)],
                "clip_start": sensor.max_distance / 1000,
                "min_distance": sensor.min_distance,
                "max_distance": sensor.max_distance,
                "max_incidence_deg": math.degrees(sensor.max_incidence),
                "color": [round(value, 4) for value in colors[s].tolist()],
                "camera_to_world": placement.camera_to_world[s].tolist(),
            }
        )
    return _BLENDER.format(
        title=in_one_line(study.title).replace("\\", "/").replace('"', "'"),
        unit=study.unit,
        metres=MM_PER_UNIT[study.unit] / 1000,
        surfaces=surfaces,
        sensors="".join(f"    {sensor!r},\n" for sensor in sensors).rstrip(),
    )


def _surface_files(study: Study) -> list[str]:
    """Return the files that show the surfaces of a study best, without their ending."""
    are_cut = [bool(model.pieces) for model in study.models] + [False] * len(study.obstacles)
    return [
        f"{PIECES}/{name}" if is_cut else name
        for name, is_cut in zip(surface_names(study), are_cut, strict=True)
    ]


def surface_names(study: Study) -> list[str]:
    """Return the names that the surfaces of a study are exported by, models first."""
    return [m.name for m in study.models] + [f"obstacle-{m.name}" for m in study.obstacles]
