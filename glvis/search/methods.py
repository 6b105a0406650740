"""The protocol of all search methods: ask for positions, tell their values, resume after a break.

A method knows positions, values and how many maps they cost; never sensors, meshes or files.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any, Protocol

import numpy as np
from numpy.typing import ArrayLike, NDArray

from glvis.errors import StudyError
from glvis.problem.search_options import MAPS
from glvis.problem.study import Study
from glvis.search.auto import auto
from glvis.search.auto_options import AutoOptions
from glvis.search.box import Box
from glvis.search.greedy import search_greedily
from glvis.search.script import Method, Note, Problem, ScriptSearch
from glvis.search.surrogate import Surrogate
from glvis.search.swarm import Swarm

Floats = NDArray[np.float64]
State = dict[str, NDArray[Any]]


class Search(Protocol):
    """A search that is asked for positions and told their values; larger is better.

    Attributes
    ----------
    method : str
        Name of what asked last.
    sensors : sequence of int or None
        Active sensors at the positions asked for last; None means all, and only then are the
        values those of whole layouts.
    best_x : (D,) float64
        Best position so far, before any value the start.
    iteration : int
        Number of the positions asked for last, from 0.
    stop_reason : str or None
        Reason why the search has ended, in words.
    """

    method: str
    sensors: Sequence[int] | None
    best_x: Floats
    iteration: int
    stop_reason: str | None

    @property
    def best_value(self) -> float:
        """Largest value told so far."""

    @property
    def note(self) -> Note | None:
        """Observer of the maps of the positions asked for, if any; see ``Evaluator.each``."""

    @property
    def iterations(self) -> int | None:
        """The most iterations there can be; None where they do not end the search."""

    @property
    def most_maps(self) -> int | None:
        """The most maps that may be rendered; None where they do not end the search."""

    def ask(self) -> Floats:
        """Return positions (P, D) to evaluate."""

    def tell(self, values: ArrayLike, maps_rendered: int) -> None:
        """Take their values (P,), and the maps that the run has rendered so far."""

    def stop(self, reason: str) -> None:
        """End from outside."""

    def extend(self, iterations: int) -> None:
        """Allow more iterations."""

    def state(self) -> State:
        """Return all that is needed to go on bit for bit, as arrays without objects."""


class SwarmSearch(Swarm):
    """The paper's swarm as one method among others."""

    method = "swarm"
    sensors: Sequence[int] | None = None
    most_maps: int | None = None
    note: Note | None = None  # it learns from values alone

    def tell(self, values: ArrayLike, maps_rendered: int = 0) -> None:
        """Take the values (P,) of the positions asked for last."""
        super().tell(values)

    @property
    def iterations(self) -> int:
        """The most iterations there can be."""
        return self.options.iterations


SCRIPTS: dict[str, Method] = {
    "auto": auto,
    "greedy": search_greedily,
}


def new_search(study: Study, most_poses: int, script: Method | None = None) -> Search:
    """Return the search that a study asks for, at its beginning.

    Parameters
    ----------
    study : Study
        With at least one variable.
    most_poses : int
        Poses whose maps the evaluator keeps.
    script : callable, optional
        A method in place of the study's.
    """
    rig = study.rig
    if script is None and study.search.method == "swarm":
        swarm = SwarmSearch(rig.bounds, rig.periodic, rig.start, study.swarm)
        swarm.most_maps = study.search.max_maps
        return swarm
    return _new_script_search(study, most_poses, script)


def _new_script_search(study: Study, most_poses: int, script: Method | None) -> ScriptSearch:
    """Return the search of a study by a script, its own or another, at its beginning."""
    rig, script = study.rig, script or SCRIPTS[study.search.method]
    box = Box(rig.bounds, rig.periodic)

    def pose_keys(x: Floats) -> list[object]:
        poses = rig.poses(x)
        return [(kind, pose.tobytes()) for kind, pose in zip(rig.sensor_kinds, poses, strict=True)]

    options = AutoOptions()
    surrogate = Surrogate(study, options)
    problem = Problem(
        box=box,
        start=box.inside(rig.start),
        moved_by=rig.moved_by,
        models=len(study.models),
        max_maps=study.search.max_maps or MAPS * len(study.sensors) * len(study.models),
        most_poses=most_poses,
        pose_keys=pose_keys,
        rng=np.random.default_rng(study.swarm.seed),
        surrogate=surrogate,
        learner=surrogate if script is auto else None,
        options=options,
    )
    return ScriptSearch(script, problem)


def search_from_state(
    study: Study,
    most_poses: int,
    state: Mapping[str, NDArray[Any]],
    script: Method | None = None,
) -> Search:
    """Return a search that goes on from ``state``.

    Raises
    ------
    StudyError
        If it cannot: another version of glvis or NumPy would have searched in another way.
    """
    try:
        if script is None and study.search.method == "swarm":
            swarm = SwarmSearch.from_state(state)
            swarm.most_maps = study.search.max_maps
            return swarm
        search = _new_script_search(study, most_poses, script)
        search.go_on(state)
        return search
    except StudyError:
        raise
    except (KeyError, TypeError, ValueError, OverflowError) as error:
        raise StudyError(f"the search cannot go on: its state is broken: {error}") from error


def swarm_columns(search: Search) -> tuple[float, int]:
    """Return inertia and neighbours of the last swarm, for the trace; 0 for other methods."""
    if not isinstance(search, SwarmSearch):
        return 0.0, 0
    last = search.trace[-1]
    return last.inertia, last.neighbours
