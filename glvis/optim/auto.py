"""The method for new studies: several starts refined and challenged, the better half for longer.

Independent mounts start from greedy choices, of which many come from one set of maps. Where
mounts share variables, maps cannot be shared so, and fewer starts are made. Refinement alone
stays on the hill it began on; rivals look for others, one block at a time, and what all runs
found is combined. Before a pose is rendered it is guessed at: ``guess.py``.

The constants were chosen on a kitchen with two Kinects (8,000 maps, 6 to 8 seeds other than those
reported) whose hidden faces came from a table of rays, to save time. Share of the faces seen:
54.5 % with uniform draws, 4 starts and refinement; 55.9 % with the best guess of 8 drawn from a
range 1.5 times as wide; on other seeds, 57.0 % with 16 starts and rivals in every round. About 35
variants were tried there. Seeds spread by 1 to 1.5 %, so the late choices stand on little.
"""

from __future__ import annotations

from itertools import cycle

import numpy as np

from glvis.optim.greedy import exchanged, greedy, mounts_of
from glvis.optim.refine import METHOD, Steps, refine, steps_of
from glvis.optim.rivals import challenge, cost
from glvis.optim.script import Block, Floats, Problem, Script

# Shares of the budget at whose end a stage ends: greedy starts, rounds in which half of them
# drop out, rivals of the last; the rest refines. Of starts so many that each can be challenged.
_GREEDY, _ROUNDS, _RIVALS = 0.15, 0.7, 0.85
_REFINED = 0.5  # of a round; the other half goes to rivals
_STARTS, _STARTS_COUPLED = 16, 2

Run = tuple[Floats, float, list[Steps]]  # a layout (D,), its value, how it is moved


def auto(problem: Problem) -> Script:
    """Search until all maps that may be rendered are."""
    runs = yield from _starts(problem)
    found = [x for x, _, _ in runs]  # where each start and each rival came to
    blocks, dearest = cycle(problem.blocks), _dearest(problem)
    rounds = len(runs).bit_length() - 1
    for _ in range(rounds):
        share = (_ROUNDS - _GREEDY) * problem.max_maps / rounds / len(runs)
        for number, run in enumerate(runs):
            end = problem.maps_rendered + share
            run = yield from _refined(problem, run, int(_REFINED * share))
            while problem.maps_rendered < end and dearest <= problem.left():
                run = yield from _challenged(problem, run, next(blocks), found)
            runs[number] = run
        found += [x for x, _, _ in runs]
        runs = sorted(runs, key=lambda run: -run[1])[: len(runs) // 2]
        runs[0] = yield from _recombined(problem, runs[0], found)
    run = runs[0]
    while problem.maps_rendered < _RIVALS * problem.max_maps and dearest <= problem.left():
        run = yield from _challenged(problem, run, next(blocks), found)
        run = yield from _recombined(problem, run, found)
    yield from _refined(problem, run)


def _dearest(problem: Problem) -> int:
    """Return the maps that the dearest challenge takes."""
    return max(cost(problem, block) for block in problem.blocks)


def _challenged(problem: Problem, run: Run, block: Block, found: list[Floats]) -> Script:
    """Return a run, or its best rival in a block if that is no worse; note where that came to."""
    rival, value = yield from challenge(problem, run[0], block)
    found.append(rival)
    return (rival, value, steps_of(problem)) if value >= run[1] else run


def _refined(problem: Problem, run: Run, maps: int | None = None) -> Script:
    """Return a run after so many maps more."""
    x, value, steps = run
    better = yield from refine(problem, x, value, steps, maps)
    return (*better, steps)


def _recombined(problem: Problem, run: Run, found: list[Floats]) -> Script:
    """Return a run with each independent mount at the best place of any in ``found``."""
    mounts = [mount for mount in mounts_of(problem) if mount.is_alone]
    if not mounts:
        return run
    x, value, _ = run
    places: dict[object, Floats] = {}
    for mount in {mount.kind: mount for mount in mounts}.values():
        alike = [other.columns for other in mounts if other.kind == mount.kind]
        known = np.unique([layout[columns] for layout in found for columns in alike], axis=0)
        layouts = np.repeat(x[None], len(known), axis=0)
        layouts[:, mount.columns] = places[mount.kind] = known
        # counted as if none of the maps were kept any more
        if len(known) * len(mount.sensors) * problem.models > problem.left():
            return run
        yield problem.ask(layouts, mount.sensors, METHOD, mount.sensors)
    other_value, other = yield from exchanged(problem, mounts, places, x)
    return (other, float(other_value), steps_of(problem)) if other_value > value else run


def _starts(problem: Problem) -> Script:
    """Return layouts to refine: (x, value, steps) each, the study's own start among them."""
    x = problem.start
    (value,) = yield problem.ask(x[None], range(len(problem.moved_by)), METHOD)
    found: list[tuple[Floats, float]] = [(x, float(value))]
    budget = int(_GREEDY * problem.max_maps)
    starts = min(_STARTS, max(2, int(_ROUNDS * problem.max_maps / _dearest(problem))))
    if all(mount.is_alone for mount in mounts_of(problem)):
        layouts, values = yield from greedy(problem, budget, starts)
        found += zip(layouts, values.tolist(), strict=True)
    else:
        for _ in range(_STARTS_COUPLED):
            layouts, values = yield from greedy(problem, budget // _STARTS_COUPLED)
            found += zip(layouts, values.tolist(), strict=True)
    found = sorted(found, key=lambda start: -start[1])[:starts]
    return [(x, value, steps_of(problem)) for x, value in found]
