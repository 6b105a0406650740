"""Workers of a dask.distributed cluster that make maps, each with its own OpenGL context.

Every worker is sent the scene once and then a few poses at a time. What a lost worker had not
delivered dask gives to the others; a map depends on nothing but its pose, so nobody can tell from
the result. dask is imported when a cluster is wanted, not before.
"""

from __future__ import annotations

import logging
import re
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import suppress
from functools import partial
from itertools import count
from queue import Empty
from typing import TYPE_CHECKING, Any
from uuid import uuid4

import numpy as np

from glvis.common.hints import installed_by
from glvis.errors import MachineError, StudyError
from glvis.evaluation.jobs import TIMEOUT_LEAST, Batch, job_timeout, share_out
from glvis.visibility.maps import Bits, MapJob, MapScene

if TYPE_CHECKING:
    from glvis.evaluation.remote import Answer, Unfit

# Seconds without any answer after which a cluster is given up: before that, others take over from
# a worker that hangs (TIMEOUT_MOST at most) or falls silent (dask's worker-ttl, 300 s).
TIMEOUT_SILENCE = 600.0
TIMEOUT_FIRST = 60.0  # seconds to wait for a first worker, where nothing is lost yet
_TO_CONNECT = 10.0  # seconds
_TICK = 1.0  # seconds between updates of the workers that are there
# Poses a task: so many that what dask spends on a task is small beside its maps (measured by
# tools/bench_cluster.py), so few that they share out evenly; the least number for one model.
_MOST_ON_CPU, _MOST_ON_GPU, _LEAST = 128, 256, 16
_ADDRESS = re.compile(r"(tcp|tls)://\S+:\d+")


