"""A study: everything one TOML file says, read, checked and ready to be run.

Whatever the user can have written wrongly ends here in a ``StudyError`` of one line: file,
key, what it got, what is allowed.
"""

from __future__ import annotations

import glob
import tomllib
from collections import Counter
from collections.abc import Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from pydantic import ValidationError

from glvis.errors import StudyError
from glvis.inputs.complaints import first_error
from glvis.inputs.expressions import nearest
from glvis.inputs.lines import one_line
from glvis.inputs.mounts import Array, Rig, Variable, build_rig
from glvis.inputs.overrides import REMOVED, overridden, written
from glvis.inputs.pieces import cut_models
from glvis.inputs.scene import Model, load_model
from glvis.inputs.schema import StudyTable, catalogue
from glvis.inputs.sensor import Sensor
from glvis.optim.objective import Objective
from glvis.optim.search_options import SearchOptions
from glvis.optim.swarm_options import SwarmOptions
from glvis.sight.visibility import VisibilityOptions

_NAMES_KEY = "sensors"  # of visibility.npz, beside one key a model


@dataclass(frozen=True, eq=False)
class Study:
    """What a study file says.

    Attributes
    ----------
    path : Path
        The file.
    text : str
        TOML as run: overrides written in, paths of meshes absolute.
    title, unit : str
        For reports; all lengths are in ``unit``.
    up : (3,) float64
        World direction that an unrolled image shows upright, unit length.
    models : tuple of Model
        What is to be seen, each on its own; large faces are cut into pieces by
        ``[scene] max_edge``, see ``pieces.py``.
    obstacles : tuple of Model
        What hides and is never counted.
    sensors : tuple of Sensor
        S of them, as ``rig.sensor_names``; the same object where the same kind.
    rig : Rig
        Positions to poses.
    visibility : VisibilityOptions
        Which faces count as seen.
    objective : Objective
        What the search maximises.
    swarm : SwarmOptions
        How the swarm searches.
    search : SearchOptions
        Which method searches, and what it may spend.
    sweep : dict
        The table ``[sweep]`` as written: no part of this study, nor of ``text``; see
        ``sweep.plan_runs``.
    """

    path: Path
    text: str = field(repr=False)
    title: str
    unit: str
    up: Array
    models: tuple[Model, ...]
    obstacles: tuple[Model, ...]
    sensors: tuple[Sensor, ...]
    rig: Rig = field(repr=False)
    visibility: VisibilityOptions
    objective: Objective
    swarm: SwarmOptions
    search: SearchOptions = field(default_factory=SearchOptions)
    sweep: Mapping[str, Any] = field(default_factory=dict)

    @property
    def variables(self) -> tuple[Variable, ...]:
        """What the search may choose, one a column of a position."""
        return self.rig.variables

    @property
    def max_seconds(self) -> float | None:
        """After how many seconds the search ends, if so."""
        of_swarm = self.swarm.max_seconds if self.search.method == "swarm" else None
        limits = [limit for limit in (self.search.max_seconds, of_swarm) if limit is not None]
        return min(limits, default=None)

    @property
    def sensor_names(self) -> tuple[str, ...]:
        """Names of the S sensors."""
        return self.rig.sensor_names


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
        source = _read_text(path)
        data = _parsed(source)
        data, changes = overridden(data, overrides)
        try:
            table = StudyTable.model_validate(data)
        except ValidationError as error:
            raise StudyError(first_error(error, data)) from None
        sensors = _sensors(table)
        rig = build_rig(table.variables, [mount.to_mount() for mount in table.mount], table.up)
        with _located("[visibility] "):
            visibility = table.visibility.to_options()
        with _located("[objective] "):
            objective = table.objective.to_objective()
        swarm, search = _swarm(table), _search(table)
        folder = path.resolve().parent
        with _located("[scene] "):
            model_paths = list(_files(table.scene.models, folder, "models"))
            obstacle_paths = list(_files(table.scene.obstacles, folder, "obstacles"))
            _check_names(model_paths, obstacle_paths)
        models = tuple(_model(file, table.scene.scale) for file in model_paths)
        obstacles = tuple(_model(file, table.scene.scale) for file in obstacle_paths)
        looking = [sensors[kind] for kind in dict.fromkeys(rig.sensor_kinds)]
        with _located("[scene] "):
            models = cut_models(models, table.scene.max_edge, looking, visibility)
    changes["scene", "models"] = [str(file) for file in model_paths]
    if obstacle_paths:
        changes["scene", "obstacles"] = [str(file) for file in obstacle_paths]
    if "sweep" in data:
        changes = {path: new for path, new in changes.items() if path[0] != "sweep"}
        changes["sweep",] = REMOVED
    return Study(
        path=path,
        text=written(source, changes),
        title=table.title or one_line(path.stem),
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
        sweep=table.sweep,
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
        return path.read_text(encoding="utf-8")
    except FileNotFoundError:
        raise StudyError("does not exist") from None
    except UnicodeDecodeError as error:
        raise StudyError(f"is no text in UTF-8 (byte {error.start})") from None
    except OSError as error:
        raise StudyError(f"cannot be read: {error.strerror}") from None


def _parsed(source: str) -> dict[str, Any]:
    """Return the tables of TOML text."""
    try:
        return tomllib.loads(source)
    except tomllib.TOMLDecodeError as error:
        raise StudyError(f"is no TOML: {error}") from None
    except RecursionError:
        raise StudyError("is no TOML: nested too deeply") from None


def _sensors(table: StudyTable) -> dict[str, Sensor]:
    """Return the sensors that the mounts name: the file's own go before the catalogue's."""
    known = catalogue(table.unit)
    for name, own in table.sensor.items():
        with _located(f"[sensor.{name}] "):
            known[name] = own.to_sensor(name)
    for mount in table.mount:
        if mount.sensor not in known:
            raise StudyError(
                f"[[mount]] '{mount.name}' sensor = '{mount.sensor}' is unknown"
                f"{nearest(mount.sensor, known)}; known are {', '.join(known)}"
            )
    return known


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


def _files(patterns: Iterable[str], folder: Path, key: str) -> Iterator[Path]:
    """Yield the absolute paths of meshes; a glob's files come sorted by name."""
    for pattern in patterns:
        plain = folder / pattern
        if plain.is_file() or not glob.has_magic(pattern):
            yield plain
            continue
        # Path.glob would refuse absolute patterns.
        found = sorted(glob.glob(pattern, root_dir=folder, recursive=True))  # noqa: PTH207
        if not found:
            raise StudyError(f"{key} = '{pattern}' matches no file in {folder}")
        yield from (folder / name for name in found)


def _check_names(models: Sequence[Path], obstacles: Sequence[Path]) -> None:
    """Refuse models that results could not tell apart, and models in their own way."""
    files = Counter(file.resolve() for file in models)
    stems: dict[str, Path] = {}
    for file in models:
        if files[file.resolve()] > 1:
            raise StudyError(f"models: {file.name} is there twice")
        name = one_line(file.stem)
        other = stems.setdefault(name, file)
        if other is not file:
            raise StudyError(
                f"models: {other} and {file} have the same name '{name}', "
                "by which results are filed; rename one"
            )
        if name == _NAMES_KEY:
            raise StudyError(f"models: a model cannot be called '{_NAMES_KEY}'; rename {file.name}")
    for file in obstacles:
        if file.resolve() in files:
            raise StudyError(f"{file.name} is both a model and an obstacle")


def _model(path: Path, scale: float) -> Model:
    """Return a mesh, with its path before what is wrong with it."""
    with _located(f"[scene] {path} "):
        return load_model(path, scale)
