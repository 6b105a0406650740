"""Windows of lenses and second viewpoints: both engines say the same, whatever the lens."""

import math

import numpy as np
import pytest
from support import shapes
from support.one_sensor import DOWN, looking, random_poses, sensor

import glvis
from glvis.problem.calibrated_lens import FisheyeLens, OpenCVLens
from glvis.problem.camera import look_along, rigid_inverse
from glvis.problem.lens import Pinhole, SphericalLens
from glvis.problem.scene import Model
from glvis.problem.sensor import Partner, Sensor
from glvis.problem.visibility_options import VisibilityOptions
from glvis.visibility import cast
from glvis.visibility.filters import (
    Limits,
    Refusal,
    faces_in_camera,
    pass_filters,
    refusals_of_sensor,
)
from glvis.visibility.lookup import lookup_of

PINHOLE = Pinhole.from_degrees(66.4, 39.5)
BARREL = OpenCVLens((800, 600), (538.6, 540.1), (392.0, 305.0), (-0.35, 0.08, 0.003, -0.003))
FISHEYE = FisheyeLens((900, 900), (900 / math.radians(220),) * 2, (449.5, 449.5), ())
LIDAR = SphericalLens(2 * math.pi, (math.radians(-15), math.radians(20)))
EVERYWHERE = SphericalLens(2 * math.pi, (-math.pi / 2, math.pi / 2))
BASE = {
    "resolution": (320, 240),
    "min_distance": 0.3,
    "max_distance": 4.5,
    "max_incidence": math.radians(75),
}
SENSORS = {
    "opencv": Sensor("s", BARREL, **BASE),
    "fisheye": Sensor("s", FISHEYE, distance="range", **BASE),
    "fisheye by depth": Sensor("s", FISHEYE, **BASE),
    "lidar": Sensor("s", LIDAR, distance="range", **BASE),
    "all directions": Sensor("s", EVERYWHERE, distance="range", **BASE),
    "pinhole by range": Sensor("s", PINHOLE, distance="range", **BASE),
    "pair": Sensor("s", PINHOLE, partner=Partner((0.4, 0, 0), PINHOLE), **BASE),
    "projector": Sensor(
        "s",
        BARREL,
        partner=Partner(
            (0.7, 0.05, -0.1), Pinhole.from_degrees(60, 50), (-0.15, 0.05), "projector"
        ),
        **BASE,
    ),
    "two kinds": Sensor(
        "s", FISHEYE, distance="range", partner=Partner((0.2, 0.1, 0), EVERYWHERE), **BASE
    ),
}


def scene(seed):
    rng = np.random.default_rng(seed)
    body = shapes.merged(shapes.blob(rng), shapes.torus())
    obstacle = shapes.moved(shapes.blob(rng, 2, 0.4), rng.normal(size=3))
    poses = [random_poses(rng, 4), random_poses(rng, 2, 1.0), random_poses(rng, 2, 0.1)]
    return body, obstacle, np.concatenate(poses)


@pytest.mark.skipif(not cast.has_compute(), reason="this driver has no compute shaders")
@pytest.mark.parametrize("criterion", ["pixels", "centroid"])
@pytest.mark.parametrize("name", SENSORS)
def test_shaders_see_what_numpy_sees(name, criterion):
    body, obstacle, poses = scene(1)
    found = []
    for casts in (True, False):
        with looking(body, [obstacle], casts=casts, criterion=criterion) as made:
            found.append(made.looks(poses, SENSORS[name]))
    assert found[0].any()
    assert np.count_nonzero(found[0] != found[1]) <= 1e-3 * np.count_nonzero(found[1])


@pytest.mark.parametrize("name", SENSORS)
def test_drawn_pixels_show_little_that_points_do_not(name):
    body, obstacle, poses = scene(2)
    found = []
    for resolution in ("sensor", "auto"):
        with looking(body, [obstacle], casts=False, resolution=resolution) as made:
            found.append(made.looks(poses, SENSORS[name]))
    drawn, asked = found
    assert drawn.any()
    # a pixel of a few faces may show the edge of one of which no point is asked about
    assert np.count_nonzero(drawn & ~asked) <= 0.02 * np.count_nonzero(asked)


@pytest.mark.parametrize("options", [{}, {"criterion": "centroid"}, {"resolution": "sensor"}])
def test_a_partner_in_the_same_place_changes_nothing(options):
    body, obstacle, poses = scene(3)
    alone = Sensor("s", PINHOLE, **BASE)
    pair = Sensor("s", PINHOLE, partner=Partner((0, 0, 0), PINHOLE), **BASE)
    with looking(body, [obstacle], **options) as made:
        found = made.looks(poses, alone)
        assert found.any() and np.array_equal(found, made.looks(poses, pair))


def test_a_pair_sees_what_each_of_the_two_sees_at_least():
    body, obstacle, poses = scene(4)
    pair = SENSORS["pair"]
    alone = Sensor("s", PINHOLE, **BASE)
    far = Sensor("s", PINHOLE, (320, 240), 0, 100, BASE["max_incidence"])
    with looking(body, [obstacle], criterion="centroid") as made:
        both = made.looks(poses, alone) & made.looks(pair.partner.poses(poses), far)
        assert both.any() and np.array_equal(both, made.looks(poses, pair))


