"""The judge of lenses and pairs is itself held to OpenCV, to the slow ray caster and to hand."""

import math

import numpy as np
import pytest
from support import kinds, oracle, shapes
from support.judge import Judge
from support.lens_kinds import SENSORS
from support.lens_oracle import Device, LensEye, LensJudge, pose_of
from support.one_sensor import looking, sensor
from support.oracle import Eye
from support.verdicts import AROUND, INSIDE, NEAR, corners_of, poses_about, size_of

ABOVE = np.diag([1.0, 1, 1, 1])  # looks down from the origin, along -z
PINHOLE = LensEye("pinhole", opening=(60, 45))
ALL_AROUND = LensEye("spherical")
COEFFICIENTS = {
    "plumb bob": (-0.35, 0.12, 0.0015, -0.001, 0, 0, 0, 0),
    "five": (-0.2696, 0.1122, 5.0e-5, -0.00152, -0.0116, 0, 0, 0),
    "rational": (4.72474, 3.20922, 1e-3, -2e-3, 0.170596, 5.05586, 4.77578, 0.886494),
}


def random_points(rng, n: int = 10_000, *, before: bool = False) -> np.ndarray:
    points = rng.normal(size=(n, 3)) * 10 ** rng.uniform(-1, 3, size=(n, 1))
    if before:
        points[:, 2] = -np.abs(points[:, 2]) - 1e-3
    return points


# --- the formulas


@pytest.mark.parametrize("name", COEFFICIENTS)
def test_opencv_puts_points_where_this_formula_does(name, rng):
    cv2 = pytest.importorskip("cv2")
    eye = LensEye(
        "opencv", size=(1280, 720), focal=(750, 745), centre=(650.3, 352.1), k=COEFFICIENTS[name]
    )
    points = random_points(rng, before=True)
    matrix = np.array([[750, 0, 650.3], [0, 745, 352.1], [0, 0, 1]])
    theirs, _ = cv2.projectPoints(
        points * [1, -1, -1], np.zeros(3), np.zeros(3), matrix, np.array(COEFFICIENTS[name])
    )
    ours = eye.project(points)
    found = np.isfinite(ours[:, 0])
    assert found.sum() > 3000
    angle = np.arctan2(np.hypot(points[:, 0], points[:, 1]), -points[:, 2])
    np.testing.assert_array_equal(found, angle < eye.end)
    np.testing.assert_allclose(ours[found], theirs[found, 0], rtol=1e-9, atol=1e-6)


def test_opencv_puts_points_before_a_fisheye_where_this_formula_does(rng):
    cv2 = pytest.importorskip("cv2")
    k = (0.02, -0.006, 0.001, -0.0001)
    eye = LensEye("fisheye", size=(1000, 1000), focal=(300, 310), centre=(499, 502), k=k)
    points = random_points(rng, before=True)
    matrix = np.array([[300, 0, 499], [0, 310, 502], [0, 0, 1.0]])
    theirs, _ = cv2.fisheye.projectPoints(
        (points * [1, -1, -1])[:, None], np.zeros(3), np.zeros(3), matrix, np.array(k)
    )
    np.testing.assert_allclose(eye.project(points), theirs[:, 0], rtol=1e-9, atol=1e-6)


def test_a_fisheye_goes_on_behind():
    eye = LensEye("fisheye", size=(9, 9), focal=(100, 200), centre=(4, 5), k=(0.1, 0, 0, 0))
    angle = math.radians(110)
    distorted = angle + 0.1 * angle**3
    point = np.array([[0, math.sin(angle), -math.cos(angle)]]) * 7
    np.testing.assert_allclose(eye.project(point), [[4, 5 - 200 * distorted]], rtol=1e-12)


def test_three_calibrations_of_one_kind_of_camera_are_one_lens():
    # three Azure Kinects: coefficients five times apart; pixels from the centre at 60 degrees
    radii = []
    for focal, *k in (
        (503.8, 4.72474, 3.20922, 0.0, 0.0, 0.170596, 5.05586, 4.77578, 0.886494),
        (503.95, 3.130577, 2.324939, 0.0, 0.0, 0.130416, 3.458652, 3.350115, 0.662942),
        (504.6, 0.921849, 0.500401, 0.0, 0.0, 0.028360, 1.258424, 0.751812, 0.144190),
    ):
        eye = LensEye("opencv", focal=(focal, focal), k=tuple(k))
        ((x, _),) = eye.project(np.array([[math.sqrt(3), 0, -1]]))
        radii.append(x)
        assert eye.end > math.atan(6)  # no fold and no pole before
    np.testing.assert_allclose(radii, [511.1, 511.7, 511.6], atol=0.06)


