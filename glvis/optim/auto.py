"""The method for new studies: many sketches, climbed and challenged, the better half for longer.

Random poses are rendered first, to choose from them and to teach the guess (``guess.py``) what is
hidden from where. Then whole layouts are sketched by the guess; each sketch is rendered once,
which teaches the guess where it was wrong, and sketched on. The best begin to climb. Climbing
alone stays on the hill it began on; rivals look for others, one block at a time, and what all
found is combined.

Where mounts share variables a pose is good only beside what shares them, and a rival that has not
climbed loses to one that has: there the study's start climbs for a while, layouts are sketched,
and the better half of all climbs on.

The constants were chosen on a kitchen with three Kinects and 12,000 maps of 104 pixels a row, seeds
101 and 103: about a dozen variants, few of them on both seeds, so they stand on little. Seed 101
came to 67.4 % of the faces with 16 starts and as many maps for climbing as for rivals, 66.6 % where
the guess learned from first views only, 68.8 % by what was chosen and by the longest search.
Climbing by guessed steps took 150 maps to where refinement by itself came after 600 to 1,200.
From the second best hill known, 2 of 24 challenges led to the best with 32 rivals of which half
were sketched, 5 of 24 with all of them sketched, 5 with 64, for fewer maps. With 16 steps a sketch
in place of 32, four rounds of sketches in place of eight, and two steps of a rival in place of
four, a search takes half the time and finds less: with two Kinects and 8,000 maps 59.2, 58.5 and
55.3 % in place of 59.25, 59.23 and 59.25 (seeds 1 to 3).

What is done where mounts share variables was chosen on six arms with eight cameras (18 variables,
at most 15.0), seeds 1, 2, 5 and 11 to 13. With 30,000 maps, seed 2: greedy choices came to 11.65
with 3,000 maps, three sketches from there to 13.84 with 1,450; rivals took 20,700 for 0.035,
climbing 4,900 for 0.052. From 13.90, 6,000 maps of climbing by the guess led to 14.15, of
refinement to 14.00. From 13.996, where a height was wrong, 8,000 maps led to 14.02 by steps of all
variables of a block at once, to 14.18 where the height is shifted alone and mounts adapt by the
guess. Seeds 21 to 23 came with 3,000 maps to 14.15, 14.06, 14.14 from the study's start alone, with
8,000 to 13.25, 13.45, 14.06 from two sketches, to 14.16, 14.15, 14.13 from both.
"""

from __future__ import annotations

from itertools import cycle

import numpy as np

from glvis.optim.climb import STEPS, STEPS_COUPLED, TRIES, climbed, sketched
from glvis.optim.greedy import exchanged, greedy, mounts_of
from glvis.optim.rivals import challenge, cost
from glvis.optim.script import Block, Floats, Problem, Script

METHOD = "sketch"
# Shares of the budget at whose end a stage ends: greedy starts, sketches, rounds in which half
# of the runs drop out, rivals of the last; the rest climbs.
_GREEDY, _SKETCHED, _ROUNDS, _RIVALS = 0.1, 0.16, 0.6, 0.88
_CLIMBED = 0.3  # of a round; the rest goes to rivals
_STARTS = 8
# Where mounts share variables, with neither greedy choices nor rivals: what sketches take, and at
# what share rounds end. The study's start climbs so many times through all blocks before it is held
# against sketches; as many of all as can climb as often in the first round.
_SKETCHED_COUPLED, _ROUNDS_COUPLED, _CLIMBS, _MOST_ROUNDS = 0.1, 0.85, 5, 6
# Layouts sketched at a time, how often each is rendered, and rounds before each time: where mounts
# are independent, and not. After every second time the poorer half is begun anew.
_LINES, _DRAFTS, _SKETCH_ROUNDS, _SKETCH_ROUNDS_COUPLED = 32, 8, 8, 4

Run = tuple[Floats, float]  # a layout (D,) and its value


def auto(problem: Problem) -> Script:
    """Search until all maps that may be rendered are."""
    x = problem.start
    (value,) = yield problem.ask(x[None], range(len(problem.moved_by)), METHOD)
    start = (x, float(value))
    if all(mount.is_alone for mount in mounts_of(problem)):
        yield from _independent(problem, start)
    else:
        yield from _coupled(problem, start)


