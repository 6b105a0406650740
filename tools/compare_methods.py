#!/usr/bin/env python3
"""Holds the search methods against each other: value against rendered maps, over several seeds.

Every method searches the same studies with the same number of maps: the arms of Sec. 3.1
without their holder (18 variables) and the kitchen of Sec. 3.2 with two, three and four sensors.

    tools/compare_methods.py                        # all methods, all studies, three seeds
    tools/compare_methods.py --only kitchen-2 --methods auto,refine --maps 4000 --seeds 5
    tools/compare_methods.py -o out/methods         # where methods.png, .md and .json go

What is finished is not searched again, and what was cut off goes on where it was: start it as
often as you like. Real meshes are read from ``../shared/data`` where that lies beside the
checkout, or from --data; else those of ``scenes/`` are taken. The table says which.
"""

from __future__ import annotations

import argparse
import hashlib
import json
import os
import sys
from functools import cache
from pathlib import Path

import numpy as np
from casestudies import BESIDE, case_study
from methods import METHODS as FOR_COMPARISON

from glvis.cli.terminal import progress_shown, say
from glvis.common.palette import OKABE_ITO
from glvis.errors import MachineError, StudyError
from glvis.problem.search_options import METHODS as OF_STUDIES
from glvis.results.result import versions
from glvis.results.tables import mean_row, model_rows
from glvis.search.checkpoint import identity_of
from glvis.search.placement import place_sensors

HERE = Path(__file__).resolve().parents[1]
METHODS = (*OF_STUDIES, *FOR_COMPARISON)

# Maps a search may render. Arms: a third of what a swarm of 100 takes for 100 iterations;
# kitchen: 4,000 a sensor.
BUDGETS = {"arms": 160_000, "kitchen-2": 8_000, "kitchen-3": 12_000, "kitchen-4": 16_000}
PARTICLES = 100  # few enough for some iterations within these budgets


def main() -> int:
    """Search what is missing, then draw."""
    arguments = _arguments()
    runs = [
        (case, method, seed)
        for case in arguments.only
        for method in arguments.methods
        for seed in range(1, arguments.seeds + 1)
    ]
    records, left_out = [], {}
    for number, (case, method, seed) in enumerate(runs, 1):
        if method in left_out:
            continue
        name = f"{case}, {method}, seed {seed} ({number} of {len(runs)})"
        try:
            record = _searched(case, method, seed, arguments, name)
        except (StudyError, MachineError) as error:
            if method == "swarm":
                raise
            left_out[method] = str(error)  # its package is missing
            say(f"{method} is left out: {error}", error=True)
            continue
        if record is None:
            say("interrupted; the same command goes on", error=True)
            return 130
        records.append(record)
    arguments.output.mkdir(parents=True, exist_ok=True)
    summary = {
        "meshes": str(arguments.data) if arguments.data else "scenes",
        "seeds": arguments.seeds,
        "glvis": versions()["glvis"],
        "left_out": left_out,
        "runs": records,
    }
    (arguments.output / "methods.json").write_text(json.dumps(summary, indent=1))
    lines = table_lines(records, arguments.data)
    (arguments.output / "methods.md").write_text("\n".join(lines) + "\n", encoding="utf-8")
    draw(records, arguments.output / "methods.png")
    for line in lines:
        say(line)
    say(f"\nmethods.png, methods.md and methods.json are in {arguments.output}")
    return 0


