"""Maps from a dask cluster on this machine: the same to the last bit, whatever happens to it."""

import contextlib
import json
import os
import re
import signal
import socket
import subprocess
import sys
import threading
import time
import tomllib
from functools import partial
from pathlib import Path
from types import SimpleNamespace

import pytest
from support.ball_and_ring import write_ball_and_ring
from support.equal_results import assert_same_maps, assert_same_placements, some_jobs

import glvis
from glvis.cli.app import main
from glvis.errors import MachineError, StudyError
from glvis.evaluation.cluster import ClusterMaps
from glvis.search.placement import place_sensors
from glvis.study.loading import load_study
from glvis.visibility.maps import MapJob, MapScene

distributed = pytest.importorskip("distributed", reason="the extra 'cluster' is not installed")

ROOT = str(Path(glvis.__file__).parents[1])
START = 120.0  # seconds that a process of dask may take to be there


class DaskProcesses:
    """A scheduler and workers, each a process of its own, and a client that looks after them."""

    def __init__(self, folder):
        self.folder = folder
        self.address = f"tcp://127.0.0.1:{free_port()}"
        self.processes = {}
        self.client = None

    def start_scheduler(self):
        port = self.address.rpartition(":")[2]
        self._start("scheduler", "--host", "127.0.0.1", "--port", port)
        self.client = distributed.Client(self.address, timeout=START, set_as_default=False)

    def start_worker(self, name, threads=1):
        options = ["--nthreads", str(threads), "--name", name, "--no-nanny"]
        self._start("worker", self.address, *options, "--local-directory", str(self.folder))
        self.processes[name] = self.processes.pop("worker")

    def have(self, *names):
        """Let exactly these workers be there."""
        for name in set(self.processes) - {"scheduler", *names}:
            self.kill(name)
        for name in names:
            if name not in self.processes:
                self.start_worker(name)
        self.wait_for(names)

    def wait_for(self, names):
        deadline = time.monotonic() + START
        while self.there() != sorted(names):
            assert time.monotonic() < deadline, f"{self.there()} are there, not {names}"
            time.sleep(0.05)

    def there(self):
        info = self.client.scheduler_info(n_workers=-1)
        return sorted(worker["name"] for worker in info["workers"].values())

    def kill(self, name):
        """End a worker as a power cut would."""
        process = self.processes.pop(name)
        process.kill()
        process.wait()

    def cut_off(self, name):
        """Let a worker fall silent at once, whatever it is at, and die a little later."""
        self.processes[name].send_signal(signal.SIGSTOP)
        self.death = threading.Timer(0.5, self.kill, [name])
        self.death.start()

    def close(self):
        if self.client:
            self.client.close()
        for process in self.processes.values():
            process.kill()
        for process in self.processes.values():
            process.wait()

    def _start(self, what, *options):
        # the test's own interpreter and checkout; what they log is there when a test fails
        command = [sys.executable, "-m", f"distributed.cli.dask_{what}", *options]
        with (self.folder / f"{len(self.processes)}-{what}.log").open("w") as log:
            self.processes[what] = subprocess.Popen(
                [*command, "--no-dashboard"],
                env=os.environ | {"PYTHONPATH": ROOT, "PYTHONWARNINGS": "ignore"},
                cwd=self.folder,
                stdout=log,
                stderr=log,
            )


def free_port():
    with socket.socket() as one:
        one.bind(("127.0.0.1", 0))
        return one.getsockname()[1]


@pytest.fixture(scope="module")
def dask(tmp_path_factory):
    processes = DaskProcesses(tmp_path_factory.mktemp("dask"))
    try:
        processes.start_scheduler()
        yield processes
    finally:
        processes.close()


@pytest.fixture
def study(tmp_path, rng):
    return load_study(write_ball_and_ring(tmp_path, rng))


@pytest.fixture
def jobs(study, rng):
    return some_jobs(study, rng, least=37)


def lost(name):
    return f"worker {name} was lost; what it had not delivered others made again"


def scenes_held(dask):
    """Return how many scenes each worker keeps, and how many it keeps a renderer for."""

    def count():
        import gc

        from glvis.visibility.maps import LocalMaps, MapScene

        gc.collect()
        kinds = [type(thing) for thing in gc.get_objects()]
        return kinds.count(MapScene), kinds.count(LocalMaps)

    return set(dask.client.run(count).values())


