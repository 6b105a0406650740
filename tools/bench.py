#!/usr/bin/env python3
"""Measures glvis against Embree: maps a second, accuracy, memory; everything in one run.

The rival is what a user would write today: embreex, one thread, and NumPy filters before the
rays. Both sides take turns within the same minutes, and what is printed are medians and ratios
of neighbours in time, because the machines this runs on are shared.

    tools/bench.py                  # all of it, about nine minutes on two cores
    tools/bench.py --only arms      # one part of: arms, kitchen, room, lenses, split, sweep, move,
                                 # sizes, processes, workers, memory
    tools/bench.py -o out/bench     # where bench.json and bench.png go

It needs the ``bench`` extra (embreex). Real arms are read from ``../shared/data`` where that
lies beside the checkout, else the arms in ``scenes/`` are taken; the output says which.
"""

from __future__ import annotations

import argparse
import itertools
import json
import os
import resource
import subprocess
import sys
import time
from pathlib import Path

# One core each: neither the rasteriser nor linear algebra shall start threads of their own.
os.environ.setdefault("LP_NUM_THREADS", "0")
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

try:
    import numpy as np
except ImportError:
    sys.exit("bench: NumPy is missing; run tools/test once, then .venv/bin/python tools/bench.py")

from measuring import (
    HERE,
    SHARED,
    Embree,
    Profile,
    against,
    agreement,
    arm_study,
    ball_views,
    dented_ball,
    device,
    maker_of,
    scratch,
    taking_turns,
)

PARTS = (
    *("arms", "kitchen", "room", "lenses", "split", "sweep", "move", "sizes"),
    *("processes", "workers", "memory"),
)


def bench_arms(repeats: int) -> dict:
    """Time 48 maps, one evaluation: both criteria at "auto", beside Embree's centroid rays."""
    from glvis import Evaluator

    nothing = np.zeros((1, 0))
    studies = {name: arm_study(name) for name in ("pixels", "centroid")}
    evaluators = {name: Evaluator(study, cache_bytes=0) for name, study in studies.items()}
    models, sensor = studies["pixels"].models, studies["pixels"].sensors[0]
    poses = studies["pixels"].rig.poses(nothing)[0]
    rivals = [Embree(model) for model in models]

    def embree():
        return [np.stack([rival.centroids(pose, sensor) for pose in poses]) for rival in rivals]

    seconds = taking_turns(
        {"Embree, centroid rays": embree}
        | {
            f"glvis, {name}": lambda evaluator=evaluator: evaluator(nothing)
            for name, evaluator in evaluators.items()
        },
        repeats,
    )
    rows = against(seconds, "Embree, centroid rays")
    truth = embree()
    maps = {name: e.visibility_of_poses(poses) for name, e in evaluators.items()}
    for row, name in zip(rows[1:], maps, strict=True):
        row["iou_with_centroid_rays"] = agreement(
            np.concatenate([m.visible.ravel() for m in maps[name]]),
            np.concatenate([t.ravel() for t in truth]),
        )
    accuracy = []
    for name in maps:
        for model, rival, exact, ours in zip(models, rivals, truth, maps[name], strict=True):
            share = np.stack([rival.share(pose, sensor) for pose in poses])
            half = share >= 0.5
            seen = ours.visible
            accuracy.append(
                {
                    "criterion": name,
                    "model": model.name,
                    "wrong_percent": 100 * float((seen & (share == 0) & ~exact).sum() / seen.sum()),
                    "missed_percent": 100 * float((half & ~seen).sum() / half.sum()),
                    "iou": agreement(seen, exact),
                }
            )
    for evaluator in evaluators.values():
        evaluator.release()
    source = "shared/data" if (SHARED / "arms").is_dir() else "scenes"
    return {"models": f"six arms of {source}", "maps": 48, "times": rows, "accuracy": accuracy}


