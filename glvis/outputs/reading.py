"""Reads a result folder back: a ``Placement`` again."""

from __future__ import annotations

import csv
import math
import zipfile
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, get_type_hints

import numpy as np
from numpy.typing import NDArray

from glvis.errors import StudyError
from glvis.inputs.scene import Model
from glvis.inputs.study import Study, load_study
from glvis.optim.placement import Placement, TraceRow
from glvis.optim.reach import Reach
from glvis.outputs.folder import INDEX, STUDY, read_index
from glvis.outputs.result import (
    MAPS,
    PIECE_OF,
    PIECES,
    REACH,
    SCHEMA,
    SENSOR_NAMES,
    TRACE,
    sha256,
)
from glvis.sight.context import GlInfo
from glvis.sight.visibility import VisibilityMap


def read_result(directory: str | Path) -> Placement:
    """Return the placement that a result folder holds.

    Parameters
    ----------
    directory : str or Path
        With ``result.json``, ``study.toml``, ``visibility.npz`` and ``trace.csv``; the meshes
        are read again from where the study says they are.

    Raises
    ------
    StudyError
        If a file is missing or broken, or a mesh is not what it was.
    """
    directory = Path(directory)
    index = read_index(directory / INDEX)
    if index["glvis_schema"] != SCHEMA:
        raise StudyError(
            f"{directory / INDEX}: schema version {index['glvis_schema']} cannot be read, "
            f"only {SCHEMA}"
        )
    study = load_study(directory / STUDY)
    try:
        if any(m.pieces for m in study.models) and not any("pieces" in m for m in index["models"]):
            # made before faces were cut: read as it was made
            study = load_study(directory / STUDY, ["scene.max_edge=off"])
        told = index["objective"]
        if (told["kind"], told["by_area"]) != (study.objective.kind, study.objective.by_area):
            # made when studies that name neither had other defaults
            settings = [f"objective.kind={told['kind']}", f"objective.by_area={told['by_area']}"]
            study = load_study(directory / STUDY, [one.lower() for one in settings])
        _check_meshes(index, study)
        return Placement(
            study=study,
            position=np.array(
                [math.nan if v["value"] is None else v["value"] for v in index["variables"]],
                dtype=float,
            ),
            camera_to_world=poses_of(index, study.sensor_names),
            maps=_read_maps(directory / MAPS, study),
            value=index["objective"]["value"],
            values_by_model=np.array([row["value"] for row in index["models"]]),
            start_value=index["objective"]["start_value"],
            trace=read_trace(directory / TRACE),
            stop_reason=index["search"]["stop_reason"],
            seed=index["search"]["seed"],
            seconds=index["run"]["seconds"],
            evaluations=index["search"]["evaluations"],
            maps_rendered=index["search"]["maps_rendered"],
            gl=GlInfo(**index["gl"]),
            workers=index["run"]["workers"],
            warnings=tuple(index["warnings"]),
            reach=_read_reach(directory / REACH, index.get("reach"), study),
        )
    except StudyError:
        raise
    except OSError as error:
        raise StudyError(f"{error.filename}: cannot be read: {error.strerror}") from None
    except (KeyError, TypeError, ValueError, zipfile.BadZipFile) as error:
        raise StudyError(
            f"{directory}: is no whole result: {type(error).__name__} {error}"
        ) from error


def _check_meshes(index: Mapping[str, Any], study: Study) -> None:
    """Refuse meshes that are not those which the result was made of."""
    entries = [*index["models"], *index["obstacles"]]
    meshes = [*study.models, *study.obstacles]
    if [entry["name"] for entry in entries] != [mesh.name for mesh in meshes]:
        raise StudyError(f"{study.path}: its meshes are not those of the result")
    for entry, mesh in zip(entries, meshes, strict=True):
        sums = [part.get("sha256") for part in entry.get("parts", [entry])]
        files = mesh.parts or ((mesh.path,) if mesh.path else ())
        for number, file in enumerate(files):
            if sums[number : number + 1] != [sha256(file)]:
                raise StudyError(f"{file}: has changed since the result was made")
    for entry, model in zip(index["models"], study.models, strict=True):
        if entry.get("pieces", model.file.n_faces) != model.n_faces:
            raise StudyError(
                f"{study.path}: {model.name} was cut into {entry.get('pieces', 'no')} pieces by "
                f"the glvis that made the result, and into {model.n_faces} by this one; "
                "evaluate its poses anew: glvis evaluate --poses"
            )


