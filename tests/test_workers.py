"""Maps from other processes: the same to the last bit, whatever happens to the processes."""

import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import pytest
from support.ball_and_ring import write_ball_and_ring
from support.equal_results import assert_same_maps, some_jobs

import glvis.evaluation.workers
from glvis.errors import MachineError
from glvis.evaluation.evaluator import Evaluator
from glvis.evaluation.jobs import job_timeout, share_out
from glvis.evaluation.workers import Workers, available_cores
from glvis.search.placement import place_sensors
from glvis.study.loading import load_study
from glvis.visibility.maps import MapJob, MapScene


@pytest.fixture
def study(tmp_path, rng):
    return load_study(write_ball_and_ring(tmp_path, rng))


@pytest.fixture
def positions(study, rng):
    low, high = study.rig.bounds.T
    return rng.uniform(low, high, size=(40, len(low)))


@pytest.fixture
def jobs(study, rng):
    return some_jobs(study, rng)


def processes(workers):
    return [worker.process for worker in workers._crew]


@pytest.mark.parametrize("n", [1, 3])
def test_workers_make_the_maps_that_this_process_makes(study, jobs, n):
    workers = Workers(MapScene.of(study), n)
    made = list(workers.make(jobs))
    crew = processes(workers)
    workers.release()
    assert_same_maps(made, study, jobs)
    assert workers.workers == n and workers.warnings == []
    assert len(crew) == n and all(process.returncode == 0 for process in crew)


def test_values_do_not_depend_on_workers_or_on_how_positions_are_put_together(study, positions):
    with Evaluator(study) as alone:
        expected = alone.values_by_model(positions)
    with Evaluator(study, maps=Workers(MapScene.of(study), 2)) as evaluator:
        values = evaluator.values_by_model(positions)
        assert evaluator.gl == alone.gl
        assert evaluator.maps_rendered == alone.maps_rendered == 2 * 2 * len(positions)
    assert np.array_equal(values, expected)
    with Evaluator(study) as interrupted:
        next(interrupted.each(positions))
        assert interrupted.maps_rendered == 2 * 2  # what nobody has waited for is not counted
    for size in (1, 3, 16):
        with Evaluator(study) as evaluator:
            parts = [
                evaluator.values_by_model(positions[first : first + size])
                for first in range(0, len(positions), size)
            ]
        assert np.array_equal(np.concatenate(parts), expected)


def test_search_finds_the_same_with_any_number_of_workers(study):
    alone, together = place_sensors(study), place_sensors(study, workers=2)
    assert together.workers == 2 and together.warnings == ()
    assert np.array_equal(alone.position, together.position)
    assert alone.value == together.value and alone.maps_rendered == together.maps_rendered
    assert [row[:-1] for row in alone.trace] == [row[:-1] for row in together.trace]
    for one, other in zip(alone.maps, together.maps, strict=True):
        assert np.array_equal(one.visible, other.visible)


def test_jobs_are_shared_out_whole_in_parts_that_become_smaller(jobs):
    for workers, least, most in ((1, 2, 1000), (2, 1, 10), (3, 4, 8)):
        parts, spans = share_out(jobs, workers, least, most)
        for job, (begin, end) in zip(jobs, spans, strict=True):
            mine = parts[begin:end]
            assert {part.sensor for part in mine} == {job.sensor}
            poses = np.concatenate([part.camera_to_world for part in mine])
            assert np.array_equal(poses, job.camera_to_world)
        sizes = [len(part) for part in parts]
        assert max(sizes) <= most and max(sizes[-workers:]) <= least
        inner = [size for begin, end in spans for size in sizes[begin : end - 1]]
        assert inner == sorted(inner, reverse=True) and min(inner) >= least


def test_few_poses_are_shared_out_evenly(jobs):
    for n, expected in ((6, [3, 3]), (11, [6, 5]), (1, [1]), (16, [8, 8])):
        parts, _ = share_out([jobs[0][:n]], 2, 1, 32)
        assert [len(part) for part in parts] == expected


def killed(process):
    """Kill a worker, and return when it is dead: a busy machine takes its time."""
    process.kill()
    process.wait(60)


def test_worker_that_is_killed_is_replaced_and_nothing_is_lost(study, jobs):
    workers = Workers(MapScene.of(study), 2)
    made = []
    for bits in workers.make(jobs):
        if not made:
            killed(processes(workers)[0])
        made.append(bits)
    assert_same_maps(made, study, jobs)
    made = list(workers.make(jobs))
    workers.release()
    assert_same_maps(made, study, jobs)
    assert workers.warnings == [
        "worker 1 died (SIGKILL) and was replaced; its maps were made again"
    ]


def test_worker_that_hangs_is_replaced_and_nothing_is_lost(study, jobs):
    workers = Workers(MapScene.of(study), 2, timeout=1.0)
    while not all(worker.is_ready for worker in workers._crew):
        workers._listen(glvis.evaluation.workers._Call())
    frozen = processes(workers)[1]
    os.kill(frozen.pid, signal.SIGSTOP)
    made = list(workers.make(jobs))
    workers.release()
    assert_same_maps(made, study, jobs)
    (warning,) = workers.warnings
    assert warning.startswith("worker 2 did not answer for ")
    assert frozen.returncode == -signal.SIGKILL


