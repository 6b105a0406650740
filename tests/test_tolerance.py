"""Mounting errors: what they cost in closed form, and poses that are whole steps."""

import math

import numpy as np
import pytest
from support import shapes
from support.two_cubes import SMALL, write_two_cubes

from glvis.cli.tolerance_words import (
    loss_lines,
    rounding_lines,
    sensitivity_lines,
    spread_lines,
)
from glvis.errors import StudyError
from glvis.problem.camera import look_along
from glvis.results.mounting import setting_of_pose
from glvis.results.tolerance import (
    AXES,
    degrees_of,
    disturbed,
    length_of,
    random_errors,
    rounded_poses,
    single_errors,
    without_each,
    worth,
)
from glvis.search.placement import evaluate_poses
from glvis.study.loading import load_study

# A wall of 40 x 20 that exactly fills the field of view from a distance of 20.
WALL = """
up = [0, 1, 0]
[scene]
models = ["wall.off"]
max_edge = "off"
[sensor.eye]
hfov_deg = 90
vfov_deg = 53.13010235415598
resolution = [800, 400]
max_distance = 30
[visibility]
criterion = "centroid"
[objective]
kind = "of1"
[[mount]]
name = "A"
sensor = "eye"
position = [0, 0, 20]
direction = [0, 0, -1]
"""


@pytest.fixture(scope="module")
def wall(tmp_path_factory):
    folder = tmp_path_factory.mktemp("wall")
    shapes.write_off(folder / "wall.off", shapes.plate(40.0, 20.0, cells=(80, 40)))
    (folder / "study.toml").write_text(WALL)
    return evaluate_poses(load_study(folder / "study.toml"))


@pytest.fixture(scope="module")
def small(tmp_path_factory):
    return evaluate_poses(load_study(write_two_cubes(tmp_path_factory.mktemp("study"))))


def test_a_wall_that_fills_the_view_is_lost_by_the_share_that_moves_out(wall):
    assert worth(wall).coverage == 1.0
    losses = dict(zip(AXES, single_errors(wall, 2.0, math.radians(4))[0], strict=True))
    faces = 0.02  # of the wall in a row of cells
    assert losses["x"] == pytest.approx(2 / 40, abs=faces)
    assert losses["y"] == pytest.approx(2 / 20, abs=faces)
    assert losses["z"] == pytest.approx(1 - (18 / 20) ** 2, abs=faces)  # nearer sees less
    # panned by 4 degrees the far edge of the view stands at 20 tan(41 deg)
    edge = 20 * math.tan(math.radians(45 - 4))
    assert losses["pan"] == pytest.approx((20 - edge) / 40, abs=0.03)
    assert losses["tilt"] > losses["pan"]  # the view is half as high as wide
    assert losses["roll"] > 0


def test_most_sensitive_axis_is_named_first(wall):
    losses = single_errors(wall, 2.0, 0.0)
    lines = list(sensitivity_lines(wall, losses, 2.0, 0.0))
    assert lines[2].split()[:4] == ["A", "z", "2", "mm"]
    assert lines[3].split()[:4] == ["A", "y", "2", "mm"]


def test_without_errors_nothing_is_lost(small):
    planned = worth(small)
    assert all(found == planned for found in random_errors(small, 0.0, 0.0, 3, 1))
    assert not single_errors(small, 0.0, 0.0).any()


def test_random_errors_are_the_same_for_the_same_seed(small):
    first, second, other = (list(random_errors(small, 0.3, 0.2, 12, seed)) for seed in (1, 1, 2))
    assert first == second
    assert first != other


def test_planned_worth_is_that_of_the_placement(small):
    planned = worth(small)
    assert planned.value == pytest.approx(small.value, rel=1e-12)
    assert planned.coverage == np.mean([found.coverage for found in small.maps])


def test_disturbed_sensors_tilt_up_pan_left_and_keep_their_roll_sign():
    pose = look_along([1, 2, 3], [1, 0, 0], 0.0, [0, 0, 1])
    a = math.radians(10)
    settings = [
        setting_of_pose(disturbed(pose, np.zeros(3), turn), [0, 0, 1])
        for turn in np.diag([a, a, a])
    ]
    assert (settings[0].tilt_deg, settings[0].pan_deg) == pytest.approx((10, 0))
    assert (settings[1].pan_deg, settings[1].tilt_deg) == pytest.approx((10, 0))
    # the third turns about +z of the camera, backwards: roll by the right hand rule is minus it
    assert settings[2].roll_deg == pytest.approx(-10)


@pytest.mark.parametrize("seed", range(10))
def test_disturbed_poses_are_rigid_and_as_far_off_as_they_were_told(seed):
    rng = np.random.default_rng(seed)
    pose = look_along(rng.normal(size=3), rng.normal(size=3), 0.3)
    shift, turn = rng.normal(size=(4, 3)), rng.normal(size=(4, 3)) * 10.0 ** -(seed % 10)
    found = disturbed(pose, shift, turn)
    assert np.allclose(found[:, :3, 3] - pose[:3, 3], shift)
    step = np.swapaxes(pose[:3, :3], 0, 1) @ found[:, :3, :3]
    assert np.allclose(step @ np.swapaxes(step, 1, 2), np.eye(3), atol=1e-12)
    # the antisymmetric part of a rotation is its axis times the sine of its angle
    odd = (step - np.swapaxes(step, 1, 2)) / 2
    axis = np.stack([odd[:, 2, 1], odd[:, 0, 2], odd[:, 1, 0]], axis=1)
    angle = np.linalg.norm(turn, axis=1, keepdims=True)
    assert np.allclose(axis, turn * np.sinc(angle / math.pi), rtol=1e-9, atol=1e-15)


