"""Points and what hides them: closed forms, and every triangle tried against every point."""

import numpy as np
import pytest
from support import shapes
from support.one_sensor import sensor

from glvis.problem.scene import Model
from glvis.visibility import occlusion, points
from glvis.visibility.clusters import Clusters
from glvis.visibility.filters import may_pass
from glvis.visibility.occlusion import unhidden
from glvis.visibility.points import Large, beside, grid_size, spans

NEAR = 0.01
# The frame here: x right, y up, and depth; a triangle is three corners.
PLATE = np.array([[-1.0, -1, 2], [1, -1, 2], [0, 1, 2]])  # 2 before the eye, around its axis
AROUND = [[-9, -9, -3], [9, -9, -3], [0, 1, 2]]  # from behind and below the eye to before it
FRONT = np.array([0.0, 0.0, 4.0])


def columns(triangles):
    """Return triangles (T, 3, 3), corners first, as the functions take them."""
    return np.moveaxis(np.asarray(triangles, dtype=float).reshape(-1, 3, 3), 0, 2)


def hides(triangle, point=FRONT, near=NEAR):
    """Return whether a triangle hides a point, the same by either side."""
    point = np.asarray(point, dtype=float)[:, None]
    free = {bool(unhidden(point, columns(t), near)[0]) for t in (triangle, triangle[::-1])}
    assert len(free) == 1
    return not free.pop()


def by_force(some, triangles, near):
    """Return which points (P, 3) are free: every ray is met with every plane, one by one."""
    free = []
    for point in some:
        at = []
        for a, b, c in triangles:
            # a + u (b - a) + v (c - a) = t point
            matrix = np.stack([b - a, c - a, -point], axis=1)
            if abs(np.linalg.det(matrix)) > 1e-12:
                u, v, t = np.linalg.solve(matrix, -a)
                if u >= 0 and v >= 0 and u + v <= 1 and t * point[2] > near and t < 1 - 1e-7:
                    at.append(t)
        free.append(not at)
    return np.array(free)


@pytest.mark.parametrize(
    ("triangle", "point", "is_hidden"),
    [
        (PLATE, (0, 0, 4), True),
        (PLATE, (1.9, -1.9, 4), True),  # the ray meets it near its corner
        (PLATE, (2.1, -1.9, 4), False),
        (PLATE, (0, 3, 4), False),
        (PLATE, (0, 0, 1), False),  # it lies behind the point
        (PLATE, (0, 0, 2), False),  # the point lies on it
        (PLATE, (0, 0, 2 * (1 + 2e-7)), True),
        (PLATE, (0, 0, 2 * (1 + 5e-8)), False),  # float32 would not know
        ([[0, -1, 1], [0, 1, 1], [0, 0, 3]], (0, 0, 4), False),  # edge-on
        ([[-1, -1, 2], [1, -1, 2], [0, -1, 2]], (0, -2, 4), False),  # without area
        (PLATE * [1, 1, -1], (0, 0, 4), False),  # behind the eye
        (AROUND, (0, 0, 4), True),  # crosses the axis 1.5 before the eye
        (AROUND, (0, 0, 1), False),
        (AROUND, (0, 3, 4), False),
        (AROUND, (0, -4, 4), True),  # 0.25 below the eye
        (AROUND, (50, -1, 4), False),
    ],
)
def test_a_triangle_hides_what_its_plane_and_edges_say(triangle, point, is_hidden):
    assert hides(triangle, point) == is_hidden


def test_what_is_nearer_than_near_hides_nothing():
    small = 0.01 * PLATE  # at depth 0.02
    assert hides(small, near=0.019) and not hides(small, near=0.021)
    # one that crosses: it is where the ray meets it that counts, 1.5 before the eye
    assert hides(AROUND, near=1.49) and not hides(AROUND, near=1.51)


def test_points_of_a_plane_are_free_of_all_triangles_in_it(rng):
    turn = np.linalg.qr(rng.normal(size=(3, 3)))[0]
    flat = rng.uniform(-1, 1, size=(80, 3, 3)) * [1, 1, 0]
    some = rng.uniform(-1, 1, size=(300, 3)) * [1, 1, 0]
    flat, some = (values @ turn.T + [0.3, -0.2, 4] for values in (flat, some))
    assert unhidden(some.T, columns(flat), NEAR).all()
    # the same a little farther away are hidden by nearly all that cover them
    assert np.mean(unhidden(1.001 * some.T, columns(flat), NEAR)) < 0.3


