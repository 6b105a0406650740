"""Mounts and rigs: poses by formula, mirrors by symmetry, names and errors by their words."""

import math

import numpy as np
import pytest

from glvis.problem.camera import look_along, mirrored_pose, position_direction_roll
from glvis.problem.expressions import parse_linear
from glvis.problem.layout import Aim, Angles, Free, Mirror, Mount, Ring, Vector
from glvis.problem.mounts import Variable, build_rig

X, Y, Z = np.eye(3)
ORIGIN = (0.0, 0.0, 0.0)
YZ = Mirror("C", ORIGIN, (1, 0, 0))


def text(expression):
    return parse_linear(expression)


def mount(name="A", place=(0.0, 0.0, 500.0), orientation=None, roll=0.0, mirror=None):
    orientation = orientation or Angles(0.0, 0.0)
    return Mount(name, "kinect-v2", place, orientation, roll, mirror)


def pose(one: Mount, x=(), variables=None, up=(0, 0, 1)):
    """Return the poses (S, 4, 4) of a rig of one mount."""
    return build_rig(variables or {}, [one], up).poses(np.asarray(x, dtype=float))


@pytest.mark.parametrize(
    ("axis", "at_0", "at_90", "up_axis"), [("z", X, Y, Z), ("x", Y, Z, X), ("y", Z, X, Y)]
)
def test_ring_angle_turns_from_the_next_axis_to_the_one_after(axis, at_0, at_90, up_axis):
    for angle in (0, 30, 90, 200, -45):
        ring = Ring(axis, 300.0, float(angle), 136.0, (1.0, 2.0, 3.0))
        turn = math.radians(angle)
        expected = [1, 2, 3] + 300 * (math.cos(turn) * at_0 + math.sin(turn) * at_90)
        expected += 136 * up_axis
        found = pose(mount(place=ring))[0, :3, 3]
        np.testing.assert_allclose(found, expected, atol=1e-9)


# Table 7: heights and angles of both rings; Table 8: positions. The paper rounds both.
@pytest.mark.parametrize(
    ("angle", "height", "table_8"),
    [
        ("-alpha", 136, (178, -242, 136)),
        ("beta", 136, (291, 73, 136)),
        ("180 + alpha", 136, (-178, -242, 136)),
        ("180 - beta", 136, (-291, 73, 136)),
        ("-alpha2", -136, (216, -208, -136)),
        ("beta2", -136, (236, 185, -136)),
    ],
)
def test_angles_of_table_7_give_the_positions_of_table_8(angle, height, table_8):
    variables = {"alpha": 54.0, "beta": 14.0, "alpha2": 44.0, "beta2": 38.0}
    one = mount(place=Ring("z", 300.0, text(angle), float(height)))
    found = pose(one, variables=variables)[0, :3, 3]
    np.testing.assert_allclose(found, table_8, atol=2.0)


def test_ring_at_minus_54_degrees_is_where_the_formula_says():
    found = pose(mount(place=Ring("z", 300.0, -54.0, 136.0)))[0, :3, 3]
    expected = [300 * math.cos(math.radians(54)), -300 * math.sin(math.radians(54)), 136]
    np.testing.assert_allclose(found, expected)


def test_azimuth_and_elevation_give_the_optical_axis():
    found = -pose(mount(orientation=Angles(120.0, -30.0)))[0, :3, 2]
    az, el = math.radians(120), math.radians(-30)
    expected = [math.cos(az) * math.cos(el), math.sin(az) * math.cos(el), math.sin(el)]
    np.testing.assert_allclose(found, expected)


def test_direction_of_any_length_is_made_a_unit_vector():
    found = pose(mount(orientation=Vector((-0.82, 0.55, -0.14))))[0]
    length = math.hypot(0.82, 0.55, 0.14)
    np.testing.assert_allclose(-found[:3, 2], np.array([-0.82, 0.55, -0.14]) / length)
    np.testing.assert_allclose(found[:3, :3].T @ found[:3, :3], np.eye(3), atol=1e-12)
    assert np.linalg.det(found[:3, :3]) == pytest.approx(1)


def test_aim_puts_the_point_on_the_optical_axis():
    aimed = mount(place=Ring("y", 200.0, 33.0, -70.0), orientation=Aim((1.0, 2.0, 3.0)), roll=25.0)
    camera = np.linalg.inv(pose(aimed)[0]) @ [1, 2, 3, 1]
    np.testing.assert_allclose(camera[:2], 0, atol=1e-9)
    assert camera[2] < 0


