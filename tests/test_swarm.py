"""The particle swarm: hand-computed steps, known optima, stop rules, exact resume, no traces."""

import json
import os
import re
import subprocess
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from glvis.search.swarm import Swarm, SwarmOptions, _best_neighbours

SMALL = SwarmOptions(particles=20, iterations=60, stall_iterations=60, initial_span=1.0, seed=3)
CUBE = np.tile([-5.0, 5.0], (3, 1))


def sphere(x):
    """Best at (1, -2, 3), where it is 0."""
    return -((x - [1.0, -2.0, 3.0]) ** 2).sum(axis=1)


def run(swarm, function=sphere):
    while swarm.stop_reason is None:
        swarm.tell(function(swarm.ask()))
    return swarm


def numbers(swarm):
    """Everything that decides how a run goes on, times aside."""
    state = swarm.state()
    scalars = json.loads(str(state.pop("json")))
    del scalars["seconds"], scalars["options"]
    scalars["trace"] = [row[:-1] for row in scalars["trace"]]
    return {name: a.tolist() for name, a in state.items()} | scalars


def generator_of(swarm):
    """A generator that will draw what the swarm will draw next."""
    rng = np.random.default_rng()
    rng.bit_generator.state = json.loads(str(swarm.state()["json"]))["generator"]
    return rng


class Clock:
    """A clock that stands until it is moved."""

    def __init__(self):
        self.now = 100.0

    def __call__(self):
        return self.now


# One iteration


def test_an_iteration_is_the_one_computed_by_hand():
    """Four particles, two variables; steps 1 to 5 of MATLAB's documentation, one by one."""
    options = SwarmOptions(particles=4, initial_span=3.0, seed=5, min_neighbors_fraction=0.5)
    swarm = Swarm([[0, 10], [0, 10]], options=options)
    x = swarm.ask()
    v = swarm.state()["velocity"]
    swarm.tell([1.0, 3.0, 2.0, 0.0])
    rng = generator_of(swarm)
    lots = rng.random((4, 4))
    u1 = rng.random((4, 2))
    u2 = rng.random((4, 2))
    order = [1, 2, 0, 3]  # from best to worst
    moved, velocity = swarm.ask(), swarm.state()["velocity"]
    left = 0
    for i in range(4):
        others = sorted((j for j in range(4) if j != i), key=lambda j: lots[i, j])[:2]
        g = min(others, key=order.index)
        for k in range(2):
            # The first personal best is the first position, so that its pull is zero here.
            expected = 1.5 * v[i, k] + 1.49 * u2[i, k] * (x[g, k] - x[i, k])
            at = x[i, k] + expected
            if not 0 <= at <= 10:
                left += 1
                at, expected = min(max(at, 0), 10), 0
            assert moved[i, k] == pytest.approx(at, abs=1e-12)
            assert velocity[i, k] == pytest.approx(expected, abs=1e-12)
    assert left > 0  # else the bounds were not put to the test
    # Second iteration: particle 0 has moved to a worse place and is drawn back to its best.
    swarm.tell([0.5, 4.0, 3.0, 1.0])
    rng = generator_of(swarm)
    rng.random((4, 4))
    u1 = rng.random((4, 2))
    social = replace(options, social=0.0)
    alone = Swarm.from_state(swarm.state(), social)
    target = moved[0] + 1.5 * velocity[0] + 1.49 * u1[0] * (x[0] - moved[0])
    np.testing.assert_allclose(alone.ask()[0], np.clip(target, 0, 10), atol=1e-12)


def test_without_attraction_a_particle_flies_straight_on_its_inertia():
    options = SwarmOptions(particles=8, cognitive=0.0, social=0.0, inertia=(0.5, 0.5))
    swarm = Swarm(CUBE * 1e3, options=options)
    x, v = swarm.ask(), swarm.state()["velocity"]
    swarm.tell(sphere(x))
    np.testing.assert_allclose(swarm.ask(), x + v / 2, atol=1e-9)
    swarm.tell(sphere(x))
    np.testing.assert_allclose(swarm.ask(), x + v / 2 + v / 4, atol=1e-9)


