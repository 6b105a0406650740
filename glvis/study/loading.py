"""Reads a study file: TOML, checked, and meshes, ready to be run.

Whatever the user can have written wrongly ends here in a ``StudyError`` of one line: file,
key, what it got, what is allowed.
"""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from pydantic import ValidationError

from glvis.common.complaints import first_error, shortened
from glvis.common.files import MOST_TOML, in_one_line, read_text, toml_tables
from glvis.errors import StudyError
from glvis.problem.catalogue import complaint
from glvis.problem.expressions import nearest
from glvis.problem.mounts import build_rig
from glvis.problem.pieces import cut_models
from glvis.problem.scene import SUFFIXES as MESH_SUFFIXES
from glvis.problem.scene import Model, joined, load_model
from glvis.problem.search_options import SearchOptions
from glvis.problem.sensor import Sensor
from glvis.problem.study import Study
from glvis.problem.swarm_options import SwarmOptions
from glvis.problem.units import UPS, own_scale, own_up
from glvis.problem.visibility_options import VisibilityOptions, render_resolution
from glvis.study.catalogue_sensors import catalogue
from glvis.study.lengths import with_plain_lengths
from glvis.study.meshpaths import NAMES_KEY, check_names, mesh_paths
from glvis.study.overrides import REMOVED, overridden, written
from glvis.study.schema import StudyTable
from glvis.study.sensor_table import sensor_table

_SCHEMA_LINE = re.compile(r"(#:schema +)([^:\s][^:\n]*)(?=\n)")  # by a path, not by an URL
_MOST_PIXELS = 1 << 26  # of an image that decides; one takes about 14 bytes a pixel


def load_study(path: str | Path, overrides: Sequence[str] = ()) -> Study:
    """Return the study in a TOML file.

    Parameters
    ----------
    path : str or Path
        The file; meshes are looked for beside it.
    overrides : sequence of str
        Such as "swarm.particles=100" or "mount.A1.roll_deg=0": values that go before those of
        the file.

    Raises
    ------
    StudyError
        If anything the user wrote cannot be run: the file, a key, a mesh.
    """
    path = Path(path)
    with _located(f"{path}: "):
        if path.suffix.lower() in MESH_SUFFIXES:
            raise StudyError("is a mesh, no study; glvis init DIR --model MESH writes a first one")
        source = _read_text(path)
        data = toml_tables(source)
        if "sweep" in data:
            raise StudyError("[sweep] is called [vary] now: rename the table, its keys stay")
        data, changes = overridden(data, overrides)
        data = with_plain_lengths(data)
        try:
            table = StudyTable.model_validate(data)
        except ValidationError as error:
            raise StudyError(first_error(error, data)) from None
        folder = path.resolve().parent
        with _located("[scene] "):
            model_paths = mesh_paths(table.scene.models, folder, "models")
            obstacle_paths = mesh_paths(table.scene.obstacles, folder, "obstacles")
            check_names(model_paths, obstacle_paths)
            if table.scene.assembly == NAMES_KEY:
                raise StudyError(f"assembly: a model cannot be called '{NAMES_KEY}'")
        sensors = _sensors(table, folder)
        up = table.up or UPS[own_up(model_paths)]
        rig = build_rig(table.variables, [mount.to_mount() for mount in table.mount], up)
        with _located("[visibility] "):
            visibility = table.visibility.to_options()
            _check_pixels(visibility, sensors, rig.sensor_kinds)
            if table.visibility.semantics == "paper":
                _check_ideal(sensors, rig.sensor_kinds)
        with _located("[objective] "):
            objective = table.objective.to_objective()
        swarm, search = _swarm(table), _search(table)
        models = tuple(_model(file, table) for file in model_paths)
        obstacles = tuple(_model(file, table) for file in obstacle_paths)
        with _located("[scene] flip: "):
            models = _flipped(models, table.scene.flip)
        if table.scene.assembly:
            models = (joined(table.scene.assembly, models),)
        looking = [sensors[kind] for kind in dict.fromkeys(rig.sensor_kinds)]
        with _located("[scene] "):
            models = cut_models(models, table.scene.max_edge, looking, visibility)
    changes["scene", "models"] = [str(file) for file in model_paths]
    if obstacle_paths:
        changes["scene", "obstacles"] = [str(file) for file in obstacle_paths]
    for name, own in table.sensor.items():
        if own.is_of_elsewhere:  # whoever reads the result has neither file nor catalogue
            changes.pop(("sensor", name), None)  # the order of changes is that of writing
            changes["sensor", name] = sensor_table(sensors[name])
    told = {"objective.kind": objective.kind, "objective.by_area": objective.by_area}
    told["search.method"] = search.method
    assumed = tuple(key for key in told if not _names(data, key))
    changes |= {tuple(key.split(".")): told[key] for key in assumed}
    if "vary" in data:
        changes = {path: new for path, new in changes.items() if path[0] != "vary"}
        changes["vary",] = REMOVED
    return Study(
        path=path,
        text=_with_absolute_schema(written(source, changes), folder),
        title=table.title or in_one_line(path.stem),
        unit=table.unit,
        up=rig.up,
        models=models,
        obstacles=obstacles,
        sensors=tuple(sensors[kind] for kind in rig.sensor_kinds),
        rig=rig,
        visibility=visibility,
        objective=objective,
        swarm=swarm,
        search=search,
        vary=table.vary,
        assumed=assumed,
    )


