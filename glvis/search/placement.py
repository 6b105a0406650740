"""Placement, the main job: a study is searched, and the best poses come back with their maps.

Joins evaluator and search; knows neither files of results nor a terminal.
"""

from __future__ import annotations

import signal
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, replace
from functools import cached_property
from importlib import import_module
from pathlib import Path
from typing import Any
from warnings import warn

import numpy as np
from numpy.typing import ArrayLike, NDArray

from glvis.common.notebook import html_table
from glvis.evaluation.cluster import ClusterMaps
from glvis.evaluation.evaluator import Evaluator
from glvis.evaluation.interference import Interference, find_interference
from glvis.evaluation.workers import Workers
from glvis.problem.camera import angles_from_direction, position_direction_roll
from glvis.problem.pieces import noun_of_shares, share_of
from glvis.problem.study import Study
from glvis.search.checkpoint import read_checkpoint
from glvis.search.progress import Progress
from glvis.search.reach import Reach, Sampler
from glvis.search.run import Run
from glvis.search.script import Method
from glvis.search.trace import TraceRow
from glvis.visibility.context import GlInfo, rasterising_in_this_thread
from glvis.visibility.maps import MapScene
from glvis.visibility.visibility_map import VisibilityMap

__all__ = ["Placement", "Progress", "TraceRow", "evaluate_poses", "place_sensors"]

Floats = NDArray[np.float64]

ONLY_EVALUATED = "evaluated only"
INTERRUPTED = "interrupted"  # how the reason to stop begins where somebody wanted it


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
        The OpenGL driver in use.
    workers : int
        Processes that drew.
    warnings : tuple of str
        What went wrong without harm to the result, such as a worker that was replaced.
    reach : Reach, optional
        What could be seen at best, where that was sampled.
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
    reach: Reach | None = None

    @cached_property
    def interference(self) -> Interference | None:
        """How projectors disturb each other, None where no two could; asked once, by OpenGL."""
        return find_interference(self.study, self.camera_to_world)

    def __repr__(self) -> str:
        return (
            f"Placement({self._worth()}, {len(self.camera_to_world)} sensors, {self.stop_reason})"
        )

    def _repr_html_(self) -> str:
        study, noun = self.study, self._noun()
        names = [model.name for model in study.models]
        seen = zip(names, [100 * share for share in self._shares()], strict=True)
        position, direction, roll = position_direction_roll(self.camera_to_world, study.up)
        angles = np.degrees([*angles_from_direction(direction), roll]).T
        columns = ("sensor", "kind", *(f"{axis} [{study.unit}]" for axis in "xyz"))
        poses = [
            (name, sensor.name, *place, *turn)
            for name, sensor, place, turn in zip(
                study.sensor_names, study.sensors, position.tolist(), angles.tolist(), strict=True
            )
        ]
        return html_table(
            f"{study.title}: {self._worth()}", ("model", f"{noun} seen %"), seen
        ) + html_table(
            self.stop_reason, (*columns, "azimuth [deg]", "elevation [deg]", "roll [deg]"), poses
        )

    def save(
        self,
        directory: str | Path,
        *,
        overwrite: bool = False,
        pictures: bool = True,
        meshes: bool = True,
    ) -> Path:
        """Write the whole result into a folder, as the command line does; return the folder.

        Parameters
        ----------
        directory : str or Path
            Made where it is missing.
        overwrite : bool
            Take the place of a result that is there.
        pictures, meshes : bool
            Whether to make the pictures, and coloured meshes for other tools.

        Raises
        ------
        StudyError
            If there is something that may not be replaced.
        MachineError
            If the files cannot be written.

        Warns
        -----
        UserWarning
            Where pictures could not be made; all else is there then.
        """
        # outputs stand above this module and are asked for when somebody wants them
        save = import_module("glvis.reports.delivery").save
        for failure in save(
            self, Path(directory), overwrite=overwrite, pictures=pictures, meshes=meshes
        ):
            warn(failure, stacklevel=2)
        return Path(directory)

    def _noun(self) -> str:
        """Return what shares of models are told of: what the objective counts."""
        return "area" if self.study.objective.by_area else noun_of_shares(self.study.models)

    def _worth(self) -> str:
        return (
            f"{self.study.objective.label} = {self.value:.4g}, "
            f"{100 * float(np.mean(self._shares())):.1f} % of the {self._noun()} seen"
        )

    def _shares(self) -> list[float]:
        """Return what share of each model at least one sensor sees."""
        return [
            share_of(model, found.counts > 0, self._noun())
            for model, found in zip(self.study.models, self.maps, strict=True)
        ]


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
    started = time.monotonic()
    x = np.array(study.rig.start if position is None else position, dtype=float)
    poses = study.rig.poses(x) if camera_to_world is None else np.array(camera_to_world, float)
    expected = (len(study.sensor_names), 4, 4)
    if poses.shape != expected or not np.isfinite(poses).all():
        raise ValueError(f"poses must be finite and of shape {expected}, got {poses.shape}")
    with _evaluator(study) as evaluator:
        placement = _evaluated(evaluator, x, poses)
        return replace(placement, seconds=time.monotonic() - started)


