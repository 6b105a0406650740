"""Poses and projections against the formulas of their conventions, which need no picture."""

import math

import numpy as np
import pytest

from glvis.problem.camera import (
    angles_from_direction,
    direction_from_angles,
    look_along,
    mirrored_pose,
    position_direction_roll,
    projection_matrix,
    rigid_inverse,
)
from glvis.problem.lens import Pinhole

AXES = np.concatenate([np.eye(3), -np.eye(3)])


def rotation_about(axis, angle):
    """Rodrigues' formula: the right-hand rotation about a unit axis."""
    x, y, z = axis
    cross = np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]])
    return np.eye(3) + math.sin(angle) * cross + (1 - math.cos(angle)) * cross @ cross


def random_poses(rng, n, up=(0, 0, 1)):
    position, direction = rng.normal(size=(2, n, 3))
    roll = rng.uniform(-math.pi, math.pi, n)
    return look_along(position, direction, roll, up)


# --- intrinsics


def test_tangents_of_the_half_angles():
    np.testing.assert_allclose(
        Pinhole.from_degrees(90, 60).tan_half, [1, 1 / math.sqrt(3)], rtol=1e-15
    )


@pytest.mark.parametrize("bad", [0, -10, 180, 190, math.nan])
def test_field_of_view_outside_0_to_180_is_refused(bad):
    with pytest.raises(ValueError, match=r"hfov = .* deg must lie in \(0, 180\)"):
        Pinhole.from_degrees(bad, 40)
    with pytest.raises(ValueError, match=r"vfov = .* deg must lie in \(0, 180\)"):
        Pinhole.from_degrees(40, bad)


# --- directions


def test_azimuth_turns_from_x_towards_y_and_elevation_rises_towards_z():
    quarter = math.pi / 2
    for azimuth, elevation, expected in (
        (0, 0, (1, 0, 0)),
        (quarter, 0, (0, 1, 0)),
        (2 * quarter, 0, (-1, 0, 0)),
        (0, quarter, (0, 0, 1)),
        (1.234, -quarter, (0, 0, -1)),
        (quarter / 2, quarter / 2, (0.5, 0.5, math.sqrt(0.5))),
    ):
        np.testing.assert_allclose(direction_from_angles(azimuth, elevation), expected, atol=1e-15)


def test_angles_and_directions_are_inverse_of_each_other(rng):
    azimuth = rng.uniform(-math.pi, math.pi, 500)
    elevation = rng.uniform(-math.pi / 2, math.pi / 2, 500)
    direction = direction_from_angles(azimuth, elevation)
    assert direction.shape == (500, 3)
    np.testing.assert_allclose(np.linalg.norm(direction, axis=1), 1, rtol=1e-14)
    got = angles_from_direction(direction * rng.uniform(0.1, 100, (500, 1)))
    np.testing.assert_allclose(got, [azimuth, elevation], atol=1e-7)


def test_angles_broadcast():
    assert direction_from_angles(np.zeros((4, 1)), np.zeros(3)).shape == (4, 3, 3)


# --- poses


def test_columns_are_right_up_back_and_position():
    # Looking along +y from (1, 2, 3) with z up: right is +x.
    pose = look_along((1, 2, 3), (0, 5, 0))
    expected = [[1, 0, 0, 1], [0, 0, -1, 2], [0, 1, 0, 3], [0, 0, 0, 1]]
    np.testing.assert_allclose(pose, expected, atol=1e-15)


def test_paper_arm_scanner_has_the_images_major_axis_parallel_to_xz():
    # Table 8, with up = y (Sec. 3.1: roll 0 puts the major axis parallel to the XZ plane)
    pose = look_along((178, -242, 136), (-0.82, 0.55, -0.14), 0, up=(0, 1, 0))
    assert pose[1, 0] == pytest.approx(0, abs=1e-15)
    assert pose[1, 1] > 0


@pytest.mark.parametrize("up", [(0, 0, 1), (0, 1, 0), (1, 2, -2)])
def test_unrolled_up_is_the_projection_of_up(rng, up):
    direction = rng.normal(size=(300, 3))
    direction /= np.linalg.norm(direction, axis=1, keepdims=True)
    pose = look_along(np.zeros(3), direction, 0.0, up)
    projected = np.array(up) - (direction @ up)[:, None] * direction
    projected /= np.linalg.norm(projected, axis=1, keepdims=True)
    np.testing.assert_allclose(pose[:, :3, 1], projected, atol=1e-9)
    np.testing.assert_allclose(pose[:, :3, 2], -direction, atol=1e-15)


def test_roll_turns_the_camera_about_its_axis_by_the_right_hand_rule(rng):
    for _ in range(100):
        direction = rng.normal(size=3)
        direction /= np.linalg.norm(direction)
        roll = rng.uniform(-7, 7)
        unrolled = look_along((1, 2, 3), direction)
        rolled = look_along((1, 2, 3), direction, roll)
        turn = rotation_about(direction, roll)
        np.testing.assert_allclose(rolled[:3, :3], turn @ unrolled[:3, :3], atol=1e-12)
        np.testing.assert_array_equal(rolled[:, 3], unrolled[:, 3])