def test_an_angle_flies_on_through_the_end_of_its_turn_and_keeps_its_velocity():
    options = SwarmOptions(particles=50, cognitive=0.0, social=0.0, inertia=(1.0, 1.0))
    swarm = Swarm([[0, 360]], [True], options=options)
    x, v = swarm.ask(), swarm.state()["velocity"]
    for turn in range(1, 30):
        swarm.tell(np.zeros(50))
        np.testing.assert_allclose(swarm.ask(), (x + turn * v) % 360, atol=1e-9)
    np.testing.assert_allclose(swarm.state()["velocity"], v, atol=1e-9)


def test_a_particle_looks_at_as_many_others_as_the_neighbourhood_has_and_never_at_itself(rng):
    # Costs rise with the index, so the best of n - 1 - k others has an index of at most k + 1.
    cost = np.arange(6.0)
    for size in (1, 2, 3, 4, 5, 6):
        for _ in range(50):
            best = _best_neighbours(cost, size, rng)
            assert (best != np.arange(6)).all()
            assert best.max() <= 6 - min(size, 5)
    assert _best_neighbours(cost, 6, rng).tolist() == [1, 0, 0, 0, 0, 0]


@pytest.mark.parametrize("cost", [np.zeros(5), np.full(5, np.inf)])
def test_on_a_plateau_every_other_particle_is_followed_equally_often(cost, rng):
    followed = np.zeros((5, 5))
    for _ in range(2000):
        followed[np.arange(5), _best_neighbours(cost, 2, rng)] += 1
    assert (np.diag(followed) == 0).all()
    off = followed[~np.eye(5, dtype=bool)]
    assert np.abs(off - 500).max() < 100  # five standard deviations


def test_inertia_and_neighbourhood_follow_the_stall_counter():
    """Step 6 by hand: c counts iterations without gain; W halves above 5, doubles below 2."""
    options = SwarmOptions(particles=10, min_neighbors_fraction=0.4, stall_iterations=99)
    gains = [0, 0, 0, 0, 0, 0, 0, 1, 1, 1, 1, 1, 1, 0]
    #          c: 1   2   3   4   5   6     7      6     5     4     3     2    1    2
    inertia = [1.5, 1.5, 1.5, 1.5, 1.5, 0.75, 0.375, 0.2, 0.2, 0.2, 0.2, 0.2, 0.4, 0.4]
    neighbours = [8, 10, 10, 10, 10, 10, 10, 4, 4, 4, 4, 4, 4, 8]
    assert _adaptation(options, gains) == (inertia, neighbours)


def test_on_improvement_adapts_the_inertia_after_gains_only():
    options = SwarmOptions(
        particles=10, stall_iterations=99, inertia_update="on_improvement", inertia=(0.2, 1.5)
    )
    gains = [0, 0, 0, 0, 0, 0, 0, 1, 1, 1, 1, 1, 1, 0]
    inertia = [1.5] * 7 + [0.75, 0.75, 0.75, 0.75, 0.75, 1.5, 1.5]
    assert _adaptation(options, gains)[0] == inertia


def _adaptation(options, gains):
    """Inertia and neighbourhood after each iteration that gains (1) or does not (0)."""
    swarm = Swarm(CUBE, options=options)
    best = 0.0
    for gain in [0, *gains]:
        swarm.ask()
        best += gain
        swarm.tell(np.full(options.particles, best))
    swarm.ask()
    swarm.tell(np.full(options.particles, best))
    rows = swarm.trace[2:]
    assert swarm.trace[1].inertia == options.inertia[1]
    return [row.inertia for row in rows], [row.neighbours for row in rows]


# The first swarm


@pytest.mark.parametrize("initial", ["sobol", "uniform"])
def test_the_start_is_the_first_particle_and_the_rest_is_spread(initial):
    start = [[1.0, 2.0, 3.0], [-9.0, 9.0, 0.0]]
    first = Swarm(CUBE, start=start, options=replace(SMALL, initial=initial)).ask()
    assert first[:2].tolist() == [[1, 2, 3], [-5, 5, 0]]  # put on the bounds
    assert (np.abs(first) <= 5).all()
    assert len(np.unique(first[2:], axis=0)) == 18


@pytest.mark.parametrize("initial", ["sobol", "uniform"])
def test_first_positions_cover_the_bounds_whatever_the_span(initial):
    options = SwarmOptions(particles=400, initial_span=0.5, initial=initial)
    first = Swarm(CUBE, options=options).ask()
    assert np.abs(first.mean(axis=0)).max() < 0.6  # four standard errors
    assert first.min() < -4.8
    assert first.max() > 4.8