def _searched(
    case: str, method: str, seed: int, arguments: argparse.Namespace, name: str
) -> dict | None:
    """Return what a search came to, from its file if it was finished before; None if cut off."""
    maps = arguments.maps or BUDGETS[case]
    iterations = maps // (PARTICLES * _maps_an_evaluation(case, arguments.data))
    settings = [
        f"swarm.particles={PARTICLES}",
        f"swarm.iterations={iterations}",  # more than the budget allows, if only just
        f"swarm.stall_iterations={iterations + 1}",  # all methods render as many maps
        f"swarm.seed={seed}",
        f"search.method={'auto' if method in FOR_COMPARISON else method}",
        f"search.max_maps={maps}",
    ]
    study = case_study(case, arguments.data, settings, holder=False)
    identity = json.dumps(identity_of(study), sort_keys=True)
    digest = hashlib.sha256(identity.encode()).hexdigest()[:10]  # another study, another file
    folder = arguments.output / "runs"
    path = folder / f"{case}-{method}-{seed}-{digest}.json"
    if path.is_file():
        say(f"{name}: done before", error=True)
        return json.loads(path.read_text())
    say(f"{name}: up to {maps:,} maps", error=True)
    folder.mkdir(parents=True, exist_ok=True)
    checkpoint = path.with_suffix(".npz")
    with progress_shown() as show:
        placement = place_sensors(
            study,
            workers=arguments.workers,
            on_iteration=show,
            checkpoint=checkpoint,
            resume=checkpoint.is_file(),
            script=FOR_COMPARISON.get(method),
        )
    if placement.stop_reason.startswith("interrupted"):
        return None
    rows = model_rows(study.models, placement.maps, study.objective)
    first = len(study.sensors) * len(study.models)  # the start's
    record = {
        "case": case,
        "method": method,
        "seed": seed,
        "budget": maps,
        "maps_rendered": placement.maps_rendered,
        "evaluations": placement.evaluations,
        "value": placement.value,
        "seen_percentage": mean_row(rows)["percentage"],
        "stop_reason": placement.stop_reason,
        "trace": [(first, placement.start_value)]
        + [(row.maps_rendered, row.best) for row in placement.trace],
        "models": len(study.models),
        "sensors": len(study.sensors),
        "variables": len(study.variables),
    }
    part = path.with_suffix(".part")
    part.write_text(json.dumps(record))
    part.replace(path)
    checkpoint.unlink()
    return record


@cache
def _maps_an_evaluation(case: str, data: Path | None) -> int:
    study = case_study(case, data, holder=False)
    return len(study.models) * len(study.sensors)


def table_lines(records: list[dict], data: Path | None) -> list[str]:
    """Return a Markdown table: a row a study and method, over seeds."""
    meshes = "the meshes of `scenes/`" if data is None else "meshes from outside this repository"
    lines = [
        f"Made by `tools/compare_methods.py` on {meshes}. OF3 of the best layout, median over",
        "seeds with the worst and the best; faces that it sees, the median; the largest median of",
        "each study in bold.",
        "",
        "| study | maps | method | OF3 | worst to best | seen % | seeds |",
        "| --- | ---: | --- | ---: | --- | ---: | ---: |",
    ]
    for case, methods in _grouped(records).items():
        best = max(np.median([run["value"] for run in runs]) for runs in methods.values())
        for method, runs in methods.items():
            values = [run["value"] for run in runs]
            middle = np.median(values)
            shown = f"**{middle:.3f}**" if middle == best else f"{middle:.3f}"
            seen = np.median([run["seen_percentage"] for run in runs])
            lines.append(
                f"| {case} | {runs[0]['budget']:,} | {method} | {shown} "
                f"| {min(values):.3f} to {max(values):.3f} | {seen:.1f} | {len(runs)} |"
            )
    return lines


