"""Warnings: each disappointment has its sentence, and a good study has none."""

import numpy as np
import pytest
from shapes import cube, flipped, icosphere
from test_study import off

from glvis.inputs.checks import study_warnings
from glvis.inputs.study import load_study

RING = """\
unit = "UNIT"
[scene]
models = ["ball.off"]
max_edge = "off"
scale = SCALE
[sensor.near]
hfov_deg = 60
vfov_deg = 40
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

    def warn(shape=None, unit="mm", scale=1, radius=300, turn=90):
        (tmp_path / "ball.off").write_text(off(shape or icosphere(2, radius=50)))
        text = RING.replace("UNIT", unit).replace("SCALE", str(scale))
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
    assert found.startswith("ball: two faces walk 3 edges in the same direction; some normals")


def test_a_model_turned_inside_out_is_told_unless_it_is_a_room(warnings_of):
    inside_out = flipped(icosphere(2, radius=50))
    (found,) = warnings_of(inside_out)
    assert found == "ball: its normals point inwards; from outside no face can be seen"
    assert warnings_of(flipped(cube(700.0))) == []  # the sensors stand inside


@pytest.mark.parametrize(
    ("scale", "message"),
    [
        (0.001, "ball: is 0.173 mm across, the sensors reach 400 mm; is unit = 'mm' right?"),
        (1000, "ball: is 1.73e+05 mm across, the sensors reach 400 mm; is unit = 'mm' right?"),
    ],
)
def test_a_model_in_another_unit_is_told(warnings_of, scale, message):
    assert message in warnings_of(cube(100.0), scale=scale)


def test_a_model_beyond_every_range_is_told(warnings_of):
    far, blind = warnings_of(cube(100.0), radius=3000)
    assert far == (
        "ball: at the start all of it lies beyond max_distance of every sensor "
        "(nearest depth 2950 mm); is unit = 'mm' right?"
    )
    assert blind == "at the start no sensor has any part of a model in view and range"


def test_a_model_nearer_than_every_range_is_told(warnings_of):
    near, _ = warnings_of(cube(20.0), unit="cm", radius=80)
    assert near == (
        "ball: at the start all of it lies nearer than min_distance of every sensor "
        "(largest depth 90 cm); is unit = 'cm' right?"
    )


def test_a_sensor_that_looks_elsewhere_is_named(warnings_of):
    assert warnings_of(turn=0) == ["B: has no part of a model in view and range at the start"]
