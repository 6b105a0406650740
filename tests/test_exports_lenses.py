"""Exports of lenses and second viewpoints: each camera projects as its lens does, read back here.

The formulas of COLMAP's models are written out from its documentation, apart from the lenses'.
"""

import csv
import json
import math
import re
import xml.etree.ElementTree as ElementTree
from dataclasses import replace

import numpy as np
import pytest
from support.two_cubes import SMALL, write_two_cubes
from test_exports import gltf_of, positions_of, rotation_of, run_in_blender

from glvis.problem.calibrated_lens import FisheyeLens, OpenCVLens
from glvis.problem.camera import rigid_inverse
from glvis.problem.lens import Pinhole, SphericalLens
from glvis.problem.sensor import Partner, Sensor
from glvis.reports.delivery import save
from glvis.reports.export_surfaces import write_surfaces
from glvis.results.calibrations import calibration, unknown_elsewhere
from glvis.results.export_poses import write_exports, write_poses
from glvis.results.given_poses import read_given_poses
from glvis.results.mounting import mounting_lines
from glvis.results.result import write_summary
from glvis.search.placement import evaluate_poses
from glvis.study.loading import load_study

FOUR = OpenCVLens((640, 480), (500, 510), (322.25, 238.5), (-0.3, 0.1, 0.001, -0.002))
EIGHT = OpenCVLens(
    (640, 480), (504, 504), (320, 240), (4.72, 3.2, 1e-4, 2e-4, 0.17, 5.06, 4.78, 0.89)
)
ROUND = FisheyeLens(
    (800, 600), (220, 221), (399, 301), (0.01, -0.002, 3e-4, -1e-5), math.radians(95)
)
NONE = OpenCVLens((640, 480), (500, 500), (319.5, 239.5), ())
LIDAR = SphericalLens(2 * math.pi, (-0.26, 0.26))
OPTICAL = np.diag([1.0, -1.0, -1.0])


def sensor(name, lens, size=(640, 480), **changes):
    return Sensor(name, lens, size, 0.5, 9.0, **changes)


PAIR = sensor(
    "stereo pair",
    Pinhole.from_degrees(60, 40),
    partner=Partner((0.4, 0, 0), Pinhole.from_degrees(60, 40)),
)
PROJECTOR = sensor(
    "scanner",
    FOUR,
    partner=Partner((0.3, 0.1, -0.05), EIGHT, (math.radians(-8), math.radians(3)), "projector"),
)


@pytest.fixture(scope="module")
def plain(tmp_path_factory):
    """Three ideal cameras about a cube, metres."""
    text = SMALL.replace("up = [0, 1, 0]", 'unit = "m"\nup = [0, 1, 0]')
    return evaluate_poses(load_study(write_two_cubes(tmp_path_factory.mktemp("study"), text)))


def placed(plain, *sensors):
    """Return the placement with other sensors in its poses."""
    return replace(plain, study=replace(plain.study, sensors=sensors))


@pytest.fixture
def exported(plain, tmp_path):
    def export(*sensors):
        placement = placed(plain, *sensors)
        write_poses(placement, tmp_path / "poses.csv")
        write_exports(placement, tmp_path)
        write_surfaces(placement, tmp_path)
        return placement, tmp_path

    return export


def lines_of(path):
    return [line.split() for line in path.read_text().splitlines() if line and line[0] != "#"]


def images_of(folder):
    """Return a (4, 4) world to camera, camera and name of each image."""
    found = {}
    for row in lines_of(folder / "colmap" / "images.txt"):
        matrix = np.eye(4)
        matrix[:3, :3] = rotation_of(*map(float, row[1:5]))
        matrix[:3, 3] = list(map(float, row[5:8]))
        found[int(row[0])] = (matrix, int(row[8]), row[9])
    return found


