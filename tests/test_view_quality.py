"""How good a view is, by closed form: pixel size, density, depth error and blur."""

import math
from dataclasses import replace

import numpy as np
import pytest

from glvis.evaluation.view_quality import (
    NAMES,
    ViewQuality,
    a_metre,
    focal_along_baseline,
    is_known,
    quality_of_views,
    view_quality,
)
from glvis.problem.calibrated_lens import FisheyeLens, OpenCVLens
from glvis.problem.camera import look_along
from glvis.problem.lens import Lens, Pinhole, SphericalLens
from glvis.problem.sensor import Focus, Noise, Partner, Sensor

FX, FY, SIZE = 1402.0, 1377.0, (1920, 1080)
PINHOLE = Pinhole.from_tangents(SIZE[0] / 2 / FX, SIZE[1] / 2 / FY)
CAM = Sensor("cam", PINHOLE, SIZE, 0.0, 1e5)
POSE = look_along(np.array([3.0, -2.0, 7.0]), (0.3, 0.8, -0.4), roll=0.7)


def in_world(camera_points) -> np.ndarray:
    """Return points (n, 3) of x right, y up and depth, in the world of POSE."""
    points = np.asarray(camera_points, dtype=float) * [1, 1, -1]
    return points @ POSE[:3, :3].T + POSE[:3, 3]


def facing(camera_points, tilt=0.0) -> np.ndarray:
    """Return unit normals (n, 3) that look back along the ray, tilted by an angle."""
    back = -np.asarray(camera_points, dtype=float) * [1, 1, -1]
    back /= np.linalg.norm(back, axis=1)[:, None]
    aside = np.cross(back, [0.2, 0.9, 0.1])
    aside /= np.linalg.norm(aside, axis=1)[:, None]
    return (math.cos(tilt) * back + math.sin(tilt) * aside) @ POSE[:3, :3].T


def quality(sensor, camera_points, tilt=0.0) -> ViewQuality:
    return view_quality(in_world(camera_points), facing(camera_points, tilt), POSE, sensor)


def random_points(rng, n=500, tangent=0.6):
    depth = rng.uniform(10, 3000, n)
    return np.stack([*rng.uniform(-tangent, tangent, (2, n)) * depth, depth], axis=1)


# -- pixel size


@pytest.mark.parametrize("tilt_deg", [0, 20, 60, 85])
def test_pixel_size_of_a_pinhole_by_the_two_closed_forms(rng, tilt_deg):
    points, tilt = random_points(rng), math.radians(tilt_deg)
    depth, distance = points[:, 2], np.linalg.norm(points, axis=1)
    f, cos_off_axis = math.sqrt(FX * FY), depth / distance
    found = quality(CAM, points, tilt).pixel_size
    np.testing.assert_allclose(found, depth / f * np.sqrt(cos_off_axis / math.cos(tilt)), rtol=1e-9)
    n_p = np.abs(np.sum(facing(points, tilt) * (in_world(points) - POSE[:3, 3]), axis=1))
    np.testing.assert_allclose(found, 1 / np.sqrt(FX * FY * n_p / depth**3), rtol=1e-9)


def test_pixel_size_on_the_axis_is_depth_by_focal_length():
    (found,) = quality(replace(CAM, lens=Pinhole.from_tangents(0.5, 0.5), resolution=(1000, 1000)),
                       [(0, 0, 500)]).pixel_size  # fmt: skip
    assert found == pytest.approx(0.5, rel=1e-9)


def test_pinhole_and_sphere_by_formula_are_what_differences_of_any_lens_give(rng):
    points = random_points(rng, tangent=0.9).T
    for lens in (PINHOLE, SphericalLens(math.radians(300), (-1.0, 1.2))):
        np.testing.assert_allclose(
            lens.image_a_steradian(*points), Lens.image_a_steradian(lens, *points), rtol=1e-7
        )


def test_opencv_lens_without_distortion_is_the_pinhole_of_its_focal_lengths(rng):
    centre = ((SIZE[0] - 1) / 2, (SIZE[1] - 1) / 2)
    lens = OpenCVLens(SIZE, (FX, FY), centre, ())
    points = random_points(rng)
    ideal, found = quality(CAM, points, 0.4), quality(replace(CAM, lens=lens), points, 0.4)
    np.testing.assert_allclose(found.pixel_size, ideal.pixel_size, rtol=1e-8)
    np.testing.assert_allclose(found.density, ideal.density, rtol=1e-8)


