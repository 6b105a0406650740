"""Projectors that disturb each other: what they light, by closed form on a plane."""

import math
from dataclasses import replace

import numpy as np
import pytest
from support.shapes import cube, moved, plate, write_off

from glvis.evaluation.interference import (
    find_interference,
    projector_of,
    projector_pose,
    rival_groups,
)
from glvis.problem.camera import look_along
from glvis.problem.lens import Pinhole
from glvis.problem.sensor import Noise, Partner, Sensor
from glvis.study.loading import load_study

# A floor of 200 x 200 mm in 2 x 80 x 80 faces under sensors that look straight down.
STUDY = """
title = "Floor"
up = [0, 1, 0]
[scene]
models = ["floor.off"]
max_edge = "off"
{obstacles}
[visibility]
criterion = "{criterion}"
[sensor.eye]
hfov_deg = 60
vfov_deg = 40
resolution = [640, 480]
min_distance = 90
max_distance = 200
max_incidence_deg = 20
"""
MOUNT = '[[mount]]\nname = "{}"\nsensor = "eye"\nposition = [0, 0, {}]\ndirection = [0, 0, -1]\n'
FINE = 80  # squares a side
STEP = 200 / FINE


def floor_study(folder, sensors, obstacles="", criterion="centroid"):
    """Return a study of the floor with some sensors instead of its own, in that order."""
    write_off(folder / "floor.off", plate(200, 200, cells=(FINE, FINE)))
    write_off(folder / "lid.off", moved(cube(10.0), (0, 0, 50)))
    text = STUDY.format(obstacles=obstacles, criterion=criterion)
    text += "".join(MOUNT.format(f"P{k}", 100 + k) for k in range(len(sensors)))
    (folder / "study.toml").write_text(text)
    return replace(load_study(folder / "study.toml"), sensors=tuple(sensors))


def over(*places) -> np.ndarray:
    """Return poses (S, 4, 4) that look down from places."""
    return look_along(np.array(places, dtype=float), (0, 0, -1), up=(0, 1, 0))


def light(width, height, group="infrared", name="light", **more) -> Sensor:
    """A sensor at height 100 whose picture on the floor has a width and a height."""
    lens = Pinhole.from_tangents(width / 200, height / 200)
    return Sensor(name, lens, (640, 480), 0.0, 200.0, emits=group, **more)


def overlap_of(first, second) -> float:
    """Return the common area of two rectangles (x, y, width, height) about their middles."""
    return math.prod(
        max(0.0, min(a + wa / 2, b + wb / 2) - max(a - wa / 2, b - wb / 2))
        for a, b, wa, wb in zip(first[:2], second[:2], first[2:], second[2:], strict=True)
    )


def test_only_groups_of_two_and_more_disturb_each_other():
    sensors = [light(9, 9), light(9, 9, "blue"), light(9, 9, ""), light(9, 9), light(9, 9, "")]
    assert rival_groups(sensors) == {"infrared": (0, 3)}
    assert rival_groups(sensors[:3]) == {}


def test_light_comes_from_a_projector_where_there_is_one_and_from_the_sensor_else():
    wide, pose = Pinhole.from_degrees(80, 60), over((1, 2, 3))[0]
    for role, lens, at in (("projector", wide, (11, 2, 3)), ("imager", CAM.lens, (1, 2, 3))):
        sensor = replace(
            CAM, partner=Partner((10, 0, 0), wide, role=role), noise=Noise(subpixel=0.1)
        )
        found = projector_of(sensor)
        assert (found.lens, found.partner, found.noise) == (lens, None, None)
        assert (found.min_distance, found.max_distance) == (0, sensor.max_distance)
        assert found.max_incidence == math.pi / 2
        np.testing.assert_allclose(projector_pose(sensor, pose)[:3, 3], at)


CAM = replace(light(100, 80), min_distance=90.0, max_incidence=math.radians(20))


