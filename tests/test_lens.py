"""Lenses: closed forms, OpenCV's own projection, published calibrations, and where a lens ends."""

import math

import cv2
import numpy as np
import pytest

from glvis.problem.calibrated_lens import CalibratedLens, FisheyeLens, OpenCVLens
from glvis.problem.lens import Lens, Pinhole, SphericalLens

HD = (1920, 1080)


def opencv(size, focal, bent, centre=None, **more) -> OpenCVLens:
    """Return OpenCV's lens, its centre in the middle without another."""
    return OpenCVLens(size, pair(focal), centre or middle(size), tuple(bent), **more)


def fisheye(size, focal, bent=(), centre=None, **more) -> FisheyeLens:
    return FisheyeLens(size, pair(focal), centre or middle(size), tuple(bent), **more)


def middle(size):
    return (size[0] - 1) / 2, (size[1] - 1) / 2


def pair(focal):
    return focal if isinstance(focal, tuple) else (focal, focal)


# Published calibrations, from makers' units and projects: the lens; its true opening angles, with
# the distortion undone, across, up and over the diagonal (None: some pixels have no ray); tangent
# and angle of the first fold (None: there is none) and its image, in focal lengths.
CALIBRATIONS = {
    "GoPro Hero 4, 720 narrow": (
        opencv((692, 487), 585.5, (-0.2696, 0.1122, 5e-5, -0.00152, -0.0116), (345.9, 243.4)),
        (66.3, 47.2, 80.0), (2.35, 66.9, 2.30),
    ),
    "GoPro Hero 4, 1080 narrow": (
        opencv(HD, 1780, (-0.255, -0.07, 0, 0, 0.3)), (61.0, 34.6, 69.3), None,
    ),
    "USB camera, wide": (
        opencv((800, 600), 538.6, (-0.3068, 0.0825, 0.0029, -0.00016, 0)),
        (86.1, 63.9, 104.6), None,
    ),
    "RealSense D455, colour": (
        opencv(
            (1280, 800), 629.8, (-0.05575, 0.06033, -0.00098, -0.00085, -0.01607), (629.0, 397.0)
        ),
        (91.5, 65.6, 100.5), (1.77, 60.5, 1.63),
    ),
    "RealSense L515, colour": (
        opencv(
            (1280, 720), (904.2, 905.2), (0.18009, -0.53418, -0.00139, 0.00012, 0.47066),
            (643.7, 357.8),
        ),
        (69.8, 42.8, 77.1), None,
    ),
    "Kinect v2, infrared": (
        opencv((512, 424), 365.46, (0.09055, -0.26819, 0, 0, 0.09509), (254.88, 205.40)),
        (70.6, 60.0, 89.2), None,
    ),
    "Zivid One": (
        opencv(
            (1920, 1200), 2760, (-0.27315, 0.35438, -0.00034, 0.0002, -0.32252), (951.7, 594.8)
        ),
        (39.5, 24.8, 46.3), (0.957, 43.7, 0.765),
    ),
    "Femto Bolt, colour": (
        opencv(HD, 1124.4, (0.07607, -0.10441, 0.00016, -0.00001, 0)),
        (81.0, 50.8, 90.6), (1.27, 51.8, 1.08),
    ),
    "webcam": (
        opencv((640, 480), 580, (0.134, -0.312, 0, 0)), (57.2, 44.4, 69.6), (0.97, 44.1, 0.82),
    ),
    "surveillance camera, wide": (
        opencv(HD, 533.6, (-0.02, -0.0025, 0, 0)), (128.5, 92.1, None), (2.62, 69.1, 1.95),
    ),
    "fisheye A": (
        fisheye(HD, 1099.5, (0.2439, -0.2522, 0.5028, -0.4013)),
        (89.8, 53.8, 101.9), (None, 59.0, 1.10),
    ),
    "fisheye B": (
        fisheye((640, 480), 349.5, (-0.0534, 0.0193, -0.0760, 0.0669)),
        (109.8, 80.9, 132.0), None,
    ),
    "fisheye C": (
        fisheye((464, 400), 138.1, (0.155, -0.155, 0.108, -0.045)),
        (None, None, None), (None, 73.9, 1.27),
    ),
}  # fmt: skip
RATIONAL = {
    "Azure Kinect A": (503.8, (4.72474, 3.20922, 0.170596), (5.05586, 4.77578, 0.886494)),
    "Azure Kinect B": (503.95, (3.130577, 2.324939, 0.130416), (3.458652, 3.350115, 0.662942)),
    "Azure Kinect C": (504.6, (0.921849, 0.500401, 0.028360), (1.258424, 0.751812, 0.144190)),
}


