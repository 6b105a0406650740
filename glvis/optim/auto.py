"""The method for new studies: several starts refined, the better half for longer, then rivals.

Independent mounts start from greedy choices, of which many come from one set of maps. Where
mounts share variables, maps cannot be shared so, and fewer starts are made.
"""

from __future__ import annotations

import numpy as np

from glvis.optim.greedy import exchanged, greedy, mounts_of
from glvis.optim.refine import METHOD, Steps, refine, steps_of
from glvis.optim.rivals import challenge
from glvis.optim.script import Floats, Problem, Script

# Shares of the budget at whose end a stage ends: greedy starts, rounds in which half of them
# drop out, rivals; the rest refines.
_GREEDY, _ROUNDS, _RIVALS = 0.15, 0.45, 0.85
_STARTS, _STARTS_COUPLED = 8, 2

Run = tuple[Floats, float, list[Steps]]  # a layout (D,), its value, how it is moved


def auto(problem: Problem) -> Script:
    """Search until all maps that may be rendered are."""
    runs = yield from _starts(problem)
    found = [x for x, _, _ in runs]  # where each run stands, those that dropped out as well
    staying = list(range(len(runs)))
    rounds = len(runs).bit_length() - 1
    for _ in range(rounds):
        share = int((_ROUNDS - _GREEDY) * problem.max_maps / rounds / len(staying))
        for number in staying:
            runs[number] = yield from _refined(problem, runs[number], share)
            found[number] = runs[number][0]
        staying = sorted(staying, key=lambda number: -runs[number][1])[: len(staying) // 2]
    run = yield from _recombined(problem, runs[staying[0]], found)
    blocks, number = problem.blocks, 0
    while problem.maps_rendered < _RIVALS * problem.max_maps:
        rival, value = yield from challenge(problem, run[0], blocks[number % len(blocks)])
        number += 1
        found.append(rival)
        if value >= run[1]:
            run = rival, value, steps_of(problem)
        if number % len(blocks) == 0:
            run = yield from _recombined(problem, run, found)
    yield from _refined(problem, run)


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
        yield problem.ask(layouts, mount.sensors, METHOD, mount.sensors)
    other_value, other = yield from exchanged(problem, mounts, places, x)
    return (other, float(other_value), steps_of(problem)) if other_value > value else run


def _starts(problem: Problem) -> Script:
    """Return layouts to refine: (x, value, steps) each, the study's own start among them."""
    x = problem.start
    (value,) = yield problem.ask(x[None], range(len(problem.moved_by)), METHOD)
    found: list[tuple[Floats, float]] = [(x, float(value))]
    budget = int(_GREEDY * problem.max_maps)
    if all(mount.is_alone for mount in mounts_of(problem)):
        layouts, values = yield from greedy(problem, budget, _STARTS)
        found += zip(layouts, values.tolist(), strict=True)
    else:
        for _ in range(_STARTS_COUPLED):
            layouts, values = yield from greedy(problem, budget // _STARTS_COUPLED)
            found += zip(layouts, values.tolist(), strict=True)
    found = sorted(found, key=lambda start: -start[1])[:_STARTS]
    return [(x, value, steps_of(problem)) for x, value in found]
