"""The result of a run as files, written for people and programs; ``reading`` reads them.

Format of ``result.json``, version 1; every float is written so that reading gives it back bit
for bit. All but ``run``, ``gl`` and ``versions`` is the same for the same study and seed.
"""

from __future__ import annotations

import csv
import hashlib
import io
import math
import platform
import time
import zipfile
from collections.abc import Iterable, Mapping, Sequence
from importlib import metadata
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from glvis import __version__
from glvis.problem.camera import angles_from_direction, position_direction_roll
from glvis.problem.scene import Model
from glvis.problem.visibility_options import render_resolution
from glvis.results.folder import INDEX, STUDY, write_index
from glvis.results.journal import files_below, write_whole
from glvis.results.quality_tables import (
    INTERFERENCE,
    WORST,
    QualityRow,
    interference_of_model,
    known_interference,
    quality_columns,
    quality_rows,
)
from glvis.results.tables import mean_row, mean_terms, model_rows, sensor_rows
from glvis.results.within_reach import reach_rows
from glvis.search.placement import Placement, TraceRow
from glvis.study.sensor_table import sensor_table
from glvis.visibility.folding import fold_counts, folded, seen_share
from glvis.visibility.visibility_map import VisibilityMap

SCHEMA = 1
COVERAGE, SENSORS, TRACE, MAPS = "coverage.csv", "sensors.csv", "trace.csv", "visibility.npz"
REACH = "reach.npz"

SENSOR_NAMES = "sensors"  # the key of visibility.npz that is no model
# After a model's name, where its faces were cut: the share of each face of the file that is seen,
# what was found for the pieces, and which of the file's faces each of them is a piece of.
SEEN_SHARE, PIECES, PIECE_OF = ":seen_share", ":pieces", ":piece_of"
_FORMULAS = ("=", "+", "-", "@", "\t", "\r")  # how a cell begins that spreadsheets run
_PACKAGES = ("moderngl", "glcontext", "numpy", "trimesh", "pyswarms", "scipy", "pillow")


def write_data(placement: Placement, directory: Path) -> None:
    """Write all files but pictures and ``result.json``.

    Parameters
    ----------
    placement : Placement
        What was found.
    directory : Path
        An existing folder.
    """
    study = placement.study
    rows = model_rows(study.models, placement.maps, study.objective)
    write_whole(directory / STUDY, study.text)  # a search may have to go on with it
    shares = [f"seen_by_{n}_percentage" for n in range(1, len(study.sensor_names) + 1)]
    columns = ["seen_by_all_cameras", "unique_seen", "total", "percentage", "area_percentage"]
    mean = mean_row(rows)
    lit = [row["area_percentage"] for row in _interference(placement) if row]
    write_csv(
        directory / COVERAGE,
        ["model", *columns, *shares[1:], "value", *([INTERFERENCE] if lit else [])],
        [
            [
                row.name,
                *(getattr(row, name) for name in columns),
                *(100 * share for share in row.shares_seen_by[1:]),
                row.terms["value"],
                *lit[m : m + 1],
            ]
            for m, row in enumerate(rows)
        ]
        + [
            [
                "mean",
                *(mean[name] for name in columns),
                *(100 * mean[f"share_seen_by_{n + 1}"] for n in range(1, len(shares))),
                mean_terms(rows)["value"],
                *([float(np.mean(lit))] if lit else []),
            ]
        ],
    )
    sensors = sensor_rows(study.models, placement.maps)
    kinds = [sensor.name for sensor in study.sensors]
    numbers = _sensor_columns(study.models)
    further, quality = quality_columns(placement)
    write_csv(
        directory / SENSORS,
        ["sensor", "kind", *numbers, *further],
        [
            [row.name, kind, *(getattr(row, name) for name in numbers), *more]
            for row, kind, more in zip(sensors, kinds, quality, strict=True)
        ],
    )
    write_csv(directory / TRACE, TraceRow._fields, placement.trace)
    arrays: dict[str, NDArray[Any]] = {}
    for model, found in zip(study.models, placement.maps, strict=True):
        arrays[model.name] = folded(found, model).visible
        if model.pieces:
            share = seen_share(found.visible, model)
            arrays[model.name + SEEN_SHARE] = share.astype(np.float32)
            arrays[model.name + PIECES] = found.visible
            arrays[model.name + PIECE_OF] = model.pieces.file_face
    write_npz(directory / MAPS, arrays | {SENSOR_NAMES: np.array(study.sensor_names)})
    if placement.reach:
        arrays = {}
        for model, by in zip(study.models, placement.reach.sensors, strict=True):
            arrays[model.name] = fold_counts(by, model) if model.pieces else by
            if model.pieces:
                arrays[model.name + PIECES] = by
        write_npz(directory / REACH, arrays)