def azure(name, size=(1024, 1024), **more) -> OpenCVLens:
    focal, (k1, k2, k3), (k4, k5, k6) = RATIONAL[name]
    return opencv(size, focal, (k1, k2, 0, 0, k3, k4, k5, k6), **more)


BENT: dict[str, Lens] = {name: lens for name, (lens, *_) in CALIBRATIONS.items()}
BENT |= {name: azure(name) for name in RATIONAL}
BENT |= {
    "k1 = -0.35 and tangential": opencv(HD, (1300, 1290), (-0.35, 0.12, 0.002, -0.003, 0.01)),
    "barrel off its centre": opencv((640, 480), 300, (-0.2, 0.03, 0, 0), (250.3, 260.9)),
    "pole": opencv(HD, 900, (0.3, 0.1, 0, 0, 0, -0.2, 0, 0)),
    "fisheye of 180 degrees": fisheye((1000, 1000), 318.3, (0.01, -0.004, 0.0005, 0)),
    "fisheye of 220 degrees": fisheye((1000, 1000), 260.4, centre=(480.2, 511.7)),
}
IDEAL: dict[str, Lens] = {
    "pinhole": Pinhole.from_degrees(66.4, 39.5),
    "wide pinhole": Pinhole.from_degrees(140, 100),
    "lidar": SphericalLens(2 * math.pi, (math.radians(-15), math.radians(15))),
    "half a turn": SphericalLens(math.pi, (math.radians(-40), math.radians(5))),
    "all around": SphericalLens(2 * math.pi, (-math.pi / 2, math.pi / 2)),
    "cone of a pinhole": opencv((640, 480), 300, (), max_angle=math.radians(40)),
    "cone of Azure Kinect": azure("Azure Kinect A", max_angle=math.radians(60)),
    "fisheye whose corners are just behind": fisheye(HD, 479.6),
    "round fisheye": fisheye((1000, 1000), 300, max_angle=math.radians(85)),
}
LENSES = BENT | IDEAL


def on_sphere(n: int, seed: int = 0):
    """Return random unit directions: x, y up and depth, each (n,)."""
    found = np.random.default_rng(seed).normal(size=(3, n))
    return found / np.linalg.norm(found, axis=0)


def angle_of(direction) -> float:
    """Return angles to the optical axis, degrees."""
    return np.degrees(np.arctan2(np.hypot(direction[0], direction[1]), direction[2]))


# --- against OpenCV


@pytest.mark.parametrize("name", BENT)
def test_points_fall_where_opencv_puts_them_or_nowhere_beyond_the_fold(name):
    lens = BENT[name]
    assert isinstance(lens, CalibratedLens)
    rng = np.random.default_rng(1)
    # 10,000 all over the hemisphere, evenly in the angle, at any distance
    theta, turn = rng.uniform(0, math.radians(89), 10_000), rng.uniform(0, 2 * math.pi, 10_000)
    away = rng.uniform(0.1, 100, 10_000)
    x, y, depth = away * [
        np.sin(theta) * np.cos(turn), np.sin(theta) * np.sin(turn), np.cos(theta)
    ]  # fmt: skip
    u, v = lens.project(x, y, depth)
    has_image = np.isfinite(u)
    assert (has_image == (theta < lens.end)).all()
    assert has_image.sum() > 4000
    assert not lens.contains(x, y, depth)[theta >= lens.end].any()
    (fx, fy), (cx, cy) = lens.focal_px, lens.centre_px
    matrix = np.array([[fx, 0, cx], [0, fy, cy], [0, 0, 1.0]])
    project = cv2.fisheye.projectPoints if isinstance(lens, FisheyeLens) else cv2.projectPoints
    points = np.stack([x, -y, depth], axis=1)[:, None]
    bent = np.array(lens.coefficients)
    theirs = project(points, np.zeros(3), np.zeros(3), matrix, bent)[0].reshape(-1, 2)
    ours = np.stack([u * lens.size[0] - 0.5, v * lens.size[1] - 0.5], axis=1)
    off = np.linalg.norm(ours - theirs, axis=1)[has_image]
    far = np.linalg.norm(theirs, axis=1)[has_image]
    # within 0.001 px, and of pixels thousands of images away within rounding
    assert (off < 1e-3 + 1e-9 * far).all()