def test_roll_turns_the_image_by_the_right_hand_rule_about_the_axis():
    # looks along +x with z up: right is -y, so a quarter turn about +x takes up (z) to -y
    flat, rolled = pose(mount())[0], pose(mount(roll=90.0))[0]
    np.testing.assert_allclose(flat[:3, :3], np.stack([-Y, Z, -X], axis=1), atol=1e-12)
    np.testing.assert_allclose(rolled[:3, 1], -Y, atol=1e-12)
    np.testing.assert_allclose(rolled[:3, 0], -Z, atol=1e-12)


def test_the_length_of_up_does_not_matter():
    flat = pose(mount(orientation=Angles(30.0, 20.0)), up=(0, 1, 0))
    for length in (1e-90, 7.0, 1e300):
        np.testing.assert_allclose(
            pose(mount(orientation=Angles(30.0, 20.0)), up=(0, length, 0)), flat
        )


def test_up_of_the_study_is_up_in_the_unrolled_image():
    found = pose(mount(orientation=Vector((0.0, 1.0, -2.0))), up=(0, 3, 0))[0]
    assert found[:3, 0] @ Y == pytest.approx(0)
    assert found[:3, 1] @ Y > 0


def test_rows_of_positions_are_poses_of_each_alone():
    mounts = [
        mount("A", Ring("z", Free(200, 400), text("-a"), text("h")), Aim(ORIGIN), Free(-90, 90)),
        mount("B", (Free(0, 9), 1.0, text("h/2")), Angles(text("a"), Free(-80, 80)), mirror=YZ),
        mount("D", (5.0, 6.0, 7.0), Vector((Free(-1, -0.1), 1.0, 0.0)), text("2*A.roll_deg")),
        mount("E", (text("0.3*a + 0.1*h + 0.7*A.roll_deg"), 1.0, 2.0), Aim((0.1, 0.2, 0.3))),
    ]
    rig = build_rig({"a": Free(5, 85), "h": Free(60, 240)}, mounts, (0, 1, 0))
    low, high = rig.bounds.T
    x = low + (high - low) * np.random.default_rng(3).random((500, len(low)))
    together = rig.poses(x)
    assert together.shape == (500, 5, 4, 4)
    # to the last bit: maps are kept by the bits of their pose
    assert np.array_equal(together, [rig.poses(row) for row in x])
    assert np.array_equal(together[::-1][:7], rig.poses(x[::-1][:7]))
    a, h, radius, roll, bx, elevation, dx = x[17]
    turn = np.radians(-a)
    place = np.array([radius * np.cos(turn), radius * np.sin(turn), h])
    expected = look_along(place, -place, np.radians(roll), (0, 1, 0))
    np.testing.assert_allclose(together[17, 0], expected, atol=1e-12)
    az, el = np.radians([a, elevation])
    axis = [np.cos(az) * np.cos(el), np.sin(az) * np.cos(el), np.sin(el)]
    expected = look_along([bx, 1, h / 2], axis, 0.0, (0, 1, 0))
    np.testing.assert_allclose(together[17, 1], expected, atol=1e-12)
    expected = look_along([5, 6, 7], [dx, 1, 0], np.radians(2 * roll), (0, 1, 0))
    np.testing.assert_allclose(together[17, 3], expected, atol=1e-12)


