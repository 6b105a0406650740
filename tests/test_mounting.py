"""Mounting instructions: pan, tilt and roll by hand, and back to the pose they came from."""

import numpy as np
import pytest
from support.two_cubes import SMALL, write_two_cubes

from glvis.problem.camera import look_along
from glvis.results.mounting import (
    Setting,
    level_axes,
    mounting_lines,
    pose_of_setting,
    setting_of_pose,
    setting_words,
)
from glvis.search.placement import evaluate_poses
from glvis.study.loading import load_study


@pytest.mark.parametrize(
    ("direction", "up", "pan", "tilt"),
    [
        ([1, 0, 0], [0, 0, 1], 0, 0),
        ([0, 1, 0], [0, 0, 1], 90, 0),
        ([0, -1, -1], [0, 0, 1], -90, -45),
        ([-1, 0, 1], [0, 0, 1], 180, 45),
        # up is Y: seen from above (from +Y), left of +X is -Z
        ([0, 0, -1], [0, 1, 0], 90, 0),
        ([1, 1, 0], [0, 1, 0], 0, 45),
        # up is X: the reference is Y, left of it is Z
        ([0, 0, 1], [1, 0, 0], 90, 0),
        ([0, 0, 1], [0, 0, -1], 0, -90),
    ],
)
def test_pan_and_tilt_are_those_of_a_tripod(direction, up, pan, tilt):
    pose = look_along([1, 2, 3], direction, 0.0, up)
    setting = setting_of_pose(pose, up)
    assert setting.tilt_deg == pytest.approx(tilt)
    if abs(tilt) < 90:
        assert setting.pan_deg == pytest.approx(pan)
    assert setting.roll_deg == pytest.approx(0)


def test_positive_roll_is_clockwise_seen_from_behind():
    pose = look_along([0, 0, 0], [1, 0, 0], np.radians(30), [0, 0, 1])
    setting = setting_of_pose(pose, [0, 0, 1])
    assert setting.roll_deg == pytest.approx(30)
    # clockwise, seen along +X with Z up: the image's upper edge falls to the right, to -Y
    assert pose[1, 1] == pytest.approx(-np.sin(np.radians(30)))
    assert setting_words(setting, "+X")[2] == "roll       30.0 deg clockwise"


@pytest.mark.parametrize("seed", range(20))
def test_setting_and_pose_are_each_others_inverse(seed):
    rng = np.random.default_rng(seed)
    up = [[0, 0, 1], [0, 1, 0], [1, 0, 0], [0, -1, 0], rng.normal(size=3)][seed % 5]
    pose = look_along(rng.normal(size=3), rng.normal(size=3), rng.uniform(-3, 3), up)
    again = pose_of_setting(pose[:3, 3], setting_of_pose(pose, up), up)
    assert np.allclose(again, pose, atol=1e-12)


@pytest.mark.parametrize("up", [[0, 0, 1], [0, 1, 0], [1, 0, 0]])
@pytest.mark.parametrize("side", [1, -1])
@pytest.mark.parametrize("roll_deg", [0, 30, 135, -90])
def test_straight_up_and_down_are_told_by_the_top_of_the_image(up, side, roll_deg):
    pose = look_along([1, 2, 3], side * np.array(up), np.radians(roll_deg), up)
    setting = setting_of_pose(pose, up)
    assert setting.is_vertical
    assert (setting.tilt_deg, setting.roll_deg) == (90 * side, 0)
    ahead, left, _ = level_axes(up)
    pan = np.radians(setting.pan_deg)
    assert np.allclose(pose[:3, 1], np.cos(pan) * ahead + np.sin(pan) * left)
    assert np.allclose(pose_of_setting([1, 2, 3], setting, up), pose, atol=1e-12)


@pytest.mark.parametrize(
    ("setting", "words"),
    [
        (Setting(20.04, -15.06, 0.01),
         ["pan        20.0 deg to the left of +X", "tilt       15.1 deg down", "roll       none"]),
        (Setting(-90, 0, -5),
         ["pan        90.0 deg to the right of +X", "tilt       level",
          "roll       5.0 deg counter-clockwise"]),
        (Setting(0, 3, 0),
         ["pan        0.0 deg: along +X", "tilt       3.0 deg up", "roll       none"]),
        (Setting(-180, 3, 0),
         ["pan        180.0 deg: along -X", "tilt       3.0 deg up", "roll       none"]),
        (Setting(45, -90, 0),
         ["looks      straight down", "image top  45.0 deg to the left of +X"]),
    ],
)  # fmt: skip
def test_settings_are_told_in_words(setting, words):
    assert setting_words(setting, "+X") == words


def test_instructions_name_places_views_and_neighbours(tmp_path):
    study = load_study(write_two_cubes(tmp_path, SMALL.replace("[scene]", 'unit = "m"\n[scene]')))
    lines = mounting_lines(evaluate_poses(study))
    assert "Up: +Y." in lines
    first = lines[lines.index("A (eye)") :][:6]
    assert first == [
        "A (eye)",
        "  position   x 3.0000   y 3.0000   z 3.0000 m",
        # from (3, 3, 3) towards the origin: level part (-1, 0, -1), left of +X is -Z
        "  pan        135.0 deg to the left of +X",
        "  tilt       35.3 deg down",
        "  roll       none",
        "  nearest    C, 4.3589 m away",  # (3, 3, 1) apart: the square root of 19
    ]
    assert "  position   x -3.0000   y 3.0000   z 3.0000 m" in lines


def test_a_lone_sensor_has_no_neighbour(tmp_path):
    text = SMALL.replace('mirror = { plane = "yz", name = "B" }', "")
    study = load_study(write_two_cubes(tmp_path, text[: text.rindex("[[mount]]")]))
    assert not [line for line in mounting_lines(evaluate_poses(study)) if "nearest" in line]