def test_a_fisheye_goes_on_beside_and_behind_the_camera_by_its_formula():
    lens = BENT["fisheye of 180 degrees"]
    k1, k2, k3, k4 = lens.coefficients
    for theta in np.radians([0, 30, 89.9, 90, 95, 120, 160]):
        radius = theta * (1 + k1 * theta**2 + k2 * theta**4 + k3 * theta**6 + k4 * theta**8)
        u, v = lens.project(math.sin(theta), 0, math.cos(theta))
        assert u * 1000 - 0.5 == pytest.approx(499.5 + 318.3 * radius)
        assert v * 1000 - 0.5 == pytest.approx(499.5)
        _, v = lens.project(0, math.sin(theta), math.cos(theta))
        assert v * 1000 - 0.5 == pytest.approx(499.5 - 318.3 * radius)  # up is towards row 0


# --- published calibrations


@pytest.mark.parametrize("name", CALIBRATIONS)
def test_published_lenses_fold_where_they_do(name):
    lens, _, fold = CALIBRATIONS[name]
    if fold is None:
        assert lens.fold == math.inf
        return
    tangent, degrees, image = fold
    assert math.degrees(lens.end) == pytest.approx(degrees, abs=0.1)
    if tangent is not None:
        assert lens.fold == pytest.approx(tangent, abs=0.006)
    # just before it an image, just beyond it none
    before, beyond = lens.end * (1 - 1e-9), lens.end * (1 + 1e-9)
    bare = type(lens)(
        lens.size, lens.focal_px, lens.centre_px,
        tuple(0.0 if i in (2, 3) and isinstance(lens, OpenCVLens) else k
              for i, k in enumerate(lens.coefficients)),
    )  # fmt: skip
    u, _ = bare.project(math.sin(before), 0, math.cos(before))
    radius = (u * lens.size[0] - 0.5 - lens.centre_px[0]) / lens.focal_px[0]
    assert radius == pytest.approx(image, abs=0.006)
    assert np.isnan(lens.project(math.sin(beyond), 0, math.cos(beyond))).all()


@pytest.mark.parametrize("name", CALIBRATIONS)
def test_published_lenses_see_as_wide_as_they_do(name):
    lens, true, _ = CALIBRATIONS[name]
    across, up, diagonal = true
    # along the row and the column of the optical axis, from border to border
    x, y = (lens.centre_px[0] + 0.5) / lens.size[0], (lens.centre_px[1] + 0.5) / lens.size[1]
    left, right = (angle_of(lens.directions(u, y)) for u in (0.0, 1.0))
    top, bottom = (angle_of(lens.directions(x, v)) for v in (0.0, 1.0))
    corners = angle_of(lens.directions([0, 1, 0, 1], [0, 1, 1, 0]))
    for found, expected in (
        (left + right, across), (top + bottom, up), (corners.sum() / 2, diagonal),
    ):  # fmt: skip
        if expected is None:
            assert np.isnan(found)
        else:
            assert found == pytest.approx(expected, abs=0.12)
    assert lens.has_blind_corners == (diagonal is None)


def test_three_calibrations_of_azure_kinects_are_one_lens():
    edge = math.radians(60)
    radii = []
    for name in RATIONAL:
        lens = azure(name)
        u, _ = lens.project(math.sin(edge), 0, math.cos(edge))
        radii.append(u * 1024 - 0.5 - 511.5)
        assert lens.fold > 6
        narrow = [math.degrees(angle) for angle in azure(name, (640, 576)).opening]
        assert narrow == pytest.approx([73.15, 65.75], abs=0.1)
        assert math.degrees(lens.opening[0]) == pytest.approx(120.15, abs=0.1)
    assert radii == pytest.approx([511.1, 511.7, 511.6], abs=0.06)
    assert np.ptp(radii) < 0.65
    inner = np.radians(np.linspace(0, 60, 100))
    rings = [azure(name).project(np.sin(inner), 0 * inner, np.cos(inner))[0] for name in RATIONAL]
    assert 1024 * np.ptp(rings, axis=0).max() < 0.7


# --- there and back


