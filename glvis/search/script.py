"""Scripts: search methods as generators that yield positions and are sent their values.

A script reads as the method does: what is tried, in which order. It goes on after a break by being
sent again the values that it was sent before: with the same seed it asks for the same positions,
and no map is rendered for that.
"""

from __future__ import annotations

import hashlib
import json
import math
from collections.abc import Callable, Generator, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, Protocol

import numpy as np
from numpy.typing import ArrayLike, NDArray

from glvis.errors import StudyError
from glvis.search.auto_options import AutoOptions
from glvis.search.box import Box

Floats = NDArray[np.float64]
Bools = NDArray[np.bool_]


@dataclass(frozen=True, eq=False)
class Ask:
    """A request for the values of positions.

    Attributes
    ----------
    positions : (P, D) float64
        In the units of the study file.
    cost : int
        Most maps that this may render.
    method : str
        Name for the trace.
    sensors : tuple of int, optional
        Active sensors; None means all.
    """

    positions: Floats
    cost: int
    method: str
    sensors: tuple[int, ...] | None = None


Script = Generator[Ask, Floats, Any]
Note = Callable[[list[NDArray[np.uint8]]], None]  # takes maps (S, F), one a model


class Learner(Protocol):
    """A model that learns from rendered maps, within limits of its own; see `Surrogate`."""

    @property
    def faces(self) -> int:
        """Number of faces that it learns of, n."""

    @property
    def is_full(self) -> bool:
        """Whether no more can be learned."""

    def sample(self, maps: list[NDArray[np.uint8]]) -> Bools:
        """Return what is worth keeping (S, n) of maps (S, F), one a model."""

    def unknown(self, positions: Floats, sensors: Sequence[int] | None) -> NDArray[np.intp]:
        """Return what can still be learned: rows of (position, place in ``sensors``)."""

    def learn(
        self,
        positions: Floats,
        sensors: Sequence[int] | None,
        which: NDArray[np.intp],
        seen: Bools,
    ) -> None:
        """Learn what was ``seen`` (K, n) from the poses (K, 2) that ``unknown`` named."""


@dataclass(frozen=True)
class Block:
    """A coordinate block: variables that are moved together.

    Attributes
    ----------
    columns : tuple of int
        Columns of these variables in a position (D,).
    sensors : tuple of int
        All sensors that they move.
    own : tuple of int
        Those of the columns that move all these sensors at once.
    """

    columns: tuple[int, ...]
    sensors: tuple[int, ...]
    own: tuple[int, ...]


@dataclass(eq=False)
class Problem:
    """A search problem as a script sees it: box, moving sensors and budget, without a scene.

    Attributes
    ----------
    box : Box
        Bounds of all positions.
    start : (D,) float64
        The study's start, in the box.
    moved_by : tuple of frozenset of int
        Columns that move each of the S sensors.
    models : int
        Number M of models: the maps that a new pose of a sensor costs.
    max_maps : int
        Maps that may be rendered.
    most_poses : int
        Poses whose maps are kept.
    pose_keys : callable
        Returns for a position (D,) one key for the pose of each of the S sensors; equal keys see
        the same.
    rng : Generator
        The one source of chance.
    surrogate : callable
        Returns predicted values (P,) of positions (P, D) by some active sensors (None: all); good
        for ranks only, and costs no map. Without one, all are equal.
    learner : Learner, optional
        Model that learns from the maps, so that predictions get better.
    options : AutoOptions
        Tuning constants.
    maps_rendered : int
        Maps rendered so far; kept up by `ScriptSearch`.
    """

    box: Box
    start: Floats
    moved_by: tuple[frozenset[int], ...]
    models: int
    max_maps: int
    most_poses: int
    pose_keys: Callable[[Floats], Sequence[object]]
    rng: np.random.Generator
    surrogate: Callable[[Floats, Sequence[int] | None], Floats] = lambda x, sensors: np.zeros(
        len(x)
    )
    learner: Learner | None = None
    options: AutoOptions = field(default_factory=AutoOptions)
    maps_rendered: int = 0

    @property
    def blocks(self) -> list[Block]:
        """For each set of sensors that some variable moves: the variables that move no others.

        The pose of a mount that shares a height with others is one block without the height,
        and all that share it are another with it.
        """
        moves = [
            frozenset(s for s, columns in enumerate(self.moved_by) if column in columns)
            for column in range(len(self.box))
        ]
        return [
            Block(
                tuple(c for c, moved in enumerate(moves) if moved <= sensors),
                tuple(sorted(sensors)),
                tuple(c for c, moved in enumerate(moves) if moved == sensors),
            )
            for sensors in sorted(dict.fromkeys(moves), key=lambda moved: (len(moved), min(moved)))
        ]

    def left(self) -> int:
        """Return the maps that may still be rendered."""
        return self.max_maps - self.maps_rendered

    def ask(
        self,
        positions: Floats,
        moved: Sequence[int],
        method: str,
        sensors: tuple[int, ...] | None = None,
    ) -> Ask:
        """Return an ask whose positions move only some sensors away from poses met before."""
        return Ask(positions, len(positions) * len(moved) * self.models, method, sensors)


