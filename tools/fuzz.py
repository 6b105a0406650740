#!/usr/bin/env python3
"""Runs the commands on damaged checkpoints, results and meshes, each in a process of its own.

    tools/fuzz.py --cases 1000 --seed 1

Each must end with exit code 0, 1 or 2 in less than ten seconds and a gigabyte beyond what it
began with, and say what is wrong in one line of less than 500 characters. The damages are those
of tests/support/damage.py; the same seed damages the same bytes.
"""

from __future__ import annotations

import argparse
import importlib
import os
import pkgutil
import shutil
import signal
import sys
import tempfile
import time
from collections import Counter
from dataclasses import dataclass
from pathlib import Path

import numpy as np

ROOT = Path(__file__).resolve().parents[1]
sys.path[:0] = [str(ROOT), str(ROOT / "tests")]

from support.damage import damaged  # noqa: E402
from support.two_cubes import SMALL, write_two_cubes  # noqa: E402
from support.whole_meshes import MESHES, write_mesh  # noqa: E402

import glvis  # noqa: E402

SECONDS, MEGABYTES, LETTERS = 10.0, 1000.0, 500
HANGS = 60  # seconds by the clock; the machine may be busy
QUICK = ("--no-pictures", "--no-meshes")
METHODS = {
    "swarm": (),
    "auto": ("--set", "search.method=auto", "--set", "search.max_maps=200"),
    "greedy": ("--set", "search.method=greedy", "--set", "search.max_maps=100"),
}
IN_RESULT = ("result.json", "visibility.npz", "reach.npz", "trace.csv", "study.toml")


@dataclass
class Outcome:
    """How a case ended: exit code, processor seconds, megabytes more than before, and why not."""

    kind: str
    code: int
    seconds: float
    megabytes: float
    wrong: str


