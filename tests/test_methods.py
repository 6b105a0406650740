"""Methods for comparison alone, those of ``tools/methods``: what each of them is known for."""

import gc
import sys
import threading

import numpy as np
import pytest
from methods.refine import Steps, refine_alone
from support.courses import ALL_METHODS, PAIR, SHARED, Course, bowl, problem

from glvis.errors import MachineError
from glvis.search.box import Box
from glvis.search.script import Block, ScriptSearch


@pytest.mark.parametrize("moved_by", [PAIR, SHARED])
@pytest.mark.parametrize("seed", [1, 2, 3])
def test_refinement_comes_as_close_to_the_top_of_a_bowl_as_one_likes(moved_by, seed):
    search = ScriptSearch(refine_alone, problem(moved_by, seed=seed))
    Course(search, bowl, moved_by).run()
    assert search.best_value > -1e-5
    assert np.abs(search.best_x - 0.7).max() < 3e-3


def test_refinement_learns_the_direction_of_a_valley():
    def valley(x, looking):
        return -float((x[0] - x[1]) ** 2 * 1e4 + (x[0] + x[1] - 1.4) ** 2)

    search = ScriptSearch(refine_alone, problem([(0, 1)], start=0.2))
    Course(search, valley, [(0, 1)]).run()
    assert search.best_value > -1e-5


def test_refinement_moves_one_block_at_a_time_and_renders_only_its_sensors():
    search = ScriptSearch(refine_alone, problem(PAIR, max_maps=300))
    course = Course(search, bowl, PAIR)
    course.run()
    best = course.asks[0][0][0]
    value = bowl(best, ())
    for x, _, method in course.asks[1:]:
        moved = {int(c) for c in np.flatnonzero((x != best).any(axis=0))}
        assert method == "refine" and (moved <= {0, 1} or moved <= {2, 3})
        values = [bowl(row, ()) for row in x]
        if max(values) >= value:
            best, value = x[int(np.argmax(values))], max(values)
    evaluations = sum(len(x) for x, _, _ in course.asks)
    assert len(course.seen) <= evaluations + 1  # one new pose each, both at the start


def test_steps_grow_with_success_shrink_without_and_begin_anew_when_tiny():
    steps = Steps(Block((0,), (0,), (0,)))
    first = steps.size
    steps.learn(1.0, np.array([0.1]))
    assert steps.size > first
    sizes = []
    for _ in range(100):
        steps.learn(0.0, None)
        sizes.append(steps.size)
    assert min(sizes) < 0.02 * first
    assert first in sizes[int(np.argmin(sizes)) :]


@pytest.mark.parametrize("name", ["cma", "de"])
@pytest.mark.parametrize("seed", [1, 2])
def test_methods_for_comparison_find_the_top_of_a_bowl(name, seed):
    before = np.random.get_state()[1].tolist()  # noqa: NPY002
    search = ScriptSearch(ALL_METHODS[name], problem(SHARED, max_maps=12_000, seed=seed))
    Course(search, bowl, SHARED).run()
    assert search.best_value > -1e-4
    assert np.random.get_state()[1].tolist() == before  # noqa: NPY002 (chance has one source)


def test_covariance_restarts_with_twice_the_population_and_wraps():
    task = problem(PAIR, max_maps=12_000)
    task.box = Box(task.box.bounds, [True, False, False, False])

    def ring(x, looking):
        around = abs(x[0] - 0.98)
        return -float(min(around, 1 - around) ** 2 + np.sum((x[1:] - 1.0) ** 2))

    task.start = np.array([0.05, 0.5, 0.5, 0.5])
    search = ScriptSearch(ALL_METHODS["cma"], task)
    course = Course(search, ring, PAIR)
    course.run()
    assert search.best_value > -1e-6
    sizes = [len(x) for x, *_ in course.asks]
    assert {8, 16} <= set(sizes) and sizes == sorted(sizes)
    for x, *_ in course.asks:
        assert (x >= 0).all() and (x <= 1).all()


def test_differential_evolution_ends_where_its_population_is_one_and_leaves_no_thread():
    threads = threading.active_count()
    search = ScriptSearch(ALL_METHODS["de"], problem([(0,)], max_maps=10**6))
    Course(search, lambda x, looking: -float(round(abs(x[0] - 0.7), 2)), [(0,)]).run(most=300)
    search = ScriptSearch(ALL_METHODS["de"], problem([(0,)], max_maps=10**6))
    flat = Course(search, lambda x, looking: 1.0, [(0,)])
    assert flat.run().stop_reason == "finished: no two layouts of the population differ"
    del search, flat
    gc.collect()
    assert threading.active_count() == threads


def test_missing_library_is_named_with_the_way_to_install_it(monkeypatch):
    monkeypatch.setitem(sys.modules, "cma", None)
    with pytest.raises(MachineError) as error:
        ScriptSearch(ALL_METHODS["cma"], problem(PAIR))
    assert str(error.value).startswith("the method 'cma' needs pycma (")
    assert 'install it by: pip install ".[bench]" in the checkout' in str(error.value)
