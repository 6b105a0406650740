#!/usr/bin/env python3
"""Checks glvis on a graphics card, and times it: one command, at most four minutes.

    tools/gpu_check.py                # progress to stderr, the report to stdout, as Markdown
    tools/gpu_check.py -o report.md   # the report to a file as well
    tools/gpu_check.py --small        # the same with little to do, in some seconds

The report has four sections: the driver and its self-test; maps of awkward meshes against rays in
float64; maps a second; where the time goes. It needs what glvis itself needs, in the Python that
runs it, and a checkout. With embreex there (pip install embreex) times stand beside Embree's.
On a machine without a graphics card it runs on the CPU (llvmpipe), and says so.

The exit code is 0 where all is right, 1 where something is not (the report begins with what), 2 for
arguments that cannot be.
"""

from __future__ import annotations

import argparse
import platform
import sys
import time
from collections.abc import Callable, Sequence
from contextlib import ExitStack
from dataclasses import dataclass, field
from importlib.util import find_spec
from pathlib import Path
from typing import Any

ROOT = Path(__file__).resolve().parents[1]
sys.path[:0] = [str(ROOT), str(ROOT / "tests"), str(ROOT / "tools")]

try:
    import numpy as np
    from measuring import (
        SHARED,
        Embree,
        Profile,
        agreement,
        arm_study,
        ball_views,
        dented_ball,
        device,
        taking_turns,
    )
    from support import kinds, verdicts
    from support.verdicts import Way

    import glvis.visibility.context as gl
    from glvis.errors import MachineError
    from glvis.problem.visibility_options import VisibilityOptions
    from glvis.visibility.cast import has_compute
    from glvis.visibility.maps import LocalMaps, MapJob, MapScene
    from glvis.visibility.selftest import can_cast, check_driver
except ImportError as error:
    sys.exit(f"gpu_check: {error}; run it in a checkout, by a Python that has what glvis needs")


@dataclass(frozen=True)
class Plan:
    """What is done, and how long each section may take.

    Attributes
    ----------
    kinds : tuple of str
        Meshes that are held against rays, by their names in tests/support/kinds.py.
    most_rounds : int
        How often poses are drawn about each of them, five at a time.
    faces : tuple of int
        Sizes of the ball that is timed; of the last the time is parted as well.
    faces_on_hardware : tuple of int
        Further ones, where the driver is no software.
    with_arms : bool
        Whether six arms before eight sensors are timed too.
    maps_seconds, times_seconds, profile_seconds : float
        What each section may take.
    """

    kinds: tuple[str, ...]
    most_rounds: int
    faces: tuple[int, ...]
    faces_on_hardware: tuple[int, ...]
    with_arms: bool
    maps_seconds: float
    times_seconds: float
    profile_seconds: float


WHOLE = Plan(
    kinds=(
        *("sheet box, wall 1e-3", "coincident", "gear", "lattice", "interpenetrating"),
        *("terrain", "nested"),
    ),
    most_rounds=4,
    faces=(10_000, 100_000),
    faces_on_hardware=(1_000_000,),
    with_arms=True,
    maps_seconds=45,
    times_seconds=130,
    profile_seconds=25,
)
SMALL = Plan(("sheet box, wall 1e-3", "coincident"), 1, (2_000,), (), False, 5, 6, 2)

# How a map is made is a matter of criterion and resolution: points of faces in compute shaders, the
# same points in NumPy, or pixels that are drawn.
CAST = (Way("pixels", "auto", True), Way("centroid", "auto", True))
IN_NUMPY = (Way("pixels", "auto", False), Way("centroid", "auto", False))
DRAWN = Way("pixels", "sensor", False)
BATCHES = (1, 10, 100)
TIMED = {
    "pixels": VisibilityOptions(criterion="pixels"),
    "centroid": VisibilityOptions(criterion="centroid"),
    "pixels, drawn": VisibilityOptions(criterion="pixels", resolution="sensor"),
}
RIVAL, RATIO = "Embree", "`centroid` against it"
SHARES = (1, 3, 8)  # of a scene's time, batch by batch
MOST_REPEATS, RIVAL_POSITIONS = 7, 10
FIRST_SECONDS = 0.3  # what a round is thought to take while nothing is known of it
MIN_IOU_WITH_RIVAL = 0.99  # its rays are float32, and meet faces beside the one they are sent to