class ClusterMaps:
    """The workers of a cluster as makers of maps; used as an Evaluator's ``maps``.

    Parameters
    ----------
    scene : MapScene
        Models, obstacles and sensors.
    address : str
        Of the scheduler, such as ``tcp://scheduler:8786``.
    silence_timeout : float, optional
        Seconds without any answer after which the cluster is given up.
    first_timeout : float, optional
        Seconds to wait for a first worker.
    timeout : float, optional
        Least timeout of a job, seconds.

    Attributes
    ----------
    gl : GlInfo
        The OpenGL driver in use, of the first worker that answered.
    workers : int
        Most workers that were there at one time.
    names : sequence of str
        Of the workers that are there.
    warnings : list of str
        One for each worker that was lost, has another driver, or wastes threads.

    Raises
    ------
    StudyError
        If ``address`` is none.
    MachineError
        Where dask.distributed is missing, no scheduler or no worker answers, or versions differ.
    """

    def __init__(
        self,
        scene: MapScene,
        address: str,
        *,
        silence_timeout: float = TIMEOUT_SILENCE,
        first_timeout: float = TIMEOUT_FIRST,
        timeout: float = TIMEOUT_LEAST,
    ) -> None:
        if not _ADDRESS.fullmatch(address):
            raise StudyError(
                f"cluster = '{address}' must be the address of a dask scheduler, such as "
                "tcp://scheduler:8786"
            )
        self.address, self.workers = address, 0
        self.names: Sequence[str] = ()
        self.warnings: list[str] = []
        self._distributed, self._remote = _import_dask()
        self._most_silence, self._timeout = first_timeout, timeout
        self._slowest = 0.0  # seconds a pose
        self._warm: set[str] = set()  # addresses of workers that have answered
        self._hung: set[str] = set()  # of those that are given no more
        self._stuck: list[Any] = []  # futures of what those hold: so dask sees that they are busy
        self._heard = time.monotonic()
        self._crew: dict[str, str] = {}  # names by address, of those that are there
        self._run, self._number = uuid4().hex, count()  # names of tasks, no two the same
        self._least = -(-_LEAST // len(scene.models))
        self._scene = ""  # its name on the workers
        self._client = self._connect()
        try:
            self._check_versions()
            for orphan in self._ask(partial(self._client.run_on_scheduler, self._remote.orphans)):
                self._free(orphan)
            there = self._remote.SceneThere(scene, self._client.id)
            self._scene = there.name
            self._ask(partial(self._client.register_plugin, there), all_workers=True)
            self._update_workers()
            while not self._crew:
                self._check_silence()
                time.sleep(_TICK / 10)
                self._update_workers()
            self._most_silence = silence_timeout
            ((_, self.gl, _, _),) = next(self._answers([None])).values()
        except BaseException:
            self.release()
            raise

    def make(self, jobs: Sequence[MapJob]) -> Iterator[Bits]:
        """Yield the maps of each job, in their order.

        Raises
        ------
        MachineError
            If the scheduler is lost, no worker answers for long, versions differ, or several
            workers die over the same maps. What else a worker raises is raised here.
        """
        most = _MOST_ON_CPU if self.gl.is_software else _MOST_ON_GPU
        parts, spans = share_out(jobs, max(1, len(self._crew)), self._least, most)
        answers = self._answers(parts)
        made: dict[int, Bits] = {}
        for begin, end in spans:
            while not all(part in made for part in range(begin, end)):
                for part, (worker, gl, bits, _) in next(answers).items():
                    made[part] = bits
                    if gl != self.gl:
                        self._warn(
                            f"worker {self._crew.get(worker, worker)} draws with {gl.renderer} "
                            f"({gl.version}), others with {self.gl.renderer} ({self.gl.version})"
                        )
            yield np.concatenate([made.pop(part) for part in range(begin, end)])

    def release(self) -> None:
        """Let go of the scene and leave the cluster."""
        if self._scene and self._client.status == "running":
            self._free(self._scene)
        with suppress(OSError):
            self._client.close()

    def _free(self, scene: str) -> None:
        """Let workers forget a scene; what does not reach them now, the next client sends."""
        with suppress(OSError, ValueError, self._distributed.CancelledError):
            forget = partial(self._client.unregister_worker_plugin, scene)
            self._client.sync(forget, callback_timeout=_TO_CONNECT)

    def _connect(self) -> Any:
        try:
            return self._distributed.Client(
                self.address,
                timeout=min(self._most_silence, _TO_CONNECT),
                set_as_default=False,
                name="glvis",
            )
        except (OSError, TimeoutError, ValueError) as error:
            fact = str(error).strip().partition("\n")[0] or type(error).__name__
            raise MachineError(f"no dask scheduler answers at {self.address}: {fact}") from error

    def _check_versions(self) -> None:
        """Refuse workers, and a scheduler, that have other packages than this process."""
        found = self._ask(
            partial(self._client.get_versions, packages=[self._remote.DISTRIBUTION]),
            all_workers=True,
        )
        ours = {name: found["client"]["packages"][name] for name in self._remote.VERSIONS}
        versions = {"the scheduler": found["scheduler"]} | {
            f"worker {worker}": there for worker, there in found["workers"].items()
        }
        for who, there in versions.items():
            self._remote.compare_versions(who, there["packages"], ours)

    def _update_workers(self) -> None:
        """Note which workers came, and which are gone."""
        info = self._ask(partial(self._client.scheduler_info, n_workers=-1)).get("workers")
        if info is None:  # dask has given up the connection
            raise self._lost()
        for address, name in self._crew.items():
            if address not in info:
                self._warn(f"worker {name} was lost; what it had not delivered others made again")
        for address, there in info.items():
            if address not in self._crew and there["nthreads"] > 1:
                self._warn(
                    f"worker {there['name']} has {there['nthreads']} threads and draws with one; "
                    "start one worker a core instead, with --nthreads 1"
                )
        self._crew = {address: str(there["name"]) for address, there in info.items()}
        self.names = tuple(self._crew.values())
        self.workers = max(self.workers, len(self._crew))

    def _warn(self, text: str) -> None:
        if text not in self.warnings:
            self.warnings.append(text)

    def _answers(self, jobs: Sequence[MapJob | None]) -> Iterator[dict[int, Answer]]:
        """Yield the answers to jobs as they come, by their number."""
        call = Batch(jobs)
        self._submit(call, list(call.jobs))
        self._heard = time.monotonic()
        while call.jobs:
            answers: dict[int, Answer] = {}
            for number, answer in self._gather(call, self._ready(call)).items():
                if not isinstance(answer, tuple):
                    self._set_aside(call, number, answer)
                    continue
                answers[number] = answer
                worker, _, bits, seconds = answer
                del call.jobs[number]
                call.since.pop(worker, None)
                self._warm.add(worker)
                if len(bits):
                    self._slowest = max(self._slowest, seconds / len(bits))
            self._heard = time.monotonic()
            if not call.jobs:  # who was lost on the way is a warning of this call
                self._update_workers()
            if answers:
                yield answers

    def _submit(self, call: Batch, numbers: Sequence[int]) -> None:
        """Give jobs of a call to the cluster, to workers that do not hang if there are any."""
        keys = [(f"glvis-maps-{self._run}", next(self._number)) for _ in numbers]
        able = sorted(self._crew.keys() - self._hung) or None
        submit = partial(
            self._client.map,
            self._remote.draw,
            [call.jobs[number] for number in numbers],
            key=keys,
            workers=able if self._hung else None,
            allow_other_workers=bool(able and self._hung),
            scene=self._scene,
            versions=self._remote.VERSIONS,
            pure=False,
        )
        for number, future in zip(numbers, self._ask(submit), strict=True):
            call.futures[number] = future
            future.add_done_callback(lambda one, number=number: call.done.put((number, one)))

    def _ready(self, call: Batch) -> dict[int, Any]:
        """Wait for answers; return their futures by number."""
        while True:
            with suppress(Empty):
                found = [call.done.get(timeout=_TICK)]
                found += [call.done.get() for _ in range(call.done.qsize())]
                # what hung may answer after all, when another has answered, too
                if ready := {number: one for number, one in found if number in call.jobs}:
                    return ready
                continue
            self._update_workers()
            self._relieve_hung(call)
            self._check_silence()

    def _relieve_hung(self, call: Batch) -> None:
        """Let others make what a worker has held for too long, and give it no more.

        Silence is measured where none answers: while others do, it holds nothing up.
        """
        now = time.monotonic()
        holds = self._held_jobs(call)
        call.since = {address: call.since.get(address, now) for address in holds}
        for address, numbers in holds.items():
            poses = sum(len(call.jobs[number] or ()) for number in numbers)
            slowest = self._slowest if address in self._warm else 0.0
            waited = now - call.since[address]
            if waited < job_timeout(poses, slowest, self._timeout):
                continue
            self._exclude(call, address, numbers, waited)

    def _held_jobs(self, call: Batch) -> dict[str, list[int]]:
        """Return the jobs without an answer that each worker holds, by address."""
        number_of = {future.key: number for number, future in call.futures.items()}
        return {
            address: mine
            for address, keys in self._ask(self._client.processing).items()
            if (mine := [n for key in keys if (n := number_of.get(key)) in call.jobs])
        }

    def _exclude(self, call: Batch, address: str, numbers: Sequence[int], waited: float) -> bool:
        """Give a worker no more, and its jobs to others; return False where there are none."""
        if not self._crew.keys() - self._hung - {address}:
            return False
        self._hung.add(address)
        self._stuck += [call.futures[number] for number in numbers]
        self._warn(
            f"worker {self._crew.get(address, address)} did not answer for {waited:.3g} s and is "
            "given no more; its maps were made again by others"
        )
        self._submit(call, numbers)
        self._heard = time.monotonic()
        return True

    def _set_aside(self, call: Batch, number: int, unfit: Unfit) -> None:
        """Give a worker that can make no maps no more, and its job to others."""
        self._update_workers()
        if not self._crew.keys() - self._hung - {unfit.address}:
            raise MachineError(unfit.reason)
        self._hung.add(unfit.address)
        self._warn(f"{unfit.reason}; it is given no more, and its maps were made by others")
        self._submit(call, [number])

    def _gather(self, call: Batch, ready: dict[int, Any]) -> dict[int, Answer | Unfit]:
        """Return answers that are ready, without those of a worker that hangs with them made."""
        began = time.monotonic()
        try:
            return self._fetch(ready, min(self._most_silence, self._timeout))
        except TimeoutError:
            self._update_workers()
        holders = self._ask(partial(self._client.who_has, list(ready.values())))
        by_holder: dict[str, dict[int, Any]] = {}
        for number, future in ready.items():
            by_holder.setdefault(next(iter(holders[future.key]), ""), {})[number] = future
        answers: dict[int, Answer | Unfit] = {}
        for address, theirs in by_holder.items():
            with suppress(TimeoutError):
                if len(by_holder) > 1:  # else it is known to hang
                    answers |= self._fetch(theirs, min(self._timeout, _TO_CONNECT))
                    continue
            numbers = [*theirs, *self._held_jobs(call).get(address, ())]
            if not self._exclude(call, address, numbers, time.monotonic() - began):
                try:  # no other worker is there
                    answers |= self._fetch(theirs, self._most_silence)
                except TimeoutError as error:
                    raise self._silence() from error
        return answers

    def _fetch(self, ready: dict[int, Any], timeout: float) -> dict[int, Answer | Unfit]:
        """Return what futures hold, by number, or raise TimeoutError after so many seconds.

        What was lost on its way dask makes again.
        """
        gather = partial(self._client.gather, list(ready.values()), asynchronous=True)
        try:
            found = self._client.sync(gather, callback_timeout=timeout)
            return dict(zip(ready, found, strict=True))
        except self._distributed.KilledWorker as error:
            raise MachineError(
                f"{self.address}: {error.allowed_failures + 1} workers died over the same maps, "
                f"the last was {error.last_worker.address}; its log may say why"
            ) from error
        except ImportError as error:
            raise MachineError(
                f"{self.address}: a worker cannot load glvis ({error}); install the same there"
            ) from error
        except (OSError, self._distributed.CancelledError) as error:
            if isinstance(error, TimeoutError):
                raise
            raise self._lost() from error

    def _ask(self, question: Callable[[], Any], *, all_workers: bool = False) -> Any:
        """Return an answer from the scheduler, or from all workers, any of which may hang."""
        try:
            if all_workers:
                return self._client.sync(question, callback_timeout=self._most_silence)
            return question()
        except TimeoutError as error:
            raise MachineError(
                f"{self.address}: a worker does not answer for {self._most_silence:.3g} s; end it"
            ) from error
        except (OSError, self._distributed.CancelledError) as error:
            raise self._lost() from error

    def _lost(self) -> MachineError:
        return MachineError(f"the dask scheduler at {self.address} was lost")

    def _check_silence(self) -> None:
        if time.monotonic() - self._heard >= self._most_silence:
            raise self._silence()

    def _silence(self) -> MachineError:
        who = f"none of {len(self._crew)} workers answered" if self._crew else "no worker"
        return MachineError(
            f"{self.address}: {who} for {time.monotonic() - self._heard:.3g} s; start some by: "
            f"dask worker {self.address} --nthreads 1"
        )


def _import_dask() -> tuple[Any, Any]:
    try:
        import distributed

        from glvis.evaluation import remote
    except ImportError as error:
        raise MachineError(
            f"a cluster needs dask.distributed ({error}); {installed_by('cluster')}"
        ) from error
    logging.getLogger("distributed.client").setLevel(logging.CRITICAL)  # errors are told here
    return distributed, remote
