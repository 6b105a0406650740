"""Refinement: one block of variables that move together at a time, with a step that adapts.

Each block has an elitist evolution strategy of its own, (1 + n)-CMA-ES: steps are drawn from a
normal distribution that learns which directions and sizes succeed. Only the sensors of the
block move, so only their maps are rendered.

References
----------
Igel, Hansen, Roth, "Covariance Matrix Adaptation for Multi-objective Optimization",
Evolutionary Computation 15(1), 2007; its single-objective strategy, Algorithms 1 to 3.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from glvis.search.box import Box
from glvis.search.script import Block, Floats, Problem, Script

METHOD = "refine"
_STEP = 0.1  # first step, as a share of each variable's range
_SMALLEST, _LARGEST = 1e-3, 0.5
_THRESHOLD = 0.44  # success rate above which the path is not lengthened


@dataclass(eq=False)
class Steps:
    """How a block is moved: all lengths are shares of the variables' ranges.

    Attributes
    ----------
    block : Block
        What moves.
    first_size, size : float
        Global step size at the beginning, and now.
    covariance : (d, d) float64
        Of a step of size 1.
    path : (d,) float64
        Where successful steps have led lately.
    success : float
        Share of the tries that were better, smoothed.
    """

    block: Block
    first_size: float = _STEP
    size: float = field(init=False)
    covariance: Floats = field(init=False)
    path: Floats = field(init=False)
    success: float = field(init=False)

    def __post_init__(self) -> None:
        self.columns: NDArray[np.intp] = np.array(self.block.columns)
        self.tries = 4 + int(1.5 * math.log(len(self.columns)))
        self.target = 1 / (5 + math.sqrt(self.tries) / 2)
        self.begin()

    def begin(self) -> None:
        """Forget what was learned."""
        d = len(self.columns)
        self.size = self.first_size
        self.covariance, self.path, self.success = np.eye(d), np.zeros(d), self.target

    def drawn(self, x: Floats, box: Box, rng: np.random.Generator) -> Floats:
        """Return positions (n, D) around ``x``."""
        root = np.linalg.cholesky(self.covariance)
        z = rng.standard_normal((self.tries, len(self.columns)))
        around = np.repeat(x[None], self.tries, axis=0)
        around[:, self.columns] += self.size * (z @ root.T) * box.range[self.columns]
        return box.inside(around)

    def learn(self, share_better: float, step: Floats | None) -> None:
        """Adapt to the share of the tries that were better, and to the best of them."""
        d, n, target = len(self.columns), self.tries, self.target
        rate = target * n / (2 + target * n)
        self.success = (1 - rate) * self.success + rate * share_better
        if step is not None:
            towards, learning = 2 / (d + 2), 2 / (d * d + 6)
            self.path = (1 - towards) * self.path
            lost = towards * (2 - towards)
            if self.success < _THRESHOLD:
                self.path = self.path + math.sqrt(lost) * step / self.size
                lost = 0.0
            self.covariance = (1 - learning) * self.covariance + learning * (
                np.outer(self.path, self.path) + lost * self.covariance
            )
        damping = 1 + d / (2 * n)
        self.size *= math.exp((self.success - target) / (1 - target) / damping)
        self.size = min(self.size, _LARGEST)
        if self.size < _SMALLEST:  # there is nothing to find here: look farther again
            self.begin()


def steps_of(problem: Problem, size: float = _STEP) -> list[Steps]:
    """Return fresh steps for each block of a problem."""
    return [Steps(block, size) for block in problem.blocks]


def refine(
    problem: Problem, x: Floats, value: float, steps: list[Steps], maps: int | None = None
) -> Script:
    """Return a better layout (D,) and its value; without ``maps``, until somebody stops it.

    Parameters
    ----------
    problem : Problem
        What is searched.
    x, value : (D,) float64, float
        Where to begin, and its value.
    steps : list of Steps
        One a block; they go on learning.
    maps : int, optional
        To spend.
    """
    begin = problem.maps_rendered
    while maps is None or problem.maps_rendered - begin < maps:
        for step in steps:
            around = step.drawn(x, problem.box, problem.rng)
            values = yield problem.ask(around, step.block.sensors, METHOD)
            best, better = int(values.argmax()), values > value
            learned = None
            if better[best]:
                moved = problem.box.shortest(around[best] - x)
                learned = (moved / np.where(problem.box.range > 0, problem.box.range, 1))[
                    step.columns
                ]
            if values[best] >= value:  # on a plateau it may wander
                x, value = around[best], float(values[best])
            step.learn(float(better.mean()), learned)
    return x, value


def refine_alone(problem: Problem) -> Script:
    """Refine the study's start until nothing may be spent any more."""
    x = problem.start
    (value,) = yield problem.ask(x[None], range(len(problem.moved_by)), METHOD)
    yield from refine(problem, x, float(value), steps_of(problem))