def wait_until_held(dask, scenes):
    deadline = time.monotonic() + START
    while scenes_held(dask) != {(scenes, scenes)}:
        assert time.monotonic() < deadline, f"{scenes_held(dask)} scenes are kept"
        time.sleep(0.05)


def test_a_worker_killed_among_maps_is_done_without(dask, study, jobs):
    dask.have("ann", "bob")
    maps = ClusterMaps(MapScene.of(study), dask.address)
    assert sorted(maps.names) == ["ann", "bob"] and maps.warnings == []
    assert_same_maps(list(maps.make(jobs)), study, jobs)
    dask.cut_off("bob")
    made = list(maps.make(jobs))
    dask.death.join()
    assert_same_maps(made, study, jobs)
    assert_same_maps(list(maps.make(jobs)), study, jobs)
    maps.release()
    assert maps.names == ("ann",) and maps.workers == 2
    assert maps.warnings == [lost("bob")]


@pytest.fixture
def hanging(dask):
    """Let a worker by name be at something for ever; it still answers the scheduler."""

    def hang():
        from threading import Event

        from glvis.evaluation import remote

        remote.gate = Event()
        remote._thread.submit(remote.gate.wait)

    def go_on():
        from glvis.evaluation import remote

        if hasattr(remote, "gate"):
            remote.gate.set()

    def run(name):
        workers = dask.client.scheduler_info(n_workers=-1)["workers"]
        dask.client.run(hang, workers=[a for a, there in workers.items() if there["name"] == name])

    yield run
    dask.client.run(go_on)


def test_a_worker_that_hangs_is_helped_and_given_no_more(dask, study, jobs, hanging):
    dask.have("ann", "bob")
    maps = ClusterMaps(MapScene.of(study), dask.address, timeout=0.5)
    while len(maps._warm) < 2:
        list(maps.make(jobs))
    hanging("bob")
    assert_same_maps(list(maps.make(jobs)), study, jobs)
    (warning,) = maps.warnings
    assert warning.startswith("worker bob did not answer for ")
    maps._warm.clear()
    assert_same_maps(list(maps.make(jobs)), study, jobs)
    assert maps.warnings == [warning] and len(maps._warm) == 1
    maps.release()


@pytest.fixture
def freezing(dask, monkeypatch):
    """Freeze a worker by name at the moment when its maps are made and not fetched yet."""
    ready, state = ClusterMaps._ready, SimpleNamespace(name=None, frozen=None)

    def watch(maps, call):
        found = ready(maps, call)
        if state.name:
            holders = maps._client.who_has(list(found.values()))
            names = {maps._crew[address] for held in holders.values() for address in held}
            if state.name in names:
                state.frozen, state.name = dask.processes[state.name], None
                state.frozen.send_signal(signal.SIGSTOP)
        return found

    monkeypatch.setattr(ClusterMaps, "_ready", watch)
    yield state
    if state.frozen:
        state.frozen.send_signal(signal.SIGCONT)


def test_a_worker_frozen_with_its_maps_made_is_done_without(dask, study, jobs, freezing):
    dask.have("ann", "bob")
    # as long as no busy machine lets the other worker wait
    maps = ClusterMaps(MapScene.of(study), dask.address, silence_timeout=120.0, timeout=10.0)
    with contextlib.ExitStack() as stack:
        stack.callback(maps.release)  # whatever fails: later tests count scenes
        while len(maps._warm) < 2:
            list(maps.make(jobs))
        freezing.name = "bob"
        while freezing.frozen is None:
            made = list(maps.make(jobs))
        assert_same_maps(made, study, jobs)
        (warning,) = maps.warnings
        assert warning.startswith("worker bob did not answer for ") and "made again" in warning
        assert_same_maps(list(maps.make(jobs)), study, jobs)
        assert maps.warnings == [warning]
        freezing.frozen.send_signal(signal.SIGCONT)


def test_a_worker_frozen_alone_with_its_maps_made_ends_the_run(dask, study, jobs, freezing):
    dask.have("ann")
    maps = ClusterMaps(MapScene.of(study), dask.address, silence_timeout=3.0, timeout=1.0)
    freezing.name = "ann"
    with pytest.raises(MachineError, match=f"{dask.address}: none of 1 workers answered for"):
        list(maps.make(jobs))
    freezing.frozen.send_signal(signal.SIGCONT)
    maps.release()


