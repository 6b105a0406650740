"""First studies: they run as they are, whatever the size, the unit and the axis that is up."""

import math
import shlex
import tomllib
from pathlib import Path

import numpy as np
import pytest
from support import robots, rooms, shapes
from test_scene import glb

from glvis.cli.app import main
from glvis.errors import StudyError
from glvis.evaluation.checks import study_warnings
from glvis.problem.scene import Model, load_model
from glvis.results.journal import files_below
from glvis.search.placement import evaluate_poses
from glvis.study.loading import load_study
from glvis.study.starter import EXAMPLES, write_starter
from glvis.study.starter_layout import fitting_sensor
from glvis.study.starter_meshes import arm, box, room
from glvis.study.starter_study import Choices


@pytest.mark.parametrize("example", EXAMPLES)
def test_example_runs_as_it_is(tmp_path, example):
    study = load_study(write_starter(tmp_path / "first", example=example))
    assert study_warnings(study) == []
    assert sorted(files_below(tmp_path)) == [
        f"first/{example}.stl", "first/study.schema.json", "first/study.toml",
    ]  # fmt: skip
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
    path = write_starter(tmp_path, [tmp_path / "ball.off"], choices=Choices(unit=unit, sensors=4))
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
    study = load_study(
        write_starter(tmp_path, [tmp_path / "part.off"], choices=Choices(up=up, sensors=sensors))
    )
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
    aims = {variable.name for variable in study.variables if ".aim" in variable.name}
    assert aims == {f"S{k}.aim.{axis}" for k in range(1, 5) for axis in "xy"}
    # nobody stands behind a sheet that has one side
    assert (study.rig.poses(study.rig.start)[:, 2, 3] > 0).all()


@pytest.mark.parametrize(
    ("radius", "unit", "name"),
    [
        (60, "mm", "d415-buonamici"), (0.06, "m", "d415-buonamici"),
        (60 / 25.4, "in", "d415-buonamici"),
        (1000, "mm", "kinect-v2"), (1, "m", "kinect-v2"),
        (200, "mm", "camera"), (5, "mm", "camera"), (1e6, "mm", "camera"),
    ],
)  # fmt: skip
def test_sensor_has_the_whole_part_in_view_and_range(radius, unit, name):
    fit = fitting_sensor(radius, unit)
    sensor, distance = fit.sensor, fit.distance
    assert sensor.name == name
    assert sensor.min_distance <= distance - radius * 0.999
    assert distance + radius <= sensor.max_distance
    half = min(sensor.lens.hfov, sensor.lens.vfov) / 2
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


def remarks_of(folder, models, **choices) -> tuple[str, list[str]]:
    """Return the study's path and what was said of the meshes."""
    said = []
    path = write_starter(folder, models, choices=Choices(**choices), on_remark=said.append)
    return path, said


def test_a_robot_of_links_is_one_thing_on_a_floor(tmp_path):
    path, said = remarks_of(tmp_path / "s", robots.write_links(tmp_path))
    assert said[1] == (
        "Warning: 1.08 mm across: are these metres (1.08 m)? Taken for metres (or: --unit mm)"
    )
    assert "The 6 meshes are taken for one thing together (or: --each)" in said
    assert any(line.startswith("Taken for a thing that stands on a floor") for line in said)
    study = load_study(path)
    assert (study.unit, [model.name for model in study.models]) == ("m", ["assembly"])
    assert study.title == "base and 5 more, assembled, 4 sensors"
    assert study.models[0].file.n_faces == sum(len(faces) for _, faces in robots.LINKS.values())
    assert study.objective.by_area
    assert study_warnings(study) == []
    rng = np.random.default_rng(0)
    for x in rng.uniform(*study.rig.bounds.T, (200, len(study.variables))):
        assert (study.rig.poses(x)[:, 2, 3] > 0).all()  # nobody below the floor
    assert evaluate_poses(study).maps[0].visible.any(axis=1).all()


