"""Warnings: each disappointment has its sentence, and a good study has none."""

import numpy as np
import pytest
from support import rooms, shapes
from support.shapes import cube, flipped, icosphere, merged, moved
from test_study import off

from glvis.evaluation.checks import size_doubts, study_warnings
from glvis.study.loading import load_study
from glvis.study.starter import write_starter
from glvis.study.starter_study import Choices

RING = """\
unit = "UNIT"
[scene]
models = ["ball.off"]
max_edge = "off"
scale = SCALE
[sensor.near]
hfov_deg = 60
vfov_deg = 46.8
resolution = [640, 480]
min_distance = 100
max_distance = 400
[[mount]]
name = "A"
sensor = "near"
ring = { axis = "z", radius = RADIUS, angle_deg = 0, height = 0 }
aim = [0, 0, 0]
[[mount]]
name = "B"
sensor = "near"
ring = { axis = "z", radius = RADIUS, angle_deg = TURN, height = 0 }
direction = { azimuth_deg = 270, elevation_deg = 0 }
"""


@pytest.fixture
def warnings_of(tmp_path):
    """Return the warnings of a study about one ball of radius 50."""

    def warn(shape=None, unit="mm", scale=1, radius=300, turn=90, scene="", copies=1):
        names = ["ball.off", *(f"ball{k}.off" for k in range(1, copies))]
        for name in names:
            (tmp_path / name).write_text(off(shape or icosphere(2, radius=50)))
        text = RING.replace("UNIT", unit).replace("SCALE", str(scale))
        text = text.replace('["ball.off"]', str(names)).replace("[sensor", f"{scene}\n[sensor", 1)
        text = text.replace("RADIUS", str(radius)).replace("TURN", str(turn))
        (tmp_path / "s.toml").write_text(text)
        return study_warnings(load_study(tmp_path / "s.toml"))

    return warn


def test_a_good_study_has_no_warning(warnings_of):
    assert warnings_of() == []


def test_faces_without_area_are_counted(warnings_of):
    vertices, faces = icosphere(1, radius=50)
    broken = np.concatenate([faces, [[0, 1, 1], [2, 2, 2]]])
    (found,) = warnings_of((vertices, broken))
    assert found == ("ball: 2 of 82 faces have no area; they are counted and can never be seen")


def test_a_face_wound_the_other_way_is_told(warnings_of):
    vertices, faces = icosphere(1, radius=50)
    faces[5] = faces[5][::-1]
    (found,) = warnings_of((vertices, faces))
    assert found == (
        "ball: 1 % of the faces are wound against their neighbours (two faces walk 3 edges in the "
        "same direction) and count as seen from behind; let the program that made the mesh "
        "recalculate its normals (Blender: Recalculate Outside, MeshLab: Re-Orient all faces "
        "coherently)"
    )


def test_a_model_turned_inside_out_is_told_unless_it_is_a_room(warnings_of):
    inside_out = flipped(icosphere(2, radius=50))
    (found,) = warnings_of(inside_out)
    assert found == (
        "ball: is inside out: its normals point inwards, and from outside no face counts as seen; "
        "set [scene] flip = true"
    )
    assert warnings_of(inside_out, scene="flip = true") == []
    assert warnings_of(flipped(cube(700.0))) == []  # the sensors stand inside


def test_vertices_that_differ_in_the_last_digits_do_not_hide_that_a_model_is_inside_out(
    warnings_of,
):
    vertices, faces = flipped(icosphere(3, radius=50))
    points = vertices[faces.ravel()]  # every face its own, as in an STL
    near = points * (1 + 1e-7 * np.random.default_rng(1).uniform(-1, 1, points.shape))
    soup = near, np.arange(len(near)).reshape(-1, 3)
    assert "set [scene] flip = true" in warnings_of(soup)[0]
    open_one = vertices, faces[7:]  # a hole besides
    assert "set [scene] flip = true" in warnings_of(open_one)[0]


def test_a_body_that_is_inside_out_among_others_is_told_with_its_share(warnings_of):
    ball = icosphere(2, radius=30)
    (found,) = warnings_of(merged(ball, flipped(moved(ball, (70, 0, 0)))))
    assert found.startswith("ball: 50 % of the faces belong to bodies that are inside out, and")


def test_a_cavity_is_not_inside_out(warnings_of):
    assert warnings_of(merged(icosphere(2, radius=50), flipped(icosphere(2, radius=30)))) == []


def test_a_sheet_modelled_from_both_sides_is_told(warnings_of):
    ball = icosphere(2, radius=50)
    (found,) = warnings_of(merged(ball, flipped(ball)))
    assert found.startswith("ball: 100 % of the faces lie on another one that looks the other way")


