"""Search methods on functions whose best place is known; budgets, resumption, whole studies."""

import math
from itertools import groupby

import numpy as np
import pytest
from methods.refine import refine_alone
from support.ball_and_ring import SMALL, write_ball_and_ring
from support.courses import ALL_METHODS, PAIR, SHARED, Course, bowl, problem

from glvis.errors import StudyError
from glvis.evaluation.evaluator import Evaluator
from glvis.problem.search_options import METHODS, SearchOptions
from glvis.search.auto import _make_surrogate_layouts, _recombine, auto, restart_block, restart_cost
from glvis.search.box import Box
from glvis.search.greedy import draw, place_greedily, search_greedily, sensor_groups
from glvis.search.local_search import optimize_on_surrogate, perturb, search_locally
from glvis.search.methods import SCRIPTS
from glvis.search.placement import place_sensors
from glvis.search.run import Run
from glvis.search.script import Block, ScriptSearch
from glvis.study.loading import load_study

STAGES = (
    "start",
    "surrogate",
    "local search",
    "restart",
    "recombine",
)  # of auto, beside other methods


def test_blocks_are_what_moves_together_and_all_that_moves_no_others():
    assert problem(PAIR).blocks == [
        Block((0, 1), (0,), (0, 1)),
        Block((2, 3), (1,), (2, 3)),
    ]
    assert problem(SHARED).blocks == [
        Block((1,), (0, 1), (1,)),
        Block((2,), (2, 3), (2,)),
        Block((0, 1, 2), (0, 1, 2, 3), (0,)),
    ]


def test_groups_are_sensors_of_the_same_variables_and_know_whether_they_are_separable():
    one, other = sensor_groups(problem(PAIR))
    assert one.is_separable and one.sensors == (0,) and one.kind == other.kind
    one, other = sensor_groups(problem(SHARED))
    assert not one.is_separable and one.sensors == (0, 1) and one.columns.tolist() == [0, 1]
    assert one.kind != other.kind


def test_greedy_finds_for_each_mount_the_best_of_the_same_poses_at_no_further_cost():
    # two sensors at 0.2 and 0.8 see most; a second at the same place sees nothing new
    def cover(x, looking):
        places = [x[2 * s : 2 * s + 2] for s in looking]
        targets = [np.array([0.2, 0.2]), np.array([0.8, 0.8])]
        return -sum(min(float(np.sum((p - t) ** 2)) for p in places) for t in targets)

    task = problem(PAIR, max_maps=600)
    course = Course(ScriptSearch(search_greedily, task), cover, PAIR)
    search = course.run()
    assert search.best_value > -0.01
    assert search.stop_reason == "finished: greedy choice and exchanges found no more"
    # the draws of one mount are good for both
    assert 500 < len(course.seen) <= 600
    assert course.asks[0][0].shape == (1, 4)
    alone = [sensors for _, sensors, _ in course.asks if sensors is not None]
    assert alone[0] == (0,) and (0, 1) in alone


def hills(x, looking):
    """Return the value of a broad low hill at 0.2 and a steep high one at 0.8, mount by mount."""
    places = x.reshape(-1, 2)[list(looking)]
    low = 1 - 2 * np.linalg.norm(places - 0.2, axis=1)
    return float(np.maximum(low, 2 - 10 * np.linalg.norm(places - 0.8, axis=1)).sum())


def run_script(script, function, sensors):
    """Return what a script returns, and how many positions it asked for."""
    asked, values = 0, None
    try:
        while True:
            ask = script.send(values)
            asked += len(ask.positions)
            values = np.array([function(x, ask.sensors or sensors) for x in ask.positions])
    except StopIteration as end:
        return end.value, asked


def guided(moved_by, function, **settings):
    """Return a problem whose surrogate is right."""
    task = problem(moved_by, **settings)
    everybody = range(len(moved_by))
    task.surrogate = lambda x, sensors: np.array([function(row, sensors or everybody) for row in x])
    return task