def test_a_worker_frozen_before_a_search_is_told(dask, study):
    dask.have("ann")
    dask.processes["ann"].send_signal(signal.SIGSTOP)
    try:
        with pytest.raises(MachineError, match="a worker does not answer for 2 s; end it"):
            ClusterMaps(MapScene.of(study), dask.address, first_timeout=2.0)
    finally:
        dask.processes["ann"].send_signal(signal.SIGCONT)


def test_a_worker_that_hangs_alone_ends_the_run(dask, study, jobs, hanging):
    dask.have("ann")
    maps = ClusterMaps(MapScene.of(study), dask.address, silence_timeout=3.0, timeout=0.5)
    list(maps.make(jobs))
    hanging("ann")
    with pytest.raises(MachineError, match=f"{dask.address}: none of 1 workers answered for 3"):
        list(maps.make(jobs))
    maps.release()


def test_search_on_a_cluster_that_loses_a_worker_ends_as_on_one_machine(dask, study):
    dask.have("ann", "bob")
    seen = []

    def kill(progress):
        seen.append(sorted(progress.workers))
        if progress.iteration == 1:
            dask.kill("ann")
            dask.wait_for(["bob"])

    alone = place_sensors(study)
    together = place_sensors(study, cluster=dask.address, on_iteration=kill)
    assert_same_placements(alone, together)
    assert together.warnings == (lost("ann"),) and together.workers == 2
    assert seen[0] == ["ann", "bob"] and seen[-1] == ["bob"]


def test_the_command_line_writes_the_result_of_a_local_run(dask, study, tmp_path, capsys):
    dask.have("ann", "bob")
    indices = []
    for name, way in (("far", ["--cluster", dask.address]), ("near", ["--workers", "1"])):
        out = tmp_path / name
        command = ["optimize", study.path, "-o", out, "--no-pictures", *way]
        assert main([str(word) for word in command]) == 0
        indices.append(json.loads((out / "result.json").read_text()))
        error = capsys.readouterr().err
        assert ("ann" in error and "bob" in error) == (name == "far")
    far, near = indices
    assert (far.pop("run")["workers"], near.pop("run")["workers"]) == (2, 1)
    assert far == near


def test_a_worker_that_comes_later_is_given_the_scene_too(dask, study, jobs):
    dask.have("ann")
    maps = ClusterMaps(MapScene.of(study), dask.address)
    list(maps.make(jobs[:1]))
    dask.have("bob")  # and ann is gone
    made = list(maps.make(jobs))
    maps.release()
    assert_same_maps(made, study, jobs)
    assert maps.names == ("bob",) and maps.warnings == [lost("ann")]


@pytest.mark.parametrize("others", [("ann",), ()])
def test_a_later_worker_of_another_version_is_given_no_more(dask, study, jobs, others):
    dask.have("ann")
    maps = ClusterMaps(MapScene.of(study), dask.address)
    fact = r"worker old has glvis-placement 0\.0\.9, this process [\d.]+; install the same on all"
    try:
        dask.have(*others, "old")
        there = dask.client.scheduler_info(n_workers=-1)["workers"]
        (address,) = (one for one, worker in there.items() if worker["name"] == "old")
        dask.client.run(
            lambda: sys.modules["glvis.evaluation.remote"].VERSIONS.update(
                {"glvis-placement": "0.0.9"}
            ),
            workers=[address],
        )
        if not others:
            with pytest.raises(MachineError, match=fact):
                list(maps.make(jobs))
            return
        made = list(maps.make(jobs * 4))
        assert_same_maps(made, study, jobs * 4)
        (warning,) = maps.warnings
        assert re.match(fact, warning) and warning.endswith("its maps were made by others")
    finally:
        maps.release()
        dask.have("ann")


def test_threads_of_a_worker_draw_one_after_the_other(dask, study, jobs):
    dask.have()
    dask.start_worker("two", threads=2)
    maps = ClusterMaps(MapScene.of(study), dask.address)
    made = list(maps.make(jobs))
    maps.release()
    assert_same_maps(made, study, jobs)
    assert dask.client.run(lambda: os.environ["LP_NUM_THREADS"]).popitem()[1] == "0"
    (warning,) = maps.warnings
    assert warning.startswith("worker two has 2 threads and draws with one; start one worker a")


