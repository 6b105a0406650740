"""What ``explain`` finds, in sentences and tables."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from glvis.cli.terminal import table
from glvis.cli.wording import quality_lines
from glvis.problem.regions import largest_regions, regions
from glvis.results.explain import (
    REASONS,
    SEEN,
    Floats,
    Integers,
    unseen_reasons,
    values_without,
)
from glvis.results.mounting import DECIMALS
from glvis.results.quality_tables import interference_words
from glvis.results.tables import sensor_table
from glvis.search.placement import Placement

_HARDLY_NEEDED = 0.5  # percent of the faces, or the area, that only one sensor sees


def explain_lines(placement: Placement) -> Iterator[str]:
    """Yield why surface stays unseen, what each sensor is for, how well it sees, thin overlap."""
    reasons = unseen_reasons(placement)
    yield from _unseen_lines(placement, reasons)
    yield ""
    yield from _region_lines(placement, reasons)
    yield ""
    yield from _sensor_lines(placement)
    yield ""
    yield from quality_lines(placement)
    yield ""
    if words := interference_words(placement):
        yield words
        yield ""
    yield from _overlap_lines(placement)


def facing_words(facing: Floats) -> str:
    """Return a direction by the axes it goes along: "-Y", "+X -Z"; "all sides" for zero."""
    named = [
        f"{'+' if value > 0 else '-'}{axis}"
        for value, axis in zip(facing, "XYZ", strict=True)
        if abs(value) > 0.4
    ]
    return " ".join(named) or "all sides"


def _unseen_lines(placement: Placement, reasons: list[Integers]) -> Iterator[str]:
    models = placement.study.models
    shares = np.array(
        [
            [100 * model.areas[why == k].sum() / model.areas.sum() for k in range(len(REASONS))]
            for model, why in zip(models, reasons, strict=True)
        ]
    )
    yield "Unseen area and why, by the sensor that came closest to seeing it"
    reach = placement.reach
    if reach:
        yield f"  (out of reach: no allowed pose sees it, {reach.positions:,} positions tried)"
    for model, row in zip(models, shares, strict=True):
        told = [
            f"{row[k]:.1f} % {REASONS[k]}" for k in np.argsort(-row, kind="stable") if row[k] > 0.05
        ]
        because = f": {', '.join(told)}" if told else ""
        yield f"  {model.name}: {row.sum():.1f} % of the area is unseen{because}"
    if len(models) > 1:
        kept = [k for k in range(len(REASONS)) if shares[:, k].any()]
        rows = [
            [model.name, f"{row.sum():.2f}", *(f"{row[k]:.2f}" for k in kept)]
            for model, row in zip(models, shares, strict=True)
        ]
        mean = shares.mean(axis=0)
        rows.append(["mean", f"{mean.sum():.2f}", *(f"{mean[k]:.2f}" for k in kept)])
        yield ""
        yield from table(["% of the area", "unseen", *(REASONS[k] for k in kept)], rows)


def _region_lines(placement: Placement, reasons: list[Integers]) -> Iterator[str]:
    study = placement.study
    yield "Largest unseen regions"
    rows = []
    for model, why in zip(study.models, reasons, strict=True):
        total = model.areas.sum()
        for region in largest_regions(model, why != SEEN):
            areas = np.bincount(
                why[region.faces], model.areas[region.faces], minlength=len(REASONS)
            )
            rows.append(
                (
                    model.name,
                    f"{100 * region.area / total:.1f} %",
                    region.n_faces,
                    _place(region.centre, study.unit),
                    facing_words(region.facing),
                    REASONS[int(areas.argmax())],
                )
            )
    if not rows:
        yield "  none of a thousandth of a model or more"
        return
    parts = "pieces" if any(model.pieces for model in study.models) else "faces"
    yield from table(("model", "area", parts, f"around [{study.unit}]", "facing", "mostly"), rows)


def _sensor_lines(placement: Placement) -> Iterator[str]:
    study = placement.study
    kind = study.objective.label
    noun, sensors = sensor_table(study.models, placement.maps, study.objective.by_area)
    without = values_without(placement)
    yield f"Sensors: what each sees alone and what is lost without it ({noun}, mean over models)"
    yield from table(
        ("sensor", "alone %", "lost without it %", f"{kind} without it", "change"),
        [
            (name, f"{seen:.1f}", f"{only_it:.1f}", f"{value:.4f}",
             f"{value - placement.value:+.4f}")
            for (name, seen, only_it), value in zip(sensors, without, strict=True)
        ],
    )  # fmt: skip
    if len(sensors) > 1:
        spare = [name for name, _, only_it in sensors if only_it < _HARDLY_NEEDED]
        if spare:
            yield (
                f"  Hardly needed for coverage (each alone; only it sees less than "
                f"{_HARDLY_NEEDED:g} %): {', '.join(spare)}"
            )


def _overlap_lines(placement: Placement) -> Iterator[str]:
    study = placement.study
    yield "Where overlap is thin: area by the number of sensors that see it, and the largest"
    yield "region that only one sees"
    rows: list[tuple[object, ...]] = []
    most = min(4, len(study.sensors))
    for model, found in zip(study.models, placement.maps, strict=True):
        counts, total = found.counts, model.areas.sum()
        exactly = [
            f"{100 * model.areas[counts >= n if n == most else counts == n].sum() / total:.1f} %"
            for n in range(most + 1)
        ]
        thin = regions(model, counts == 1, 1)
        where: list[object] = ["", "", ""]
        if thin:
            seers = found.visible[:, thin[0].faces] @ model.areas[thin[0].faces]
            where = [
                f"{100 * thin[0].area / total:.1f} %",
                _place(thin[0].centre, study.unit),
                found.sensor_names[int(seers.argmax())],
            ]
        rows.append((model.name, *exactly, *where))
    numbers = [f"{n}+" if n == most else str(n) for n in range(most + 1)]
    yield from table(("model", *numbers, "region", f"around [{study.unit}]", "mostly by"), rows)


def _place(point: Floats, unit: str) -> str:
    places = max(0, DECIMALS.get(unit, 2) - 1)
    return "(" + ", ".join(f"{value + 0.0:.{places}f}" for value in np.round(point, places)) + ")"