def test_a_quarter_roll_brings_up_to_where_right_was():
    # right' = right cos - up sin, up' = right sin + up cos
    unrolled, rolled = look_along((0, 0, 0), (0, 1, 0), [0, math.pi / 2])
    np.testing.assert_allclose(rolled[:3, 0], -unrolled[:3, 1], atol=1e-15)
    np.testing.assert_allclose(rolled[:3, 1], unrolled[:3, 0], atol=1e-15)


@pytest.mark.parametrize("up", [*AXES.tolist(), (1, 1, 1), (3, -4, 0)])
def test_looking_along_up_takes_the_least_aligned_world_axis_instead(up):
    length = np.linalg.norm(up)
    fallback = np.eye(3)[np.argmin(np.abs(up))]
    for sign in (1, -1):
        direction = sign * np.array(up) * 3
        pose = look_along(np.zeros(3), direction, 0.0, up)
        unit = direction / (3 * length)
        projected = fallback - (unit @ fallback) * unit
        np.testing.assert_allclose(pose[:3, 1], projected / np.linalg.norm(projected), atol=1e-12)


def test_poses_are_proper_rotations_even_near_and_at_the_parallel(rng):
    directions = [rng.normal(size=(200, 3)), AXES]
    for tiny in (1e-3, 1e-6, 1e-8, 1e-9, 1e-10, 1e-12, 1e-16):
        directions.append(AXES + tiny * rng.normal(size=(6, 3)))
    direction = np.concatenate(directions)
    for up in AXES:
        pose = look_along(np.zeros(3), direction, 0.3, up)
        rotation = pose[:, :3, :3]
        assert np.all(np.isfinite(pose))
        unit = np.broadcast_to(np.eye(3), rotation.shape)
        np.testing.assert_allclose(rotation @ rotation.transpose(0, 2, 1), unit, atol=1e-7)
        np.testing.assert_allclose(np.linalg.det(rotation), 1, atol=1e-7)


def test_poses_broadcast_over_any_leading_shape(rng):
    position, direction = rng.normal(size=(2, 4, 5, 3))
    pose = look_along(position, direction, rng.normal(size=(4, 5)))
    assert pose.shape == (4, 5, 4, 4)
    one = look_along(position[2, 3], direction[2, 3])
    np.testing.assert_allclose(one[:3, 3], pose[2, 3, :3, 3])
    assert look_along(np.zeros(3), direction).shape == (4, 5, 4, 4)
    assert look_along(position, (0, 1, 0)).shape == (4, 5, 4, 4)
    assert look_along(np.zeros(3), (0, 1, 0), np.zeros(7)).shape == (7, 4, 4)


@pytest.mark.parametrize("bad", [(0, 0, 0), (math.nan, 0, 1), (math.inf, 0, 0)])
def test_a_direction_or_up_that_is_none_is_refused(bad):
    with pytest.raises(ValueError, match="a direction must be finite and not zero"):
        look_along((0, 0, 0), bad)
    with pytest.raises(ValueError, match="a direction must be finite and not zero"):
        look_along((0, 0, 0), (1, 0, 0), 0, up=bad)


@pytest.mark.parametrize("up", [(0, 0, 1), (0, 1, 0), (1, 2, 3)])
def test_position_direction_and_roll_come_back_from_a_pose(rng, up):
    position, direction = rng.normal(size=(2, 300, 3))
    direction = np.concatenate([direction, np.array([up]), -np.array([up])])
    position = np.concatenate([position, np.zeros((2, 3))])
    roll = rng.uniform(-math.pi, math.pi, 302)
    pose = look_along(position, direction, roll, up)
    got_position, got_direction, got_roll = position_direction_roll(pose, up)
    unit = direction / np.linalg.norm(direction, axis=1, keepdims=True)
    np.testing.assert_allclose(got_position, position)
    np.testing.assert_allclose(got_direction, unit, atol=1e-12)
    np.testing.assert_allclose(got_roll, roll, atol=1e-9)


# --- mirrors


@pytest.mark.parametrize(
    ("point", "normal"),
    [
        ((0, 0, 0), (1, 0, 0)),
        ((3, 1, 2), (0, 1, 0)),
        ((0, 0, -7), (0, 0, 2)),
        ((1, 2, 3), (1, 1, 0)),
    ],
)
def test_mirrored_pose_sees_the_mirrored_point_at_the_mirrored_pixel(rng, point, normal):
    pose = random_poses(rng, 50)
    twin = mirrored_pose(pose, point, normal)
    unit = np.array(normal) / np.linalg.norm(normal)
    points = rng.normal(size=(50, 3)) * 5
    images = points - 2 * ((points - point) @ unit)[:, None] * unit

    def in_camera(poses, where):
        homogeneous = np.concatenate([where, np.ones((len(where), 1))], axis=1)
        return np.einsum("nij,nj->ni", rigid_inverse(poses), homogeneous)[:, :3]

    np.testing.assert_allclose(
        in_camera(twin, images), in_camera(pose, points) * [-1, 1, 1], atol=1e-12
    )
    np.testing.assert_allclose(np.linalg.det(twin[:, :3, :3]), 1)


