"""Local search: one coordinate block at a time, by steps of all sizes, ranked by the surrogate.

Of many candidates the few that the surrogate ranks best are rendered (`search_locally`), or none
at all (`optimize_on_surrogate`): a layout that was optimised on the surrogate alone costs no map,
and shows where it is worth to render any.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from glvis.search.script import Block, Floats, Problem, Script

METHOD = "local search"


def search_locally(problem: Problem, x: Floats, value: float, maps: int | None = None) -> Script:
    """Return a better layout (D,) and its value; without ``maps``, until the search is stopped.

    Parameters
    ----------
    problem : Problem
        What is searched.
    x, value : (D,) float64, float
        Where to begin, and its value.
    maps : int, optional
        To spend, about.
    """
    begin = problem.maps_rendered
    while maps is None or problem.maps_rendered - begin < maps:
        for block in problem.blocks:
            candidates = propose(problem, x, block)
            values = yield problem.ask(candidates, block.sensors, METHOD)
            best = int(values.argmax())
            if values[best] >= value:  # on a plateau it may wander
                x, value = candidates[best], float(values[best])
    return x, value


def propose(problem: Problem, x: Floats, block: Block) -> Floats:
    """Return the candidates (K, D) around one layout (D,) that the surrogate ranks best.

    What several groups share is shifted alone, and each group adapts to that on the surrogate:
    where a height changes, all sensors at that height must turn.
    """
    options = problem.options
    inner = [other for other in problem.blocks if {*other.sensors} < {*block.sensors}]
    if inner:
        around = perturb(problem, x[None], block.own, options.shifts)[0]
        around, predicted = optimize_on_surrogate(
            problem,
            around,
            inner,
            options.shift_rounds,
            options.candidates_coupled,
            with_restarts=False,
        )
    else:
        n = options.tries * _affordable(problem, options.tries_predicted, block)
        around = perturb(problem, x[None], block.columns, n)[0]
        predicted = problem.surrogate(around, None)
    return around[np.argsort(-predicted, kind="stable")[: options.tries]]


def optimize_on_surrogate(
    problem: Problem,
    x: Floats,
    blocks: Sequence[Block],
    rounds: int,
    candidates: int,
    *,
    with_restarts: bool,
) -> tuple[Floats, Floats]:
    """Return layouts (K, D), each moved from its own of x (K, D), and their predicted values.

    In each round each block takes the best of so many ``candidates`` around it; with
    ``with_restarts``, as many again are drawn uniformly from the block's bounds.
    """
    predicted = problem.surrogate(x, None)
    for _ in range(rounds):
        for block in blocks:
            n = _affordable(problem, candidates, block)
            around = perturb(problem, x, block.columns, n)
            if with_restarts:
                drawn = redraw(problem, x, block, n)
                around = np.concatenate([drawn, around], axis=1)
            x, predicted = take_best(problem, x, predicted, around)
    return x, predicted


def perturb(problem: Problem, x: Floats, columns: Sequence[int], n: int) -> Floats:
    """Return layouts (K, n, D) at all distances from x (K, D), about half of ``columns`` moved."""
    rng, box, moving = problem.rng, problem.box, np.array(columns)
    shape = (len(x), n, len(moving))
    size = _power_of_two(rng.uniform(*problem.options.step_sizes, (*shape[:2], 1)))
    moved = rng.random(shape) < 0.5
    moved |= np.arange(len(moving)) == rng.integers(len(moving), size=(*shape[:2], 1))
    around = np.repeat(x[:, None], n, axis=1)
    around[:, :, moving] += size * moved * rng.standard_normal(shape) * box.range[moving]
    return box.inside(around)


def redraw(problem: Problem, x: Floats, block: Block, n: int) -> Floats:
    """Return layouts (K, n, D) that differ from x (K, D) in a block, drawn uniformly."""
    columns = np.array(block.columns)
    drawn = problem.box.uniform(len(x) * n, problem.rng, problem.options.reach).reshape(
        len(x), n, -1
    )
    layouts = np.repeat(x[:, None], n, axis=1)
    layouts[:, :, columns] = drawn[:, :, columns]
    return layouts


def take_best(
    problem: Problem, x: Floats, predicted: Floats, candidates: Floats
) -> tuple[Floats, Floats]:
    """Return each of x (K, D), or the best of its ``candidates`` (K, n, D) where that is better.

    Their predicted values (K,) come with them.
    """
    values = problem.surrogate(candidates.reshape(-1, x.shape[1]), None)
    values = values.reshape(candidates.shape[:2])
    rows, best = np.arange(len(x)), values.argmax(axis=1)
    is_better = values[rows, best] > predicted
    x = np.where(is_better[:, None], candidates[rows, best], x)
    return x, np.where(is_better, values[rows, best], predicted)


def _affordable(problem: Problem, n: int, block: Block) -> int:
    """Return how many candidates to predict: by the sensors that move, or it takes too long."""
    return max(n // len(block.sensors), problem.options.candidates_least)


def _power_of_two(exponent: Floats) -> Floats:
    """Return about 2 ** exponent, to 6 %, and the same bits on every processor."""
    whole = np.floor(exponent)
    return np.ldexp(1 + (exponent - whole), whole.astype(int))
