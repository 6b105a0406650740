"""Faces in one place: which are pairs, and that a pixel that shows one shows the other."""

import numpy as np
import pytest
from support import shapes
from support.one_sensor import DOWN, seen, sensor

from glvis.problem.camera import look_along
from glvis.problem.scene import Model
from glvis.visibility.coincident import Coincident

UNIT = shapes.triangle((0, 0, 0), (1, 0, 0), (0, 1, 0))
FAR_OFF = shapes.triangle((9, 9, 9), (9, 10, 9), (9, 9, 10))  # makes the extent that of a scene
UP = look_along([0, 0, -4], [0, 0, 1], up=(0, 1, 0))  # as DOWN, from the other side


def found(*parts):
    return Coincident.of(Model.from_arrays("parts", *shapes.merged(*parts)))


def pairs(*parts):
    """Return the pairs of faces of some shapes as one model, the smaller first."""
    made = found(*parts)
    number = np.diff(made.first)
    faces = np.repeat(np.arange(len(number)), number)
    both = set(map(tuple, np.stack([faces, made.partner], axis=1).tolist()))
    assert len(both) == len(made) and both == {(b, a) for a, b in both}
    return {(a, b) for a, b in both if a < b}


@pytest.mark.parametrize(
    ("other", "is_pair"),
    [
        (UNIT, True),
        (shapes.flipped(UNIT), True),
        (shapes.permuted((UNIT[0], UNIT[1][:, [1, 2, 0]]), [0]), True),
        (shapes.moved(UNIT, (0.9, 0, 0)), True),  # they share a little area
        (shapes.moved(UNIT, (0.2, 0.2, 0)), True),
        ((UNIT[0] / 4 + [0.1, 0.1, 0], UNIT[1]), True),  # one within the other
        (shapes.moved(UNIT, (1, 0, 0)), False),  # a corner
        (shapes.moved(UNIT, (0.6, 0.6, 0)), False),  # their boxes overlap alone
        (shapes.triangle((1, 0, 0), (1, 1, 0), (0, 1, 0)), False),  # an edge
        (shapes.moved(UNIT, (0, 0, 1e-4)), False),  # parallel
        (shapes.triangle((0, 0, 0), (1, 0, 0), (0, 1, 1e-3)), False),  # opened like a book
        (shapes.triangle((0, 0, 0), (1, 0, 0), (0, 0, 1)), False),  # through an edge
        (shapes.triangle((0.2, 0.2, -1), (0.3, 0.2, 1), (0.2, 0.4, 1)), False),  # pierces
        (shapes.triangle((0, 0, 0), (1, 0, 0), (0.5, 0, 0)), False),  # without area
    ],
)
def test_faces_are_a_pair_that_share_area_in_one_plane(other, is_pair):
    for parts in ((UNIT, other, FAR_OFF), (other, UNIT, FAR_OFF)):
        assert pairs(*parts) == ({(0, 1)} if is_pair else set())


def test_a_pair_of_opposite_windings_makes_a_model_two_sided():
    assert found(UNIT, shapes.flipped(UNIT)).is_two_sided
    assert not found(UNIT, UNIT).is_two_sided
    assert not found(UNIT, shapes.flipped(shapes.moved(UNIT, (0, 0, 1e-3)))).is_two_sided


def test_quads_that_overlap_in_part_make_each_pair_once():
    one = shapes.plate(2)  # lower right, upper left of the square from -1 to 1
    # of the other, only the upper left half reaches into that strip of the first, 0.5 < x < 1
    other = shapes.moved(one, (1.5, 0.25, 0))
    assert pairs(one, other) == {(0, 2), (0, 3), (1, 3)}
    # each half of the square covers its own three of the eight smaller faces
    grid = shapes.plate(2, cells=(2, 2))
    x, y, _ = shapes.corners(grid).mean(axis=1).T
    assert pairs(one, grid) == {(int(y[k] > x[k]), 2 + k) for k in range(8)}


@pytest.mark.parametrize("make", [shapes.cube, shapes.icosphere, shapes.torus, shapes.plate])
def test_neighbours_of_a_closed_or_flat_surface_are_no_pairs(make):
    assert not pairs(make())
    n = len(make()[1])
    assert pairs(make(), shapes.flipped(make())) >= {(k, n + k) for k in range(n)}


def recut(shape, place, turn, extent):
    """Return the pairs of a triangle with its own two halves, as float32 has these."""
    at = shapes.moved(shape, place, turn)
    a, b, c = shapes.corners(at)[0]
    middle = (b + c) / 2
    halves = shapes.flipped(
        shapes.merged(shapes.triangle(a, b, middle), shapes.triangle(a, middle, c))
    )
    rounded = (halves[0].astype(np.float32), halves[1])
    return pairs(at, rounded, shapes.moved(FAR_OFF, (2 * extent, 0, 0)))