def write_summary(placement: Placement, directory: Path, warnings: Sequence[str] = ()) -> None:
    """Write ``result.json``, the last file: it names all the others.

    Parameters
    ----------
    placement : Placement
        What was found.
    directory : Path
        The folder with all other files.
    warnings : sequence of str
        Sentences to keep with the result, after those of the placement.
    """
    files = sorted({*files_below(directory), INDEX})
    write_index(directory / INDEX, _summary(placement, warnings) | {"files": files})


def write_npz(path: Path, arrays: Mapping[str, NDArray[Any]]) -> None:
    """Write arrays so that ``np.load`` reads them: the same bytes for the same arrays.

    ``np.savez_compressed`` would refuse models that are called as its own arguments are.
    """
    with zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED) as archive:
        for name, array in arrays.items():
            data = io.BytesIO()
            np.lib.format.write_array(data, np.asanyarray(array), allow_pickle=False)
            archive.writestr(zipfile.ZipInfo(f"{name}.npy"), data.getvalue(), zipfile.ZIP_DEFLATED)


def _sensor_columns(models: Sequence[Model]) -> list[str]:
    """Return what is told of each sensor, by the names of ``SensorRow``."""
    columns = ["seen", "seen_percentage", "only_it", "only_it_percentage"]
    are_cut = any(model.pieces for model in models)
    return [*columns, *(["area_percentage", "only_it_area_percentage"] if are_cut else [])]


def sensor_poses(placement: Placement) -> list[dict[str, Any]]:
    """Return the pose of each sensor as numbers that people use, in the study's unit."""
    study = placement.study
    position, direction, roll = position_direction_roll(placement.camera_to_world, study.up)
    azimuth, elevation = angles_from_direction(direction)
    return [
        {
            "name": name,
            "sensor": sensor.name,
            "position": position[s].tolist(),
            "direction": direction[s].tolist(),
            "azimuth_deg": _degrees(azimuth[s]),
            "elevation_deg": _degrees(elevation[s]),
            "roll_deg": _degrees(roll[s]),
            "camera_to_world": placement.camera_to_world[s].tolist(),
        }
        for s, (name, sensor) in enumerate(zip(study.sensor_names, study.sensors, strict=True))
    ]


def versions() -> dict[str, str]:
    """Return the versions of glvis, Python and the packages that numbers depend on."""
    found = {"python": platform.python_version(), "glvis": __version__}
    for name in _PACKAGES:
        try:
            found[name] = metadata.version(name)
        except metadata.PackageNotFoundError:  # a fork by another name
            found[name] = ""
    return found


def _summary(placement: Placement, warnings: Sequence[str]) -> dict[str, Any]:
    """Return all of ``result.json`` but the list of files."""
    study, objective = placement.study, placement.study.objective
    rows = model_rows(study.models, placement.maps, objective)
    is_position = bool(np.isfinite(placement.position).all()) and np.array_equal(
        study.rig.poses(placement.position), placement.camera_to_world
    )
    return {
        "glvis_schema": SCHEMA,
        "title": study.title,
        "unit": study.unit,
        "up": study.up.tolist(),
        "poses": sensor_poses(placement),
        "variables": [
            {
                "name": variable.name,
                # poses from elsewhere belong to no position
                "value": float(value) if is_position else None,
                "min": variable.min,
                "max": variable.max,
                "start": variable.start,
                "periodic": variable.periodic,
            }
            for variable, value in zip(study.variables, placement.position, strict=True)
        ],
        "objective": {
            "kind": objective.kind,
            "value": placement.value,
            "start_value": placement.start_value,
            "by_area": objective.by_area,
            "normalize": objective.normalize,
            "aggregate": objective.aggregate,
            "weights": {
                "w_tot": objective.w_tot,
                "w_of1": objective.w_of1,
                "w_of2": objective.w_of2,
                "overlap": list(objective.overlap),
            },
            "terms": _without_value(mean_terms(rows)),
        },
        "models": [
            {
                "name": row.name,
                "seen_by_all_cameras": row.seen_by_all_cameras,
                "unique_seen": row.unique_seen,
                "total": row.total,
                "percentage": row.percentage,
                "area_percentage": row.area_percentage,
                "share_seen_by": {str(n): s for n, s in enumerate(row.shares_seen_by, 1) if n > 1},
                "value": row.terms["value"],
                "terms": _without_value(row.terms),
                "render_resolution": {
                    sensor.name: resolution and list(resolution)
                    for sensor in study.sensors
                    for resolution in [render_resolution(study.visibility, sensor)]
                },
                **_pieces_of(model, found),
                **({"interference": light} if light else {}),
                **_file_of(model),
            }
            for row, model, found, light in zip(
                rows, study.models, placement.maps, _interference(placement), strict=True
            )
        ],
        "mean": mean_row(rows),
        "obstacles": [{"name": model.name, **_file_of(model)} for model in study.obstacles],
        "sensors": [
            {name: getattr(row, name) for name in ("name", *_sensor_columns(study.models))}
            | ({} if sensor.is_ideal else sensor_table(sensor))
            | {"quality": _quality(row_of_views)}
            for row, sensor, row_of_views in zip(
                sensor_rows(study.models, placement.maps),
                study.sensors,
                quality_rows(placement),
                strict=True,
            )
        ],
        "search": {
            "stop_reason": placement.stop_reason,
            "seed": placement.seed,
            "iterations": placement.trace[-1].iteration if placement.trace else 0,
            "evaluations": placement.evaluations,
            "maps_rendered": placement.maps_rendered,
        },
        "reach": _reach(placement),
        "warnings": [*placement.warnings, *warnings],
        "run": {
            "finished": time.strftime("%Y-%m-%dT%H:%M:%SZ", time.gmtime()),
            "seconds": placement.seconds,
            "workers": placement.workers,
        },
        "gl": {
            "vendor": placement.gl.vendor,
            "renderer": placement.gl.renderer,
            "version": placement.gl.version,
            "backend": placement.gl.backend,
        },
        "versions": versions(),
    }