def place_sensors(
    study: Study,
    *,
    workers: int = 1,
    cluster: str | None = None,
    on_iteration: Callable[[Progress], None] | None = None,
    checkpoint: Path | None = None,
    resume: bool = False,
    extend: int = 0,
    sampler: Sampler | None = None,
    script: Method | None = None,
) -> Placement:
    """Return the best poses that the study's search finds; a study without variables is evaluated.

    Ctrl-C, SIGTERM and SIGHUP end the search well: what is being evaluated is dropped, and the
    best so far comes back, never worse than the start. A second Ctrl-C raises KeyboardInterrupt.

    Parameters
    ----------
    study : Study
        What is searched and how.
    workers : int
        Processes that render; the result is the same for any number.
    cluster : str, optional
        Address of a dask scheduler, such as ``tcp://scheduler:8786``, whose workers render
        in place of processes here; the result is the same.
    on_iteration : callable, optional
        Is told the Progress after each iteration.
    checkpoint : Path, optional
        File that the state of the search is written to after each iteration.
    resume : bool
        Go on from ``checkpoint``; the numbers are those of a run that was never broken off.
    extend : int
        Iterations to add, with ``resume``.
    sampler : Sampler, optional
        Samples what could be seen at best, too, from at most as many maps again as the search
        rendered. Ctrl-C ends that as well.
    script : callable, optional
        A search method of one's own in place of the study's, which must not be "swarm"; see
        ``glvis.search.script``. A checkpoint does not know it: resume with the same.

    Raises
    ------
    ValueError
        If ``workers`` is less than 1 or given with ``cluster``, ``resume`` or ``extend`` miss
        what they need, or ``script`` is given to a study of "swarm".
    StudyError
        If there is nothing to resume, or the study has changed since, or ``cluster`` is no
        address.
    MachineError
        Where there is no OpenGL, workers die again and again, the checkpoint cannot be
        written, or the cluster does not answer.
    """
    if resume and checkpoint is None:
        raise ValueError("resume needs a checkpoint")
    if extend and not resume:
        raise ValueError("extend needs resume")
    if script and study.search.method == "swarm":
        raise ValueError("script replaces a search.method other than 'swarm'")
    if workers < 1:
        raise ValueError(f"workers = {workers} must be at least 1")
    if cluster and workers != 1:
        raise ValueError("workers are processes here, cluster has its own: give one of them")
    if not study.variables:
        return evaluate_poses(study)
    saved = read_checkpoint(checkpoint, study) if checkpoint and resume else None
    with _interruptions() as interrupted, _evaluator(study, workers, cluster) as evaluator:
        run = Run(study, evaluator, checkpoint, saved, script)
        if extend:
            run.search.extend(extend)
        try:
            run.save()
            run.keep_to_budget()
            while run.search.stop_reason is None:
                if not run.iterate(interrupted):
                    run.search.stop(f"{INTERRUPTED}: {interrupted[0]}")
                    break
                run.save()
                run.keep_to_budget()
                if on_iteration:
                    on_iteration(run.progress())
        except KeyboardInterrupt:  # whoever else raised it means the same
            if interrupted:
                raise
            run.search.stop(f"{INTERRUPTED}: Ctrl-C")
        spent, x = evaluator.maps_rendered, run.best_position
        best = _evaluated(evaluator, x, study.rig.poses(x))
        reach = sampler.reach(evaluator, best.maps, spent, interrupted) if sampler else None
        return replace(
            best,
            start_value=run.start_value,
            trace=tuple(run.trace),
            stop_reason=run.search.stop_reason or "",
            seconds=run.seconds(),
            evaluations=run.evaluations,
            maps_rendered=spent,
            warnings=tuple(run.warnings),
            reach=reach,
        )


def _evaluator(study: Study, workers: int = 1, cluster: str | None = None) -> Evaluator:
    """Return an evaluator whose maps are made here, by workers or on a cluster."""
    if cluster:
        return Evaluator(study, maps=ClusterMaps(MapScene.of(study), cluster))
    if workers != 1:
        return Evaluator(study, maps=Workers(MapScene.of(study), workers))
    with rasterising_in_this_thread():
        return Evaluator(study)


def _evaluated(evaluator: Evaluator, position: Floats, poses: Floats) -> Placement:
    """Return what one set of poses (S, 4, 4) sees, as if nothing had been searched."""
    study = evaluator.study
    maps = tuple(evaluator.visibility_of_poses(poses))
    by_model = study.objective.value_by_model(
        [found.counts for found in maps], [model.areas for model in study.models]
    )
    value = float(study.objective.aggregated(by_model))
    return Placement(
        study=study,
        position=position,
        camera_to_world=poses,
        maps=maps,
        value=value,
        values_by_model=by_model,
        start_value=value,
        trace=(),
        stop_reason=ONLY_EVALUATED,
        seed=study.swarm.seed,
        seconds=0.0,
        evaluations=1,
        maps_rendered=evaluator.maps_rendered,
        gl=evaluator.gl,
        workers=evaluator.workers,
    )


@contextmanager
def _interruptions() -> Iterator[list[str]]:
    """Collect the names of Ctrl-C, SIGTERM and SIGHUP instead of dying of them.

    Only the main thread may ask for that; elsewhere, and where a handler is neither Python's nor
    the system's own, all stays as it was.
    """
    names: list[str] = []
    before: dict[int, Any] = {}

    def note(number: int, frame: object) -> None:
        names.append("Ctrl-C" if number == signal.SIGINT else signal.Signals(number).name)
        if number == signal.SIGINT:
            signal.signal(number, signal.default_int_handler)  # the second one is meant

    if threading.current_thread() is threading.main_thread():
        for name in ("SIGINT", "SIGTERM", "SIGHUP"):
            if not hasattr(signal, name):  # Windows has no SIGHUP
                continue
            number = getattr(signal, name)
            handler = signal.getsignal(number)
            if handler is signal.default_int_handler or (
                handler is signal.SIG_DFL and number != signal.SIGINT
            ):
                before[number] = signal.signal(number, note)
    try:
        yield names
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)
