"""Rivals: one block of variables somewhere else altogether, where climbing alone would not lead.

Many places are drawn and guessed at; those that may be good beside all else as it stands are
rendered, climb for a while, and half of them leave at a time. Only the block's sensors move.
"""

from __future__ import annotations

import numpy as np

from glvis.optim.script import Block, Floats, Problem, Script

METHOD = "rivals"
# See auto.py for what was measured.
_RIVALS, _GUESSES = 16, 32  # rendered at first, a power of 2; places guessed at for each
_CLIMBS = 4  # before half of them leave
_TRIES, _TRIED_OF = 4, 4  # rendered of each climb; guessed at for each
_STEPS = (-2.5, -0.5)  # powers of ten between which a step lies, in shares of the range


def cost(problem: Problem, block: Block) -> int:
    """Return the most maps that a challenge renders."""
    climbs = _CLIMBS * _TRIES * (_RIVALS - 1)  # half of the rivals, a quarter, ..., one
    return (_RIVALS + climbs) * len(block.sensors) * problem.models


def challenge(problem: Problem, x: Floats, block: Block) -> Script:
    """Return the best rival of a layout (D,) that differs in one block, and its value."""
    n, columns = _RIVALS, np.array(block.columns)
    drawn = np.repeat(x[None], n * _GUESSES, axis=0)
    drawn[:, columns] = problem.box.uniform(len(drawn), problem.rng, reach=1.5)[:, columns]
    rivals = drawn.reshape(n, _GUESSES, -1)
    best = problem.guess(drawn, None).reshape(n, _GUESSES).argmax(axis=1)
    rivals = rivals[np.arange(n), best]
    values = yield problem.ask(rivals, block.sensors, METHOD)
    while len(rivals) > 1:
        stay = np.argsort(-values, kind="stable")[: len(rivals) // 2]
        rivals, values = rivals[stay], values[stay]
        for _ in range(_CLIMBS):
            tried = np.concatenate([_around(problem, rival, block) for rival in rivals])
            told = yield problem.ask(tried, block.sensors, METHOD)
            rows = np.arange(len(rivals))
            best = told.reshape(-1, _TRIES).argmax(axis=1) + rows * _TRIES
            better = told[best] >= values  # on a plateau they may wander
            rivals = np.where(better[:, None], tried[best], rivals)
            values = np.where(better, told[best], values)
    return rivals[0], float(values[0])


def _around(problem: Problem, x: Floats, block: Block) -> Floats:
    """Return positions (n, D) at all distances from one, about half of the block moved."""
    rng, box, columns = problem.rng, problem.box, np.array(block.columns)
    shape = (_TRIES * _TRIED_OF, len(columns))
    size = 10 ** rng.uniform(*_STEPS, (shape[0], 1))
    moved = rng.random(shape) < 0.5
    moved[np.arange(shape[0]), rng.integers(shape[1], size=shape[0])] = True  # one at least
    around = np.repeat(x[None], shape[0], axis=0)
    around[:, columns] += size * moved * rng.standard_normal(shape) * box.range[columns]
    around = box.inside(around)
    likely = np.argsort(-problem.guess(around, None), kind="stable")[:_TRIES]
    return around[likely]
