#!/usr/bin/env python3
"""Measures what dask costs: bytes and CPU time of a task, bytes of the scene, and when it pays.

    .venv/bin/python tools/bench_cluster.py [STUDY] [--rounds 7]

Starts a scheduler and two workers on this machine, makes the same maps there and in this process,
in tasks of one pose and of many, and prints medians over the rounds. Bytes are counted at the
workers' sockets. Times are CPU times, which a busy machine changes little; only the round trip,
an idle cluster's answer to one task, is by the clock.
"""

import argparse
import socket
import subprocess
import sys
import tempfile
import time

import distributed
import numpy as np
import psutil  # comes with distributed

from glvis.evaluation import cluster
from glvis.evaluation.cluster import ClusterMaps
from glvis.study.loading import load_study
from glvis.visibility.maps import LocalMaps, MapJob, MapScene

MANY = cluster._MOST_ON_CPU  # poses a task, where there are many


def bytes_moved():
    """Return the bytes that this process received and sent since the first call; for workers."""
    from tornado.iostream import IOStream

    def counted(place, function):
        def replacement(self, data):
            n = function(self, data)
            IOStream.counts[place] += n or 0
            return n

        return replacement

    if not hasattr(IOStream, "counts"):
        IOStream.counts = [0, 0]
        IOStream.read_from_fd = counted(0, IOStream.read_from_fd)
        IOStream.write_to_fd = counted(1, IOStream.write_to_fd)
    return list(IOStream.counts)


def measure(study, address, processes, rounds):
    """Make the same maps on the cluster and here, and print what the difference costs."""

    def moved():  # received and sent by the workers together, (2,)
        return np.sum(list(client.run(bytes_moved).values()), axis=0)

    def cpu():  # seconds of this process, the scheduler, the workers, (3,)
        used = [sum(psutil.Process(process.pid).cpu_times()[:2]) for process in processes]
        return np.array([time.process_time(), used[0], sum(used[1:])])

    scene = MapScene.of(study)
    low, high = study.rig.bounds.T
    positions = np.random.default_rng(1).uniform(low, high, (MANY, len(low)))
    poses = study.rig.poses(positions)[:, 0]
    jobs = [MapJob(0, poses)]
    trips, seconds, sent, here = [], [], [], []
    with distributed.Client(address, set_as_default=False) as client:
        client.wait_for_workers(2, timeout=120)
        before = moved()
        maps, local = ClusterMaps(scene, address), LocalMaps(scene)
        scene_bytes = (moved() - before)[0] / 2
        for far, near in zip(maps.make(jobs), local.make(jobs), strict=True):
            assert np.array_equal(far, near), "the cluster's maps differ"
        for _ in range(rounds):
            began = time.perf_counter()
            list(maps.make([MapJob(0, poses[:1])]))
            trips.append(time.perf_counter() - began)
            for size in (1, MANY):
                maps._least = cluster._MOST_ON_CPU = cluster._MOST_ON_GPU = size
                bytes_before, before = moved(), cpu()
                list(maps.make(jobs))
                seconds.append(cpu() - before)
                sent.append(moved() - bytes_before)
                before = time.process_time()
                list(local.make([part for job in jobs for part in job.parts(size)]))
                here.append(time.process_time() - before)
        maps.release()
    # per pose, looked at on all models; axis 0: in tasks of one pose, of many
    seconds, sent, here = (
        np.median(np.reshape(of, (rounds, 2, -1)), axis=0) / MANY for of in (seconds, sent, here)
    )
    a_pose, n_models = here[1, 0], len(scene.models)
    # what a task costs beyond its maps: n tasks against n / MANY; drawing one by one costs too
    mine, scheduler, worker = (seconds[0] - seconds[1] - [0, 0, here[0, 0] - a_pose]) / (
        1 - 1 / MANY
    )
    share, feeds = worker / (worker + MANY * a_pose), MANY * a_pose / max(mine, scheduler)
    trip = np.median(trips)
    maps_a_trip = trip / a_pose * n_models
    ms = [f"{1e3 * cost:.2f}" for cost in (mine, scheduler, worker, a_pose)]
    for name, text in {
        "study": f"{study.path.name}, {n_models} models, {maps.gl.renderer}",
        "scene": f"{scene_bytes:,.0f} bytes to a worker, once",
        "task of 1 pose": "{:,.0f} bytes there, {:,.0f} back".format(*sent[0]),
        f"task of {MANY} poses": "{:,.0f} bytes there, {:,.0f} back".format(*sent[1] * MANY),
        "overhead a task": "ms: here {}, scheduler {}, worker {}; a pose {}".format(*ms),
        f"{MANY} poses a task": f"{share:.1%} of a worker's time is dask's; {feeds:.0f} can be fed",
        "round trip": f"{1e3 * trip:.1f} ms by the clock: {maps_a_trip:.0f} maps",
        "pays from": f"{maps_a_trip:.0f} CW/(W-C) maps an iteration: W workers for C cores",
    }.items():
        print(f"{name:<20}{text}")


def main():
    """Start the cluster, measure, end it."""
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("study", nargs="?", default="scenes/arm.toml")
    parser.add_argument("--rounds", type=int, default=7)
    arguments = parser.parse_args()
    with socket.socket() as one:
        one.bind(("127.0.0.1", 0))
        port = str(one.getsockname()[1])
    scheduler = ["distributed.cli.dask_scheduler", "--host", "127.0.0.1", "--port", port]
    address = f"tcp://127.0.0.1:{port}"
    worker = ["distributed.cli.dask_worker", address, "--nthreads", "1", "--no-nanny"]
    quiet = {"stdout": subprocess.DEVNULL, "stderr": subprocess.DEVNULL}
    with tempfile.TemporaryDirectory() as folder:
        processes = [
            subprocess.Popen([sys.executable, "-m", *it, "--no-dashboard"], cwd=folder, **quiet)
            for it in (scheduler, worker, worker)
        ]
        try:
            measure(load_study(arguments.study), address, processes, arguments.rounds)
        finally:
            for process in processes:
                process.kill()
                process.wait()


if __name__ == "__main__":
    main()