def test_faces_of_very_different_size_are_counted_by_area(warnings_of):
    uneven = merged(icosphere(4, radius=5, center=(60, 0, 0)), icosphere(2, radius=50))
    (found,) = warnings_of(uneven, scene="[objective]\nby_area = false")
    assert found == (
        "ball: the smaller half of the faces holds 0.5 % of the area, and the objective counts "
        "faces; [objective] by_area = true counts area"
    )
    assert warnings_of(uneven) == []


def test_sensors_in_solid_material_are_told(warnings_of):
    found = warnings_of(cube(700.0))
    assert found[0].startswith("A, B: at the start in solid material of ball, or behind its walls")


def test_a_sensor_in_the_furniture_of_a_room_or_behind_its_walls_is_told(tmp_path):
    shapes.write_off(tmp_path / "room.off", rooms.room())
    places = {"free": (3.0, 0.8, 2.0), "cabinet": (0.3, 1.0, 0.5), "behind": (-1.0, 2.0, 1.5)}
    mounts = "".join(
        f'[[mount]]\nname = "{name}"\nsensor = "depth"\nposition = {list(place)}\naim = [3, 3, 1]\n'
        for name, place in places.items()
    )
    text = rooms.STUDY.format(scene='max_edge = "off"', criterion="centroid", mounts=mounts)
    (tmp_path / "s.toml").write_text(text)
    told = study_warnings(load_study(tmp_path / "s.toml"))
    assert not any("inside out" in line for line in told)
    assert told[-1].startswith("cabinet, behind: at the start in solid material of room, or behind")


def test_sensors_that_stand_at_one_point_are_told_unless_the_search_parts_them(warnings_of):
    assert warnings_of(turn=0)[1:] == [
        "A, B: stand at the same point, wherever the search puts them"
    ]
    free = "{ min = -90, max = 90, start = 0 }"
    assert not any("same point" in line for line in warnings_of(turn=free))


def test_what_is_wrong_with_many_models_is_said_once(warnings_of):
    broken = flipped(icosphere(2, radius=50))
    (found,) = warnings_of(broken, copies=5)
    assert found == (
        "ball: is inside out: its normals point inwards, and from outside no face counts as seen; "
        "set [scene] flip = true (likewise ball1, ball2, 2 more: 5 models)"
    )
    other = warnings_of(broken, copies=5, scene="flip = ['ball', 'ball2', 'ball3', 'ball4']")
    assert other == [
        found.replace("ball:", "ball1:").split(" (likewise")[0].replace("true", "['ball1']")
    ]


@pytest.mark.parametrize(
    ("scale", "message"),
    [
        (
            0.001,
            (
                "ball: is 0.173 mm across, the sensors reach 400 mm; are these metres (173 mm)? "
                "unit = 'm'"
            ),
        ),
        (1000, "ball: is 173000 mm across, the sensors reach 400 mm; is unit = 'mm' right?"),
    ],
)
def test_a_model_in_another_unit_is_told(warnings_of, scale, message):
    assert message in warnings_of(cube(100.0), scale=scale)


@pytest.mark.parametrize(
    ("name", "unit", "remedy"), [("a.off", "mm", "unit = 'm'"), ("a.3mf", "mm", "scale = 1000")]
)
def test_a_size_is_doubted_even_where_sensors_are_made_to_measure(tmp_path, name, unit, remedy):
    write = {".off": shapes.write_off, ".3mf": shapes.write_3mf}
    write[(tmp_path / name).suffix](tmp_path / name, cube(0.3))
    write_starter(tmp_path / "s", [tmp_path / name], choices=Choices(unit=unit))
    study = load_study(tmp_path / "s" / "study.toml")
    assert size_doubts(study) == [
        f"a: is 0.52 mm across; are these metres (520 mm)? {'[scene] ' * (name != 'a.off')}{remedy}"
    ]
    assert study_warnings(study) == []


def test_a_model_beyond_every_range_is_told(warnings_of):
    far, blind = warnings_of(cube(100.0), radius=3000)
    assert far == (
        "ball: at the start all of it lies beyond max_distance of every sensor "
        "(nearest distance 2950 mm); is unit = 'mm' right?"
    )
    assert blind == "at the start no sensor has any part of a model in view and range"


def test_a_model_nearer_than_every_range_is_told(warnings_of):
    near, _ = warnings_of(cube(20.0), unit="cm", radius=80)
    assert near == (
        "ball: at the start all of it lies nearer than min_distance of every sensor "
        "(largest distance 90 cm); is unit = 'cm' right?"
    )


def test_a_sensor_that_looks_elsewhere_is_named(warnings_of):
    assert warnings_of(turn=0)[:1] == ["B: has no part of a model in view and range at the start"]