@pytest.mark.parametrize(
    ("kind", "k", "degrees"),
    [
        # published calibrations and their folds
        ("opencv", (-0.2696, 0.1122, 5e-5, -0.00152, -0.0116, 0, 0, 0), 66.9),
        ("opencv", (-0.05575, 0.06033, -0.00098, -0.00085, -0.01607, 0, 0, 0), 60.5),
        ("opencv", (0.07607, -0.10441, 0.00016, -0.00001, 0, 0, 0, 0), 51.8),
        ("opencv", (-0.02, -0.0025, 0, 0, 0, 0, 0, 0), 69.1),
        ("opencv", (-0.35, 0, 0, 0, 0, 0, 0, 0), math.degrees(math.atan(1 / math.sqrt(1.05)))),
        ("opencv", (-0.255, -0.07, 0, 0, 0.3, 0, 0, 0), 89.99),
        ("fisheye", (0.2439, -0.2522, 0.5028, -0.4013), 59.0),
        ("fisheye", (0.155, -0.155, 0.108, -0.045), 73.9),
        ("fisheye", (0.0, 0.0, 0.0, 0.0), 180),
    ],
)
def test_a_lens_ends_where_it_folds(kind, k, degrees):
    assert math.degrees(LensEye(kind, k=k).end) == pytest.approx(degrees, abs=0.06)


def test_points_beyond_the_fold_are_not_in_the_image_though_the_formula_puts_them_there():
    k = (-0.35, 0, 0, 0, 0, 0, 0, 0)
    eye = LensEye("opencv", size=(1000, 1000), focal=(700, 700), centre=(499.5, 499.5), k=k)
    tangent = np.array([0.9, 1.0, 1.5])  # it folds at 0.976
    assert np.abs(tangent * (1 - 0.35 * tangent**2) * 700).max() < 500
    points = np.stack([tangent, 0 * tangent, -np.ones(3)], axis=1)
    np.testing.assert_array_equal(eye.holds(points), [True, False, False])


@pytest.mark.parametrize("name", SENSORS)
def test_the_products_lenses_are_read_as_they_are(name, rng):
    device, those = Device.of(SENSORS[name]), SENSORS[name]
    points = random_points(rng)
    pairs = [(device.first, those.lens, points)]
    if those.partner:
        np.testing.assert_allclose(
            device.second_to_first, those.partner.partner_to_sensor, atol=1e-15
        )
        pairs.append((device.second, those.partner.lens, points))
    for eye, lens, some in pairs:
        inside = lens.contains(some[:, 0], some[:, 1], -some[:, 2])
        sure = np.abs(eye.margin(some, np.full(len(some), 1e-9))) > 1
        np.testing.assert_array_equal(eye.holds(some)[sure], inside[sure])
        assert sure.mean() > 0.999 and inside.any()
        place = eye.project(some)
        ours = place / 1 if eye.size == (1, 1) else (place + 0.5) / eye.size
        theirs = np.stack(lens.project(some[:, 0], some[:, 1], -some[:, 2]), axis=1)
        np.testing.assert_allclose(ours[inside], theirs[inside], atol=1e-9)


def test_borders_are_left_open_within_a_rounding():
    # 30 degrees to either side: the border of a pinhole, and what is a bit before and beyond
    turn = np.radians(30 + np.array([-1e-3, -1e-5, 1e-5, 1e-3]))
    points = np.stack([np.sin(turn), 0 * turn, -np.cos(turn)], axis=1)
    margin = PINHOLE.margin(points, np.full(4, 1e-6))
    np.testing.assert_array_equal(margin, [2, 0.5, -0.5, -2])
    # nothing ends at the back of a full turn, nor above
    back = np.array([[0.0, 0.0, 1.0], [1e-9, 0, 1], [0, 1, 0], [0, -1, 0]])
    np.testing.assert_array_equal(ALL_AROUND.margin(back, np.full(4, 1e-6)), [2, 2, 2, 2])


# --- against the casters of the plain pinhole


