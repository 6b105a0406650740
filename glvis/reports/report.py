"""What the page shows of a placement: the scene, the maps, the tables, the facts."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np

from glvis.evaluation.view_quality import quality_of_views
from glvis.problem.units import fine_unit
from glvis.results.explain import refusals_of
from glvis.results.mounting import mounting_lines
from glvis.results.quality_tables import (
    TOLD,
    interference_table,
    interference_words,
    known_names,
    quality_rows,
    quality_table,
)
from glvis.results.result import versions
from glvis.results.tables import mean_row, model_rows, sensor_table
from glvis.results.within_reach import reach_table, reach_words
from glvis.search.placement import Placement
from glvis.viewer.page_data import (
    PageData,
    PageModel,
    PageObstacle,
    PageQuality,
    PageSensor,
    PageTable,
    PageTrace,
)

_SHARES = {"percentage": "seen %", "area_percentage": "area seen %"}
# What the page says of the view of a face; # is the number with its unit.
_READINGS = {"pixel_size": "# a pixel", "depth_error": "depth error #", "blur": "blur #"}
_MOST_VIEWS = 1 << 25  # faces times sensors; a byte of the page for each number of each of them
_COUNTS = {
    "total": "faces",
    "unique_seen": "unique seen",
    "seen_by_all_cameras": "seen, by all sensors",
}


def page_data(placement: Placement, left_out: Sequence[str] = ()) -> PageData:
    """Return all that the page of a placement shows; ``left_out`` is said of the pictures."""
    study = placement.study
    return PageData(
        title=study.title,
        unit=study.unit,
        up=study.up,
        models=[
            PageModel(
                model.name,
                model.vertices,
                model.faces,
                found.visible,
                model.pieces.file_face if model.pieces else None,
                refusals_of(model, study, placement.camera_to_world),
                qualities,
            )
            for model, found, qualities in zip(
                study.models, placement.maps, _qualities(placement), strict=True
            )
        ],
        sensors=[
            PageSensor.of(name, sensor, pose)
            for name, sensor, pose in zip(
                study.sensor_names, study.sensors, placement.camera_to_world, strict=True
            )
        ],
        obstacles=[PageObstacle(m.name, m.vertices, m.faces) for m in study.obstacles],
        tables=[
            _coverage(placement),
            *_reach(placement),
            _sensors(placement),
            _quality(placement),
            *_interference(placement),
        ],
        trace=_trace(placement),
        facts=[*_facts(placement), *(("Pictures", text) for text in _bare(left_out))],
        mounting=mounting_lines(placement),
        by_area=study.objective.by_area,
        incidence=study.visibility.incidence,
    )


def _bare(sentences: Sequence[str]) -> list[str]:
    """Return sentences without the word that they begin with."""
    return [sentence.partition(": ")[2] for sentence in sentences]


def _coverage(placement: Placement) -> PageTable:
    """Return what is seen of each model: shares first, the page is narrow."""
    study = placement.study
    rows = model_rows(study.models, placement.maps, study.objective)
    several = range(2, len(study.sensors) + 1)
    shares = dict(reversed(_SHARES.items())) if study.objective.by_area else _SHARES
    body: list[list[str | float]] = [
        [
            row.name,
            *(getattr(row, name) for name in shares),
            *(100 * row.shares_seen_by[n - 1] for n in several),
            *(getattr(row, name) for name in _COUNTS),
        ]
        for row in rows
    ]
    if len(rows) > 1:
        mean = mean_row(rows)
        by_number = [100 * mean[f"share_seen_by_{n}"] for n in several]
        numbers = [*(mean[name] for name in shares), *by_number]
        body.append(["mean", *numbers, *(round(mean[name]) for name in _COUNTS)])
    names = [*shares.values(), *(f"by {n}+ %" for n in several), *_COUNTS.values()]
    return PageTable("Faces seen", ["model", *names], body)


def _reach(placement: Placement) -> list[PageTable]:
    if placement.reach is None:
        return []
    header, rows = reach_table(placement, len(placement.study.sensors))
    return [PageTable("Within reach", header, rows, reach_words(placement.reach))]


def _sensors(placement: Placement) -> PageTable:
    study = placement.study
    noun, rows = sensor_table(study.models, placement.maps, study.objective.by_area)
    return PageTable(
        "Sensors",
        ["sensor", "sees %", "only it sees %"],
        rows,
        f"Of the {noun}, the mean over models. What only it sees would be lost without it.",
    )


def _quality(placement: Placement) -> PageTable:
    return PageTable(
        "How good the views are",
        *quality_table(placement),
        "The median over the faces that each sensor sees, and what the worst of them exceed.",
    )


def _interference(placement: Placement) -> list[PageTable]:
    table = interference_table(placement)
    return [PageTable("Interference", *table, f"{interference_words(placement)}.")] if table else []


def _qualities(placement: Placement) -> Iterator[list[PageQuality]]:
    """Yield how good each sensor's view of each face is, model by model; nothing of too many."""
    study = placement.study
    n_views = len(study.sensors) * sum(model.n_faces for model in study.models)
    rows = quality_rows(placement) if n_views <= _MOST_VIEWS else []
    units: dict[str, tuple[float, str]] = {}
    for name in known_names(study.sensors) if rows else []:
        typical = [spread.median for row in rows if (spread := row.numbers[name])]
        length = float(np.median(typical)) if typical else 1.0
        units[name] = (1.0, "px") if TOLD[name] else fine_unit(length, study.unit)
    for model in study.models:
        if not units:
            yield []
            continue
        views = quality_of_views(
            model.centroids, model.normals, placement.camera_to_world, study.sensors
        )
        yield [
            PageQuality(_READINGS[name], unit, np.float32(factor * views.of(name)))
            for name, (factor, unit) in units.items()
        ]


def _trace(placement: Placement) -> PageTrace | None:
    rows = placement.trace
    if not rows:
        return None
    return PageTrace(
        [row.iteration for row in rows], [row.best for row in rows], [row.mean for row in rows]
    )


def _facts(placement: Placement) -> list[tuple[str, str]]:
    study, gl = placement.study, placement.gl
    facts = [("Objective", f"{study.objective.label} = {placement.value:.6g}")]
    if placement.trace:
        facts += [
            ("At the start", f"{placement.start_value:.6g}"),
            ("Search", placement.stop_reason),
            ("Seed", str(placement.seed)),
            ("Evaluations", f"{placement.evaluations:,}"),
            ("Maps rendered", f"{placement.maps_rendered:,}"),
        ]
    return [
        *facts,
        ("Criterion", study.visibility.semantics or study.visibility.criterion),
        ("OpenGL", f"{gl.renderer}, {gl.version}"),
        ("Made by", f"glvis {versions()['glvis']}"),
    ]
