"""The main job: a study's search runs to its end, and the best poses come back with their maps.

Joins evaluator and search; knows neither files of results nor a terminal.
"""

from __future__ import annotations

import math
import os
import signal
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from glvis.context import GlInfo
from glvis.evaluator import Evaluator
from glvis.maps import MapScene
from glvis.study import Study
from glvis.swarm import Swarm
from glvis.visibility import VisibilityMap
from glvis.workers import Workers

__all__ = ["Placement", "Progress", "TraceRow", "evaluate_poses", "place_sensors"]

Floats = NDArray[np.float64]

ONLY_EVALUATED = "evaluated only"


class TraceRow(NamedTuple):
    """One iteration of a search.

    ``best`` is the largest value so far, ``mean`` and ``std`` are those of this iteration's
    positions. ``inertia`` and ``neighbours`` are the swarm's (NaN and 0 for other methods).
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


@dataclass(frozen=True)
class Progress:
    """How far a search is.

    Attributes
    ----------
    iteration, iterations : int
        Done, and the most there can be.
    best, mean : float
        Largest value so far, mean of the last iteration.
    evaluations : int
        Since the start of the run.
    evaluations_per_second : float
        Since the start of this process's part of the run.
    seconds, seconds_left : float
        Of the run so far, and until ``iterations`` at this speed; a run may stall before.
    """

    iteration: int
    iterations: int
    best: float
    mean: float
    evaluations: int
    evaluations_per_second: float
    seconds: float
    seconds_left: float


@dataclass(frozen=True, eq=False)
class Placement:
    """Poses of all sensors, what they see, and how they were found.

    Attributes
    ----------
    study : Study
        What was asked.
    position : (D,) float64
        Values of the variables, in the units of the study file.
    camera_to_world : (S, 4, 4) float64
        Poses.
    maps : tuple of VisibilityMap
        One a model.
    value : float
        Of the objective over all models; larger is better.
    values_by_model : (M,) float64
        Of the objective on each model.
    start_value : float
        Of the study's start, put into the bounds.
    trace : tuple of TraceRow
        One row an iteration; empty where nothing was searched.
    stop_reason : str
        Why the search ended, in words, or "evaluated only".
    seed : int
        Of the search.
    seconds : float
        That the run took, parts before a resume included.
    evaluations, maps_rendered : int
        Positions evaluated; maps made for them.
    gl : GlInfo
        Who drew.
    workers : int
        Processes that drew.
    warnings : tuple of str
        What went wrong without harm to the result, such as a worker that was replaced.
    """

    study: Study
    position: Floats
    camera_to_world: Floats
    maps: tuple[VisibilityMap, ...]
    value: float
    values_by_model: Floats
    start_value: float
    trace: tuple[TraceRow, ...]
    stop_reason: str
    seed: int
    seconds: float
    evaluations: int
    maps_rendered: int
    gl: GlInfo
    workers: int = 1
    warnings: tuple[str, ...] = ()


def evaluate_poses(
    study: Study,
    camera_to_world: ArrayLike | None = None,
    *,
    position: ArrayLike | None = None,
) -> Placement:
    """Return what given poses see; nothing is searched.

    Parameters
    ----------
    study : Study
        Scene, sensors and objective.
    camera_to_world : (S, 4, 4) float, optional
        Poses; without them those of ``position``.
    position : (D,) float, optional
        Values of the variables; without it the study's start.

    Raises
    ------
    ValueError
        If poses or position have a wrong shape or are not finite.
    MachineError
        Where there is no OpenGL.
    """
    clock = _Clock()
    x = np.array(study.rig.start if position is None else position, dtype=float)
    poses = study.rig.poses(x) if camera_to_world is None else np.array(camera_to_world, float)
    expected = (len(study.sensor_names), 4, 4)
    if poses.shape != expected or not np.isfinite(poses).all():
        raise ValueError(f"poses must be finite and of shape {expected}, got {poses.shape}")
    with _evaluator(study) as evaluator:
        maps, by_model, value = _seen(evaluator, poses)
        return Placement(
            study=study,
            position=x,
            camera_to_world=poses,
            maps=maps,
            value=value,
            values_by_model=by_model,
            start_value=value,
            trace=(),
            stop_reason=ONLY_EVALUATED,
            seed=study.swarm.seed,
            seconds=clock.elapsed(),
            evaluations=1,
            maps_rendered=evaluator.maps_rendered,
            gl=evaluator.gl,
        )


def place_sensors(
    study: Study,
    *,
    workers: int = 1,
    on_iteration: Callable[[Progress], None] | None = None,
) -> Placement:
    """Return the best poses that the study's search finds; a study without variables is evaluated.

    Ctrl-C and SIGTERM end the search well: what is being evaluated is dropped, and the best so
    far comes back, never worse than the start. A second Ctrl-C raises KeyboardInterrupt.

    Parameters
    ----------
    study : Study
        What is searched and how.
    workers : int
        Processes that render; the result is the same for any number.
    on_iteration : callable, optional
        Is told the Progress after each iteration.

    Raises
    ------
    ValueError
        If ``workers`` is less than 1.
    MachineError
        Where there is no OpenGL, or workers die again and again.
    """
    if not study.variables:
        return evaluate_poses(study)
    clock = _Clock()
    with _interruptions() as interrupted, _evaluator(study, workers) as evaluator:
        rig = study.rig
        search = Swarm(rig.bounds, rig.periodic, rig.start, study.swarm)
        start = search.best_x
        start_value = float(evaluator(start)[0])
        trace: list[TraceRow] = []
        try:
            while search.stop_reason is None:
                values = _values(evaluator, search.ask(), interrupted)
                if values is None:
                    search.stop(f"interrupted: {interrupted[0]}")
                    break
                search.tell(values)
                trace.append(_trace_row(search, evaluator.maps_rendered, clock))
                if on_iteration:
                    on_iteration(_progress(trace, search.options.iterations, clock))
        except KeyboardInterrupt:  # whoever else raised it means the same
            if interrupted:
                raise
            search.stop("interrupted: Ctrl-C")
        x = search.best_x if search.best_value >= start_value else start
        poses = rig.poses(x)
        evaluations, maps_rendered = search.evaluations, evaluator.maps_rendered
        maps, by_model, value = _seen(evaluator, poses)
        return Placement(
            study=study,
            position=x.copy(),
            camera_to_world=poses,
            maps=maps,
            value=value,
            values_by_model=by_model,
            start_value=start_value,
            trace=tuple(trace),
            stop_reason=search.stop_reason or "",
            seed=study.swarm.seed,
            seconds=clock.elapsed(),
            evaluations=evaluations,
            maps_rendered=maps_rendered,
            gl=evaluator.gl,
            workers=workers,
            warnings=tuple(evaluator.warnings),
        )


class _Clock:
    """Seconds of a run."""

    def __init__(self) -> None:
        self._started = time.monotonic()

    def elapsed(self) -> float:
        return time.monotonic() - self._started


def _evaluator(study: Study, workers: int = 1) -> Evaluator:
    """Return an evaluator; where the CPU draws in this process, it does so in this thread.

    llvmpipe's own threads cost more than they give on images of this size; the user's word
    on them holds. The variable is read when the context is made.
    """
    if workers != 1:
        return Evaluator(study, maps=Workers(MapScene.of(study), workers))
    name = "LP_NUM_THREADS"
    if name in os.environ:
        return Evaluator(study)
    os.environ[name] = "0"
    try:
        return Evaluator(study)
    finally:
        del os.environ[name]


def _seen(evaluator: Evaluator, poses: Floats) -> tuple[tuple[VisibilityMap, ...], Floats, float]:
    """Return maps, values by model (M,) and the value of one set of poses (S, 4, 4)."""
    study = evaluator.study
    maps = tuple(evaluator.visibility_of_poses(poses))
    by_model = np.array(
        [
            study.objective.terms(found.counts, model.areas)["value"]
            for found, model in zip(maps, study.models, strict=True)
        ]
    )
    return maps, by_model, float(study.objective.aggregated(by_model))


def _values(evaluator: Evaluator, positions: Floats, interrupted: list[str]) -> Floats | None:
    """Return the values of positions (P, D), or None where somebody wants the run to end."""
    by_model = []
    for values in evaluator.each(positions):
        if interrupted:
            return None
        by_model.append(values)
    return evaluator.study.objective.aggregated(np.array(by_model))


def _trace_row(search: Swarm, maps_rendered: int, clock: _Clock) -> TraceRow:
    row = search.trace[-1]
    return TraceRow(
        iteration=row.iteration,
        method="swarm",
        best=row.best,
        mean=row.mean,
        std=row.std,
        inertia=row.inertia,
        neighbours=row.neighbours,
        evaluations=row.evaluations,
        maps_rendered=maps_rendered,
        seconds=clock.elapsed(),
    )


def _progress(trace: list[TraceRow], iterations: int, clock: _Clock) -> Progress:
    last, seconds = trace[-1], clock.elapsed()
    an_iteration = seconds / len(trace)
    return Progress(
        iteration=last.iteration,
        iterations=iterations,
        best=last.best,
        mean=last.mean,
        evaluations=last.evaluations,
        evaluations_per_second=last.evaluations / seconds if seconds > 0 else math.nan,
        seconds=seconds,
        seconds_left=an_iteration * (iterations - last.iteration),
    )


@contextmanager
def _interruptions() -> Iterator[list[str]]:
    """Collect the names of Ctrl-C and SIGTERM instead of dying of them.

    Only the main thread may ask for that; elsewhere, and for Ctrl-C where its handler is not
    Python's own, all stays as it was.
    """
    names: list[str] = []
    before: dict[int, Any] = {}

    def note(number: int, frame: object) -> None:
        names.append("Ctrl-C" if number == signal.SIGINT else "SIGTERM")
        if number == signal.SIGINT:
            signal.signal(number, signal.default_int_handler)  # the second one is meant

    if threading.current_thread() is threading.main_thread():
        if signal.getsignal(signal.SIGINT) is signal.default_int_handler:
            before[signal.SIGINT] = signal.signal(signal.SIGINT, note)
        if signal.getsignal(signal.SIGTERM) is signal.SIG_DFL:
            before[signal.SIGTERM] = signal.signal(signal.SIGTERM, note)
    try:
        yield names
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)
