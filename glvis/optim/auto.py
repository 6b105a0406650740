"""The method for new studies: several starts, all refined for a while, the better half for longer.

Independent mounts start from greedy choices, of which many come from one set of maps. Where
mounts share variables, maps cannot be shared so, and fewer starts are made.
"""

from __future__ import annotations

from glvis.optim.greedy import greedy, mounts_of
from glvis.optim.refine import METHOD, refine, steps_of
from glvis.optim.script import Floats, Problem, Script

# Shares of the budget: for greedy starts, and for all rounds in which some of them drop out.
_GREEDY, _ROUNDS = 0.3, 0.35
_STARTS, _STARTS_COUPLED = 4, 2


def auto(problem: Problem) -> Script:
    """Search until all maps that may be rendered are."""
    runs = yield from _starts(problem)
    rounds = len(runs).bit_length() - 1
    for _ in range(rounds):
        share = int(_ROUNDS * problem.max_maps / rounds / len(runs))
        for number, (x, value, steps) in enumerate(runs):
            better = yield from refine(problem, x, value, steps, share)
            runs[number] = (*better, steps)
        runs = sorted(runs, key=lambda run: -run[1])[: len(runs) // 2]
    x, value, steps = runs[0]
    yield from refine(problem, x, value, steps)


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