def test_pixel_size_of_an_equidistant_fisheye():
    f, size = 500.0, (2000, 2000)
    lens = FisheyeLens(size, (f, f), (999.5, 999.5), ())
    theta, distance, tilt = np.radians([1e-3, 30, 60, 90, 130]), 800.0, math.radians(35)
    points = distance * np.stack([np.sin(theta), 0 * theta, np.cos(theta)], axis=1)
    found = quality(replace(CAM, lens=lens, resolution=size), points, tilt)
    # f pixels a radian from the axis, f theta / sin(theta) around it
    pixels = f * f * theta / np.sin(theta)
    np.testing.assert_allclose(
        found.pixel_size, np.sqrt(distance**2 / (math.cos(tilt) * pixels)), rtol=1e-6
    )
    np.testing.assert_allclose(found.density, np.sqrt(pixels) / distance, rtol=1e-6)


def test_pixel_size_of_a_spinning_lidar_and_behind_it():
    lens = SphericalLens(2 * math.pi, (math.radians(-15), math.radians(15)))
    lidar = Sensor("lidar", lens, (1800, 16), 0, 1e5, distance="range")
    found = quality(lidar, [(0, 0, 1e4), (0, 0, -1e4), (1e4, 0, 0)]).pixel_size
    step = (2 * math.pi / 1800) * (math.radians(30) / 16)  # solid angle of a pixel, level
    np.testing.assert_allclose(found, 1e4 * math.sqrt(step), rtol=1e-9)


def test_pixels_of_a_face_times_pixel_size_squared_is_its_area():
    # a small square, tilted, counted by the area of its projection
    centre, half = np.array([120.0, -80.0, 900.0]), 0.5
    normal = facing([centre], 0.8)[0]
    a = np.cross(normal, [0.0, 0.0, 1.0])
    a /= np.linalg.norm(a)
    b = np.cross(normal, a)
    corners = in_world([centre]) + half * np.array([a + b, a - b, -a - b, b - a])
    local = (corners - POSE[:3, 3]) @ POSE[:3, :3] * [1, 1, -1]
    u, v = PINHOLE.project(*local.T)
    u, v = u * SIZE[0], v * SIZE[1]
    pixels = abs(np.dot(u, np.roll(v, 1)) - np.dot(v, np.roll(u, 1))) / 2
    (size,) = view_quality(in_world([centre]), normal[None], POSE, CAM).pixel_size
    assert pixels * size**2 == pytest.approx((2 * half) ** 2, rel=1e-5)


# -- density


def test_density_of_a_pinhole_is_the_same_all_over_a_wall_square_to_the_axis(rng):
    points = random_points(rng)
    points[:, 2] = 4000.0
    found = a_metre(quality(CAM, points, 0.9).density, "mm")
    np.testing.assert_allclose(found, 1000 * math.sqrt(FX * FY) / 4000, rtol=1e-9)


def test_identify_is_250_pixels_a_metre_whatever_the_unit_of_the_study():
    in_metres = quality(CAM, [(0, 0, math.sqrt(FX * FY) / 250)]).density
    assert a_metre(in_metres, "m")[0] == pytest.approx(250, rel=1e-9)
    assert a_metre(np.array([6.35]), "in")[0] == pytest.approx(250)


# -- depth error


def stereo(f, baseline, subpixel=0.08, **more) -> Sensor:
    """A stereo sensor of f pixels, its partner beside it."""
    lens = Pinhole.from_tangents(640 / f, 360 / f)
    partner = Partner((baseline, 0, 0), lens)
    return Sensor("pair", lens, (1280, 720), 0, 1e5, partner=partner, noise=Noise(subpixel, **more))


@pytest.mark.parametrize(
    ("f", "baseline", "depth", "printed"),
    [  # focal length in pixels and baseline of Intel's D435, D415 and D455, error at 0.08 pixel
        *[(645, 50, 500, 0.62), (645, 50, 1000, 2.5), (645, 50, 2000, 9.9), (645, 50, 4000, 40)],
        *[(940, 55, 200, 0.06), (940, 55, 500, 0.39), (940, 55, 1000, 1.55)],
        *[(940, 55, 2000, 6.2), (640, 95, 1000, 1.3), (640, 95, 2000, 5.3), (640, 95, 4000, 21)],
    ],
)
def test_depth_error_of_stereo_cameras_as_intel_tells_it(f, baseline, depth, printed):
    (found,) = quality(stereo(f, baseline), [(0.1 * depth, 0, depth)], 0.5).depth_error
    assert found == pytest.approx(depth**2 * 0.08 / (f * baseline), rel=1e-6)
    digits = 1 if printed == 0.06 else len(str(printed).replace(".", "").strip("0"))
    assert float(f"{found:.{digits}g}") == printed


