"""Poses as other tools read them: a table, COLMAP, ROS, Blender.

Pixels are counted from the upper left corner of the image, whose first pixel has its middle at
(0.5, 0.5), as COLMAP does.
"""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from glvis.common.files import in_one_line
from glvis.common.palette import second_tones, sensor_colors
from glvis.problem.lens import Lens, Pinhole
from glvis.problem.rotations import quaternion
from glvis.problem.sensor import Sensor
from glvis.problem.study import Study
from glvis.problem.units import MM_PER_UNIT
from glvis.results.calibrations import calibration, partner_size
from glvis.results.export_colmap import write_colmap
from glvis.results.export_ros import write_ros
from glvis.results.mounting import setting_of_pose
from glvis.results.result import sensor_poses, write_csv
from glvis.search.placement import Placement

Floats = NDArray[np.float64]
Colors = NDArray[np.uint8]

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
_README_LENSES = """\
poses.csv              of lenses that are no ideal pinholes: model and coefficients as COLMAP and
                       OpenCV order them, opening angles, range or depth; the pose of a second
                       viewpoint. cx, cy count from the corner of the image: OpenCV's and ROS's
                       centre is half a pixel less
colmap/                PINHOLE, OPENCV, FULL_OPENCV or OPENCV_FISHEYE; what has no model there is
                       named in cameras.txt and left out
ros/camera_info/*.yaml calibrated lenses and both viewpoints of pairs, as camera_info_manager
                       loads them
blender_scene.py       cameras are pinholes that hold the image, drawn without distortion
"""
_README_PAIRS = """\
colmap/rigs.txt        pairs as rigs, with frames.txt; rig_config.json for rig_configurator, with
                       images in KIND/first and KIND/second
ros/                   NAME_ROLE_optical_frame is the second viewpoint, fixed to the first
"""
_SECOND = ("partner", *(f"partner_{key}" for key in ("x", "y", "z", "qw", "qx", "qy", "qz")))
PIECES = "pieces"  # folder of the surfaces of models whose faces were cut


def write_poses(placement: Placement, path: Path) -> None:
    """Write the poses as a table, a row a sensor."""
    up = placement.study.up
    are_ideal = all(sensor.is_ideal for sensor in placement.study.sensors)
    rows: list[dict[str, Any]] = []
    for s, pose in enumerate(sensor_poses(placement)):
        matrix = placement.camera_to_world[s]
        setting = setting_of_pose(matrix, up)
        sensor = placement.study.sensors[s]
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
                **_intrinsics(sensor),
                **({} if are_ideal else _beyond_pinhole(sensor, matrix)),
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
    text += "" if all(sensor.is_ideal for sensor in study.sensors) else _README_LENSES
    text += _README_PAIRS if any(sensor.partner for sensor in study.sensors) else ""
    (directory / "README.txt").write_text(text, encoding="utf-8")
    write_colmap(placement, directory / "colmap")
    write_ros(placement, directory / "ros")
    (directory / "blender_scene.py").write_text(
        _blender_script(placement, _surface_files(study) if meshes else []), encoding="utf-8"
    )


def _intrinsics(sensor: Sensor) -> dict[str, Any]:
    """Return width, height, fx, fy, cx, cy of a sensor; empty where its lens has none."""
    width, height = sensor.resolution
    pixels = calibration(sensor.lens, sensor.resolution)
    numbers = [*pixels.focal, *pixels.centre] if pixels else [""] * 4
    names = ("fx", "fy", "cx", "cy")
    return {"width": width, "height": height, **dict(zip(names, numbers, strict=True))}


def _beyond_pinhole(sensor: Sensor, matrix: Floats) -> dict[str, Any]:
    """Return the columns of sensors that are no ideal pinholes: lens, range, second viewpoint."""
    pixels = calibration(sensor.lens, sensor.resolution)
    across, up = (math.degrees(angle) for angle in sensor.lens.opening)
    partner = sensor.partner
    second: list[Any] = [""] * len(_SECOND)
    if partner:
        pose = partner.poses(matrix)
        turn = quaternion(pose[:3, :3]).tolist()
        second = [partner.role, *pose[:3, 3].tolist(), *turn]
    return {
        "lens": sensor.lens.kind,
        "model": pixels.model if pixels else "",
        # in brackets: of a text that begins with a minus spreadsheets would make a formula
        "distortion": str(list(pixels.coefficients)) if pixels else "",
        "hfov_deg": across,
        "vfov_deg": up,
        "distance": sensor.distance,
        **dict(zip(_SECOND, second, strict=True)),
    }


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
    sensors, seconds = [], []
    colors = sensor_colors(len(study.sensors))
    for s, (name, sensor) in enumerate(zip(study.sensor_names, study.sensors, strict=True)):
        matrix, color = placement.camera_to_world[s], colors[s]
        sensors.append(_blender_camera(name, sensor, sensor.lens, sensor.resolution, matrix, color))
        if partner := sensor.partner:
            view = partner.lens, partner_size(sensor), partner.poses(matrix)
            tone = second_tones(color)
            seconds.append(_blender_camera(f"{name} {partner.role}", sensor, *view, tone))
    sensors += seconds
    return _BLENDER.format(
        title=in_one_line(study.title).replace("\\", "/").replace('"', "'"),
        unit=study.unit,
        metres=MM_PER_UNIT[study.unit] / 1000,
        surfaces=surfaces,
        sensors="".join(f"    {sensor!r},\n" for sensor in sensors).rstrip(),
    )


def _blender_camera(
    name: str, sensor: Sensor, lens: Lens, size: tuple[int, int], matrix: Floats, color: Colors
) -> dict[str, Any]:
    """Return what the script knows of a camera: a pinhole that holds its image."""
    width, height = size
    tan_x, tan_y = lens.tan_half.tolist()
    tall = (tan_y / height) / (tan_x / width)  # of a pixel, in its widths
    is_pinhole = isinstance(lens, Pinhole)
    return {
        "name": name,
        "sensor": sensor.name,
        **({} if is_pinhole else {"lens": lens.kind}),
        "hfov": lens.opening[0] if is_pinhole else 2 * math.atan(tan_x),
        "resolution": [width, height],
        # Blender wants both at least 1
        "pixel_aspect": [max(1.0, 1 / tall), max(1.0, tall)],
        "clip_start": sensor.max_distance / 1000,
        "min_distance": sensor.min_distance,
        "max_distance": sensor.max_distance,
        "max_incidence_deg": math.degrees(sensor.max_incidence),
        "color": [round(value, 4) for value in (color / 255).tolist()],
        "camera_to_world": matrix.tolist(),
    }


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