def test_a_pattern_stands_for_all_its_meshes_wherever_they_lie(tmp_path, monkeypatch):
    robots.write_links(tmp_path)
    named = write_starter(tmp_path / "named", sorted(tmp_path.glob("*.off")))
    by_pattern = write_starter(tmp_path / "pattern", [tmp_path / "*.off"])
    monkeypatch.chdir(tmp_path)
    from_here = write_starter(Path("here"), [Path("*.off")])
    for path in (by_pattern, from_here):
        assert path.read_text() == named.read_text()
    with pytest.raises(StudyError, match=r"--model = '\*\.stl' matches no file in \.$"):
        write_starter(tmp_path / "none", [Path("*.stl")])


def test_links_in_frames_of_their_own_are_doubted(tmp_path):
    for name, size in (("a", (1, 1, 4)), ("b", (1, 1, 3)), ("c", (9, 9, 9))):
        vertices, faces = shapes.cube(100.0)
        shift = (500, 0, 0) if name == "c" else (0, 0, 0)
        shapes.write_off(tmp_path / f"{name}.off", (vertices * size + shift, faces))
    _, said = remarks_of(tmp_path / "s", [tmp_path / f"{name}.off" for name in "abc"])
    assert any("is each in a frame of its own?" in line for line in said)


def test_meshes_in_one_place_are_looked_at_one_by_one(tmp_path):
    files = [shapes.write_off(tmp_path / f"{k}.off", shapes.icosphere(2, 50 + k)) for k in range(3)]
    path, said = remarks_of(tmp_path / "s", files)
    assert len(load_study(path).models) == 3
    assert any("one by one (or: --together)" in line for line in said)
    together, said = remarks_of(tmp_path / "t", files, together=True)
    assert len(load_study(together).models) == 1
    assert not any("--together" in line or "--each" in line for line in said)


def turned_up(shape: shapes.Shape, up: str) -> shapes.Shape:
    """Return a shape with its z axis along another one, by a cyclic change of axes."""
    order = {"z": [0, 1, 2], "y": [1, 2, 0], "x": [2, 0, 1]}[up]
    return shape[0][:, order], shape[1]


@pytest.mark.parametrize("up", ["z", "y", "x"])
def test_a_room_is_watched_from_within_off_its_walls_and_furniture(tmp_path, up):
    mesh = shapes.write_off(tmp_path / "room.off", turned_up(rooms.room(), up))
    path, said = remarks_of(tmp_path / "s", [mesh], up=up, sensors=4)
    assert any(line.startswith("Taken for a room, seen from within (or: --around") for line in said)
    assert any(
        line.startswith("Sensor: kinect-v2, 0.5 to 4.5 m (or: --sensor d415-buonamici")
        for line in said
    )
    study = load_study(path)
    assert study.unit == "m"
    axis = "xyz".index(up)
    high = np.array(rooms.SIZE)[{"z": [0, 1, 2], "y": [1, 2, 0], "x": [2, 0, 1]}[up]]
    rng = np.random.default_rng(0)
    for x in rng.uniform(*study.rig.bounds.T, (100, len(study.variables))):
        places = study.rig.poses(x)[:, :3, 3]
        assert (places >= 0.299).all() and (places <= high - 0.299).all()
        assert (places[:, axis] >= 0.69 * high[axis]).all()
    start = study.rig.poses(study.rig.start)
    gaps = np.linalg.norm(start[:, None, :3, 3] - start[None, :, :3, 3], axis=2)
    assert (gaps + 9 * np.eye(4)).min() > 2  # far from each other
    assert study_warnings(study) == []  # in no furniture
    (found,) = evaluate_poses(study).maps
    assert found.visible.any(axis=1).all()


def test_a_scan_of_furniture_is_a_room_though_its_walls_are_missing(tmp_path, shared_data):
    path, _ = remarks_of(tmp_path / "s", [shared_data / "kitchen" / "kitchen.stl"])
    study = load_study(path)
    assert study.unit == "mm"
    assert study_warnings(study) == []
    places = study.rig.poses(study.rig.start)[:, :3, 3]
    assert ((places > 300) & (places < [2700, 2600, 2600])).all()