def test_first_speeds_are_limited_by_the_span_and_by_the_range():
    options = SwarmOptions(particles=400, initial_span=20.0)
    v = np.abs(Swarm([[0, 180], [0, 5]], options=options).state()["velocity"])
    assert (v <= [20, 5]).all()
    assert (v.max(axis=0) > [19, 4.75]).all()


def test_before_any_value_the_best_is_the_first_particle():
    swarm = Swarm(CUBE, start=[1, 2, 3], options=SMALL)
    assert swarm.best_x.tolist() == [1, 2, 3]
    assert swarm.best_value == -np.inf
    assert (swarm.iteration, swarm.evaluations, swarm.trace) == (0, 0, [])


# The search


def test_the_top_of_a_sphere_is_found():
    swarm = run(Swarm(CUBE, options=SMALL))
    assert swarm.best_value > -1e-3
    np.testing.assert_allclose(swarm.best_x, [1, -2, 3], atol=0.05)


@pytest.mark.parametrize("seed", range(3))
def test_the_top_of_a_tilted_ridge_in_six_dimensions_is_found(seed):
    rng = np.random.default_rng(seed)
    axes = np.linalg.qr(rng.normal(size=(6, 6)))[0] * [1, 2, 3, 5, 7, 10]
    top = rng.uniform(-50, 50, 6)

    def ridge(x):
        return -(((x - top) @ axes) ** 2).sum(axis=1)

    options = SwarmOptions(particles=60, iterations=150, stall_iterations=150, seed=seed)
    swarm = run(Swarm(np.tile([-100, 100], (6, 1)), options=options), ridge)
    np.testing.assert_allclose(swarm.best_x, top, atol=0.5)


def test_a_best_on_the_bounds_is_reached_exactly():
    swarm = run(Swarm(CUBE, options=SMALL), lambda x: x @ [1.0, -1.0, 2.0])
    assert swarm.best_x.tolist() == [5, -5, 5]


@pytest.mark.parametrize("seed", range(5))
def test_the_result_is_never_worse_than_the_start(seed):
    start = [1.001, -2.0, 3.0]  # hard to beat in three iterations
    options = replace(SMALL, iterations=3, seed=seed)
    swarm = run(Swarm(CUBE, start=start, options=options))
    assert swarm.best_value >= sphere(np.array([start]))[0]


def test_the_best_is_one_that_was_asked_for_and_has_its_value():
    asked, values = [], []

    def noted(x):
        asked.extend(x.tolist())
        values.extend(sphere(x))
        return sphere(x)

    swarm = run(Swarm(CUBE, options=replace(SMALL, iterations=10)), noted)
    assert swarm.best_value == max(values)
    assert swarm.best_x.tolist() == asked[int(np.argmax(values))]
    assert swarm.evaluations == len(values) == 11 * 20
    assert [row.best for row in swarm.trace] == [max(values[: 20 * k]) for k in range(1, 12)]


def test_every_position_lies_in_the_bounds():
    bounds = np.array([[-1.0, 2.0], [0.0, 360.0], [3.0, 3.0]])
    options = replace(SMALL, initial_span=50.0)
    swarm = Swarm(bounds, [False, True, False], options=options)
    while swarm.stop_reason is None:
        x = swarm.ask()
        assert ((x >= bounds[:, 0]) & (x <= bounds[:, 1])).all()
        swarm.tell(-np.abs(x[:, 1] - 359))


def test_a_nan_is_never_a_best_and_pulls_nobody():
    def half_broken(x):
        return np.where(x[:, 0] > 0, np.nan, sphere(x))

    swarm = run(Swarm(CUBE, start=[4, 4, 4], options=SMALL), half_broken)
    assert swarm.best_x[0] <= 0
    assert swarm.best_value == pytest.approx(-1.0, abs=0.05)  # at (0, -2, 3)
    assert all(np.isfinite(row[1:4]).all() for row in swarm.trace)


def test_a_swarm_without_any_value_ends_with_its_start_and_minus_infinity():
    options = replace(SMALL, stall_iterations=4)
    swarm = run(Swarm(CUBE, start=[1, 2, 3], options=options), lambda x: np.full(len(x), np.nan))
    assert swarm.best_value == -np.inf
    assert swarm.best_x.tolist() == [1, 2, 3]
    assert swarm.stop_reason == "stalled: the best value did not change over 4 iterations"
    assert np.isnan(swarm.trace[-1].mean)
    # The first swarm has nothing to be compared with: the neighbourhood grows from the second on.
    assert [row.neighbours for row in swarm.trace] == [8, 8, 16, 20, 20]
    assert numbers(Swarm.from_state(swarm.state()))["best_x"] == [1, 2, 3]


