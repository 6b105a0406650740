"""Worker processes that make maps, each with its own OpenGL context.

Every worker is sent the scene once and then a few poses at a time. A worker that dies or hangs
is replaced and its maps are made again by another; a map depends on nothing but its pose, so
nobody can tell from the result.
"""

from __future__ import annotations

import os
import pickle
import signal
import socket
import subprocess
import sys
import time
from collections import deque
from collections.abc import Iterator, Sequence
from contextlib import suppress
from multiprocessing.connection import Connection, wait
from pathlib import Path
from typing import Any

import numpy as np

from glvis.errors import MachineError
from glvis.evaluation.jobs import TIMEOUT_LEAST, TIMEOUT_START, job_timeout, share_out
from glvis.visibility.context import GlInfo
from glvis.visibility.maps import Bits, MapJob, MapScene

_MOST_DEATHS = 3  # in a row at the start, or over the same maps: then it is no accident
_AHEAD = 2  # jobs that a worker holds, so that it need not wait for the next one
# Poses a job: many enough that sending them costs nothing, few enough to share them out evenly.
# The least are four maps, and two poses: a map of a pose alone may take twice as long as one of
# several together.
_JOB_ON_CPU, _JOB_ON_GPU, _LEAST_MAPS, _LEAST = 32, 128, 4, 2
# One core a worker: neither the rasteriser nor linear algebra shall start threads of their own.
_THREADS = {
    "LP_NUM_THREADS": "0",
    "OPENBLAS_NUM_THREADS": "1",
    "OMP_NUM_THREADS": "1",
    "MKL_NUM_THREADS": "1",
}


