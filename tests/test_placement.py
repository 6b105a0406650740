"""The main loop: a search's result is its best, complete, and never below the start."""

import os
import signal

import numpy as np
import pytest
from support.ball_and_ring import write_ball_and_ring

from glvis.evaluation.evaluator import Evaluator
from glvis.search.placement import evaluate_poses, place_sensors
from glvis.study.loading import load_study


@pytest.fixture
def study(tmp_path, rng):
    return load_study(write_ball_and_ring(tmp_path, rng))


def assert_complete(placement):
    """Check that all parts of a placement tell the same story."""
    study = placement.study
    assert np.array_equal(study.rig.poses(placement.position), placement.camera_to_world)
    with Evaluator(study) as evaluator:
        assert evaluator(placement.position)[0] == placement.value
        maps = evaluator.visibility(placement.position)
    assert [found.model_name for found in placement.maps] == [m.name for m in study.models]
    for found, expected in zip(placement.maps, maps, strict=True):
        assert np.array_equal(found.visible, expected.visible)
    assert study.objective.aggregated(placement.values_by_model) == placement.value
    assert placement.value >= placement.start_value


def test_search_ends_with_its_best_position_and_that_position_s_maps(study):
    placement = place_sensors(study)
    assert_complete(placement)
    assert placement.value == placement.trace[-1].best > placement.start_value
    assert placement.stop_reason.startswith("finished: all 4 iterations done")
    assert [row.iteration for row in placement.trace] == [0, 1, 2, 3, 4]
    assert placement.evaluations == 6 * 5
    # two sensors on two models; what stays on a bound or is met again is not drawn again
    assert 0 < placement.maps_rendered <= 4 * placement.evaluations
    assert placement.maps_rendered == placement.trace[-1].maps_rendered
    assert placement.workers == 1 and placement.warnings == () and placement.seed == 3


def test_same_seed_finds_the_same_and_another_seed_does_not(study, tmp_path):
    first, second = place_sensors(study), place_sensors(study)
    assert np.array_equal(first.position, second.position)
    assert [row[:-1] for row in first.trace] == [row[:-1] for row in second.trace]
    other = place_sensors(load_study(study.path, ["swarm.seed=4"]))
    assert not np.array_equal(first.position, other.position)


def test_progress_is_told_after_each_iteration(study):
    told = []
    placement = place_sensors(study, on_iteration=told.append)
    assert [p.iteration for p in told] == [0, 1, 2, 3, 4]
    assert {(p.limit, p.most) for p in told} == {("iterations", 4)}
    assert [p.best for p in told] == [row.best for row in placement.trace]
    assert [p.evaluations for p in told] == [6, 12, 18, 24, 30]
    assert told[-1].seconds_left == 0 < told[0].seconds_left
    assert all(p.evaluations_per_second > 0 for p in told)


def test_study_without_variables_is_only_evaluated(tmp_path, rng):
    fixed = ["turn=10", "height=1", "azimuth=60", "elevation=20"]
    path = write_ball_and_ring(tmp_path, rng)
    placement = place_sensors(load_study(path, [f"variables.{text}" for text in fixed]))
    assert_complete(placement)
    assert placement.stop_reason == "evaluated only"
    assert placement.trace == () and placement.position.shape == (0,)
    assert placement.value == placement.start_value and placement.evaluations == 1


def test_poses_are_evaluated_as_given_or_at_the_start_or_at_a_position(study):
    at_start = evaluate_poses(study)
    assert_complete(at_start)
    assert np.array_equal(at_start.position, study.rig.start)
    given = evaluate_poses(study, at_start.camera_to_world)
    assert given.value == at_start.value
    moved = evaluate_poses(study, position=[200.0, 0.0, 90.0, 0.0])
    assert_complete(moved)
    assert moved.value != at_start.value and moved.maps_rendered == 4


def test_poses_of_a_wrong_shape_are_refused(study):
    with pytest.raises(ValueError, match=r"poses must be finite and of shape \(2, 4, 4\)"):
        evaluate_poses(study, np.eye(4))
    with pytest.raises(ValueError, match=r"a position must have shape \(P, 4\), got \(3,\)"):
        evaluate_poses(study, position=[0.0, 0.0, 0.0])


@pytest.mark.parametrize(
    ("number", "word"), [(signal.SIGINT, "Ctrl-C"), (signal.SIGTERM, "SIGTERM")]
)
def test_signal_ends_the_run_with_the_best_so_far(study, number, word):
    def interrupt(progress):
        if progress.iteration == 1:
            os.kill(os.getpid(), number)

    before = signal.getsignal(number)
    placement = place_sensors(study, on_iteration=interrupt)
    assert signal.getsignal(number) is before
    assert_complete(placement)
    assert placement.stop_reason == f"interrupted: {word}"
    assert [row.iteration for row in placement.trace] == [0, 1]
    assert placement.value == placement.trace[-1].best


def test_interrupt_in_the_first_iteration_gives_the_start(study, monkeypatch):
    each = Evaluator.each

    def interrupted(self, positions, *rest):
        for place, values in enumerate(each(self, positions, *rest)):
            if place == 2:
                os.kill(os.getpid(), signal.SIGINT)
            yield values

    monkeypatch.setattr(Evaluator, "each", interrupted)
    placement = place_sensors(study)
    monkeypatch.undo()
    assert_complete(placement)
    assert placement.stop_reason == "interrupted: Ctrl-C"
    assert placement.trace == () and placement.evaluations == 0
    assert np.array_equal(placement.position, study.rig.start)
    assert placement.value == placement.start_value


def test_second_interrupt_is_not_held_back(study):
    def interrupt(progress):
        os.kill(os.getpid(), signal.SIGINT)
        os.kill(os.getpid(), signal.SIGINT)

    with pytest.raises(KeyboardInterrupt):
        place_sensors(study, on_iteration=interrupt)
    assert signal.getsignal(signal.SIGINT) is signal.default_int_handler


def test_interrupt_that_somebody_raises_ends_the_run_well(study):
    def interrupt(progress):
        raise KeyboardInterrupt

    placement = place_sensors(study, on_iteration=interrupt)
    assert_complete(placement)
    assert placement.stop_reason == "interrupted: Ctrl-C" and len(placement.trace) == 1


def test_software_threads_are_a_choice_of_the_user_or_left_alone(study, monkeypatch):
    evaluate_poses(study)
    assert "LP_NUM_THREADS" not in os.environ
    monkeypatch.setenv("LP_NUM_THREADS", "1")
    evaluate_poses(study)
    assert os.environ["LP_NUM_THREADS"] == "1"


def test_public_names_are_there_and_no_others():
    import glvis

    for name in glvis.__all__:
        assert getattr(glvis, name) is not None
    with pytest.raises(AttributeError, match="module 'glvis' has no attribute 'place_cameras'"):
        _ = glvis.place_cameras
