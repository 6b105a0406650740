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

from glvis.search.greedy import exchange, place_greedily, sensor_groups
from glvis.search.local_search import (
    optimize_on_surrogate,
    propose,
    redraw,
    search_locally,
    take_best,
)
from glvis.search.script import Block, Floats, Problem, Script

# Names of stages in the trace, beside those of greedy.py and local_search.py.
START, SURROGATE, RESTART, RECOMBINE = "start", "surrogate", "restart", "recombine"

Run = tuple[Floats, float]  # a layout (D,) and its value


def auto(problem: Problem) -> Script:
    """Search until all maps that may be rendered are."""
    x = problem.start
    (value,) = yield problem.ask(x[None], range(len(problem.moved_by)), START)
    start = (x, float(value))
    if all(group.is_separable for group in sensor_groups(problem)):
        yield from _search_separable(problem, start)
    else:
        yield from _search_coupled(problem, start)


def _search_separable(problem: Problem, start: Run) -> Script:
    """Search where no groups share variables: maps of one are good beside any others."""
    options = problem.options
    runs = yield from _make_starts(problem, start)
    found = [x for x, _ in runs]  # where each start and each restart came to
    blocks, dearest = cycle(problem.blocks), _dearest_restart(problem)
    rounds = len(runs).bit_length() - 1
    begin = problem.maps_rendered
    for _ in range(rounds):
        share = (options.halving_share * problem.max_maps - begin) / rounds / len(runs)
        for number, run in enumerate(runs):
            end = problem.maps_rendered + share
            run = yield from search_locally(
                problem, run[0], run[1], int(options.local_share * share)
            )
            while problem.maps_rendered < end and dearest <= problem.left():
                run = yield from _try_restart(problem, run, next(blocks), found)
            runs[number] = run
        found += [x for x, _ in runs]
        runs = _keep_best(runs, len(runs) // 2)
        runs[0] = yield from _recombine(problem, runs[0], found)
    run = runs[0]
    end = options.restart_share * problem.max_maps
    while problem.maps_rendered < end and dearest <= problem.left():
        run = yield from _try_restart(problem, run, next(blocks), found)
        run = yield from _recombine(problem, run, found)
    yield from search_locally(problem, *run)


def _search_coupled(problem: Problem, start: Run) -> Script:
    """Search where groups share variables: a restart would cost the maps of all that share them."""
    options = problem.options
    one_pass = options.tries * problem.models * sum(len(block.sensors) for block in problem.blocks)
    start = yield from search_locally(problem, *start, options.passes * one_pass)
    layouts = yield from _make_surrogate_layouts(
        problem,
        options.surrogate_share_coupled,
        options.rounds_coupled,
        options.candidates_coupled,
    )
    left = options.halving_share_coupled * problem.max_maps - problem.maps_rendered
    enough = [
        r for r in range(options.halvings + 1) if left >= r * 2**r * options.passes * one_pass
    ]
    runs = _keep_best([start, *layouts], 2 ** max(enough, default=0))
    rounds = len(runs).bit_length() - 1
    for _ in range(rounds):
        for number, run in enumerate(runs):
            runs[number] = yield from search_locally(problem, *run, int(left / rounds / len(runs)))
        runs = _keep_best(runs, len(runs) // 2)
    yield from search_locally(problem, *runs[0])


def _keep_best(runs: list[Run], n: int) -> list[Run]:
    """Return the ``n`` best runs, best first."""
    return sorted(runs, key=lambda run: -run[1])[:n]


def _make_starts(problem: Problem, start: Run) -> Script:
    """Return layouts for local search and their values, the study's own start among them."""
    options, maps = problem.options, problem.max_maps
    can_restart = int(options.halving_share * maps / _dearest_restart(problem))
    starts = min(options.starts, max(2, can_restart))
    layouts, values = yield from place_greedily(problem, int(options.greedy_share * maps), starts)
    others = yield from _make_surrogate_layouts(
        problem,
        options.surrogate_share - options.greedy_share,
        options.rounds,
        options.candidates,
    )
    return _keep_best([start, *zip(layouts, values.tolist(), strict=True), *others], starts)


def _make_surrogate_layouts(problem: Problem, share: float, rounds: int, candidates: int) -> Script:
    """Return layouts optimised on the surrogate alone and their values, for a share of the budget.

    ``rounds`` before each time that they are rendered, among so many ``candidates`` a step.
    """
    options, sensors = problem.options, range(len(problem.moved_by))
    maps = options.renders * len(sensors) * problem.models  # of a layout
    n = min(options.layouts, int(share * problem.max_maps / maps))
    if n == 0:
        return []
    x = problem.box.uniform(n, problem.rng, options.reach)
    values = np.full(n, -np.inf)
    given_up: list[Run] = []
    for time in range(1, options.renders + 1):
        new, _ = optimize_on_surrogate(
            problem, x, problem.blocks, rounds, candidates, with_restarts=True
        )
        new_values = yield problem.ask(new, sensors, SURROGATE)
        is_better = new_values > values
        x = np.where(is_better[:, None], new, x)
        values = np.where(is_better, new_values, values)
        if time % 2 == 0 and time < options.renders:
            poor = np.argsort(-values, kind="stable")[(n + 1) // 2 :]
            given_up += [(x[k].copy(), float(values[k])) for k in poor]
            x[poor] = problem.box.uniform(len(poor), problem.rng, options.reach)
            values[poor] = -np.inf
    return [*given_up, *zip(x, values.tolist(), strict=True)]


def restart_cost(problem: Problem, block: Block) -> int:
    """Return the most maps that a restart of a block renders."""
    options = problem.options
    # of all survivors, half of them, ..., one
    steps = options.survivor_steps * options.tries * (2 * options.survivors - 1)
    return (options.restarts + steps) * len(block.sensors) * problem.models


def restart_block(problem: Problem, x: Floats, block: Block) -> Script:
    """Return the best layout found that differs from one (D,) in a block, and its value.

    Many places for the block are drawn, and optimised on the surrogate from the best predicted;
    those are rendered beside all else as it stands. Successive halving, with a step of local
    search for each in each round, leaves one of the best.
    """
    options = problem.options
    layouts = np.repeat(x[None], options.restarts, axis=0)
    drawn = redraw(problem, layouts, block, options.restart_poses)
    layouts, _ = take_best(problem, layouts, np.full(options.restarts, -np.inf), drawn)
    layouts, _ = optimize_on_surrogate(
        problem, layouts, [block], options.restart_rounds, options.candidates, with_restarts=False
    )
    values = yield problem.ask(layouts, block.sensors, RESTART)
    stay = options.survivors
    while stay:
        best = np.argsort(-values, kind="stable")[:stay]
        layouts, values = layouts[best], values[best]
        for _ in range(options.survivor_steps):
            candidates = np.concatenate([propose(problem, layout, block) for layout in layouts])
            new_values = yield problem.ask(candidates, block.sensors, RESTART)
            rows = np.arange(len(layouts))
            best = new_values.reshape(-1, options.tries).argmax(axis=1) + rows * options.tries
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


def _recombine(problem: Problem, run: Run, found: list[Floats]) -> Script:
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
        yield problem.ask(layouts, group.sensors, RECOMBINE, group.sensors)
    other_value, other = yield from exchange(problem, groups, places, x)
    return (other, float(other_value)) if other_value > value else run