def test_scenes_that_nobody_needs_any_more_are_freed(dask, study, jobs):
    dask.have("ann")
    scene = MapScene.of(study)
    one, other = (ClusterMaps(scene, dask.address) for _ in range(2))
    for maps in (one, other):
        list(maps.make(jobs))
    assert scenes_held(dask) == {(2, 2)}
    one.release()
    assert_same_maps(list(other.make(jobs)), study, jobs)
    wait_until_held(dask, 1)
    other.release()
    wait_until_held(dask, 0)


def test_a_scene_whose_search_was_killed_is_freed_by_the_next_one(dask, study):
    dask.have("ann")
    script = (
        "import os, signal, sys\nfrom glvis.study.loading import load_study\n"
        "from glvis.search.placement import place_sensors\n"
        "place_sensors(load_study(sys.argv[1]), cluster=sys.argv[2],\n"
        "              on_iteration=lambda _: os.kill(os.getpid(), signal.SIGKILL))\n"
    )
    command = [sys.executable, "-c", script, str(study.path), dask.address]
    assert subprocess.run(command, cwd=ROOT).returncode == -signal.SIGKILL
    wait_until_held(dask, 1)
    ClusterMaps(MapScene.of(study), dask.address).release()
    wait_until_held(dask, 0)


def test_maps_that_nobody_waits_for_any_more_are_forgotten(dask, study, jobs):
    dask.have("ann")
    maps = ClusterMaps(MapScene.of(study), dask.address)
    abandoned = maps.make(jobs[::-1])
    next(abandoned)
    abandoned.close()
    made = list(maps.make(jobs))
    maps.release()
    assert_same_maps(made, study, jobs)


def test_without_workers_the_search_ends_and_can_go_on(dask, study, tmp_path, monkeypatch):
    dask.have("ann")
    hasty = partial(ClusterMaps, silence_timeout=1.0)
    monkeypatch.setattr("glvis.search.placement.ClusterMaps", hasty)
    path = tmp_path / "checkpoint.npz"
    with pytest.raises(MachineError) as error:
        place_sensors(
            study,
            cluster=dask.address,
            checkpoint=path,
            on_iteration=lambda progress: dask.kill("ann") if progress.iteration == 1 else None,
        )
    assert str(error.value).startswith(f"{dask.address}: no worker for 1")
    monkeypatch.undo()
    dask.have("bob")
    resumed = place_sensors(study, cluster=dask.address, checkpoint=path, resume=True)
    assert_same_placements(place_sensors(study), resumed)


def test_interrupted_search_comes_back_with_its_best(dask, study):
    dask.have("bob")
    placement = place_sensors(
        study,
        cluster=dask.address,
        on_iteration=lambda progress: os.kill(os.getpid(), signal.SIGINT),
    )
    assert placement.stop_reason == "interrupted: Ctrl-C"
    assert len(placement.trace) == 1 and placement.value >= placement.start_value


def test_other_versions_on_a_worker_are_refused(dask, study, monkeypatch):
    dask.have("bob")
    remote = pytest.importorskip("glvis.evaluation.remote")
    monkeypatch.setattr(remote, "VERSIONS", remote.VERSIONS | {"numpy": "0.1"})
    with pytest.raises(MachineError, match=r"worker bob has numpy [\d.]+, this process 0\.1; ins"):
        ClusterMaps(MapScene.of(study), dask.address)


def test_a_scheduler_or_worker_without_glvis_is_refused(dask, study, monkeypatch):
    dask.have("bob")
    versions = distributed.Client.get_versions

    async def without(client, **options):
        found = await versions(client, **options)
        found["scheduler"]["packages"]["glvis-placement"] = None
        return found

    monkeypatch.setattr(distributed.Client, "get_versions", without)
    with pytest.raises(MachineError, match="the scheduler has glvis-placement not at all, this p"):
        ClusterMaps(MapScene.of(study), dask.address)


def test_dask_knows_the_package_by_the_name_that_versions_are_asked_by():
    """Asked by another name it answers None for everybody, and None equals None."""
    remote = pytest.importorskip("glvis.evaluation.remote")
    project = tomllib.loads((Path(ROOT) / "pyproject.toml").read_text())["project"]
    assert project["name"] == remote.DISTRIBUTION


def test_error_on_a_worker_is_raised_here(dask, study, jobs):
    dask.have("bob")
    maps = ClusterMaps(MapScene.of(study), dask.address)
    with pytest.raises(IndexError, match="tuple index out of range"):
        list(maps.make([MapJob(7, jobs[0].camera_to_world)]))
    maps.release()