def test_variables_come_in_the_order_of_the_file_and_are_named_by_their_place():
    mounts = [
        mount(
            "K1",
            (Free(0, 3000, 1500), 1200.0, Free(0, 1)),
            Angles(Free(0, 10), Free(0, 20)),
            Free(-5, 5),
        ),
        mount(
            "A1",
            Ring("x", Free(1, 2), Free(0, 9), Free(3, 4), (Free(0, 1), 0.0, 0.0)),
            Aim((0.0, Free(-1, 1), 0.0)),
        ),
        mount("V", ORIGIN, Vector((1.0, 0.0, Free(-1, 1)))),
    ]
    rig = build_rig(
        {"z": Free(0, 2, 0), "a": Free(0, 4)}, [*mounts, mount("M", (text("z+a"), 0, 0))]
    )
    assert [v.name for v in rig.variables] == [
        "z",
        "a",
        "K1.position.x",
        "K1.position.z",
        "K1.direction.azimuth_deg",
        "K1.direction.elevation_deg",
        "K1.roll_deg",
        "A1.ring.centre.x",
        "A1.ring.radius",
        "A1.ring.angle_deg",
        "A1.ring.height",
        "A1.aim.y",
        "V.direction.z",
    ]
    assert rig.variables[0] == Variable("z", 0, 2, 0, False)
    np.testing.assert_array_equal(rig.start[:4], [0, 2, 1500, 0.5])  # the middle, unless given
    np.testing.assert_array_equal(rig.bounds[2], [0, 3000])
    assert rig.sensor_kinds == ("kinect-v2",) * 4
    assert rig.moved_by[:3] == (frozenset(range(2, 7)), frozenset(range(7, 12)), frozenset({12}))
    assert rig.moved_by[3] == {0, 1}


def test_only_the_columns_that_move_a_sensor_change_its_pose():
    mounts = [
        mount("A", Ring("z", 300.0, text("-t"), 5.0), Aim(ORIGIN), Free(-90, 90), YZ),
        mount("B", (Free(0, 9), 1.0, 2.0), Angles(text("t - 20"), 0.0)),
        mount("F"),
    ]
    rig = build_rig({"t": Free(1, 85)}, mounts)
    assert rig.moved_by == ({0, 1}, {0, 1}, {0, 2}, set())
    for column in range(3):
        x = rig.start.copy()
        x[column] += 0.3
        moved = (rig.poses(x) != rig.poses(rig.start)).any(axis=(1, 2))
        assert moved.tolist() == [column in columns for columns in rig.moved_by]


def test_a_rig_without_variables_has_poses_all_the_same():
    rig = build_rig({}, [mount("A"), mount("B", roll=10.0)])
    assert rig.bounds.shape == (0, 2) and rig.start.shape == rig.periodic.shape == (0,)
    assert rig.poses(rig.start).shape == (2, 4, 4)
    assert rig.poses(np.zeros((7, 0))).shape == (7, 2, 4, 4)


@pytest.mark.parametrize(
    ("normal", "up"),
    [((1, 0, 0), Y), ((0, 1, 0), Y), ((0, 0, 2), Y), ((1, 0, 1), Y), ((1, 1, 0), Z)],
)
@pytest.mark.parametrize("seed", range(5))
def test_a_twin_has_reflected_position_and_direction_and_the_opposite_roll(normal, up, seed):
    rng = np.random.default_rng(seed)
    place, axis, point = rng.normal(size=(3, 3))
    roll = rng.uniform(-180, 180)
    mirror = Mirror("C", tuple(point), normal)
    one, twin = pose(mount("A", tuple(place), Vector(tuple(axis)), roll, mirror), up=up)
    n = np.array(normal) / np.linalg.norm(normal)
    reflection = np.eye(3) - 2 * np.outer(n, n)
    expected = look_along(
        reflection @ (place - point) + point, reflection @ axis, -np.radians(roll), up
    )
    np.testing.assert_allclose(twin, expected, atol=1e-12)
    assert np.linalg.det(twin[:3, :3]) == pytest.approx(1)
    # and it sees the mirrored scene mirrored: where up lies in the plane, left and right change
    side = np.array([-1, 1, 1, 1]) if abs(n @ up) < 0.5 else np.array([1, -1, 1, 1])
    seen = np.append(rng.normal(size=3), 1)
    world = one @ seen
    world[:3] = reflection @ (world[:3] - point) + point
    np.testing.assert_allclose(np.linalg.inv(twin) @ world, side * seen, atol=1e-9)


def test_a_twin_over_a_plane_through_up_is_the_mirrored_pose():
    one, twin = pose(mount("A", (9.0, 5.0, 2.0), Angles(100.0, 20.0), 33.0, YZ))
    np.testing.assert_allclose(twin, mirrored_pose(one, ORIGIN, (1, 0, 0)), atol=1e-12)
    _, direction, roll = position_direction_roll(twin)
    assert math.degrees(roll) == pytest.approx(-33)
    np.testing.assert_allclose(direction, one[:3, 2] * [1, -1, -1], atol=1e-12)


