"""The door from Python: meshes of all kinds in, the same maps as a study's out, clear refusals."""

import doctest
import importlib

import numpy as np
import pytest
import trimesh
from support import shapes
from support.one_sensor import seen

import glvis

CAMERA = glvis.Sensor.from_degrees(
    hfov_deg=60, vfov_deg=45, resolution=(320, 240), min_distance=1, max_distance=10
)


def test_a_ball_is_seen_from_two_sides_from_five_lines():
    ball = trimesh.creation.icosphere(subdivisions=4)
    poses = glvis.look_at([[0, 0, 5], [0, 0, -5]], [0, 0, 0])
    visible = glvis.visible_faces(ball, poses, CAMERA)
    assert visible.shape == (2, len(ball.faces)) and not visible.all(axis=0).any()
    # from 5 radii a sphere shows (1 - 1/5) / 2 of its area
    share = visible @ ball.area_faces / ball.area
    np.testing.assert_allclose(share, 0.4, atol=0.01)


def test_a_path_a_trimesh_and_arrays_are_one_mesh(tmp_path, rng):
    mesh = trimesh.Trimesh(*shapes.blob(rng), process=False)
    path = tmp_path / "blob.ply"
    mesh.export(path)
    pose = glvis.look_at([3, 1, 2], [0, 0, 0], roll_deg=20)
    first = glvis.visible_faces(mesh, pose, CAMERA)
    assert first.shape == (len(mesh.faces),) and first.any() and not first.all()
    for other in (path, str(path), (mesh.vertices, mesh.faces)):
        assert np.count_nonzero(first != glvis.visible_faces(other, pose, CAMERA)) <= 2
    assert np.array_equal(first, seen((mesh.vertices, mesh.faces), pose, CAMERA))


def test_obstacles_hide_and_are_not_counted():
    wall, plate = shapes.plate(2, center=(0, 0, -4)), shapes.plate(2, center=(0, 0, -2))
    pose = glvis.look_at([0, 0, 0], [0, 0, -1], up=(0, 1, 0))
    assert glvis.visible_faces(wall, pose, CAMERA).all()
    assert not glvis.visible_faces(wall, pose, CAMERA, obstacles=[plate]).any()


def test_options_are_those_of_a_study():
    plate = shapes.plate(0.5, center=(0, 0, -3), tilt_deg=105)
    pose = glvis.look_at([0, 0, 0], [0, 0, -1], up=(0, 1, 0))
    assert not glvis.visible_faces(plate, pose, CAMERA).any()
    options = glvis.VisibilityOptions.paper()
    assert glvis.visible_faces(plate, pose, CAMERA, options=options).all()


@pytest.mark.parametrize(
    "options",
    [
        None,
        glvis.VisibilityOptions(resolution="sensor"),
        glvis.VisibilityOptions(criterion="centroid", occlusion="paper"),
        glvis.VisibilityOptions.paper(),
    ],
)
def test_no_pose_gives_no_row(options):
    none = np.zeros((0, 4, 4))
    assert glvis.visible_faces(shapes.plate(1), none, CAMERA, options=options).shape == (0, 2)


def test_by_axis_a_level_camera_sees_the_floor_up_to_90_degrees():
    """The normal is square to the axis: rounding of pi / 2 decided."""
    floor = shapes.plate(3, center=(0, 0, 0))
    pose = glvis.look_at([0, -5, 1], [0, 0, 1])
    for resolution in ("auto", "sensor"):
        options = glvis.VisibilityOptions(incidence="axis", resolution=resolution)
        assert glvis.visible_faces(floor, pose, CAMERA, options=options).all()


@pytest.mark.parametrize("obstacles", ["fixture.stl", trimesh.creation.box(), None])
def test_obstacles_that_are_no_sequence_are_refused(obstacles):
    with pytest.raises(ValueError, match="obstacles must be a sequence"):
        glvis.visible_faces(shapes.plate(1), np.eye(4), CAMERA, obstacles)


@pytest.mark.parametrize(
    ("call", "fact"),
    [
        (lambda: glvis.look_at([0, 0, 1], [0, 0, 1]), "target must not be where the camera stands"),
        (
            lambda: glvis.look_at([0, 0], [0, 1]),
            "position must be finite and of shape",
        ),
        (lambda: glvis.look_at([0, 0, 0], [0, np.nan, 1]), "target must be finite"),
        (lambda: glvis.look_at([0, 0, 0], [0, 1, 1], roll_deg=np.nan), "roll_deg must be finite"),
        (lambda: a_sensor(resolution=(128.0, 96)), "two whole numbers"),
        (lambda: a_sensor(resolution=640), "two whole numbers"),
        (lambda: a_sensor(hfov_deg=190), r"190 deg must lie in \(0, 180\)"),
    ],
)
def test_what_no_camera_can_be_is_refused(call, fact):
    with pytest.raises(ValueError, match=fact):
        call()


def a_sensor(**changes):
    sheet = {"hfov_deg": 60, "vfov_deg": 45, "resolution": (64, 48)}
    return glvis.Sensor.from_degrees(**sheet | {"min_distance": 1, "max_distance": 9} | changes)


@pytest.mark.parametrize(
    ("mesh", "pose", "fact"),
    [
        ("none.stl", np.eye(4), r"^mesh 'none\.stl' does not exist"),
        (7, np.eye(4), r"^mesh must be a path, a trimesh\.Trimesh or \(vertices, faces\), got int"),
        (([[0, 0, 0]], [[0, 1, 2]]), np.eye(4), "^mesh "),
        (shapes.plate(1), np.eye(3), r"shape \(\.\.\., 4, 4\), got \(3, 3\)"),
        (shapes.plate(1), [np.eye(4), 2 * np.eye(4)], r"^camera_to_world\[1\] is no rigid pose"),
        (shapes.plate(1), np.diag([-1.0, 1, 1, 1]), "^camera_to_world is no .* right-handed"),
        (shapes.plate(1), np.full((4, 4), np.nan), "no rigid pose"),
    ],
)
def test_what_is_no_mesh_or_pose_is_refused(mesh, pose, fact):
    with pytest.raises(ValueError, match=fact):
        glvis.visible_faces(mesh, pose, CAMERA)


def test_an_obstacle_that_is_no_mesh_is_named():
    with pytest.raises(ValueError, match=r"^obstacles\[1\] must be a path"):
        glvis.visible_faces(shapes.plate(1), np.eye(4), CAMERA, [shapes.plate(1), None])


@pytest.mark.parametrize("module", ["problem.camera", "problem.sensor", "visibility.visible_faces"])
def test_examples_in_docstrings_run(module):
    failed, tried = doctest.testmod(importlib.import_module(f"glvis.{module}"))
    assert tried > 0 and failed == 0
