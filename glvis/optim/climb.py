"""Climbing: one block of variables at a time, by steps of all sizes, guessed at before rendered.

Of many steps those that may be good are rendered (``climbed``), or none at all (``sketched``):
a layout that is only sketched costs no map, and shows where it is worth to render any.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from glvis.optim.script import Block, Floats, Problem, Script

METHOD = "climb"
# Rendered of each climb, and guessed at for each of them. See auto.py for what was measured.
TRIES, _TRIED_OF = 4, 16
_STEPS = (-8.3, -1.7)  # powers of two between which a step lies, in shares of the range
STEPS = 32  # of a sketch
# Shifts of what mounts share; rounds in which each mount adapts, and steps then.
_SHIFTS, _ADAPTED, STEPS_COUPLED = 8, 1, 16
_LEAST = 4  # of both, where many sensors move at once


def _fewer(n: int, block: Block) -> int:
    """Return how many steps to guess at: by the sensors that move, or guessing takes too long."""
    return max(n // len(block.sensors), _LEAST)


def climbed(problem: Problem, x: Floats, value: float, maps: int | None = None) -> Script:
    """Return a better layout (D,) and its value; without ``maps``, until somebody stops it.

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
            tried = likely(problem, x, block)
            values = yield problem.ask(tried, block.sensors, METHOD)
            best = int(values.argmax())
            if values[best] >= value:  # on a plateau it may wander
                x, value = tried[best], float(values[best])
    return x, value


def likely(problem: Problem, x: Floats, block: Block) -> Floats:
    """Return the positions (TRIES, D) around one (D,) that have the best guesses of many.

    What several mounts share is shifted alone, and each mount adapts to that by the guess: where
    a height changes, all that stand there must look elsewhere.
    """
    inner = [other for other in problem.blocks if {*other.sensors} < {*block.sensors}]
    if inner:
        around = near(problem, x[None], block.own, _SHIFTS)[0]
        around, guesses = sketched(
            problem, around, inner, _ADAPTED, with_leaps=False, steps=STEPS_COUPLED
        )
    else:
        around = near(problem, x[None], block.columns, TRIES * _fewer(_TRIED_OF, block))[0]
        guesses = problem.guess(around, None)
    return around[np.argsort(-guesses, kind="stable")[:TRIES]]


def near(problem: Problem, x: Floats, moving: Sequence[int], n: int) -> Floats:
    """Return positions (K, n, D) at all distances from x (K, D), about half of ``moving`` moved."""
    rng, box, columns = problem.rng, problem.box, np.array(moving)
    shape = (len(x), n, len(columns))
    size = _power_of_two(rng.uniform(*_STEPS, (*shape[:2], 1)))
    moved = rng.random(shape) < 0.5
    moved |= np.arange(len(columns)) == rng.integers(len(columns), size=(*shape[:2], 1))
    around = np.repeat(x[:, None], n, axis=1)
    around[:, :, columns] += size * moved * rng.standard_normal(shape) * box.range[columns]
    return box.inside(around)


def _power_of_two(exponent: Floats) -> Floats:
    """Return about 2 ** exponent, to 6 %, and the same bits on every processor."""
    whole = np.floor(exponent)
    return np.ldexp(1 + (exponent - whole), whole.astype(int))


def anywhere(problem: Problem, x: Floats, block: Block, n: int) -> Floats:
    """Return positions (K, n, D) that differ from x (K, D) in a block, which may be anywhere."""
    columns = np.array(block.columns)
    drawn = problem.box.uniform(len(x) * n, problem.rng, reach=1.5).reshape(len(x), n, -1)
    places = np.repeat(x[:, None], n, axis=1)
    places[:, :, columns] = drawn[:, :, columns]
    return places


def sketched(
    problem: Problem,
    x: Floats,
    blocks: Sequence[Block],
    rounds: int,
    *,
    with_leaps: bool,
    steps: int = STEPS,
) -> tuple[Floats, Floats]:
    """Return layouts (K, D) moved from x (K, D) to better guesses, each by itself, and these.

    ``with_leaps`` lets a block leave for anywhere as well; it goes the best of so many ``steps``.
    """
    guesses = problem.guess(x, None)
    for _ in range(rounds):
        for block in blocks:
            among = _fewer(steps, block)
            tried = near(problem, x, block.columns, among)
            if with_leaps:
                leaps = anywhere(problem, x, block, among)
                tried = np.concatenate([leaps, tried], axis=1)
            x, guesses = best_of(problem, x, guesses, tried)
    return x, guesses


def best_of(problem: Problem, x: Floats, guesses: Floats, tried: Floats) -> tuple[Floats, Floats]:
    """Return for each of x (K, D) the best guess of ``tried`` (K, n, D), if better, and guesses."""
    told = problem.guess(tried.reshape(-1, x.shape[1]), None).reshape(tried.shape[:2])
    rows, best = np.arange(len(x)), told.argmax(axis=1)
    is_better = told[rows, best] > guesses
    x = np.where(is_better[:, None], tried[rows, best], x)
    return x, np.where(is_better, told[rows, best], guesses)