@pytest.mark.parametrize("kind", ["sheet box, wall 1e-3", "lattice", "faces of no area"])
def test_a_pinhole_is_judged_as_before(kind, rng):
    corners = corners_of(kinds.KINDS[kind]())
    far = 3 * size_of(corners)[1]
    eye = Eye(60, 45, max_distance=far, max_incidence_deg=75)
    same = LensEye(
        "opencv",
        size=(600, 450),
        focal=tuple(0.5 * np.array((600, 450)) / eye.tan_half),
        centre=(299.5, 224.5),
        k=(0,) * 8,
    )
    for pose in poses_about(rng, corners, (AROUND, INSIDE, NEAR)):
        old = Judge(pose, eye, corners)
        for lens in (PINHOLE, same):
            device = Device(lens, max_distance=far, max_incidence_deg=75)
            judge = LensJudge(pose, device, corners)
            ours, theirs = judge.centroids(), old.centroids()
            sure = ~(ours.doubtful | theirs.doubtful)
            np.testing.assert_array_equal(ours.free[sure], theirs.free[sure])
            assert np.count_nonzero(~sure) <= 0.02 * len(corners)
            (surely, possibly), (low, high) = judge.shares(3), old.shares(3)
            assert np.all((surely <= high + 1e-9) & (low <= possibly + 1e-9))


@pytest.mark.parametrize("name", ["fisheye 220", "spherical 360 x 180"])
def test_wide_lenses_are_judged_as_the_slow_caster_does(name, rng):
    vertices, faces = kinds.KINDS["lattice"]()
    corners = corners_of((vertices * 100, faces))
    device, total = Device.of(SENSORS[name]), 0
    for pose in poses_about(rng, corners, (AROUND, INSIDE)):
        verdict = LensJudge(pose, device, corners).centroids()
        points, own = corners.mean(axis=1), np.arange(len(corners))
        at = (points - pose[:3, 3]) @ pose[:3, :3]
        far = np.linalg.norm(at, axis=1)
        normal = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
        cosine = np.sum(normal * (pose[:3, 3] - points), axis=1)
        cosine /= np.linalg.norm(normal, axis=1) * far
        passes = device.first.holds(at) & (cosine >= math.cos(math.radians(80)))
        passes &= (far >= device.min_distance) & (far <= device.max_distance)
        hidden = oracle.is_hidden(pose[:3, 3], points, own, corners)
        sure = ~verdict.doubtful
        np.testing.assert_array_equal(verdict.free[sure], (passes & ~hidden)[sure])
        assert np.count_nonzero(~sure) <= 0.02 * len(corners)
        total += np.count_nonzero(verdict.free)
    assert total > 50


# --- against the product's plain pinhole


@pytest.mark.parametrize("made", ["lattice", "torus"])
def test_six_pinholes_of_the_product_see_what_a_sphere_does_and_two_what_a_pair_does(made, rng):
    vertices, faces = kinds.lattice() if made == "lattice" else shapes.torus(0.7, 0.3, 64, 32)
    corners = corners_of((vertices, faces))
    poses = poses_about(rng, corners, (AROUND, INSIDE, NEAR))
    square = sensor(hfov_deg=90, vfov_deg=90, far=10.0, max_incidence_deg=80)
    turns = np.stack([pose_of((0, 0, 0), yaw) for yaw in (0, 90, 180, 270)])
    turns = np.concatenate([turns, [pose_of((0, 0, 0), 0, pitch) for pitch in (90, -90)]])
    there = pose_of((0.3, 0.1, -0.1), 20, -10)
    with looking((vertices, faces), criterion="centroid") as engine:
        six = engine.looks((poses[:, None] @ turns).reshape(-1, 4, 4), square)
        first, second = (engine.looks(one, square) for one in (poses, poses @ there))
    lens = LensEye("pinhole", opening=(90, 90))
    limits = {"max_distance": 10.0, "max_incidence_deg": 80}
    for device, maps in (
        (Device(ALL_AROUND, by_range=True, **limits), six.reshape(3, 6, -1).any(axis=1)),
        (Device(lens, lens, there, **limits), first & second),
    ):
        seen = 0
        for pose, theirs in zip(poses, maps, strict=True):
            verdict = LensJudge(pose, device, corners).centroids()
            sure = ~verdict.doubtful
            np.testing.assert_array_equal(verdict.free[sure], theirs[sure])
            assert np.count_nonzero(~sure) <= 0.05 * len(corners)
            seen += np.count_nonzero(theirs)
        assert seen > 50