Method = Callable[[Problem], Script]


class ScriptSearch:
    """A search that a script directs; see ``search.Search``.

    Parameters
    ----------
    method : callable
        Returns the script of a problem.
    problem : Problem
        Fresh, for this search alone.
    """

    def __init__(self, method: Method, problem: Problem) -> None:
        self._problem = problem
        self._script = method(problem)
        self.best_x = problem.start.copy()
        self.best_value = -math.inf
        self.iteration = -1
        self.stop_reason: str | None = None
        self.method = ""
        self.sensors: Sequence[int] | None = None
        self._beyond = -1  # iterations allowed whatever they cost
        self._values: list[Floats] = []
        self._maps: list[int] = []
        self._noted: list[Bools] = []  # of the positions asked for last
        self._learned: list[NDArray[np.uint8]] = []  # one bit a face, a row a pose
        self._before: NDArray[np.uint8] | None = None  # the same, of the run that is repeated
        self._digest = hashlib.sha256()  # of all positions asked for
        self._next: Ask | None = None
        self._advance(None)

    @property
    def iterations(self) -> int | None:
        """The most iterations there can be, where it goes on though the maps are used up."""
        is_beyond = self._is_spent and 0 <= self.iteration <= self._beyond
        return self._beyond if is_beyond else None

    @property
    def most_maps(self) -> int | None:
        """The most maps that may be rendered, where they end the search."""
        return self._problem.max_maps if self.iterations is None else None

    def ask(self) -> Floats:
        """Return the positions (P, D) to evaluate next.

        Raises
        ------
        ValueError
            When the search has ended.
        """
        if self._next is None or self.stop_reason is not None:
            raise ValueError(f"the search has ended: {self.stop_reason}")
        self.method, self.sensors = self._next.method, self._next.sensors
        self._noted = []
        return self._next.positions.copy()

    @property
    def note(self) -> Note | None:
        """Observer of the maps of each position asked for; None where nothing is learned."""
        learner = self._problem.learner
        if learner is None or learner.is_full:
            return None
        return lambda maps: self._noted.append(learner.sample(maps))

    def tell(self, values: ArrayLike, maps_rendered: int) -> None:
        """Take the values (P,) of the positions asked for last; NaN counts as -inf.

        Raises
        ------
        ValueError
            If the shape is wrong.
        """
        ask = self._next
        v = np.asarray(values, dtype=float)
        if ask is None or v.shape != (len(ask.positions),):
            raise ValueError(f"values of shape {v.shape} are not those of what was asked for")
        self._learn(ask)
        v = np.where(np.isnan(v), -math.inf, v)
        self._values.append(v)
        self._maps.append(maps_rendered)
        self._problem.maps_rendered = maps_rendered
        self.iteration += 1
        if ask.sensors is None and v.max() > self.best_value:
            self.best_value = float(v.max())
            self.best_x = ask.positions[v.argmax()].copy()
        self._advance(v)

    def stop(self, reason: str) -> None:
        """End from outside; the first reason given stays."""
        self.stop_reason = self.stop_reason or reason

    def extend(self, iterations: int) -> None:
        """Allow this many iterations more, whatever they cost."""
        if iterations < 1:
            raise ValueError(f"iterations = {iterations} to add must be at least 1")
        self._beyond = self.iteration + iterations
        self.stop_reason = self._rule_that_stops()

    def state(self) -> dict[str, NDArray[Any]]:
        """Return all values taken, from which all else follows."""
        head = {"beyond": self._beyond, "digest": self._digest.hexdigest()}
        # in one piece each from now on, as this is asked for again after the next few
        self._values = [np.concatenate([np.zeros(0), *self._values])]
        self._learned = [np.concatenate(self._learned)] if self._learned else []
        return {
            "values": self._values[0],
            "maps": np.array(self._maps, dtype=np.int64),
            "learned": self._learned[0] if self._learned else np.zeros((0, 0), np.uint8),
            "json": np.array(json.dumps(head)),
        }

    def go_on(self, state: Mapping[str, NDArray[Any]]) -> None:
        """Take the values of a saved search, in one that is fresh.

        Raises
        ------
        StudyError
            If it would have asked for something else: another version of glvis or NumPy.
        """
        head = json.loads(str(state["json"]))
        values, first = state["values"], 0
        self._before = state["learned"]
        for maps in state["maps"].tolist():
            if self._next is None:
                break
            n = len(self._next.positions)
            self.tell(values[first : first + n], maps)
            first += n
        self._before = None
        if first != len(values) or self._digest.hexdigest() != head["digest"]:
            raise _another_way()
        self._beyond = head["beyond"]
        self.stop_reason = self._rule_that_stops()

    def _learn(self, ask: Ask) -> None:
        """Let the learner learn from the maps asked for, or from those before a break."""
        learner = self._problem.learner
        if learner is None or learner.is_full:
            return
        which = learner.unknown(ask.positions, ask.sensors)
        if self._before is None:
            noted = [self._noted[p][column] for p, column in which.tolist()]
            bits = np.packbits(np.array(noted, bool).reshape(-1, learner.faces), axis=1)
        else:
            bits, self._before = self._before[: len(which)], self._before[len(which) :]
            if bits.shape != (len(which), (learner.faces + 7) // 8):
                raise _another_way()
        self._learned.append(bits)
        seen = np.unpackbits(bits, axis=1, count=learner.faces).astype(bool)
        learner.learn(ask.positions, ask.sensors, which, seen)

    def _advance(self, values: Floats | None) -> None:
        try:
            self._next = next(self._script) if values is None else self._script.send(values)
        except StopIteration as end:
            self._next = None
            self.stop_reason = self.stop_reason or f"finished: {end.value}"
            return
        self._digest.update(self._next.positions.tobytes())
        self.stop_reason = self.stop_reason or self._rule_that_stops()

    def _rule_that_stops(self) -> str | None:
        """Return in words why no more may be asked, if so."""
        if self._next is None:
            return self.stop_reason
        if self.iteration < self._beyond or not self._is_spent:
            return None
        spent, most = self._problem.maps_rendered, self._problem.max_maps
        return f"finished: {spent} of {most} maps are rendered"

    @property
    def cost(self) -> int:
        """The most maps that what is asked for next may render, 0 at the end."""
        return self._next.cost if self._next else 0

    @property
    def _is_spent(self) -> bool:
        """Whether what is asked for next may cost more maps than are left."""
        return self.cost > self._problem.left()


def _another_way() -> StudyError:
    return StudyError(
        "the search cannot go on: this version of glvis or NumPy, or this processor, would have "
        "searched in another way"
    )