def test_lost_sensor_costs_what_only_it_saw(small):
    planned = worth(small)
    for s, left in enumerate(without_each(small)):
        lost = [
            (found.visible[s] & (found.counts == 1)).sum() / found.visible.shape[1]
            for found in small.maps
        ]
        assert planned.coverage - left.coverage == pytest.approx(np.mean(lost))


def test_rounded_poses_are_whole_steps_and_no_farther_off_than_half_of_one(small):
    rounded = rounded_poses(small, 0.25, 15.0)
    for pose, new in zip(small.camera_to_world, rounded, strict=True):
        assert np.allclose(new[:3, 3] / 0.25, np.round(new[:3, 3] / 0.25))
        assert np.abs(new[:3, 3] - pose[:3, 3]).max() <= 0.125
        before, after = (setting_of_pose(p, small.study.up) for p in (pose, new))
        for name in ("pan_deg", "tilt_deg", "roll_deg"):
            value = getattr(after, name)
            assert value / 15 == pytest.approx(round(value / 15), abs=1e-9)
            assert abs(value - getattr(before, name)) <= 7.5 + 1e-9


def test_rounding_by_nothing_changes_nothing(small):
    assert np.allclose(rounded_poses(small, 0, 0), small.camera_to_world, atol=1e-12)


def test_rounded_positions_have_no_dust(small):
    assert set(rounded_poses(small, 0.1, 0)[:, :3, 3].ravel().tolist()) == {0.0, 3.0, -3.0, 4.0}


@pytest.mark.parametrize(
    ("text", "unit", "length"),
    [("1mm", "mm", 1), ("1 mm", "m", 0.001), ("2.5", "cm", 2.5), ("1in", "mm", 25.4),
     ("1e-3m", "mm", 1), ("0", "mm", 0)],
)  # fmt: skip
def test_lengths_carry_their_unit(text, unit, length):
    assert length_of(text, unit, "--position") == pytest.approx(length)


@pytest.mark.parametrize(
    ("read", "message"),
    [
        (lambda: length_of("wide", "mm", "--position"), "--position wide: must be a length such"),
        (lambda: length_of("-1mm", "mm", "--position"), "must be a length such as 1mm, 0 or more"),
        (lambda: length_of("1lightyear", "mm", "--position"), "'lightyear' must be one of mm, cm"),
        (lambda: degrees_of("1rad", "--angle"), "--angle 1rad: 'rad' must be deg"),
        (lambda: degrees_of("1e999", "--angle"), "must be an angle such as 0.5deg, 0 or more"),
        (lambda: degrees_of("1e", "--angle"), "--angle 1e: "),
    ],
)
def test_what_is_no_quantity_is_refused(read, message):
    with pytest.raises(StudyError, match=message):
        read()


def test_words_tell_the_spread(wall):
    found = list(random_errors(wall, 2.0, 0.0, 20, 1))
    lines = list(spread_lines(wall, found, 2.0, 0.0))
    rows = {line.split()[0]: float(line.split()[-2]) for line in lines[2:]}
    assert rows["as"] == 100
    assert rows["worst"] == pytest.approx(100 * min(one.coverage for one in found), abs=0.01)
    assert rows["worst"] <= rows["5th"] <= rows["mean"] < 100


def test_lengths_are_told_in_few_digits(wall):
    length = length_of("1mm", "in", "--position")
    first = next(spread_lines(wall, [worth(wall)], length, 0.5))
    assert "every sensor up to 0.03937 mm off along each axis and 0.5 deg in tilt" in first
    losses = single_errors(wall, length, 0.0)
    assert {line.split()[2] for line in [*sensitivity_lines(wall, losses, length, 0.0)][2:5]} == {
        "0.03937"
    }


def test_words_tell_lost_and_rounded(small):
    lines = list(loss_lines(small))
    assert [line.split()[0] for line in lines[2:]] == ["none", "A", "B", "C"]
    rounded = evaluate_poses(small.study, rounded_poses(small, 0.5, 5.0))
    lines = list(rounding_lines(small, rounded))
    # A looks from (3, 3, 3) at the origin: 35.26 degrees down, 135 to the left of +X
    assert lines[2].split() == ["A", "3", "3", "3", "135", "-35", "0"]
    assert "% of the faces instead of" in lines[-1]


def test_settings_of_a_rolled_sensor_survive_rounding(tmp_path):
    text = SMALL.replace("direction = [0, 0, -1]", "direction = [0, 1, -1]")
    placement = evaluate_poses(load_study(write_two_cubes(tmp_path, text)))
    pose = rounded_poses(placement, 0, 1.0)[2]
    setting = setting_of_pose(pose, placement.study.up)
    assert (setting.pan_deg, setting.tilt_deg, setting.roll_deg) == pytest.approx((90, 45, 30))
