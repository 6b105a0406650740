"""First studies: they run as they are, whatever the size, the unit and the axis that is up."""

import math
import tomllib
from pathlib import Path

import numpy as np
import pytest
import shapes

from glvis.cli import main
from glvis.errors import StudyError
from glvis.inputs.checks import study_warnings
from glvis.inputs.scene import Model, load_model
from glvis.inputs.starter import EXAMPLES, fitting_sensor, write_starter
from glvis.inputs.starter_meshes import arm, box, room
from glvis.inputs.study import load_study
from glvis.optim.placement import evaluate_poses
from glvis.outputs.files import files_below


@pytest.mark.parametrize("example", EXAMPLES)
def test_example_runs_as_it_is(tmp_path, example):
    study = load_study(write_starter(tmp_path / "first", example=example))
    assert study_warnings(study) == []
    assert sorted(files_below(tmp_path)) == [f"first/{example}.stl", "first/study.toml"]
    found = evaluate_poses(study)
    assert found.maps[0].coverage > 0.3
    for visible in found.maps[0].visible:
        assert visible.any()


def test_an_arm_is_made_where_nothing_is_asked_for(tmp_path):
    study = load_study(write_starter(tmp_path))
    assert study.sensor_names == ("A1", "C1", "B1", "D1", "A2", "C2", "B2", "D2")
    assert study.models[0].is_closed


@pytest.mark.parametrize(
    ("unit", "radius"),
    [("mm", 1e-3), ("mm", 60), ("mm", 300), ("mm", 900), ("cm", 6), ("in", 2.5), ("ft", 1e5)],
)
def test_study_of_a_ball_of_any_size_sees_it_from_all_sides(tmp_path, unit, radius):
    ball = shapes.icosphere(2, radius, center=(3 * radius, 0, radius))
    shapes.write_off(tmp_path / "ball.off", ball)
    path = write_starter(tmp_path, [tmp_path / "ball.off"], unit=unit, sensors=4)
    study = load_study(path)
    assert study.unit == unit
    assert study_warnings(study) == []
    found = evaluate_poses(study)
    assert found.maps[0].coverage > 0.75
    # the search may go to any corner of its bounds and still see something
    for position in (study.rig.bounds[:, 0], study.rig.bounds[:, 1]):
        there = evaluate_poses(study, position=position).maps[0]
        assert (there.visible.sum(axis=1) > 0).all()


@pytest.mark.parametrize("up", ["x", "y", "z"])
@pytest.mark.parametrize("sensors", [1, 2, 7])
def test_sensors_stand_about_the_axis_that_is_up(tmp_path, up, sensors):
    shapes.write_off(tmp_path / "part.off", shapes.cube(100.0, center=(10, 20, 30)))
    study = load_study(write_starter(tmp_path, [tmp_path / "part.off"], up=up, sensors=sensors))
    assert len(study.sensors) == sensors
    assert study.up["xyz".index(up)] == 1
    poses = study.rig.poses(study.rig.start)
    offset = poses[:, :3, 3] - [10, 20, 30]
    assert np.allclose(np.linalg.norm(offset, axis=1), np.linalg.norm(offset[0]), rtol=1e-2)
    toward = -offset / np.linalg.norm(offset, axis=1, keepdims=True)
    assert np.allclose(-poses[:, :3, 2], toward, atol=1e-2)
    axis = "xyz".index(up)
    assert (np.sign(offset[:, axis]) == [1 if k % 2 == 0 else -1 for k in range(sensors)]).all()


def test_a_flat_part_has_nothing_to_aim_along(tmp_path):
    shapes.write_off(tmp_path / "plate.off", shapes.plate(100.0, cells=(4, 4)))
    study = load_study(write_starter(tmp_path, [tmp_path / "plate.off"]))
    assert not any("aim" in variable.name for variable in study.variables)


@pytest.mark.parametrize(
    ("radius", "unit", "name"),
    [
        (60, "mm", "d415"), (0.06, "m", "d415"), (60 / 25.4, "in", "d415"),
        (1000, "mm", "kinect-v2"), (1, "m", "kinect-v2"),
        (200, "mm", "camera"), (5, "mm", "camera"), (1e6, "mm", "camera"),
    ],
)  # fmt: skip
def test_sensor_has_the_whole_part_in_view_and_range(radius, unit, name):
    sensor, distance = fitting_sensor(radius, unit)
    assert sensor.name == name
    assert sensor.min_distance <= distance - radius * 0.999
    assert distance + radius <= sensor.max_distance
    half = min(sensor.intrinsics.hfov, sensor.intrinsics.vfov) / 2
    assert math.asin(radius / distance) <= half + 1e-9


