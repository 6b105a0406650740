"""Poses from files: those that glvis writes come back, others are read as they are meant."""

import json
import re

import numpy as np
import pytest
from support.two_cubes import SMALL, write_two_cubes

from glvis.cli.app import main
from glvis.errors import StudyError
from glvis.problem.camera import look_along
from glvis.problem.rotations import quaternion, rotation
from glvis.results.export_poses import write_exports, write_poses
from glvis.results.folder import result_folder
from glvis.results.given_poses import read_given_poses
from glvis.results.result import write_data, write_summary
from glvis.search.placement import evaluate_poses
from glvis.study.loading import load_study

NAMES = SMALL.replace('name = "C"', 'name = "over the door"')  # COLMAP's names end at a space


@pytest.fixture(scope="module")
def study(tmp_path_factory):
    return load_study(write_two_cubes(tmp_path_factory.mktemp("study"), NAMES))


@pytest.fixture(scope="module")
def placement(study):
    rng = np.random.default_rng(5)
    poses = [
        look_along(rng.normal(size=3), rng.normal(size=3), rng.uniform(-3, 3), study.up)
        for _ in study.sensor_names
    ]
    return evaluate_poses(study, np.stack(poses))


@pytest.fixture(scope="module")
def result(placement, tmp_path_factory):
    """A folder with the files that hold poses."""
    path = tmp_path_factory.mktemp("result") / "out"
    with result_folder(path) as folder:
        write_data(placement, folder.staging)
        write_poses(placement, folder.staging / "poses.csv")
        (folder.staging / "exports").mkdir()
        write_exports(placement, folder.staging / "exports", meshes=False)
        write_summary(placement, folder.staging)
    return path


@pytest.mark.parametrize("name", ["", "result.json", "poses.csv", "exports/colmap/images.txt"])
def test_what_glvis_writes_comes_back(placement, result, study, name):
    poses = read_given_poses(result / name, study)
    np.testing.assert_allclose(poses, placement.camera_to_world, atol=1e-12)
    if name in ("", "result.json"):
        assert np.array_equal(poses, placement.camera_to_world)


def test_poses_go_by_the_names_of_the_sensors(placement, result, tmp_path):
    names = {"A": "A", "over the door": "B", "B": "over the door"}
    text = re.sub(r'name = "([^"]+)"', lambda found: f'name = "{names[found[1]]}"', NAMES)
    other = load_study(write_two_cubes(tmp_path, text))
    assert other.sensor_names == ("A", "over the door", "B")
    poses = read_given_poses(result, other)
    assert np.array_equal(poses, placement.camera_to_world[[0, 2, 1]])


def test_a_result_in_another_unit_is_converted(placement, result, tmp_path):
    inches = load_study(write_two_cubes(tmp_path, NAMES.replace("[scene]", 'unit = "in"\n[scene]')))
    poses = read_given_poses(result, inches)
    np.testing.assert_allclose(
        poses[:, :3, 3], placement.camera_to_world[:, :3, 3] / 25.4, rtol=1e-12
    )
    assert np.array_equal(poses[:, :3, :3], placement.camera_to_world[:, :3, :3])


def test_matrices_by_name_are_read(placement, study, tmp_path):
    path = tmp_path / "mine.json"
    matrices = dict(zip(study.sensor_names, placement.camera_to_world.tolist(), strict=True))
    path.write_text(json.dumps(matrices | {"another": "one"}))
    assert np.array_equal(read_given_poses(path, study), placement.camera_to_world)


def test_a_table_may_have_directions_and_semicolons(placement, study, tmp_path):
    path = tmp_path / "mine.csv"
    rows = ["name;x;y;z;dx;dy;dz;roll_deg"]
    rows += [f"{name};1;2;3;0;0;-2;90" for name in study.sensor_names]
    path.write_text("\ufeff" + "\r\n".join(rows), encoding="utf-8")
    pose = look_along([1, 2, 3], [0, 0, -1], np.pi / 2, study.up)
    np.testing.assert_allclose(read_given_poses(path, study), [pose] * 3, atol=1e-15)


def test_images_of_colmap_have_lines_of_points_between_them(result, placement, study, tmp_path):
    text = (result / "exports/colmap/images.txt").read_text()
    path = tmp_path / "images.txt"
    path.write_text(text.replace(".png\n\n", ".png\n1.5 2.5 -1 3.5 4.5 7\n"))
    np.testing.assert_allclose(read_given_poses(path, study), placement.camera_to_world, atol=1e-12)


