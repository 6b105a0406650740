"""The method for new studies: a multi-start local search, assisted by a surrogate.

Greedy starts and layouts optimised on the surrogate alone are rendered; the best of them are
improved by local search and by restarts of one coordinate block at a time, in rounds of successive
halving: after each round the better half goes on, with twice the maps for each. Blocks that all
runs found are combined by exchange.

Where groups of sensors share variables a pose is good only beside the others that share them, and
a restart would move them all. There the study's start is improved by local search for a while,
layouts are optimised on the surrogate alone, and successive halving chooses among all of these.

References
----------
Karnin, Koren, Somekh, "Almost Optimal Exploration in Multi-Armed Bandits", ICML 2013; Jamieson,
Talwalkar, "Non-stochastic Best Arm Identification and Hyperparameter Optimization", AISTATS 2016:
successive halving.
"""

from __future__ import annotations

from itertools import cycle

import numpy as np

from glvis.optim.greedy import exchange, place_greedily, sensor_groups
from glvis.optim.local_search import (
    CANDIDATES,
    CANDIDATES_COUPLED,
    TRIES,
    optimize_on_surrogate,
    propose,
    redraw,
    search_locally,
    take_best,
)
from glvis.optim.script import Block, Floats, Problem, Script

METHOD, METHOD_RESTART = "sketch", "rivals"
# Shares of the budget at whose end a stage ends: greedy starts, layouts optimised on the
# surrogate, rounds of halving, restarts of the last run; the rest is local search.
_GREEDY, _SURROGATE, _ROUNDS, _RESTARTED = 0.1, 0.16, 0.6, 0.88
_LOCAL = 0.3  # of a round; the rest goes to restarts
_STARTS = 8
# The same where groups share variables, with neither greedy choices nor restarts. The study's
# start is improved so many times through all blocks before it is held against other layouts; as
# many of all as can be improved as often in the first round.
_SURROGATE_COUPLED, _ROUNDS_COUPLED, _PASSES, _MOST_ROUNDS = 0.1, 0.85, 5, 6
# Layouts optimised on the surrogate at a time, how often each is rendered, and rounds before each
# time: separable, and not. After every second time the poorer half is begun anew.
_LAYOUTS, _RENDERED, _SURROGATE_ROUNDS, _SURROGATE_ROUNDS_COUPLED = 32, 8, 8, 4
# Restarts that are rendered at first; places predicted for each, and rounds on the surrogate.
_RESTARTS, _PREDICTED, _RESTART_ROUNDS = 64, 8, 4
# Of these go on to local search, a power of 2; steps before half of them leave.
_SURVIVORS, _STEPS = 8, 1

Run = tuple[Floats, float]  # a layout (D,) and its value


def auto(problem: Problem) -> Script:
    """Search until all maps that may be rendered are."""
    x = problem.start
    (value,) = yield problem.ask(x[None], range(len(problem.moved_by)), METHOD)
    start = (x, float(value))
    if all(group.is_separable for group in sensor_groups(problem)):
        yield from _search_separable(problem, start)
    else:
        yield from _search_coupled(problem, start)


