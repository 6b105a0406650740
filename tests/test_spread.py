"""How far runs lie apart: closed forms on known poses, whatever the sensors are called."""

import dataclasses
import math
import statistics
from types import SimpleNamespace

import numpy as np
import pytest

from glvis.problem.camera import distance_and_angle, look_along
from glvis.problem.lens import Pinhole
from glvis.problem.sensor import Sensor
from glvis.results.spread import Outcome, apart, spread
from glvis.results.vary import PlannedRun, Point

UP = np.array([0.0, 0.0, 1.0])
NEAR = Sensor("near", Pinhole.from_degrees(60, 40), (64, 48), 10.0, 30.0, math.pi / 2)
FAR = dataclasses.replace(NEAR, name="far", max_distance=90.0)


def turned(pose, degrees, axis=2):
    """Turn a camera in its place about one of its own axes."""
    a, b = [k for k in range(3) if k != axis]
    turn = np.eye(4)
    turn[a, a] = turn[b, b] = math.cos(math.radians(degrees))
    turn[a, b], turn[b, a] = -math.sin(math.radians(degrees)), math.sin(math.radians(degrees))
    return pose @ turn


def moved(pose, by):
    """Move one camera, or all."""
    pose = pose.copy()
    pose[..., :3, 3] += by
    return pose


def layout(rng, n):
    place = rng.uniform(-100, 100, (n, 3))
    return look_along(place, -place, rng.uniform(-1, 1, n), UP)


def outcome(poses, sensors=None, value=1.0, name="run-01", reason="finished", seen=50.0):
    point = Point({}, (), sensors or (NEAR,) * len(poses), 6, 100, 1, "OF1")
    return Outcome(PlannedRun(name, point, 1, ()), value, seen, seen / 2, 3, 4, 5, reason, poses)


def test_a_layout_lies_nowhere_from_itself(rng):
    one = outcome(layout(rng, 5))
    assert dataclasses.astuple(apart(one, one)) == (0, 0, 0, 0)


def test_known_moves_and_turns_are_told(rng):
    poses = layout(rng, 2)
    other = np.array([moved(poses[0], [3, 0, 4]), turned(poses[1], 10, axis=0)])
    far = apart(outcome(other), outcome(poses))
    assert (far.mean_position, far.max_position) == pytest.approx((2.5, 5))
    assert (far.mean_angle_deg, far.max_angle_deg) == pytest.approx((5, 10))


@pytest.mark.parametrize("seed", range(10))
def test_names_that_changed_places_do_not_count(seed):
    rng = np.random.default_rng(seed)
    poses = layout(rng, 6)
    near = np.array([moved(turned(pose, 0.5), [0.06, 0, 0.08]) for pose in poses])
    far = apart(outcome(near[rng.permutation(6)]), outcome(poses))
    assert dataclasses.astuple(far) == pytest.approx((0.1, 0.1, 0.5, 0.5))


def test_only_sensors_of_a_kind_change_places(rng):
    poses = layout(rng, 2)
    gap = np.linalg.norm(poses[0, :3, 3] - poses[1, :3, 3])
    swapped = outcome(poses[::-1], (NEAR, FAR)), outcome(poses, (NEAR, FAR))
    assert apart(*swapped).mean_position == pytest.approx(gap)
    assert apart(outcome(poses[::-1]), outcome(poses)).max_position == 0


def test_sensors_of_one_place_are_told_apart_by_where_they_look(rng):
    pose = layout(rng, 1)[0]
    poses = np.array([pose, turned(pose, 90, axis=1), turned(pose, 180, axis=1)])
    far = apart(outcome(poses[[2, 0, 1]]), outcome(poses))
    assert dataclasses.astuple(far) == pytest.approx((0, 0, 0, 0), abs=1e-6)


def test_pairs_differ_least_in_all_and_not_one_after_the_other():
    # On a line at 0 and 10; the other layout at 9 and 21: the nearest pair first would leave 21.
    line = [np.eye(4) for _ in range(4)]
    for pose, x in zip(line, (0, 10, 9, 21), strict=True):
        pose[0, 3] = x
    far = apart(outcome(np.array(line[2:])), outcome(np.array(line[:2])))
    assert (far.mean_position, far.max_position) == (10, 11)


@pytest.mark.parametrize(("degrees", "expected"), [(180, 0), (170, 10), (90, 90), (-30, 30)])
def test_half_a_turn_of_roll_brings_the_image_back(rng, degrees, expected):
    poses = layout(rng, 1)
    far = apart(outcome(np.array([turned(poses[0], degrees)])), outcome(poses))
    assert far.max_angle_deg == pytest.approx(expected, abs=1e-6)


@pytest.mark.parametrize("degrees", [1e-7, 1e-3, 1.0, 179.0, 180.0])
def test_angle_is_exact_from_tiny_to_half_a_turn(rng, degrees):
    pose = layout(rng, 1)[0]
    distance, angle = distance_and_angle(pose, turned(pose, degrees, axis=1))
    assert distance == 0
    assert math.degrees(angle) == pytest.approx(degrees, rel=1e-6)


def test_statistics_are_those_of_the_finished_runs(rng):
    poses = layout(rng, 2)
    values = [3.0, 7.0, 5.0]
    runs = [
        outcome(moved(poses, [v, 0, 0]), value=v, name=f"run-0{k}", seen=10 * v)
        for k, v in enumerate(values)
    ]
    runs.append(outcome(poses, value=99.0, reason="interrupted: Ctrl-C"))
    found = spread(runs[0].run.point, runs)
    assert found.best is runs[1] and len(found.outcomes) == 3
    assert (found.value.mean, found.value.best, found.value.worst) == (5, 7, 3)
    assert found.value.std == statistics.stdev(values) == 2
    assert (found.percentage.mean, found.percentage.std) == (50, 20)
    assert found.area_percentage.best == 35
    assert [far.max_position for far in found.distances] == [4, 0, 2]
    assert (found.apart.mean_position, found.apart.max_position) == pytest.approx((3, 4))


def test_one_run_has_no_deviation_and_none_has_nothing(rng):
    one = outcome(layout(rng, 2), value=4.0)
    found = spread(one.run.point, [one])
    assert (found.value.mean, found.value.std, found.apart) == (4, None, None)
    cut = dataclasses.replace(one, stop_reason="interrupted: SIGTERM")
    nothing = spread(one.run.point, [cut])
    assert (nothing.best, nothing.value, nothing.outcomes) == (None, None, ())


def test_runs_of_other_points_are_left_aside(rng):
    one = outcome(layout(rng, 2))
    other = SimpleNamespace(run=SimpleNamespace(point=dataclasses.replace(
        one.run.point, values={"mounts": 2})), is_finished=True)  # fmt: skip
    assert spread(one.run.point, [other, one]).outcomes == (one,)