@pytest.mark.parametrize("seed", range(5))
def test_quaternions_of_any_length_are_rotations(seed):
    turn = look_along(*np.random.default_rng(seed).normal(size=(2, 3)), seed)[:3, :3]
    for length in (1, -3, 1e-200):
        np.testing.assert_allclose(rotation(length * quaternion(turn)), turn, atol=1e-14)
    with pytest.raises(ValueError, match="a quaternion of zeros is no rotation"):
        rotation(np.zeros(4))


MATRIX, DOUBLE = (json.dumps((k * np.eye(4)).tolist()) for k in (1, 2))
OTHERS = f'"B": {MATRIX}, "over the door": {MATRIX}'
HEAD = "name,x,y,z,qw,qx,qy,qz\n"


@pytest.mark.parametrize(
    ("name", "text", "message"),
    [
        ("a.json", "{}", "has no pose for 'A'; it has none"),
        ("a.json", f'{{"A": {MATRIX}, "B": {MATRIX}}}', "no pose for 'over the door'; it has A, B"),
        (
            "a.json",
            '{"left": 1, "right": 2}',
            "for 'A'; it has left, right, the study's sensors are A",
        ),
        ("a.json", f'{{"A": {MATRIX[:-1]}}}', "is no JSON: Expecting"),
        ("a.json", f'{{"A": [1, 2], {OTHERS}}}', r"camera_to_world\[0\] = 1 must be a list"),
        ("a.json", f'{{"A": {DOUBLE}, {OTHERS}}}', "pose of 'A' is no rigid transform"),
        ("a.json", "[1, 2]", "must hold { sensor: 4 x 4 matrix, ... }, or be a result"),
        ("a.json", '{"poses": [3]}', r"its poses are broken: poses\[0\] = 3 must be"),
        ("a.json", "[" * 100_000, "is no JSON: "),
        ("a.csv", "name,x,y\nA,1,2\n", "needs the columns name, x, y, z and qw, .* it has name, x"),
        ("a.csv", "", "needs the columns .* it has none"),
        ("a.csv", HEAD + "A,1,2,3,1,0,0,zero\n", "qz of 'A' = 'zero' must be a number"),
        ("a.csv", HEAD + "A,1,2,3,1,0,0\n", "qz of 'A' = 'None' must be a number"),
        ("a.csv", HEAD + "A,1,2,nan,1,0,0,0\n", "z of 'A' = 'nan' must be a number"),
        ("a.csv", HEAD + "A,1,2,3,0,0,0,0\n", "its poses are broken"),
        ("a.csv", "name,x,y,z,dx,dy,dz\nA,1,2,3,0,0,0\n", "the direction of 'A' is zero"),
        ("images.txt", "1 0 0 0 0 0 0 0 1\n", "is no line of COLMAP's images.txt"),
        ("images.txt", "1 one 0 0 0 0 0 0 1 A.png\n", "qw of 'A' = 'one' must be a number"),
        ("poses.toml", "", "holds no poses that can be read; they may be a result or its folder"),
    ],
)
def test_broken_poses_are_refused_in_one_line(study, tmp_path, name, text, message):
    path = tmp_path / name
    path.write_text(text)
    with pytest.raises(StudyError, match=message) as caught:
        read_given_poses(path, study)
    assert str(caught.value).startswith(f"{path}: ")
    assert len(str(caught.value)) < 500 and "\n" not in str(caught.value)


def test_poses_that_are_not_there_or_no_text_are_refused(study, tmp_path):
    for name in ("none.json", "none.csv"):
        with pytest.raises(StudyError, match="does not exist"):
            read_given_poses(tmp_path / name, study)
    with pytest.raises(StudyError, match=r"result.json: does not exist"):
        read_given_poses(tmp_path, study)
    (tmp_path / "result.json").write_text("{}")
    with pytest.raises(StudyError, match=r"result.json: is no result of glvis"):
        read_given_poses(tmp_path, study)
    (tmp_path / "bytes.csv").write_bytes(b"name\xff\xfe")
    with pytest.raises(StudyError, match="is no text in UTF-8"):
        read_given_poses(tmp_path / "bytes.csv", study)


@pytest.mark.parametrize("name", ["", "poses.csv", "exports/colmap/images.txt"])
def test_a_layout_scores_the_same_by_its_files(placement, result, study, tmp_path, name, capsys):
    out = tmp_path / "out"
    command = ["evaluate", str(study.path), "-o", str(out), "--poses", str(result / name)]
    assert main([*command, "--no-pictures", "--no-meshes"]) == 0
    again = json.loads((out / "result.json").read_text())
    assert again["objective"]["value"] == pytest.approx(placement.value, abs=1e-12)
