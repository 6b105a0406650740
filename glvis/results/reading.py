"""Reads a result folder back: a ``Placement`` again."""

from __future__ import annotations

import csv
import math
from collections.abc import Collection, Sequence
from pathlib import Path
from typing import Any, get_type_hints

import numpy as np
from numpy.typing import NDArray

from glvis.common.complaints import as_toml, checked, shortened
from glvis.common.files import read_npz, read_text
from glvis.errors import StudyError
from glvis.problem.scene import Model
from glvis.problem.study import Study
from glvis.results.folder import INDEX, STUDY, read_index
from glvis.results.indexes import PoseEntry, ReachEntry, ResultIndex
from glvis.results.result import (
    MAPS,
    PIECE_OF,
    PIECES,
    REACH,
    SCHEMA,
    SENSOR_NAMES,
    TRACE,
    sha256,
)
from glvis.search.placement import Placement, TraceRow
from glvis.search.reach import Reach
from glvis.study.loading import load_study
from glvis.visibility.context import GlInfo
from glvis.visibility.visibility_map import VisibilityMap

_MOST_TRACE = 64_000_000  # bytes; a million iterations


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
    index = result_index(directory / INDEX)
    study = load_study(directory / STUDY)
    try:
        if any(m.pieces for m in study.models) and not any(m.pieces for m in index.models):
            # made before faces were cut: read as it was made
            study = load_study(directory / STUDY, ["scene.max_edge=off"])
        told = index.objective
        if (told.kind, told.by_area) != (study.objective.kind, study.objective.by_area):
            # made when studies that name neither had other defaults
            settings = [f"objective.kind={told.kind}", f"objective.by_area={told.by_area}"]
            study = load_study(directory / STUDY, [one.lower() for one in settings])
        _check_meshes(index, study)
        if len(index.variables) != len(study.variables):
            raise StudyError(f"{study.path}: its variables are not those of the result")
        return Placement(
            study=study,
            position=np.array(
                [math.nan if v.value is None else v.value for v in index.variables],
                dtype=float,
            ),
            camera_to_world=poses_of(index.poses, study.sensor_names),
            maps=_read_maps(directory / MAPS, study),
            value=index.objective.value,
            values_by_model=np.array([model.value for model in index.models]),
            start_value=index.objective.start_value,
            trace=read_trace(directory / TRACE),
            stop_reason=index.search.stop_reason,
            seed=index.search.seed,
            seconds=index.run.seconds,
            evaluations=index.search.evaluations,
            maps_rendered=index.search.maps_rendered,
            gl=GlInfo(**index.gl.model_dump()),
            workers=index.run.workers,
            warnings=tuple(index.warnings),
            reach=_read_reach(directory / REACH, index.reach, study),
        )
    except StudyError:
        raise
    except OSError as error:
        raise StudyError(
            f"{error.filename or directory}: cannot be read: {error.strerror or error}"
        ) from None


def result_index(path: Path) -> ResultIndex:
    """Return what a ``result.json`` says, checked.

    Raises
    ------
    StudyError
        If it is missing, cannot be read, is not glvis' own or of another version, or a value in
        it is not what it must be.
    """
    found = read_index(path)
    version = found["glvis_schema"]
    if version != SCHEMA:
        raise StudyError(f"{path}: schema version {as_toml(version)} cannot be read, only {SCHEMA}")
    try:
        return checked(ResultIndex, found)
    except ValueError as error:
        raise StudyError(f"{path}: is no whole result: {error}") from None


def _check_meshes(index: ResultIndex, study: Study) -> None:
    """Refuse meshes that are not those which the result was made of."""
    entries = [*index.models, *index.obstacles]
    meshes = [*study.models, *study.obstacles]
    if [entry.name for entry in entries] != [mesh.name for mesh in meshes]:
        raise StudyError(f"{study.path}: its meshes are not those of the result")
    for entry, mesh in zip(entries, meshes, strict=True):
        sums = [part.sha256 for part in entry.parts] if entry.parts else [entry.sha256]
        files = mesh.parts or ((mesh.path,) if mesh.path else ())
        for number, file in enumerate(files):
            if sums[number : number + 1] != [sha256(file)]:
                raise StudyError(f"{file}: has changed since the result was made")
    for entry, model in zip(index.models, study.models, strict=True):
        if (entry.pieces or model.file.n_faces) != model.n_faces:
            raise StudyError(
                f"{study.path}: {model.name} was cut into {entry.pieces or 'no'} pieces by "
                f"the glvis that made the result, and into {model.n_faces} by this one; "
                "evaluate its poses anew: glvis evaluate --poses"
            )