@pytest.mark.parametrize("normal", [(1, 0, 0), (0, 1, 0), (0, 0, 1)])
@pytest.mark.parametrize("up", [(0, 0, 1), (0, 1, 0), (1, 0, 0)])
def test_mirroring_reflects_position_and_direction_and_turns_roll_round(rng, normal, up):
    # up lies in the plane or is normal to it. In the latter case image up would hang down:
    # the twin then stands on its head, roll + 180 degrees.
    position, direction = rng.normal(size=(2, 80, 3))
    roll = rng.uniform(-math.pi, math.pi, 80)
    twin = mirrored_pose(look_along(position, direction, roll, up), (0, 0, 0), normal)
    reflection = 1 - 2 * np.array(normal)
    along = abs(np.dot(normal, up)) == 1
    expected = look_along(
        position * reflection, direction * reflection, -roll + (math.pi if along else 0), up
    )
    np.testing.assert_allclose(twin, expected, atol=1e-9)


def test_mirrored_pose_is_its_own_inverse(rng):
    pose = random_poses(rng, 30)
    twice = mirrored_pose(mirrored_pose(pose, (1, 2, 3), (1, -1, 2)), (1, 2, 3), (1, -1, 2))
    np.testing.assert_allclose(twice, pose, atol=1e-12)


def test_table_8_pairs_are_mirror_images_with_opposite_roll():
    for position, direction, roll in (
        ((178, -242, 136), (-0.82, 0.55, -0.14), 0),
        ((216, -208, -136), (-0.77, 0.62, -0.13), 20),
    ):
        y = (0, 1, 0)
        right = look_along(position, direction, math.radians(roll), y)
        flip = np.array([-1, 1, 1])
        left = look_along(position * flip, np.array(direction) * flip, -math.radians(roll), y)
        np.testing.assert_allclose(mirrored_pose(right, (0, 0, 0), (1, 0, 0)), left, atol=1e-12)


# --- matrices


def test_rigid_inverse_undoes_a_pose(rng):
    pose = random_poses(rng, 100).reshape(10, 10, 4, 4)
    unit = np.broadcast_to(np.eye(4), pose.shape)
    np.testing.assert_allclose(rigid_inverse(pose) @ pose, unit, atol=1e-12)
    np.testing.assert_allclose(rigid_inverse(rigid_inverse(pose)), pose, atol=1e-15)


@pytest.mark.parametrize(("near", "far"), [(0.1, 10.0), (1.0, 1.5), (3.0, 4500.0)])
def test_corners_of_the_frustum_land_on_the_corners_of_the_clip_cube(near, far):
    tan_x, tan_y = tan_half = Pinhole.from_degrees(66.4, 39.5).tan_half
    matrix = projection_matrix(tan_half, near, far)
    for x in (-1, 1):
        for y in (-1, 1):
            for z, depth in ((-1, near), (1, far)):
                corner = np.array([x * tan_x * depth, y * tan_y * depth, -depth, 1])
                clip = matrix @ corner
                assert clip[3] == pytest.approx(depth)
                np.testing.assert_allclose(clip[:3] / clip[3], [x, y, z], atol=1e-12)


def test_a_known_point_lands_on_a_known_pixel():
    # 90 degrees wide, 640 x 480 px: focal length 320 px. One metre ahead, a quarter to the right
    # and an eighth up is 80 px right of and 40 px above the middle.
    tan_half = (1, 0.75)
    pose = look_along((5, 5, 5), (0, 1, 0))
    clip = projection_matrix(tan_half, 0.1, 10) @ rigid_inverse(pose) @ [5.25, 6, 5.125, 1]
    x, y = clip[:2] / clip[3]
    assert ((x + 1) * 320, (1 - y) * 240) == pytest.approx((320 + 80, 240 - 40))


def test_projections_broadcast():
    assert projection_matrix(np.ones((6, 2)), 1.0, np.arange(2, 8)).shape == (6, 4, 4)
    assert projection_matrix((1, 1), np.ones((3, 1)), np.array([2, 3])).shape == (3, 2, 4, 4)


@pytest.mark.parametrize(("near", "far"), [(0, 1), (-1, 1), (2, 1), (1, 1), (math.nan, 1)])
def test_clip_planes_out_of_order_are_refused(near, far):
    with pytest.raises(ValueError, match=r"clip planes must satisfy 0 < near < far, got .* and"):
        projection_matrix((1, 1), near, far)