def test_a_place_that_is_wanted_goes_before_the_guess(tmp_path):
    cube = shapes.write_off(tmp_path / "cube.off", shapes.cube(100.0, center=(0, 0, 50)))
    above, said = remarks_of(tmp_path / "above", [cube], place="above")
    assert not any("Taken for" in line for line in said)
    heights = [v for v in load_study(above).variables if v.name.endswith("height")]
    assert min(v.min for v in heights) + 50 > 0
    room, _ = remarks_of(tmp_path / "room", [cube], place="room", sensor="d415-buonamici")
    study = load_study(room)
    assert {sensor.name for sensor in study.sensors} == {"d415-buonamici"}
    assert (np.abs(study.rig.poses(study.rig.start)[:, :2, 3]) < 50).all()


def test_no_sector_keeps_sensors_from_standing_opposite_each_other(tmp_path):
    ball = shapes.write_off(tmp_path / "ball.off", shapes.icosphere(2, 60.0))
    path = write_starter(tmp_path / "s", [ball])
    study = load_study(path, ["mounts=2"])
    for variable in study.variables:
        if variable.name.endswith("angle_deg"):
            assert (variable.max - variable.min, variable.periodic) == (360, True)
    radius = next(v for v in study.variables if v.name == "S1.ring.radius")
    assert radius.max > 1.1 * radius.min > 60  # distance is searched, outside of the part


@pytest.mark.parametrize("unit", ["mm", "in"])
@pytest.mark.parametrize("sensor", ["d415-buonamici", "kinect-v2"])
@pytest.mark.parametrize("size", [40.0, 400.0, 5000.0])
def test_a_sensor_of_the_catalogue_sees_parts_of_any_size(tmp_path, sensor, size, unit):
    mm = {"mm": 1.0, "in": 25.4}[unit]
    part = shapes.write_off(tmp_path / "part.off", shapes.moved(shapes.cube(size / mm), (7, 8, 9)))
    path, _ = remarks_of(tmp_path / "s", [part], unit=unit, sensor=sensor, sensors=5)
    study = load_study(path)
    assert {one.name for one in study.sensors} == {sensor}
    assert not [line for line in study_warnings(study) if "across" not in line]
    assert evaluate_poses(study).maps[0].visible.any(axis=1).all()
    rng = np.random.default_rng(0)
    low, high = study.models[0].bounds
    for x in rng.uniform(*study.rig.bounds.T, (50, len(study.variables))):
        places = study.rig.poses(x)[:, :3, 3]
        assert not ((places > low) & (places < high)).all(axis=1).any()  # never in the part


@pytest.mark.parametrize(
    ("size", "unit", "taken"),
    [(0.3, None, "m"), (4.0, None, "in"), (1.5, None, "m"), (200, None, "mm"), (0.3, "mm", "mm")],
)
def test_a_unit_is_guessed_from_the_size_and_said(tmp_path, size, unit, taken):
    part = shapes.write_off(tmp_path / "part.off", shapes.cube(size))
    path, said = remarks_of(tmp_path / "s", [part], unit=unit)
    assert load_study(path).unit == taken
    assert any("are these" in line for line in said) == (taken != "mm")


def test_gltf_and_3mf_come_in_their_own_unit_and_up(tmp_path):
    truck = tmp_path / "truck.glb"
    truck.write_bytes(glb([{"mesh": 0}], [shapes.corners(shapes.cube(3.0))]))
    path, said = remarks_of(tmp_path / "g", [truck])
    study = load_study(path)
    assert (study.unit, study.up.tolist()) == ("m", [0, 1, 0])
    assert np.ptp(study.models[0].bounds, axis=0) == pytest.approx(3)
    assert said[0] == "truck: 3 x 3 x 3 m in all, y is up"
    part = shapes.write_3mf(tmp_path / "part.3mf", shapes.cube(4.0), "inch")
    path, said = remarks_of(tmp_path / "i", [part])
    assert load_study(path).unit == "in"
    path, said = remarks_of(tmp_path / "m", [part], unit="mm")
    assert np.ptp(load_study(path).models[0].bounds, axis=0) == pytest.approx(101.6)
    assert said[0] == "part: 102 x 102 x 102 mm in all, z is up (or: --up y)"


