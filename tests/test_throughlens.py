"""Pictures through lenses: a chequerboard's lines lie where the lens says, distances are measured.

The board stands square to the optical axis, so that every depth is the same and every range
follows from the direction.
"""

import math
from dataclasses import replace
from itertools import product

import numpy as np
import pytest
from support import torus_scene

from glvis.common.palette import NO_RAY
from glvis.pictures.sensorsheets import contact_sheet, depth_sheet, sensor_sheet, sensor_words
from glvis.pictures.stage import Stage
from glvis.pictures.throughlens import SAMPLES, look_ups, window_size
from glvis.problem.calibrated_lens import FisheyeLens, OpenCVLens
from glvis.problem.camera import look_along
from glvis.problem.lens import Pinhole, SphericalLens
from glvis.problem.scene import Model
from glvis.problem.sensor import Partner
from glvis.visibility.visibility_map import VisibilityMap

DEPTH, CELLS, CELL = 200.0, 12, 40.0
PALE, DARK = 235, 40
TURN = 2 * math.pi
DISTORTED = OpenCVLens((640, 480), (420, 430), (330.5, 231), (-0.3, 0.08, 0.002, -0.001))
ROUND = FisheyeLens((500, 500), (140, 140), (249.5, 249.5), (), max_angle=math.radians(95))
LENSES = {
    "pinhole": (Pinhole.from_degrees(80, 60), (640, 480)),
    "opencv": (DISTORTED, (640, 480)),
    "fisheye": (ROUND, (500, 500)),
    "lidar": (SphericalLens(TURN, (math.radians(-50), math.radians(50))), (720, 200)),
    "ball": (SphericalLens(TURN, (-math.pi / 2, math.pi / 2)), (800, 400)),
}


@pytest.fixture(scope="module")
def board():
    """A board of CELLS x CELLS squares of two faces about (DEPTH, 0, 0), that faces the origin."""
    line = (np.arange(CELLS + 1) - CELLS / 2) * CELL
    y, z = np.meshgrid(line, line, indexing="ij")
    vertices = np.stack([np.full(y.size, DEPTH), y.ravel(), z.ravel()], axis=1)
    i, j = (k.ravel() for k in np.meshgrid(*[np.arange(CELLS)] * 2, indexing="ij"))
    a = i * (CELLS + 1) + j
    b, c, d = a + CELLS + 1, a + CELLS + 2, a + 1
    faces = np.stack([a, d, c, a, c, b], axis=1).reshape(-1, 3)
    colors = np.repeat(np.where((i + j) % 2, PALE, DARK), 2).astype(np.uint8)
    return Model.from_arrays("board", vertices, faces), np.repeat(colors[:, None], 3, axis=1)


@pytest.fixture(scope="module")
def ring_study(tmp_path_factory):
    return torus_scene.ring_study(tmp_path_factory.mktemp("ring"))


@pytest.fixture
def stage_of(board, ring_study):
    """Return a function that puts the board before a sensor at the origin that looks along +x."""
    stages = []

    def make(name, distance="depth", **changes):
        lens, size = LENSES[name]
        sensor = replace(
            ring_study.sensors[0],
            lens=lens,
            resolution=size,
            distance=distance,
            min_distance=50,
            max_distance=900,
            **changes,
        )
        study = replace(ring_study, models=(board[0],), obstacles=(), sensors=(sensor,))
        stage = Stage(study, look_along([0, 0, 0], [1, 0, 0])[None])
        stages.append(stage)
        seen = np.ones((1, board[0].n_faces), dtype=bool)
        stage.show(0, VisibilityMap("board", ("A",), seen))
        stage.paint(board[1])
        return stage, lens, size

    yield make
    for stage in stages:
        stage.release()


def on_image(lens, size, y, z):
    """Return pixels of places of the board; the camera's right is -y, its up z."""
    u, v = lens.project(*np.broadcast_arrays(-y, z, DEPTH))
    return np.stack([u * size[0], v * size[1]], axis=-1)


def crossing_of(picture, start, end):
    """Return where gray passes the middle between two pixels' (2,), which differ; a pixel (2,)."""
    way = start + np.linspace(0, 1, 201)[:, None] * (end - start)
    column, row = (way - 0.5).T
    c, r = np.floor(column).astype(int), np.floor(row).astype(int)
    a, b = column - c, row - r
    gray = (1 - b) * ((1 - a) * picture[r, c] + a * picture[r, c + 1])
    gray += b * ((1 - a) * picture[r + 1, c] + a * picture[r + 1, c + 1])
    is_pale = gray > (gray[:20].mean() + gray[-20:].mean()) / 2
    (at,) = np.flatnonzero(np.diff(is_pale))
    return way[at]


@pytest.mark.parametrize("name", LENSES)
def test_lines_of_a_chequerboard_lie_where_the_lens_projects_them(name, stage_of):
    stage, lens, size = stage_of(name)
    picture = stage.sensor_picture(0, size).astype(float).mean(axis=2)
    lines = (np.arange(1, CELLS) - CELLS / 2) * CELL
    middles = (np.arange(CELLS) + 0.5 - CELLS / 2) * CELL
    across = np.array([0.4, 0.0, -0.4]) * CELL
    found = []
    for line, middle in product(lines, middles):
        for y, z in ((line + across, middle), (middle, line + across)):  # upright, level
            before, here, beyond = on_image(lens, size, y, z)
            ends = np.array([before, beyond])
            length = np.linalg.norm(beyond - before)
            if ((ends > 2) & (ends < np.array(size) - 3)).all() and length > 6:
                off = crossing_of(picture, before, beyond) - here
                found.append(abs(off @ (beyond - before)) / length)
    assert len(found) > 60
    assert max(found) < 1.0
    assert np.mean(found) < 0.35