def bench_kitchen(repeats: int) -> dict:
    """Time maps of a room of large faces; count what they miss of 64 rays to points of a face."""
    from casestudies import case_study

    from glvis import Evaluator
    from glvis.search.box import Box

    data = SHARED if (SHARED / "kitchen").is_dir() else None
    ways = {
        "pixels": ["visibility.resolution=auto"],
        "pixels, sensor's": ["visibility.resolution=sensor"],
        "centroid": ["visibility.criterion=centroid"],
    }
    studies = {name: case_study("kitchen-4", data, settings) for name, settings in ways.items()}
    evaluators = {name: Evaluator(study, cache_bytes=0) for name, study in studies.items()}
    study = studies["pixels"]
    (model,), sensor = study.models, study.sensors[0]
    positions = Box(study.rig.bounds).uniform(8, np.random.default_rng(1))
    poses = study.rig.poses(positions).reshape(-1, 4, 4)
    rival = Embree(model)

    def maps_by(name):
        return np.concatenate([m.visible for (m,) in evaluators[name].each_visibility(positions)])

    def centroids():
        return np.stack([rival.centroids(pose, sensor) for pose in poses])

    seconds = taking_turns(
        {
            "Embree, centroid rays": centroids,
            "Embree, sweep": lambda: [rival.sweep(p, sensor, sensor.resolution) for p in poses],
        }
        | {f"glvis, {name}": lambda name=name: maps_by(name) for name in ways},
        repeats,
    )
    share = np.stack([rival.share(pose, sensor) for pose in poses])
    exact = centroids()
    accuracy = []
    for name in ways:
        seen = maps_by(name)
        any_shows, half_shows = share > 0, share >= 0.5
        accuracy.append(
            {
                "way": name,
                # by a pixel that meets it beside the 64 points
                "seen_between_points_percent": 100
                * float((seen & ~any_shows & ~exact).sum())
                / float(seen.sum()),
                "missed_percent": 100 * float((half_shows & ~seen).sum() / half_shows.sum()),
                "missed_of_any_percent": 100 * float((any_shows & ~seen).sum() / any_shows.sum()),
                "iou_with_centroid_rays": agreement(seen, exact),
            }
        )
        evaluators[name].release()
    source = "shared/data" if data else "scenes"
    return {
        "model": f"kitchen of {source}",
        "maps": len(poses),
        "times": against(seconds, "Embree, centroid rays"),
        "accuracy": accuracy,
    }


def bench_room(repeats: int) -> dict:
    """Hold areas seen in a room of 252 faces, cut or not, against rays to a 2 cm grid of points."""
    sys.path.insert(0, str(HERE / "tests"))
    from support import rooms

    from glvis import Evaluator, load_study, place_sensors

    ways = {
        "pixels": ("pixels", []),
        "pixels, sensor's": ("pixels", ["visibility.resolution=sensor"]),
        "centroid": ("centroid", []),
    }
    rows = []
    for (name, (criterion, settings)), max_edge in itertools.product(ways.items(), ("auto", "off")):
        path = rooms.write_room_study(scratch(), f'max_edge = "{max_edge}"', criterion)
        study = load_study(path, settings)
        (model,), rig = study.models, study.rig
        low, high = rig.bounds.T
        poses = rig.poses(np.random.default_rng(7).uniform(low, high, (10, len(low))))
        truth = [100 * rooms.true_area_share(some) for some in poses]

        def area(found, model=model):
            return 100 * float(model.areas[found.counts > 0].sum() / model.areas.sum())

        with Evaluator(study, cache_bytes=0) as evaluator:
            seen = [area(evaluator.visibility_of_poses(some)[0]) for some in poses]
            seconds = []
            for _ in range(repeats):
                started = time.perf_counter()
                for some in poses:
                    evaluator.visibility_of_poses(some)
                seconds.append((time.perf_counter() - started) / (len(poses) * len(study.sensors)))
        best = place_sensors(study, workers=2)
        rows.append(
            {
                "way": name,
                "max_edge": max_edge,
                "pieces": model.n_faces,
                "ms_a_map": 1000 * float(np.median(seconds)),
                "ten_layouts_off_by_at_most": float(np.abs(np.subtract(seen, truth)).max()),
                "found_area_percent": area(best.maps[0]),
                "found_by_rays_percent": 100 * rooms.true_area_share(best.camera_to_world),
            }
        )
    return {"rows": rows}