# --- by hand


def test_from_inside_a_ball_a_lens_sees_what_it_holds():
    corners = corners_of(shapes.flipped(shapes.icosphere(3, 10.0)))
    centres = corners.mean(axis=1)
    every = LensJudge(ABOVE, Device(ALL_AROUND, by_range=True), corners).centroids()
    assert every.surely.all()
    assert np.all(LensJudge(ABOVE, Device(ALL_AROUND, by_range=True), corners).shares(4)[0] == 1)
    wide = LensEye("fisheye", size=(2000, 2000), focal=(500, 500), k=(0,) * 4, cone=110)
    wide = LensEye("fisheye", wide.opening, size=wide.size, focal=wide.focal,
                   centre=(999.5, 999.5), k=wide.k, cone=110)  # fmt: skip
    seen = LensJudge(ABOVE, Device(wide, by_range=True), corners).centroids()
    angle = np.degrees(np.arccos(-centres[:, 2] / np.linalg.norm(centres, axis=1)))
    np.testing.assert_array_equal(seen.free[~seen.doubtful], (angle < 110)[~seen.doubtful])
    flat = LensEye("spherical", elevation=(-15, 15))
    seen = LensJudge(ABOVE, Device(flat, by_range=True), corners).centroids()
    height = np.degrees(np.arcsin(centres[:, 1] / np.linalg.norm(centres, axis=1)))
    np.testing.assert_array_equal(seen.free[~seen.doubtful], (np.abs(height) < 15)[~seen.doubtful])


def wall(z: float = -2.0) -> np.ndarray:
    return corners_of(shapes.plate(4.0, center=(0, 0, z), cells=(80, 80)))


def test_ranges_count_from_the_centre_or_along_the_axis():
    corners = wall()
    centres = corners.mean(axis=1)
    wide = LensEye("pinhole", opening=(100, 100))
    far = np.linalg.norm(centres, axis=1)
    by_range = LensJudge(ABOVE, Device(wide, max_distance=2.3, by_range=True), corners)
    np.testing.assert_array_equal(by_range.centroids().free, far < 2.3)
    by_depth = LensJudge(ABOVE, Device(wide, max_distance=2.3), corners)
    assert by_depth.centroids().free.all()
    by_range = LensJudge(ABOVE, Device(wide, min_distance=2.3, by_range=True), corners)
    np.testing.assert_array_equal(by_range.centroids().free, far > 2.3)


def with_partner(offset, yaw=0.0, pitch=0.0, **limits) -> Device:
    wide = LensEye("pinhole", opening=(100, 100))
    return Device(wide, wide, pose_of(offset, yaw, pitch), **limits)


def test_a_post_hides_from_each_of_two_viewpoints_another_strip():
    # a post at half the way, 0.1 wide: each sees a shadow 0.2 wide, at 0 and at -0.4 of the wall
    post = corners_of(shapes.plate(0.1, 20.0, center=(0, 0, -1)))
    corners = wall()
    x = corners.mean(axis=1)[:, 0]
    first, second = LensJudge(ABOVE, with_partner((0.4, 0, 0)), corners, post).one_by_one(
        corners.mean(axis=1), np.arange(len(corners))
    )
    np.testing.assert_array_equal(first.free, np.abs(x) > 0.1)
    in_second = np.abs(x - 0.4) < 2 * math.tan(math.radians(50))
    np.testing.assert_array_equal(second.free, (np.abs(x + 0.4) > 0.1) & in_second)
    both = LensJudge(ABOVE, with_partner((0.4, 0, 0)), corners, post).centroids()
    np.testing.assert_array_equal(both.free, first.free & second.free)
    assert not both.doubtful.any()