def test_a_twin_that_looks_along_up_still_sees_the_mirrored_scene():
    mirror = Mirror("C", ORIGIN, (1, 1, 0))
    one, twin = pose(mount("A", (4.0, 1.0, 9.0), Vector((0.0, 0.0, -1.0)), 20.0, mirror))
    point = np.array([0.3, -0.4, -2.0, 1.0])
    world = one @ point
    world[:2] = -world[1::-1]  # the reflection over x = -y
    np.testing.assert_allclose(np.linalg.inv(twin) @ world, point * [-1, 1, 1, 1], atol=1e-12)


def test_mirrored_sensors_follow_their_mount():
    rig = build_rig(
        {}, [mount("A", mirror=YZ), mount("B"), mount("D", mirror=Mirror("E", (1, 0, 0), Z))]
    )
    assert rig.sensor_names == ("A", "C", "B", "D", "E")
    places = rig.poses([])[:, :3, 3]
    np.testing.assert_allclose(places[[0, 1, 4]], [[0, 0, 500], [0, 0, 500], [0, 0, -500]])


@pytest.mark.parametrize(
    ("place", "periodic"),
    [
        (mount(orientation=Angles(Free(0, 360), 0.0)), True),
        (mount(orientation=Angles(0.0, Free(-180, 180))), True),
        (mount(roll=Free(-180, 180)), True),
        (mount(place=Ring("z", 1.0, Free(0, 720), 0.0)), True),
        (mount(roll=Free(-90, 90)), False),
        (mount(roll=Free(-90, 90, periodic=True)), True),  # half a turn of a rectangle
        (mount(roll=Free(-180, 180, periodic=False)), False),
        (mount(place=(Free(0, 360), 0.0, 0.0)), False),
        (mount(orientation=Aim((Free(0, 360), 0.0, 0.0))), False),
        (mount(orientation=Vector((1.0, Free(-180, 180), 0.0))), False),
    ],
)
def test_angles_over_a_full_turn_are_periodic_unless_told(place, periodic):
    (variable,) = build_rig({}, [place]).variables
    assert variable.periodic is periodic


@pytest.mark.parametrize(
    ("expression", "periodic"), [("turn", True), ("10 - 2*turn", True), ("turn/2", False)]
)
def test_a_named_turn_is_periodic_where_every_use_closes(expression, periodic):
    turning = [mount(roll=text(expression)), mount("B", orientation=Angles(text("turn"), 0.0))]
    rig = build_rig({"turn": Free(0, 360)}, turning)
    assert rig.periodic.tolist() == [periodic]


def test_both_ends_of_a_periodic_variable_are_the_same_pose():
    rig = build_rig(
        {"t": Free(0, 360)}, [mount(place=Ring("z", 5.0, text("-2*t"), 1.0), roll=text("t"))]
    )
    np.testing.assert_allclose(rig.poses([0.0]), rig.poses([360.0]), atol=1e-12)


def test_a_sensor_moved_onto_its_aim_still_has_a_pose():
    rig = build_rig({}, [mount(place=(Free(0, 9), 0.0, 0.0), orientation=Aim(ORIGIN))])
    assert np.isfinite(rig.poses([[0.0], [1.0]])).all()