def bench_lenses(repeats: int) -> dict:
    """Time maps of other lenses and of two viewpoints, beside a pinhole's from the same poses."""
    from dataclasses import replace

    from glvis.problem.calibrated_lens import FisheyeLens, OpenCVLens
    from glvis.problem.lens import SphericalLens
    from glvis.problem.sensor import Partner
    from glvis.visibility.maps import LocalMaps, MapJob, MapScene

    study = arm_study("pixels")
    poses = study.rig.poses(np.zeros((1, 0)))[0]
    pinhole = study.sensors[0]
    width, height = pinhole.resolution
    tan_x = float(pinhole.lens.tan_half[0])
    k1 = -0.1  # barrel; the focal length is such that the field across is that of the pinhole
    focal = width / 2 / (tan_x * (1 + k1 * tan_x**2))
    middle = (width - 1) / 2, (height - 1) / 2
    half_turn = width / np.pi
    sensors = {
        "pinhole": pinhole,
        "opencv": replace(
            pinhole, lens=OpenCVLens((width, height), (focal, focal), middle, (k1, 0, 0, 0))
        ),
        "fisheye, 180 deg": replace(
            pinhole,
            lens=FisheyeLens((width, width), (half_turn, half_turn), (middle[0],) * 2, ()),
            distance="range",
        ),
        "spherical, 360 x 30 deg": replace(
            pinhole,
            lens=SphericalLens(2 * np.pi, (-np.pi / 12, np.pi / 12)),
            distance="range",
        ),
        "pair, 55 mm apart": replace(pinhole, partner=Partner((55.0, 0.0, 0.0), pinhole.lens)),
    }
    rows = []
    for criterion in ("pixels", "centroid"):
        options = replace(study.visibility, criterion=criterion)
        maps = LocalMaps(MapScene(study.models, (), tuple(sensors.values()), options))
        jobs = {name: MapJob(number, poses) for number, name in enumerate(sensors)}
        ways = {
            name: lambda job=job, maps=maps: list(maps.make([job])) for name, job in jobs.items()
        }
        for row in against(taking_turns(ways, repeats), "pinhole"):
            (bits,) = maps.make([jobs[row["way"]]])
            rows.append(
                {"criterion": criterion, **row, "faces_seen": int(np.unpackbits(bits).sum())}
            )
        maps.release()
    return {"models": "six arms", "maps": len(poses) * len(study.models), "times": rows}


def bench_split(repeats: int) -> dict:
    """Part the time of the 48 maps: each step waits for the driver, so the sum is a bit more."""
    from glvis import Evaluator

    rows = []
    nothing = np.zeros((1, 0))
    for criterion in ("pixels", "centroid"):
        with Evaluator(arm_study(criterion), cache_bytes=0) as evaluator:
            evaluator(nothing)
            with Profile() as profile:
                for _ in range(repeats):
                    evaluator(nothing)
        rows += [
            {"criterion": criterion, "step": step, "ms": 1e3 * seconds / repeats}
            for step, seconds in profile.seconds.items()
        ]
    return {"rows": rows}


def bench_sweep(repeats: int) -> dict:
    """Time the sensor's own 1280 x 720 pixels, beside Embree's ray through each of them."""
    study = arm_study("pixels", '"sensor"')
    poses, sensor = study.rig.poses(np.zeros((1, 0)))[0], study.sensors[0]
    rival = Embree(study.models[1])
    visible = maker_of(study.models[1], sensor, study.visibility)

    def glvis():
        return visible(poses)

    def embree():
        return np.stack([rival.sweep(pose, sensor, sensor.resolution) for pose in poses])

    seconds = taking_turns({"Embree, sweep": embree, "glvis, pixels": glvis}, min(repeats, 2))
    rows = against(seconds, "Embree, sweep")
    rows[1]["iou_with_sweep"] = agreement(glvis(), embree())
    return {"model": study.models[1].name, "maps": len(poses), "times": rows}