def main() -> int:
    """Run the cases, say how each kind ended, and return 1 if any went wrong."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--cases", type=int, default=1000)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--first", type=int, default=0, help="number of the first case")
    parser.add_argument("--keep", type=Path, help="folder for the cases that went wrong")
    options = parser.parse_args()
    preload()
    with tempfile.TemporaryDirectory() as folder:
        base = Path(folder) / "base"
        made(base)
        outcomes = []
        for case in range(options.first, options.first + options.cases):
            place = Path(folder) / "case"
            rng = np.random.default_rng([options.seed, case])
            kind, arguments = prepared(base, place, rng)
            outcome = run(kind, arguments, Path(folder) / "said")
            outcomes.append(outcome)
            if outcome.wrong:
                print(f"case {case} ({kind}: {' '.join(arguments)}): {outcome.wrong}", flush=True)
                if options.keep:
                    shutil.copytree(place, options.keep / f"case-{case}", symlinks=True)
            shutil.rmtree(place)
    report(outcomes)
    return int(any(outcome.wrong for outcome in outcomes))


def preload() -> None:
    """Import what commands import late, once for all cases; no OpenGL, which no child could use."""
    for module in pkgutil.walk_packages(glvis.__path__, "glvis."):
        if not module.name.endswith("__main__"):
            importlib.import_module(module.name)
    for name in ("lxml.etree", "networkx", "scipy.optimize", "scipy.stats", "trimesh"):
        importlib.import_module(name)


def made(base: Path) -> None:
    """Write whole results by several methods, and a mesh of each format."""
    for name, settings in METHODS.items():
        (base / name).mkdir(parents=True)
        study = write_two_cubes(base / name)
        arguments = ["optimize", str(study), "-o", str(base / name / "out"), "--workers", "1"]
        outcome = run("base", [*arguments, *QUICK, *settings], base / "said")
        if outcome.wrong or outcome.code:
            raise SystemExit(f"the base cannot be made: {(base / 'said').read_text()}")
    for suffix in MESHES:
        write_mesh(base / f"mesh{suffix}")


def prepared(base: Path, place: Path, rng: np.random.Generator) -> tuple[str, list[str]]:
    """Write one damaged case; return its kind and the command."""
    method = list(METHODS)[rng.integers(0, len(METHODS))]
    kind = ("checkpoint", "result", "mesh")[rng.integers(0, 3)]
    if kind == "mesh":
        name = list(MESHES)[rng.integers(0, len(MESHES))]
        place.mkdir()
        study = write_two_cubes(place, SMALL.replace("cube.off", f"mesh{name}"))
        hurt(base / f"mesh{name}", place / f"mesh{name}", rng)
        command = ["check"] if rng.random() < 0.5 else ["evaluate", "-o", str(place / "o"), *QUICK]
        return f"mesh {name}", [*command, str(study)]
    shutil.copytree(base / method, place)
    out = place / "out"
    text = (out / "study.toml").read_text().replace(str(base / method), str(place))
    (out / "study.toml").write_text(text)
    if kind == "checkpoint":
        hurt(out / "checkpoint.npz", out / "checkpoint.npz", rng)
        more = ("--extend", "1") if rng.random() < 0.5 else ()
        return kind, ["optimize", "--resume", str(out), "--workers", "1", *QUICK, *more]
    name = IN_RESULT[rng.integers(0, len(IN_RESULT))]
    hurt(out / name, out / name, rng)
    study = str(place / "study.toml")
    commands = [
        ["explain", str(out)],
        ["compare", str(out), str(base / method / "out")],
        ["tolerance", str(out), "--position", "0.1", "--samples", "2"],
        ["evaluate", study, "-o", str(place / "o"), *QUICK, "--poses", str(out)],
        ["optimize", study, "-o", str(out), *QUICK, "--overwrite", "--workers", "1"],
        ["optimize", "--resume", str(out), *QUICK, "--workers", "1"],
        ["render", str(out), "--color", "unseen", "--size", "200x150"],
    ]
    return f"result {name}", commands[rng.integers(0, len(commands))]


def hurt(source: Path, target: Path, rng: np.random.Generator) -> None:
    """Write a damaged copy of a file."""
    target.write_bytes(damaged(source.suffix, source.read_bytes(), rng))


def run(kind: str, arguments: list[str], said: Path) -> Outcome:
    """Run a command in a child of this process, and judge how it ended."""
    before = resident()
    began = time.monotonic()
    child = os.fork()
    if not child:
        signal.alarm(HANGS)
        with said.open("w") as file:
            sys.stdout = sys.stderr = file
            os.dup2(file.fileno(), 1)
            os.dup2(file.fileno(), 2)
            from glvis.cli.app import main as glvis

            try:
                code = glvis(arguments)
            except BaseException:
                import traceback

                traceback.print_exc()
                code = 70
            sys.stdout.flush()
            sys.stderr.flush()
            os._exit(code)
    _, status, used = os.wait4(child, 0)
    text = said.read_text(errors="replace")
    seconds, megabytes = used.ru_utime + used.ru_stime, used.ru_maxrss / 1000 - before
    code = os.waitstatus_to_exitcode(status)
    wrong = []
    if code not in (0, 1, 2):
        wrong.append(f"exit code {code} after {time.monotonic() - began:.0f} s")
    if "Traceback" in text or "RuntimeWarning" in text:
        wrong.append(" | ".join(text.strip().splitlines()[-3:])[-400:])
    errors = [line for line in text.splitlines() if line.startswith("error: ")]
    if (code != 0) != (len(errors) == 1):
        wrong.append(f"{len(errors)} lines of error with exit code {code}: {text[-200:]!r}")
    wrong += [f"a line of {len(line)} letters" for line in errors if len(line) >= LETTERS]
    if seconds > SECONDS:
        wrong.append(f"{seconds:.1f} s")
    if megabytes > MEGABYTES:
        wrong.append(f"{megabytes:.0f} MB")
    return Outcome(kind, code, seconds, megabytes, "; ".join(wrong))


def resident() -> float:
    """Return the megabytes that this process holds."""
    pages = int(Path("/proc/self/statm").read_text().split()[1])
    return pages * os.sysconf("SC_PAGE_SIZE") / 1e6


def report(outcomes: list[Outcome]) -> None:
    """Print a row a kind of case, and one of all."""
    kinds = Counter(outcome.kind for outcome in outcomes)
    print("kind                     cases  code 0     1     2  wrong  most s  most MB")
    for kind in [*sorted(kinds), "all"]:
        own = [one for one in outcomes if kind in (one.kind, "all")]
        codes = Counter(one.code for one in own)
        print(
            f"{kind:24}{len(own):6}{codes[0]:8}{codes[1]:6}{codes[2]:6}"
            f"{sum(bool(one.wrong) for one in own):7}{max(one.seconds for one in own):8.1f}"
            f"{max(one.megabytes for one in own):9.0f}"
        )


if __name__ == "__main__":
    raise SystemExit(main())