def _quality(row: QualityRow) -> dict[str, Any]:
    """Return how good a sensor's views are, lengths in the study's unit, blur in pixels."""
    return {
        name: spread and {"median": spread.median, f"worst_{WORST:g}_percent": spread.worst}
        for name, spread in row.numbers.items()
    }


def _interference(placement: Placement) -> list[dict[str, Any] | None]:
    """Return how projectors disturb each other on each model, None where none do."""
    found, n = known_interference(placement), len(placement.study.models)
    return [interference_of_model(found, placement, m) if found else None for m in range(n)]


def _reach(placement: Placement) -> dict[str, Any] | None:
    """Return what could be seen at best, None where nobody looked."""
    reach = placement.reach
    if reach is None:
        return None
    return {
        "positions": reach.positions,
        "maps_rendered": reach.maps_rendered,
        "growth": reach.growth,
        "models": [
            {
                "name": row.name,
                "percentage": row.percentage,
                "area_percentage": row.area_percentage,
                "seen_of_it_percentage": row.seen_of_it,
                "area_seen_of_it_percentage": row.area_seen_of_it,
                "share_by": {str(n): share for n, share in enumerate(row.shares_by, 1) if n > 1},
            }
            for row in reach_rows(placement.study.models, placement.maps, reach)
        ],
    }


def _without_value(terms: Mapping[str, float]) -> dict[str, float]:
    return {name: term for name, term in terms.items() if name != "value"}


def _degrees(angle: float) -> float:
    """Return an angle in degrees, never -0."""
    return math.degrees(angle) + 0.0


def _pieces_of(model: Model, found: VisibilityMap) -> dict[str, Any]:
    """Return how a model was cut, and what share of its area at least n sensors see."""
    if model.pieces is None:
        return {}
    areas, counts = model.areas, found.counts
    shares = {
        str(n): float(areas[counts >= n].sum() / areas.sum())
        for n in range(1, len(found.sensor_names) + 1)
    }
    return {
        "pieces": model.n_faces,
        "max_edge": model.pieces.max_edge,
        "area_share_seen_by": shares,
    }


def _file_of(model: Model) -> dict[str, Any]:
    """Return where a mesh came from and the sum that tells whether it is still the same."""
    if model.parts:
        return {"parts": [{"file": str(part), "sha256": sha256(part)} for part in model.parts]}
    if model.path is None:
        return {}
    return {"file": str(model.path), "sha256": sha256(model.path)}


def sha256(path: Path) -> str:
    """Return the sum that tells whether a file is still the same."""
    with path.open("rb") as file:
        return hashlib.file_digest(file, "sha256").hexdigest()


def write_csv(path: Path, header: Sequence[str], rows: Iterable[Sequence[Any]]) -> None:
    """Write a table; every float is exact, and no text is a formula to a spreadsheet."""
    with path.open("w", newline="", encoding="utf-8") as file:
        writer = csv.writer(file, lineterminator="\n")
        writer.writerows([_cell(value) for value in row] for row in (header, *rows))


def _cell(value: Any) -> Any:
    """Return a value as a cell: a text that would be run, such as "=1+1", after an apostrophe."""
    is_formula = isinstance(value, str) and value.startswith(_FORMULAS)
    return f"'{value}" if is_formula else value
