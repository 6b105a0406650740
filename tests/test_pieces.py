"""Large faces cut into pieces: closed forms of the cut, and what is told of the file's faces."""

import math

import numpy as np
import pytest
from support import shapes

from glvis.problem import pieces
from glvis.problem.lens import Pinhole
from glvis.problem.pieces import MOST_ADDED, cut, cut_models, noun_of_shares, pieces_words, share_of
from glvis.problem.scene import Model
from glvis.problem.sensor import Sensor
from glvis.problem.visibility_options import VisibilityOptions
from glvis.visibility.folding import fold, fold_counts, seen_share

BY_PIXELS, BY_CENTROIDS = VisibilityOptions(), VisibilityOptions(criterion="centroid")
# sees 2 x 2 at its working distance of 1
EYE = Sensor("eye", Pinhole.from_degrees(90, 90), (512, 512), 0.5, 1.5)


def model(shape, name="shape") -> Model:
    return Model.from_arrays(name, *shape)


def longest(one: Model) -> float:
    corner = one.vertices[one.faces]
    return float(np.linalg.norm(corner - np.roll(corner, 1, axis=1), axis=2).max())


def corner_sets(one: Model) -> set:
    """Return the faces as what does not depend on their order: their corners' coordinates."""
    return {frozenset(map(tuple, corner)) for corner in one.vertices[one.faces].tolist()}


@pytest.mark.parametrize(
    ("max_edge", "parts"),
    [(1.5, 1), (1.4, 2), (1.0, 2), (0.99, 4), (0.7, 8), (0.4, 16), (0.35, 32)],
)
def test_a_right_isosceles_triangle_falls_into_halves_of_halves(max_edge, parts):
    # each is the one before turned and smaller by the square root of two
    found = cut(model(shapes.triangle([0, 0, 0], [1, 0, 0], [0, 1, 0])), max_edge)
    assert found.n_faces == parts
    np.testing.assert_allclose(found.areas, 0.5 / parts)


@pytest.mark.parametrize("halvings", range(5))
def test_an_equilateral_triangle_falls_into_equal_ones(halvings):
    corner = [0.5, math.sqrt(3) / 2, 0]
    found = cut(model(shapes.triangle([0, 0, 0], [1, 0, 0], corner)), 1.01 / 2**halvings)
    assert found.n_faces == 4**halvings
    sides = found.vertices[found.faces] - np.roll(found.vertices[found.faces], 1, axis=1)
    np.testing.assert_allclose(np.linalg.norm(sides, axis=2), 1 / 2**halvings)


SHAPES = {
    "soup": lambda rng: shapes.soup(rng, 60, size=1.0),
    "cube": lambda rng: shapes.cube(3.0),
    "dented ball": lambda rng: shapes.blob(rng, 1, radius=2.0),
    "torus": lambda rng: shapes.torus(nu=7, nv=5),
    "long plate": lambda rng: shapes.plate(9.0, 0.2, cells=(1, 3)),
}


@pytest.mark.parametrize("kind", SHAPES)
@pytest.mark.parametrize("max_edge", [1.0, 0.33, 0.11])
def test_pieces_tile_their_face_and_follow_it_in_order(rng, kind, max_edge):
    whole = model(SHAPES[kind](rng))
    found = cut(whole, max_edge)
    assert found.pieces
    owner = found.pieces.file_face
    assert found.file is whole
    assert found.pieces.max_edge == max_edge
    assert longest(found) <= max_edge
    assert (np.diff(owner) >= 0).all()
    assert (np.unique(owner) == np.arange(whole.n_faces)).all()
    # the pieces' areas add up to the face's, their normals are its own: they lie in its plane and
    # none is turned over, so together they are the face
    area = np.bincount(owner, found.areas)
    np.testing.assert_allclose(area, whole.areas, rtol=1e-9)
    np.testing.assert_allclose(found.normals, whole.normals[owner], atol=1e-9)
    weighted = found.areas[:, None] * found.centroids
    middle = np.stack([np.bincount(owner, weighted[:, k]) for k in range(3)], axis=1)
    np.testing.assert_allclose(middle / area[:, None], whole.centroids, atol=1e-9)
    # small faces are as they were
    small = np.bincount(owner) == 1
    np.testing.assert_array_equal(
        found.vertices[found.faces[small[owner]]], whole.vertices[whole.faces[small]]
    )


@pytest.mark.parametrize("kind", ["cube", "dented ball", "torus"])
@pytest.mark.parametrize("max_edge", [1.3, 0.7, 0.2])
def test_what_was_closed_stays_closed(rng, kind, max_edge):
    whole = model(SHAPES[kind](rng))
    found = cut(whole, max_edge)
    # a vertex in the middle of a neighbour's edge would leave edges with one face
    assert found.is_closed
    assert found.is_consistent
    characteristic = 0 if kind == "torus" else 2
    assert len(found.vertices) - found.n_faces / 2 == characteristic