@dataclass
class Report:
    """The text so far, and what was found wrong."""

    lines: list[str] = field(default_factory=list)
    wrong: list[str] = field(default_factory=list)

    def say(self, text: str = "") -> None:
        """Add a paragraph, a headline or a table."""
        self.lines += [text, ""]

    def fail(self, text: str) -> None:
        """Note what is wrong."""
        print(f"WRONG: {text}", file=sys.stderr, flush=True)
        self.wrong.append(text)

    def section(self, title: str, work: Callable[[Report], None]) -> None:
        """Add a section; what stops it is noted, and the next one has its turn."""
        self.say(f"## {title}")
        try:
            work(self)
        except Exception as error:  # any driver may fail in any way
            self.fail(f"{title}: {type(error).__name__}: {' '.join(str(error).split())}")
            self.say("This section was not finished: see the beginning.")

    def __str__(self) -> str:
        head = ["# glvis on this machine", "", about(), ""]
        if self.wrong:
            head += ["**Not all is right:**", "", *(f"- {one}" for one in self.wrong), ""]
        else:
            head += ["**All is right.**", ""]
        return "\n".join([*head, *self.lines]).rstrip() + "\n"


def main(arguments: Sequence[str] | None = None) -> int:
    """Check, print, and return the exit code."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("-o", "--output", type=Path, metavar="FILE", help="the report, to a file")
    parser.add_argument("--small", action="store_true", help="little to do, in some seconds")
    asked = parser.parse_args(arguments)
    if asked.output and (asked.output.is_dir() or not asked.output.absolute().parent.is_dir()):
        parser.error(f"-o {asked.output}: must be a file in a folder that is there")
    plan, start = SMALL if asked.small else WHOLE, time.perf_counter()
    report = Report()
    with gl.rasterising_in_this_thread():  # as glvis itself does
        report.section("Driver", driver)
    for title, work in (
        ("Maps against rays", maps_against_rays),
        ("Maps a second", maps_a_second),
        ("Where the time goes", where_time_goes),
    ):
        if gl_is_there():
            progress(f"{title} ...")
            report.section(title, lambda report, work=work: work(report, plan))
    if gl_is_there() and (error := gl.gl_context().error) != "GL_NO_ERROR":
        report.fail(f"OpenGL was left with the error {error}")
    report.say(f"All this took {time.perf_counter() - start:.0f} s.")
    print(report, end="")
    if asked.output:
        asked.output.write_text(str(report), encoding="utf-8")
    return 1 if report.wrong else 0


def progress(text: str) -> None:
    """Say how far this is."""
    print(text, file=sys.stderr, flush=True)


def table(head: Sequence[str], rows: Sequence[Sequence[str]]) -> str:
    """Return a table of Markdown; all columns but the first are numbers."""
    rule = ["---", *["---:"] * (len(head) - 1)]
    return "\n".join(f"| {' | '.join(row)} |" for row in (head, rule, *rows))


def about() -> str:
    """Return what ran, but for the driver."""
    cpu = device()["cpu"] if gl_is_there() else platform.machine()
    return f"Python {platform.python_version()}, NumPy {np.__version__}, {cpu}."


def gl_is_there() -> bool:
    """Return whether this process has an OpenGL context."""
    try:
        gl.gl_context()
    except MachineError:
        return False
    return True


# --- the driver


def driver(report: Report) -> None:
    """Say who draws, and whether it draws and casts known scenes rightly."""
    info, limits = gl.gl_info(), gl.gl_context().info
    progress(f"Driver: {info.renderer}, {info.version} ...")
    try:
        check_driver()
        draws = "yes"
    except MachineError as error:
        draws = "no"
        report.fail(f"check_driver(): {error}")
    if has_compute() and not can_cast():
        report.fail(
            "can_cast(): this driver has compute shaders, and casts a known scene wrongly or "
            "refuses a shader; glvis makes maps without them then, more slowly"
        )
    block = int(limits["GL_MAX_SHADER_STORAGE_BLOCK_SIZE"]) if has_compute() else 0
    rows = [
        ("vendor", info.vendor),
        ("renderer", info.renderer),
        ("version", info.version),
        ("context by", info.backend),
        ("kind", "software: no graphics card is used" if info.is_software else "hardware"),
        ("compute shaders (OpenGL 4.3)", "yes" if has_compute() else "no"),
        ("largest storage block", f"{block / 2**20:,.0f} MiB" if block else "–"),
        ("largest texture", f"{int(limits['GL_MAX_TEXTURE_SIZE']):,}"),
        ("casts known scenes rightly (`can_cast()`)", "yes" if can_cast() else "no"),
        ("draws known scenes rightly (`check_driver()`)", draws),
    ]
    report.say(table(["what", "is"], rows).replace("---:", "---"))


# --- maps against rays


def maps_against_rays(report: Report, plan: Plan) -> None:
    """Hold maps of awkward meshes against rays in float64, round by round while there is time."""
    ways = [*(CAST if can_cast() else ()), *IN_NUMPY, DRAWN]
    found: dict[str, verdicts.Verdicts] = {}
    took: dict[str, float] = {}
    end = time.perf_counter() + plan.maps_seconds
    for turn in range(plan.most_rounds):
        for name in plan.kinds:
            if time.perf_counter() + took.get(name, 0) > end:
                continue
            progress(f"  {name}, round {turn + 1}")
            start = time.perf_counter()
            shape = kinds.KINDS[name]()
            poses = verdicts.poses_about(
                np.random.default_rng([turn, *name.encode()]), verdicts.corners_of(shape)
            )
            sensor = verdicts.device_for(shape)
            new = verdicts.judged(name, shape, poses, sensor, those=ways, words=verdicts.PLACES)
            if name in found:
                found[name] += new
            else:
                found[name] = new
            took[name] = time.perf_counter() - start
    limits = verdicts.Limits()
    report.say(
        "Faces that maps call visible and of which no point is (wrong), faces at least half "
        "visible that they leave out (missed), and centres of mass, intersection over union (IoU): "
        "held against rays in float64, in NumPy. Faces that rounding decides on count nowhere. "
        f"At most {limits.wrong_percent} % may be wrong, {limits.missed_percent} % missed and "
        f"{limits.excused_percent} % left to rounding, and the IoU is {limits.iou} at least."
    )
    rows = []
    for verdict in found.values():
        for line in verdict.broken():
            for way in ways:
                line = line.replace(f"{way}:", f"{way.criterion}, {how(way)}:")
            report.fail(line)
        for way in verdict.by_pose:
            total = verdict.total(way)
            by_centre = way.criterion == "centroid"
            rows.append(
                (
                    f"{verdict.name}, {verdict.n_faces:,} faces",
                    str(len(verdict.poses)),
                    f"`{way.criterion}`, {how(way)}",
                    f"{total.seen:,}",
                    "" if by_centre else f"{total.wrong_percent:.3f}",
                    "" if by_centre else f"{total.missed_percent:.3f}",
                    f"{total.iou:.4f}" if by_centre else "",
                    "yes" if verdict.limits.share(way, total) <= 1 else "**no**",
                )
            )
    head = ("mesh", "poses", "maps by", "faces seen", "wrong, %", "missed, %", "IoU", "right")
    report.say(table(head, rows))
    left_out = [name for name in plan.kinds if name not in found]
    if left_out:
        report.say(f"There was no time for {'; '.join(left_out)}.")
    if not can_cast():
        report.say("No maps were made in compute shaders: this driver has none that can be used.")


def how(way: Way) -> str:
    """Return how maps are made, in words."""
    if way == DRAWN:
        return "drawn"
    return "compute shaders" if way.casts else "NumPy"


# --- maps a second


@dataclass(frozen=True)
class Scene:
    """What is timed.

    Attributes
    ----------
    name : str
        For people.
    models : tuple of Model
        M of them.
    sensor : Sensor
        Whose maps are made.
    poses : (N, S, 4, 4) float64
        S of them a position.
    """

    name: str
    models: tuple
    sensor: Any
    poses: np.ndarray


def maps_a_second(report: Report, plan: Plan) -> None:
    """Time maps of batches of positions."""
    is_software = gl.gl_info().is_software
    sizes: list[int | None] = [*plan.faces, *([None] if plan.with_arms else [])]  # None: the arms
    sizes += [] if is_software else plan.faces_on_hardware
    end = time.perf_counter() + plan.times_seconds
    rows: list[tuple[str, ...]] = []
    a_face, iou = 0.0, 1.0  # seconds until the first map
    for number, n_faces in enumerate(sizes):
        share = (end - time.perf_counter()) / (len(sizes) - number)
        if n_faces and a_face * n_faces > share / 2:
            report.say(f"A ball of {n_faces:,} faces was left out: there was no time for it.")
            continue
        with ExitStack() as held:
            start = time.perf_counter()
            scene = ball_scene(n_faces) if n_faces else arm_scene()
            progress(f"  {scene.name}")
            makers = {name: maps_of(scene, options, held) for name, options in TIMED.items()}
            rivals = [Embree(model) for model in scene.models] if find_spec("embreex") else []
            a_face = (time.perf_counter() - start) / sum(model.n_faces for model in scene.models)
            more, least = timed(report, scene, makers, rivals, start + share)
        rows += more
        iou = min(iou, least)
    rival = find_spec("embreex") is not None
    report.say(
        "Medians of several rounds, in which all ways take turns. `pixels` and `centroid` are the "
        'criteria at `resolution = "auto"`, '
        + ("by compute shaders" if can_cast() else "in NumPy, as this driver cannot cast")
        + "; drawn: `pixels` at the sensor's own 1280 x 720. A position of the ball is one pose, "
        "one of the arms eight sensors before six models."
        + (
            " Embree: a ray to each centre of mass of what NumPy filters leave (embreex, one "
            f"thread, of {RIVAL_POSITIONS} positions at most); the last column is how many times "
            f"as fast `centroid` is. The least IoU of their maps was {iou:.4f}."
            if rival
            else " embreex is not there, so that there is nothing to compare with."
        )
    )
    head = ["scene", "positions", "maps", *(f"{name}, maps/s" for name in TIMED)]
    head += [f"{RIVAL}, maps/s", RATIO] if rival else []
    report.say(table(head, rows))
    if any("–" in row for row in rows):
        report.say("–: left out, for it would have taken too long.")
    if is_software:
        report.say(
            "This is a software driver: the numbers say nothing about a graphics card, and larger "
            "balls were left out."
        )


def ball_scene(n_faces: int) -> Scene:
    """Return a dented ball, a pose a position around it, and its sensor."""
    model = dented_ball(n_faces)
    poses, sensor = ball_views(BATCHES[-1])
    poses = poses[np.random.default_rng(0).permutation(len(poses))]
    name = f"dented ball, {model.n_faces:,} faces"
    return Scene(name, (model,), sensor, poses[:, None])


def arm_scene() -> Scene:
    """Return six arms, and eight poses a position about those of the paper."""
    study = arm_study("pixels")
    poses = np.repeat(study.rig.poses(np.zeros((1, 0))), BATCHES[-1], axis=0)
    poses[:, :, :3, 3] += np.random.default_rng(0).normal(scale=5, size=(*poses.shape[:2], 3))
    where = "of ../shared/data" if (SHARED / "arms").is_dir() else "of scenes/"
    n_faces = sum(model.n_faces for model in study.models)
    name = f"six arms {where}, {n_faces:,} faces in all"
    return Scene(name, tuple(study.models), study.sensors[0], poses)


def maps_of(scene: Scene, options: VisibilityOptions, held: ExitStack) -> LocalMaps:
    """Return who makes maps of a scene, given back with all that is held."""
    maps = LocalMaps(MapScene(scene.models, (), (scene.sensor,), options))
    held.callback(maps.release)
    return maps


def timed(
    report: Report,
    scene: Scene,
    makers: dict[str, LocalMaps],
    rivals: list[Embree],
    end: float,
) -> tuple[list[tuple[str, ...]], float]:
    """Return rows of the table, one a batch, and the least IoU with Embree's maps."""
    made: dict[str, np.ndarray] = {}
    rows, least = [], 1.0
    a_position: dict[str, float] = {}  # seconds, by way
    for k, n in enumerate(BATCHES):
        # more for the larger ones
        share = (end - time.perf_counter()) * SHARES[k] / sum(SHARES[k:])
        likely = {name: n * a_position.get(name, 0.0) for name in makers}
        ways = sorted(makers, key=likely.__getitem__)
        while ways and 2 * sum(likely[name] for name in ways) > max(share, 0.5):
            ways.pop()
        n_maps = n * scene.poses.shape[1] * len(scene.models)
        cells = dict.fromkeys([*TIMED, *([RIVAL, RATIO] if rivals else [])], "–")
        if ways:
            progress(f"    positions: {n}")
            once = sum(likely[name] for name in ways) or FIRST_SECONDS
            repeats = int(np.clip(0.8 * share / once - 1, 1, MOST_REPEATS))
            batch = {name: makers[name] for name in ways}
            seconds, mine, theirs = round_of(scene, n, batch, rivals, repeats)
            for name, maps in mine.items():
                fewer = made.get(name, maps[:0])
                if not np.array_equal(fewer, maps[: len(fewer)]):
                    report.fail(f"{scene.name}, {name}: maps differ where more are made at once")
                a_position[name] = min(seconds[name]) / n
                cells[name] = f"{n_maps / np.median(seconds[name]):,.0f}"
            made |= mine
            if rivals:
                base = np.array(seconds[RIVAL]) * n / min(n, RIVAL_POSITIONS)
                cells[RIVAL] = f"{n_maps / np.median(base):,.0f}"
                if "centroid" in mine:
                    cells[RATIO] = f"{np.median(base / np.array(seconds['centroid'])):.2f}"
                    least = min(least, agreement(mine["centroid"][: len(theirs)], theirs))
        rows.append((scene.name, f"{n}", f"{n_maps:,}", *cells.values()))
    if least < MIN_IOU_WITH_RIVAL:
        report.fail(f"{scene.name}: centroid has an IoU of {least:.4f} with Embree's centroid rays")
    return rows, least