@pytest.mark.parametrize("name", LENSES)
def test_directions_and_places_lead_to_each_other(name):
    lens = LENSES[name]
    u, v = np.random.default_rng(2).uniform(0, 1, (2, 3000))
    x, y, depth = found = lens.directions(u, v)
    has_ray = np.isfinite(x)
    assert has_ray.all() or lens.has_blind_corners
    np.testing.assert_allclose(np.linalg.norm(found[:, has_ray], axis=0), 1, atol=1e-12)
    back = lens.project(x[has_ray], y[has_ray], depth[has_ray])
    np.testing.assert_allclose(back, [u[has_ray], v[has_ray]], atol=1e-9)
    # and from directions: what is in the image comes back, and every one of them has a ray
    x, y, depth = directions = on_sphere(20_000, 3)
    seen = lens.contains(x, y, depth)
    assert seen.any()
    u, v = lens.project(x[seen], y[seen], depth[seen])
    back = lens.directions(u, v)
    away = np.arccos(np.clip(np.einsum("in,in->n", back, directions[:, seen]), -1, 1))
    assert np.quantile(away, 0.99) < 1e-6
    assert np.nanmax(away) < 1e-3  # beside a fold or a pole places are few for many directions


@pytest.mark.parametrize("name", LENSES)
def test_shapes_of_directions_are_kept(name):
    lens = LENSES[name]
    u = np.full((2, 3), 0.5)
    assert lens.directions(u, 0.4).shape == (3, 2, 3)
    x, y, depth = lens.directions(u, u)
    assert lens.project(x, y, depth)[0].shape == (2, 3)
    assert lens.contains(x, y, depth).all()
    assert lens.image_a_steradian(x, y, depth).shape == (2, 3)


# --- windows


@pytest.mark.parametrize("name", LENSES)
def test_windows_hold_every_direction_of_the_image(name):
    lens = LENSES[name]
    windows = lens.windows
    u, v = np.random.default_rng(4).uniform(0, 1, (2, 4000))
    edge = np.linspace(0, 1, 997)
    u = np.concatenate([u, edge, edge, 0 * edge, 0 * edge + 1])
    v = np.concatenate([v, 0 * edge, 0 * edge + 1, edge, edge])
    found = lens.directions(u, v)
    found = np.concatenate([found[:, np.isfinite(found[0])], on_sphere(20_000, 5)], axis=1)
    found = found[:, lens.contains(*found)]
    is_held = np.zeros(found.shape[1], dtype=bool)
    for window_to_camera in windows.window_to_camera:
        np.testing.assert_allclose(window_to_camera @ window_to_camera.T, np.eye(3), atol=1e-12)
        assert np.linalg.det(window_to_camera) == pytest.approx(1)
        right, up, back = window_to_camera.T @ [found[0], found[1], -found[2]]
        tan_x, tan_y = windows.tan_half
        is_held |= (np.abs(right) <= -tan_x * back) & (np.abs(up) <= -tan_y * back)
    assert is_held.all()
    assert np.degrees(np.arctan(windows.tan_half)).max() <= 75.1 or name == "all around"


def test_an_image_between_the_samples_of_a_window_has_one():
    far = opencv((100, 100), 5000, (), (60_000.0, 200.0))  # 1.1 degrees, 85 from the axis
    directions = far.directions(*np.random.default_rng(0).uniform(0, 1, (2, 99)))
    right, up, back = np.einsum(
        "kab,an->bkn", far.windows.window_to_camera, directions * [[1], [1], [-1]]
    )
    tan_x, tan_y = far.windows.tan_half
    assert ((np.abs(right) <= -tan_x * back) & (np.abs(up) <= -tan_y * back)).any(axis=0).all()


def test_a_lens_has_few_windows():
    counts = {name: len(lens.windows) for name, lens in LENSES.items()}
    assert counts["pinhole"] == counts["k1 = -0.35 and tangential"] == 1
    assert counts["lidar"] == 4
    assert counts["half a turn"] == 2
    assert counts["all around"] == 6
    assert counts["round fisheye"] == 5
    assert counts["fisheye of 180 degrees"] == 6  # over its diagonal it has 254
    assert LENSES["pinhole"].windows.is_straight
    assert not LENSES["lidar"].windows.is_straight


# --- the size of a pixel