def test_an_angle_is_searched_across_the_end_of_its_turn():
    """Two particles left and right of 0 degrees; the way between them leads across 0."""
    options = SwarmOptions(particles=2, inertia=(0.0, 0.0), iterations=400, stall_iterations=400)
    swarm = Swarm([[0, 360]], [True], [[350.0], [20.0]], options)
    while swarm.stop_reason is None:
        angle = swarm.ask()[:, 0]
        assert ((angle <= 60) | (angle >= 300)).all()  # overshoot at most 0.49 of 30 degrees
        swarm.tell(np.cos(np.radians(angle)))
    assert swarm.best_value == pytest.approx(1.0, abs=1e-4)


def test_turning_the_zero_of_an_angle_changes_nothing():
    def hill(degrees):
        return np.cos(np.radians(degrees[:, 0] - 70)) - 0.01 * np.abs(degrees[:, 1])

    options = replace(SMALL, iterations=15, initial_span=30.0)
    one = Swarm([[0, 360], [-9, 9]], [True, False], options=options)
    other = Swarm([[256, 616], [-9, 9]], [True, False], options=options)
    while one.stop_reason is None:
        x, y = one.ask(), other.ask()
        apart = np.cos(np.radians(y[:, 0] - x[:, 0] - 256))
        np.testing.assert_allclose(apart, 1, atol=1e-9)
        np.testing.assert_allclose(y[:, 1], x[:, 1], atol=1e-9)
        one.tell(hill(x))
        other.tell(hill(x))


def test_the_velocity_of_an_angle_stays_within_half_a_turn():
    """No bound stops it, so inertia above 1 would make it grow without end."""
    options = SwarmOptions(particles=10, inertia=(1.5, 1.5), initial_span=90.0)
    swarm = Swarm([[0, 360]], [True], options=options)
    for gain in range(150):
        swarm.ask()
        swarm.tell(np.full(10, float(gain)))
    assert np.abs(swarm.state()["velocity"]).max() <= 180


# Randomness


def test_equal_seeds_give_equal_runs():
    one, other = run(Swarm(CUBE, options=SMALL)), run(Swarm(CUBE, options=SMALL))
    assert numbers(one) == numbers(other)


def test_different_seeds_give_different_runs():
    one = run(Swarm(CUBE, options=SMALL))
    other = run(Swarm(CUBE, options=replace(SMALL, seed=4)))
    assert not np.array_equal(one.best_x, other.best_x)
    assert one.trace[0].best != other.trace[0].best


def test_the_caller_cannot_change_the_swarm_through_what_it_was_given():
    one, other = Swarm(CUBE, options=SMALL), Swarm(CUBE, options=SMALL)
    for _ in range(5):
        x = one.ask()
        values = sphere(x)
        x[:] = 0
        one.tell(values)
        values[:] = 0
        for array in one.state().values():
            array.fill(0)
        other.tell(sphere(other.ask()))
    assert numbers(one) == numbers(other)


def test_asking_twice_gives_the_same_positions():
    swarm = Swarm(CUBE, options=SMALL)
    for _ in range(3):
        assert np.array_equal(swarm.ask(), swarm.ask())
        swarm.tell(sphere(swarm.ask()))


# Stop rules


def test_it_ends_after_its_iterations():
    swarm = run(Swarm(CUBE, options=replace(SMALL, iterations=7)))
    assert swarm.stop_reason == "finished: all 7 iterations done"
    assert [row.iteration for row in swarm.trace] == list(range(8))
    assert swarm.evaluations == 8 * 20


def test_no_iterations_evaluate_the_first_swarm_only():
    swarm = run(Swarm(CUBE, options=replace(SMALL, iterations=0)))
    assert (swarm.evaluations, swarm.stop_reason) == (20, "finished: all 0 iterations done")


def fed(bests, options):
    """A swarm that is told these best values, one an iteration, until it stops."""
    swarm = Swarm(CUBE, options=options)
    for best in bests:
        if swarm.stop_reason is None:
            swarm.ask()
            swarm.tell(np.full(options.particles, best))
    return swarm