@pytest.mark.parametrize(("criterion", "band"), [("centroid", STEP / 2), ("pixels", STEP)])
def test_two_projectors_light_the_overlap_of_two_rectangles(tmp_path, criterion, band):
    sensors = [light(100, 80), light(70, 120, name="tall")]
    study = floor_study(tmp_path, sensors, criterion=criterion)
    found = find_interference(study, over((-20, 5, 100), (15, -10, 100)))
    assert (found.groups, found.members) == (("infrared",), ((0, 1),))
    overlap = overlap_of((-20, 5, 100, 80), (15, -10, 70, 120))
    share = found.disturbed_share(0, study.models[0])
    # whole faces along the border of 50 x 70 count or do not
    assert share * 200**2 == pytest.approx(overlap, abs=2 * (50 + 70) * band)
    x, y, _ = study.models[0].centroids.T
    deep = (abs(x + 20) < 50 - STEP) & (abs(y - 5) < 40 - STEP)
    deep &= (abs(x - 15) < 35 - STEP) & (abs(y + 10) < 60 - STEP)
    assert (found.most(0)[deep] == 2).all() and np.count_nonzero(deep) > 1000
    outside = (abs(x + 20) > 50 + STEP) | (abs(y - 5) > 40 + STEP)
    outside |= (abs(x - 15) > 35 + STEP) | (abs(y + 10) > 60 + STEP)
    assert (found.most(0)[outside] < 2).all()


def test_what_the_camera_refuses_is_lit_all_the_same(tmp_path):
    # nearer than minD and more oblique than the camera takes: both limits are not the light's
    study = floor_study(tmp_path, [CAM, CAM])
    found = find_interference(study, over((0, 0, 50), (0, 0, 50)))
    lit = found.disturbed_share(0, study.models[0]) * 200**2
    assert lit == pytest.approx(50 * 40, rel=0.15)
    far = replace(CAM, max_distance=40.0, min_distance=0.0)
    far = replace(study, sensors=(far, far))
    assert find_interference(far, over((0, 0, 50), (0, 0, 50))).disturbed_share(
        0, study.models[0]
    ) == 0  # fmt: skip


def test_projector_beside_the_camera_lights_from_there_in_its_own_field(tmp_path):
    shifted = replace(
        light(10, 10, name="shifted"),
        partner=Partner((60, 0, 0), light(70, 120).lens, role="projector"),
    )
    study = floor_study(tmp_path, [light(100, 80), shifted])
    found = find_interference(study, over((-20, 5, 100), (-45, -10, 100)))
    overlap = overlap_of((-20, 5, 100, 80), (15, -10, 70, 120))
    share = found.disturbed_share(0, study.models[0])
    assert share * 200**2 == pytest.approx(overlap, abs=2 * (50 + 70) * STEP / 2)


def test_three_sensors_in_two_groups_disturb_only_within_their_own(tmp_path):
    sensors = [light(100, 100), light(100, 100), light(100, 100, "blue", "blue")]
    study = floor_study(tmp_path, sensors)
    found = find_interference(study, over((-60, 0, 100), (40, 0, 100), (0, 0, 100)))
    assert (found.groups, found.members) == (("infrared",), ((0, 1),))
    assert found.disturbed_share(0, study.models[0]) == pytest.approx(0, abs=0.03)
    both = replace(study, sensors=(*sensors[:2], sensors[2], replace(sensors[2], name="b2")))
    four = find_interference(both, over((0, 0, 100), (0, 0, 100), (80, 0, 100), (80, 0, 100)))
    assert four.groups == ("infrared", "blue")
    assert four.disturbed_share(0, study.models[0], 0) == pytest.approx(0.25, rel=0.08)
    assert four.disturbed_share(0, study.models[0], 1) == pytest.approx(0.25 * 0.7, rel=0.08)
    # the two squares overlap by 20 x 100: what either group disturbs counts once
    assert four.disturbed_share(0, study.models[0]) == pytest.approx(0.25 * 1.5, rel=0.08)
    assert int(four.most(0).max()) == 2


def test_obstacle_keeps_light_off(tmp_path):
    sensors = [light(100, 100), light(100, 100)]
    poses = over((0, 0, 100), (0, 0, 100))
    free = floor_study(tmp_path, sensors)
    hidden = floor_study(tmp_path, sensors, 'obstacles = ["lid.off"]')
    shares = [find_interference(s, poses).disturbed_share(0, s.models[0]) for s in (free, hidden)]
    # the lid's top, 10 wide at 45 under the light, hides 10 * 100 / 45 on the floor
    assert (shares[0] - shares[1]) * 200**2 == pytest.approx((1000 / 45) ** 2, rel=0.2)


def test_sensors_that_emit_nothing_do_not_disturb(tmp_path):
    study = floor_study(tmp_path, [light(10, 10, ""), light(10, 10, "")])
    assert find_interference(study, over((0, 0, 100), (0, 0, 100))) is None