@pytest.mark.parametrize("extent", [1, 10, 1000])
def test_the_bins_part_no_pair_whatever_its_plane(extent, rng):
    for _ in range(200):
        turn = np.linalg.qr(rng.normal(size=(3, 3)))[0]
        turn *= np.linalg.det(turn)
        place = rng.uniform(-extent, extent, size=3)
        assert recut(UNIT, place, turn, extent) == {(0, 1), (0, 2)}


def test_nor_where_a_normal_has_a_coordinate_of_one_half(rng):
    for _ in range(200):
        # the side of a hexagonal prism about z, of which normals are (-1/2, 0.866..., 0)
        cos, sin = -0.5, 0.75**0.5
        turn = np.array([[-sin, 0, cos], [cos, 0, sin], [0, 1, 0]])
        turn[:, 0] *= np.linalg.det(turn)
        assert recut(UNIT, rng.uniform(-1, 1, size=3), turn, 1) == {(0, 1), (0, 2)}


def test_pairs_are_looked_for_in_parts(rng, monkeypatch):
    flat = shapes.soup(rng, 100, 0.3)
    flat = (flat[0] * [1, 1, 0], flat[1])
    whole = pairs(flat)
    monkeypatch.setattr("glvis.visibility.coincident._PAIRS", 5)
    assert len(whole) > 100 and pairs(flat) == whole


DEVICE = sensor(resolution=(31, 31), far=10)


def test_both_faces_of_a_doubled_plate_are_seen_in_equal_pixels():
    plate = shapes.plate(1, center=(0, 0, -2))
    model = Model.from_arrays("doubled", *shapes.merged(plate, plate))
    image = np.zeros((31, 31), np.uint32)
    # the plate spans 0.433 of the image: 13.4 pixels, of which 13 centres; row 0 at the top
    row, column = np.indices((13, 13))
    image[9:22, 9:22] = np.where(column > 12 - row, 1, 2)
    image[image.nonzero()] *= (column + row != 12).ravel()  # rays to the common edge meet either
    further = Coincident.of(model).pixels_shared(image, model, DEVICE, DOWN)
    shown = np.bincount(image.ravel(), minlength=5)[1:]
    assert shown.tolist() == [78, 78, 0, 0]
    assert further.tolist() == [0, 0, *shown[:2]]
    # none is seen from behind
    assert not Coincident.of(model).pixels_shared(image, model, DEVICE, UP).any()


def test_a_pixel_that_misses_the_partner_does_not_show_it():
    wide, small = shapes.plate(2, center=(0, 0, -2)), shapes.plate(0.5, center=(0, 0, -2))
    parts = shapes.merged(wide, small)
    for size in (31, 64):
        device = sensor(resolution=(size, size), far=10)
        model = Model.from_arrays("parts", *parts)
        image = np.zeros((size, size), np.uint32)
        image[:, : size // 4] = 1  # far from the small one
        assert not Coincident.of(model).pixels_shared(image, model, device, DOWN)[2:].any()
        assert Coincident.of(model).pixels_shared(image + 1, model, device, DOWN)[2:].any()


def test_an_image_without_faces_shares_nothing():
    model = Model.from_arrays("doubled", *shapes.merged(UNIT, UNIT))
    image = np.zeros((4, 4), np.uint32)
    assert Coincident.of(model).pixels_shared(image, model, DEVICE, DOWN).tolist() == [0, 0]


@pytest.mark.parametrize("resolution", ["auto", "sensor"])
@pytest.mark.parametrize("tilt_deg", [0, 35, 71])
def test_both_of_a_doubled_plate_are_seen(resolution, tilt_deg):
    plate = shapes.plate(1, center=(0, 0, -2), tilt_deg=tilt_deg, cells=(3, 3))
    assert seen(shapes.merged(plate, plate), DOWN, sensor(), resolution=resolution).all()


@pytest.mark.parametrize("resolution", ["auto", "sensor"])
@pytest.mark.parametrize("tilt_deg", [0, 35, 71])
def test_a_sheet_modelled_from_both_sides_shows_the_side_that_faces_the_sensor(
    resolution, tilt_deg
):
    sheet = shapes.plate(1, center=(0, 0, -2), tilt_deg=tilt_deg, cells=(3, 3))
    front = np.arange(36) < 18
    for both, faces in (
        (shapes.merged(sheet, shapes.flipped(sheet)), front),
        (shapes.merged(shapes.flipped(sheet), sheet), ~front),
    ):
        shown = seen(both, np.stack([DOWN, UP]), sensor(), resolution=resolution)
        assert np.array_equal(shown, [faces, ~faces])


@pytest.mark.parametrize("resolution", ["auto", "sensor"])
@pytest.mark.parametrize("turn", [shapes.moved, shapes.flipped])
def test_an_obstacle_that_lies_on_a_face_does_not_hide_it(resolution, turn):
    plate = shapes.plate(1, center=(0, 0, -2), cells=(3, 3))
    lies, nearer = shapes.plate(3, center=(0, 0, -2)), shapes.plate(3, center=(0, 0, -1.99))
    assert seen(plate, DOWN, sensor(), [turn(lies)], resolution=resolution).all()
    assert not seen(plate, DOWN, sensor(), [turn(nearer)], resolution=resolution).any()
