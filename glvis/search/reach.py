"""Reach: what the sensors could see at best, the share of each model that some allowed pose sees.

Positions of the variables are drawn at random within their bounds, and what each sensor sees
from them is put together. No layout sees more than that, so a coverage of 68 % where 94 % can be
reached is 72 % of what is possible. Sampling can only miss: the share is a lower bound, and
``growth`` says how much was still being found.
"""

from __future__ import annotations

import json
import tomllib
from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from glvis.evaluation.evaluator import Evaluator
from glvis.search.box import Box
from glvis.search.checkpoint import identity_of
from glvis.visibility.visibility_map import VisibilityMap

# Sampling stops when a doubling has added less than this share of the faces: what is missed is
# about the last growth.
_ENOUGH = 0.005
_FIRST = 64  # positions before the first doubling; fewer may miss a whole side by chance
_NEVER = 2**16 - 1  # of the numbers of positions
_BYTES = 256 << 20  # of what is kept for later searches; the last one is, whatever it takes
_OF_THE_SEARCH = {"title", "objective", "search", "swarm"}  # tables that no map depends on
_SEED = 0  # the same for every search of a study, so that their shares can be compared


@dataclass(frozen=True, eq=False)
class Reach:
    """Which faces some allowed pose sees, as far as sampling has found them.

    Attributes
    ----------
    sensors : tuple of (F,) int
        One a model, by its faces, or their pieces where they were cut: how many sensors have an
        allowed pose that sees them. 0 is out of reach. Where mounts share variables, not all of
        these sensors can see it at the same time.
    positions : int
        Random positions of the variables that were tried.
    maps_rendered : int
        Maps they cost, for this search or another; not counted as the search's.
    growth : float
        Share of the faces, the mean over models, that only the later half of the positions found.
    """

    sensors: tuple[NDArray[np.integer], ...]
    positions: int
    maps_rendered: int
    growth: float


class Sampler:
    """A sampler of what can be reached, which keeps what it saw for the study's next search.

    Searches that differ in seed, method or objective alone are held against the same positions:
    which position first showed a face to a sensor tells what any number of the first ones see.

    Parameters
    ----------
    on_start : callable, optional
        Is called before sampling begins: it may take as long as the search did.
    """

    def __init__(self, on_start: Callable[[], None] | None = None) -> None:
        self._on_start = on_start
        self._known: dict[object, _Samples] = {}  # by what was sampled, the latest last

    def reach(
        self,
        evaluator: Evaluator,
        maps: Sequence[VisibilityMap],
        most_maps: int,
        interrupted: Sequence[str] = (),
    ) -> Reach | None:
        """Return what can be reached in a study, the same for any number of workers.

        Parameters
        ----------
        evaluator : Evaluator
            Of a study with variables.
        maps : sequence of VisibilityMap
            One a model: what a layout sees is within reach, too.
        most_maps : int
            Stop before more are needed, whatever is still to be found.
        interrupted : sequence of str
            Filled by whoever wants this to end; what was found so far is the answer.

        Returns
        -------
        Reach or None
            None if not a single position was tried.
        """
        samples = self._samples(evaluator, maps)
        most = min(most_maps // (len(evaluator.study.sensors) * len(maps)), _NEVER - 1)
        tried, goal, growth = 0, min(_FIRST, most), 0.0
        if self._on_start and samples.tried < goal and not interrupted:
            self._on_start()
        while tried < goal and not interrupted:
            if samples.tried < goal:
                samples.go_on(evaluator, goal, interrupted)
            tried = min(goal, samples.tried)
            since = [
                np.where(found.visible.any(axis=0), 0, first.min(axis=0))
                for found, first in zip(maps, samples.first, strict=True)
            ]
            growth = float(np.mean([_later_half(first, tried) for first in since]))
            if tried == _FIRST or growth >= _ENOUGH:
                goal = min(2 * tried, most)
        if not tried:
            return None
        sensors = tuple(
            ((first <= tried) | found.visible).sum(axis=0)
            for found, first in zip(maps, samples.first, strict=True)
        )
        return Reach(sensors, tried, samples.rendered * tried // samples.tried, growth)

    def _samples(self, evaluator: Evaluator, maps: Sequence[VisibilityMap]) -> _Samples:
        """Return what is known of a study, and forget what was not asked for longest."""
        identity = identity_of(evaluator.study)
        tables = tomllib.loads(identity.pop("study"))
        scene = {name: table for name, table in tables.items() if name not in _OF_THE_SEARCH}
        key = evaluator.gl, json.dumps([scene, identity], sort_keys=True)
        self._known[key] = self._known.pop(key) if key in self._known else _Samples(maps)
        while len(self._known) > 1 and sum(s.nbytes for s in self._known.values()) > _BYTES:
            del self._known[next(iter(self._known))]
        return self._known[key]


class _Samples:
    """By which position each sensor first saw each face."""

    def __init__(self, maps: Sequence[VisibilityMap]) -> None:
        self.first = [np.full(found.visible.shape, _NEVER, np.uint16) for found in maps]
        self.nbytes = sum(first.nbytes for first in self.first)
        self.tried = self.rendered = 0

    def go_on(self, evaluator: Evaluator, goal: int, interrupted: Sequence[str]) -> None:
        """Try positions until there are so many, or somebody interrupts."""
        rig, before = evaluator.study.rig, evaluator.maps_rendered
        positions = Box(rig.bounds, rig.periodic).uniform(goal, np.random.default_rng(_SEED))
        for seen in evaluator.each_visibility(positions[self.tried :]):
            self.tried += 1
            for first, one in zip(self.first, seen, strict=True):
                first[one.visible & (first == _NEVER)] = self.tried
            if interrupted:
                break
        self.rendered += evaluator.maps_rendered - before


def _later_half(first: NDArray[np.integer], tried: int) -> float:
    """Return the share of the faces that were first seen by the later half of the positions."""
    return float(((first > tried / 2) & (first <= tried)).mean())
