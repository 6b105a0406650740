"""Files for other tools: each camera projects as ours does, by the target's own conventions."""

import csv
import json
import re
import shutil
import subprocess
import sys
import types
import xml.etree.ElementTree as ElementTree
from pathlib import Path

import numpy as np
import pytest
import trimesh
from support.two_cubes import SMALL, write_two_cubes

from glvis.problem.camera import rigid_inverse
from glvis.problem.rotations import quaternion, roll_pitch_yaw, rotation_between
from glvis.reports.export_surfaces import face_colors, write_surfaces
from glvis.results.export_poses import write_exports, write_poses
from glvis.search.placement import evaluate_poses
from glvis.study.loading import load_study

# Two kinds of sensors, pixels that are not square, a roll, a mirror, another unit and up.
TEXT = (
    SMALL.replace("up = [0, 1, 0]", 'unit = "cm"\nup = [0, 0, 1]')
    .replace("vfov_deg = 42", "vfov_deg = 33.7")
    .replace('name = "C"\nsensor = "eye"', 'name = "C top"\nsensor = "kinect-v2"')
    .replace('"cube.off", "small.off"]', '"cube.off"]\nobstacles = ["small.off"]')
)  # fmt: skip
TOLERANCE = 0.01  # pixels


@pytest.fixture(scope="module")
def placement(tmp_path_factory):
    study = load_study(write_two_cubes(tmp_path_factory.mktemp("study"), TEXT))
    return evaluate_poses(study)


@pytest.fixture(scope="module")
def folder(placement, tmp_path_factory):
    folder = tmp_path_factory.mktemp("exports")
    write_poses(placement, folder / "poses.csv")
    write_exports(placement, folder)
    write_surfaces(placement, folder)
    return folder


@pytest.fixture
def points(rng):
    return rng.uniform(-4, 4, size=(1000, 3))


