"""Differential evolution by SciPy, for comparison: differences of layouts move layouts.

SciPy calls a function where a search here is asked and told, so that it runs in a thread of its
own, which stands still whenever this one does not wait for it.

References
----------
Storn and Price, "Differential Evolution", Journal of Global Optimization 11, 1997;
``scipy.optimize.differential_evolution``.
"""

from __future__ import annotations

import sys
from queue import SimpleQueue
from threading import Thread

from glvis.search.script import Floats, Problem, Script

METHOD = "de"


class _Over(Exception):
    """Nobody will ask any more."""


def differential_evolution(problem: Problem) -> Script:
    """Search until all maps are rendered, or no two layouts of the population differ."""
    asked: SimpleQueue[Floats | None] = SimpleQueue()
    told: SimpleQueue[Floats | None] = SimpleQueue()
    failed: list[BaseException] = []

    def costs(x: Floats) -> Floats:
        asked.put(problem.box.inside(x.T))
        values = told.get()
        if values is None:
            raise _Over
        return -values

    def solve() -> None:
        from scipy import optimize  # half a second to import

        try:
            optimize.differential_evolution(
                costs,
                problem.box.bounds,
                x0=problem.start,
                rng=problem.rng,
                maxiter=sys.maxsize,
                tol=0,
                polish=False,
                vectorized=True,
                updating="deferred",
            )
        except _Over:
            pass
        except BaseException as error:
            failed.append(error)
        finally:
            asked.put(None)

    solver = Thread(target=solve, daemon=True)
    solver.start()
    try:
        while (x := asked.get()) is not None:
            told.put((yield problem.ask(x, range(len(problem.moved_by)), METHOD)))
    finally:
        told.put(None)
        solver.join()
    if failed:
        raise failed[0]
    return "no two layouts of the population differ"