def test_what_lies_far_from_the_origin_keeps_its_place(tmp_path):
    part = shapes.write_off(
        tmp_path / "part.off", shapes.cube(100.0, center=(12345.6, -98765.4, 0))
    )
    study = load_study(write_starter(tmp_path / "s", [part]))
    middle = study.rig.poses(study.rig.start)[:, :3, 3].mean(axis=0)
    assert middle[:2] == pytest.approx([12345.6, -98765.4], abs=0.2)


def test_real_meshes_get_a_study_without_a_fault(tmp_path, shared_data):
    units = {"CesiumMilkTruck": "m", "featuretype": "in", "box": "in", "ADIS16480": "m"}
    for mesh in sorted((shared_data / "parts").glob("*")):
        if mesh.suffix == ".md":
            continue
        study = load_study(write_starter(tmp_path / mesh.stem, [mesh]), ["scene.max_edge=off"])
        assert study.unit == units.get(mesh.stem, "m"), mesh
        told = [line for line in study_warnings(study) if "modelled from both sides" not in line]
        assert told == [], mesh
        assert evaluate_poses(study).maps[0].visible.any(axis=1).all()
        floor = study.models[0].bounds[0, 1]
        if mesh.stem == "CesiumMilkTruck":
            heights = [v.min for v in study.variables if v.name.endswith("height")]
            assert study.models[0].bounds[:, 1].mean() + min(heights) > floor


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"models": ["none.stl"]}, "--model none.stl: does not exist"),
        ({"example": "garden"}, "--example garden: must be one of arm, kitchen, room"),
        ({"models": ["a.stl"], "example": "arm"}, "--model and --example exclude each other"),
        ({"unit": "yd"}, "--unit yd: must be one of mm, cm, m, in"),
        ({"unit": "m"}, "--unit: is for the meshes of --model; the examples are in mm"),
        ({"place": "above"}, "--above: is for the meshes of --model"),
        ({"together": False}, "--each: is for the meshes of --model"),
        ({"sensor": "d435"}, "--sensor: sensor 'd435' is unknown; did you mean 'realsense-d435'"),
        ({"sensor": "imx264-8mm"}, "--sensor: sensor 'imx264-8mm' has no max_distance in the"),
        ({"up": "w"}, "--up w: must be one of x, y, z"),
        ({"sensors": 3}, "--sensors: the arm's scanner has eight"),
    ],
)
def test_wrong_choice_is_refused(tmp_path, options, message):
    models = [Path(name) for name in options.pop("models", [])]
    with pytest.raises(StudyError, match=message):
        example = options.pop("example", None)
        write_starter(tmp_path / "study", models, example=example, choices=Choices(**options))
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


@pytest.mark.parametrize("example", EXAMPLES)
def test_a_first_study_says_what_it_optimises_and_how(tmp_path, example):
    assert load_study(write_starter(tmp_path, example=example)).assumed == ()


def test_commands_can_be_pasted_whatever_the_folder_is_called(tmp_path, capsys):
    out = tmp_path / "Prüfling ß $x"
    assert main(["init", str(out), "--example", "room"]) == 0
    lines = capsys.readouterr().out.splitlines()[1:]
    assert shlex.split(lines[0]) == ["glvis", "check", str(out / "study.toml")]
    assert shlex.split(lines[1])[-2:] == ["-o", str(out / "out")]


def test_command_takes_one_place_and_says_what_it_found(tmp_path, capsys):
    cube = shapes.write_off(tmp_path / "cube.off", shapes.cube(0.6))
    arguments = ["init", str(tmp_path / "s"), "--model", str(cube)]
    assert main([*arguments, "--above", "--room"]) == 2
    assert "--above and --room exclude each other" in capsys.readouterr().err
    assert main([*arguments, "--sensor", "kinect-v2", "--sensors", "2", "--around"]) == 0
    out = capsys.readouterr().out.splitlines()
    assert out[0] == "cube: 0.6 x 0.6 x 0.6 m in all, z is up (or: --up y)"
    assert out[1].startswith("Warning: 1.04 mm across: are these metres (1.04 m)?")
    assert out[2].startswith("Sensor: kinect-v2, 0.5 to 4.5 m (or: --sensor d415-buonamici")


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