def round_of(
    scene: Scene, n: int, makers: dict[str, LocalMaps], rivals: list[Embree], repeats: int
) -> tuple[dict[str, list[float]], dict[str, np.ndarray], np.ndarray]:
    """Return seconds of n positions by way, its maps, and the rival's of the first positions.

    Maps are (poses, faces of all models) bool.
    """
    poses = scene.poses[:n].reshape(-1, 4, 4)
    some = scene.poses[: min(n, RIVAL_POSITIONS)].reshape(-1, 4, 4)
    made: dict[str, list[np.ndarray]] = {}

    def ours(name: str) -> None:
        made[name] = list(makers[name].make([MapJob(0, poses)]))

    def theirs() -> None:
        made[RIVAL] = [
            np.concatenate([one.centroids(pose, scene.sensor) for one in rivals]) for pose in some
        ]

    ways = {name: lambda name=name: ours(name) for name in makers}
    ways |= {RIVAL: theirs} if rivals else {}
    took = taking_turns(ways, repeats)
    maps = {name: unpacked(made[name][0], scene.models) for name in makers}
    return took, maps, np.array(made.get(RIVAL, []))


def unpacked(bits: np.ndarray, models: Sequence) -> np.ndarray:
    """Return maps (N, faces of all models) bool."""
    parts, begin = [], 0
    for model in models:
        end = begin + -(-model.n_faces // 8)
        parts.append(np.unpackbits(bits[:, begin:end], axis=1, count=model.n_faces).view(bool))
        begin = end
    return np.concatenate(parts, axis=1)


# --- where the time goes


def where_time_goes(report: Report, plan: Plan) -> None:
    """Part the time of maps of a ball, step by step."""
    scene = ball_scene(plan.faces[-1])
    columns: dict[str, dict[str, float]] = {}
    n = {}
    for name, options in TIMED.items():
        with ExitStack() as held:
            maps = maps_of(scene, options, held)
            progress(f"  {name}")
            few, many = (MapJob(0, scene.poses[:k, 0]) for k in BATCHES[1:])
            list(maps.make([few]))
            start = time.perf_counter()
            list(maps.make([few]))
            likely = (time.perf_counter() - start) * len(many) / len(few)
            job = many if 3 * likely < plan.profile_seconds / len(TIMED) else few
            list(maps.make([job]))
            with Profile() as profile:
                list(maps.make([job]))
        columns[name], n[name] = profile.seconds, len(job)
    steps = [step for column in columns.values() for step in column if step != Profile.REST]
    rows = []
    for step in [*dict.fromkeys(steps), Profile.REST]:
        rows.append((step, *(cell(one, step, n[name]) for name, one in columns.items())))
    totals = (f"{1e3 * sum(one.values()) / n[name]:.2f}" for name, one in columns.items())
    report.say(
        f"Milliseconds a map of the {scene.name}, and shares of the whole. Each step waits for "
        "the GPU before the next begins, so that the sum is more than a map takes otherwise. `ask` "
        "looks up points of faces, `keep` leaves out what hides none, `hide` finds what is hidden, "
        "`draw` draws the sensor's pixels; marking turns what is read back into maps."
    )
    batches = (f"{name}, {n[name]} positions" for name in columns)
    report.say(table(["step", *batches], [*rows, ("all", *totals)]))


def cell(seconds: dict[str, float], step: str, n: int) -> str:
    """Return milliseconds a map and the share of the whole, in words."""
    if step not in seconds:
        return ""
    share = 100 * seconds[step] / sum(seconds.values())
    return f"{1e3 * seconds[step] / n:.2f} ({share:.0f} %)"


if __name__ == "__main__":
    sys.exit(main())
