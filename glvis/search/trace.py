"""The trace of a search: one row an iteration, as files keep it."""

from __future__ import annotations

from typing import NamedTuple


class TraceRow(NamedTuple):
    """One iteration of a search.

    ``best`` is the largest value so far, ``mean`` and ``std`` are those of this iteration's
    positions. ``inertia`` and ``neighbours`` are the swarm's (0 for other methods).
    ``evaluations``, ``maps_rendered`` and ``seconds`` count from the start of the run.
    """

    iteration: int
    method: str
    best: float
    mean: float
    std: float
    inertia: float
    neighbours: int
    evaluations: int
    maps_rendered: int
    seconds: float
