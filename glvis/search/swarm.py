"""The paper's particle swarm: MATLAB's ``particleswarm`` as ask and tell, maximising.

Steps are those of MATLAB's documentation, "Particle Swarm Optimization Algorithm" (MathWorks,
Global Optimization Toolbox); the options are those of Table 5. pyswarms gives the swarm's
record and its personal bests. Its random topology, bound handlers, stop rule and generator do
not fit (the first fails on current NumPy, the last is NumPy's global one), so neighbourhood,
bounds, stop rules and random numbers are ours. Knows nothing of sensors, meshes or files; the
caller owns the loop.
"""

from __future__ import annotations

import json
import math
import os
import time
from collections.abc import Callable, Mapping
from dataclasses import asdict, replace
from functools import cache
from pathlib import Path
from typing import Any, NamedTuple, Self

import numpy as np
from numpy.typing import ArrayLike, NDArray

from glvis.problem.swarm_options import SwarmOptions
from glvis.search.box import Box, Floats

__all__ = ["Swarm", "SwarmOptions", "SwarmRow"]

STATE_VERSION = 1
# A configuration that changes nothing: without it the import of pyswarms opens ./report.log
# and puts handlers on the root logger.
_QUIET_LOGGING = Path(__file__).resolve().parent / "pyswarms_quiet.yaml"
# What a state is made of, besides the box, the options, the trace and the generator.
_SWARM_ARRAYS = ("position", "velocity", "pbest_pos", "pbest_cost")
_SCALARS = ("iteration", "_waiting", "_inertia", "_neighbours", "_stall_counter", "_stall_from")


class SwarmRow(NamedTuple):
    """One evaluated swarm.

    ``best`` is the largest value so far, ``mean`` and ``std`` are those of this swarm (NaN where
    no value was finite), ``inertia`` and ``neighbours`` are what moved it here (for iteration 0:
    what will move it), ``evaluations`` and ``seconds`` count from the start of the run.
    """

    iteration: int
    best: float
    mean: float
    std: float
    inertia: float
    neighbours: int
    evaluations: int
    seconds: float


