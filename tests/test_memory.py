"""What is remembered of occlusion: eyes that stood near decide, for what they looked at."""

import numpy as np
import pytest

from glvis.optim.memory import Memory


def wall_of(eyes, targets):
    """Return whether targets (n, 3) are free from eyes (P, 3): no wall at x = 0 up to z = 1."""
    share = eyes[:, None, 0] / (eyes[:, None, 0] - targets[None, :, 0])
    height = eyes[:, None, 2] + share * (targets[None, :, 2] - eyes[:, None, 2])
    return height > 1


def test_nothing_hides_anything_as_long_as_nothing_is_known():
    assert Memory(3).free(np.zeros((2, 3))).tolist() == [[True] * 3] * 2


def test_eye_in_the_same_place_decides_for_what_it_looked_at():
    memory = Memory(3)
    far = np.array([[9.0, 0, 0], [0, 9, 0], [0, 0, 9]])
    memory.learn(far, np.ones((3, 3), bool), np.ones((3, 3), bool))
    assert memory.free(np.zeros((1, 3))).all()
    in_view = np.array([[True, True, False]])
    memory.learn(np.zeros((1, 3)), in_view, np.array([[True, False, False]]))
    assert memory.free(np.zeros((1, 3))).tolist() == [[True, False, True]]


def test_face_that_no_near_eye_looked_at_is_taken_for_free():
    memory = Memory(2)
    near, far = np.arange(16)[:, None] / 100 * np.ones(3), np.full((3, 3), 99.0)
    in_view = np.array([[False, True]] * 16)
    memory.learn(near, in_view, ~in_view & in_view)
    memory.learn(far, np.ones((3, 2), bool), np.zeros((3, 2), bool))
    assert memory.free(np.zeros((1, 3))).tolist() == [[True, False]]
    assert memory.free(far[:1]).tolist() == [[False, False]]


@pytest.mark.parametrize(("seen_by", "free"), [(0, False), (4, False), (6, True), (16, True)])
def test_face_is_free_where_a_third_of_the_votes_say_so(seen_by, free):
    turn = np.arange(16) * 2 * np.pi / 16  # all at the same distance
    eyes = np.stack([np.cos(turn), np.sin(turn), 0 * turn], axis=1)
    memory = Memory(1)
    memory.learn(eyes, np.ones((16, 1), bool), (np.arange(16) < seen_by)[:, None])
    assert memory.free(np.zeros((1, 3))).tolist() == [[free]]


def test_it_does_not_matter_in_how_many_lots_it_learns(rng):
    eyes, seen = rng.random((400, 3)), rng.random((400, 5)) < 0.5
    in_view = seen | (rng.random((400, 5)) < 0.5)
    at_once, one_by_one = Memory(5), Memory(5)
    at_once.learn(eyes, in_view, seen)
    for k in range(400):
        one_by_one.learn(eyes[k : k + 1], in_view[k : k + 1], seen[k : k + 1])
        one_by_one.free(eyes[:1])
    places = rng.random((30, 3))
    assert np.array_equal(at_once.free(places), one_by_one.free(places))


def test_wall_is_learned_from_what_it_hid(rng):
    targets = rng.uniform([-4, -2, 0], [-1, 2, 2], (60, 3))
    eyes, places = rng.uniform([1, -2, 0], [4, 2, 4], (2, 500, 3))
    in_view = rng.random((500, 60)) < 0.3  # each looks at some only
    memory = Memory(60)
    memory.learn(eyes, in_view, in_view & wall_of(eyes, targets))
    wrong = memory.free(places) != wall_of(places, targets)
    assert 0.2 < wall_of(places, targets).mean() < 0.8
    assert wrong.mean() < 0.06