def test_a_long_face_beside_a_short_one_leaves_no_vertex_on_an_edge():
    # one long edge shared by two faces of different size, the other edges of the second short
    shape = np.array([[0, 0, 0], [4, 0, 0], [2, 9, 0], [2, -0.5, 0.0]], dtype=float)
    found = cut(model((shape, np.array([[0, 1, 2], [1, 0, 3]], dtype=np.int32))), 2.1)
    assert found.boundary_edges == np.count_nonzero(on_rim(found, shape))
    owner = found.pieces.file_face
    on_shared = np.flatnonzero(found.vertices[:, 1] == 0)
    used = [set(found.faces[owner == side].ravel()) & set(on_shared) for side in (0, 1)]
    assert used[0] == used[1] == set(on_shared)


def on_rim(found: Model, shape) -> np.ndarray:
    """Return which edges of the faces (F, 3) lie on the outline 0-2, 1-2, 0-3 or 1-3."""
    start = found.vertices[found.faces]
    end = np.roll(start, -1, axis=1)
    is_on = np.zeros(found.faces.shape, dtype=bool)
    for a, b in ((0, 2), (1, 2), (0, 3), (1, 3)):
        way = (shape[b] - shape[a]) / np.linalg.norm(shape[b] - shape[a])
        off = [np.linalg.norm(np.cross(p - shape[a], way), axis=2) for p in (start, end)]
        is_on |= (off[0] < 1e-9) & (off[1] < 1e-9)
    return is_on


def test_the_cut_depends_on_no_order(rng):
    shape = shapes.blob(rng, 1)
    expected = corner_sets(cut(model(shape), 0.3))
    order = rng.permutation(len(shape[1]))
    turned = shape[0], np.roll(shape[1], 1, axis=1)
    for other in (shapes.permuted(shape, order), turned, shapes.flipped(shape)):
        assert corner_sets(cut(model(other), 0.3)) == expected


def test_faces_without_area_keep_their_place():
    vertices = np.array([[0, 0, 0], [4, 0, 0], [2, 0, 0], [0, 4, 0]], dtype=float)
    whole = model((vertices, np.array([[0, 1, 2], [0, 1, 3], [1, 1, 2]], dtype=np.int32)))
    found = cut(whole, 1.0)
    owner = found.pieces.file_face
    assert (np.unique(owner) == [0, 1, 2]).all()
    np.testing.assert_allclose(np.bincount(owner, found.areas), [0, 8, 0])
    share, _ = fold(np.ones((1, found.n_faces), dtype=bool), found)
    np.testing.assert_allclose(share, 1.0)


def test_nothing_to_cut_is_the_same_model(rng):
    ball = model(shapes.icosphere(3))
    assert cut(ball, ball.longest_edge) is ball
    for max_edge in ("off", "auto", 0.5):
        assert cut_models([ball], max_edge, [EYE], BY_PIXELS) == (ball,)
    assert ball.file is ball
    assert ball.longest_edge == pytest.approx(longest(ball))


def test_too_many_pieces_are_refused():
    whole = model(shapes.cube(1000.0), "hall")
    with pytest.raises(ValueError, match=r"max_edge = 0\.001 cuts hall into more than 4,000,000"):
        cut(whole, 0.001)


@pytest.mark.parametrize("options", [BY_PIXELS, BY_CENTROIDS])
def test_auto_cuts_to_a_share_of_what_the_sensor_sees(options):
    (found,) = cut_models([model(shapes.cube(3.0))], "auto", [EYE], options)
    share = {"pixels": 1 / 36, "centroid": 1 / 10}[options.criterion]
    assert found.pieces.max_edge == pytest.approx(2 * share)
    assert longest(found) <= 2 * share
    # what looks closer decides
    near = Sensor("near", Pinhole.from_degrees(90, 90), (512, 512), 0.25, 0.75)
    (finer,) = cut_models([model(shapes.cube(2.0))], "auto", [EYE, near], options)
    assert finer.pieces.max_edge == pytest.approx(share)


def test_auto_cuts_to_a_share_of_small_things_too():
    # the sensor sees far more than there is: pieces are a share of the thing
    (found,) = cut_models([model(shapes.cube(0.1))], "auto", [EYE], BY_PIXELS)
    assert found.pieces.max_edge == pytest.approx(0.1 * math.sqrt(3) / 36)


def test_auto_leaves_pieces_pixels_enough():
    stated = VisibilityOptions(resolution=(100, 200))
    (found,) = cut_models([model(shapes.cube(3.0))], "auto", [EYE], stated)
    assert found.pieces.max_edge == pytest.approx(2 * 12 / 100)


def test_auto_leaves_a_mesh_whose_large_faces_are_hardly_any_area():
    ball = shapes.icosphere(4, radius=2.0)
    needle = shapes.triangle([5, 0, 0], [5, 3, 0], [5, 3, 0.05])
    whole = model(shapes.merged(ball, needle))
    assert whole.areas[-1] < 0.01 * whole.areas.sum()
    assert cut_models([whole], "auto", [EYE], BY_PIXELS)[0] is whole


