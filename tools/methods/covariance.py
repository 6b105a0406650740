"""CMA-ES by pycma, for comparison: a whole layout moves at a time, by steps that learn a shape.

pycma is an extra (``bench``) and imported only when this method is asked for.

References
----------
Hansen, "The CMA Evolution Strategy: A Tutorial", arXiv:1604.00772. Restarts with twice the
population: Auger and Hansen, "A Restart CMA Evolution Strategy With Increasing Population
Size", CEC 2005.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from glvis.common.hints import installed_by
from glvis.errors import MachineError
from glvis.search.script import Floats, Problem, Script

METHOD = "cma"
_STEP = 0.25  # first one, in shares of the range: a quarter, as pycma's documentation advises
_WORST = 1e300  # told for what has no value


def cma(problem: Problem) -> Script:
    """Search from the start, then again from random places, until all maps are rendered."""
    library = _imported()
    box, sensors = problem.box, range(len(problem.moved_by))
    low, span = box.bounds[:, 0], np.where(box.range > 0, box.range, 1.0)
    # Periodic variables have no bounds: whole layouts wrap when they are evaluated.
    bounds = [[None if wraps else bound for wraps in box.wraps] for bound in (0.0, 1.0)]
    begin, population = problem.start, 4 + int(3 * math.log(len(box)))  # as the tutorial has it

    def normal(*shape: int) -> Floats:
        return problem.rng.standard_normal(shape)

    while True:
        options = {
            "bounds": bounds,
            "maxstd": math.inf,  # pycma cannot limit the step of a single variable
            "popsize": population,
            "randn": normal,
            "seed": math.nan,  # leave NumPy's global generator alone
            "verbose": -9,
            "verb_log": 0,
        }
        strategy = library.CMAEvolutionStrategy((begin - low) / span, _STEP, options)
        while not strategy.stop():
            asked = strategy.ask()
            x = box.inside(low + span * np.array(asked))
            values = yield problem.ask(x, sensors, METHOD)
            strategy.tell(asked, np.where(np.isfinite(values), -values, _WORST).tolist())
        begin, population = box.uniform(1, problem.rng)[0], 2 * population


def _imported() -> Any:
    try:
        import cma as library
    except ImportError as error:
        raise MachineError(
            f"the method 'cma' needs pycma ({error}); {installed_by('bench')}"
        ) from error
    return library
