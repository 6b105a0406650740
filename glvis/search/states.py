"""The schema of saved searches: what a checkpoint must hold before anything of it is believed.

A checkpoint may come from anywhere. What passes here has the right names, types and shapes, and
its numbers agree with each other and with the study; whether they are those of a search is found
out by searching on.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from typing import Annotated, Any, get_type_hints

import numpy as np
from numpy.typing import NDArray
from pydantic import BaseModel, ConfigDict, Field

from glvis.common.complaints import checked
from glvis.common.files import json_value
from glvis.common.values import between
from glvis.problem.study import Study
from glvis.problem.swarm_options import SwarmOptions
from glvis.search.trace import TraceRow

_MOST_ITERATIONS = 10**9
_ROUNDING = 1e-9
_Count = Annotated[int, between(0, 2**62)]
_Seconds = Annotated[float, between(0, 1e12)]


class _Record(BaseModel):
    model_config = ConfigDict(strict=True, frozen=True, allow_inf_nan=False)


class IdentityState(_Record):
    """What must not have changed since; see ``checkpoint.identity_of``."""

    study: str
    variables: list[str]
    meshes: dict[str, str]


class RunState(_Record):
    """What ``Run`` counts."""

    start: list[float]
    start_value: float
    evaluations: _Count
    maps_rendered: _Count
    seconds: _Seconds
    warnings: list[str]
    gl: dict[str, str]


class Head(_Record):
    """The JSON of a checkpoint."""

    identity: IdentityState
    run: RunState


class _ScriptState(_Record):
    beyond: Annotated[int, between(-1, _MOST_ITERATIONS)]
    digest: str


class _SwarmState(_Record):
    options: dict[str, Any]
    seconds: _Seconds
    generator: dict[str, Any]
    # NaN stands where no value was finite
    trace: list[list[Annotated[float, Field(allow_inf_nan=True)] | None]]
    iteration: _Count
    waiting: bool = Field(alias="_waiting")
    inertia: float = Field(alias="_inertia")
    neighbours: _Count = Field(alias="_neighbours")
    stall_counter: _Count = Field(alias="_stall_counter")
    stall_from: _Count = Field(alias="_stall_from")


def check_trace(trace: bytes, run: RunState) -> int:
    """Refuse rows that are none, or do not lead to the counts of the run; return their number.

    Raises
    ------
    ValueError
        Which row.
    """
    kinds = get_type_hints(TraceRow)
    before, n = (0, 0, 0.0), 0
    for n, line in enumerate(trace.splitlines(), start=1):
        row = json_value(line.decode())
        is_row = isinstance(row, list) and len(row) == len(kinds)
        if not is_row or not all(map(_is_of, row, kinds.values())):
            raise ValueError(f"row {n} of its trace is broken")
        now = TraceRow(*row)
        spent = (now.evaluations, now.maps_rendered, now.seconds)
        if now.iteration != n - 1 or any(a < b for a, b in zip(spent, before, strict=True)):
            raise ValueError(f"row {n} of its trace does not follow from the one before")
        before = spent
    if before[0] != run.evaluations or (n and before[1] != run.maps_rendered):
        raise ValueError("its trace does not lead to its counts")
    return n


def check_search(state: Mapping[str, NDArray[Any]], study: Study, n_rows: int) -> None:
    """Refuse what cannot be the state of the study's search after so many iterations.

    Raises
    ------
    ValueError
        What is wrong.
    """
    if study.search.method == "swarm":
        _check_swarm(state, study, n_rows)
        return
    checked(_ScriptState, json_value(_text(state, "json")))
    maps = _array(state, "maps", np.int64, 1)
    _array(state, "values", np.float64, 1)
    _array(state, "learned", np.uint8, 2)
    if len(maps) != n_rows or (np.diff(maps) < 0).any():
        raise ValueError("its search has not the iterations of its trace")


def _check_swarm(state: Mapping[str, NDArray[Any]], study: Study, n_rows: int) -> None:
    data = json_value(_text(state, "json"))
    scalars = checked(_SwarmState, data)
    saved = scalars.options | {"inertia": tuple(scalars.options.get("inertia", ()))}
    try:
        options = SwarmOptions(**saved)
    except (TypeError, ValueError) as error:
        raise ValueError(f"options: {error}") from None
    # its iterations grow where it was extended
    if replace(options, iterations=study.swarm.iterations) != study.swarm:
        raise ValueError("its swarm has other options than the study")
    if not 0 <= options.iterations <= _MOST_ITERATIONS:
        raise ValueError(f"options.iterations = {options.iterations} is too many")
    rig, width = study.rig, len(study.variables)
    for name, own in (("bounds", rig.bounds), ("periodic", rig.periodic)):
        if not np.array_equal(_array(state, name, own.dtype, own.ndim), own):
            raise ValueError(f"its swarm has other {name} than the study")
    for name in ("position", "pbest_pos", "velocity"):
        if _array(state, name, np.float64, 2).shape != (options.particles, width):
            raise ValueError(f"{name} has another shape")
    _array(state, "best_x", np.float64, 1)
    for name in ("position", "pbest_pos", "best_x"):
        check_inside(name, state[name], study)
    # faster than from bound to bound would leave the box, and stops there
    if not (np.abs(state["velocity"]) <= np.ptp(rig.bounds, axis=1) * (1 + _ROUNDING)).all():
        raise ValueError("velocity is too large")
    cost = _array(state, "pbest_cost", np.float64, 1)
    if len(cost) != options.particles or np.isnan(cost).any():
        raise ValueError("pbest_cost is broken")
    rows, last = len(scalars.trace), scalars.iteration
    is_odd = any(len(row) != 8 or None in row for row in scalars.trace)
    if is_odd or rows != n_rows or last != max(n_rows - (not scalars.waiting), 0):
        raise ValueError("its search has not the iterations of its trace")
    if not 0 < scalars.neighbours <= options.particles:
        raise ValueError(f"_neighbours = {scalars.neighbours} is not possible")


def check_inside(name: str, positions: NDArray[Any], study: Study) -> None:
    """Refuse positions (..., D) that are none of the study's, or lie outside its bounds.

    Raises
    ------
    ValueError
        By their name.
    """
    low, high = study.rig.bounds.T
    if positions.dtype != np.float64 or positions.shape[-1:] != low.shape:
        raise ValueError(f"{name} has another number of variables than the study")
    if not ((positions >= low) & (positions <= high)).all():
        raise ValueError(f"{name} lies outside the bounds of the study")


def _array(state: Mapping[str, NDArray[Any]], name: str, kind: Any, ndim: int) -> NDArray[Any]:
    """Return an array of a state, checked for its type and number of axes."""
    found = state.get(name)
    if found is None or found.dtype != kind or found.ndim != ndim:
        raise ValueError(f"{name} is missing or of another type")
    return found


def _text(state: Mapping[str, NDArray[Any]], name: str) -> str:
    """Return the text that an array without axes holds."""
    found = state.get(name)
    if found is None or found.dtype.kind != "U" or found.ndim:
        raise ValueError(f"{name} is missing or no text")
    return str(found)


def _is_of(value: Any, kind: type) -> bool:
    """Return whether a JSON value is of the type of a trace's column, and finite."""
    if isinstance(value, bool):
        return False
    if kind is float:
        return isinstance(value, int | float) and abs(value) < float("inf")
    return isinstance(value, kind)