def _search_separable(problem: Problem, start: Run) -> Script:
    """Search where no groups share variables: maps of one are good beside any others."""
    runs = yield from _make_starts(problem, start)
    found = [x for x, _ in runs]  # where each start and each restart came to
    blocks, dearest = cycle(problem.blocks), _dearest_restart(problem)
    rounds = len(runs).bit_length() - 1
    begin = problem.maps_rendered
    for _ in range(rounds):
        share = (_ROUNDS * problem.max_maps - begin) / rounds / len(runs)
        for number, run in enumerate(runs):
            end = problem.maps_rendered + share
            run = yield from search_locally(problem, run[0], run[1], int(_LOCAL * share))
            while problem.maps_rendered < end and dearest <= problem.left():
                run = yield from _try_restart(problem, run, next(blocks), found)
            runs[number] = run
        found += [x for x, _ in runs]
        runs = _take_best(runs, len(runs) // 2)
        runs[0] = yield from _combine(problem, runs[0], found)
    run = runs[0]
    while problem.maps_rendered < _RESTARTED * problem.max_maps and dearest <= problem.left():
        run = yield from _try_restart(problem, run, next(blocks), found)
        run = yield from _combine(problem, run, found)
    yield from search_locally(problem, *run)


def _search_coupled(problem: Problem, start: Run) -> Script:
    """Search where groups share variables: a restart would cost the maps of all that share them."""
    one_pass = TRIES * problem.models * sum(len(block.sensors) for block in problem.blocks)
    start = yield from search_locally(problem, *start, _PASSES * one_pass)
    layouts = yield from _make_surrogate_layouts(
        problem, _SURROGATE_COUPLED, _SURROGATE_ROUNDS_COUPLED, CANDIDATES_COUPLED
    )
    left = _ROUNDS_COUPLED * problem.max_maps - problem.maps_rendered
    enough = [r for r in range(_MOST_ROUNDS) if left >= r * 2**r * _PASSES * one_pass]
    runs = _take_best([start, *layouts], 2 ** max(enough, default=0))
    rounds = len(runs).bit_length() - 1
    for _ in range(rounds):
        for number, run in enumerate(runs):
            runs[number] = yield from search_locally(problem, *run, int(left / rounds / len(runs)))
        runs = _take_best(runs, len(runs) // 2)
    yield from search_locally(problem, *runs[0])


def _take_best(runs: list[Run], n: int) -> list[Run]:
    """Return the ``n`` best runs, best first."""
    return sorted(runs, key=lambda run: -run[1])[:n]


def _make_starts(problem: Problem, start: Run) -> Script:
    """Return layouts for local search and their values, the study's own start among them."""
    # as many as can be restarted
    starts = min(_STARTS, max(2, int(_ROUNDS * problem.max_maps / _dearest_restart(problem))))
    layouts, values = yield from place_greedily(problem, int(_GREEDY * problem.max_maps), starts)
    others = yield from _make_surrogate_layouts(
        problem, _SURROGATE - _GREEDY, _SURROGATE_ROUNDS, CANDIDATES
    )
    return _take_best([start, *zip(layouts, values.tolist(), strict=True), *others], starts)


def _make_surrogate_layouts(problem: Problem, share: float, rounds: int, candidates: int) -> Script:
    """Return layouts optimised on the surrogate alone and their values, for a share of the budget.

    ``rounds`` before each time that they are rendered, among so many ``candidates`` a step.
    """
    sensors = range(len(problem.moved_by))
    n = min(_LAYOUTS, int(share * problem.max_maps / (_RENDERED * len(sensors) * problem.models)))
    if n == 0:
        return []
    x, values = problem.box.uniform(n, problem.rng, reach=1.5), np.full(n, -np.inf)
    given_up: list[Run] = []
    for time in range(1, _RENDERED + 1):
        new, _ = optimize_on_surrogate(
            problem, x, problem.blocks, rounds, with_restarts=True, candidates=candidates
        )
        new_values = yield problem.ask(new, sensors, METHOD)
        is_better = new_values > values
        x = np.where(is_better[:, None], new, x)
        values = np.where(is_better, new_values, values)
        if time % 2 == 0 and time < _RENDERED:
            poor = np.argsort(-values, kind="stable")[(n + 1) // 2 :]
            given_up += [(x[k].copy(), float(values[k])) for k in poor]
            x[poor] = problem.box.uniform(len(poor), problem.rng, reach=1.5)
            values[poor] = -np.inf
    return [*given_up, *zip(x, values.tolist(), strict=True)]


def restart_cost(problem: Problem, block: Block) -> int:
    """Return the most maps that a restart of a block renders."""
    steps = _STEPS * TRIES * (2 * _SURVIVORS - 1)  # of all survivors, half of them, ..., one
    return (_RESTARTS + steps) * len(block.sensors) * problem.models


def restart_block(problem: Problem, x: Floats, block: Block) -> Script:
    """Return the best layout found that differs from one (D,) in a block, and its value.

    Many places for the block are drawn, and optimised on the surrogate from the best predicted;
    those are rendered beside all else as it stands. Successive halving, with a step of local
    search for each in each round, leaves one of the best.
    """
    layouts = np.repeat(x[None], _RESTARTS, axis=0)
    drawn = redraw(problem, layouts, block, _PREDICTED)
    layouts, _ = take_best(problem, layouts, np.full(_RESTARTS, -np.inf), drawn)
    layouts, _ = optimize_on_surrogate(
        problem, layouts, [block], _RESTART_ROUNDS, with_restarts=False
    )
    values = yield problem.ask(layouts, block.sensors, METHOD_RESTART)
    stay = _SURVIVORS
    while stay:
        best = np.argsort(-values, kind="stable")[:stay]
        layouts, values = layouts[best], values[best]
        for _ in range(_STEPS):
            candidates = np.concatenate([propose(problem, layout, block) for layout in layouts])
            new_values = yield problem.ask(candidates, block.sensors, METHOD_RESTART)
            rows = np.arange(len(layouts))
            best = new_values.reshape(-1, TRIES).argmax(axis=1) + rows * TRIES
            is_better = new_values[best] >= values  # on a plateau they may wander
            layouts = np.where(is_better[:, None], candidates[best], layouts)
            values = np.where(is_better, new_values[best], values)
        stay //= 2
    return layouts[0], float(values[0])


def _dearest_restart(problem: Problem) -> int:
    """Return the maps that the dearest restart takes."""
    return max(restart_cost(problem, block) for block in problem.blocks)


def _try_restart(problem: Problem, run: Run, block: Block, found: list[Floats]) -> Script:
    """Return a run, or its restart in a block if that is no worse; note where that came to."""
    layout, value = yield from restart_block(problem, run[0], block)
    found.append(layout)
    return (layout, value) if value >= run[1] else run


def _combine(problem: Problem, run: Run, found: list[Floats]) -> Script:
    """Return a run with each group, all separable, at the best place of any in ``found``."""
    groups = sensor_groups(problem)
    x, value = run
    places: dict[object, Floats] = {}
    for group in {group.kind: group for group in groups}.values():
        alike = [other.columns for other in groups if other.kind == group.kind]
        known = np.unique([layout[columns] for layout in found for columns in alike], axis=0)
        layouts = np.repeat(x[None], len(known), axis=0)
        layouts[:, group.columns] = places[group.kind] = known
        # counted as if none of the maps were kept any more; from here on they must be
        poses = len(known) * len(group.sensors)
        if poses > min(problem.left() // problem.models, problem.most_poses // 2):
            return run
        yield problem.ask(layouts, group.sensors, "recombine", group.sensors)
    other_value, other = yield from exchange(problem, groups, places, x)
    return (other, float(other_value)) if other_value > value else run