def test_points_not_faces_are_seen_by_both():
    # two plates let the first see -0.2 < x < 0.8 of a face, the second x < -0.2: no point is common
    face = np.array([[[-1, -1, -2], [1, -1, -2], [-1, 1, -2.0]]])
    left = corners_of(shapes.plate(2.0, 20.0, center=(-1.1, 0, -1)))
    right = corners_of(shapes.plate(2.0, 20.0, center=(1.4, 0, -1)))
    plates, device = np.concatenate([left, right]), with_partner((1.0, 0, 0))
    alone, _ = LensJudge(ABOVE, Device(device.first), face, plates).shares(16)
    other, _ = LensJudge(device.second_to_first, Device(device.first), face, plates).shares(16)
    assert alone[0] > 0.2 and other[0] > 0.3
    surely, possibly = LensJudge(ABOVE, device, face, plates).shares(16)
    assert surely[0] == 0 and possibly[0] < 0.1
    # without the right one the second sees all of it
    both, _ = LensJudge(ABOVE, device, face, left).shares(16)
    one, _ = LensJudge(ABOVE, Device(device.first), face, left).shares(16)
    assert both[0] == one[0] > 0.3


def test_the_partner_has_its_own_image_and_incidence_but_no_range():
    corners = wall()
    x, y = corners.mean(axis=1)[:, :2].T
    narrow = LensEye("pinhole", opening=(20, 30))
    wide = LensEye("pinhole", opening=(100, 100))
    # at right angles to the wall from 0.5 to the right and 0.3 nearer, turned by 15 degrees left
    device = Device(wide, narrow, pose_of((0.5, 0, -0.3), -15))
    seen = LensJudge(ABOVE, device, corners).centroids()
    along = np.degrees(np.arctan2(x - 0.5, 1.7)) + 15
    turned = np.radians(-15)
    depth = 1.7 * math.cos(turned) + (x - 0.5) * math.sin(turned)
    in_second = (np.abs(along) < 10) & (np.abs(y) < depth * math.tan(math.radians(15)))
    np.testing.assert_array_equal(seen.free, in_second)
    # 45 degrees of incidence for each: discs about (0, 0) and (0.5, 0)
    device = Device(wide, wide, pose_of((0.5, 0, -0.3)), max_incidence_deg=45)
    seen = LensJudge(ABOVE, device, corners).centroids()
    discs = (np.hypot(x, y) < 2) & (np.hypot(x - 0.5, y) < 1.7)
    np.testing.assert_array_equal(seen.free[~seen.doubtful], discs[~seen.doubtful])
    # the partner is nearer than min_distance, and that is no matter
    device = Device(wide, wide, pose_of((0.5, 0, -0.3)), min_distance=1.9)
    assert LensJudge(ABOVE, device, corners).centroids().free.any()


def test_backs_hide_from_the_partner_too_and_are_not_seen_by_it():
    corners = wall()
    back = corners_of(shapes.flipped(shapes.plate(0.1, 20.0, center=(0, 0, -1))))
    device = with_partner((0.4, 0, 0))
    for among in (back, back[:, ::-1]):
        seen = LensJudge(ABOVE, device, np.concatenate([corners, among])).centroids()
        alone = LensJudge(ABOVE, device, corners, back).centroids()
        np.testing.assert_array_equal(seen.free[: len(corners)], alone.free)
    # a face that looks at the first and away from the second
    tilted = np.array([[[0.2, -0.1, -1], [0.2, 0.1, -1], [0.21, 0, -2.0]]])
    for corner in (tilted, tilted[:, ::-1]):
        judge = LensJudge(ABOVE, device, corner)
        sees = [one.free[0] for one in judge.one_by_one(corner.mean(axis=1), np.arange(1))]
        assert sum(sees) == 1 and not judge.centroids().free.any()


def test_pixels_count_what_rays_through_them_meet(rng):
    corners, total = corners_of(shapes.torus(100.0, 40.0, 48, 24)), 0
    for name in ("opencv that folds", "fisheye 220", "spherical 360 x 180", "pair 50"):
        device = Device.of(SENSORS[name])
        (pose,) = poses_about(rng, corners, (AROUND,))
        judge = LensJudge(pose, device, corners)
        surely, possibly = judge.pixels((160, 120))
        rays = device.rays((160, 120))
        t, face, _ = oracle.nearest_hits(pose[:3, 3], rays @ pose[:3, :3].T, corners)
        met = np.flatnonzero(face >= 0)
        points = pose[:3, 3] + t[met, None] * (rays[met] @ pose[:3, :3].T)
        seen = judge.look(points, face[met])
        counts = np.bincount(face[met[seen.free]], minlength=len(corners))
        assert np.all((surely <= counts) & (counts <= possibly))
        total += counts.sum()
        assert possibly.sum() - surely.sum() <= 0.02 * len(rays)
    assert total > 300
