"""Jobs as workers are given them: how large they are, and after how long a worker counts as hung.

The same for processes here and for a cluster.
"""

from __future__ import annotations

from collections.abc import Sequence
from queue import SimpleQueue
from typing import Any

from glvis.visibility.maps import MapJob

# Seconds until a worker counts as hung: without a job behind it, for any job at least, and at
# most; between the two, so many times the longest job before, pose for pose. Within a job of
# quick maps a driver may give up on one of millions of faces, and NumPy has to make it.
TIMEOUT_START, TIMEOUT_LEAST, TIMEOUT_MOST, TIMEOUT_FACTOR = 300.0, 60.0, 540.0, 20.0
_FEW = 8  # poses a worker: not more are shared out all at once, not more finely towards the end


def job_timeout(poses: int, slowest: float, least: float = TIMEOUT_LEAST) -> float:
    """Return the timeout of a job of so many poses, seconds.

    ``slowest`` is the longest that a pose has taken, seconds; 0 where none is known.
    """
    if not slowest:
        return TIMEOUT_START
    return min(TIMEOUT_MOST, max(least, TIMEOUT_FACTOR * slowest * poses))


def share_out(
    jobs: Sequence[MapJob], workers: int, least: int, most: int
) -> tuple[list[MapJob], list[tuple[int, int]]]:
    """Return jobs in parts for workers, and of each job its parts, begin and end.

    Parameters
    ----------
    jobs : sequence of MapJob
        Of any size.
    workers : int
        How many share them. A part is half of one's share of what is left: parts become smaller
        towards the end, so that all workers end together,
    least, most : int
        but no parts of fewer poses than ``least``, nor of more than ``most``.
    """
    left = sum(map(len, jobs))
    share = -(-left // workers)
    if share <= _FEW:
        least = max(least, share)
    parts: list[MapJob] = []
    spans = []
    for job in jobs:
        begin, first = len(parts), 0
        while first < len(job):
            size = max(least, min(most, -(-left // (2 * workers))))
            parts.append(job[first : first + size])
            first, left = first + size, left - len(parts[-1])
        spans.append((begin, len(parts)))
    return parts, spans


class Batch:
    """Jobs that wait for an answer, and how it will come."""

    def __init__(self, jobs: Sequence[MapJob | None]) -> None:
        self.jobs = dict(enumerate(jobs))
        self.futures: dict[int, Any] = {}  # the latest of each
        self.done: SimpleQueue[tuple[int, Any]] = SimpleQueue()  # numbers and futures
        self.since: dict[str, float] = {}  # when workers were seen to hold jobs without an answer
