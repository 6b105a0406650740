"""How good the views of a placement are, and how its projectors disturb each other, as rows."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from glvis.errors import MachineError
from glvis.evaluation.interference import Interference
from glvis.evaluation.view_quality import is_known, view_quality
from glvis.problem.sensor import Sensor
from glvis.problem.units import fine_unit
from glvis.search.placement import Placement

Floats = NDArray[np.float64]

WORST = 5.0  # percent of the faces that a sensor sees worst
# What is told of each sensor, and in which unit; "" is a length.
TOLD = {"pixel_size": "", "depth_error": "", "blur": "pixels"}
INTERFERENCE = "interference_area_percentage"  # column of coverage.csv


@dataclass(frozen=True)
class Spread:
    """A number over the faces that a sensor sees: its median, and what the worst 5 % exceed."""

    median: float
    worst: float


@dataclass(frozen=True)
class QualityRow:
    """How well one sensor sees what it sees, over all models.

    Attributes
    ----------
    name : str
        Of the sensor.
    numbers : dict of str to Spread or None
        By the names of ``TOLD``, lengths in the study's unit; None where the sensor sees nothing,
        or does not state what the number follows from.
    """

    name: str
    numbers: dict[str, Spread | None]


def quality_rows(placement: Placement) -> list[QualityRow]:
    """Return one row a sensor, in their order; faces are pieces where faces were cut."""
    study, rows = placement.study, []
    for s, (name, sensor) in enumerate(zip(study.sensor_names, study.sensors, strict=True)):
        pose = placement.camera_to_world[s]
        views = [
            view_quality(model.centroids[seen], model.normals[seen], pose, sensor)
            for model, found in zip(study.models, placement.maps, strict=True)
            for seen in [found.visible[s]]
        ]
        rows.append(
            QualityRow(name, {k: _spread(np.concatenate([v.of(k) for v in views])) for k in TOLD})
        )
    return rows


def known_names(sensors: Sequence[Sensor]) -> list[str]:
    """Return the names of ``TOLD`` that some of the sensors state."""
    return [name for name in TOLD if is_known(name, sensors)]


def has_quality_columns(sensors: Sequence[Sensor]) -> bool:
    """Return whether tables of sensors tell how good views are.

    Where all are the paper's ideal pinholes and state neither noise, focus nor light, tables stay
    as they have always been; ``result.json`` and ``explain`` tell of these as well.
    """
    return any(s.noise or s.focus or s.emits or not s.is_ideal for s in sensors)


def quality_columns(placement: Placement) -> tuple[list[str], list[list[float | str]]]:
    """Return headers with units and a row a sensor for ``sensors.csv``; "" for what is not known.

    Lengths are in the study's unit. Nothing where ``has_quality_columns`` says so.
    """
    sensors, unit = placement.study.sensors, placement.study.unit
    if not has_quality_columns(sensors):
        return [], [[] for _ in sensors]
    names = known_names(sensors)
    header = [
        f"{name}_{what}_{TOLD[name] or unit}"
        for name in names
        for what in ("median", f"worst_{WORST:g}_percent")
    ]
    rows: list[list[float | str]] = []
    for row in quality_rows(placement):
        spreads = [row.numbers[name] for name in names]
        rows.append([n for s in spreads for n in ((s.median, s.worst) if s else ("", ""))])
    return header, rows


def quality_table(placement: Placement) -> tuple[list[str], list[list[str]]]:
    """Return the same for people: units that suit the numbers, three digits."""
    study, rows = placement.study, quality_rows(placement)
    header, columns = ["sensor"], [[row.name for row in rows]]
    for name in known_names(study.sensors):
        spreads = [row.numbers[name] for row in rows]
        known = [spread.median for spread in spreads if spread]
        factor, unit = 1.0, TOLD[name]
        if not unit:
            factor, unit = fine_unit(float(np.median(known)) if known else 1.0, study.unit)
        header += [f"{name.replace('_', ' ')} [{unit}]", f"worst {WORST:g} % [{unit}]"]
        for what in ("median", "worst"):
            columns.append([_digits(factor * getattr(s, what)) if s else "-" for s in spreads])
    return header, [list(row) for row in zip(*columns, strict=True)]


def known_interference(placement: Placement) -> Interference | None:
    """Return how projectors disturb each other; None where no two could, or no OpenGL is here."""
    try:
        return placement.interference
    except MachineError:  # maps were made on other machines
        return None


def interference_of_model(found: Interference, placement: Placement, m: int) -> dict[str, Any]:
    """Return what ``result.json`` says of the light on a model: percent of its area."""
    model = placement.study.models[m]
    return {
        "area_percentage": 100 * found.disturbed_share(m, model),
        "by_group": {
            group: 100 * found.disturbed_share(m, model, g) for g, group in enumerate(found.groups)
        },
    }


def interference_table(placement: Placement) -> tuple[list[str], list[list[str | float]]] | None:
    """Return header and rows, a model and the mean of several: percent of the area disturbed."""
    found = known_interference(placement)
    if found is None:
        return None
    models = placement.study.models
    groups = [None, *(range(len(found.groups)) if len(found.groups) > 1 else [])]
    shares = np.array(
        [
            [100 * found.disturbed_share(m, model, g) for g in groups]
            for m, model in enumerate(models)
        ]
    )
    rows: list[list[str | float]] = [
        [model.name, *row] for model, row in zip(models, shares.tolist(), strict=True)
    ]
    if len(models) > 1:
        rows.append(["mean", *shares.mean(axis=0).tolist()])
    header = ["model", "disturbed %", *(f"'{found.groups[g]}' %" for g in groups if g is not None)]
    return header, rows


def interference_words(placement: Placement) -> str:
    """Return in a sentence how much area projectors spoil for each other; "" where none do."""
    found, study = known_interference(placement), placement.study
    if found is None:
        return ""
    shares = [100 * found.disturbed_share(m, model) for m, model in enumerate(study.models)]
    who = "; ".join(
        f"'{group}': {', '.join(study.sensor_names[s] for s in members)}"
        for group, members in zip(found.groups, found.members, strict=True)
    )
    told = f"{np.mean(shares):.1f} % of the area"
    if len(shares) > 1:
        worst = int(np.argmax(shares))
        told += f" (mean over models; {study.models[worst].name} {shares[worst]:.1f} %)"
    return f"Interference: {told} is lit by two or more projectors of one group ({who})"


def _digits(value: float) -> str:
    """Return a number with three significant digits, no fewer: "0.320"."""
    text = f"{float(f'{value:.3g}'):#.3g}"
    return f"{value:.0f}" if "e" in text and value >= 1 else text.rstrip(".")


def _spread(values: Floats) -> Spread | None:
    """Return the median and the 95th percentile of what is known."""
    known = values[np.isfinite(values)]
    if not len(known):
        return None
    return Spread(*np.percentile(known, [50, 100 - WORST]).tolist())