def test_focal_length_is_that_along_the_baseline():
    lens = Pinhole.from_tangents(0.8, 0.6)
    sensor = Sensor(
        "s", lens, (1600, 900), 0, 100, noise=Noise(0.1), partner=Partner((1, 0, 0), lens)
    )
    for offset, expected in [
        ((50, 0, 0), 1000), ((-50, 0, 9), 1000), ((0, 70, 0), 750),
        ((30, 40, 0), math.hypot(1000 * 0.6, 750 * 0.8)),
    ]:  # fmt: skip
        one = replace(sensor, partner=Partner(offset, lens))
        assert focal_along_baseline(one) == pytest.approx(expected, rel=1e-9)
    assert math.isnan(focal_along_baseline(replace(sensor, partner=Partner((0, 0, 5), lens))))


def test_depth_error_by_a_polynomial_and_by_incidence():
    # Fankhauser 2015 for the Kinect v2, mm: 1.5 - 0.5 z + 0.3 z^2, z in metres
    noise = Noise(polynomial=(1.5, -0.5e-3, 0.3e-6))
    sensor = replace(CAM, noise=noise)
    points = [(0, 0, 1000), (300, 0, 2000), (0, 0, 3000)]
    flat = quality(sensor, points, 0.6).depth_error
    np.testing.assert_allclose(flat, [1.3, 1.7, 2.7], rtol=1e-9)
    turned = replace(sensor, noise=replace(noise, by_incidence=True))
    np.testing.assert_allclose(
        quality(turned, points, 0.6).depth_error, flat / math.cos(0.6), rtol=1e-9
    )


def test_polynomial_of_a_sensor_that_measures_ranges_is_one_of_the_range():
    lens = SphericalLens(2 * math.pi, (-0.3, 0.3))
    noise = Noise(polynomial=(8.0, 1e-3))
    lidar = Sensor("lidar", lens, (1800, 16), 0, 1e5, distance="range", noise=noise)
    found = quality(lidar, [(3000, 0, 4000), (0, 0, -5000)]).depth_error
    np.testing.assert_allclose(found, 13.0, rtol=1e-9)


# -- blur


def in_focus(focal_length, f_number, distance, pitch) -> Sensor:
    return replace(CAM, focus=Focus(focal_length, f_number, distance, pitch))


@pytest.mark.parametrize(
    ("focal_length", "f_number", "distance", "circle", "ends"),
    [  # depth of field: f, N, s, circle of confusion, mm; near and far end to five digits
        (16, 4, 1000, 3.45e-3, (949.6, 1056.0)),
        (8, 2.8, 600, 3.45e-3, (550.8, 658.9)),
        (35, 8, 3000, 0.03, (1897.7, 7158)),
        (35, 8, 3000, 4.34e-3, (2767, 3275)),
    ],
)
def test_blur_is_one_pixel_at_the_ends_of_the_depth_of_field(
    focal_length, f_number, distance, circle, ends
):
    hyperfocal = focal_length**2 / (f_number * circle) + focal_length
    near = distance * (hyperfocal - focal_length) / (hyperfocal + distance - 2 * focal_length)
    far = distance * (hyperfocal - focal_length) / (hyperfocal - distance)
    assert (near, far) == pytest.approx(ends, rel=2e-4)
    sensor = in_focus(focal_length, f_number, distance, circle)
    points = [(0, 0, near), (0, 0, far), (0, 0, distance), (0.2 * far, 0, far)]
    np.testing.assert_allclose(
        quality(sensor, points, 0.3).blur, [1, 1, 0, 1], rtol=1e-6, atol=1e-9
    )


# -- what does not exist, and the best of several


def test_numbers_that_do_not_exist_are_nan():
    unknown = quality(CAM, [(0, 0, 10)])
    assert np.isfinite([unknown.pixel_size, unknown.density]).all()
    assert np.isnan([unknown.depth_error, unknown.blur]).all()
    noisy = replace(in_focus(16, 4, 1000, 3.45e-3), noise=Noise(polynomial=(1.0,)))
    for found in (
        quality(noisy, [(0, 0, -10)]),  # behind a pinhole
        quality(noisy, [(0, 0, 10)], math.radians(100)),  # looks away
        quality(noisy, [(5, 0, -0.1)]),  # 91 degrees off the axis
        view_quality(POSE[None, :3, 3], [(0, 0, 1)], POSE, noisy),  # in the optical centre
    ):
        assert all(np.isnan(found.of(name)).all() for name in NAMES)
    falling = replace(CAM, noise=Noise(polynomial=(1.0, -0.5)))
    assert np.isnan(quality(falling, [(0, 0, 10)]).depth_error).all()
    assert [is_known(name, [CAM]) for name in NAMES] == [True, True, False, False]
    assert all(is_known(name, [CAM, noisy]) for name in NAMES)


