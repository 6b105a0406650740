"""A search under way: asks, evaluates, tells, counts, and keeps what a later process needs."""

from __future__ import annotations

import math
import time
from collections.abc import Sequence
from dataclasses import asdict, dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from glvis.errors import MachineError
from glvis.inputs.study import Study
from glvis.optim.checkpoint import Checkpoint, identity_of, write_checkpoint
from glvis.optim.evaluator import Evaluator
from glvis.optim.search import TraceRow, new_search, search_from_state

Floats = NDArray[np.float64]


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
    workers : tuple of str
        Names of those that render on other machines, at the moment.
    """

    iteration: int
    iterations: int
    best: float
    mean: float
    evaluations: int
    evaluations_per_second: float
    seconds: float
    seconds_left: float
    workers: tuple[str, ...] = ()


class Run:
    """One search of one study.

    Parameters
    ----------
    study : Study
        What is searched.
    evaluator : Evaluator
        Of the same study.
    path : Path, optional
        File of the checkpoints.
    saved : Checkpoint, optional
        Where to go on from; without it the search begins.

    Attributes
    ----------
    search : Search
        The method, to be stopped or extended.
    start_value : float
        Of the study's start.
    trace : list of TraceRow
        One row an iteration.
    evaluations : int
        Positions evaluated.
    """

    def __init__(
        self,
        study: Study,
        evaluator: Evaluator,
        path: Path | None = None,
        saved: Checkpoint | None = None,
    ) -> None:
        self._evaluator, self._path = evaluator, path
        self._identity = identity_of(study) if path else {}
        self._began = time.monotonic()
        self._is_saved = False
        self.trace: list[TraceRow] = []
        self.evaluations = self._evaluations_before = 0
        self._seconds_before = 0.0
        self._warnings: list[str] = []
        if saved is None:
            self.search = new_search(study, evaluator.most_poses)
            self._start = self.search.best_x.copy()
            self.start_value = float(evaluator(self._start)[0])
            return
        self.search = search_from_state(study, evaluator.most_poses, saved.search)
        evaluator.recall(saved.known_poses)
        run = saved.run
        evaluator.maps_rendered = run["maps_rendered"]
        self._start = np.array(run["start"])
        self.start_value = run["start_value"]
        self.trace = [TraceRow(*row) for row in run["trace"]]
        self.evaluations = self._evaluations_before = run["evaluations"]
        self._seconds_before = run["seconds"]
        self._warnings = run["warnings"]
        gl = asdict(evaluator.gl)
        if run["gl"] != gl:
            self._warnings.append(
                f"the search began on {run['gl']['renderer']} ({run['gl']['version']}) and went "
                f"on on {gl['renderer']} ({gl['version']})"
            )

    @property
    def warnings(self) -> list[str]:
        """What went wrong without harm to the result."""
        return [*self._warnings, *self._evaluator.warnings]

    @property
    def best_position(self) -> Floats:
        """The best position so far (D,), never worse than the start."""
        is_better = self.search.best_value >= self.start_value
        return (self.search.best_x if is_better else self._start).copy()

    def seconds(self) -> float:
        """Return the seconds of this run, parts before a resume included."""
        return self._seconds_before + time.monotonic() - self._began

    def keep_to_budget(self) -> None:
        """Stop the search where what it may spend is spent."""
        study, evaluator = self._evaluator.study, self._evaluator
        most_maps, most_seconds = study.search.max_maps, study.search.max_seconds
        if most_seconds is not None and self.seconds() >= most_seconds:
            self.search.stop(f"out of time: {self.seconds():.0f} s of {most_seconds:g} s are used")
        if most_maps is not None and study.search.method == "swarm":
            an_iteration = study.swarm.particles * len(study.sensors) * len(study.models)
            if evaluator.maps_rendered + an_iteration > most_maps:
                self.search.stop(
                    f"finished: {evaluator.maps_rendered} of {most_maps} maps are rendered"
                )

    def iterate(self, interrupted: Sequence[str] = ()) -> bool:
        """Do one iteration; return False, and have done nothing, where somebody interrupts."""
        search, evaluator = self.search, self._evaluator
        positions = search.ask()
        by_model = []
        for values in evaluator.each(positions, search.sensors):
            if interrupted:
                return False
            by_model.append(values)
        v = evaluator.study.objective.aggregated(np.array(by_model))
        search.tell(v, evaluator.maps_rendered)
        self.evaluations += len(v)
        self.trace.append(
            TraceRow(
                iteration=len(self.trace),
                method=search.method,
                best=max(search.best_value, self.start_value),
                mean=float(v.mean()),
                std=float(v.std()),
                inertia=search.inertia,
                neighbours=search.neighbours,
                evaluations=self.evaluations,
                maps_rendered=evaluator.maps_rendered,
                seconds=self.seconds(),
            )
        )
        return True

    def save(self) -> None:
        """Write the checkpoint, if there is a file for it.

        Raises
        ------
        MachineError
            If the first one cannot be written; later ones leave a warning, as the search is
            worth more.
        """
        if self._path is None:
            return
        evaluator = self._evaluator
        run = {
            "start": self._start.tolist(),
            "start_value": self.start_value,
            "trace": self.trace,
            "evaluations": self.evaluations,
            "maps_rendered": evaluator.maps_rendered,
            "seconds": self.seconds(),
            "warnings": self.warnings,
            "gl": asdict(evaluator.gl),
        }
        checkpoint = Checkpoint(self._identity, self.search.state(), evaluator.known_poses, run)
        try:
            write_checkpoint(self._path, checkpoint)
        except MachineError as error:
            if not self._is_saved:
                raise
            if str(error) not in self._warnings:
                self._warnings.append(str(error))
        self._is_saved = True

    def progress(self) -> Progress:
        """Return how far the search is."""
        last, seconds = self.trace[-1], self.seconds()
        here = seconds - self._seconds_before
        done = last.evaluations - self._evaluations_before
        most = self.search.iterations
        return Progress(
            iteration=last.iteration,
            iterations=most,
            best=last.best,
            mean=last.mean,
            evaluations=last.evaluations,
            evaluations_per_second=done / here if here > 0 else math.nan,
            seconds=seconds,
            seconds_left=seconds / len(self.trace) * max(0, most - last.iteration),
            workers=tuple(self._evaluator.worker_names),
        )