def available_cores() -> int:
    """Return how many cores this process may use, by affinity and by control group."""
    cores = len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count()
    quota, _, period = _cgroup_limit().partition(" ")
    if quota.isdecimal() and period.isdecimal():
        return max(1, min(cores or 1, int(quota) // int(period)))
    return cores or 1


def _cgroup_limit() -> str:
    try:
        return Path("/sys/fs/cgroup/cpu.max").read_text(encoding="ascii").strip()
    except OSError:
        return ""


class Workers:
    """Worker processes that make maps; used as an Evaluator's ``maps``.

    Parameters
    ----------
    scene : MapScene
        Models, obstacles and sensors.
    n : int
        Processes.
    timeout : float, optional
        Least timeout of a job, seconds.

    Attributes
    ----------
    gl : GlInfo
        The OpenGL driver in use.
    workers : int
        Processes.
    warnings : list of str
        One for each worker that was replaced.

    Raises
    ------
    ValueError
        If ``n`` is less than 1.
    MachineError
        Where a worker finds no OpenGL, or workers die again and again.
    """

    names: Sequence[str] = ()

    def __init__(self, scene: MapScene, n: int, *, timeout: float = TIMEOUT_LEAST) -> None:
        if n < 1:
            raise ValueError(f"workers = {n} must be at least 1")
        self.workers = n
        self.warnings: list[str] = []
        self._least = max(_LEAST, -(-_LEAST_MAPS // len(scene.models)))
        self._scene = pickle.dumps(scene, protocol=pickle.HIGHEST_PROTOCOL)
        self._timeout = timeout
        self._slowest = 0.0  # seconds a pose
        self._deaths_at_start = 0
        self._call = 0  # so that answers to a call that nobody waits for any more are known
        self._gl: GlInfo | None = None
        self._crew: list[_Worker] = []
        try:
            self._crew += [_Worker(number) for number in range(1, n + 1)]
            while self._gl is None:
                self._listen(_Call())
        except BaseException:
            self.release()
            raise
        self.gl: GlInfo = self._gl

    def make(self, jobs: Sequence[MapJob]) -> Iterator[Bits]:
        """Yield the maps of each job, in their order.

        Raises
        ------
        MachineError
            If three workers die over the same maps. What a worker raises is raised here.
        """
        most = _JOB_ON_CPU if self.gl.is_software else _JOB_ON_GPU
        call = _Call(*share_out(jobs, self.workers, self._least, most))
        self._call += 1
        for begin, end in call.spans:
            while not all(part in call.made for part in range(begin, end)):
                self._hand_out(call)
                self._listen(call)
            self._hand_out(call)
            yield np.concatenate([call.made.pop(part) for part in range(begin, end)])

    def release(self) -> None:
        """End all processes."""
        for worker in self._crew:
            worker.connection.close()  # to a worker that waits, this is the end
        for worker in self._crew:
            worker.end()
        self._crew.clear()

    def _hand_out(self, call: _Call) -> None:
        """Give parts to workers that hold few, those with the fewest first."""
        for held in range(_AHEAD):
            for worker in self._crew:
                if call.waiting and worker.is_ready and len(worker.holds) <= held:
                    part = call.waiting.popleft()
                    worker.give((self._call, part), call.parts[part])

    def _listen(self, call: _Call) -> None:
        """Wait for an answer, a death or a timeout, and deal with it."""
        now = time.monotonic()
        deadlines = [self._deadline(worker) for worker in self._crew]
        timeout = max(0.0, min(deadlines) - now) if any(w.is_busy for w in self._crew) else None
        answering = wait([worker.connection for worker in self._crew], timeout)
        for place, worker in enumerate(self._crew):
            if worker.connection in answering:
                try:
                    tag, answer = worker.connection.recv()
                except (EOFError, OSError, pickle.UnpicklingError):
                    self._replace(place, call, f"died ({worker.end()})")
                else:
                    self._take(worker, tag, answer, call)
            elif time.monotonic() >= deadlines[place]:
                waited = time.monotonic() - worker.since
                worker.end(at_once=True)
                self._replace(place, call, f"did not answer for {waited:.3g} s")

    def _deadline(self, worker: _Worker) -> float:
        """Return the time after which a worker counts as hung."""
        if not worker.is_ready:
            return worker.since + max(TIMEOUT_START, self._timeout)
        if not worker.holds:
            return float("inf")
        poses = len(worker.holds[0][1])
        return worker.since + job_timeout(poses, self._slowest, self._timeout)

    def _take(self, worker: _Worker, tag: Any, answer: Any, call: _Call) -> None:
        """Deal with what a worker says."""
        if tag == "raised":
            raise answer
        now = time.monotonic()
        if tag == "here":
            worker.say(self._scene)
        elif tag == "ready":
            worker.is_ready = True
            self._deaths_at_start = 0
            self._gl = self._gl or answer
        else:
            _, job = worker.holds.popleft()
            self._slowest = max(self._slowest, (now - worker.since) / len(job))
            number, part = tag
            if number == self._call:
                call.made[part] = answer
        worker.since = now

    def _replace(self, place: int, call: _Call, how: str) -> None:
        """Put a new worker in the place of one that is gone; its maps wait again."""
        gone = self._crew[place]
        what = f"worker {gone.number} {how}"
        if not gone.is_ready:
            self._deaths_at_start += 1
            if self._deaths_at_start >= _MOST_DEATHS:
                raise MachineError(f"{what} at its start, as others before")
        mine = [part for (number, part), _ in gone.holds if number == self._call]
        if mine and gone.holds[0][0] == (self._call, mine[0]):  # at work on it, not just holding
            call.deaths[mine[0]] = call.deaths.get(mine[0], 0) + 1
            if call.deaths[mine[0]] >= _MOST_DEATHS:
                raise MachineError(f"{what}, as others before over the same maps")
        call.waiting.extendleft(reversed(mine))
        self.warnings.append(f"{what} and was replaced; its maps were made again")
        self._crew[place] = _Worker(gone.number)


class _Call:
    """The parts of the jobs of one ``make``, and what is known of them."""

    def __init__(self, parts: Sequence[MapJob] = (), spans: Sequence[tuple[int, int]] = ()) -> None:
        self.parts, self.spans = parts, spans
        self.waiting = deque(range(len(self.parts)))
        self.made: dict[int, Bits] = {}
        self.deaths: dict[int, int] = {}


class _Worker:
    """One process and the way to it."""

    def __init__(self, number: int) -> None:
        ours, theirs = socket.socketpair()
        root = str(Path(__file__).resolve().parents[2])
        inherited = os.environ.get("PYTHONPATH")
        path = root if not inherited else os.pathsep.join([root, inherited])
        with theirs:
            self.process = subprocess.Popen(
                [sys.executable, "-P", "-m", "glvis.evaluation.worker", str(theirs.fileno())],
                pass_fds=[theirs.fileno()],
                stdin=subprocess.DEVNULL,
                stdout=subprocess.DEVNULL,
                env=_THREADS | os.environ | {"PYTHONPATH": path},
            )
        self.number = number
        self.connection = Connection(ours.detach())
        self.is_ready = False
        self.holds: deque[tuple[tuple[int, int], MapJob]] = deque()  # tag and job, oldest first
        self.since = time.monotonic()  # when what it is at now began

    @property
    def is_busy(self) -> bool:
        """Whether an answer is due."""
        return not self.is_ready or bool(self.holds)

    def say(self, message: bytes) -> None:
        """Send bytes; if nobody is there, listening will tell."""
        with suppress(OSError):
            self.connection.send_bytes(message)

    def give(self, tag: tuple[int, int], job: MapJob) -> None:
        """Send a job, to be done after those that are held."""
        if not self.holds:
            self.since = time.monotonic()
        self.holds.append((tag, job))
        self.say(pickle.dumps((tag, job), protocol=pickle.HIGHEST_PROTOCOL))

    def end(self, *, at_once: bool = False) -> str:
        """End the process; return how it ended, in words."""
        self.connection.close()
        if at_once:
            self.process.kill()
        try:
            code = self.process.wait(2.0)
        except subprocess.TimeoutExpired:
            self.process.kill()
            code = self.process.wait()
        if code < 0:
            return signal.Signals(-code).name
        return f"exit code {code}"