def bench_move(repeats: int) -> dict:
    """Time an evaluation in which one of eight sensors has moved, beside a whole one."""
    from glvis import Evaluator

    study = arm_study("pixels")
    start = study.rig.poses(np.zeros((1, 0)))[0]
    rng = np.random.default_rng(1)
    with Evaluator(study) as evaluator:

        def moved(sensors):
            poses = start.copy()
            poses[sensors, :3, 3] += rng.normal(scale=0.01, size=(len(sensors), 3))
            return evaluator.visibility_of_poses(poses)

        seconds = taking_turns(
            {"all eight moved": lambda: moved(list(range(8))), "one moved": lambda: moved([3])},
            2 * repeats,
        )
    return {"times": against(seconds, "all eight moved")}


def bench_sizes(repeats: int) -> dict:
    """Time a map and peak memory by number of faces, each size in a process of its own."""
    rows = []
    for n_faces, times in ((10_000, 5), (100_000, 5), (900_000, 3), (4_000_000, 1)):
        command = [sys.executable, __file__, "--one-size", str(n_faces), "--repeats", str(times)]
        done = subprocess.run(command, capture_output=True, text=True, check=False)
        if done.returncode:
            sys.exit(f"bench: {n_faces} faces failed: {done.stderr.strip().splitlines()[-1]}")
        rows.append(json.loads(done.stdout.splitlines()[-1]))
    return {"rows": rows}


def one_size(n_faces: int, repeats: int) -> dict:
    """Measure one generated mesh; runs in its own process so that memory is its own."""
    from glvis.problem.visibility_options import VisibilityOptions
    from glvis.visibility.clusters import Clusters

    model = dented_ball(n_faces)
    path = scratch() / f"{model.name}.stl"
    write_stl(path, model)
    made = peak_mib()
    poses, sensor = ball_views(4)
    row = {"faces": model.n_faces}
    ways = {}
    for name in ("pixels", "centroid"):
        start = time.perf_counter()
        visible = maker_of(model, sensor, VisibilityOptions(criterion=name))
        visible(poses[:1])
        row[f"{name}_first_seconds"] = time.perf_counter() - start
        ways[name] = lambda visible=visible: visible(poses)
    row["clusters"] = len(Clusters.of(model))
    with_rival = n_faces <= 1_000_000
    row["peak_mib"] = peak_mib()
    if with_rival:
        rival = Embree(model)
        row["embree_build_seconds"] = rival.build_seconds

        def embree():
            return np.stack([rival.centroids(pose, sensor) for pose in poses])

        ways["embree"] = embree
    seconds = taking_turns(ways, repeats)
    for name, values in seconds.items():
        row[f"{name}_ms_a_map"] = 1e3 * float(np.median(values)) / len(poses)
    if with_rival:
        theirs = embree()
        for name in ("pixels", "centroid"):
            ratio = np.array(seconds["embree"]) / np.array(seconds[name])
            row[f"{name}_times_faster"] = float(np.median(ratio))
            row[f"{name}_iou"] = agreement(ways[name](), theirs)
    row["peak_before_glvis_mib"] = made
    return row | load_size(path)


def load_size(path: Path) -> dict:
    """Return seconds and peak memory of reading a mesh and one map, in a fresh process."""
    code = (
        "import sys, time, resource, numpy as np\n"
        "from glvis.problem.scene import load_model\n"
        "from glvis.problem.visibility_options import VisibilityOptions\n"
        f"sys.path.insert(0, {str(Path(__file__).parent)!r})\n"
        "import measuring\n"
        "start = time.perf_counter()\n"
        "model = load_model(sys.argv[1]); read = time.perf_counter() - start\n"
        "poses, sensor = measuring.ball_views(1)\n"
        "options = VisibilityOptions(criterion='centroid')\n"
        "measuring.maker_of(model, sensor, options)(poses)\n"
        "print(read, resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024)\n"
    )
    done = subprocess.run(
        [sys.executable, "-c", code, str(path)], capture_output=True, text=True, check=False
    )
    path.unlink()
    if done.returncode:
        sys.exit(f"bench: reading {path.name} failed: {done.stderr.strip().splitlines()[-1]}")
    seconds, peak = map(float, done.stdout.split())
    return {"read_seconds": seconds, "read_and_map_peak_mib": peak}