STALL = replace(SMALL, stall_iterations=3, tolerance=0.01)


def test_it_ends_when_the_best_changes_less_than_the_tolerance_over_the_stall_iterations():
    swarm = fed([50, 98.9, 99.1, 99.5, 99.89, 100, 100.5, 100.6], STALL)
    assert swarm.iteration == 4  # from 98.9 to 99.89 it is 0.99 %; the step before, far more
    assert swarm.stop_reason == (
        "stalled: the best value changed by less than 0.01 (relative) over 3 iterations"
    )


def test_a_slow_but_sufficient_climb_does_not_stall():
    assert fed(100 * 1.0035 ** np.arange(50), STALL).stop_reason is None


def test_a_stall_is_relative_for_small_values_too():
    climb = 1e-5 * 1.1 ** np.arange(10)
    assert fed(climb, STALL).stop_reason is None
    matlab = fed(climb, replace(STALL, tolerance_mode="matlab"))
    # What MATLAB makes of the paper's 1/OF: any change is below the tolerance.
    assert matlab.iteration == 3
    assert matlab.stop_reason == (
        "stalled: the best value changed by less than 0.01 (relative, absolute below 1) "
        "over 3 iterations"
    )


def test_both_tolerances_agree_on_large_values():
    values = [50, 98.9, 99.1, 99.5, 99.89, 100, 100.5, 100.6]
    assert fed(values, replace(STALL, tolerance_mode="matlab")).iteration == 4


@pytest.mark.parametrize("best", [0.0, -3.0])
def test_no_change_at_all_is_a_stall_even_without_tolerance(best):
    swarm = fed([best] * 9, replace(STALL, tolerance=0.0))
    assert swarm.iteration == 3
    assert swarm.stop_reason == "stalled: the best value did not change over 3 iterations"


def test_it_ends_at_the_objective_limit():
    swarm = fed([1, 14.9, 15, 16], replace(SMALL, objective_limit=15.0))
    assert swarm.iteration == 2
    assert swarm.stop_reason == "reached the limit: the best value 15 is at least 15"


def test_it_ends_after_the_iteration_that_uses_up_the_time():
    clock = Clock()
    swarm = Swarm(CUBE, options=replace(SMALL, max_seconds=60.0), clock=clock)
    while swarm.stop_reason is None:
        clock.now += 25
        swarm.tell(sphere(swarm.ask()))
    assert [row.seconds for row in swarm.trace] == [25, 50, 75]
    assert swarm.stop_reason == "out of time: 75 s of 60 s are used"


def test_a_stop_from_outside_keeps_its_words_and_the_values_in_hand_still_count():
    swarm = Swarm(CUBE, options=replace(SMALL, objective_limit=-1e9))
    x = swarm.ask()
    swarm.stop("interrupted by Ctrl-C")
    swarm.stop("too late")
    swarm.tell(sphere(x))
    assert swarm.stop_reason == "interrupted by Ctrl-C"
    assert swarm.best_value == sphere(x).max()
    with pytest.raises(ValueError, match="the swarm has ended: interrupted by Ctrl-C"):
        swarm.ask()


# Checkpoints


def through_a_file(swarm, path):
    np.savez(path, **swarm.state())
    with np.load(path) as file:  # refuses pickles
        return Swarm.from_state(file)


@pytest.mark.parametrize("update", ["always", "on_improvement"])
@pytest.mark.parametrize("broken_in_an_evaluation", [False, True])
def test_a_resumed_run_is_the_unbroken_run_bit_for_bit(update, broken_in_an_evaluation, tmp_path):
    options = replace(SMALL, iterations=20, inertia_update=update)
    bounds, periodic = [[-5, 5], [-5, 5], [0, 4]], [False, False, True]
    whole = run(Swarm(bounds, periodic, [1, 1, 1], options))
    part = Swarm(bounds, periodic, [1, 1, 1], options)
    while part.evaluations < 8 * 20:
        part.tell(sphere(part.ask()))
    if broken_in_an_evaluation:
        part.ask()
        part.stop("terminated")
    rest = through_a_file(part, tmp_path / "state.npz")
    assert rest.stop_reason is None
    run(rest)
    assert numbers(rest) == numbers(whole)
    assert rest.best_x.tolist() == whole.best_x.tolist()
    assert rest.stop_reason == whole.stop_reason
    assert len(rest.trace) == 21


