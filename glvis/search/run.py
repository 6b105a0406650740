"""The loop of a search: ask, evaluate, tell, count, and save what a later process needs."""

from __future__ import annotations

import json
import math
import time
from bisect import bisect
from collections.abc import Sequence
from dataclasses import asdict
from operator import attrgetter
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from glvis.errors import MachineError
from glvis.evaluation.evaluator import Evaluator
from glvis.problem.study import Study
from glvis.search.checkpoint import Checkpoint, identity_of, write_checkpoint
from glvis.search.methods import new_search, search_from_state, swarm_columns
from glvis.search.progress import Progress, Spent, first_limit
from glvis.search.script import Method
from glvis.search.trace import TraceRow

Floats = NDArray[np.float64]

# Seconds whose speed tells the time left: methods change theirs from stage to stage.
_LATELY = 60.0
_SECONDS = attrgetter("seconds")


class Run:
    """A search under way, of one study.

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
    script : callable, optional
        A search method in place of the study's.

    Attributes
    ----------
    search : Search
        The search method, to be stopped or extended.
    start_value : float
        Value of the study's start.
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
        script: Method | None = None,
    ) -> None:
        self._evaluator, self._path = evaluator, path
        self._identity = identity_of(study) if path else {}
        self._began = time.monotonic()
        self._is_saved = False
        self.trace: list[TraceRow] = []
        self._lines = b""  # the trace, as a checkpoint has it
        self.evaluations = self._evaluations_before = 0
        self._seconds_before = 0.0
        self._begin, self._rows_before = Spent(-1, 0, 0.0), 0
        self._warnings: list[str] = []
        if saved is None:
            self.search = new_search(study, evaluator.most_poses, script)
            self._start = self.search.best_x.copy()
            self.start_value = float(evaluator(self._start)[0])
            return
        self.search = search_from_state(study, evaluator.most_poses, saved.search, script)
        evaluator.recall(saved.known_poses)
        run = saved.run
        evaluator.maps_rendered = run["maps_rendered"]
        self._start = np.array(run["start"])
        self.start_value = run["start_value"]
        self._lines = saved.trace
        self.trace = [TraceRow(*json.loads(line)) for line in saved.trace.splitlines()]
        self.evaluations = self._evaluations_before = run["evaluations"]
        self._seconds_before = run["seconds"]
        self._rows_before = len(self.trace)
        self._begin = Spent(self._rows_before - 1, run["maps_rendered"], run["seconds"])
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
        for values in evaluator.each(positions, search.sensors, search.note):
            if interrupted:
                return False
            by_model.append(values)
        v = evaluator.study.objective.aggregated(np.array(by_model))
        search.tell(v, evaluator.maps_rendered)
        self.evaluations += len(v)
        inertia, neighbours = swarm_columns(search)
        row = TraceRow(
            iteration=len(self.trace),
            method=search.method,
            best=max(search.best_value, self.start_value),
            mean=float(v.mean()),
            std=float(v.std()),
            inertia=inertia,
            neighbours=neighbours,
            evaluations=self.evaluations,
            maps_rendered=evaluator.maps_rendered,
            seconds=self.seconds(),
        )
        self.trace.append(row)
        self._lines += json.dumps(row).encode() + b"\n"
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
            "evaluations": self.evaluations,
            "maps_rendered": evaluator.maps_rendered,
            "seconds": self.seconds(),
            "warnings": self.warnings,
            "gl": asdict(evaluator.gl),
        }
        state, poses = self.search.state(), evaluator.known_poses
        checkpoint = Checkpoint(self._identity, state, poses, run, self._lines)
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
        last = self.trace[-1]
        here = self.seconds() - self._seconds_before
        evaluated = last.evaluations - self._evaluations_before
        # the last row before what counts as lately
        row = bisect(self.trace, last.seconds - _LATELY, self._rows_before, key=_SECONDS) - 1
        then = self._begin if row < self._rows_before else _spent(self.trace[row])
        limit, done, most, seconds_left = first_limit(then, _spent(last), self._most())
        return Progress(
            iteration=last.iteration,
            limit=limit,
            done=done,
            most=most,
            seconds_left=seconds_left,
            best=last.best,
            mean=last.mean,
            evaluations=last.evaluations,
            evaluations_per_second=evaluated / here if here > 0 else math.nan,
            has_ended=self.search.stop_reason is not None,
            workers=tuple(self._evaluator.worker_names),
        )

    def _most(self) -> dict[str, float | None]:
        """Return what may be spent at the most, None where that does not end the search."""
        return {
            "iterations": self.search.iterations,
            "maps": self.search.most_maps,
            "seconds": self._evaluator.study.max_seconds,
        }


def _spent(row: TraceRow) -> Spent:
    return Spent(row.iteration, row.maps_rendered, row.seconds)