@pytest.mark.parametrize("moved_by", [PAIR, SHARED])
@pytest.mark.parametrize("seed", [1, 2, 3])
def test_local_search_finds_the_top_of_a_bowl_and_sooner_with_a_surrogate(moved_by, seed):
    def from_start(task):
        (value,) = yield task.ask(task.start[None], range(len(moved_by)), "start")
        yield from search_locally(task, task.start, value)

    asked = []
    for task in (problem(moved_by, seed=seed), guided(moved_by, bowl, seed=seed)):
        search = ScriptSearch(from_start, task)
        course = Course(search, bowl, moved_by)
        while search.best_value < -1e-3:
            course.run(most=len(course.asks) + 1)
            assert len({row[sorted(moved_by[0])].tobytes() for row in course.asks[-1][0]}) <= 4
        asked.append(len(course.asks))
    assert asked[1] < 0.7 * asked[0]


def ridge(x, looking):
    """Return the value of a narrow ridge that leads to 0.9; all must move together."""
    return -float(np.sum((x[1:] - x[0]) ** 2) * 100 + (x[0] - 0.9) ** 2)


@pytest.mark.parametrize("seed", range(5))
def test_local_search_follows_a_ridge_where_groups_must_adapt_to_what_they_share(seed):
    task = guided(SHARED, ridge, seed=seed, max_maps=1000)
    search = ScriptSearch(lambda task: search_locally(task, task.start, -np.inf), task)
    Course(search, ridge, SHARED).run()
    assert search.best_value > -0.05  # by steps of a whole block -0.24 at best


def test_steps_are_of_all_sizes_and_move_some_of_a_block_and_nothing_else():
    task = problem(SHARED, start=0.5)
    for block in task.blocks:
        moved = perturb(task, task.start[None], block.columns, 500)[0] - task.start
        columns = list(block.columns)
        assert not np.delete(moved, columns, axis=1).any()
        assert (moved[:, columns] != 0).any(axis=1).all()  # one at least
        largest = np.abs(moved).max(axis=1)
        assert np.quantile(largest, 0.1) < 0.01 and np.quantile(largest, 0.9) > 0.1
        assert np.abs(moved).max() <= 0.5


def test_layouts_end_where_the_surrogate_is_best_each_by_itself():
    task = guided(PAIR, hills)
    begin = np.array([[0.2, 0.2, 0.2, 0.2], [0.7, 0.75, 0.1, 0.1], [0.9, 0.9, 0.9, 0.9]])
    kept = begin.copy()
    improved, predicted = optimize_on_surrogate(
        task, begin, task.blocks, 30, 32, with_restarts=False
    )
    restarted, _ = optimize_on_surrogate(task, begin, task.blocks, 30, 32, with_restarts=True)
    assert np.array_equal(begin, kept)
    assert np.array_equal(predicted, task.surrogate(improved, None))
    assert task.surrogate(improved, None) == pytest.approx([2, 3, 4], abs=0.1)
    assert task.surrogate(restarted, None) == pytest.approx([4, 4, 4], abs=0.2)
    one, _ = optimize_on_surrogate(task, begin, [task.blocks[1]], 5, 32, with_restarts=True)
    assert np.array_equal(one[:, :2], begin[:, :2])


@pytest.mark.parametrize("seed", range(3))
def test_layouts_of_the_surrogate_come_with_their_own_values(seed):
    task = guided(PAIR, hills, seed=seed, max_maps=4000)
    runs, _ = run_script(_make_surrogate_layouts(task, 0.3, 2, 8), hills, range(2))
    assert len(runs) > 2 * 32  # those given up on the way are among them
    assert [value for _, value in runs] == [hills(x, range(2)) for x, _ in runs]


@pytest.mark.parametrize("seed", range(5))
def test_restarts_find_the_hill_that_local_search_does_not_lead_to(seed):
    def restarted(task):  # without a surrogate, then improved by local search
        x, value = task.start, hills(task.start, (0, 1))
        while task.left() > restart_cost(task, task.blocks[1]):
            layout, layouts_value = yield from restart_block(task, x, task.blocks[1])
            assert np.array_equal(layout[:2], x[:2])  # the other mount stays
            assert layouts_value == hills(layout, (0, 1))
            if layouts_value > value:
                x, value = layout, layouts_value
        yield from search_locally(task, x, value)

    best = {}
    for script in (restarted, refine_alone):
        search = ScriptSearch(script, problem(PAIR, seed=seed, start=0.2, max_maps=400))
        best[script] = Course(search, hills, PAIR).run().best_value
    assert best[restarted] > 1 + 1.5
    assert best[refine_alone] < 2 + 1e-9