def test_a_state_before_the_first_value_can_be_resumed(tmp_path):
    fresh = through_a_file(Swarm(CUBE, start=[1, 2, 3], options=SMALL), tmp_path / "state.npz")
    assert numbers(run(fresh)) == numbers(run(Swarm(CUBE, start=[1, 2, 3], options=SMALL)))


def test_seconds_go_on_where_they_ended():
    clock = Clock()
    swarm = Swarm(CUBE, options=replace(SMALL, max_seconds=60.0), clock=clock)
    clock.now += 40
    swarm.tell(sphere(swarm.ask()))
    later = Clock()
    later.now = 5e6
    resumed = Swarm.from_state(swarm.state(), clock=later)
    assert resumed.stop_reason is None
    later.now += 30
    resumed.tell(sphere(resumed.ask()))
    assert resumed.trace[-1].seconds == 70
    assert resumed.stop_reason == "out of time: 70 s of 60 s are used"


def test_a_finished_run_resumed_is_still_finished_unless_given_more_iterations():
    short = run(Swarm(CUBE, options=replace(SMALL, iterations=7)))
    assert Swarm.from_state(short.state()).stop_reason == "finished: all 7 iterations done"
    more = run(Swarm.from_state(short.state(), replace(SMALL, iterations=20)))
    assert numbers(more) == numbers(run(Swarm(CUBE, options=replace(SMALL, iterations=20))))


def test_extending_a_finished_run_gives_the_longer_run():
    swarm = run(Swarm(CUBE, options=replace(SMALL, iterations=7)))
    swarm.extend(13)
    whole = numbers(run(Swarm(CUBE, options=replace(SMALL, iterations=20))))
    assert numbers(run(swarm)) == whole | {"_stall_from": 7}


def test_extending_a_stalled_run_waits_anew_for_a_stall():
    swarm = fed([1.0] * 9, STALL)
    assert swarm.iteration == 3
    swarm.extend(50)
    run(swarm, lambda x: np.ones(len(x)))
    assert swarm.iteration == 6
    assert swarm.stop_reason == "stalled: the best value did not change over 3 iterations"
    swarm.extend(2)
    again = Swarm.from_state(swarm.state())
    assert again.stop_reason is None
    assert run(again, lambda x: np.ones(len(x))).stop_reason == "finished: all 8 iterations done"


def test_a_run_cannot_be_extended_by_nothing():
    with pytest.raises(ValueError, match="iterations = 0 to add must be at least 1"):
        Swarm(CUBE, options=SMALL).extend(0)


def test_a_state_of_another_version_is_refused():
    state = Swarm(CUBE, options=SMALL).state()
    state["json"] = np.array(json.dumps(json.loads(str(state["json"])) | {"version": 99}))
    with pytest.raises(ValueError, match="state of version 99 cannot be read, only 1"):
        Swarm.from_state(state)


def test_a_resumed_run_cannot_change_its_number_of_particles():
    with pytest.raises(
        ValueError, match=re.escape("swarm.particles = 30 must stay 20 in a run that goes on")
    ):
        Swarm.from_state(Swarm(CUBE, options=SMALL).state(), replace(SMALL, particles=30))


# Messages


def test_values_of_a_wrong_shape_are_refused():
    swarm = Swarm(CUBE, options=SMALL)
    with pytest.raises(ValueError, match=re.escape("values must have shape (20,), got (20, 1)")):
        swarm.tell(sphere(swarm.ask())[:, None])


def test_values_that_nobody_asked_for_are_refused():
    swarm = Swarm(CUBE, options=SMALL)
    swarm.tell(sphere(swarm.ask()))
    with pytest.raises(ValueError, match="tell without ask: the swarm waits for no values"):
        swarm.tell(np.zeros(20))


