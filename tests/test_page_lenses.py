"""The page on lenses and second viewpoints: what is packed, and what a browser draws of it."""

import math
from dataclasses import replace

import numpy as np
import pytest
from test_page import CORNER, HALF, centroids, example, header

from glvis.common.palette import hex_color, second_tones, sensor_colors
from glvis.problem.calibrated_lens import FisheyeLens, OpenCVLens
from glvis.problem.camera import rigid_inverse
from glvis.problem.field import common_border, field_of, partner_field
from glvis.problem.lens import Pinhole, SphericalLens
from glvis.problem.sensor import Partner, Sensor
from glvis.viewer.page import page_text, write_page
from glvis.viewer.page_data import PageSensor

CAM = Sensor("cam", Pinhole.from_degrees(60, 40), (640, 480), 100, 400)
LIDAR = replace(
    CAM,
    name="lidar",
    lens=SphericalLens(2 * math.pi, (-0.4, 0.2)),
    resolution=(1800, 16),
    distance="range",
)
ROUND = FisheyeLens((800, 800), (230, 230), (399.5, 399.5), (), max_angle=math.radians(95))
PAIR = replace(CAM, partner=Partner((60, 0, 0), CAM.lens, (math.radians(-9), 0.0), "projector"))
BARREL = replace(CAM, lens=OpenCVLens((640, 480), (538.6, 538.6), (320, 240), (-0.31, 0.08, 0, 0)))


def page_sensor(name, sensor, s):
    """Return a sensor of the page in the s-th pose of the example."""
    return PageSensor.of(name, sensor, example().sensors[s].camera_to_world)


def data_of(first, second=CAM):
    return example(sensors=[page_sensor("A", first, 0), page_sensor("B", second, 1)])


# ---- the file


def test_ideal_pinholes_are_packed_as_ever():
    plain = header(page_text(data_of(PAIR, CAM)))["sensors"][1]
    assert list(plain) == [
        "name", "kind", "camera_to_world", "tan_half", "min_distance", "max_distance",
        "max_incidence", "resolution", "color",
    ]  # fmt: skip


def test_a_second_viewpoint_is_packed_with_what_both_see():
    entry = header(page_text(data_of(PAIR)))["sensors"][0]
    second = entry["second"]
    assert second["role"] == "projector"
    np.testing.assert_allclose(second["pose"], PAIR.partner.partner_to_sensor)
    borders = [common_border(PAIR, depth) for depth in (100, 400)]
    assert len(second["common"]) == 2
    for found, border in zip(second["common"], borders, strict=True):
        np.testing.assert_allclose(found, border, atol=1e-6)
    tones = [second_tones(sensor_colors(1)[0], on_dark=dark) for dark in (False, True)]
    assert second["colors"] == [hex_color(tone) for tone in tones]


# ---- in the browser


@pytest.fixture
def opened(browser, tmp_path):
    """Return a function that opens the page of two sensors; the console must stay silent."""

    def open_page(*sensors):
        path = tmp_path / "report.html"
        write_page(path, data_of(*sensors))
        browser.errors.clear()
        browser.open(path, (900, 560))
        browser.run("glvis.show('frusta', true)")
        return browser

    yield open_page
    assert browser.errors == []


def in_the_first(tab, pose):
    """Return the ends of all lines (N, 2, 3) in the camera frame of the first sensor."""
    ends = np.array(tab.run("glvis.lines().map(([a, b]) => [a, b])")) + CORNER + HALF
    to_camera = rigid_inverse(np.asarray(pose))
    return ends @ to_camera[:3, :3].T + to_camera[:3, 3]


def distance_to(points, among):
    """Return how far each point (N, 3) is from the nearest of others (M, 3)."""
    return np.linalg.norm(points[:, None] - among[None], axis=2).min(axis=1)


@pytest.mark.parametrize(
    "sensor",
    [CAM, BARREL, LIDAR, PAIR, replace(CAM, lens=ROUND, distance="range")],
    ids=["pinhole", "opencv", "lidar", "pair", "fisheye"],
)
def test_lines_of_a_field_end_where_the_lens_ends(opened, sensor):
    tab = opened(sensor)
    tab.run("glvis.setSensor(1, false)")
    ends = in_the_first(tab, example().sensors[0].camera_to_world).reshape(-1, 3)
    for field in filter(None, (field_of(sensor), partner_field(sensor))):
        for reach in (sensor.min_distance, sensor.max_distance):
            for line in (*field.borders, *field.ribs):
                places = field.at(line, reach)
                # broken lines begin at each place, though they end before the next
                assert distance_to(places[:-1], ends).max() < 1e-3
    if sensor.partner:
        assert distance_to(common_border(sensor, sensor.max_distance), ends).max() < 1e-3


def test_a_second_viewpoint_has_a_body_that_is_picked_as_its_sensor(opened):
    tab = opened(replace(PAIR, partner=Partner((90, 0, 0), CAM.lens)))
    pose = np.asarray(example().sensors[0].camera_to_world)
    centre = (pose @ [90, 0, 0, 1])[:3] - CORNER - HALF
    tab.run("glvis.setView('3D', 0); for (const n of ['frusta', 'labels']) glvis.show(n, false)")
    tab.settle()
    at = tab.run(f"glvis.camera().project({(centre + pose[:3, 2]).tolist()})")
    hit = tab.run(f"glvis.pickAt({at['x']}, {at['y']})")
    assert hit == {"kind": "sensor", "sensor": 0}


@pytest.mark.parametrize(
    ("sensor", "words"),
    [
        (CAM, "60 × 40°, 100 to 400 mm"),
        (replace(CAM, distance="range"), "60 × 40°, 100 to 400 mm from its centre"),
        (LIDAR, "360 × 34.4° by azimuth and elevation, 100 to 400 mm from its centre; drawn "),
        (replace(CAM, lens=ROUND), "190 × 190° fisheye, 100 to 400 mm; drawn without distortion"),
        (BARREL, "with distortion, 100 to 400 mm; drawn without distortion"),
    ],
)
def test_through_a_sensor_it_is_said_what_the_picture_leaves_out(opened, sensor, words):
    tab = opened(sensor)
    tab.run("glvis.lookThrough(0, 0)")
    tab.settle()
    assert words in tab.run("document.getElementById('through-facts').textContent")


def test_readings_are_ranges_where_the_sensor_measures_them(opened):
    tab = opened(LIDAR)
    first, second = tab.run("glvis.read(5)")
    point = centroids(example().models[0])[5]
    poses = [np.asarray(one.camera_to_world) for one in example().sensors]
    assert first["distance"] == pytest.approx(np.linalg.norm(point - poses[0][:3, 3]), abs=1e-3)
    depth = (poses[1][:3, 3] - point) @ poses[1][:3, 2]
    assert second["distance"] == pytest.approx(depth, abs=1e-3)


def test_a_wide_lens_is_looked_through_by_its_pinhole(opened):
    tab = opened(replace(CAM, lens=ROUND))
    tab.run("glvis.lookThrough(0, 0)")
    frame = tab.run("glvis.frame()")
    assert frame["width"] / frame["height"] == pytest.approx(ROUND.tan_half[0] / ROUND.tan_half[1])