@pytest.mark.parametrize("max_maps", [100, 333, 1000, 4000])
def test_auto_spends_what_it_may(max_maps):
    course = Course(ScriptSearch(SCRIPTS["auto"], problem(PAIR, max_maps=max_maps)), bowl, PAIR)
    course.run()
    assert max_maps - 10 < len(course.seen) <= max_maps


def test_restart_costs_no_more_than_it_says():
    task = problem(SHARED, models=2)
    for block in task.blocks:
        _, asked = run_script(restart_block(task, task.start, block), bowl, range(4))
        assert asked * len(block.sensors) * 2 == restart_cost(task, block)


def test_auto_makes_no_restarts_where_groups_share_variables():
    course = Course(ScriptSearch(SCRIPTS["auto"], problem(SHARED, max_maps=4000)), ridge, SHARED)
    course.run()
    stages = [method for method, _ in groupby(method for _, _, method in course.asks)]
    assert stages == ["start", "local search", "surrogate", "local search"]
    assert course.search.best_value > -0.01


def test_auto_takes_every_mount_to_the_higher_hill():
    search = ScriptSearch(SCRIPTS["auto"], problem(PAIR, max_maps=2000, start=0.2))
    assert Course(search, hills, PAIR).run().best_value > 3.9


def test_places_that_runs_found_are_recombined_at_no_cost_of_maps():
    task = problem(PAIR, start=0.1)
    good, bad = [0.7, 0.7], [0.0, 0.0]
    found = [np.array(one + other) for one, other in ((good, bad), (bad, bad))]
    run = (found[1], bowl(found[1], ()))
    (x, value), _ = run_script(_recombine(task, run, found), bowl, (0, 1))
    assert x.tolist() == good + good and value == bowl(x, ())
    worse = [np.array(bad + bad)]
    run = (found[0], bowl(found[0], ()))
    (x, value), _ = run_script(_recombine(task, run, worse), bowl, (0, 1))
    assert x is found[0] and value == bowl(x, ())


def test_poses_with_the_best_prediction_are_drawn_and_often_on_the_bounds():
    tasks = problem(PAIR), guided(PAIR, bowl)
    drawn = [draw(task, sensor_groups(task)[0], 400) for task in tasks]
    far = [np.linalg.norm(places - 0.7, axis=1).mean() for places in drawn]
    assert far[1] < 0.6 * far[0]
    on_bounds = np.mean((drawn[0] == 0) | (drawn[0] == 1))
    assert abs(on_bounds - 1 / 3) < 0.05  # of a range 1.5 times as wide


def test_greedy_with_shared_variables_leaves_what_is_decided_alone():
    course = Course(ScriptSearch(search_greedily, problem(SHARED, max_maps=400)), bowl, SHARED)
    course.run()
    first = [x for x, sensors, _ in course.asks if sensors == (0, 1)]
    second = [x for x, sensors, _ in course.asks if sensors == (0, 1, 2, 3)]
    height = {row[0] for part in second for row in part}
    assert len(height) == 1 and height <= {row[0] for part in first for row in part}


def test_greedy_takes_no_more_poses_than_are_kept():
    course = Course(
        ScriptSearch(search_greedily, problem(PAIR, max_maps=10_000, most_poses=100)), bowl, PAIR
    )
    course.run()
    assert len(course.seen) <= 50 + 1


@pytest.mark.parametrize("name", sorted(ALL_METHODS))
@pytest.mark.parametrize("moved_by", [PAIR, SHARED])
@pytest.mark.parametrize("max_maps", [10, 333, 2000])
def test_no_method_renders_more_maps_than_it_may(name, moved_by, max_maps):
    search = ScriptSearch(ALL_METHODS[name], problem(moved_by, max_maps=max_maps, models=2))
    course = Course(search, bowl, moved_by, models=2)
    course.run()
    assert 2 * len(course.seen) <= max_maps
    assert search.stop_reason.startswith("finished: ")


