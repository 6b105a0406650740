"""Rivals: one block of variables somewhere else altogether, where climbing alone would not lead.

Many places are drawn and guessed at, and sketched on from the best; those are rendered beside all
else as it stands, climb for a while, and half of them leave at a time. Only the block's sensors
move.
"""

from __future__ import annotations

import numpy as np

from glvis.optim.climb import TRIES, anywhere, best_of, likely, sketched
from glvis.optim.script import Block, Floats, Problem, Script

METHOD = "rivals"
# See auto.py for what was measured.
_RIVALS, _GUESSES = 64, 8  # rendered at first; places guessed at for each
_SKETCHES = 4  # steps by the guess before
_CLIMBERS = 8  # of them climb, a power of 2
_CLIMBS = 1  # before half of them leave


def cost(problem: Problem, block: Block) -> int:
    """Return the most maps that a challenge renders."""
    climbs = _CLIMBS * TRIES * (2 * _CLIMBERS - 1)  # all climbers, half of them, ..., one
    return (_RIVALS + climbs) * len(block.sensors) * problem.models


def challenge(problem: Problem, x: Floats, block: Block) -> Script:
    """Return the best rival of a layout (D,) that differs in one block, and its value."""
    rivals = np.repeat(x[None], _RIVALS, axis=0)
    drawn = anywhere(problem, rivals, block, _GUESSES)
    rivals, _ = best_of(problem, rivals, np.full(_RIVALS, -np.inf), drawn)
    rivals, _ = sketched(problem, rivals, [block], _SKETCHES, with_leaps=False)
    values = yield problem.ask(rivals, block.sensors, METHOD)
    stay = _CLIMBERS
    while stay:
        best = np.argsort(-values, kind="stable")[:stay]
        rivals, values = rivals[best], values[best]
        for _ in range(_CLIMBS):
            tried = np.concatenate([likely(problem, rival, block) for rival in rivals])
            told = yield problem.ask(tried, block.sensors, METHOD)
            rows = np.arange(len(rivals))
            best = told.reshape(-1, TRIES).argmax(axis=1) + rows * TRIES
            better = told[best] >= values  # on a plateau they may wander
            rivals = np.where(better[:, None], tried[best], rivals)
            values = np.where(better, told[best], values)
        stay //= 2
    return rivals[0], float(values[0])