def poses_of(index: Mapping[str, Any], sensor_names: Sequence[str]) -> NDArray[np.float64]:
    """Return the poses (S, 4, 4) of some sensors in what a ``result.json`` says.

    Raises
    ------
    StudyError
        If a sensor is not in it, or a pose is no rigid transform.
    KeyError, TypeError, ValueError
        If its list of poses is none.
    """
    found = {entry["name"]: entry["camera_to_world"] for entry in index["poses"]}
    poses = np.zeros((len(sensor_names), 4, 4))
    for s, name in enumerate(sensor_names):
        if name not in found:
            raise StudyError(f"has no pose for '{name}'; it has {', '.join(found) or 'none'}")
        pose = np.array(found[name], dtype=float)
        if pose.shape != (4, 4) or not np.isfinite(pose).all():
            raise StudyError(f"the pose of '{name}' must be a finite 4 x 4 matrix")
        rotation = pose[:3, :3]
        is_rigid = np.allclose(rotation @ rotation.T, np.eye(3), atol=1e-6)
        if not (is_rigid and np.linalg.det(rotation) > 0 and (pose[3] == [0, 0, 0, 1]).all()):
            raise StudyError(f"the pose of '{name}' is no rigid transform")
        poses[s] = pose
    return poses


def _read_maps(path: Path, study: Study) -> tuple[VisibilityMap, ...]:
    """Return the maps of a result, checked against the study."""
    with np.load(path, allow_pickle=False) as arrays:
        names = tuple(str(name) for name in arrays[SENSOR_NAMES])
        maps = tuple(VisibilityMap(m.name, names, arrays[_key(m)]) for m in study.models)
        for model in study.models:
            if model.pieces and (arrays[model.name + PIECE_OF] != model.pieces.file_face).any():
                raise StudyError(f"{path}: its pieces are not those of the study")
    for found, model in zip(maps, study.models, strict=True):
        expected = (len(study.sensor_names), model.n_faces)
        if names != study.sensor_names or found.visible.shape != expected:
            raise StudyError(f"{path}: its maps are not those of the study")
    return maps


def _read_reach(path: Path, told: Mapping[str, Any] | None, study: Study) -> Reach | None:
    """Return what could be seen at best, None where nobody looked."""
    if told is None:
        return None
    with np.load(path, allow_pickle=False) as arrays:
        sensors = tuple(arrays[_key(model)] for model in study.models)
    for by, model in zip(sensors, study.models, strict=True):
        if by.shape != (model.n_faces,):
            raise StudyError(f"{path}: its faces are not those of the study")
    return Reach(sensors, told["positions"], told["maps_rendered"], told["growth"])


def _key(model: Model) -> str:
    """Return under which name an archive holds what was found for a model's own faces."""
    return model.name + PIECES if model.pieces else model.name


def read_trace(path: Path) -> tuple[TraceRow, ...]:
    """Return the rows of ``trace.csv``."""
    kinds = get_type_hints(TraceRow)
    with path.open(newline="", encoding="utf-8") as file:
        rows = list(csv.reader(file))
    if not rows or tuple(rows[0]) != TraceRow._fields:
        raise StudyError(f"{path}: must have the columns {', '.join(TraceRow._fields)}")
    return tuple(
        TraceRow(*(kinds[name](text) for name, text in zip(rows[0], row, strict=True)))
        for row in rows[1:]
    )