def test_nothing_is_seen_between_triangles_that_share_an_edge(rng):
    for _ in range(10):
        turn = np.linalg.qr(rng.normal(size=(3, 3)))[0]
        corners = shapes.corners(shapes.moved(shapes.plate(2, cells=(9, 7)), rotation=turn))
        corners = corners + np.array([0.1, 0.2, 3])
        # through edges, corners and between them, three times as far
        weights = rng.choice([0.0, 0.0, 0.3, 1.0], size=(1000, 3)) + np.array([0, 0, 1e-9])
        weights /= weights.sum(axis=1, keepdims=True)
        face = rng.integers(len(corners), size=1000)
        through = np.einsum("pk,pkx->px", weights, corners[face])
        rim = np.abs((through - [0.1, 0.2, 3]) @ turn)[:, :2].max(axis=1) > 0.999
        assert not unhidden(3 * through[~rim].T, columns(corners), NEAR).any()


@pytest.mark.parametrize("seed", range(4))
def test_no_point_and_triangle_are_passed_over(seed):
    rng = np.random.default_rng(seed)
    # around the eye, and before it, by turns
    triangles = shapes.corners(shapes.soup(rng, 60, 0.4, 2.0)) + np.array([0, 0, 2.0 * (seed % 2)])
    some = rng.uniform([-2, -2, 0.1], [2, 2, 4], size=(150, 3))
    free = by_force(some, triangles, NEAR)
    assert 0.05 < free.mean() < 0.95
    assert np.array_equal(unhidden(some.T, columns(triangles), NEAR), free)


def test_many_pairs_are_tested_in_parts(rng, monkeypatch):
    triangles = columns(shapes.corners(shapes.soup(rng, 60, 0.4, 2.0)))
    some = rng.uniform([-2, -2, 0.1], [2, 2, 4], size=(150, 3)).T
    whole = unhidden(some, triangles, NEAR)
    monkeypatch.setattr(occlusion, "_PAIRS", 7)
    assert np.array_equal(whole, unhidden(some, triangles, NEAR))


@pytest.mark.parametrize("number", [0, 1, 5])
def test_points_without_extent_and_no_points_at_all(number):
    same = np.repeat(FRONT[:, None], number, axis=1)
    assert unhidden(same, columns(PLATE), NEAR).tolist() == [False] * number
    assert unhidden(same, np.zeros((3, 3, 0)), NEAR).tolist() == [True] * number


@pytest.mark.parametrize("scale", [1e-6, 1e6])
def test_the_unit_of_length_does_not_matter(scale, rng):
    triangles = columns(shapes.corners(shapes.soup(rng, 60, 0.4, 2.0)))
    some = rng.uniform([-2, -2, 0.1], [2, 2, 4], size=(150, 3)).T
    scaled = unhidden(scale * some, scale * triangles, scale * NEAR)
    assert np.array_equal(unhidden(some, triangles, NEAR), scaled)


@pytest.mark.parametrize("tan", [(1.0, 1.0), (1.0, 0.5), (0.2, 0.6)])
@pytest.mark.parametrize("n", [1, 30, 5000])
def test_a_grid_has_cells_as_large_as_faces_within_bounds(n, tan):
    across, up = np.degrees(2 * np.arctan(tan))
    device = sensor(hfov_deg=across, vfov_deg=up, far=10)
    side = 20 * max(tan) / n  # of a face: n of them span the longer side at maxD
    low, high = np.zeros(3), np.array([side, 0, 0])
    model = Model.from_arrays("f", [low, high, [side / 2, side * 0.75**0.5, 0]], [[0, 1, 2]])
    columns_, rows = grid_size(device.lens.windows.tan_half, model, device.max_distance)
    longer = min(max(points._CELLS_A_SIDE * n, points._FEWEST), points._MOST)
    assert max(columns_, rows) in (np.ceil(longer - 1e-6), np.ceil(longer + 1e-6))
    assert abs(columns_ * tan[1] - rows * tan[0]) <= 1