@contextmanager
def _located(where: str) -> Iterator[None]:
    """Put a place before the bare fact of an error."""
    try:
        yield
    except ValueError as error:
        raise StudyError(f"{where}{error}") from error


def _read_text(path: Path) -> str:
    """Return the text of the study file, or say in one phrase why there is none."""
    try:
        return read_text(path, 4 * MOST_TOML)
    except FileNotFoundError:
        raise StudyError("does not exist") from None
    except UnicodeDecodeError as error:
        raise StudyError(f"is no text in UTF-8 (byte {error.start}); save it as UTF-8") from None
    except OSError as error:
        raise StudyError(f"cannot be read: {error.strerror}") from None


def _with_absolute_schema(text: str, folder: Path) -> str:
    """Return a study whose first line, if it names a schema beside the study, is true elsewhere."""
    found = _SCHEMA_LINE.match(text)
    return f"{found[1]}{folder / found[2]}{text[found.end() :]}" if found else text


def _names(data: Mapping[str, Any], key: str) -> bool:
    """Return whether a study has a key such as "search.method"."""
    table, _, name = key.partition(".")
    return name in data.get(table, {})


def _sensors(table: StudyTable, folder: Path) -> dict[str, Sensor]:
    """Return the sensors that the mounts name: the file's own go before the catalogue's."""
    known = catalogue(table.unit)
    for name, own in table.sensor.items():
        with _located(f"[sensor.{shortened(name)}] "):
            known[name] = own.to_sensor(name, table.unit, folder)
    for mount in table.mount:
        if mount.sensor not in known:
            raise StudyError(
                f"[[mount]] '{shortened(mount.name)}' sensor = '{shortened(mount.sensor)}' "
                f"{complaint(mount.sensor, table.sensor)}"
            )
    return known


def _check_pixels(
    options: VisibilityOptions, sensors: Mapping[str, Sensor], kinds: Sequence[str]
) -> None:
    """Refuse images that decide and are larger than memory and patience are."""
    for kind in dict.fromkeys(kinds):
        width, height = render_resolution(options, sensors[kind]) or (1, 1)
        if width * height > _MOST_PIXELS:
            raise StudyError(
                f"resolution: '{shortened(kind)}' would be drawn with {width} x {height} pixels, "
                f"more than {_MOST_PIXELS:,} in all; choose 'auto' or a smaller [width, height]"
            )


def _check_ideal(sensors: Mapping[str, Sensor], kinds: Sequence[str]) -> None:
    """Refuse sensors of which the paper says nothing, where all is to be as in the paper."""
    for kind in dict.fromkeys(kinds):
        sensor = sensors[kind]
        if not sensor.is_ideal:
            what = "a partner" if sensor.partner else f"distance = '{sensor.distance}'"
            if sensor.lens.kind != "pinhole":
                what = f"lens = '{sensor.lens.kind}'"
            raise StudyError(
                f"semantics = 'paper': '{shortened(kind)}' has {what}, and the paper knows one "
                "ideal pinhole, depth along its axis and no second viewpoint; leave semantics out"
            )


def _swarm(table: StudyTable) -> SwarmOptions:
    """Return the options of the swarm, its complaints in the words of the file."""
    try:
        return table.swarm_options()
    except ValueError as error:
        raise StudyError(f"[swarm] {str(error).removeprefix('swarm.')}") from error


def _search(table: StudyTable) -> SearchOptions:
    """Return which method searches, the complaints in the words of the file."""
    try:
        return table.search_options()
    except ValueError as error:
        raise StudyError(f"[search] {str(error).removeprefix('search.')}") from error


def _flipped(models: Sequence[Model], flip: bool | Sequence[str]) -> tuple[Model, ...]:
    """Return models, those that are named, or all, with their normals the other way."""
    names = [model.name for model in models]
    chosen = (names if flip else []) if isinstance(flip, bool) else flip
    for name in chosen:
        if name not in names:
            raise StudyError(f"no model is called '{name}'{nearest(name, names)}")
    return tuple(model.flipped() if model.name in chosen else model for model in models)


def _model(path: Path, table: StudyTable) -> Model:
    """Return a mesh in the study's unit, with its path before what is wrong with it."""
    with _located(f"[scene] {path} "):
        return load_model(path, table.scene.scale or own_scale(path, table.unit))
