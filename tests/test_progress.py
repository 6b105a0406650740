"""How far a search is: the limit that is met first, and the time until then."""

import math

import pytest
from support.ball_and_ring import write_ball_and_ring

from glvis.evaluation.evaluator import Evaluator
from glvis.search.checkpoint import read_checkpoint
from glvis.search.placement import place_sensors
from glvis.search.progress import Spent, first_limit
from glvis.search.run import Run
from glvis.study.loading import load_study

# Between the two, 0.25 iterations and 10 maps a second.
THEN = Spent(iterations=9, maps=3600, seconds=60.0)
NOW = Spent(iterations=19, maps=4000, seconds=100.0)


@pytest.mark.parametrize(
    ("most", "limit", "seconds_left"),
    [
        ({"iterations": 99, "maps": None, "seconds": None}, "iterations", 80 / 0.25),
        ({"iterations": 99, "maps": 5000, "seconds": None}, "maps", 1000 / 10),
        ({"iterations": 99, "maps": 5000, "seconds": 150.0}, "seconds", 50.0),
        ({"iterations": 20, "maps": 5000, "seconds": 150.0}, "iterations", 1 / 0.25),
        ({"iterations": None, "maps": 3990, "seconds": 150.0}, "maps", 0.0),
    ],
)
def test_the_limit_that_is_met_first_tells_the_time_left(most, limit, seconds_left):
    got, done, allowed, left = first_limit(THEN, NOW, most)
    assert (got, done, allowed) == (limit, getattr(NOW, limit), most[limit])
    assert left == pytest.approx(seconds_left)


def test_speed_is_that_of_all_the_time_where_nothing_was_spent_of_late():
    most = {"maps": 5000}
    assert first_limit(NOW._replace(seconds=50.0), NOW, most)[-1] == pytest.approx(1000 / 40)
    nothing = Spent(0, 0, 5.0)
    assert first_limit(nothing, nothing, most) == ("maps", 0, 5000, math.inf)


def told(path, *overrides, **options):
    """Return what a search says after each iteration, and its trace."""
    study, said = load_study(path, overrides), []
    placement = place_sensors(study, on_iteration=said.append, **options)
    return said, placement


@pytest.fixture
def path(tmp_path, rng):
    return write_ball_and_ring(tmp_path, rng)


@pytest.mark.parametrize("method", ["auto", "greedy"])
def test_methods_that_spend_maps_tell_how_many(path, method):
    said, placement = told(path, f"search.method={method}", "search.max_maps=300")
    assert {(p.limit, p.most) for p in said} == {("maps", 300)}
    assert [p.done for p in said] == [row.maps_rendered for row in placement.trace]
    assert all(0 <= p.seconds_left < math.inf for p in said)
    assert [p.has_ended for p in said] == [False] * (len(said) - 1) + [True]


def test_a_swarm_with_few_maps_tells_of_maps_and_with_many_of_iterations(path):
    swarm = "search.method=swarm"
    said, _ = told(path, swarm, "swarm.iterations=1000", "search.max_maps=100")
    assert said[-1].has_ended and {(p.limit, p.most) for p in said} == {("maps", 100)}
    said, _ = told(path, swarm, "search.max_maps=100000")
    assert {(p.limit, p.most) for p in said} == {("iterations", 4)}
    assert [p.done for p in said] == [0, 1, 2, 3, 4] and said[-1].seconds_left == 0


def test_a_search_with_little_time_tells_of_time(path):
    plenty = ("swarm.iterations=100_000", "swarm.stall_iterations=100_000")
    for method in ("auto", "swarm"):
        search = (f"search.method={method}", "search.max_maps=10_000_000")
        said, _ = told(path, *plenty, *search, "search.max_seconds=0.2")
        assert {(p.limit, p.most) for p in said} == {("seconds", 0.2)}
    said, _ = told(path, *plenty, "swarm.max_seconds=0.2")
    assert {(p.limit, p.most) for p in said} == {("seconds", 0.2)}


def test_an_extension_beyond_the_maps_tells_of_its_iterations(path, tmp_path):
    overrides = ("search.method=auto", "search.max_maps=60")
    checkpoint = {"checkpoint": tmp_path / "checkpoint.npz"}
    before, _ = told(path, *overrides, **checkpoint)
    said, _ = told(path, *overrides, **checkpoint, resume=True, extend=3)
    end = before[-1].iteration + 3
    assert [(p.limit, p.done, p.most) for p in said] == [
        ("iterations", end - left, end) for left in (2, 1, 0)
    ]


def test_time_of_earlier_parts_is_no_measure_of_the_speed_of_this_one(path, tmp_path):
    study = load_study(path, ["swarm.iterations=100", "swarm.stall_iterations=100"])
    file = tmp_path / "checkpoint.npz"
    with Evaluator(study) as evaluator:
        run = Run(study, evaluator, file)
        for _ in range(3):
            run.iterate()
        run.save()
        saved = read_checkpoint(file, study)
        saved.run["seconds"] += 1e6  # as if it had been a slow machine
        again = Run(study, evaluator, file, saved)
        again.iterate()
        assert again.progress().seconds_left < 1e6
