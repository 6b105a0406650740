"""The size of a pixel on a face, by every lens: the pixels that show it make up its visible area.

One ray in float64 through the middle of each pixel counts pixels; 64 rays to points of a face tell
how much of it shows.
"""

from __future__ import annotations

import math

import numpy as np
import pytest
from support import oracle, shapes
from support.lens_kinds import SENSORS
from support.lens_oracle import Device, LensEye, LensJudge
from support.verdicts import corners_of

from glvis.problem.camera import look_along
from glvis.problem.lens import Lens, Pinhole

LENSES = {"pinhole": Pinhole.from_degrees(69, 42)} | {
    name: sensor.lens
    for name, sensor in SENSORS.items()
    if sensor.lens.kind != "pinhole" and sensor.partner is None
}
PIXELS = 100_000  # of an image, about


def pixel_size(lens: Lens, n_pixels: int, at: np.ndarray, normals: np.ndarray) -> np.ndarray:
    """Return the length a pixel covers at points (N, 3) of the camera frame, (N,).

    By the pixels that the lens gives a steradian: sqrt(r^2 / (cos theta |d pixels / d omega|)).
    """
    far = np.linalg.norm(at, axis=1)
    cosine = -np.sum(at * normals, axis=1) / far
    density = n_pixels * lens.image_a_steradian(at[:, 0], at[:, 1], -at[:, 2])
    return far / np.sqrt(cosine * density)


def image_size(lens: Lens) -> tuple[int, int]:
    """Return a size in pixels of the image's own shape."""
    wide, high = lens.opening
    width = round(math.sqrt(PIXELS * wide / high))
    return width, round(PIXELS / width)


def cave(rng) -> np.ndarray:
    """Return the triangles of a bumpy hall that looks inward."""
    return corners_of(shapes.flipped(shapes.blob(rng, 3, 200.0)))


@pytest.mark.parametrize("name", LENSES)
def test_pixels_that_show_a_face_make_up_its_visible_area(name, rng):
    lens = LENSES[name]
    hall = cave(rng)
    posts = [shapes.moved(shapes.icosphere(1, 12.0), place) for place in rng.normal(0, 60, (9, 3))]
    hiding = corners_of(shapes.merged(*posts))
    everything = np.concatenate([hall, hiding])
    edges = hall[:, 1] - hall[:, 0], hall[:, 2] - hall[:, 0]
    cross = np.cross(*edges)
    area = np.linalg.norm(cross, axis=1) / 2
    normals = cross / (2 * area[:, None])

    width, height = image_size(lens)
    u, v = np.meshgrid((np.arange(width) + 0.5) / width, (np.arange(height) + 0.5) / height)
    x, y, depth = lens.directions(u.ravel(), v.ravel())
    has_ray = np.isfinite(x)
    rays = np.stack([x, y, -depth], axis=1)[has_ray]
    ratios = []
    for _ in range(3):
        pose = look_along(rng.uniform(-30, 30, 3), rng.normal(size=3), rng.uniform(-3, 3))
        eye, axes = pose[:3, 3], pose[:3, :3]
        _, face, _ = oracle.nearest_hits(eye, rays @ axes.T, everything)
        shows = np.bincount(face[(face >= 0) & (face < len(hall))], minlength=len(hall))
        judge = LensJudge(pose, Device(LensEye.of(lens), by_range=True), hall, hiding)
        many = np.flatnonzero(shows > 30)
        share = np.mean(judge.shares(8, many), axis=0)
        centre = hall[many].mean(axis=1)
        in_view = lens.contains(*((centre - eye) @ axes * [1, 1, -1]).T)
        many, share, centre = many[in_view], share[in_view], centre[in_view]
        side = pixel_size(lens, width * height, (centre - eye) @ axes, normals[many] @ axes)
        ratios.append(shows[many] * side**2 / (share * area[many]))
    ratio = np.concatenate(ratios)
    assert len(ratio) > 50
    assert np.median(ratio) == pytest.approx(1, abs=0.01)
    assert np.median(np.abs(ratio - 1)) < 0.03


def test_a_pinholes_pixel_is_as_large_as_its_closed_form_says(rng):
    lens, size = Pinhole.from_degrees(69, 42), (1280, 720)
    at = np.stack([*rng.uniform(-0.3, 0.3, (2, 200)), -np.ones(200)], axis=1)
    at *= rng.uniform(100, 1000, (200, 1))
    normals = rng.normal(size=(200, 3))
    normals /= np.linalg.norm(normals, axis=1)[:, None]
    normals *= -np.sign(np.sum(normals * at, axis=1))[:, None]
    far, z = np.linalg.norm(at, axis=1), -at[:, 2]
    focal = math.prod(
        n / (2 * tangent) for n, tangent in zip(size, lens.tan_half, strict=True)
    )  # fx fy
    cos_theta, cos_phi = -np.sum(at * normals, axis=1) / far, z / far
    expected = z / math.sqrt(focal) * np.sqrt(cos_phi / cos_theta)
    sides = pixel_size(lens, math.prod(size), at, normals)
    np.testing.assert_allclose(sides, expected, rtol=1e-6)
    # the same as 1 / sqrt(fx fy |n . P| / z^3)
    along = np.abs(np.sum(normals * at, axis=1))
    np.testing.assert_allclose(sides, 1 / np.sqrt(focal * along / z**3), rtol=1e-6)