def test_a_pinholes_pixels_a_steradian_are_those_of_the_closed_form():
    lens = Pinhole.from_degrees(90, 60)
    u, v = np.random.default_rng(6).uniform(0, 1, (2, 500))
    x, y, depth = lens.directions(u, v)
    tan_x, tan_y = lens.tan_half
    # a steradian is 1 / depth^3 of the plane at depth 1, which holds 4 tan tan of the image
    expected = 1 / (4 * tan_x * tan_y * depth**3)
    np.testing.assert_allclose(lens.image_a_steradian(x, y, depth), expected, rtol=1e-6)
    away = 7.3  # of any length
    found = lens.image_a_steradian(away * x, away * y, away * depth)
    np.testing.assert_allclose(found, expected, rtol=1e-6)


def test_an_equidistant_fisheyes_pixels_a_steradian_are_those_of_the_closed_form():
    lens = fisheye((1000, 800), (300, 280))
    theta = np.radians([1e-3, 10, 45, 89, 91, 120])
    turn = np.arange(6.0)
    x, y, depth = np.sin(theta) * np.cos(turn), np.sin(theta) * np.sin(turn), np.cos(theta)
    expected = 300 * 280 / (1000 * 800) * theta / np.sin(theta)
    np.testing.assert_allclose(lens.image_a_steradian(x, y, depth), expected, rtol=1e-6)


def test_a_spherical_lenss_pixels_a_steradian_are_those_of_the_closed_form():
    lens = SphericalLens(2 * math.pi, (-1.2, 1.3))
    u, v = np.random.default_rng(7).uniform(0.01, 0.99, (2, 200))
    x, y, depth = lens.directions(u, v)
    expected = 1 / (2 * math.pi * 2.5 * np.hypot(x, depth))
    np.testing.assert_allclose(lens.image_a_steradian(x, y, depth), expected, rtol=1e-6)


@pytest.mark.parametrize("name", LENSES)
def test_all_steradians_together_are_the_image_less_its_blind_corners(name):
    """Over random directions, the mean of pixels a steradian in the image times all steradians."""
    lens = LENSES[name]
    n = 400_000
    x, y, depth = on_sphere(n, 8)
    seen = lens.contains(x, y, depth)
    shares = lens.image_a_steradian(x[seen], y[seen], depth[seen])
    u, v = np.random.default_rng(9).uniform(0, 1, (2, 4000))
    has_ray = np.isfinite(lens.directions(u, v)[0]).mean()
    shares = shares[np.isfinite(shares)]
    error = 4 * math.pi * math.sqrt((shares**2).sum() / n) / math.sqrt(n)
    assert 4 * math.pi * shares.sum() / n == pytest.approx(has_ray, abs=4 * error + 0.03)


# --- sizes and borders


def test_a_lens_at_another_size_is_the_same_image():
    lens = BENT["k1 = -0.35 and tangential"]
    half = lens.at_size((960, 540))
    assert half.focal_px == (650, 645)
    assert half.centre_px == middle((960, 540))
    x, y, depth = lens.directions(*np.random.default_rng(0).uniform(0, 1, (2, 100)))
    np.testing.assert_allclose(half.project(x, y, depth), lens.project(x, y, depth), atol=1e-12)


@pytest.mark.parametrize("name", LENSES)
def test_the_outline_goes_around_the_image_and_is_of_rays(name):
    lens = LENSES[name]
    found = lens.outline(16)
    assert found.shape == (64, 3)
    np.testing.assert_allclose(np.linalg.norm(found, axis=1), 1, atol=1e-9)
    u, v = lens.project(*found.T)
    assert min(u.min(), v.min()) > -1e-6
    assert max(u.max(), v.max()) < 1 + 1e-6


@pytest.mark.parametrize(
    ("kind", "bent", "fact"),
    [
        (OpenCVLens, (1, 2, 3), "distortion has 3 numbers; it takes k1, k2, p1, p2, then none, k3"),
        (FisheyeLens, (1, 2, 3, 4, 5), "distortion has 5 numbers; a fisheye takes k1, k2, k3, k4"),
        (OpenCVLens, (math.nan,) * 4, "focal_px, centre_px and distortion must be finite"),
    ],
)
def test_distortions_that_are_none_are_refused(kind, bent, fact):
    with pytest.raises(ValueError, match=fact):
        kind((9, 9), (5, 5), (4, 4), bent)