@pytest.mark.parametrize(
    ("option", "message"),
    [
        ({"particles": 1}, "swarm.particles = 1 must be at least 2"),
        ({"particles": 2.5}, "swarm.particles = 2.5 must be a whole number"),
        ({"iterations": -1}, "swarm.iterations = -1 must be at least 0"),
        ({"stall_iterations": 0}, "swarm.stall_iterations = 0 must be at least 1"),
        ({"tolerance": -0.1}, "swarm.tolerance = -0.1 must be at least 0"),
        ({"tolerance": np.nan}, "swarm.tolerance = nan must be at least 0"),
        ({"initial_span": -1.0}, "swarm.initial_span = -1.0 must be at least 0"),
        ({"initial_span": np.inf}, "swarm.initial_span = inf must be finite"),
        ({"cognitive": -1.0}, "swarm.cognitive = -1.0 must be at least 0"),
        ({"social": -1.0}, "swarm.social = -1.0 must be at least 0"),
        ({"seed": -1}, "swarm.seed = -1 must be at least 0"),
        ({"min_neighbors_fraction": -0.1}, "min_neighbors_fraction = -0.1 must be at least 0"),
        ({"min_neighbors_fraction": 1.1}, "min_neighbors_fraction = 1.1 must be at most 1"),
        ({"inertia": (1.5, 0.2)}, "swarm.inertia = [1.5, 0.2] must be [low, high] with 0 <="),
        ({"inertia": (0.2,)}, "swarm.inertia = [0.2] must be [low, high]"),
        ({"inertia": (-0.2, 1.0)}, "swarm.inertia = [-0.2, 1.0] must be [low, high]"),
        ({"objective_limit": np.nan}, "swarm.objective_limit = nan must be finite"),
        ({"max_seconds": 0}, "swarm.max_seconds = 0 must be larger than 0"),
        ({"initial": "grid"}, "swarm.initial = 'grid' must be 'sobol' or 'uniform'"),
        ({"inertia_update": "no"}, "inertia_update = 'no' must be 'always' or 'on_improvement'"),
        ({"tolerance_mode": ""}, "swarm.tolerance_mode = '' must be 'relative' or 'matlab'"),
    ],
)
def test_an_impossible_option_is_named_with_what_is_allowed(option, message):
    with pytest.raises(ValueError, match=re.escape(message)):
        SwarmOptions(**option)


def test_the_defaults_are_those_of_table_5():
    o = SwarmOptions()
    assert (o.particles, o.iterations, o.stall_iterations) == (300, 200, 30)
    assert (o.inertia, o.initial_span, o.tolerance) == ((0.2, 1.5), 20, 0.001)
    assert o.min_neighbors_fraction == 0.4
    assert Swarm(CUBE, options=o)._neighbours == 120


# What a user must never notice of pyswarms

WATCHED = """
import logging, os, sys
import numpy as np
opened = []
def watch(event, arguments):
    if event == "open":
        path, mode, flags = arguments
        if flags & (os.O_WRONLY | os.O_RDWR | os.O_CREAT):
            opened.append(path)
    elif event in ("os.mkdir", "os.rename", "os.remove"):
        opened.append((event, arguments))
sys.addaudithook(watch)
logging.getLogger("mine").setLevel(logging.DEBUG)
def outside():
    root = logging.getLogger()
    return (
        root.handlers[:], root.level, root.disabled, logging.getLogger("mine").disabled,
        dict(os.environ), str(np.random.get_state()),
    )
before = outside()
import glvis.search.swarm
assert "pyswarms" not in sys.modules, "pyswarms is imported before it is needed"
from glvis.search.swarm import Swarm, SwarmOptions
swarm = Swarm([[0, 1]] * 2, options=SwarmOptions(particles=5, iterations=3))
while swarm.stop_reason is None:
    swarm.tell(-swarm.ask().sum(axis=1))
assert "pyswarms" in sys.modules
assert outside() == before, (outside(), before)
assert opened == [], opened
"""


def run_watched(folder, **environment):
    root = str(Path(__file__).resolve().parents[1])
    done = subprocess.run(
        [sys.executable, "-c", WATCHED],
        cwd=folder,
        env=os.environ | {"PYTHONPATH": root, "PYTHONDONTWRITEBYTECODE": "1"} | environment,
        capture_output=True,
        text=True,
        check=False,
    )
    assert (done.returncode, done.stdout, done.stderr) == (0, "", "")


def test_no_file_no_log_handler_no_global_random_state(tmp_path):
    run_watched(tmp_path)
    assert list(tmp_path.iterdir()) == []


def test_it_runs_in_a_folder_that_cannot_be_written():
    if not Path("/proc/self").exists():
        pytest.skip("needs a folder that not even root can write, such as Linux' /proc")
    run_watched("/proc")


def test_a_logging_configuration_of_the_user_is_put_back(tmp_path):
    run_watched(tmp_path, LOG_CFG="/of/the/user.yaml")
