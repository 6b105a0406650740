"""A series of runs as tables, index and plot; its runs are read from their own results."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict
from pathlib import Path
from typing import Any

from glvis.pictures.seriesplots import Line, Panel, TracedRun, write_repeats, write_vary
from glvis.results.folder import SERIES, write_index
from glvis.results.journal import machine_errors, whole_file
from glvis.results.reading import read_trace
from glvis.results.result import SCHEMA, TRACE, versions, write_csv
from glvis.results.spread import Apart, Spread, Statistic, outcomes_of, spread
from glvis.results.vary import Plan, key_label, label_of, value_text
from glvis.study.overrides import toml_text

RUNS = "runs.csv"  # beside the table of varied keys, which has a row a point
FILES = (
    *(RUNS, *SERIES, "vary.csv", "vary.png", "repeats.csv", "repeats.png"),
    *("sweep.csv", "sweep.png"),  # of earlier builds
)
_NUMBERS = (
    *("value", "percentage", "area_percentage"),
    *("iterations", "evaluations", "maps_rendered"),
)
_DISTANCES = tuple(Apart.__dataclass_fields__)


def kind_of(plan: Plan) -> str:
    """Return what the files of a series are called: "vary" or "repeats"."""
    return "vary" if plan.vary else "repeats"


def write_series(directory: Path, plan: Plan) -> list[Spread]:
    """Write the tables and the index of what is known so far; return it by point."""
    outcomes = outcomes_of(directory, plan)
    spreads = [spread(point, outcomes) for point in plan.points]
    known = {one.run.name: one for one in outcomes}
    far = {
        outcome.run.name: asdict(distance)
        for one in spreads
        for outcome, distance in zip(one.outcomes, one.distances, strict=True)
    }
    rows, entries = [], []
    for run in plan.runs:
        found = known.get(run.name)
        state = "finished" if found and found.is_finished else "interrupted"
        entry = {"run": run.name, "values": dict(run.point.values), "seed": run.seed}
        entry["state"] = state if found else "waiting"
        if found:
            numbers = {name: getattr(found, name) for name in _NUMBERS}
            distances = far.get(run.name, dict.fromkeys(_DISTANCES))
            entry |= numbers | {"apart_from_best": distances, "stop_reason": found.stop_reason}
            row = [run.name, *map(_cell, run.point.values.values()), run.seed, *numbers.values()]
            rows.append([*row, *distances.values(), found.stop_reason])
        entries.append(entry)
    kind, keys, points = kind_of(plan), list(plan.vary), [_point_entry(one) for one in spreads]
    header = ["run", *keys, "seed", *_NUMBERS]
    header += [f"{name}_from_best" for name in _DISTANCES] + ["stop_reason"]
    with machine_errors(directory):
        _write_table(directory / (RUNS if plan.vary else f"{kind}.csv"), header, rows)
        if plan.vary:
            _write_table(directory / f"{kind}.csv", *_table_of_points(keys, spreads))
        write_index(
            directory / f"{kind}.json",
            {
                "glvis_schema": SCHEMA,
                "title": plan.title,
                "unit": plan.unit,
                "vary": dict(plan.vary),
                "repeats": plan.repeats,
                "planned": len(plan.runs),
                "finished": sum(len(one.outcomes) for one in spreads),
                # each point of varied keys has its own: more sensors see more, and say nothing
                "best": None if plan.vary else points[0]["best"],
                "points": points,
                "runs": entries,
                "versions": versions(),
            },
        )
    return spreads


def write_plot(directory: Path, plan: Plan, spreads: Sequence[Spread]) -> None:
    """Write ``repeats.png`` or ``vary.png``, if any run has finished."""
    if not any(one.outcomes for one in spreads):
        return
    path = directory / f"{kind_of(plan)}.png"
    quantities = {one.point.quantity for one in spreads}
    if not plan.vary:
        runs = []
        for one in spreads[0].outcomes:
            trace = read_trace(directory / one.run.name / TRACE)
            maps, best = [row.maps_rendered for row in trace], [row.best for row in trace]
            runs.append(
                TracedRun(one.run.name, one.run.seed, maps, best, one.value, one.percentage)
            )
        title = f"{plan.title}: {len(runs)} runs with different seeds"
        with machine_errors(directory), whole_file(path) as part:
            write_repeats(part, runs, title=title, quantity=quantities.pop())
        return
    key = _along(plan)
    shown = ["percentage", "area_percentage"]
    names = {"percentage": "faces seen [%]", "area_percentage": "area seen [%]"}
    if len(quantities) == 1:  # values of different objectives have no common axis
        shown, names["value"] = ["value", "percentage"], quantities.pop()
    panels = [Panel(names[name], _lines(plan, spreads, name)) for name in shown]
    with machine_errors(directory), whole_file(path) as part:
        write_vary(
            part,
            panels,
            title=plan.title,
            x_label=key_label(key, plan.unit),
            ticks=_ticks(plan.vary[key]),
            are_numbers=_are_numbers(plan.vary[key]),
        )


def _along(plan: Plan) -> str:
    """Return the key that the plot has along x: the first one of numbers, if there is any."""
    numbers = (key for key, values in plan.vary.items() if _are_numbers(values))
    return next(numbers, next(iter(plan.vary)))


def _lines(plan: Plan, spreads: Sequence[Spread], name: str) -> list[Line]:
    """Return a line for each combination of the other keys, along one of them."""
    along = _along(plan)
    places = [place for place, _ in _ticks(plan.vary[along])]
    lines: dict[str, Line] = {}
    for one in spreads:
        others = {key: value for key, value in one.point.values.items() if key != along}
        line = lines.setdefault(toml_text(others), Line(label_of(others), places, []))
        line.values.append([getattr(found, name) for found in one.outcomes])
    return list(lines.values())


def _ticks(values: Sequence[Any]) -> list[tuple[float, str]]:
    """Return where varied values lie along an axis: numbers at their place, the rest in order."""
    if _are_numbers(values):
        return [(float(value), f"{value:g}") for value in values]
    return [(float(place), value_text(value).strip("'")) for place, value in enumerate(values)]


def _are_numbers(values: Sequence[Any]) -> bool:
    return all(isinstance(v, int | float) and not isinstance(v, bool) for v in values)


def _cell(value: Any) -> Any:
    """Return a varied value as a cell of a table."""
    return value if isinstance(value, int | float | str) else toml_text(value)


def _table_of_points(
    keys: Sequence[str], spreads: Sequence[Spread]
) -> tuple[list[str], list[list[Any]]]:
    """Return header and rows of the table of points."""
    header = [*keys, "sensors", "variables", "finished", "best"]
    names, parts = ("value", "percentage", "area_percentage"), Statistic.__dataclass_fields__
    header += [f"{name}_{part}" for name in names for part in parts]
    header += [f"{name}_from_best" for name in _DISTANCES]
    rows = []
    for one in spreads:
        row = [*map(_cell, one.point.values.values()), len(one.point.sensors)]
        row += [one.point.variables, len(one.outcomes), one.best.run.name if one.best else None]
        for found, fields in (
            (one.value, parts),
            (one.percentage, parts),
            (one.area_percentage, parts),
            (one.apart, _DISTANCES),
        ):
            row += [found and getattr(found, field) for field in fields]
        rows.append(row)
    return header, rows


def _point_entry(found: Spread) -> dict[str, Any]:
    """Return a point as the index holds it."""
    return {
        "values": dict(found.point.values),
        "objective": found.point.quantity,
        "sensors": len(found.point.sensors),
        "variables": found.point.variables,
        "finished": len(found.outcomes),
        "best": found.best and found.best.run.name,
        "value": found.value and asdict(found.value),
        "percentage": found.percentage and asdict(found.percentage),
        "area_percentage": found.area_percentage and asdict(found.area_percentage),
        "apart_from_best": found.apart and asdict(found.apart),
    }


def _write_table(path: Path, header: Sequence[str], rows: Sequence[Sequence[Any]]) -> None:
    """Write a table; until it is whole, the one before stays."""
    with whole_file(path) as part:
        write_csv(part, header, rows)
