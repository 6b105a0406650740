"""A series of runs in tables of text: what is planned, and what came of it."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from pathlib import Path

from glvis.cli.terminal import table
from glvis.common.hints import command
from glvis.reports.series_tables import kind_of
from glvis.results.spread import Apart, Spread, Statistic
from glvis.results.vary import Plan, PlannedRun, value_text


def plan_lines(plan: Plan) -> Iterator[str]:
    """Yield all runs that are planned, and what they cost at most."""
    runs = plan.runs
    yield f"{_counted(len(runs), 'run')}: {_what(plan)}"
    rows = []
    for point in plan.points:
        own = [run for run in runs if run.point is point]
        rows.append(
            (
                *map(value_text, point.values.values()),
                _range([run.name for run in own]),
                _range([run.seed for run in own]),
                len(point.sensors),
                point.variables,
                point.run_maps,
                point.run_maps * len(own),
            )
        )
    header = ("runs", "seeds", "sensors", "variables", "maps a run, at most", "maps")
    yield from table((*plan.vary, *header), rows)
    yield (
        f"At most {sum(run.point.run_maps for run in runs):,} maps in all, and at most as "
        "many again to learn what is within reach"
    )


def run_line(plan: Plan, run: PlannedRun) -> str:
    """Return which run begins."""
    values = f"{run.point.label}, " if run.point.values else ""
    return f"{run.name} of {len(plan.runs)} ({values}seed {run.seed})"


def series_lines(plan: Plan, spreads: Sequence[Spread], directory: Path) -> Iterator[str]:
    """Yield what a series has found so far."""
    if not any(one.outcomes for one in spreads):
        yield "No run has finished"
    elif plan.vary:
        yield from _vary_lines(plan, spreads)
    else:
        yield from _repeat_lines(plan, spreads[0], directory)
    finished, kind = sum(len(one.outcomes) for one in spreads), kind_of(plan)
    yield ""
    if finished < len(plan.runs):
        yield (
            f"{finished} of {len(plan.runs)} runs are finished; "
            f"{command('optimize', '--resume', directory)} goes on"
        )
    yield f"Results: {directory} ({kind}.csv, {kind}.json, {kind}.png, run-01/, ...)"


def _repeat_lines(plan: Plan, found: Spread, directory: Path) -> Iterator[str]:
    """Yield a row a run, their statistics, how far their poses lie apart, the best."""
    assert found.best and found.value and found.percentage and found.area_percentage
    unit, kind = plan.unit, found.point.quantity
    rows: list[tuple[object, ...]] = []
    for one, far in zip(found.outcomes, found.distances, strict=True):
        away = ("", "") if one is found.best else (f"{far.max_position:.4g}", _angle(far))
        seen = f"{one.percentage:.2f}", f"{one.area_percentage:.2f}"
        rows.append((one.run.name, one.run.seed, f"{one.value:.6g}", *seen, one.maps_rendered,
                     *away))  # fmt: skip
    yield from table(
        ("run", "seed", kind, "seen %", "area %", "maps", f"moved [{unit}]", "turned [deg]"), rows
    )
    yield "moved, turned: the sensor that lies farthest from its like in the best run"
    yield ""
    statistics = ((kind, found.value), ("seen %", found.percentage),
                  ("area %", found.area_percentage))  # fmt: skip
    yield from table(
        ("", "mean", "std", "best", "worst"), [(name, *_numbers(one)) for name, one in statistics]
    )
    if found.apart:
        yield (
            f"Poses differ from the best run's by {found.apart.mean_position:.3g} {unit} and "
            f"{found.apart.mean_angle_deg:.3g} deg in the mean, at most "
            f"{found.apart.max_position:.3g} {unit} and {_angle(found.apart)} deg"
        )
    yield f"Best: {directory / found.best.run.name}"


def _vary_lines(plan: Plan, spreads: Sequence[Spread]) -> Iterator[str]:
    """Yield a row a point."""
    quantities = {one.point.quantity for one in spreads}
    kind = quantities.pop() if len(quantities) == 1 else "value"
    several = plan.repeats > 1
    header = [*plan.vary, "sensors", "runs", kind]
    header += ["std", "best", "seen %", "std", "area %"] if several else ["seen %", "area %"]
    header += [f"apart [{plan.unit}]", "best run"] if several else ["run"]
    rows: list[list[object]] = []
    for one in spreads:
        row: list[object] = [*map(value_text, one.point.values.values())]
        row += [len(one.point.sensors), len(one.outcomes)]
        if one.best and one.value and one.percentage and one.area_percentage:
            mean, std, best, _ = _numbers(one.value)
            row += [mean, std, best] if several else [mean]
            row += [f"{one.percentage.mean:.2f}"]
            row += [_numbers(one.percentage)[1]] if several else []
            row += [f"{one.area_percentage.mean:.2f}"]
            if several:
                row += [f"{one.apart.max_position:.4g}" if one.apart else ""]
            row += [one.best.run.name]
        rows.append(row + [""] * (len(header) - len(row)))
    yield from table(header, rows)
    if several:
        yield "apart: how far, at most, a sensor lies from its like in the best run"


def _numbers(one: Statistic) -> tuple[str, str, str, str]:
    std = "" if one.std is None else f"{one.std:.3g}"
    return f"{one.mean:.6g}", std, f"{one.best:.6g}", f"{one.worst:.6g}"


def _angle(far: Apart) -> str:
    return f"{far.max_angle_deg:.3g}"


def _what(plan: Plan) -> str:
    """Return how a series comes to its number of runs."""
    combinations = _counted(len(plan.points), "combination") + " of the varied values"
    seeds = f"{plan.repeats} seeds"
    if not plan.vary:
        return seeds if plan.repeats > 1 else "one seed"
    return f"{combinations}, {seeds} each" if plan.repeats > 1 else combinations


def _range(parts: Sequence[object]) -> str:
    """Return "1", "1 to 3", or "run-01, run-04, ..."."""
    if len(parts) < 4:
        return ", ".join(map(str, parts))
    return f"{parts[0]}, {parts[1]} ... {parts[-1]}"


def _counted(number: int, what: str) -> str:
    return f"{number:,} {what}{'' if number == 1 else 's'}"
