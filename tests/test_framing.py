"""Views and eyes: directions by name, and frames that just hold what they must show."""

import numpy as np
import pytest
from support.shapes import cube, icosphere, plate

from glvis.pictures.framing import (
    View,
    axis_label,
    fitted_eye,
    level_axes,
    standard_views,
    towards_eye,
    view_axes,
)
from glvis.problem.scene import Model

UPS = ([0, 0, 1], [0, 1, 0], [1, 0, 0], [0.2, -0.5, 0.8])


@pytest.mark.parametrize("up", UPS)
def test_level_axes_are_a_right_handed_frame(up):
    right, forward, z = level_axes(up)
    np.testing.assert_allclose(np.linalg.det([right, forward, z]), 1, atol=1e-12)
    np.testing.assert_allclose(z, np.array(up) / np.linalg.norm(up), atol=1e-12)


def test_front_view_with_z_up_looks_along_plus_y():
    np.testing.assert_allclose(towards_eye([0, 0, 1], 0, 0), [0, -1, 0], atol=1e-12)
    axes = view_axes([0, 0, 1], View("front", 0, 0))
    np.testing.assert_allclose(axes[:, 0], [1, 0, 0], atol=1e-12)  # X to the right
    np.testing.assert_allclose(axes[:, 1], [0, 0, 1], atol=1e-12)  # Z upwards


def test_azimuth_90_is_the_right_side_and_elevation_90_the_top():
    np.testing.assert_allclose(towards_eye([0, 0, 1], 90, 0), [1, 0, 0], atol=1e-12)
    np.testing.assert_allclose(towards_eye([0, 0, 1], 0, 90), [0, 0, 1], atol=1e-12)
    top = view_axes([0, 0, 1], View("top", 0, 90))
    np.testing.assert_allclose(top[:, 1], [0, 1, 0], atol=1e-12)  # away from the front is up


@pytest.mark.parametrize("is_parallel", [True, False])
@pytest.mark.parametrize("seed", range(5))
def test_fitted_eye_shows_all_points_and_wastes_nothing(is_parallel, seed):
    rng = np.random.default_rng(seed)
    points = rng.normal(size=(200, 3)) * rng.uniform(1, 100, size=3) + [1e4, 0, -1e4]
    view = View("any", rng.uniform(0, 360), rng.uniform(-60, 60), is_parallel)
    size = (800, 500)
    eye = fitted_eye([0, 0, 1], view, points, size[0] / size[1], margin=0.05)
    low, high = eye.project(points, size).min(axis=0), eye.project(points, size).max(axis=0)
    free = 0.05 * np.array(size)
    assert (low >= free - 3).all()
    assert (high <= size - free + 3).all()
    # one of the two directions is filled
    assert ((high - low) / (size - 2 * free)).max() > 0.98


def test_projection_has_row_0_at_the_top_and_knows_its_scale():
    eye = fitted_eye([0, 0, 1], View("front", 0, 0), cube(2.0)[0], 1.0, margin=0.25)
    right_top = eye.project([1.0, 0.0, 1.0], (400, 400))
    np.testing.assert_allclose(right_top, [300, 100], atol=1e-6)
    assert eye.pixels_per_length((400, 400)) == pytest.approx(100)


def test_points_behind_the_eye_have_no_place():
    eye = fitted_eye([0, 0, 1], View("front", 0, 0, is_parallel=False), cube()[0], 1.0)
    behind = eye.camera_to_world[:3, 3] + 5 * eye.camera_to_world[:3, 2]
    assert np.isnan(eye.project(behind, (10, 10))).all()


def test_closed_surface_is_seen_from_front_and_right():
    model = Model.from_arrays("ball", *icosphere(2))
    views = standard_views([0, 0, 1], model.normals, model.areas, [1, 1, 1])
    assert [views[k].name for k in ("top", "front", "side")] == ["top", "front", "right"]
    assert views["perspective"].azimuth_deg == 35


def test_surface_without_back_is_seen_from_where_it_faces():
    model = Model.from_arrays("wall", *plate(tilt_deg=-90))  # normal +y: away from the front
    views = standard_views([0, 0, 1], model.normals, model.areas, [1, 0, 1])
    assert views["front"].name == "back"
    assert towards_eye([0, 0, 1], views["perspective"].azimuth_deg, 0)[1] > 0


def test_long_thing_is_shown_from_its_long_side():
    model = Model.from_arrays("ball", *icosphere(1))
    long = standard_views([0, 0, 1], model.normals, model.areas, [1, 5, 1])["perspective"]
    assert long.azimuth_deg == 60


def test_axis_labels_name_world_axes_only():
    assert axis_label([0, 0, 2]) == "+Z"
    assert axis_label([0, -1, 0]) == "−Y"
    assert axis_label([1, 1, 0]) == ""