def test_a_face_spans_the_larger_share_of_width_and_height():
    corners = columns([[[0, 0, 2], [1, 0, 2], [0, 1, 2]], [[0, 0, 1], [1, 0, 2], [0, -1, 1]]])
    assert np.allclose(spans(corners, np.array([[1.0], [1.0]]), 0.1), [0.25, 0.5])
    assert np.allclose(spans(corners, np.array([[0.1], [0.5]]), 0.1), [2.5, 2.5])
    assert np.allclose(spans(corners, np.array([[0.1, 1.0], [0.5, 2.0]]), 0.1), [2.5, 0.25])


def test_a_face_before_near_spans_everything():
    corners = columns([PLATE, AROUND, PLATE])
    assert spans(corners, np.ones((2, 1)), 0.5).tolist() == [0.5, np.inf, 0.5]
    assert spans(corners, np.ones((2, 1)), np.array([2.0, 2.0, 2.1])).tolist() == [
        *(0.5, np.inf, np.inf)
    ]


@pytest.mark.parametrize(
    ("triangle", "expected"),
    [
        (PLATE, True),
        (PLATE + np.array([2.9, 0, 0]), True),
        (PLATE + np.array([3.1, 0, 0]), False),
        (PLATE - np.array([0, 3.1, 0]), False),
        (PLATE * 4, True),
        (PLATE + np.array([0, 0, 7]), False),  # beyond maxD
        (PLATE - np.array([0, 0, 1.1]), False),  # nearer than minD
        (PLATE * [1, 1, -1], False),
        (AROUND, True),
    ],
)
def test_a_face_reaches_the_image_and_the_range_or_not(triangle, expected):
    found = may_pass(columns(triangle), np.ones((2, 1)), np.array([[1.0], [8.0]]))
    assert found.tolist() == [expected]


@pytest.mark.parametrize("seed", range(4))
def test_no_face_with_a_point_in_the_image_is_said_to_miss_it(seed):
    rng = np.random.default_rng(seed)
    triangles = shapes.corners(shapes.soup(rng, 400, 1.0, 4.0))
    weights = rng.dirichlet(np.ones(3), size=200)
    x, y, depth = np.moveaxis(np.einsum("pk,tkx->tpx", weights, triangles), 2, 0)
    inside = (np.abs(x) <= 0.5 * depth) & (np.abs(y) <= 0.3 * depth) & (depth >= 1) & (depth <= 4)
    found = may_pass(columns(triangles), np.array([[0.5], [0.3]]), np.array([[1.0], [4.0]]))
    assert inside.any() and found[inside.any(axis=1)].all()
    assert found.mean() < 0.5


def test_faces_beside_those_seen_share_a_corner_with_one():
    clusters = Clusters.of(Model.from_arrays("plate", *shapes.plate(3, cells=(3, 1))))
    seen = np.zeros((3, 6), dtype=bool)
    seen[1, 0] = True  # lower right of the first cell
    all_faces, nothing = np.arange(6), np.zeros(0, dtype=int)
    by_second = beside(clusters, seen, np.full(6, 1), all_faces)
    assert by_second.tolist() == [True, True, True, True, False, False]
    assert beside(clusters, seen, np.array([1, 2, 1]), np.array([5, 1, 1])).tolist() == [0, 0, 1]
    assert not beside(clusters, seen, np.zeros(6, dtype=int), all_faces).any()
    assert not len(beside(clusters, seen, nothing, nothing))


def test_large_faces_are_looked_at_in_few_points_and_some_in_many():
    large = Large(0.1, 0.4)
    shares = np.array([0.09, 0.1, 0.39, 0.4, np.inf])
    touches = np.array([[False] * 5, [True] * 5])
    for some in touches:
        few = large.are_looked_at(large.few, shares, some)
        assert few.tolist() == [False, True, True, True, True]
    alone, beside_one = (large.are_looked_at(large.many, shares, some) for some in touches)
    assert alone.tolist() == [False, False, False, True, True]
    assert beside_one.tolist() == [False, True, True, True, True]