def test_a_lens_without_distortion_is_a_pinhole():
    body, obstacle, poses = scene(5)
    size = (800, 600)
    focal = [n / 2 / t for n, t in zip(size, PINHOLE.tan_half, strict=True)]
    lens = OpenCVLens(size, tuple(focal), (399.5, 299.5), ())
    with looking(body, [obstacle], criterion="centroid") as made:
        found = [made.looks(poses, Sensor("s", one, **BASE)) for one in (lens, PINHOLE)]
    assert found[1].any() and np.count_nonzero(found[0] != found[1]) <= 1


@pytest.mark.parametrize("lens", [BARREL, FISHEYE, LIDAR, EVERYWHERE])
def test_a_window_shows_each_pixel_in_its_direction(lens):
    lookup = lookup_of(lens, (90, 60))
    width, height = lookup.window_size
    windows, (tan_x, tan_y) = lens.windows, lens.windows.tan_half
    column, row = np.meshgrid(np.arange(width) + 0.5, np.arange(height) + 0.5)
    across, up = (2 * column / width - 1) * tan_x, (1 - 2 * row / height) * tan_y
    images = []
    for turn in windows.window_to_camera:
        right, above, back = np.tensordot(turn, np.stack([across, up, -np.ones_like(up)]), axes=1)
        directions = np.stack([right, above, -back], axis=-1)
        images.append(directions / np.linalg.norm(directions, axis=-1, keepdims=True))
    found = lookup.image(images, nothing=np.nan)
    u, v = np.meshgrid((np.arange(90) + 0.5) / 90, (np.arange(60) + 0.5) / 60)
    expected = np.moveaxis(lens.directions(u, v), 0, -1)
    assert np.array_equal(np.isnan(found), np.isnan(expected))
    assert np.nanmax(np.linalg.norm(found - expected, axis=-1)) < 0.75 * max(
        2 * tan_x / width, 2 * tan_y / height
    )


def test_the_far_end_is_a_sphere_by_range_and_a_plane_by_depth():
    # a wall at depth 2 in two halves, whose centres are 2.4 away
    wall = shapes.merged(*(shapes.plate(1, center=(x, 0.0, -2.0)) for x in (-1.3, 1.3)))
    lens = Pinhole.from_degrees(100, 100)
    with looking(wall, criterion="centroid") as made:
        by_depth = made.looks(DOWN[None], Sensor("s", lens, (64, 64), 0, 2.1))
        by_range = made.looks(DOWN[None], Sensor("s", lens, (64, 64), 0, 2.1, distance="range"))
    assert by_depth.all() and not by_range.any()


def test_the_reasons_of_a_partner_are_told():
    body, _, poses = scene(6)
    model = Model.from_arrays("body", *body)
    options, pair = VisibilityOptions(criterion="centroid"), SENSORS["projector"]
    told = set()
    for pose in poses:
        found = refusals_of_sensor(model, pose, pair, options)
        first = pass_filters(faces_in_camera(model, pose, options), Limits.of(pair, options))
        faces = faces_in_camera(model, pose, options)
        to_partner = rigid_inverse(pair.partner.partner_to_sensor)
        second = pass_filters(
            faces.moved(to_partner), Limits.of(pair, options).of_partner(pair.partner)
        )
        assert np.array_equal(found == Refusal.NONE, first & second)
        assert np.array_equal(found >= Refusal.OUTSIDE_PARTNER, first)
        told |= set(found.tolist())
    assert {Refusal.OUTSIDE_PARTNER, Refusal.TURNED_FROM_PARTNER} <= told


def test_faces_move_with_the_camera():
    body, _, poses = scene(7)
    model, options = Model.from_arrays("body", *body), VisibilityOptions()
    partner = SENSORS["projector"].partner
    moved = faces_in_camera(model, poses[0], options).moved(
        rigid_inverse(partner.partner_to_sensor)
    )
    again = faces_in_camera(model, partner.poses(poses[0]), options)
    assert np.allclose(moved.points, again.points) and np.allclose(moved.normals, again.normals)


def test_the_papers_semantics_know_no_other_lens():
    with pytest.raises(ValueError, match="one ideal pinhole"):
        glvis.visible_faces(
            shapes.plate(1), look_along([0, 0, 3], [0, 0, -1]), SENSORS["pair"],
            options=VisibilityOptions.paper(),
        )  # fmt: skip
    assert sensor().is_ideal


@pytest.mark.skipif(not cast.has_compute(), reason="this driver has no compute shaders")
@pytest.mark.parametrize("criterion", ["pixels", "centroid"])
@pytest.mark.parametrize("partner", [None, Partner((0.0, 0.0, 0.0), LIDAR)], ids=["one", "two"])
def test_what_lies_on_the_seam_of_windows_is_hidden_too(partner, criterion, monkeypatch):
    def no_numpy(*_):
        raise AssertionError("NumPy was asked")

    # the optical axis of a full turn is a seam of its four windows; the ball is symmetric to it and
    # so small in its room that many of its centres share a cell
    ball = shapes.moved(shapes.icosphere(5, 0.06), (0, 0, -1.5))
    n, body = len(ball[1]), shapes.merged(ball, shapes.flipped(shapes.cube(6.0)))
    plate = shapes.plate(0.25, center=(0, 0, -0.7))
    device = Sensor("s", LIDAR, (1800, 16), 0, 100, distance="range", partner=partner)
    monkeypatch.setattr(cast, "visible_of", no_numpy)
    with looking(body, [plate], casts=True, criterion=criterion) as made:
        assert not made.looks(DOWN[None], device)[:, :n].any()
    with looking(body, casts=True, criterion=criterion) as made:
        assert made.looks(DOWN[None], device)[:, :n].any()