def poses_of(entries: Sequence[PoseEntry], sensor_names: Sequence[str]) -> NDArray[np.float64]:
    """Return the poses (S, 4, 4) of some sensors, checked to be rigid.

    Raises
    ------
    StudyError
        If a sensor is not among them, or a pose is no rigid transform.
    """
    found = {entry.name: entry.camera_to_world for entry in entries}
    check_sensors(found, sensor_names)
    poses = np.zeros((len(sensor_names), 4, 4))
    for s, name in enumerate(sensor_names):
        pose = np.array(found[name], dtype=float)
        rotation = pose[:3, :3]
        is_rigid = np.allclose(rotation @ rotation.T, np.eye(3), atol=1e-6)
        if not (is_rigid and np.linalg.det(rotation) > 0 and (pose[3] == [0, 0, 0, 1]).all()):
            raise StudyError(f"the pose of '{name}' is no rigid transform")
        poses[s] = pose
    return poses


def check_sensors(found: Collection[str], wanted: Sequence[str]) -> None:
    """Refuse poses by names that lack one of the wanted sensors.

    Raises
    ------
    StudyError
        The first that is missing, what there is, and all that is wanted.
    """
    for name in wanted:
        if name not in found:
            raise StudyError(
                f"has no pose for '{shortened(name)}'; it has {_listed(found)}, "
                f"the study's sensors are {_listed(wanted)}"
            )


def _listed(names: Collection[str]) -> str:
    return shortened(", ".join(names) or "none")


def _read_maps(path: Path, study: Study) -> tuple[VisibilityMap, ...]:
    """Return the maps of a result, checked against the study."""
    arrays = _arrays(path, study)
    names = study.sensor_names
    if arrays.get(SENSOR_NAMES, np.array("")).tolist() != list(names):
        raise StudyError(f"{path}: its maps are not those of the study's sensors")
    maps = []
    for model in study.models:
        found = arrays.get(_key(model))
        if found is None or found.dtype != bool or found.shape != (len(names), model.n_faces):
            raise StudyError(f"{path}: its maps are not those of the study")
        maps.append(VisibilityMap(model.name, names, found))
        pieces = arrays.get(model.name + PIECE_OF, np.zeros(0))
        if model.pieces and not np.array_equal(pieces, model.pieces.file_face):
            raise StudyError(f"{path}: its pieces are not those of the study")
    return tuple(maps)


def _arrays(path: Path, study: Study) -> dict[str, NDArray[Any]]:
    """Return the arrays of an archive that has a few bytes a sensor and face at most."""
    sensors = len(study.sensor_names)
    faces = sum(model.n_faces + model.file.n_faces for model in study.models)
    try:
        return read_npz(path, 8 * (sensors + 2) * faces)
    except ValueError as error:
        raise StudyError(f"{path}: {error}") from None


def _read_reach(path: Path, told: ReachEntry | None, study: Study) -> Reach | None:
    """Return what could be seen at best, None where nobody looked."""
    if told is None:
        return None
    arrays, most, sensors = _arrays(path, study), len(study.sensor_names), []
    for model in study.models:
        by = arrays.get(_key(model))
        if by is None or by.dtype.kind not in "iu" or by.shape != (model.n_faces,):
            raise StudyError(f"{path}: its faces are not those of the study")
        if by.min() < 0 or by.max() > most:
            raise StudyError(f"{path}: says that more sensors see a face than there are")
        sensors.append(by)
    return Reach(tuple(sensors), told.positions, told.maps_rendered, told.growth)


def _key(model: Model) -> str:
    """Return under which name an archive holds what was found for a model's own faces."""
    return model.name + PIECES if model.pieces else model.name


def read_trace(path: Path) -> tuple[TraceRow, ...]:
    """Return the rows of ``trace.csv``.

    Raises
    ------
    StudyError
        If it is none, with the line that is broken.
    OSError
        If it cannot be read.
    """
    kinds = get_type_hints(TraceRow).values()
    lines = csv.reader([])
    try:
        lines = csv.reader(read_text(path, _MOST_TRACE).splitlines())
        if tuple(next(lines, ())) != TraceRow._fields:
            raise StudyError(f"{path}: must have the columns {', '.join(TraceRow._fields)}")
        trace = []
        for row in lines:
            found = TraceRow(*(kind(cell) for kind, cell in zip(kinds, row, strict=True)))
            if not np.isfinite([found.best, found.mean, found.std, found.seconds]).all():
                raise ValueError
            trace.append(found)
    except StudyError:
        raise
    except (ValueError, OverflowError, csv.Error) as error:
        fact = f"line {lines.line_num} is broken" if lines.line_num else error
        raise StudyError(f"{path}: {fact}") from None
    return tuple(trace)
