"""The options of the swarm, Table 5, and what they may be."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Literal


@dataclass(frozen=True)
class SwarmOptions:
    """Options of the swarm; the defaults are those of Table 5.

    Attributes
    ----------
    particles : int
        P, the paper's SwarmSize.
    iterations : int
        MaxIterations: moves of the swarm after its first evaluation, so that a full run takes
        ``particles * (iterations + 1)`` evaluations.
    stall_iterations, tolerance : int, float
        MaxStallIterations and FunctionTolerance: stop when the best value has changed by less
        than ``tolerance`` over this many iterations.
    tolerance_mode : str
        "relative": to the size of the best value. "matlab": the same, but absolute where the
        best value is smaller than 1.
    inertia : tuple of float
        InertiaRange (low, high).
    inertia_update : str
        When the inertia adapts: "always", after every iteration, or "on_improvement", the other
        reading of the documentation, after iterations that improved the best value only.
    min_neighbors_fraction : float
        MinNeighborsFraction: share of the swarm that a particle looks at, at least.
    initial_span : float
        InitialSwarmSpan: largest initial speed, in the unit of each variable an iteration.
        Where bounds are finite it does not limit the initial positions.
    cognitive, social : float
        SelfAdjustmentWeight and SocialAdjustmentWeight.
    initial : str
        "sobol" spreads the first swarm evenly, "uniform" at random as MATLAB does.
    objective_limit : float, optional
        Stop at a value at least this large. (Table 5's limit 0 is for 1/OF, which is never
        reached; it has no counterpart here.)
    max_seconds : float, optional
        Stop after the iteration that takes the run past this time.
    seed : int
        Of the one random generator.
    """

    particles: int = 300
    iterations: int = 200
    stall_iterations: int = 30
    tolerance: float = 1e-3
    inertia: tuple[float, float] = (0.2, 1.5)
    min_neighbors_fraction: float = 0.4
    initial_span: float = 20.0
    objective_limit: float | None = None
    max_seconds: float | None = None
    seed: int = 1
    # MATLAB's defaults; Table 5 leaves them alone.
    cognitive: float = 1.49
    social: float = 1.49
    inertia_update: Literal["always", "on_improvement"] = "always"
    initial: Literal["sobol", "uniform"] = "sobol"
    tolerance_mode: Literal["relative", "matlab"] = "relative"

    def __post_init__(self) -> None:
        for name, least in _LEAST.items():
            value = getattr(self, name)
            if not value >= least:  # also catches NaN
                raise ValueError(f"swarm.{name} = {value} must be at least {least:g}")
            if value == math.inf:
                raise ValueError(f"swarm.{name} = {value} must be finite")
            if isinstance(least, int) and value != int(value):
                raise ValueError(f"swarm.{name} = {value} must be a whole number")
        for name, allowed in _WORDS.items():
            if getattr(self, name) not in allowed:
                choice = " or ".join(f"'{word}'" for word in allowed)
                raise ValueError(f"swarm.{name} = '{getattr(self, name)}' must be {choice}")
        if len(self.inertia) != 2 or not 0 <= self.inertia[0] <= self.inertia[1] < math.inf:
            raise ValueError(
                f"swarm.inertia = {list(self.inertia)} must be [low, high] with 0 <= low <= high"
            )
        if not self.min_neighbors_fraction <= 1:
            raise ValueError(
                f"swarm.min_neighbors_fraction = {self.min_neighbors_fraction} must be at most 1"
            )
        if self.objective_limit is not None and not math.isfinite(self.objective_limit):
            raise ValueError(f"swarm.objective_limit = {self.objective_limit} must be finite")
        if self.max_seconds is not None and not self.max_seconds > 0:
            raise ValueError(f"swarm.max_seconds = {self.max_seconds} must be larger than 0")


# Whole numbers have a whole lower limit.
_LEAST: dict[str, float] = {
    "particles": 2,
    "iterations": 0,
    "stall_iterations": 1,
    "tolerance": 0.0,
    "min_neighbors_fraction": 0.0,
    "initial_span": 0.0,
    "cognitive": 0.0,
    "social": 0.0,
    "seed": 0,
}
_WORDS = {
    "inertia_update": ("always", "on_improvement"),
    "initial": ("sobol", "uniform"),
    "tolerance_mode": ("relative", "matlab"),
}