def colmap_pixels(model, params, x, y, z):
    """Return pixels by COLMAP's models: x right, y down, z ahead; from the image's corner."""
    fx, fy, cx, cy, *k = params
    a, b = x / z, y / z
    if model == "OPENCV_FISHEYE":
        r = np.hypot(a, b)
        t = np.arctan(r)
        scale = t * (1 + k[0] * t**2 + k[1] * t**4 + k[2] * t**6 + k[3] * t**8) / r
        a, b = a * scale, b * scale
    elif model != "PINHOLE":
        k1, k2, p1, p2, k3, k4, k5, k6 = [*k, *[0.0] * (8 - len(k))]
        r2 = a * a + b * b
        radial = (1 + k1 * r2 + k2 * r2**2 + k3 * r2**3) / (1 + k4 * r2 + k5 * r2**2 + k6 * r2**3)
        a, b = (
            a * radial + 2 * p1 * a * b + p2 * (r2 + 2 * a * a),
            b * radial + 2 * p2 * a * b + p1 * (r2 + 2 * b * b),
        )
    return fx * a + cx, fy * b + cy


@pytest.mark.parametrize(
    ("lens", "model", "n"),
    [
        (FOUR, "OPENCV", 4),
        (EIGHT, "FULL_OPENCV", 8),
        (ROUND, "OPENCV_FISHEYE", 4),
        (NONE, "PINHOLE", 0),
        (Pinhole.from_degrees(60, 40), "PINHOLE", 0),
    ],
)
@pytest.mark.parametrize("half", [1, 2])
def test_calibrations_project_as_the_lenses_do(lens, model, n, half, rng):
    size = tuple(side // half for side in getattr(lens, "size", (640, 480)))
    found = calibration(lens, size)  # of a calibrated image, or of half as many pixels
    assert found.model == model
    assert len(found.coefficients) == n
    x, y = rng.uniform(-0.4, 0.4, (2, 500))
    depth = rng.uniform(1, 3, 500)
    u, v = lens.project(x * depth, y * depth, depth)
    column, row = colmap_pixels(found.model, found.params, x * depth, -y * depth, depth)
    np.testing.assert_allclose(column, size[0] * u, atol=1e-9)
    np.testing.assert_allclose(row, size[1] * v, atol=1e-9)


def test_centre_of_colmap_is_half_a_pixel_more_than_opencvs(exported):
    _, folder = exported(sensor("a", FOUR), sensor("b", ROUND, (800, 600)), sensor("c", EIGHT))
    rows = lines_of(folder / "colmap" / "cameras.txt")
    assert [row[:4] for row in rows] == [
        ["1", "OPENCV", "640", "480"],
        ["2", "OPENCV_FISHEYE", "800", "600"],
        ["3", "FULL_OPENCV", "640", "480"],
    ]
    assert [[float(v) for v in row[6:8]] for row in rows] == [
        [322.75, 239.0],
        [399.5, 301.5],
        [320.5, 240.5],
    ]
    text = (folder / "colmap" / "cameras.txt").read_text()
    assert "OpenCV's + 0.5" in text
    assert "# 2 sees nothing beyond 95 degrees off its axis" in text
    assert not (folder / "colmap" / "rigs.txt").exists()


def test_a_lens_without_a_model_is_named_and_the_rest_is_written(exported):
    placement, folder = exported(sensor("a", FOUR), sensor("spin", LIDAR, (1800, 16)), PAIR)
    rows = lines_of(folder / "colmap" / "cameras.txt")
    assert [row[0] for row in rows] == ["1", "3", "4"]
    assert (
        "# 2 is left out: COLMAP has no model for the spherical lens of 'spin'"
        in (folder / "colmap" / "cameras.txt").read_text()
    )
    assert sorted(images_of(folder)) == [1, 3, 6]
    (told,) = unknown_elsewhere(placement.study.sensors)
    assert "'spin'" in told
    assert "\n" not in told
    assert "spherical" in told
    assert unknown_elsewhere([PAIR, sensor("a", FOUR)]) == []
    assert {path.stem for path in (folder / "ros" / "camera_info").iterdir()} == {
        "a",
        "stereo_pair",
        "stereo_pair_imager",
    }


def test_images_of_a_second_viewpoint_are_the_pose_times_its_own(exported):
    placement, folder = exported(PAIR, PROJECTOR, sensor("a", FOUR))
    images = images_of(folder)
    assert [images[k][2] for k in (1, 2, 3, 4, 5)] == [
        "stereo_pair/first/A.png",
        "scanner/first/B.png",
        "C.png",
        "stereo_pair/second/A.png",
        "scanner/second/B.png",
    ]
    for s, one in enumerate((PAIR, PROJECTOR)):
        pose = placement.camera_to_world[s]
        for number, expected in ((s + 1, pose), (s + 4, pose @ one.partner.partner_to_sensor)):
            found = rigid_inverse(images[number][0])
            np.testing.assert_allclose(found[:3, :3] @ OPTICAL, expected[:3, :3], atol=1e-12)
            np.testing.assert_allclose(found[:3, 3], expected[:3, 3], atol=1e-12)


def test_rigs_and_frames_of_colmap_agree_with_its_images(exported):
    _, folder = exported(PAIR, PROJECTOR, sensor("a", FOUR))
    images, rigs = images_of(folder), {}
    for row in lines_of(folder / "colmap" / "rigs.txt"):
        rigs[int(row[0])] = row[1:]
    assert rigs[3] == ["1", "CAMERA", "3"]
    frames = lines_of(folder / "colmap" / "frames.txt")
    assert len(frames) == 3
    for s, frame in enumerate(frames):
        n, kind, reference, *rest = rigs[int(frame[1])]
        rig_from_world = np.eye(4)
        rig_from_world[:3, :3] = rotation_of(*map(float, frame[2:6]))
        rig_from_world[:3, 3] = list(map(float, frame[6:9]))
        data = [frame[10 + 3 * k : 13 + 3 * k] for k in range(int(frame[9]))]
        assert len(data) == int(n)
        assert data[0] == [kind, reference, str(s + 1)]
        np.testing.assert_allclose(images[s + 1][0], rig_from_world, atol=1e-12)
        if len(data) == 2:
            assert rest[:3] == ["CAMERA", data[1][1], "1"]
            from_rig = np.eye(4)
            from_rig[:3, :3] = rotation_of(*map(float, rest[3:7]))
            from_rig[:3, 3] = list(map(float, rest[7:10]))
            second, camera, _ = images[int(data[1][2])]
            assert camera == int(data[1][1])
            np.testing.assert_allclose(second, from_rig @ rig_from_world, atol=1e-12)
    config = json.loads((folder / "colmap" / "rig_config.json").read_text())
    assert len(config) == 2
    for rig, one, k in zip(config, (PAIR, PROJECTOR), (1, 2), strict=True):
        first, second = rig["cameras"]
        assert first["ref_sensor"]
        assert images[k][2].startswith(first["image_prefix"])
        assert images[k + 3][2].startswith(second["image_prefix"])
        assert images[k][2].removeprefix(first["image_prefix"]) == (
            images[k + 3][2].removeprefix(second["image_prefix"])
        )
        assert second["camera_params"] == calibration(one.partner.lens, (640, 480)).params
    # the right-hand imager of a parallel pair: a point of its frame is 0.4 less to the right
    np.testing.assert_allclose(config[0]["cameras"][1]["cam_from_rig_translation"], [-0.4, 0, 0])


def test_images_of_colmap_give_the_poses_back(exported):
    placement, folder = exported(PAIR, PROJECTOR, sensor("a", FOUR))
    for file in (folder / "colmap" / "images.txt", folder / "poses.csv"):
        poses = read_given_poses(file, placement.study)
        np.testing.assert_allclose(poses, placement.camera_to_world, atol=1e-12)


def test_ros_frames_of_second_viewpoints_are_the_pose_times_their_own(exported):
    placement, folder = exported(PAIR, PROJECTOR, sensor("a", FOUR))
    frames = {"world": np.eye(4)}
    for line in (folder / "ros" / "static_transforms.sh").read_text().splitlines():
        if not line.startswith("ros2"):
            continue
        value = {key: float(v) for key, v in re.findall(r"--(q?[wxyz]) (\S+)", line)}
        matrix = np.eye(4)
        matrix[:3, :3] = rotation_of(*(value[k] for k in ("qw", "qx", "qy", "qz")))
        matrix[:3, 3] = [value[k] for k in "xyz"]
        parent, child = re.search(r"--frame-id (\S+) --child-frame-id (\S+)", line).groups()
        frames[child] = frames[parent] @ matrix
    links = {"world": np.eye(4)}
    for joint in ElementTree.parse(folder / "ros" / "sensors.urdf").getroot().iter("joint"):
        origin = joint.find("origin")
        roll, pitch, yaw = map(float, origin.get("rpy").split())
        turn = np.eye(4)
        for angle, (i, j) in ((yaw, (0, 1)), (pitch, (2, 0)), (roll, (1, 2))):
            step = np.eye(4)
            step[[i, j], [i, j]] = np.cos(angle)
            step[j, i], step[i, j] = np.sin(angle), -np.sin(angle)
            turn = turn @ step
        turn[:3, 3] = [float(v) for v in origin.get("xyz").split()]
        links[joint.find("child").get("link")] = links[joint.find("parent").get("link")] @ turn
    for s, (name, one) in enumerate((("A_imager", PAIR), ("B_projector", PROJECTOR))):
        expected = placement.camera_to_world[s] @ one.partner.partner_to_sensor
        for found in (frames[f"{name}_optical_frame"], links[f"{name}_optical_frame"]):
            np.testing.assert_allclose(found[:3, 3], expected[:3, 3], atol=1e-9)
            np.testing.assert_allclose(found[:3, :3] @ OPTICAL, expected[:3, :3], atol=1e-9)
    assert "C_optical_frame" in frames


def camera_info(path):
    """Return the keys of a camera_info file; as much YAML as it has."""
    found, key = {}, ""
    for line in path.read_text().splitlines():
        if line.startswith("#"):
            continue
        name, _, value = line.strip().partition(":")
        if not line.startswith(" "):
            key = name
            found[key] = value.strip()
        elif name == "data":
            found[key] = json.loads(value)
    return found


def test_camera_info_counts_pixels_as_opencv_does(exported):
    _, folder = exported(PAIR, PROJECTOR, sensor("eye", ROUND, (800, 600)))
    infos = {path.stem: camera_info(path) for path in (folder / "ros" / "camera_info").iterdir()}
    assert sorted(infos) == [
        "eye", "scanner", "scanner_projector", "stereo_pair", "stereo_pair_imager",
    ]  # fmt: skip
    assert {name: info["distortion_model"] for name, info in infos.items()} == {
        "eye": "equidistant",
        "scanner": "plumb_bob",
        "scanner_projector": "rational_polynomial",
        "stereo_pair": "plumb_bob",
        "stereo_pair_imager": "plumb_bob",
    }
    assert infos["scanner"]["camera_matrix"] == [500, 0, 322.25, 0, 510, 238.5, 0, 0, 1]
    assert infos["scanner"]["distortion_coefficients"] == [-0.3, 0.1, 0.001, -0.002, 0]
    assert infos["scanner_projector"]["distortion_coefficients"] == list(EIGHT.coefficients)
    assert infos["eye"]["distortion_coefficients"] == list(ROUND.coefficients)
    pair = infos["stereo_pair_imager"]
    fx = 320 / math.tan(math.radians(30))
    np.testing.assert_allclose(pair["projection_matrix"][3], -fx * 0.4)
    assert pair["camera_matrix"][2] == 319.5
    assert infos["stereo_pair"]["projection_matrix"][3] == 0
    assert infos["scanner_projector"]["projection_matrix"][3] == 0  # not parallel: no such pair


def test_gltf_has_the_second_viewpoint_under_the_first(exported):
    spin = sensor("spin", LIDAR, (1800, 16), distance="range")
    _, folder = exported(PROJECTOR, spin, PAIR)
    gltf, data = gltf_of(folder / "scene.glb")
    nodes = {node["name"]: node for node in gltf["nodes"]}
    children = [gltf["nodes"][k]["name"] for k in nodes["A"]["children"]]
    assert children == ["A frustum", "A projector frustum", "A projector"]
    node = nodes["A projector"]
    x, y, z, w = node["rotation"]
    pose = PROJECTOR.partner.partner_to_sensor
    np.testing.assert_allclose(rotation_of(w, x, y, z), pose[:3, :3], atol=1e-12)
    np.testing.assert_allclose(node["translation"], PROJECTOR.partner.offset)
    extras = gltf["cameras"][node["camera"]]["extras"]
    assert extras["lens"] == "opencv"
    assert "lens" not in gltf["cameras"][nodes["C"]["camera"]]["extras"]
    assert gltf["cameras"][nodes["B"]["camera"]]["extras"]["distance"] == "range"
    # a band of a lidar: all its points are at the ends of the range, or the centre
    (lines,) = nodes["B"]["children"]
    points = positions_of(gltf, data, gltf["nodes"][lines]["mesh"])
    ranges = np.unique(np.linalg.norm(points, axis=1).round(5))
    assert ranges.tolist() == [0.0, 0.5, 9.0]
    assert len(gltf["scenes"][0]["nodes"]) == 1 + 3


def test_blender_has_a_camera_for_each_viewpoint(exported, monkeypatch):
    placement, folder = exported(PROJECTOR, sensor("spin", LIDAR, (1800, 16)), PAIR)
    bpy, script = run_in_blender(folder, monkeypatch)
    assert [one["name"] for one in script["SENSORS"]] == [
        "A", "B", "C", "A projector", "C imager",
    ]  # fmt: skip
    script["look_through"]("A projector")
    expected = placement.camera_to_world[0] @ PROJECTOR.partner.partner_to_sensor
    np.testing.assert_allclose(bpy.scene.camera.matrix_world, expected)
    half = math.tan(bpy.scene.camera.data.angle_x / 2)
    assert half == pytest.approx(EIGHT.tan_half[0])


def test_table_of_poses_says_what_is_no_ideal_pinhole(exported):
    placement, folder = exported(
        PROJECTOR, sensor("spin", LIDAR, (1800, 16), distance="range"), PAIR
    )
    with (folder / "poses.csv").open(newline="") as file:
        first, spin, pair = csv.DictReader(file)
    assert (first["lens"], first["model"]) == ("opencv", "OPENCV")
    assert json.loads(first["distortion"]) == list(FOUR.coefficients[:4])
    assert (float(first["cx"]), float(first["cy"])) == (322.75, 239.0)
    assert (spin["lens"], spin["fx"], spin["model"], spin["distance"]) == (
        "spherical", "", "", "range",
    )  # fmt: skip
    assert float(spin["hfov_deg"]) == pytest.approx(360)
    assert (first["partner"], spin["partner"], pair["partner"]) == ("projector", "", "imager")
    pose = placement.camera_to_world[2] @ PAIR.partner.partner_to_sensor
    place = [float(pair[f"partner_{axis}"]) for axis in "xyz"]
    np.testing.assert_allclose(place, pose[:3, 3])
    turn = rotation_of(*(float(pair[f"partner_q{k}"]) for k in "wxyz"))
    np.testing.assert_allclose(turn, pose[:3, :3], atol=1e-12)


def test_ideal_pinholes_have_the_columns_and_files_they_had(exported, plain):
    _, folder = exported(*plain.study.sensors)
    head = (folder / "poses.csv").read_text().partition("\n")[0].split(",")
    assert head[-6:] == ["width", "height", "fx", "fy", "cx", "cy"]
    assert {path.name for path in (folder / "colmap").iterdir()} == {
        "cameras.txt", "images.txt", "points3D.txt",
    }  # fmt: skip
    assert not (folder / "ros" / "camera_info").exists()
    assert "rig_config" not in (folder / "README.txt").read_text()


def test_readme_says_where_pixels_are_counted_from(exported):
    _, folder = exported(PAIR, PROJECTOR, sensor("a", FOUR))
    text = (folder / "README.txt").read_text()
    assert "half a pixel less" in text
    assert "rig_config.json" in text


def test_result_and_mounting_name_the_second_viewpoint(plain, tmp_path):
    placement = placed(plain, PAIR, *plain.study.sensors[1:])
    write_summary(placement, tmp_path)
    rows = json.loads((tmp_path / "result.json").read_text())["sensors"]
    assert "max_distance" in rows[0]
    assert list(rows[1]) == [
        "name", "seen", "seen_percentage", "only_it", "only_it_percentage", "quality",
    ]  # fmt: skip
    x, y, z = (placement.camera_to_world[0] @ PAIR.partner.partner_to_sensor)[:3, 3]
    (line,) = [line for line in mounting_lines(placement) if line.startswith("  imager")]
    assert [float(v) for v in re.findall(r"-?\d+\.\d+", line)] == pytest.approx([x, y, z], abs=1e-3)


def test_delivery_says_what_no_export_holds(plain, tmp_path):
    placement = placed(plain, sensor("spin", LIDAR, (1800, 16)), *plain.study.sensors[1:])
    told = save(placement, tmp_path / "out", overwrite=False, pictures=False, meshes=False)
    assert told == unknown_elsewhere(placement.study.sensors)
    warnings = json.loads((tmp_path / "out" / "result.json").read_text())["warnings"]
    assert warnings[-1:] == told
    assert (tmp_path / "out" / "exports" / "colmap" / "images.txt").is_file()
