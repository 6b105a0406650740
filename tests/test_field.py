"""Fields of view as lines, by closed forms: borders, rays, second viewpoints, what both see."""

import math
from dataclasses import replace

import numpy as np
import pytest

from glvis.problem.calibrated_lens import FisheyeLens, OpenCVLens
from glvis.problem.field import (
    body_tangents,
    common_border,
    field_of,
    image_aspect,
    partner_field,
)
from glvis.problem.lens import Pinhole, SphericalLens
from glvis.problem.sensor import Partner, Sensor

CAM = Sensor("cam", Pinhole.from_degrees(69, 42), (1280, 720), 160, 350)
TURN = 2 * math.pi


def with_lens(lens, distance="depth"):
    return replace(CAM, lens=lens, distance=distance)


def test_border_of_a_pinhole_is_its_four_corners_at_a_depth():
    field = field_of(CAM)
    x, y = 350 * CAM.lens.tan_half
    corners = [(-x, -y, -350), (x, -y, -350), (x, y, -350), (-x, y, -350)]
    np.testing.assert_allclose(field.at(field.borders[0], 350), [*corners, corners[0]])
    np.testing.assert_allclose(field.at(field.rays, 350), corners)
    assert field.is_flat
    assert field.ribs == ()


def test_range_ends_a_pinhole_on_a_ball():
    field = field_of(replace(CAM, distance="range"))
    for line in (*field.borders, *field.ribs):
        np.testing.assert_allclose(np.linalg.norm(field.at(line, 350), axis=1), 350)
    corner = np.array([-CAM.lens.tan_half[0], -CAM.lens.tan_half[1], -1])
    np.testing.assert_allclose(field.at(field.rays, 1)[0], corner / np.linalg.norm(corner))


@pytest.mark.parametrize("distance", ["depth", "range"])
def test_places_of_a_border_lie_on_the_border_of_the_image(distance):
    lens = OpenCVLens((800, 600), (538.6, 538.6), (410, 290), (-0.3068, 0.0825, 0.0029, -0.0002))
    field = field_of(with_lens(lens, distance))
    ends = field.at(field.borders[0], 200)
    if distance == "depth":
        np.testing.assert_allclose(ends[:, 2], -200)
    u, v = lens.project(ends[:, 0], ends[:, 1], -ends[:, 2])
    off = np.minimum.reduce([abs(u), abs(1 - u), abs(v), abs(1 - v)])
    assert off.max() < 1e-6
    u, v = lens.project(*(field.rays * [1, 1, -1]).T)
    np.testing.assert_allclose(np.stack([u, v]), [[0, 1, 1, 0], [1, 1, 0, 0]], atol=1e-6)


def test_border_of_a_round_fisheye_is_a_circle_about_the_axis():
    lens = FisheyeLens((900, 900), (220, 220), (449.5, 449.5), (), max_angle=math.radians(100))
    field = field_of(with_lens(lens))
    assert not field.is_flat  # no plane holds more than half a ball
    ends = field.at(field.borders[0], 3.0)
    np.testing.assert_allclose(np.linalg.norm(ends, axis=1), 3)
    np.testing.assert_allclose(ends[:, 2], -3 * math.cos(math.radians(100)), atol=1e-6)
    assert len(field.rays) == 8


def test_band_of_a_spinning_lidar_is_two_rings():
    low, high = math.radians(-25), math.radians(15)
    field = field_of(with_lens(SphericalLens(TURN, (low, high)), "range"))
    assert len(field.borders) == 2
    for ring, elevation in zip(field.borders, (low, high), strict=True):
        ends = field.at(ring, 10)
        np.testing.assert_allclose(ends[:, 1], 10 * math.sin(elevation))
        np.testing.assert_allclose(np.hypot(ends[:, 0], ends[:, 2]), 10 * math.cos(elevation))
        np.testing.assert_allclose(ends[0], ends[-1], atol=1e-12)  # all around
    assert len(field.ribs) == 8


def test_part_of_a_band_has_edges_and_a_whole_ball_an_equator():
    part = field_of(with_lens(SphericalLens(math.radians(120), (-0.2, 0.2)), "range"))
    assert len(part.borders) == 4
    assert np.abs(np.arctan2(part.rays[:, 0], -part.rays[:, 2])).round(6).tolist() == (
        [round(math.radians(60), 6)] * 4
    )
    ball = field_of(with_lens(SphericalLens(TURN, (-math.pi / 2, math.pi / 2)), "range"))
    (equator,) = ball.borders
    np.testing.assert_allclose(equator[:, 1], 0, atol=1e-12)


def test_lines_of_a_second_viewpoint_start_at_its_centre_and_end_in_the_plane_of_the_first():
    sensor = replace(CAM, partner=Partner((120, 0, 10), CAM.lens, (math.radians(-12), 0.0)))
    field = partner_field(sensor)
    np.testing.assert_array_equal(field.centre, [120, 0, 10])
    ends = field.at(field.borders[0], 300)
    np.testing.assert_allclose(ends[:, 2], -300)
    # back in its own frame they are in its corners
    local = (ends - [120, 0, 10]) @ sensor.partner.partner_to_sensor[:3, :3]
    share = np.abs(local[:, :2] / -local[:, 2:]) / CAM.lens.tan_half
    np.testing.assert_allclose(share, 1)
    assert partner_field(CAM) is None


def test_two_equal_parallel_fields_share_all_but_a_band_as_wide_as_the_baseline():
    sensor = replace(CAM, partner=Partner((55, 0, 0), CAM.lens))
    for depth in (160.0, 350.0):
        border = common_border(sensor, depth)
        x, y = depth * CAM.lens.tan_half
        assert border[:, 0].min() == pytest.approx(55 - x)
        assert border[:, 0].max() == pytest.approx(x)
        assert np.abs(border[:, 1]).max() == pytest.approx(y)
    assert len(common_border(replace(CAM, partner=Partner((900, 0, 0), CAM.lens)), 160)) == 0


def test_a_field_within_the_other_is_what_both_see():
    narrow = Pinhole.from_degrees(20, 10)
    sensor = replace(CAM, partner=Partner((0, 0, 0), narrow, role="projector"))
    border = common_border(sensor, 100)
    x, y = 100 * narrow.tan_half
    assert {tuple(p) for p in border[:, :2].round(6)} == {
        (i * round(x, 6), j * round(y, 6)) for i in (-1, 1) for j in (-1, 1)
    }


def test_no_common_border_is_told_where_a_field_ends_on_a_ball():
    pair = replace(CAM, partner=Partner((55, 0, 0), CAM.lens), distance="range")
    assert common_border(pair, 300).shape == (0, 3)


@pytest.mark.parametrize(
    ("lens", "aspect"),
    [
        (Pinhole.from_tangents(0.8, 0.5), 1.6),
        (OpenCVLens((1280, 720), (700, 700), (639.5, 359.5), (-0.3, 0.1, 0, 0)), 16 / 9),
        (OpenCVLens((1280, 720), (700, 1400), (639.5, 359.5), ()), 32 / 9),
        (SphericalLens(TURN, (-0.25, 0.25)), 4 * math.pi),
    ],
)
def test_aspect_of_an_image_is_that_of_what_its_middle_shows(lens, aspect):
    assert image_aspect(lens) == pytest.approx(aspect)


def test_a_wide_lens_has_no_plate_for_a_body():
    assert body_tangents(SphericalLens(TURN, (-0.2, 0.2))).max() <= 1.2
    assert body_tangents(CAM.lens) is CAM.lens.tan_half
