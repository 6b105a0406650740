"""What ``glvis compare`` says: layouts side by side in numbers, and against the first."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

from glvis.cli.terminal import duration, table
from glvis.reports.compare import (
    Layout,
    cut_alike,
    have_one_unit,
    noun_of,
    percentages,
    sensor_moves,
    shared_models,
)
from glvis.results.tables import mean_row, model_rows


def comparison_rows(layouts: Sequence[Layout]) -> list[list[str]]:
    """Return the table of numbers: what it is, then one column a layout."""
    placements = [layout.placement for layout in layouts]
    studies = [placement.study for placement in placements]
    models = [
        model_rows(study.models, placement.maps, study.objective)
        for study, placement in zip(studies, placements, strict=True)
    ]
    means = [mean_row(rows) for rows in models]
    kinds = [study.objective.label for study in studies]
    label = kinds[0] if len(set(kinds)) == 1 else "objective"
    rows = [["sensors", *(str(len(study.sensors)) for study in studies)]]
    rows.append(
        [label]
        + [
            f"{placement.value:.4f}" + ("" if len(set(kinds)) == 1 else f" ({kind})")
            for placement, kind in zip(placements, kinds, strict=True)
        ]
    )
    rows.append(["seen, mean %", *(f"{mean['percentage']:.2f}" for mean in means)])
    rows.append(["area seen, mean %", *(f"{mean['area_percentage']:.2f}" for mean in means)])
    for n in range(2, min(4, max(len(study.sensors) for study in studies)) + 1):
        shares = [mean.get(f"share_seen_by_{n}") for mean in means]
        rows.append([f"by {n}+, mean %", *("" if s is None else f"{100 * s:.2f}" for s in shares)])
    names = list(dict.fromkeys(row.name for found in models for row in found))
    for name in names if len(names) > 1 else []:
        seen = [{row.name: row.percentage for row in found}.get(name) for found in models]
        rows.append([f"{name} seen %", *("" if s is None else f"{s:.2f}" for s in seen)])
    rows.append(["evaluations", *(f"{placement.evaluations:,}" for placement in placements)])
    rows.append(["time", *(duration(placement.seconds) for placement in placements)])
    return rows


def comparison_lines(layouts: Sequence[Layout]) -> Iterator[str]:
    """Yield the table, and against the first layout: gains, losses, how far sensors moved."""
    given, layouts = layouts, cut_alike(layouts)
    first, *others = layouts
    yield from table(["", *(layout.name for layout in layouts)], comparison_rows(layouts))
    for one, before in zip(layouts, given, strict=True):
        if one.placement is not before.placement:
            yield (
                f"{one.name} is told by the finer pieces of others; by its own its objective was "
                f"{before.placement.value:.4f}"
            )
    models = shared_models(layouts)
    for other in others:
        if models:
            noun = noun_of(first, models)
            yield ""
            yield f"{other.name} against {first.name}, % of the {noun}"
            yield from table(
                ("model", "both see", f"only {first.name}", f"only {other.name}", "neither"),
                [
                    (name, *(f"{value:.2f}" for value in percentages(first, other, name, noun)))
                    for name in models
                ],
            )
        moved = sensor_moves(first.placement, other.placement)
        if moved:
            unit = first.placement.study.unit
            yield ""
            yield f"Sensors of {other.name} against those of {first.name}"
            yield from table(
                ("sensor", f"moved [{unit}]", "turned [deg]"),
                [
                    (name, f"{round(far, 6):.4g}", f"{round(turn, 4):.3g}")
                    for name, far, turn in moved
                ],
            )
    if not models:
        yield ""
        units = "" if have_one_unit(layouts) else " in one unit"
        yield f"No model is the same mesh{units} in all layouts: what they see cannot be compared"