def draw(records: list[dict], path: Path) -> None:
    """Plot value against maps: the median over seeds, between the worst and the best of them."""
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    cases = _grouped(records)
    columns = min(2, len(cases))
    rows = -(-len(cases) // columns)
    figure = Figure(figsize=(5.6 * columns, 3.7 * rows + 0.3), dpi=180, layout="constrained")
    FigureCanvasAgg(figure)
    for place, (case, methods) in enumerate(cases.items(), 1):
        _draw_case(figure.add_subplot(rows, columns, place), case, methods)
    seeds = max(len(runs) for methods in cases.values() for runs in methods.values())
    between = " " if columns > 1 else "\n"  # one panel is too narrow for one line
    figure.suptitle(
        f"Value against maps rendered: median over {seeds} seeds, from the worst to the best;"
        f"{between}a method begins where it first has a whole layout",
        fontsize=9.5,
        x=0.01,
        ha="left",
        color="0.3",
    )
    figure.savefig(path, format="png")


def _draw_case(axes, case: str, methods: dict[str, list[dict]]) -> None:
    """Plot the methods on one study, with their names at the right end."""
    colors = dict(zip(METHODS, OKABE_ITO, strict=False))
    budget = max(runs[0]["budget"] for runs in methods.values())
    grid = np.linspace(0, budget, 600)
    lowest, ends = np.inf, []
    for method, runs in methods.items():
        values = np.array([_stepped(run["trace"], grid) for run in runs])
        is_there = (values > runs[0]["trace"][0][1]).all(axis=0)
        values[:, ~is_there] = np.nan
        low, middle, high = values.min(axis=0), np.median(values, axis=0), values.max(axis=0)
        axes.fill_between(grid, low, high, color=colors[method], alpha=0.16, lw=0)
        axes.plot(grid, middle, color=colors[method], lw=2, solid_capstyle="butt")
        last = float(np.median([run["value"] for run in runs]))
        axes.plot(budget, last, "o", ms=5, color=colors[method], clip_on=False, zorder=5)
        ends.append((last, method))
        # the climb from the start may leave the picture at the bottom
        shown = low[is_there & (grid >= 0.1 * budget)]
        lowest = min([lowest, last, *shown])
    highest = max(run["value"] for runs in methods.values() for run in runs)
    margin = 0.06 * (highest - lowest) or 1.0
    bottom, top = lowest - margin, highest + margin
    axes.set_xlim(0, budget)
    axes.set_ylim(bottom, top)
    height = -np.inf
    for last, method in sorted(ends):  # upwards, each name clear of the one below
        height = max((last - bottom) / (top - bottom), height + 0.075)
        axes.text(
            1.025,
            height,
            f"{method}  {last:.2f}",
            transform=axes.transAxes,
            va="center",
            color=colors[method],
            fontsize=9.5,
            fontweight="bold",
        )
    run = next(iter(methods.values()))[0]
    models = f"{run['models']} models, " if run["models"] > 1 else ""
    axes.set_title(
        f"{case}: {models}{run['sensors']} sensors, {run['variables']} variables",
        loc="left",
        fontsize=10.5,
        fontweight="bold",
    )
    axes.set_xlabel("maps rendered")
    axes.set_ylabel("OF3 of the best layout")
    axes.xaxis.set_major_formatter(lambda value, _: f"{value:,.0f}".replace(",", " "))
    axes.grid(True, color="0.9", lw=0.8)
    axes.set_axisbelow(True)
    for side in ("top", "right"):
        axes.spines[side].set_visible(False)


def _stepped(trace: list[tuple[int, float]], grid: np.ndarray) -> np.ndarray:
    """Return the best value after each number of maps; before the first, that of the start."""
    maps, best = np.array(trace).T
    return best[np.maximum(np.searchsorted(maps, grid, side="right") - 1, 0)]


def _grouped(records: list[dict]) -> dict[str, dict[str, list[dict]]]:
    """Return the runs by study and method, in their order."""
    cases: dict[str, dict[str, list[dict]]] = {}
    for record in records:
        cases.setdefault(record["case"], {}).setdefault(record["method"], []).append(record)
    return cases


def _arguments() -> argparse.Namespace:
    """Return what the user wants, checked."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--only", help="studies, with commas: " + ", ".join(BUDGETS))
    parser.add_argument("--methods", help="with commas: " + ", ".join(METHODS))
    parser.add_argument("--maps", type=int, help="that each search may render")
    parser.add_argument("--seeds", type=int, default=3, help="searches a method: seeds 1, 2, ...")
    parser.add_argument("--data", type=Path, metavar="DIR", help="meshes: arms/ and kitchen/")
    parser.add_argument("--workers", type=int, default=os.cpu_count(), help="processes that render")
    parser.add_argument("-o", "--output", type=Path, default=HERE / "out" / "methods")
    arguments = parser.parse_args()
    for name, known in (("only", list(BUDGETS)), ("methods", METHODS)):
        given = getattr(arguments, name)
        chosen = list(known) if given is None else given.split(",")
        unknown = [word for word in chosen if word not in known]
        if unknown:
            parser.error(f"--{name}: no {', '.join(unknown)}; choose from {', '.join(known)}")
        setattr(arguments, name, chosen)
    for name in ("maps", "seeds", "workers"):
        value = getattr(arguments, name)
        if value is not None and value < 1:
            parser.error(f"--{name} {value}: must be at least 1")
    if arguments.data is None and BESIDE.is_dir():
        arguments.data = BESIDE
    if arguments.data is not None and not arguments.data.is_dir():
        parser.error(f"--data {arguments.data}: there is no such folder")
    arguments.data = arguments.data and arguments.data.resolve()
    return arguments


if __name__ == "__main__":
    try:
        sys.exit(main())
    except (StudyError, MachineError) as problem:
        sys.exit(f"compare_methods: {problem}")