@pytest.mark.parametrize(
    ("variables", "mounts", "message"),
    [
        ({}, [], "a study needs at least one [[mount]]"),
        ({}, [mount("A"), mount("a")], "two sensors are called 'A'"),
        ({}, [mount("A", mirror=Mirror("A", ORIGIN, X))], "two sensors are called 'A'"),
        ({}, [mount("a/b")], "'a/b' cannot name a sensor: use letters, digits, '_', '-', '+'"),
        ({}, [mount("")], "'' cannot name a sensor"),
        ({}, [mount(".x")], "'.x' cannot name a sensor"),
        ({}, [mount("x ")], "'x ' cannot name a sensor"),
        (
            {"alpha1": Free(0, 1)},
            [mount(roll=text("alpha1")), mount("B", roll=text("2*alpa1"))],
            "B.roll_deg = '2*alpa1': unknown variable 'alpa1'; did you mean 'alpha1'?",
        ),
        ({"a": text("b"), "b": text("a")}, [mount()], "a = 'b' is cyclic: a -> b -> a"),
        ({"a": Free(0, 1)}, [mount()], "the variable 'a' moves no sensor"),
        ({"a": Free(0, 1)}, [mount(roll=text("a - a"))], "the variable 'a' moves no sensor"),
        (
            {"a": Free(0, 90)},  # a ring without a radius
            [mount(place=Ring("z", 0.0, text("a"), 1.0)), mount("B", place=(Free(0, 1), 0.0, 0.0))],
            "the variable 'a' moves no sensor over its range; give a number instead, or a wider",
        ),
        (
            {"a": Free(1, 2)},  # the same direction, longer and longer
            [mount(orientation=Vector((text("a"), text("2*a"), text("-a"))))],
            "the variable 'a' moves no sensor",
        ),
        (
            {"a": Free(1, 2)},  # what is aimed at moves away along the line of sight
            [mount(place=(1.0, 1.0, 1.0), orientation=Aim((text("-a"), text("-a"), text("-a"))))],
            "the variable 'a' moves no sensor",
        ),
        ({"a": Free(3, 3 + 4e-16)}, [mount(place=(text("a"), 0.0, 0.0))], "'a' moves no sensor"),
        ({"a": Free(3, 3 + 1e-9)}, [mount(place=(text("a"), 0.0, 0.0))], "'a' moves no sensor"),
        ({"2a": Free(0, 1)}, [mount()], "'2a' cannot name a variable"),
        (
            {"\N{MICRO SIGN}": 1.0, "\N{GREEK SMALL LETTER MU}": 2.0},
            [mount()],
            "the variable '\N{GREEK SMALL LETTER MU}' is there twice",
        ),
        (
            {"z": Free(0, 360, periodic=True)},
            [mount(place=(0.0, 0.0, text("z")))],
            "the variable 'z' cannot be periodic: A.position.z is no angle",
        ),
        (
            {"t": Free(0, 360, periodic=True)},
            [mount(orientation=Angles(text("t/2"), 0.0))],
            "the variable 't' cannot be periodic: A.direction.azimuth_deg turns 180 degrees",
        ),
        (
            {},
            [mount(mirror=Mirror("C", ORIGIN, (0, 1, 1)))],
            "A.mirror: up must lie in the mirror plane or be normal to it",
        ),
        (
            {},
            [mount(mirror=Mirror("C", ORIGIN, ORIGIN))],
            "a direction needs three numbers",
        ),
        (
            {"r": Free(-10, 10)},
            [mount(place=Ring("z", text("r - 5"), 0.0, 0.0))],
            "A.ring.radius can be -15; it must not be negative",
        ),
        (
            {},
            [mount(orientation=Aim((0.0, 0.0, 500.0)))],
            "A.aim is the sensor's own place at the start",
        ),
        ({}, [mount(orientation=Vector(ORIGIN))], "A.direction is zero at the start"),
        ({}, [mount(orientation=Vector((0.0, 1e-200, 0.0)))], "A.direction is zero at the start"),
        ({}, [mount(roll=1e13)], "A.roll_deg can be as large as 1e+13, more than 1e+12"),
        (
            {"z": Free(-1e308, 1e308)},
            [mount(place=(0.0, 0.0, text("2*z")))],
            "A.position.z can be as large as inf, more than 1e+12",
        ),
    ],
)
def test_rigs_that_cannot_be_built_say_why(variables, mounts, message):
    with pytest.raises(ValueError) as caught:
        build_rig(variables, mounts)
    assert message in str(caught.value)


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ((5, 3), "min = 5 must be less than max = 3"),
        ((3, 3), "min = 3 must be less than max = 3"),
        ((5, 85, 100), "start = 100 must lie in [5, 85]"),
        ((5, 85, 4.9), "start = 4.9 must lie in [5, 85]"),
    ],
)
def test_ranges_that_are_none_are_refused(arguments, message):
    with pytest.raises(ValueError) as caught:
        Free(*arguments)
    assert str(caught.value) == message


@pytest.mark.parametrize(
    ("x", "message"),
    [
        (np.zeros((4, 3)), r"a position must have shape \(P, 1\), got \(4, 3\)"),
        (np.zeros((2, 2, 1)), r"a position must have shape \(P, 1\), got \(2, 2, 1\)"),
        (0.0, r"a position must have shape \(P, 1\), got \(\)"),
        ([np.nan], "a position must be finite"),
    ],
)
def test_positions_of_another_shape_are_refused(x, message):
    rig = build_rig({}, [mount(roll=Free(0, 1))])
    with pytest.raises(ValueError, match=message):
        rig.poses(x)