class Swarm:
    """A particle swarm that is asked for positions and told their values; larger is better.

    ::

        swarm = Swarm(bounds, start=start, options=SwarmOptions(particles=50))
        while swarm.stop_reason is None:
            swarm.tell(values_of(swarm.ask()))
        swarm.best_x, swarm.best_value, swarm.stop_reason

    Parameters
    ----------
    bounds : (D, 2) float
        Smallest and largest value of each variable, in the variable's unit; finite.
    periodic : (D,) bool, optional
        Variables whose two bounds are the same place: they wrap, and attraction takes the
        shorter way round.
    start : (K, D) or (D,) float, optional
        The first particles, K <= P; clipped into the bounds. The rest is drawn.
    options : SwarmOptions, optional
    clock : callable, optional
        Returns seconds; only differences count.

    Attributes
    ----------
    best_x : (D,) float64
        The best position told so far; before that the first particle.
    best_value : float
        Its value; -inf before the first finite one.
    stop_reason : str or None
        Why the run has ended, in words.
    iteration : int
        Of the positions last asked for; 0 is the first swarm.
    evaluations : int
        Values told so far.
    trace : list of SwarmRow
        One row for each evaluated swarm, the first one included.

    Raises
    ------
    ValueError
        On bounds, periodic or start of a wrong shape, not finite, or reversed.

    References
    ----------
    MathWorks, "Particle Swarm Optimization Algorithm"; Table 5 of the paper.
    """

    def __init__(
        self,
        bounds: ArrayLike,
        periodic: ArrayLike | None = None,
        start: ArrayLike | None = None,
        options: SwarmOptions | None = None,
        *,
        clock: Callable[[], float] = time.monotonic,
    ) -> None:
        self.options = options = options or SwarmOptions()
        self.box = box = Box(bounds, periodic)
        self._clock, self._started, self._seconds_before = clock, clock(), 0.0
        self._rng = rng = np.random.default_rng(options.seed)
        given = np.zeros((0, len(box))) if start is None else box.checked(start, options.particles)
        spread = box.sobol if options.initial == "sobol" else box.uniform
        position = np.concatenate([given, spread(options.particles - len(given), rng)])
        # "Initialization": velocities uniform in [-r, r], r = min(ub - lb, InitialSwarmSpan).
        fastest = np.minimum(box.range, options.initial_span)
        self._swarm = _pyswarms().Swarm(
            position=position,
            velocity=fastest * rng.uniform(-1.0, 1.0, position.shape),
            pbest_cost=np.full(options.particles, math.inf),  # no value yet
        )
        # "Initialization": smallest neighbourhood, largest inertia, stall counter c = 0.
        self._least = max(2, math.floor(options.particles * options.min_neighbors_fraction))
        self._neighbours = self._least
        self._inertia = float(options.inertia[1])
        self._stall_counter = 0
        self._stall_from = 0  # iteration from which on the stall rule looks
        self._waiting = True  # for the values of the positions that stand in self._swarm
        self.iteration = 0
        self.best_x: Floats = position[0].copy()
        self.stop_reason: str | None = None
        self.trace: list[SwarmRow] = []

    def ask(self) -> Floats:
        """Return the positions (P, D) to evaluate next.

        Asking again before `tell` returns the same positions.

        Raises
        ------
        ValueError
            When the run has ended.
        """
        if not self._waiting:
            if self.stop_reason is not None:
                raise ValueError(f"the swarm has ended: {self.stop_reason}")
            self._move()
            self._waiting = True
        return self._swarm.position.copy()

    def tell(self, values: ArrayLike) -> None:
        """Take the values (P,) of the positions last asked for; NaN counts as -inf.

        Raises
        ------
        ValueError
            If no positions were asked for, or the shape is wrong.
        """
        v = np.asarray(values, dtype=float)
        if not self._waiting:
            raise ValueError("tell without ask: the swarm waits for no values")
        if v.shape != (self.options.particles,):
            raise ValueError(f"values must have shape ({self.options.particles},), got {v.shape}")
        v = np.where(np.isnan(v), -math.inf, v)
        swarm, old_best = self._swarm, self.best_value
        swarm.current_cost = -v  # pyswarms minimises
        swarm.pbest_pos, swarm.pbest_cost = _pyswarms().compute_pbest(swarm)
        if v.max() > old_best:
            self.best_x = swarm.position[v.argmax()].copy()
        finite = v[np.isfinite(v)]
        self.trace.append(
            SwarmRow(
                iteration=self.iteration,
                best=max(old_best, float(v.max())),
                mean=float(finite.mean()) if len(finite) else math.nan,
                std=float(finite.std()) if len(finite) else math.nan,
                inertia=self._inertia,
                neighbours=self._neighbours,
                evaluations=self.evaluations + len(v),
                seconds=self._elapsed(),
            )
        )
        self._waiting = False
        if self.iteration > 0:  # the first swarm neither improves nor stalls
            self._adapt(improved=self.best_value > old_best)
        self.stop_reason = self.stop_reason or self._rule_that_stops()

    def stop(self, reason: str) -> None:
        """End the run from outside, for instance on Ctrl-C; the first reason given stays."""
        self.stop_reason = self.stop_reason or reason

    def extend(self, iterations: int) -> None:
        """Allow this many iterations more, whatever ended the run, and wait anew for a stall.

        A reached ``objective_limit`` or ``max_seconds`` still holds.
        """
        if iterations < 1:
            raise ValueError(f"iterations = {iterations} to add must be at least 1")
        done = self.trace[-1].iteration if self.trace else 0
        self.options = replace(self.options, iterations=done + iterations)
        self._stall_from = done
        self.stop_reason = self._rule_that_stops()

    @property
    def best_value(self) -> float:
        """Largest value told so far, -inf before the first."""
        return self.trace[-1].best if self.trace else -math.inf

    @property
    def evaluations(self) -> int:
        """Values told so far."""
        return self.trace[-1].evaluations if self.trace else 0

    def state(self) -> dict[str, NDArray[Any]]:
        """Return all that `from_state` needs to go on bit for bit.

        Returns
        -------
        dict of str to ndarray
            Numbers, and one JSON text as an array without dimensions, so that
            ``np.savez(file, **swarm.state())`` and ``np.load(file)`` keep it without pickle.
        """
        scalars = {
            "version": STATE_VERSION,
            "options": asdict(self.options),
            "seconds": self._elapsed(),
            "generator": self._rng.bit_generator.state,
            "trace": self.trace,
        } | {name: getattr(self, name) for name in _SCALARS}
        return {
            "bounds": self.box.bounds.copy(),
            "periodic": self.box.periodic.copy(),
            "best_x": self.best_x.copy(),
            "json": np.array(json.dumps(scalars)),
        } | {name: np.array(getattr(self._swarm, name)) for name in _SWARM_ARRAYS}

    @classmethod
    def from_state(
        cls,
        state: Mapping[str, NDArray[Any]],
        options: SwarmOptions | None = None,
        *,
        clock: Callable[[], float] = time.monotonic,
    ) -> Self:
        """Return the swarm that `state` describes, ready to go on.

        Parameters
        ----------
        state : mapping
            From `state`; an open ``.npz`` file will do.
        options : SwarmOptions, optional
            Instead of the saved ones, for instance with more ``iterations``. The number of
            particles must be the same; the seed has no effect any more.
        clock : callable, optional
            Goes on where the saved run's seconds ended.

        A `stop` from outside is forgotten: to go on is what the caller wants. The stop rules
        are asked again, so a run that had come to its own end still is at its end.

        Raises
        ------
        ValueError
            If the state is of another version, or the number of particles differs.
        """
        scalars = json.loads(str(state["json"]))
        if scalars["version"] != STATE_VERSION:
            raise ValueError(
                f"state of version {scalars['version']} cannot be read, only {STATE_VERSION}"
            )
        saved = scalars["options"]
        kept = SwarmOptions(**saved | {"inertia": tuple(saved["inertia"])})
        options = options or kept
        if options.particles != kept.particles:
            raise ValueError(
                f"swarm.particles = {options.particles} must stay {kept.particles} in a run "
                "that goes on"
            )
        swarm = cls(state["bounds"], state["periodic"], None, options, clock=clock)
        swarm._rng.bit_generator.state = scalars["generator"]
        for name in _SWARM_ARRAYS:
            setattr(swarm._swarm, name, np.array(state[name]))
        swarm.best_x = np.array(state["best_x"])
        for name in _SCALARS:
            setattr(swarm, name, scalars[name])
        swarm.trace = [SwarmRow(*row) for row in scalars["trace"]]
        swarm._seconds_before = scalars["seconds"]
        swarm.stop_reason = swarm._rule_that_stops()
        return swarm

    def _move(self) -> None:
        """Take the swarm one iteration on: steps 1 to 5 of MATLAB's documentation."""
        swarm, rng, options = self._swarm, self._rng, self.options
        # Steps 1 and 2: the best personal best g of a random neighbourhood S.
        neighbour = _best_neighbours(swarm.pbest_cost, self._neighbours, rng)
        swarm.best_pos = swarm.pbest_pos[neighbour]
        # Step 3: v = W v + y1 u1 (p - x) + y2 u2 (g - x).
        u1, u2 = rng.random((2, *swarm.position.shape))
        velocity = (
            self._inertia * swarm.velocity
            + options.cognitive * u1 * self.box.shortest(swarm.pbest_pos - swarm.position)
            + options.social * u2 * self.box.shortest(swarm.best_pos - swarm.position)
        )
        # Step 4: x = x + v.
        target = swarm.position + velocity
        swarm.position = self.box.inside(target)
        # Step 5: what left the bounds stands on them and loses that component of its velocity.
        stopped = ~self.box.wraps & (swarm.position != target)
        # Round a circle the same move is always possible in at most half a period; without
        # that, inertia above 1 would wind a velocity up for ever, as no bound stops it.
        swarm.velocity = np.where(stopped, 0.0, self.box.shortest(velocity))
        self.iteration += 1

    def _adapt(self, improved: bool) -> None:
        """Adapt neighbourhood and inertia to the last iteration: step 6."""
        low, high = self.options.inertia
        if improved:
            self._stall_counter = max(0, self._stall_counter - 1)
            self._neighbours = self._least
        else:
            self._stall_counter += 1
            self._neighbours = min(self._neighbours + self._least, self.options.particles)
        if improved or self.options.inertia_update == "always":
            if self._stall_counter < 2:
                self._inertia *= 2.0
            elif self._stall_counter > 5:
                self._inertia /= 2.0
            self._inertia = min(max(self._inertia, low), high)

    def _rule_that_stops(self) -> str | None:
        """Return in words which of Table 5's stop rules holds, if any."""
        if not self.trace:
            return None
        o, best, done = self.options, self.best_value, self.trace[-1].iteration
        if o.objective_limit is not None and best >= o.objective_limit:
            return f"reached the limit: the best value {best:g} is at least {o.objective_limit:g}"
        if done >= o.iterations:
            return f"finished: all {o.iterations} iterations done"
        then = done - o.stall_iterations
        if then >= self._stall_from:
            old = self.trace[then].best
            if best == old:
                return (
                    f"stalled: the best value did not change over {o.stall_iterations} iterations"
                )
            scale = abs(best) if o.tolerance_mode == "relative" else max(1.0, abs(best))
            if best - old < o.tolerance * scale:
                how = "relative" if o.tolerance_mode == "relative" else "relative, absolute below 1"
                return (
                    f"stalled: the best value changed by less than {o.tolerance:g} ({how}) "
                    f"over {o.stall_iterations} iterations"
                )
        if o.max_seconds is not None and self._elapsed() >= o.max_seconds:
            return f"out of time: {self._elapsed():.0f} s of {o.max_seconds:g} s are used"
        return None

    def _elapsed(self) -> float:
        """Return the seconds of this run, those before a resume included."""
        return self._seconds_before + self._clock() - self._started


def _best_neighbours(cost: Floats, size: int, rng: np.random.Generator) -> NDArray[np.intp]:
    """Return for each particle the best of ``size`` random others (at most all), by index (P,).

    Equals are decided by lot, not by index: on a plateau nobody shall follow the first particle.
    """
    n = len(cost)
    lots = rng.random((n, n))
    np.fill_diagonal(lots, math.inf)  # never oneself
    last = min(size, n - 1) - 1
    drawn = lots <= np.partition(lots, last, axis=1)[:, last : last + 1]
    seen = np.where(drawn, cost, math.inf)
    best = seen == seen.min(axis=1, keepdims=True)
    return np.where(best, lots, math.inf).argmin(axis=1)  # the lowest lots are those drawn


@cache
def _pyswarms() -> Any:
    """Return ``pyswarms.backend``, imported only when needed and without its side effects."""
    before = os.environ.get("LOG_CFG")
    os.environ["LOG_CFG"] = str(_QUIET_LOGGING)
    try:
        import pyswarms.backend
    finally:
        del os.environ["LOG_CFG"]
        if before is not None:
            os.environ["LOG_CFG"] = before
    return pyswarms.backend
