#!/usr/bin/env python3
"""Does the paper's two case studies again and writes our figures beside its own.

    tools/reproduce.py            # the paper's settings: Table 5, six arms with their holder, and
                               # five runs each of the kitchen with 2, 3 and 4 sensors
    tools/reproduce.py --quick    # small swarms, a few minutes; the page says so
    tools/reproduce.py --only kitchen --repeats 2
    tools/reproduce.py --page     # runs nothing, writes the page of what is there

Writes ``scenes/reproduced.md`` and ``scenes/pictures/``; the runs themselves, each a whole result,
are in ``out/reproduce``. Stop it whenever you like, by Ctrl-C or by killing it: the same command
goes on and loses one iteration at most. Where a study has been run with the paper's settings,
the page shows that; else the quick run.
"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Iterator
from pathlib import Path

from casestudies import HERE, STUDIES, case_study, mesh_settings, study_file
from paperpage import Run, page_lines, wanted_pictures

from glvis.cli.app import main as glvis
from glvis.cli.streams import patient_streams
from glvis.cli.terminal import say
from glvis.errors import MachineError, StudyError
from glvis.evaluation.workers import available_cores
from glvis.results.folder import CHECKPOINT, INDEX, STUDY
from glvis.results.reading import read_result

# Of a swarm that shows what the page will look like, and no more.
QUICK = ["swarm.particles=40", "swarm.iterations=30"]
REPEATS = {"paper": 5, "quick": 2}  # of the kitchen; the paper's own number is 5 (Sec. 3.2)
PARTS = {
    "arms": ("arms-table-8", "arms"),
    "kitchen": ("kitchen-2", "kitchen-3", "kitchen-4"),
}


def main() -> int:
    """Run what is missing, then write the page."""
    arguments = _arguments()
    mode = "quick" if arguments.quick else "paper"
    if not arguments.page:
        for case, seed in _wanted(arguments, mode):
            code = _run(case, seed, mode, arguments)
            if code:
                say("stopped; the same command goes on", error=True)
                return code
    runs = {case: _runs(arguments.output, case) for case in STUDIES}
    pictures = _copied(runs, arguments.docs / "pictures") if arguments.pictures else []
    arguments.docs.mkdir(parents=True, exist_ok=True)
    page = arguments.docs / "reproduced.md"
    page.write_text("\n".join(page_lines(runs, pictures)) + "\n", encoding="utf-8")
    say(f"The page is {page}, the results are in {arguments.output}")
    return 0


def _wanted(arguments: argparse.Namespace, mode: str) -> Iterator[tuple[str, int]]:
    """Yield what is to be run: case and seed."""
    for part in arguments.only:
        for case in PARTS[part]:
            repeats = (arguments.repeats or REPEATS[mode]) if part == "kitchen" else 1
            for seed in range(1, repeats + 1):
                yield case, seed


def _run(case: str, seed: int, mode: str, arguments: argparse.Namespace) -> int:
    """Run a case to its end, from where it was; return an exit code."""
    folder = arguments.output / mode / f"{case}-{seed}"
    searches = case != "arms-table-8"
    settings = mesh_settings(case, arguments.data)
    if searches:
        settings += [*(QUICK if mode == "quick" else []), f"swarm.seed={seed}"]
    more = [] if arguments.pictures and seed == 1 else ["--no-pictures"]
    text = case_study(case, None, settings).text
    for begun in (folder / "unfinished" / STUDY, folder / STUDY):
        if begun.is_file() and begun.read_text(encoding="utf-8") != text:
            raise StudyError(
                f"{folder}: holds a run with other meshes or settings; remove it, or choose "
                "another folder by -o"
            )
    is_over = (folder / INDEX).is_file() and not _is_interrupted(folder)
    if is_over and not (folder / "unfinished").exists():
        say(f"{case}, seed {seed}: done before", error=True)
        return 0
    say(f"\n{case}, seed {seed}, into {folder}", error=True)
    if searches:
        more += ["--workers", str(arguments.workers)]
    if (folder / "unfinished" / CHECKPOINT).is_file() or (folder / INDEX).is_file():
        return _done(glvis(["optimize", "--resume", str(folder), *more]), folder)
    command = "optimize" if searches else "evaluate"
    sets = [word for setting in settings for word in ("--set", setting)]
    words = [command, str(study_file(case)), "-o", str(folder), *sets, *more]
    return _done(glvis(words), folder)


def _done(code: int, folder: Path) -> int:
    """Return an exit code that also says whether the search was cut off."""
    return code or (130 if _is_interrupted(folder) else 0)


def _is_interrupted(folder: Path) -> bool:
    return read_result(folder).stop_reason.startswith("interrupted")


def _runs(output: Path, case: str) -> list[Run]:
    """Return the finished runs of a case: with the paper's settings, else the quick ones."""
    for mode in ("paper", "quick"):
        found = []
        for index in sorted((output / mode).glob(f"{case}-[0-9]*/{INDEX}")):
            placement = read_result(index.parent)
            if not placement.stop_reason.startswith("interrupted"):
                found.append(Run(placement, index.parent, is_quick=mode == "quick"))
        if found:
            return found
    return []


def _copied(runs: dict[str, list[Run]], folder: Path) -> list[tuple[str, str]]:
    """Copy the pictures of the page; return (file name, caption) of those that are there."""
    copied = []
    folder.mkdir(parents=True, exist_ok=True)
    for case, view, caption in wanted_pictures():
        source = runs[case][0].folder / "views" / f"{view}.png" if runs[case] else None
        if source and source.is_file():
            name = f"{case}-{view}.png"
            (folder / name).write_bytes(source.read_bytes())
            copied.append((name, caption))
    return copied


def _arguments() -> argparse.Namespace:
    """Return what the user wants, checked."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--quick", action="store_true", help="small swarms: a few minutes")
    parser.add_argument("--only", help="with commas: " + ", ".join(PARTS))
    parser.add_argument("--repeats", type=int, help="runs of each kitchen study: seeds 1, 2, ...")
    parser.add_argument("--data", type=Path, metavar="DIR", help="meshes: arms/ and kitchen/")
    parser.add_argument("--page", action="store_true", help="run nothing, write the page")
    parser.add_argument("--no-pictures", dest="pictures", action="store_false")
    parser.add_argument("--workers", type=int, default=available_cores())
    parser.add_argument("--docs", type=Path, default=HERE / "scenes", help="where the page goes")
    parser.add_argument("-o", "--output", type=Path, default=HERE / "out" / "reproduce")
    arguments = parser.parse_args()
    arguments.only = list(PARTS) if arguments.only is None else arguments.only.split(",")
    unknown = [part for part in arguments.only if part not in PARTS]
    if unknown:
        parser.error(f"--only: no {', '.join(unknown)}; choose from {', '.join(PARTS)}")
    for name in ("repeats", "workers"):
        value = getattr(arguments, name)
        if value is not None and value < 1:
            parser.error(f"--{name} {value}: must be at least 1")
    if arguments.data is not None and not arguments.data.is_dir():
        parser.error(f"--data {arguments.data}: there is no such folder")
    arguments.data = arguments.data and arguments.data.resolve()
    return arguments


if __name__ == "__main__":
    try:
        with patient_streams():
            sys.exit(main())
    except (StudyError, MachineError) as problem:
        sys.exit(f"reproduce: {problem}")
