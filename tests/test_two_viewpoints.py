"""Sensors with a partner see what both viewpoints see: closed forms on finely cut planes.

All through the public door, ``glvis.visible_faces``. The sensor is at the origin and looks down
-z; its partner lies ``B`` to the right where nothing else is said.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest
from support import shapes
from support.lens_kinds import SENSORS
from support.lens_oracle import LensEye, pose_of
from support.one_sensor import random_poses

import glvis
from glvis.problem.lens import Lens, Pinhole, SphericalLens
from glvis.problem.sensor import Partner, Sensor
from glvis.problem.visibility_options import VisibilityOptions

DOWN = np.eye(4)
WIDE = Pinhole.from_degrees(90, 80)
CRITERIA = ("centroid", "pixels")


def at(x=0.0, y=0.0, z=0.0) -> np.ndarray:
    """Return the pose that looks down from a place."""
    pose = np.eye(4)
    pose[:3, 3] = x, y, z
    return pose


def rolled(pose: np.ndarray) -> np.ndarray:
    """Return a pose turned by 90 degrees about its optical axis: its right is now its up."""
    turn = np.eye(4)
    turn[:2, :2] = [[0, -1], [1, 0]]
    return pose @ turn


def single(lens: Lens = WIDE, **limits) -> Sensor:
    near, far = limits.pop("near", 1.0), limits.pop("far", 5000.0)
    return Sensor("test", lens, (1280, 720), near, far, **limits)


def pair(
    baseline=50.0, lens: Lens = WIDE, turn_deg=(0.0, 0.0), other: Lens | None = None, **limits
):
    """Return a sensor with a partner at an offset, or so far to the right."""
    offset = baseline if isinstance(baseline, tuple) else (baseline, 0.0, 0.0)
    yaw, pitch = map(math.radians, turn_deg)
    return replace(single(lens, **limits), partner=Partner(offset, other or lens, (yaw, pitch)))


def faces_seen(shape, pose, sensor, obstacles=(), criterion="centroid") -> np.ndarray:
    return glvis.visible_faces(shape, pose, sensor, obstacles, VisibilityOptions(criterion))


def assert_seen(
    seen: np.ndarray,
    shape: shapes.Shape,
    is_seen: Callable[[np.ndarray], np.ndarray],
    criterion: str,
) -> None:
    """Hold a map against what is true of points (N, 3) -> (N,).

    By pixels only of faces whose corners and centre are all seen or all not, and beside no other.
    """
    corners = shapes.corners(shape)
    expected = is_seen(corners.mean(axis=1))
    decided = np.ones(len(corners), dtype=bool)
    if criterion == "pixels":
        of_corners = np.stack([is_seen(corners[:, k]) for k in range(3)])
        decided = (of_corners == expected).all(axis=0)
        beside = np.zeros(len(shape[0]), dtype=bool)
        beside[shape[1][~decided]] = True
        decided = ~beside[shape[1]].any(axis=1)
        assert decided.mean() > 0.8
    np.testing.assert_array_equal(seen[decided], expected[decided])
    assert 0 < np.count_nonzero(expected) < len(expected)


def wall(z: float, width=2400.0, height=1600.0, cells=(120, 60)) -> shapes.Shape:
    return shapes.plate(width, height, center=(0, 0, -z), cells=cells)


# --- the band that only one of the two images holds


@pytest.mark.parametrize("criterion", CRITERIA)
@pytest.mark.parametrize(
    ("focal", "baseline", "z", "pixels"),
    [
        # D415 and D435 at 1280 pixels, as worked out from their data sheets
        (940, 55, 160, 323),
        (940, 55, 350, 148),
        (940, 55, 1000, 52),
        (645, 50, 280, 115),
        (645, 50, 500, 64),
    ],
)
def test_the_band_without_depth_is_baseline_times_focal_length_by_depth(
    focal, baseline, z, pixels, criterion
):
    lens = Pinhole.from_tangents(640 / focal, 360 / focal)
    # a wall as wide as the image: a column of faces is 4 pixels wide
    width = 1280 * z / focal
    shape = shapes.plate(width, width / 4, center=(0, 0, -z), cells=(320, 8))
    seen = faces_seen(shape, DOWN, pair(baseline, lens), criterion=criterion)
    one = faces_seen(shape, DOWN, single(lens), criterion=criterion)
    assert one.all()
    x = shapes.corners(shape).mean(axis=1)[:, 0]
    assert seen[x > -width / 2 + 1.02 * baseline].all()  # lost at the left alone
    lost = np.count_nonzero(~seen) / len(seen) * 1280
    assert baseline * focal / z == pytest.approx(pixels, abs=0.7)
    assert lost == pytest.approx(pixels, abs=4)


@pytest.mark.parametrize("criterion", CRITERIA)
@pytest.mark.parametrize("offset", [(90, 0, 0), (-90, 0, 0), (0, 70, 0), (0, -70, 0), (40, 30, 0)])
def test_the_band_lies_on_the_side_away_from_the_partner(offset, criterion):
    z, tangents = 600.0, WIDE.tan_half

    def is_seen(points: np.ndarray) -> np.ndarray:
        in_first = np.abs(points[:, :2]) < z * tangents
        in_second = np.abs(points[:, :2] - offset[:2]) < z * tangents
        return (in_first & in_second).all(axis=1)

    shape = wall(z)
    seen = faces_seen(shape, DOWN, pair(offset), criterion=criterion)
    assert_seen(seen, shape, is_seen, criterion)


@pytest.mark.parametrize("criterion", CRITERIA)
def test_a_projector_with_its_own_field_and_turn_lights_its_own_part(criterion):
    z, projector = 700.0, Pinhole.from_degrees(40, 25)
    offset, turn_deg = (-150.0, 20.0, -10.0), (12.0, -3.0)
    sensor = pair(offset, turn_deg=turn_deg, other=projector)
    beam, pose = LensEye("pinhole", opening=(40, 25)), pose_of(offset, *turn_deg)

    def is_seen(points: np.ndarray) -> np.ndarray:
        in_first = (np.abs(points[:, :2]) < z * WIDE.tan_half).all(axis=1)
        return in_first & beam.holds((points - pose[:3, 3]) @ pose[:3, :3])

    shape = wall(z)
    seen = faces_seen(shape, DOWN, sensor, criterion=criterion)
    assert_seen(seen, shape, is_seen, criterion)
    # along its middle row it reaches from 8 degrees left to 32 degrees right of its centre
    far = z - 10
    middle = 20 - far * math.tan(math.radians(3)) / math.cos(math.radians(12))
    x, y, _ = shapes.corners(shape).mean(axis=1)[seen].T
    row = x[np.abs(y - middle) < 15]
    ends = [-150 + far * math.tan(math.radians(degrees)) for degrees in (12 - 20, 12 + 20)]
    np.testing.assert_allclose([row.min(), row.max()], ends, atol=15)


# --- what hides


SLOT = {"width": 40.0, "depth": 100.0, "length": 300.0, "z": 500.0}  # z: to its floor


def slot(cells=(100, 20)) -> tuple[shapes.Shape, list[shapes.Shape]]:
    """Return the floor of a slot along y, and its sides with the plane that it is cut into."""
    w, h, length, z = SLOT.values()
    floor = shapes.plate(w, length, center=(0, 0, -z), cells=cells)
    sides = []
    for side in (-1, 1):
        x = side * w / 2
        top = shapes.plate(400, 2000, center=(x + side * 200, 0, h - z))
        corners = [(x, -1000, -z), (x, 1000, -z), (x, 1000, h - z), (x, -1000, h - z)]
        sides += [top, (np.array(corners), np.array([[0, 1, 2], [0, 2, 3]]))]
    return floor, sides


@pytest.mark.parametrize("criterion", CRITERIA)
@pytest.mark.parametrize("baseline", [50.0, 90.0, 120.0])
def test_both_see_of_the_floor_of_a_slot_what_lies_between_their_sights(baseline, criterion):
    w, h, _, z = SLOT.values()
    floor, sides = slot()
    seen = faces_seen(floor, at(-baseline / 2), pair(baseline), sides, criterion)
    # what the tops' edges hide from each: (w z - B h) / (z - h), which is w - 2 h tan(gamma / 2)
    # as both sights have it at the top, gamma the angle between them
    half_gamma = math.atan(baseline / (2 * z))
    width = (w - 2 * h * math.tan(half_gamma)) * z / (z - h)

    def is_seen(points: np.ndarray) -> np.ndarray:
        return np.abs(points[:, 0]) < width / 2

    assert_seen(seen, floor, is_seen, criterion)
    assert width == pytest.approx(w - 2 * h * math.tan(half_gamma), rel=0.26)
    assert np.mean(seen) * w == pytest.approx(width, abs=2 * w / 100)


@pytest.mark.parametrize("criterion", CRITERIA)
def test_a_slot_along_the_baseline_loses_nothing_and_a_turn_decides(criterion):
    w, h, _, z = SLOT.values()
    baseline = 1.01 * w * z / h  # across, nothing of the floor is common to both
    floor, sides = slot()
    sensor = pair(baseline)
    across = faces_seen(floor, at(-baseline / 2), sensor, sides, criterion)
    along = faces_seen(floor, rolled(at(0, -baseline / 2)), sensor, sides, criterion)
    assert along.all() and not across.any()
    # of the views alone, each sees some of the floor
    for x in (-baseline / 2, baseline / 2):
        assert faces_seen(floor, at(x), single(), sides, criterion).any()


@pytest.mark.parametrize("criterion", CRITERIA)
def test_a_wide_post_has_a_shadow_of_baseline_times_the_gap_by_its_depth(criterion):
    baseline, far, near, half = 80.0, 600.0, 400.0, 60.0
    post = shapes.plate(2 * half, 3000, center=(0, 0, -near))
    shape = wall(far, 900.0, 400.0, (300, 20))
    seen = faces_seen(shape, DOWN, pair(baseline), [post], criterion)
    one = faces_seen(shape, DOWN, single(), [post], criterion)
    edge = half * far / near
    shadow = baseline * (far - near) / near

    def is_seen(points: np.ndarray) -> np.ndarray:  # the partner's shadow falls to the left
        x = points[:, 0]
        inside = x > baseline - far
        return inside & ((x < -edge - shadow) | (x > edge))

    assert_seen(seen, shape, is_seen, criterion)
    x = shapes.corners(shape).mean(axis=1)[one & ~seen, 0]
    assert len(x) / len(seen) * 900 == pytest.approx(shadow, abs=2 * 3)
    assert x.min() > -edge - shadow - 3 and x.max() < -edge + 3


@pytest.mark.parametrize("criterion", CRITERIA)
def test_a_thin_post_has_two_shadows(criterion):
    baseline, far, near, half = 80.0, 600.0, 400.0, 6.2
    post = shapes.plate(2 * half, 3000, center=(0, 0, -near))
    shape = wall(far, 900.0, 400.0, (300, 20))
    seen = faces_seen(shape, DOWN, pair(baseline), [post], criterion)
    each, apart = half * far / near, baseline * (far - near) / near

    def is_seen(points: np.ndarray) -> np.ndarray:
        x = points[:, 0]
        return (x > baseline - far) & (np.abs(x) > each) & (np.abs(x + apart) > each)

    assert_seen(seen, shape, is_seen, criterion)


@pytest.mark.parametrize("criterion", CRITERIA)
def test_a_step_hides_its_foot_from_the_partner_alone(criterion):
    # a step up to the right of x = 0; the sensor is left of it, its partner right: the sensor sees
    # the lower floor up to the step, the partner nothing of a strip before it
    baseline, far, near = 100.0, 600.0, 450.0
    step = shapes.plate(600, 3000, center=(300, 0, -near))
    shape = wall(far, 600.0, 400.0, (200, 20))
    pose = at(-baseline / 2)
    seen = faces_seen(shape, pose, pair(baseline), [step], criterion)
    shadow = baseline / 2 * (far - near) / near

    def is_seen(points: np.ndarray) -> np.ndarray:
        return points[:, 0] < -shadow

    assert_seen(seen, shape, is_seen, criterion)


@pytest.mark.parametrize("criterion", CRITERIA)
def test_what_refuses_to_be_seen_hides_from_the_partner_as_well(criterion):
    # a plate of the model that shows its back to the partner's sight, nearer than minD
    baseline, far, near, half = 80.0, 600.0, 100.0, 10.1
    back = shapes.flipped(shapes.plate(2 * half, 3000, center=(baseline, 0, -near)))
    flat = wall(far, 900.0, 400.0, (300, 20))
    sensor = pair(baseline, near=300.0)
    seen = faces_seen(shapes.merged(flat, back), DOWN, sensor, criterion=criterion)
    n = len(flat[1])
    edges = [(baseline + side * half) * far / near for side in (-1, 1)]  # from the sensor
    assert edges[0] > 400  # the sensor sees the wall past the plate nearly everywhere

    def is_seen(points: np.ndarray) -> np.ndarray:
        x = points[:, 0]
        first = (x < edges[0]) | (x > edges[1])
        return first & (x > baseline - far) & (np.abs(x - baseline) > half * far / near)

    assert not seen[n:].any()
    assert_seen(seen[:n], flat, is_seen, criterion)


@pytest.mark.parametrize("criterion", CRITERIA)
def test_each_has_its_incidence_and_the_first_alone_its_range(criterion):
    far, baseline, limit = 300.0, 150.0, math.radians(40)
    lens = Pinhole.from_degrees(120, 120)
    shape = wall(far, 1200.0, 1000.0, (160, 120))

    def is_seen(points: np.ndarray) -> np.ndarray:
        reach = far * math.tan(limit)
        first = np.hypot(points[:, 0], points[:, 1]) < reach
        return first & (np.hypot(points[:, 0] - baseline, points[:, 1]) < reach)

    sensor = pair(baseline, lens, max_incidence=limit)
    assert_seen(faces_seen(shape, DOWN, sensor, criterion=criterion), shape, is_seen, criterion)

    # the partner is 200 nearer, within minD and without any of its own
    def is_within(points: np.ndarray) -> np.ndarray:
        inside = np.abs(points[:, :2]) < 100 * lens.tan_half
        return inside.all(axis=1)

    sensor = pair((0, 0, -200), lens, near=250.0, far=350.0)
    assert_seen(faces_seen(shape, DOWN, sensor, criterion=criterion), shape, is_within, criterion)

    # by range: a disc about the first
    def is_near(points: np.ndarray) -> np.ndarray:
        return np.linalg.norm(points, axis=1) < 400

    sensor = pair(20.0, lens, far=400.0, distance="range")
    assert_seen(faces_seen(shape, DOWN, sensor, criterion=criterion), shape, is_near, criterion)


# --- the two and the one


@pytest.mark.parametrize(
    "options",
    [
        VisibilityOptions("centroid"),
        VisibilityOptions("pixels"),
        VisibilityOptions("pixels", resolution=(320, 240)),
        VisibilityOptions("pixels", min_pixels=3, resolution="sensor"),
    ],
    ids=["centroid", "pixels", "320 x 240", "3 pixels"],
)
@pytest.mark.parametrize(
    "lens", ["opencv", "fisheye 220", "spherical 360 x 180", "pinhole by range", "plain"]
)
def test_a_partner_at_the_same_place_changes_no_bit(lens, options, rng):
    one = single(Pinhole.from_degrees(60, 45)) if lens == "plain" else SENSORS[lens]
    body = shapes.blob(rng, 4, 100.0)
    poses = random_poses(rng, 4, 260.0)
    obstacle = shapes.moved(shapes.blob(rng, 2, 30.0), (0, 0, 120))
    both = replace(one, partner=Partner((0.0, 0.0, 0.0), one.lens))
    alone = glvis.visible_faces(body, poses, one, [obstacle], options)
    assert alone.any(axis=1).all()
    np.testing.assert_array_equal(
        glvis.visible_faces(body, poses, both, [obstacle], options), alone
    )


def exchanged(sensor: Sensor, poses: np.ndarray) -> tuple[Sensor, np.ndarray]:
    """Return the sensor put where its partner was, with the partner where the sensor was.

    For turns to the right or left alone.
    """
    partner = sensor.partner
    yaw, pitch = partner.turn
    assert pitch == 0
    there = pose_of(partner.offset, math.degrees(yaw))
    back = -there[:3, :3].T @ there[:3, 3]
    swapped = Partner(tuple(back.tolist()), sensor.lens, (-yaw, 0.0))
    return replace(sensor, lens=partner.lens, partner=swapped), poses @ there


@pytest.mark.parametrize("criterion", CRITERIA)
@pytest.mark.parametrize(
    "sensor",
    [
        pair(60.0),
        pair((40.0, -30.0, 0.0), max_incidence=math.radians(70)),
        pair((150.0, 0.0, 10.0), turn_deg=(-25.0, 0.0), other=Pinhole.from_degrees(50, 40)),
        pair(80.0, SphericalLens(2 * math.pi, (-1.0, 1.0)), distance="range"),
        pair(80.0, SENSORS["fisheye 180"].lens, other=SENSORS["opencv"].lens),
    ],
    ids=["plain", "aslant", "convergent", "spherical", "two lenses"],
)
def test_exchanged_viewpoints_see_the_same_faces(sensor, criterion, rng):
    body = shapes.blob(rng, 4, 100.0)
    poses = random_poses(rng, 6, 260.0)
    obstacle = shapes.moved(shapes.blob(rng, 2, 30.0), (0, 0, 120))
    seen = faces_seen(body, poses, sensor, [obstacle], criterion)
    again = faces_seen(body, exchanged(sensor, poses)[1], exchanged(sensor, poses)[0], [obstacle],
                       criterion)  # fmt: skip
    alone = faces_seen(body, poses, replace(sensor, partner=None), [obstacle], criterion)
    assert seen.sum() > 1000 and (seen <= alone).all() and (seen < alone).any()
    # rounding may decide on a face at an edge; and "pixels" are those of the first's image: of a
    # face that is large in the one and small in the other, more points are asked there
    most = 1e-3 if criterion == "centroid" else 1e-2
    assert np.count_nonzero(seen != again) <= most * np.count_nonzero(seen)


@pytest.mark.parametrize("criterion", CRITERIA)
def test_both_see_no_more_than_each_does(criterion, rng):
    body = shapes.torus(100.0, 40.0, 64, 32)
    poses = random_poses(rng, 6, 260.0)
    sensor = pair((90.0, 20.0, -15.0), turn_deg=(-15.0, 4.0), max_incidence=math.radians(75))
    there = poses @ pose_of(sensor.partner.offset, -15.0, 4.0)
    both = faces_seen(body, poses, sensor, criterion=criterion)
    first, second = (
        faces_seen(body, one, replace(sensor, partner=None), criterion=criterion)
        for one in (poses, there)
    )
    assert (both <= first).all() and both.any()
    # of a face that is small in the second's own image it is asked for the centre alone
    most = 0 if criterion == "centroid" else 1e-3 * np.count_nonzero(both)
    assert np.count_nonzero(both & ~second) <= most
    if criterion == "centroid":  # of points seen by both is nothing else to say
        differs = both != (first & second)  # rounding may decide on a face at an edge
        assert np.count_nonzero(differs) <= 1e-3 * np.count_nonzero(both)


@pytest.mark.parametrize("criterion", CRITERIA)
def test_a_partner_that_looks_away_sees_nothing(criterion):
    shape = wall(600.0)
    for turn_deg in ((180.0, 0.0), (-180.0, 0.0), (0.0, 180.0), (140.0, 0.0)):
        sensor = pair(50.0, turn_deg=turn_deg)
        assert not faces_seen(shape, DOWN, sensor, criterion=criterion).any()
    # and one that stands behind the wall sees its back, or nothing of it
    assert not faces_seen(shape, DOWN, pair((0, 0, -700.0)), criterion=criterion).any()
    behind = pair((0, 0, -1200.0), turn_deg=(180.0, 0.0))
    assert not faces_seen(shape, DOWN, behind, criterion=criterion).any()
    assert faces_seen(shape, DOWN, single(), criterion=criterion).any()
