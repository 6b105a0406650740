"""Options of the table ``[search]``: which method searches, and its budget."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Literal, get_args

Method = Literal["swarm", "auto", "greedy"]
METHODS = get_args(Method)
FOR_COMPARISON = ("refine", "cma", "de")  # once methods of studies, now of tools/compare_methods.py
MAPS = 4000  # a sensor and model, for all methods but "swarm", where the study does not say


@dataclass(frozen=True)
class SearchOptions:
    """Options of every search: its method and its budget.

    Attributes
    ----------
    method : str
        "swarm": the paper's, with the options of its own table. "greedy": random poses of one
        mount at a time. "auto":
        greedy starts and layouts optimised on a surrogate, the best of them improved by local
        search and restarts; by local search alone where mounts share variables.
    max_maps : int, optional
        Stop before more maps are rendered; without it "swarm" has its iterations, and the
        others 4,000 maps a sensor and model.
    max_seconds : float, optional
        Stop after the iteration that takes the run past this time.
    """

    method: Method = "auto"
    max_maps: int | None = None
    max_seconds: float | None = None

    def __post_init__(self) -> None:
        if self.method not in METHODS:
            choice = ", ".join(f"'{method}'" for method in METHODS)
            raise ValueError(f"search.method = '{self.method}' must be one of {choice}")
        if self.max_maps is not None and self.max_maps < 1:
            raise ValueError(f"search.max_maps = {self.max_maps} must be at least 1")
        if self.max_seconds is not None and not 0 < self.max_seconds < math.inf:
            raise ValueError(f"search.max_seconds = {self.max_seconds} must be larger than 0")