def pixels_of_ours(placement, s: int, points: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return pixels (N, 2), row 0 on top, and which points lie before the sensor."""
    sensor = placement.study.sensors[s]
    local = points @ rigid_inverse(placement.camera_to_world[s])[:3, :3].T
    local += rigid_inverse(placement.camera_to_world[s])[:3, 3]
    before = local[:, 2] < -0.1
    tangent = local[before, :2] / -local[before, 2:]
    share = 0.5 + tangent * [0.5, -0.5] / sensor.lens.tan_half
    return share * sensor.resolution, before


def assert_same_pixels(placement, s, points, project) -> None:
    expected, before = pixels_of_ours(placement, s, points)
    assert before.sum() > 100
    assert np.abs(project(points[before]) - expected).max() < TOLERANCE


def rotation_of(w, x, y, z) -> np.ndarray:
    """Return the rotation of a unit quaternion, by the textbook."""
    return np.array(
        [
            [1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)],
            [2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)],
            [2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)],
        ]
    )


def test_table_of_poses_projects_as_ours(placement, folder, points):
    with (folder / "poses.csv").open(newline="") as file:
        rows = list(csv.DictReader(file))
    assert [row["name"] for row in rows] == ["A", "B", "C top"]
    assert [row["sensor"] for row in rows] == ["eye", "eye", "kinect-v2"]
    for s, row in enumerate(rows):
        number = {key: float(row[key]) for key in row if key not in ("name", "sensor")}
        rotation = rotation_of(*(number[k] for k in ("qw", "qx", "qy", "qz")))
        place = np.array([number[k] for k in "xyz"])

        def project(p, rotation=rotation, place=place, number=number):
            x, y, z = ((p - place) @ rotation).T
            return np.stack(
                [number["cx"] + number["fx"] * x / -z, number["cy"] - number["fy"] * y / -z], axis=1
            )

        assert_same_pixels(placement, s, points, project)


def test_colmap_projects_as_ours(placement, folder, points):
    lines = (folder / "colmap" / "cameras.txt").read_text().splitlines()
    cameras = {line.split()[0]: line.split()[1:] for line in lines if not line.startswith("#")}
    assert [camera[:3] for camera in cameras.values()] == [
        ["PINHOLE", "96", "64"],
        ["PINHOLE", "512", "424"],
    ]
    text = (folder / "colmap" / "images.txt").read_text()
    images = [line.split() for line in text.splitlines()[1::2]]  # a line of points after each
    assert [image[9] for image in images] == ["A.png", "B.png", "C_top.png"]
    for s, image in enumerate(images):
        rotation = rotation_of(*map(float, image[1:5]))  # world to camera
        place = np.array([float(v) for v in image[5:8]])
        fx, fy, cx, cy = map(float, cameras[image[8]][3:])

        def project(p, rotation=rotation, place=place, k=(fx, fy, cx, cy)):
            x, y, z = (p @ rotation.T + place).T  # x right, y down, z ahead
            return np.stack([k[0] * x / z + k[2], k[1] * y / z + k[3]], axis=1)

        assert_same_pixels(placement, s, points, project)


def optical_projection(placement, s, rotation, place):
    """Return the projection of an optical frame given in metres; the study is in centimetres."""
    tan = placement.study.sensors[s].lens.tan_half

    def project(points):
        x, y, z = ((points / 100 - place) @ rotation).T
        share = 0.5 + 0.5 * np.stack([x / z, y / z], axis=1) / tan
        return share * placement.study.sensors[s].resolution

    return project


def test_ros_transforms_project_as_ours(placement, folder, points):
    lines = (folder / "ros" / "static_transforms.sh").read_text().splitlines()
    calls = [line for line in lines if line.startswith("ros2 run tf2_ros")]
    assert len(calls) == 3
    for s, line in enumerate(calls):
        value = {key: float(v) for key, v in re.findall(r"--(q?[wxyz]) (\S+)", line)}
        rotation = rotation_of(*(value[k] for k in ("qw", "qx", "qy", "qz")))
        place = np.array([value[k] for k in "xyz"])
        assert_same_pixels(placement, s, points, optical_projection(placement, s, rotation, place))
    assert "--child-frame-id C_top_optical_frame &" in calls[2]


def test_shell_script_is_one(folder):
    subprocess.run(["sh", "-n", folder / "ros" / "static_transforms.sh"], check=True)


def test_urdf_joints_project_as_ours(placement, folder, points):
    joints = {}
    for joint in ElementTree.parse(folder / "ros" / "sensors.urdf").getroot().iter("joint"):
        origin = joint.find("origin")
        roll, pitch, yaw = map(float, origin.get("rpy").split())
        turn = np.eye(3)
        for angle, (i, j) in ((yaw, (0, 1)), (pitch, (2, 0)), (roll, (1, 2))):  # Rz Ry Rx
            step = np.eye(3)
            step[[i, j], [i, j]] = np.cos(angle)
            step[j, i], step[i, j] = np.sin(angle), -np.sin(angle)
            turn = turn @ step
        place = np.array([float(v) for v in origin.get("xyz").split()])
        parent, child = joint.find("parent").get("link"), joint.find("child").get("link")
        base, start = joints.get(parent, (np.eye(3), np.zeros(3)))
        joints[child] = (base @ turn, start + base @ place)
    for s, name in enumerate(("A", "B", "C_top")):
        body, place = joints[f"{name}_link"]
        direction = -placement.camera_to_world[s][:3, 2]
        assert np.allclose(body[:, 0], direction)  # x ahead
        assert np.allclose(body[:, 2], placement.camera_to_world[s][:3, 1])  # z up
        rotation, place = joints[f"{name}_optical_frame"]
        assert_same_pixels(placement, s, points, optical_projection(placement, s, rotation, place))


class FakeBlender(types.ModuleType):
    """As much of bpy as the script uses; cameras keep what they were given."""

    def __init__(self):
        super().__init__("bpy")
        self.opened = []
        self.scene = types.SimpleNamespace(
            collection=types.SimpleNamespace(objects=types.SimpleNamespace(link=lambda o: None)),
            render=types.SimpleNamespace(),
            unit_settings=types.SimpleNamespace(),
            camera=None,
        )
        self.context = types.SimpleNamespace(scene=self.scene)
        objects = {}

        class Objects(dict):
            def new(self, name, data):
                objects[name] = types.SimpleNamespace(name=name, data=data)
                self[name] = objects[name]
                return objects[name]

        new_camera = types.SimpleNamespace(new=lambda name: types.SimpleNamespace(name=name))
        self.data = types.SimpleNamespace(cameras=new_camera, objects=Objects())
        load = types.SimpleNamespace(ply_import=lambda **options: self.opened.append(options))
        self.ops = types.SimpleNamespace(wm=load)


def run_in_blender(folder, monkeypatch):
    """Run the script of a result in a Blender of our own; return that and the script's names."""
    bpy, mathutils = FakeBlender(), types.ModuleType("mathutils")
    mathutils.Matrix = np.array
    monkeypatch.setitem(sys.modules, "bpy", bpy)
    monkeypatch.setitem(sys.modules, "mathutils", mathutils)
    path = folder / "blender_scene.py"
    script = {"__file__": str(path), "__name__": "__main__"}
    exec(compile(path.read_text(), path, "exec"), script)
    return bpy, script


def test_blender_cameras_project_as_ours(placement, folder, points, monkeypatch):
    bpy, script = run_in_blender(folder, monkeypatch)
    opened = [options["filepath"] for options in bpy.opened]
    assert opened == [str(folder / "cube.ply"), str(folder / "obstacle-small.ply")]
    assert all(Path(name).is_file() for name in opened)
    assert bpy.scene.unit_settings.scale_length == 0.01
    for s, name in enumerate(("A", "B", "C top")):
        script["look_through"](name)
        camera, render = bpy.scene.camera, bpy.scene.render
        assert camera.name == name
        assert camera.data.sensor_fit == "HORIZONTAL"
        assert min(render.pixel_aspect_x, render.pixel_aspect_y) == 1
        # Blender's manual: the horizontal angle is given, the vertical one follows from the
        # picture's pixels and their aspect
        half = np.tan(camera.data.angle_x / 2) * np.array(
            [
                1,
                render.resolution_y * render.pixel_aspect_y
                / (render.resolution_x * render.pixel_aspect_x),
            ]
        )  # fmt: skip
        matrix = camera.matrix_world

        def project(p, matrix=matrix, half=half, render=render):
            x, y, z = ((p - matrix[:3, 3]) @ matrix[:3, :3]).T
            share = 0.5 + 0.5 * np.stack([x / -z, y / z], axis=1) / half
            return share * [render.resolution_x, render.resolution_y]

        assert_same_pixels(placement, s, points, project)


def gltf_of(path: Path) -> tuple[dict, bytes]:
    data = path.read_bytes()
    assert data[:4] == b"glTF"
    version, total = np.frombuffer(data[4:12], "<u4")
    assert (version, total) == (2, len(data))
    size = int(np.frombuffer(data[12:16], "<u4")[0])
    assert data[16:20] == b"JSON"
    return json.loads(data[20 : 20 + size]), data[28 + size :]


def positions_of(gltf: dict, data: bytes, mesh: int) -> np.ndarray:
    accessor = gltf["accessors"][gltf["meshes"][mesh]["primitives"][0]["attributes"]["POSITION"]]
    view = gltf["bufferViews"][accessor["bufferView"]]
    part = data[view["byteOffset"] : view["byteOffset"] + view["byteLength"]]
    return np.frombuffer(part, "<f4").reshape(-1, 3).astype(float)


def test_gltf_cameras_project_as_ours(placement, folder, points):
    gltf, _ = gltf_of(folder / "scene.glb")
    nodes = {node["name"]: node for node in gltf["nodes"]}
    # study: centimetres, z up; glTF: metres, y up, and z towards the viewer is world -y
    in_gltf = np.stack([points[:, 0], points[:, 2], -points[:, 1]], axis=1) / 100
    for s, name in enumerate(("A", "B", "C top")):
        node = nodes[name]
        camera = gltf["cameras"][node["camera"]]
        assert camera["name"] == name
        x, y, z, w = node["rotation"]
        rotation, place = rotation_of(w, x, y, z), np.array(node["translation"])
        tan_y = np.tan(camera["perspective"]["yfov"] / 2)
        half = np.array([tan_y * camera["perspective"]["aspectRatio"], tan_y])
        expected, before = pixels_of_ours(placement, s, points)
        x, y, z = ((in_gltf[before] - place) @ rotation).T
        share = 0.5 + 0.5 * np.stack([x / -z, y / z], axis=1) / half
        resolution = placement.study.sensors[s].resolution
        assert np.abs(share * resolution - expected).max() < TOLERANCE


def test_gltf_surfaces_lie_where_ours_do(placement, folder):
    gltf, data = gltf_of(folder / "scene.glb")
    nodes = {node["name"]: node for node in gltf["nodes"]}
    for name, mesh in (
        ("cube", placement.study.models[0]),
        ("obstacle-small", placement.study.obstacles[0]),
    ):
        found = positions_of(gltf, data, nodes[name]["mesh"]) + nodes[name]["translation"]
        expected = mesh.vertices[:, [0, 2, 1]] * [1, 1, -1] / 100
        assert np.allclose(found, expected, atol=1e-9)


def test_gltf_frusta_reach_from_the_eye_to_both_ends_of_the_range(placement, folder):
    gltf, data = gltf_of(folder / "scene.glb")
    nodes = {node["name"]: node for node in gltf["nodes"]}
    (lines,) = nodes["C top"]["children"]
    corners = positions_of(gltf, data, gltf["nodes"][lines]["mesh"])
    tan = np.tan(np.radians([70.6 / 2, 60 / 2]))
    for depth, part in ((0.5, corners[:4]), (4.5, corners[4:8])):  # of a Kinect v2, metres
        assert np.allclose(np.abs(part), [*(tan * depth), depth], rtol=1e-6)
    assert np.array_equal(corners[8], [0, 0, 0])


def test_gltf_has_a_scene_a_model_and_all_faces_in_their_colours(tmp_path):
    text = SMALL.replace("[scene]", "[scene]\nscale = 2")
    placement = evaluate_poses(load_study(write_two_cubes(tmp_path, text)))
    write_surfaces(placement, tmp_path)
    gltf, data = gltf_of(tmp_path / "scene.glb")
    names = [node["name"] for node in gltf["nodes"]]
    scenes = {s["name"]: [names[n] for n in s["nodes"]] for s in gltf["scenes"]}
    assert scenes == {"cube": ["cube", "A", "B", "C"], "small": ["small", "A", "B", "C"]}
    colors = face_colors(placement, 0)
    found = {}
    for primitive in gltf["meshes"][gltf["nodes"][0]["mesh"]]["primitives"]:
        accessor = gltf["accessors"][primitive["indices"]]
        view = gltf["bufferViews"][accessor["bufferView"]]
        part = data[view["byteOffset"] : view["byteOffset"] + view["byteLength"]]
        factor = gltf["materials"][primitive["material"]]["pbrMetallicRoughness"]["baseColorFactor"]
        linear = np.array(factor[:3])
        srgb = np.where(linear <= 0.0031308, 12.92 * linear, 1.055 * linear ** (1 / 2.4) - 0.055)
        for face in np.frombuffer(part, "<u4").reshape(-1, 3).tolist():
            found[tuple(face)] = np.round(255 * srgb).astype(int).tolist()
    expected = dict(zip(map(tuple, placement.study.models[0].faces.tolist()), colors.tolist(),
                        strict=True))  # fmt: skip
    assert found == expected


def test_gltf_is_read_by_trimesh(placement, folder):
    scene = trimesh.load_scene(folder / "scene.glb", process=False)
    faces = sum(len(g.faces) for g in scene.geometry.values() if isinstance(g, trimesh.Trimesh))
    assert faces == placement.study.models[0].n_faces + placement.study.obstacles[0].n_faces


def test_gltf_passes_the_khronos_validator(folder):
    node = shutil.which("node")
    has_it = (
        node
        and not subprocess.run(
            [node, "-e", "require('gltf-validator')"], capture_output=True, check=False
        ).returncode
    )
    if not has_it:
        pytest.skip("no gltf-validator: npm install gltf-validator, NODE_PATH=.../node_modules")
    script = (
        "const bytes = new Uint8Array(require('fs').readFileSync(process.argv[1]));"
        "require('gltf-validator').validateBytes(bytes)"
        ".then(report => console.log(JSON.stringify(report.issues)))"
    )
    run = subprocess.run(
        [node, "-e", script, folder / "scene.glb"], capture_output=True, text=True, check=True
    )
    issues = json.loads(run.stdout)
    assert (issues["numErrors"], issues["numWarnings"]) == (0, 0), issues["messages"]


def test_ply_keeps_faces_in_order_with_their_colours(placement, folder):
    mesh = trimesh.load(folder / "cube.ply", process=False)
    model = placement.study.models[0]
    assert np.allclose(mesh.vertices[mesh.faces], model.vertices[model.faces], atol=1e-6)
    colors = face_colors(placement, 0)
    assert np.array_equal(mesh.visual.vertex_colors[mesh.faces][:, 0, :3], colors)
    text = (folder / "cube.ply").read_bytes()
    body = text[text.index(b"end_header\n") + 11 + 36 * 15 :]
    rows = np.frombuffer(body, [("n", "u1"), ("v", "<i4", 3), ("color", "u1", 3), ("seen", "<i4")])
    assert np.array_equal(rows["color"], colors)
    assert np.array_equal(rows["seen"], placement.maps[0].counts)


def test_readme_of_the_exports_names_what_is_there(folder):
    text = (folder / "README.txt").read_text()
    for path in folder.rglob("*"):
        name = path.relative_to(folder).as_posix()
        if path.is_file() and path.suffix not in (".ply", ".txt"):
            assert name in text, name


@pytest.mark.parametrize("seed", range(50))
def test_quaternion_and_its_rotation_are_the_same(seed):
    rng = np.random.default_rng(seed)
    q = rng.normal(size=4) * rng.choice([0, 1], size=4, p=[0.3, 0.7])
    q = np.array([0, 1, 0, 0]) if not q.any() else q / np.linalg.norm(q)
    rotation = rotation_of(*q)
    again = quaternion(rotation)
    assert np.allclose(rotation_of(*again), rotation, atol=1e-12)
    assert again[0] >= 0


@pytest.mark.parametrize(
    ("rotation", "angles"),
    [
        (np.eye(3), (0, 0, 0)),
        ([[0, -1, 0], [1, 0, 0], [0, 0, 1]], (0, 0, 90)),
        ([[1, 0, 0], [0, 0, -1], [0, 1, 0]], (90, 0, 0)),
        ([[0, 0, 1], [0, 1, 0], [-1, 0, 0]], (0, 90, 0)),
    ],
)
def test_roll_pitch_yaw_of_quarter_turns(rotation, angles):
    assert np.degrees(roll_pitch_yaw(rotation)) == pytest.approx(angles)


@pytest.mark.parametrize("end", [[0, 1, 0], [0, -1, 0], [1, 2, 3], [0, 0, -1], [1, 0, 0]])
def test_shortest_rotation_ends_where_it_must(end):
    for start in ([0, 1, 0], [0, 0, 1], [1, 1, 1]):
        turn = rotation_between(start, end)
        unit = np.array(end) / np.linalg.norm(end)
        assert np.allclose(turn @ np.array(start) / np.linalg.norm(start), unit)
        assert np.allclose(turn @ turn.T, np.eye(3))
        assert np.linalg.det(turn) == pytest.approx(1)