def write_stl(path: Path, model) -> None:
    """Write a binary STL."""
    record = np.zeros(
        model.n_faces, dtype=[("normal", "<f4", 3), ("corners", "<f4", (3, 3)), ("pad", "<u2")]
    )
    record["corners"] = model.vertices[model.faces]
    with path.open("wb") as file:
        file.write(b"glvis bench".ljust(80) + np.uint32(model.n_faces).tobytes())
        record.tofile(file)


def bench_processes(repeats: int) -> dict:
    """Count maps a second of one process, and of two at a time."""
    code = [sys.executable, __file__, "--count-maps"]

    def rate(n: int) -> float:
        running = [subprocess.Popen(code, stdout=subprocess.PIPE, text=True) for _ in range(n)]
        return sum(float(process.communicate()[0]) for process in running)

    rates = [(rate(1), rate(2)) for _ in range(2 if repeats > 2 else 1)]
    one, two = np.median(rates, axis=0)
    return {
        "maps_a_second_one": float(one),
        "maps_a_second_two": float(two),
        "ratio": float(np.median([b / a for a, b in rates])),
    }


def bench_workers(repeats: int) -> dict:
    """Time 100 evaluations, an iteration of a swarm, by a search with one worker, and with two."""
    from casestudies import case_study

    from glvis import Evaluator
    from glvis.evaluation.workers import Workers
    from glvis.search.box import Box
    from glvis.visibility.maps import MapScene

    study = case_study("arms", SHARED if SHARED.is_dir() else None, holder=False)
    positions = Box(study.rig.bounds).uniform(100, np.random.default_rng(1))
    two_workers = Workers(MapScene.of(study), 2)
    evaluators = {
        "one worker": Evaluator(study, cache_bytes=0),  # which is the process itself
        "two workers": Evaluator(study, maps=two_workers, cache_bytes=0),
    }
    try:
        seconds = taking_turns(
            {
                name: lambda evaluator=evaluator: evaluator(positions)
                for name, evaluator in evaluators.items()
            },
            repeats,
        )
    finally:
        for evaluator in evaluators.values():
            evaluator.release()
    one, two = (np.array(values) for values in seconds.values())
    return {
        "evaluations_a_second_one": float(len(positions) / np.median(one)),
        "evaluations_a_second_two": float(len(positions) / np.median(two)),
        "ratio": float(np.median(one / two)),
    }


def count_maps(seconds: float = 6.0) -> float:
    """Return the maps a second that this process makes of the arms."""
    from glvis import Evaluator

    nothing = np.zeros((1, 0))
    with Evaluator(arm_study("pixels"), cache_bytes=0) as evaluator:
        evaluator(nothing)
        start, n = time.perf_counter(), 0
        while time.perf_counter() < start + seconds:
            evaluator(nothing)
            n += 48
        return n / (time.perf_counter() - start)


def bench_memory(repeats: int) -> dict:
    """Resident memory after 100 and after 10,000 evaluations of positions never met before."""
    from glvis import Evaluator, load_study

    model = dented_ball(600)
    write_stl(scratch() / "ball.stl", model)
    path = scratch() / "memory.toml"
    path.write_text(
        '[scene]\nmodels = ["ball.stl"]\nmax_edge = "off"\n'
        "[sensor.s]\nhfov_deg = 50\nvfov_deg = 50\n"
        "resolution = [64, 64]\nmin_distance = 10\nmax_distance = 400\n"
        '[[mount]]\nname = "M"\nsensor = "s"\nposition = [{ min = 150, max = 300 }, 0, 0]\n'
        "aim = [0, 0, 0]\nroll_deg = { min = -90, max = 90 }\n"
    )
    study = load_study(path)
    rng = np.random.default_rng(0)
    low, high = study.rig.bounds.T
    at = {}
    with Evaluator(study, cache_bytes=1 << 20) as evaluator:  # full long before the first mark
        for n in range(1, 10_001):
            evaluator(rng.uniform(low, high))
            if n in (100, 2000, 10_000):
                at[n] = resident_mib()
    return {"resident_mib": at, "grown_mib": at[10_000] - at[100]}