@pytest.mark.parametrize("name", sorted(ALL_METHODS))
def test_script_that_goes_on_asks_for_what_an_unbroken_one_asks_for(name):
    whole = Course(ScriptSearch(ALL_METHODS[name], problem(PAIR)), bowl, PAIR)
    whole.run()
    broken = Course(ScriptSearch(ALL_METHODS[name], problem(PAIR)), bowl, PAIR)
    broken.run(most=7)
    state = broken.search.state()
    again = ScriptSearch(ALL_METHODS[name], problem(PAIR))
    again.go_on(state)
    assert again.best_value == broken.search.best_value
    rest = Course(again, bowl, PAIR)
    rest.seen = broken.seen
    rest.run()
    assert again.stop_reason == whole.search.stop_reason
    assert again.iteration == whole.search.iteration
    for (x, *_), (other, *_) in zip(whole.asks[7:], rest.asks, strict=True):
        assert np.array_equal(x, other)
    assert np.array_equal(again.best_x, whole.search.best_x)


def test_script_that_would_go_another_way_is_refused():
    broken = Course(ScriptSearch(auto, problem(PAIR)), bowl, PAIR)
    broken.run(most=3)
    other = ScriptSearch(auto, problem(PAIR, seed=2))
    with pytest.raises(StudyError, match="the search cannot go on: this version of glvis or NumPy"):
        other.go_on(broken.search.state())


def test_extension_goes_beyond_the_budget_by_so_many_iterations():
    course = Course(ScriptSearch(auto, problem(PAIR, max_maps=100)), bowl, PAIR)
    search = course.run()
    done = search.iteration
    search.extend(5)
    course.run()
    assert search.iteration == done + 5
    assert search.stop_reason.endswith("of 100 maps are rendered")
    with pytest.raises(ValueError, match="iterations = 0 to add must be at least 1"):
        search.extend(0)


def test_ended_search_has_nothing_to_ask_and_wrong_values_are_refused():
    search = ScriptSearch(auto, problem(PAIR))
    with pytest.raises(ValueError, match=r"values of shape \(2,\) are not those of what was asked"):
        search.tell([0.0, 0.0], 2)
    search.stop("interrupted: Ctrl-C")
    search.stop("too late")
    with pytest.raises(ValueError, match="the search has ended: interrupted: Ctrl-C"):
        search.ask()


def test_value_that_is_no_number_never_becomes_the_best():
    search = ScriptSearch(auto, problem(PAIR, max_maps=200))

    def holed(x, looking):
        return math.nan if x[0] > 0.5 else bowl(x, looking)

    Course(search, holed, PAIR).run()
    assert math.isfinite(search.best_value) and search.best_x[0] <= 0.5


@pytest.fixture
def small(tmp_path, rng):
    return write_ball_and_ring(tmp_path, rng)


@pytest.mark.parametrize("method", sorted(ALL_METHODS))
def test_study_is_searched_by_the_method_it_names_within_its_maps(small, method, tmp_path):
    most, last = (1000, 1) if method == "de" else (300, 6)  # whose first iteration takes 240
    script = None if method in SCRIPTS else ALL_METHODS[method]
    named = [f"search.method={method}"] * (method in SCRIPTS)
    study = load_study(small, ["search.method=auto", *named, f"search.max_maps={most}"])
    placement = place_sensors(study, script=script)
    assert placement.value > placement.start_value
    assert placement.maps_rendered <= most
    assert {row.method for row in placement.trace} <= {*ALL_METHODS, *STAGES}
    assert placement.trace[-1].best == placement.value
    with Evaluator(study) as evaluator:
        assert evaluator(placement.position)[0] == placement.value

    def stop(progress):
        if progress.iteration == last:
            raise InterruptedError

    path = tmp_path / "checkpoint.npz"
    with pytest.raises(InterruptedError):
        place_sensors(study, checkpoint=path, on_iteration=stop, script=script)
    resumed = place_sensors(study, checkpoint=path, resume=True, workers=2, script=script)
    assert [row[:-1] for row in resumed.trace] == [row[:-1] for row in placement.trace]
    assert np.array_equal(resumed.position, placement.position)
    assert resumed.maps_rendered == placement.maps_rendered


@pytest.mark.parametrize("name", sorted(ALL_METHODS))
def test_one_variable_and_one_that_cannot_move_are_no_trouble(name):
    single = ScriptSearch(ALL_METHODS[name], problem([(0,)], max_maps=500))
    assert Course(single, bowl, [(0,)]).run().best_value > -1e-3
    task = problem(PAIR, max_maps=3000)
    task.box = Box([[0, 1], [0.5, 0.5], [0, 1], [0, 1]])
    task.start = np.array([0.1, 0.5, 0.1, 0.1])
    held = Course(ScriptSearch(ALL_METHODS[name], task), bowl, PAIR).run()
    assert held.best_x[1] == 0.5 and held.best_value > -0.1