def test_best_is_the_smallest_but_of_densities_the_largest_of_those_that_see_a_face():
    noisy = replace(CAM, noise=Noise(polynomial=(0.0, 1e-3)))
    poses = np.stack([POSE, POSE, POSE])
    poses[1, :3, 3] += 100 * POSE[:3, 2]  # farther back
    points = in_world([(0, 0, 500), (0, 0, 500), (0, 0, 500)])
    found = quality_of_views(points, facing([(0, 0, 500)] * 3), poses, [CAM, noisy, CAM])
    visible = np.array([[1, 0, 0], [1, 1, 0], [0, 0, 0]], dtype=bool)
    f = math.sqrt(FX * FY)
    size, which = found.best("pixel_size", visible)
    np.testing.assert_allclose(size, [500 / f, 600 / f, np.nan], rtol=1e-9)
    assert which.tolist() == [0, 1, -1]
    density, which = found.best("density", visible)
    np.testing.assert_allclose(density, [f / 500, f / 600, np.nan], rtol=1e-9)
    assert which.tolist() == [0, 1, -1]
    error, which = found.best("depth_error", visible)
    np.testing.assert_allclose(error, [0.6, 0.6, np.nan], rtol=1e-9)
    assert which.tolist() == [1, 1, -1]


def pixel_rays(lens, size) -> np.ndarray:
    """Return unit directions (n, 3) of the pixels' centres, x right, y up, depth."""
    u, v = np.meshgrid((np.arange(size[0]) + 0.5) / size[0], (np.arange(size[1]) + 0.5) / size[1])
    rays = lens.directions(u.ravel(), v.ravel()).T
    return rays[np.isfinite(rays).all(axis=1)]


def hit_by(rays, corners) -> int:
    """Return how many rays from the origin meet a triangle (3, 3): Cramer's rule."""
    shares = np.linalg.solve(corners.T, rays.T)
    return int(np.count_nonzero((shares > 0).all(axis=0)))


@pytest.mark.parametrize(
    ("lens", "size", "widest_deg"),
    [
        (Pinhole.from_degrees(75, 60), (400, 300), 30),
        (OpenCVLens((400, 300), (260.0, 262.0), (203.0, 148.0), (-0.3, 0.1, 4e-4, -2e-4)),
         (400, 300), 28),
        (FisheyeLens((500, 500), (135.0, 135.0), (249.5, 249.5), (0.02, -0.004, 0.0, 0.0)),
         (500, 500), 95),
        (SphericalLens(2 * math.pi, (-0.6, 0.6)), (900, 172), 170),
    ],
)  # fmt: skip
def test_pixels_that_show_a_face_times_pixel_size_squared_are_its_area(rng, lens, size, widest_deg):
    rays, errors = pixel_rays(lens, size), []
    sensor = Sensor("any", lens, size, 0, 1e9, distance="range")
    for _ in range(45):
        # somewhere before the lens, of some 30 to 300 pixels, tilted up to 65 degrees
        theta = math.radians(widest_deg) * math.sqrt(rng.random())
        turn = rng.uniform(0, 2 * math.pi)
        if isinstance(lens, SphericalLens):
            along = lens.directions(rng.uniform(0.02, 0.98), rng.uniform(0.15, 0.85))
        else:
            along = np.array([math.sin(theta) * math.cos(turn), math.sin(theta) * math.sin(turn),
                              math.cos(theta)])  # fmt: skip
        centre = along * 1000 * [1, 1, -1]  # right, up, back
        normal = (
            -centre / 1000
            + math.tan(math.radians(65))
            * rng.random()
            * np.cross(centre / 1000, rng.normal(size=3))
            / 2
        )
        normal /= np.linalg.norm(normal)
        a = np.cross(normal, [0.3, 0.5, 0.8])
        a /= np.linalg.norm(a)
        b = np.cross(normal, a)
        turns = 2 * math.pi * np.arange(3) / 3
        corners = centre + 70 * (np.outer(np.cos(turns), a) + np.outer(np.sin(turns), b))
        n = hit_by(rays, corners * [1, 1, -1])
        (pixel,) = view_quality(centre[None], normal[None], np.eye(4), sensor).pixel_size
        area = 70**2 * 0.75 * math.sqrt(3)
        if n > 30:
            errors.append(n * pixel**2 / area - 1)
    assert len(errors) > 20
    assert abs(np.median(errors)) < 0.01
    assert np.median(np.abs(errors)) < 0.03
