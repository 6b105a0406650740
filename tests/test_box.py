"""The box of positions: bounds, wrapping, the shorter way, spreads."""

import re

import numpy as np
import pytest

from glvis.search.box import Box

ROOM = Box([[0, 10], [0, 360], [5, 5]], [False, True, True])


def test_what_leaves_the_bounds_is_put_on_them_and_angles_wrap():
    x = np.array([[-1.0, 370.0, 7.0], [11.0, -10.0, 3.0], [4.0, 725.0, 5.0]])
    assert ROOM.inside(x).tolist() == [[0, 10, 5], [10, 350, 5], [4, 5, 5]]


def test_wrapping_respects_a_period_that_does_not_start_at_zero():
    assert Box([[-180, 180]], [True]).inside(np.array([[190.0], [-540.0]])).tolist() == [
        [-170],
        [-180],
    ]


def test_wrapped_positions_never_leave_the_bounds_by_rounding(rng):
    low = rng.uniform(-1e3, 1e3, 50)
    box = Box(np.c_[low, low + rng.uniform(1e-3, 1e3, 50)], np.ones(50, bool))
    x = np.r_[rng.normal(0, 1e4, (200, 50)), [low - 1e-13, low, low + box.range]]
    inside = box.inside(x)
    assert (inside >= box.bounds[:, 0]).all()
    assert (inside <= box.bounds[:, 1]).all()


def test_the_way_between_two_angles_is_the_shorter_one():
    to = np.array([[9.0, 350.0, 5.0], [1.0, 20.0, 5.0], [5.0, 100.0, 5.0]])
    at = np.array([[1.0, 10.0, 5.0], [9.0, 350.0, 5.0], [5.0, 10.0, 5.0]])
    assert ROOM.shortest(to - at).tolist() == [[8, -20, 0], [-8, 30, 0], [0, 90, 0]]


def test_going_the_shorter_way_arrives(rng):
    box = Box([[0, 360], [-90, 270]], [True, True])
    at, to = box.uniform(100, rng), box.uniform(100, rng)
    way = box.shortest(to - at)
    np.testing.assert_allclose(box.inside(at + way), to, atol=1e-10)
    assert (np.abs(way) <= 180).all()


def test_sobol_points_put_one_into_each_cell_of_a_grid(rng):
    points = Box([[0, 8], [0, 8]]).sobol(64, rng)
    assert len({(int(x), int(y)) for x, y in points}) == 64


@pytest.mark.parametrize("n", [0, 1, 3, 100])
@pytest.mark.parametrize("how", ["sobol", "uniform"])
def test_a_spread_has_as_many_points_as_asked_for_all_in_the_box(how, n, rng):
    points = getattr(ROOM, how)(n, rng)
    assert points.shape == (n, 3)
    assert np.array_equal(ROOM.inside(points), points)


def test_user_positions_are_put_into_the_box_one_or_many():
    assert ROOM.checked([12, -90, 5], 2).tolist() == [[10, 270, 5]]
    assert ROOM.checked([[1, 2, 5], [3, 4, 5]], 2).tolist() == [[1, 2, 5], [3, 4, 5]]


@pytest.mark.parametrize(
    ("start", "message"),
    [
        ([1, 2], "start must have shape (K, 3) with K <= 2, got (2,)"),
        (np.zeros((3, 3)), "start must have shape (K, 3) with K <= 2, got (3, 3)"),
        (np.zeros((1, 1, 3)), "start must have shape (K, 3) with K <= 2, got (1, 1, 3)"),
        ([1, np.nan, 3], "start must be finite"),
    ],
)
def test_bad_user_positions_are_refused(start, message):
    with pytest.raises(ValueError, match=re.escape(message)):
        ROOM.checked(start, 2)


@pytest.mark.parametrize(
    ("bounds", "periodic", "message"),
    [
        ([0, 1], None, "bounds must have shape (D, 2) with D > 0, got (2,)"),
        (np.zeros((0, 2)), None, "bounds must have shape (D, 2) with D > 0, got (0, 2)"),
        ([[0, 1], [3, 2]], None, "bounds must be finite, the smaller first"),
        ([[0, np.inf]], None, "bounds must be finite, the smaller first"),
        ([[np.nan, 1]], None, "bounds must be finite, the smaller first"),
        ([[0, 1]], [True, False], "periodic must have shape (1,), got (2,)"),
    ],
)
def test_bad_bounds_are_refused(bounds, periodic, message):
    with pytest.raises(ValueError, match=re.escape(message)):
        Box(bounds, periodic)