@pytest.mark.parametrize(
    ("error", "fact"),
    [
        (
            distributed.KilledWorker("draw", SimpleNamespace(address="tcp://b"), 3),
            "4 workers died over the same maps, the last was tcp://b; its log may say why",
        ),
        (ModuleNotFoundError("No module named 'glvis'"), r"a worker cannot load glvis \(No module"),
        (TimeoutError(), "none of 1 workers answered for .* s; start some by: dask worker"),
    ],
)
def test_answers_that_do_not_come_end_the_run(dask, study, jobs, monkeypatch, error, fact):
    dask.have("bob")
    maps = ClusterMaps(MapScene.of(study), dask.address)
    sync = maps._client.sync

    def without_answers(function, *args, **options):
        if getattr(function, "func", None) == maps._client.gather:
            raise error
        return sync(function, *args, **options)

    with monkeypatch.context() as patch, pytest.raises(MachineError, match=fact):
        patch.setattr(maps._client, "sync", without_answers)
        list(maps.make(jobs))
    maps.release()


def test_cluster_without_workers_is_not_waited_for_long(dask, study, monkeypatch):
    dask.have()
    with pytest.raises(MachineError, match=r"no worker for .* s; start some by: dask worker tcp"):
        ClusterMaps(MapScene.of(study), dask.address, first_timeout=0.1)


def test_lost_scheduler_ends_the_run(tmp_path, study, jobs, monkeypatch):
    monkeypatch.setattr("glvis.evaluation.cluster._TO_CONNECT", 3.0)  # and to connect again
    own = DaskProcesses(tmp_path)
    try:
        own.start_scheduler()
        own.have("ann")
        maps = ClusterMaps(MapScene.of(study), own.address)
        own.kill("scheduler")
        with pytest.raises(MachineError, match=f"the dask scheduler at {own.address} was lost$"):
            list(maps.make(jobs))
        maps.release()
    finally:
        own.close()


def test_unreachable_scheduler_is_named(study):
    address = f"tcp://127.0.0.1:{free_port()}"
    with pytest.raises(MachineError, match=f"no dask scheduler answers at {address}: "):
        ClusterMaps(MapScene.of(study), address, first_timeout=0.2)


@pytest.mark.parametrize("address", ["scheduler", "scheduler:8786", "http://a:1", "tcp://a"])
def test_what_is_no_address_is_refused(study, address):
    with pytest.raises(StudyError, match=f"cluster = '{address}' must be the address of a dask"):
        place_sensors(study, cluster=address)


def test_workers_here_and_a_cluster_do_not_go_together(study, tmp_path, capsys):
    with pytest.raises(ValueError, match="workers are processes here, cluster has its own"):
        place_sensors(study, workers=2, cluster="tcp://127.0.0.1:1")
    out = tmp_path / "out"
    command = [
        "optimize",
        str(study.path),
        "-o",
        str(out),
        "--workers",
        "2",
        "--cluster",
        "tcp://a",
    ]
    assert main(command) == 2
    assert "--workers are processes here, --cluster has its own" in capsys.readouterr().err
    assert not out.exists()


def test_missing_package_is_one_line_and_leaves_nothing(study, tmp_path, monkeypatch, capsys):
    monkeypatch.setitem(sys.modules, "distributed", None)
    out = tmp_path / "out"
    code = main(["optimize", str(study.path), "-o", str(out), "--cluster", "tcp://127.0.0.1:1"])
    told = capsys.readouterr().err.splitlines()
    (error,) = [line for line in told if not line.startswith("Warning: ")]  # of the study's angles
    assert code == 1
    assert error.startswith("error: a cluster needs dask.distributed (")
    assert '; install it by: pip install ".[cluster]" in the checkout' in error
    assert not out.exists()


def test_nothing_of_dask_is_imported_without_a_cluster(study, tmp_path):
    script = (
        "import sys\nfrom glvis.cli.app import main\n"
        "assert main(sys.argv[1:]) == 0\n"
        "print(sorted({name.partition('.')[0] for name in sys.modules}))\n"
    )
    command = ["optimize", study.path, "-o", tmp_path / "out", "--workers", "2", "--no-pictures"]
    done = subprocess.run(
        [sys.executable, "-c", script, *map(str, command)],
        cwd=ROOT,
        capture_output=True,
        text=True,
        check=True,
    )
    imported = set(done.stdout.splitlines()[-1].split("'"))
    assert "glvis" in imported
    assert not {"dask", "distributed", "tornado"} & imported