@pytest.mark.parametrize("name", LENSES)
@pytest.mark.parametrize("distance", ["depth", "range"])
def test_distances_are_those_of_the_board_and_nothing_where_there_is_no_ray(
    name, distance, stage_of
):
    stage, lens, size = stage_of(name, distance)
    size = (size[0] // 2, size[1] // 2)
    found, samples = stage.sensor_distances(0, size)
    assert found.shape == (size[1] * samples, size[0] * samples)
    u, v = ((np.arange(n * samples) + 0.5) / (n * samples) for n in size)
    x, y, depth = lens.directions(u[None], v[:, None])
    has_ray = np.isfinite(depth)
    differs = np.isnan(found) == has_ray
    assert differs.mean() < 1e-4  # at the very end of a round field
    half = CELLS * CELL / 2 - 2
    with np.errstate(divide="ignore", invalid="ignore"):
        hits = (depth > 0) & (np.maximum(abs(x), abs(y)) / depth * DEPTH < half) & ~differs
        beside = has_ray & ~((depth > 0) & (np.maximum(abs(x), abs(y)) / depth * DEPTH < half + 4))
    expected = DEPTH / depth[hits] if distance == "range" else np.full(hits.sum(), DEPTH)
    assert hits.sum() > 500
    np.testing.assert_allclose(found[hits], expected, rtol=0.02 if distance == "range" else 1e-4)
    assert np.median(np.abs(found[hits] / expected - 1)) < 2e-3
    assert np.isinf(found[beside & ~differs]).all()


def test_pixels_without_a_ray_are_of_one_grey(stage_of):
    stage, _, size = stage_of("fisheye")
    picture = stage.sensor_picture(0, size)
    radius = np.hypot(*np.meshgrid(*[np.arange(n) - (n - 1) / 2 for n in size]))
    outside = radius > 140 * math.radians(95) + 1
    assert outside.any()
    assert (picture[outside] == NO_RAY).all()
    assert not (picture[radius < 140 * math.radians(95) - 1] == NO_RAY).all(axis=1).any()


def test_a_pinhole_is_drawn_as_before(stage_of):
    stage, _, size = stage_of("pinhole")
    assert np.array_equal(stage.sensor_picture(0, size), stage.picture(stage.sensor_eye(0), size))
    depths, samples = stage.depth(stage.sensor_eye(0), size)
    assert np.array_equal(stage.sensor_distances(0, size)[0], depths)
    assert stage.sensor_distances(0, size)[1] == samples


@pytest.mark.parametrize("name", [name for name in LENSES if name != "pinhole"])
def test_every_pixel_with_a_ray_has_a_window_that_it_looks_into(name):
    lens, size = LENSES[name]
    small = (size[0] // 4, size[1] // 4)
    ups = list(look_ups(lens, small))
    assert [(up.row, up.column) for up in ups] == [(i, j) for i in (0, 1) for j in (0, 1)]
    for up in ups:
        u = (np.arange(small[0]) + (up.column + 0.5) / SAMPLES) / small[0]
        v = (np.arange(small[1]) + (up.row + 0.5) / SAMPLES) / small[1]
        along = lens.directions(u[None], v[:, None])
        has_ray = np.isfinite(along[0])
        assert ((up.window >= 0) == has_ray).mean() > 1 - 1e-4
        inside = (up.window >= 0) & has_ray
        assert (np.abs(np.stack([up.u, up.v])[:, inside] - 0.5) <= 0.5).all()
        # back out of the window it is the way that the lens looks
        tan_x, tan_y = up.windows.tan_half
        x, y = (2 * up.u[inside] - 1) * tan_x, (1 - 2 * up.v[inside]) * tan_y
        turn = up.windows.window_to_camera[up.window[inside]]
        back = np.einsum("nij,jn->in", turn, np.stack([x, y, -np.ones_like(x)]))
        back /= np.linalg.norm(back, axis=0)
        np.testing.assert_allclose(back * [[1], [1], [-1]], along[:, inside], atol=1e-3)
    assert max(window_size(lens, size)) <= 4096


@pytest.mark.parametrize("name", LENSES)
def test_sheets_are_as_wide_as_the_image_is(name, stage_of):
    stage, _, _ = stage_of(name, partner=Partner((50, 0, 0), LENSES[name][0]))
    for sheet in (sensor_sheet(stage, 0, (320, 200)), depth_sheet(stage, 0, (320, 200))):
        assert sheet.size[0] <= 320
        assert (sheet.pixels() != 255).any()
    assert contact_sheet(stage, (320, 200)).size[0] == 320


def test_words_say_lens_range_and_second_viewpoint(ring_study):
    cam = ring_study.sensors[0]
    assert sensor_words(cam, "mm") == "cam · 320 × 240 pixels · 50° × 38° · 100 to 420\u00a0mm"
    lidar = replace(cam, lens=LENSES["lidar"][0], resolution=(1800, 16), distance="range")
    assert sensor_words(lidar, "mm") == (
        "cam · 1800 × 16 pixels · 360° × 100° by azimuth and elevation · "
        "100 to 420\u00a0mm from its centre"
    )
    pair = replace(cam, partner=Partner((55, 0, 0), cam.lens, role="projector"))
    assert sensor_words(pair, "mm").endswith("· projector 55\u00a0mm beside")
    assert "fisheye" in sensor_words(replace(cam, lens=ROUND), "mm")
    assert "with distortion" in sensor_words(replace(cam, lens=DISTORTED), "mm")
