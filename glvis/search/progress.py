"""Progress of a search: towards the limit that it will meet first, at its speed of late."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import NamedTuple


class Spent(NamedTuple):
    """Amounts that a search has spent at some moment; fields are the names of limits, too."""

    iterations: float
    maps: float
    seconds: float


@dataclass(frozen=True)
class Progress:
    """Progress of a search.

    Attributes
    ----------
    iteration : int
        Done last, from 0.
    limit : str
        What will end the search first, a field of ``Spent``; a search may stall before.
    done, most : float
        How much of that is spent, and may be.
    seconds_left : float
        Until then; infinite where nothing tells.
    best, mean : float
        Largest value so far, mean of the last iteration.
    evaluations : int
        Since the start of the run.
    evaluations_per_second : float
        Since the start of this process's part of the run.
    has_ended : bool
        Whether this was the last iteration.
    workers : tuple of str
        Names of those that render on other machines, at the moment.
    """

    iteration: int
    limit: str
    done: float
    most: float
    seconds_left: float
    best: float
    mean: float
    evaluations: int
    evaluations_per_second: float
    has_ended: bool = False
    workers: tuple[str, ...] = ()


def first_limit(
    then: Spent, now: Spent, most: Mapping[str, float | None]
) -> tuple[str, float, float, float]:
    """Return the limit that will be met first: its name, what is spent, the most, seconds left.

    Parameters
    ----------
    then, now : Spent
        The speed is what was spent between them, or, where that is nothing, all the time.
    most : mapping
        Limits by name, None where there is none; those that come first win a tie.
    """
    found = []
    for name, limit in most.items():
        if limit is not None:
            done = getattr(now, name)
            speed = _speed(name, then, now) or _speed(name, Spent(0, 0, 0), now)
            left = max(0.0, limit - done)
            found.append((name, done, limit, left / speed if speed else math.inf))
    return min(found, key=lambda entry: entry[-1])


def _speed(name: str, then: Spent, now: Spent) -> float:
    """Return how much of something was spent a second; 0 where no time has passed."""
    seconds = now.seconds - then.seconds
    return (getattr(now, name) - getattr(then, name)) / seconds if seconds > 0 else 0.0