def resident_mib() -> float:
    """Return this process's resident memory."""
    pages = int(Path("/proc/self/statm").read_text().split()[1])
    return pages * resource.getpagesize() / 2**20


def peak_mib() -> float:
    """Return the most memory this process has had."""
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024


# --- what comes out


def table(rows: list[dict]) -> str:
    """Return rows as aligned text; numbers to four digits."""
    keys = list(dict.fromkeys(key for row in rows for key in row))
    cells = [keys] + [
        [
            f"{row.get(k, ''):.4g}" if isinstance(row.get(k), float) else str(row.get(k, ""))
            for k in keys
        ]
        for row in rows
    ]
    widths = [max(map(len, column)) for column in zip(*cells, strict=True)]
    return "\n".join(
        "  " + "  ".join(cell.rjust(w) for cell, w in zip(line, widths, strict=True))
        for line in cells
    )


def draw(results: dict, path: Path) -> None:
    """Plot faces against time a map."""
    import matplotlib as mpl

    mpl.use("Agg")
    import matplotlib.pyplot as plt

    rows = results["sizes"]["rows"]
    figure, axes = plt.subplots(figsize=(7, 4.5), layout="constrained")
    for key, label, mark in (
        ("embree", "Embree, centroid rays, one thread", "s--"),
        ("centroid", "glvis, centroid", "o-"),
        ("pixels", "glvis, pixels at auto", "^-"),
    ):
        points = [(r["faces"], r[f"{key}_ms_a_map"]) for r in rows if f"{key}_ms_a_map" in r]
        axes.loglog(*zip(*points, strict=True), mark, label=label)
    axes.set(xlabel="faces of the model", ylabel="time a map, ms", title=results["device"]["gl"])
    axes.grid(which="both", alpha=0.3)
    axes.legend(frameon=False)
    figure.savefig(path, dpi=150)


def main() -> None:
    """Run the parts asked for."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--only", help="comma-separated parts: " + ", ".join(PARTS))
    parser.add_argument("-o", "--output", type=Path, default=HERE / "out" / "bench")
    parser.add_argument("--repeats", type=int, default=7, help="rounds a part, medians are shown")
    parser.add_argument("--one-size", type=int, help=argparse.SUPPRESS)
    parser.add_argument("--count-maps", action="store_true", help=argparse.SUPPRESS)
    arguments = parser.parse_args()
    if arguments.one_size:
        print(json.dumps(one_size(arguments.one_size, arguments.repeats)))
        return
    if arguments.count_maps:
        print(count_maps())
        return
    try:
        import glvis  # noqa: F401
    except ImportError:
        sys.exit(
            "bench: glvis is missing here; run tools/test once, then "
            ".venv/bin/python tools/bench.py"
        )
    try:
        import embreex  # noqa: F401
    except ImportError:
        sys.exit("bench: embreex is missing; install it by: pip install '.[bench]'")
    wanted = arguments.only.split(",") if arguments.only else list(PARTS)
    unknown = set(wanted) - set(PARTS)
    if unknown:
        sys.exit(
            f"bench: unknown part {', '.join(sorted(unknown))}; choose from {', '.join(PARTS)}"
        )
    started = time.perf_counter()
    results: dict = {"device": device()}
    print(f"{results['device']['gl']}\n{results['device']['cpu']}, one thread a process")
    for part in wanted:
        measure = globals()[f"bench_{part}"]
        results[part] = measure(arguments.repeats)
        print(f"\n{part}: {measure.__doc__}")
        for key, value in results[part].items():
            print(table(value) if isinstance(value, list) else f"  {key}: {value}")
    results["seconds"] = time.perf_counter() - started
    arguments.output.mkdir(parents=True, exist_ok=True)
    (arguments.output / "bench.json").write_text(json.dumps(results, indent=1))
    if "sizes" in results:
        draw(results, arguments.output / "bench.png")
    print(f"\n{results['seconds']:.0f} s; bench.json and bench.png are in {arguments.output}")


if __name__ == "__main__":
    main()
