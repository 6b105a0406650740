"""The guess that renders no map: exact where nothing hides anything, the same in any company."""

import numpy as np
import pytest
from shapes import icosphere, write_off
from small_study import SMALL, write_small_study

from glvis.inputs.study import load_study
from glvis.optim.evaluator import Evaluator
from glvis.optim.guess import Guess

# one convex body seen from around it, by centres of mass: only the filters decide
CONVEX = (
    SMALL.replace('"ball.off", "ring.off"', '"tiny.off"')
    .replace('obstacles = ["post.off"]', "")
    .replace('resolution = "sensor"', 'criterion = "centroid"')
)


def positions(study, n, rng):
    low, high = study.rig.bounds.T
    return low + (high - low) * rng.random((n, len(low)))


@pytest.mark.parametrize("kind", ["of1", "of3"])
def test_guess_is_the_value_where_nothing_hides_anything(tmp_path, rng, kind):
    study = load_study(write_small_study(tmp_path, rng, CONVEX), [f"objective.kind={kind}"])
    x = positions(study, 100, rng)
    with Evaluator(study) as evaluator:
        guess = Guess(study)
        assert np.allclose(guess(x, None), evaluator(x), atol=1e-12)
        of_one = [float(values[0]) for values in evaluator.each(x, (1,))]
        assert np.allclose(guess(x, (1,)), of_one, atol=1e-12)


@pytest.mark.parametrize("by_area", ["false", "true"])
def test_guess_of_counts_knows_how_many_faces_it_does_not_look_at(tmp_path, rng, by_area):
    two_sizes = CONVEX.replace('"tiny.off"', '"tiny.off", "fine.off"')
    path = write_small_study(tmp_path, rng, two_sizes)
    write_off(tmp_path / "fine.off", icosphere(4))
    study = load_study(path, ["objective.normalize=false", f"objective.by_area={by_area}"])
    x = positions(study, 100, rng)
    with Evaluator(study) as evaluator:
        values, guesses = evaluator(x), Guess(study)(x, None)
    assert 0.9 < guesses.mean() / values.mean() < 1.1
    assert np.corrcoef(guesses, values)[0, 1] > 0.9


def test_guess_looks_at_some_faces_only_and_ranks_as_maps_do(tmp_path, rng, monkeypatch):
    monkeypatch.setattr("glvis.optim.guess._FACES", 100)
    study = load_study(write_small_study(tmp_path, rng), ["objective.kind=of1"])
    x = positions(study, 200, rng)
    with Evaluator(study) as evaluator:
        values, guesses = evaluator(x), Guess(study)(x, None)
        assert evaluator.maps_rendered == 2 * 2 * 200  # none of them for the guess
    ranks = [np.argsort(np.argsort(v)) for v in (values, guesses)]
    assert np.corrcoef(*ranks)[0, 1] > 0.6


def test_guess_of_a_position_does_not_depend_on_its_neighbours(tmp_path, rng):
    study = load_study(write_small_study(tmp_path, rng))
    x, guess = positions(study, 150, rng), Guess(study)
    together = guess(x, None)
    assert together.shape == (150,)
    assert [float(guess(row[None], None)[0]) for row in x[::10]] == together[::10].tolist()
    assert np.array_equal(guess(np.concatenate([x, x[:1]]), None)[[0, -1]], together[[0, 0]])


def test_guess_ranks_better_after_it_has_learned_from_maps(tmp_path, rng):
    study = load_study(write_small_study(tmp_path, rng), ["objective.kind=of1"])
    x, taught = positions(study, 200, rng), positions(study, 300, rng)
    guess, noted = Guess(study), []
    with Evaluator(study) as evaluator:
        values = evaluator(x)
        before = guess(x, None)
        list(evaluator.each(taught, None, lambda maps: noted.append(guess.sample(maps))))
    which = guess.unknown(taught, None)
    guess.learn(taught, None, which, np.array(noted)[which[:, 0], which[:, 1]])
    far_off = [np.abs(guessed - values).mean() for guessed in (before, guess(x, None))]
    assert far_off[1] < 0.5 * far_off[0]
    # sampled faces of a pose it was taught are known; only those between the filters differ
    assert np.abs(guess(taught, None) - evaluator_values(study, taught)).mean() < far_off[1]


def evaluator_values(study, x):
    with Evaluator(study) as evaluator:
        return evaluator(x)


def test_guess_learns_each_pose_once_and_no_more_than_it_may(tmp_path, rng, monkeypatch):
    monkeypatch.setattr("glvis.optim.guess._MOST_POSES", 5)
    study = load_study(write_small_study(tmp_path, rng))
    guess, x = Guess(study), positions(study, 3, rng)
    x[1, :2] = x[0, :2]  # the first sensor stays
    which = guess.unknown(np.concatenate([x, x]), None)
    assert which.tolist() == [[0, 0], [0, 1], [1, 1], [2, 0], [2, 1]]
    guess.learn(x, None, which[:3], np.zeros((3, guess.faces), bool))
    assert guess.unknown(x, None).tolist() == [[2, 0], [2, 1]]
    assert guess.unknown(x, (1,)).tolist() == [[2, 0]]
    assert not guess.is_full
    more = positions(study, 9, rng)
    which = guess.unknown(more, None)
    assert len(which) == 2
    guess.learn(more, None, which, np.zeros((2, guess.faces), bool))
    assert guess.is_full and len(guess.unknown(x, None)) == 0