def test_meshes_are_named_from_the_study(tmp_path):
    for folder in ("parts", "far/away"):
        (tmp_path / folder).mkdir(parents=True)
        shapes.write_off(tmp_path / folder / "cube.off", shapes.cube(100.0))
    near = write_starter(tmp_path / "study", [tmp_path / "parts" / "cube.off"])
    assert tomllib.loads(near.read_text())["scene"]["models"] == ["../parts/cube.off"]
    (tmp_path / "a" / "b").mkdir(parents=True)
    far = write_starter(tmp_path / "a" / "b" / "c", [tmp_path / "parts" / "cube.off"])
    assert tomllib.loads(far.read_text())["scene"]["models"] == [
        (tmp_path / "parts" / "cube.off").as_posix()
    ]
    for path in (near, far):
        assert load_study(path).models[0].file.n_faces == 12


def test_several_models_are_all_in_range(tmp_path):
    shapes.write_off(tmp_path / "a.off", shapes.cube(100.0))
    shapes.write_off(tmp_path / "b.off", shapes.cube(40.0, center=(30, 0, 0)))
    study = load_study(write_starter(tmp_path, [tmp_path / "a.off", tmp_path / "b.off"]))
    assert [model.name for model in study.models] == ["a", "b"]
    assert study_warnings(study) == []


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"models": ["none.stl"]}, "--model none.stl: does not exist"),
        ({"example": "garden"}, "--example garden: must be one of arm, kitchen, room"),
        ({"models": ["a.stl"], "example": "arm"}, "--model and --example exclude each other"),
        ({"unit": "yd"}, "--unit yd: must be one of mm, cm, m, in"),
        ({"unit": "m"}, "--unit: is for the meshes of --model; the examples are in mm"),
        ({"up": "w"}, "--up w: must be one of x, y, z"),
        ({"sensors": 3}, "--sensors: the arm's scanner has eight"),
    ],
)
def test_wrong_choice_is_refused(tmp_path, options, message):
    models = [Path(name) for name in options.pop("models", [])]
    with pytest.raises(StudyError, match=message):
        write_starter(tmp_path / "study", models, **options)
    assert not (tmp_path / "study").exists()


def test_a_study_that_is_there_is_never_replaced(tmp_path):
    (tmp_path / "study.toml").write_text("mine")
    with pytest.raises(StudyError, match=r"study\.toml: is there already; choose another folder"):
        write_starter(tmp_path)
    assert (tmp_path / "study.toml").read_text() == "mine"


def test_a_file_in_place_of_the_folder_is_refused(tmp_path):
    (tmp_path / "file").touch()
    with pytest.raises(StudyError, match="cannot be a folder: there is a file"):
        write_starter(tmp_path / "file" / "study")


def test_command_prints_the_next_three(tmp_path, capsys):
    out = tmp_path / "first"
    assert main(["init", str(out), "--example", "room", "--sensors", "2"]) == 0
    lines = capsys.readouterr().out.splitlines()
    assert lines == [
        f"Wrote {out / 'study.toml'}. Next:",
        f"  glvis check {out / 'study.toml'}",
        f"  glvis optimize {out / 'study.toml'} -o {out / 'out'}",
        f"  glvis explain {out / 'out'}",
    ]
    assert load_study(out / "study.toml").sensor_names == ("K1", "K2")


def test_arm_is_closed_and_looks_outwards(tmp_path):
    model = model_of(arm())
    assert model.is_closed
    assert model.is_consistent
    volume = np.einsum("ij,ij,i->", model.centroids, model.normals, model.areas) / 3
    assert volume > 0


@pytest.mark.parametrize("furniture", ["kitchen", "room"])
def test_walls_look_into_the_room(furniture):
    model = model_of(room(furniture))
    on_floor = model.centroids[:, 2] == 0
    assert on_floor.any()
    assert (model.normals[on_floor, 2] == 1).all()
    assert model.is_consistent


def test_box_is_closed_with_the_area_of_its_sides():
    model = model_of(box((0, 0, 0), (300, 200, 100)))
    assert model.is_closed
    assert model.areas.sum() == pytest.approx(2 * (300 * 200 + 300 * 100 + 200 * 100))
    volume = np.einsum("ij,ij,i->", model.centroids, model.normals, model.areas) / 3
    assert volume == pytest.approx(300 * 200 * 100)


def test_written_mesh_is_the_one_that_was_made(tmp_path):
    write_starter(tmp_path, example="kitchen")
    model = load_model(tmp_path / "kitchen.stl")
    assert np.allclose(model.vertices[model.faces], room("kitchen"), atol=1e-3)


def model_of(triangles: np.ndarray) -> Model:
    faces = np.arange(3 * len(triangles)).reshape(-1, 3)
    return Model.from_arrays("made", triangles.reshape(-1, 3), faces)
