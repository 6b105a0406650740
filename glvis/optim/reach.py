"""What the sensors could see at best: the share of each model that some allowed pose sees.

Positions of the variables are drawn at random within their bounds, and what each sensor sees
from them is put together. No layout sees more than that, so a coverage of 68 % where 94 % can be
reached is 72 % of what is possible. Sampling can only miss: the share is a lower bound, and
``growth`` says how much was still being found.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from glvis.optim.box import Box
from glvis.optim.evaluator import Evaluator
from glvis.sight.visibility import VisibilityMap

# Sampling stops when a doubling has added less than this share of the faces. Measured: so
# scenes/arm.toml stops after 128 positions at 99.7 %, and 1,024 find 99.9 %; scenes/kitchen-2.toml
# after 4,096 at 97.4 %, and 16,384 find 97.7 %: what is missed is about the last growth.
_ENOUGH = 0.005
_FIRST = 64  # positions before the first doubling; fewer may miss a whole side by chance
_NEVER = np.iinfo(np.int64).max
_SEED = 0  # the same for every search of a study, so that their shares can be compared


@dataclass(frozen=True, eq=False)
class Reach:
    """Which faces some allowed pose sees, as far as sampling has found them.

    Attributes
    ----------
    sensors : tuple of (F,) int
        One a model, in the face order of the file: how many sensors have an allowed pose that
        sees the face. 0 is out of reach. Where mounts share variables, not all of these
        sensors can see it at the same time.
    positions : int
        Random positions of the variables that were tried.
    maps_rendered : int
        Maps made for them; not counted as the search's.
    growth : float
        Share of the faces, the mean over models, that only the later half of the positions found.
    """

    sensors: tuple[NDArray[np.integer], ...]
    positions: int
    maps_rendered: int
    growth: float


def sampled_reach(
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
        Stop before more are rendered, whatever is still to be found.
    interrupted : sequence of str
        Filled by whoever wants this to end; what was found so far is the answer.

    Returns
    -------
    Reach or None
        None if not a single position was tried.
    """
    rig, before = evaluator.study.rig, evaluator.maps_rendered
    box, rng = Box(rig.bounds, rig.periodic), np.random.default_rng(_SEED)
    seen = [found.visible.copy() for found in maps]  # (S, F) a model
    since = [np.where(union.any(axis=0), 0, _NEVER) for union in seen]  # found by which position
    most = most_maps // (len(rig.sensor_names) * len(maps))
    tried, goal, growth = 0, min(_FIRST, most), 0.0
    while tried < goal and not interrupted:
        for found in evaluator.each_visibility(box.uniform(goal - tried, rng)):
            tried += 1
            for union, first, one in zip(seen, since, found, strict=True):
                union |= one.visible
                first[one.visible.any(axis=0) & (first == _NEVER)] = tried
            if interrupted:
                break
        growth = float(np.mean([_later_half(first, tried) for first in since]))
        if tried == _FIRST or growth >= _ENOUGH:
            goal = min(2 * tried, most)
    if not tried:
        return None
    rendered = evaluator.maps_rendered - before
    return Reach(tuple(union.sum(axis=0) for union in seen), tried, rendered, growth)


def _later_half(first: NDArray[np.integer], tried: int) -> float:
    """Return the share of the faces that were first seen by the later half of the positions."""
    return float(((first > tried / 2) & (first < _NEVER)).mean())