@pytest.mark.parametrize(
    ("poses", "slowest", "seconds"),
    [
        (32, 0.0, 300.0),  # nothing is known yet
        (32, 0.001, 60.0),
        (32, 0.1, 20 * 3.2),  # twenty times the longest job, pose for pose
        (4, 0.1, 60.0),
        (128, 1.0, 540.0),
    ],
)
def test_timeout_is_a_multiple_of_the_longest_job_within_limits(poses, slowest, seconds):
    assert job_timeout(poses, slowest) == pytest.approx(seconds)


def test_warning_of_a_replaced_worker_is_part_of_the_result(study, monkeypatch):
    crews = []
    monkeypatch.setattr(
        "glvis.search.placement.Workers", lambda *args: crews.append(Workers(*args)) or crews[0]
    )

    def kill(progress):
        if progress.iteration == 1:
            killed(processes(crews[0])[0])

    alone, together = place_sensors(study), place_sensors(study, workers=2, on_iteration=kill)
    assert together.warnings == (
        "worker 1 died (SIGKILL) and was replaced; its maps were made again",
    )
    assert [row[:-1] for row in alone.trace] == [row[:-1] for row in together.trace]


def test_maps_that_kill_every_worker_end_the_run(study, jobs, monkeypatch):
    give = glvis.evaluation.workers._Worker.give

    def deadly(self, tag, job):
        give(self, tag, job)
        self.process.kill()

    monkeypatch.setattr(glvis.evaluation.workers._Worker, "give", deadly)
    workers = Workers(MapScene.of(study), 1)
    with pytest.raises(MachineError, match=r"worker 1 died \(SIGKILL\), as others before over the"):
        list(workers.make(jobs[:1]))
    workers.release()


def test_workers_that_die_at_their_start_end_the_run(study, monkeypatch):
    monkeypatch.setattr("glvis.evaluation.workers.sys.executable", "/bin/false")
    with pytest.raises(
        MachineError, match=r"worker 1 died \(exit code 1\) at its start, as others"
    ):
        Workers(MapScene.of(study), 1)


def test_worker_without_opengl_says_so(study, monkeypatch):
    monkeypatch.setenv("GLVIS_GL", "vulkan")
    with pytest.raises(MachineError, match="GLVIS_GL = 'vulkan' must be one of egl, osmesa"):
        Workers(MapScene.of(study), 1)


def test_error_in_a_worker_is_raised_here(study):
    workers = Workers(MapScene.of(study), 1)
    with pytest.raises(IndexError, match="tuple index out of range"):
        list(workers.make([MapJob(7, study.rig.poses(study.rig.start)[:1])]))
    workers.release()


def test_fewer_than_one_worker_is_refused(study):
    with pytest.raises(ValueError, match="workers = 0 must be at least 1"):
        place_sensors(study, workers=0)


def test_maps_that_nobody_waits_for_any_more_are_forgotten(study, jobs):
    workers = Workers(MapScene.of(study), 2)
    abandoned = workers.make(jobs[::-1])
    next(abandoned)
    abandoned.close()
    made = list(workers.make(jobs))
    workers.release()
    assert_same_maps(made, study, jobs)


def test_workers_end_with_the_process_that_started_them(study):
    script = (
        "import sys, time\n"
        "from glvis.visibility.maps import MapScene\nfrom glvis.study.loading import load_study\n"
        "from glvis.evaluation.workers import Workers\n"
        "workers = Workers(MapScene.of(load_study(sys.argv[1])), 1)\n"
        "print(workers._crew[0].process.pid, flush=True)\n"
        "time.sleep(60)\n"
    )
    root = Path(glvis.evaluation.workers.__file__).parents[1]
    parent = subprocess.Popen(
        [sys.executable, "-c", script, str(study.path)], stdout=subprocess.PIPE, cwd=root
    )
    with parent:
        worker = int(parent.stdout.readline())
        os.kill(worker, 0)
        parent.kill()
    for _ in range(200):
        if not is_running(worker):
            return
        time.sleep(0.05)
    pytest.fail(f"worker {worker} goes on")


def is_running(pid):
    try:
        state = Path(f"/proc/{pid}/stat").read_text().rsplit(")", 1)[1].split()[0]
    except OSError:
        return False
    return state != "Z"


def test_workers_leave_the_threads_to_the_user(study, monkeypatch):
    monkeypatch.setenv("LP_NUM_THREADS", "1")
    monkeypatch.delenv("OPENBLAS_NUM_THREADS", raising=False)
    workers = Workers(MapScene.of(study), 1)
    environ = Path(f"/proc/{processes(workers)[0].pid}/environ").read_bytes().split(b"\0")
    workers.release()
    assert b"LP_NUM_THREADS=1" in environ and b"OPENBLAS_NUM_THREADS=1" in environ


def test_cores_are_those_that_the_process_may_use(monkeypatch):
    allowed = len(os.sched_getaffinity(0))
    assert 1 <= available_cores() <= allowed
    monkeypatch.setattr("glvis.evaluation.workers._cgroup_limit", lambda: "max 100000")
    assert available_cores() == allowed
    monkeypatch.setattr("glvis.evaluation.workers._cgroup_limit", lambda: "150000 100000")
    assert available_cores() == 1