def test_swarm_obeys_the_maps_and_the_seconds_too(small):
    placement = place_sensors(load_study(small, ["search.method=swarm", "search.max_maps=60"]))
    assert placement.maps_rendered <= 60 and len(placement.trace) == 2
    assert placement.stop_reason == f"finished: {placement.maps_rendered} of 60 maps are rendered"
    placement = place_sensors(load_study(small, ["search.method=swarm", "search.max_seconds=1e-9"]))
    assert placement.trace == () and placement.stop_reason.startswith("out of time: ")


def test_method_is_auto_unless_the_study_names_one(small):
    assert load_study(small).search == SearchOptions("swarm")
    for text in ("", "[search]\n"):
        small.write_text(SMALL.replace('[search]\nmethod = "swarm"\n', text))
        assert load_study(small).search == SearchOptions() == SearchOptions("auto")
        assert load_study(small, ["search.max_maps=9"]).search == SearchOptions("auto", 9)
    small.write_text(SMALL.replace('method = "swarm"', 'method = "greedy"\nmax_seconds = 2.5'))
    assert load_study(small).search == SearchOptions("greedy", None, 2.5)


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"method": "simplex"}, "search.method = 'simplex' must be one of 'swarm', 'auto', "),
        ({"max_maps": 0}, "search.max_maps = 0 must be at least 1"),
        ({"max_seconds": math.inf}, "search.max_seconds = inf must be larger than 0"),
    ],
)
def test_options_out_of_range_are_refused(options, message):
    with pytest.raises(ValueError) as error:
        SearchOptions(**options)
    assert str(error.value).startswith(message)


def test_greedy_gives_its_layouts_best_first():
    script = place_greedily(problem(PAIR), 200, 3)
    ask = next(script)
    try:
        while True:
            ask = script.send(np.array([bowl(row, ()) for row in ask.positions]))
    except StopIteration as end:
        layouts, values = end.value
    assert layouts.shape == (len(values), 4) and 1 <= len(values) <= 3
    assert values.tolist() == sorted(values, reverse=True)
    assert values[0] == bowl(layouts[0], ())


def test_groups_that_stand_elsewhere_for_the_same_values_are_of_another_kind():
    task = problem(PAIR)
    task.pose_keys = lambda x: [x[:2].tobytes(), (-x[2:]).tobytes()]
    one, other = sensor_groups(task)
    assert one.kind != other.kind


@pytest.mark.parametrize("method", sorted({*ALL_METHODS} - {"cma"}))
def test_the_narrowest_range_that_is_allowed_does_not_hold_a_search_up(tmp_path, rng, method):
    path = write_ball_and_ring(tmp_path, rng)
    fixed = [f"variables.{text}" for text in ("turn=10", "azimuth=60", "elevation=20")]
    narrow = ["variables.height={min = 1, max = 1.00000001}"]
    study = load_study(path, [*fixed, *narrow, "search.method=auto", "search.max_maps=200"])
    with Evaluator(study) as evaluator:
        run = Run(study, evaluator, script=ALL_METHODS[method])
        while run.search.stop_reason is None and run.search.iteration < 2000:
            run.iterate()
        assert run.search.stop_reason.startswith("finished: ")


def test_every_method_but_the_swarm_is_a_script():
    assert {*METHODS} == {*SCRIPTS, "swarm"}


def test_script_of_ones_own_takes_the_place_of_a_method_but_not_of_the_swarm(small):
    def first_draw(task):
        """Evaluate one random layout."""
        yield task.ask(task.box.uniform(1, task.rng), range(2), "mine")
        return "one is enough"

    study = load_study(small, ["search.method=auto"])
    placement = place_sensors(study, script=first_draw)
    assert [row.method for row in placement.trace] == ["mine"]
    assert placement.stop_reason == "finished: one is enough"
    with pytest.raises(ValueError, match=r"script replaces a search\.method other than 'swarm'"):
        place_sensors(load_study(small), script=first_draw)