def _independent(problem: Problem, start: Run) -> Script:
    """Search where no mounts share variables: maps of one are good beside any others."""
    runs = yield from _starts(problem, start)
    found = [x for x, _ in runs]  # where each start and each rival came to
    blocks, dearest = cycle(problem.blocks), _dearest(problem)
    rounds = len(runs).bit_length() - 1
    begin = problem.maps_rendered
    for _ in range(rounds):
        share = (_ROUNDS * problem.max_maps - begin) / rounds / len(runs)
        for number, run in enumerate(runs):
            end = problem.maps_rendered + share
            run = yield from climbed(problem, run[0], run[1], int(_CLIMBED * share))
            while problem.maps_rendered < end and dearest <= problem.left():
                run = yield from _challenged(problem, run, next(blocks), found)
            runs[number] = run
        found += [x for x, _ in runs]
        runs = _best(runs, len(runs) // 2)
        runs[0] = yield from _recombined(problem, runs[0], found)
    run = runs[0]
    while problem.maps_rendered < _RIVALS * problem.max_maps and dearest <= problem.left():
        run = yield from _challenged(problem, run, next(blocks), found)
        run = yield from _recombined(problem, run, found)
    yield from climbed(problem, *run)


def _coupled(problem: Problem, start: Run) -> Script:
    """Search where mounts share variables: a rival would cost the maps of all that share them."""
    through = TRIES * problem.models * sum(len(block.sensors) for block in problem.blocks)
    start = yield from climbed(problem, *start, _CLIMBS * through)
    sketches = yield from _sketches(
        problem, _SKETCHED_COUPLED, _SKETCH_ROUNDS_COUPLED, STEPS_COUPLED
    )
    left = _ROUNDS_COUPLED * problem.max_maps - problem.maps_rendered
    enough = [r for r in range(_MOST_ROUNDS) if left >= r * 2**r * _CLIMBS * through]
    runs = _best([start, *sketches], 2 ** max(enough, default=0))
    rounds = len(runs).bit_length() - 1
    for _ in range(rounds):
        for number, run in enumerate(runs):
            runs[number] = yield from climbed(problem, *run, int(left / rounds / len(runs)))
        runs = _best(runs, len(runs) // 2)
    yield from climbed(problem, *runs[0])


def _best(runs: list[Run], n: int) -> list[Run]:
    """Return the ``n`` best runs, best first."""
    return sorted(runs, key=lambda run: -run[1])[:n]


def _dearest(problem: Problem) -> int:
    """Return the maps that the dearest challenge takes."""
    return max(cost(problem, block) for block in problem.blocks)


def _challenged(problem: Problem, run: Run, block: Block, found: list[Floats]) -> Script:
    """Return a run, or its best rival in a block if that is no worse; note where that came to."""
    rival, value = yield from challenge(problem, run[0], block)
    found.append(rival)
    return (rival, value) if value >= run[1] else run


def _recombined(problem: Problem, run: Run, found: list[Floats]) -> Script:
    """Return a run with each mount, all independent, at the best place of any in ``found``."""
    mounts = mounts_of(problem)
    x, value = run
    places: dict[object, Floats] = {}
    for mount in {mount.kind: mount for mount in mounts}.values():
        alike = [other.columns for other in mounts if other.kind == mount.kind]
        known = np.unique([layout[columns] for layout in found for columns in alike], axis=0)
        layouts = np.repeat(x[None], len(known), axis=0)
        layouts[:, mount.columns] = places[mount.kind] = known
        # counted as if none of the maps were kept any more; from here on they must be
        poses = len(known) * len(mount.sensors)
        if poses > min(problem.left() // problem.models, problem.most_poses // 2):
            return run
        yield problem.ask(layouts, mount.sensors, "recombine", mount.sensors)
    other_value, other = yield from exchanged(problem, mounts, places, x)
    return (other, float(other_value)) if other_value > value else run


def _starts(problem: Problem, start: Run) -> Script:
    """Return layouts to climb from and their values, the study's own start among them."""
    # as many as can be challenged
    starts = min(_STARTS, max(2, int(_ROUNDS * problem.max_maps / _dearest(problem))))
    layouts, values = yield from greedy(problem, int(_GREEDY * problem.max_maps), starts)
    sketches = yield from _sketches(problem, _SKETCHED - _GREEDY, _SKETCH_ROUNDS, STEPS)
    return _best([start, *zip(layouts, values.tolist(), strict=True), *sketches], starts)


def _sketches(problem: Problem, share: float, rounds: int, steps: int) -> Script:
    """Return layouts that were sketched, and their values, for a share of the budget.

    ``rounds`` before each time that they are rendered, among so many ``steps`` each.
    """
    sensors = range(len(problem.moved_by))
    n = min(_LINES, int(share * problem.max_maps / (_DRAFTS * len(sensors) * problem.models)))
    if n == 0:
        return []
    x, values = problem.box.uniform(n, problem.rng, reach=1.5), np.full(n, -np.inf)
    given_up: list[Run] = []
    for draft in range(1, _DRAFTS + 1):
        new, _ = sketched(problem, x, problem.blocks, rounds, with_leaps=True, steps=steps)
        told = yield problem.ask(new, sensors, METHOD)
        is_better = told > values
        x, values = np.where(is_better[:, None], new, x), np.where(is_better, told, values)
        if draft % 2 == 0 and draft < _DRAFTS:
            poor = np.argsort(-values, kind="stable")[(n + 1) // 2 :]
            given_up += [(x[k].copy(), float(values[k])) for k in poor]
            x[poor] = problem.box.uniform(len(poor), problem.rng, reach=1.5)
            values[poor] = -np.inf
    return [*given_up, *zip(x, values.tolist(), strict=True)]