@pytest.mark.parametrize("size", [30.0, 3000.0])
def test_auto_never_makes_more_pieces_than_it_says(size):
    halls = [model(shapes.cube(size), "one"), model(shapes.cube(size / 2), "two")]
    found = cut_models(halls, "auto", [EYE], BY_CENTROIDS)
    added = sum(one.n_faces for one in found) - 24
    assert MOST_ADDED / 16 < added <= MOST_ADDED
    edges = [one.pieces.max_edge for one in found]
    assert edges[0] == edges[1] > 0.2


def test_a_face_is_seen_where_half_of_its_area_is():
    # a square of two triangles, and a small one that is not cut
    shape = shapes.merged(
        shapes.plate(1.0, cells=(1, 1)), shapes.triangle([5, 0, 0], [5.1, 0, 0], [5, 0.1, 0])
    )
    found = cut(model(shape), 0.3)
    owner = found.pieces.file_face
    assert (np.bincount(owner) == [32, 32, 1]).all()
    visible = np.zeros((3, found.n_faces), dtype=bool)
    visible[0, :16] = True  # half of the first
    visible[1, 32 : 32 + 15] = True  # a little less than half of the second
    visible[2] = True
    share, seen = fold(visible, found)
    np.testing.assert_allclose(share, [[0.5, 0, 0], [0, 15 / 32, 0], [1, 1, 1]])
    assert (seen == [[True, False, False], [False, False, False], [True, True, True]]).all()
    # of counts alone: all of the second is seen once, and less than half of it twice
    np.testing.assert_array_equal(fold_counts(visible.sum(axis=0), found), [2, 1, 1])


def test_what_is_told_of_faces_is_as_counted_by_hand(rng):
    whole = model(shapes.soup(rng, 30, size=0.5))
    found = cut(whole, 0.3)
    visible = rng.uniform(size=(4, found.n_faces)) < 0.6
    share, seen = fold(visible, found)
    counts = fold_counts(visible.sum(axis=0), found)
    for face in range(whole.n_faces):
        own = np.flatnonzero(found.pieces.file_face == face)
        area = found.areas[own]
        parts = [area[visible[s, own]].sum() / area.sum() for s in range(4)]
        np.testing.assert_allclose(share[:, face], parts, atol=1e-12)
        assert (seen[:, face] == (np.array(parts) >= 0.5 - 1e-9)).all()
        times = visible[:, own].sum(axis=0)
        at_least = [area[times >= n].sum() >= (0.5 - 1e-9) * area.sum() for n in range(1, 5)]
        assert counts[face] == sum(at_least)


def test_what_was_not_cut_is_told_as_it_is(rng):
    ball = model(shapes.icosphere(1))
    visible = rng.uniform(size=(3, ball.n_faces)) < 0.5
    share, seen = fold(visible, ball)
    np.testing.assert_array_equal(seen, visible)
    np.testing.assert_array_equal(share, visible)
    np.testing.assert_array_equal(seen_share(visible[0], ball), visible[0])
    np.testing.assert_array_equal(fold_counts(visible.sum(axis=0), ball), visible.sum(axis=0))


def test_shares_are_of_the_area_as_soon_as_anything_is_cut():
    plate = model(shapes.plate(1.0), "plate")
    ball = model(shapes.cube(1.0), "ball")
    found = cut(plate, 0.5)
    assert noun_of_shares([plate, ball]) == "faces"
    assert noun_of_shares([found, ball]) == noun_of_shares([plate, ball], by_area=True) == "area"
    lower = ball.centroids[:, 2] < 0
    assert share_of(ball, lower, "faces") == pytest.approx(0.5)
    # a dozen faces of one side and one of the other: by area half, by faces not
    uneven = model(
        shapes.merged(shapes.plate(1.0, cells=(3, 2)), shapes.plate(1.0, center=(2, 0, 0)))
    )
    first = uneven.centroids[:, 0] < 1
    assert share_of(uneven, first, "faces") == pytest.approx(12 / 14)
    assert share_of(uneven, first, "area") == pytest.approx(0.5)


def test_what_was_cut_is_said_in_a_sentence():
    shape = shapes.merged(shapes.plate(1.0), shapes.plate(0.5, center=(3, 0, 0), cells=(4, 4)))
    found = cut(model(shape, "floor"), 0.3)
    assert pieces_words(found, "m") == (
        "floor: 2 faces hold 80 % of the area; cut into 64 pieces, edges up to 0.3 m"
    )
    assert pieces_words(found.file, "m") == ""


def test_a_scan_of_small_faces_is_looked_at_once(monkeypatch):
    ball = model(shapes.icosphere(5))
    calls = []
    monkeypatch.setattr(pieces, "cut", lambda *args: calls.append(args))
    assert cut_models([ball], "auto", [EYE], BY_PIXELS)[0] is ball
    assert not calls
