"""Several runs of one study as a list: the combinations of ``[vary]``, each with several seeds.

A varied key is one that an override takes, so each run is the study with a few overrides, and all
of them are read before the first one starts.
"""

from __future__ import annotations

import itertools
import logging
import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from glvis.common.complaints import as_toml, shortened
from glvis.common.files import toml_tables
from glvis.errors import StudyError
from glvis.problem.sensor import Sensor
from glvis.problem.study import Study
from glvis.search.estimate import run_maps
from glvis.study.loading import load_study
from glvis.study.overrides import toml_text, toml_value

_LOG = logging.getLogger(__name__)

_SEED = "swarm.seed"
_MANY_RUNS, _MOST_RUNS = 50, 1000  # whose studies are read in seconds, and in minutes
_FILES = {"scene.models", "scene.obstacles"}
_LENGTHS = ("min_distance", "max_distance", "radius", "height")  # keys in the study's unit


@dataclass(frozen=True)
class Point:
    """One combination of the varied values.

    Attributes
    ----------
    values : dict of str to value
        By varied key; empty where nothing varies.
    settings : tuple of str
        The same as overrides.
    sensors : tuple of Sensor
        S of them.
    variables : int
        Numbers that its runs search.
    run_maps : int
        That one of its runs may render; see ``estimate.run_maps``.
    seed : int
        Of its first run.
    quantity : str
        Name of the objective, as "OF3".
    """

    values: Mapping[str, Any]
    settings: tuple[str, ...]
    sensors: tuple[Sensor, ...]
    variables: int
    run_maps: int
    seed: int
    quantity: str

    @property
    def label(self) -> str:
        """Its values in words."""
        return label_of(self.values)


@dataclass(frozen=True)
class PlannedRun:
    """One search of many.

    Attributes
    ----------
    name : str
        Its folder: "run-01".
    point : Point
        What it is run with.
    seed : int
        Of its random numbers.
    settings : tuple of str
        Overrides that make the study its own.
    """

    name: str
    point: Point
    seed: int
    settings: tuple[str, ...]


@dataclass(frozen=True)
class Plan:
    """All runs of a study.

    Attributes
    ----------
    title, unit : str
        Of the study.
    vary : dict of str to list
        Values by varied key.
    points : tuple of Point
        Every combination, the last key changing fastest.
    repeats : int
        Runs of each point.
    """

    title: str
    unit: str
    vary: Mapping[str, list[Any]]
    points: tuple[Point, ...]
    repeats: int

    @property
    def runs(self) -> list[PlannedRun]:
        """All points with their first seed, then all with the next: more repeats come last."""
        runs: list[PlannedRun] = []
        for repeat, point in itertools.product(range(self.repeats), self.points):
            title = f"{self.title} ({point.label})" if point.values else self.title
            seed = point.seed + repeat
            settings = (*point.settings, f"title={toml_text(title)}", f"{_SEED}={seed}")
            runs.append(PlannedRun(f"run-{len(runs) + 1:02d}", point, seed, settings))
        return runs


def plan_runs(
    study: Study, overrides: Sequence[str] = (), options: Sequence[str] = (), repeats: int = 1
) -> Plan:
    """Return all runs that a study, its ``[vary]`` and the command line ask for.

    Parameters
    ----------
    study : Study
        As it stands; its file is read again for every point.
    overrides : sequence of str
        What it was read with.
    options : sequence of str
        Keys to vary as well, such as "mounts=2,3,4"; they go before those of the file.
    repeats : int
        Runs of each point, with the study's seed and those that follow it.

    Raises
    ------
    StudyError
        If a key is unknown or its values are no list, a study of a point cannot be run, or
        repeats would all be the same.
    """
    vary = _lists(study.vary, f"{study.path}: [vary]") | dict(map(_from_option, options))
    folder = study.path.resolve().parent  # runs are read from a copy of the study elsewhere
    for key in _FILES & vary.keys():
        vary[key] = [_absolute(names, folder) for names in vary[key]]
    if repeats > 1 and _SEED in vary:
        raise StudyError(
            f"{study.path}: [vary] {_SEED}: repeats have seeds of their own; take one of the two"
        )
    planned = repeats * math.prod(len(values) for values in vary.values())
    if planned > _MOST_RUNS:
        raise StudyError(
            f"{study.path}: [vary] asks for {planned:,} runs, at most {_MOST_RUNS:,} can be "
            "planned at once; vary fewer values, or one part after the other"
        )
    if planned > _MANY_RUNS:
        _LOG.info("Reading the study of each of %d runs ...", planned // repeats)
    points = tuple(_points(study, overrides, vary))
    if repeats > 1 and not all(point.variables for point in points):
        raise StudyError(
            f"{study.path}: there is nothing to search, so that all repeats would be the same; "
            "free a number by { min, max, start }"
        )
    return Plan(study.title, study.unit, vary, points, repeats)


def label_of(values: Mapping[str, Any]) -> str:
    """Return varied values in words: "mounts = 2, objective.kind = 'of1'"."""
    return ", ".join(f"{key} = {value_text(value)}" for key, value in values.items())


def value_text(value: Any) -> str:
    """Return a varied value as people write it; of a file its name."""
    if isinstance(value, str):
        return f"'{value.rpartition('/')[2]}'"
    if isinstance(value, list):
        return f"[{', '.join(map(value_text, value))}]"
    return toml_text(value)


def key_label(key: str, unit: str) -> str:
    """Return what a varied key stands for, with its unit where that is known."""
    parts = key.split(".")
    if key == "mounts":
        return "number of mounts"
    if key.endswith("_deg"):
        return f"{key.removesuffix('_deg')} [deg]"
    return f"{key} [{unit}]" if parts[-1] in _LENGTHS or "position" in parts else key


def _points(
    study: Study, overrides: Sequence[str], vary: Mapping[str, list[Any]]
) -> Iterator[Point]:
    """Yield every combination of values, its study read and checked."""
    for combination in itertools.product(*vary.values()):
        values = dict(zip(vary, combination, strict=True))
        settings = tuple(f"{key}={toml_text(value)}" for key, value in values.items())
        one = study
        if values:
            try:
                one = load_study(study.path, [*overrides, *settings])
            except StudyError as error:
                fact = str(error).removeprefix(f"{study.path}: ")
                raise StudyError(
                    f"{study.path}: [vary] with {shortened(label_of(values), 200)}: {fact}"
                ) from error
        yield Point(
            values,
            settings,
            one.sensors,
            len(one.variables),
            run_maps(one) if one.variables else len(one.sensors) * len(one.models),
            one.swarm.seed,
            one.objective.label,
        )


def _lists(table: Mapping[str, Any], where: str) -> dict[str, list[Any]]:
    """Return the lists of values in a table ``[vary]`` by dotted key, or refuse what is none."""
    found = dict(_leaves(table))
    for key, values in found.items():
        if not isinstance(values, list):
            value = shortened(toml_text(values))
            fact = f"{value} must be a list of values, as [{value}, ...]"
        elif not values:
            fact = "[] must hold at least one value"
        elif len(values) > _MOST_RUNS:
            fact = f"{toml_text(values[:3])[:-1]}, ...] must hold at most {_MOST_RUNS} values"
        elif twice := [value for k, value in enumerate(values) if value in values[:k]]:
            fact = f"{as_toml(values)} holds {shortened(toml_text(twice[0]))} twice"
        else:
            continue
        raise StudyError(f"{where} {shortened(key)} = {fact}")
    return found


def _absolute(names: Any, folder: Path) -> Any:
    is_list = isinstance(names, list) and all(isinstance(name, str) for name in names)
    return [str(folder / name) for name in names] if is_list else names


def _leaves(table: Mapping[str, Any], above: str = "") -> Iterator[tuple[str, Any]]:
    """Yield values by dotted key; a key of the outermost table may hold dots itself."""
    for key, value in table.items():
        name = f"{above}.{_quoted(key)}" if above else key
        if isinstance(value, dict):
            yield from _leaves(value, name)
        else:
            yield name, value


def _quoted(key: str) -> str:
    """Return one part of a dotted key, in quotes where TOML needs them."""
    is_bare = key.isascii() and key.replace("-", "").replace("_", "").isalnum()
    return key if is_bare else toml_text(key)


def _from_option(text: str) -> tuple[str, list[Any]]:
    """Return key and values of "mounts=2,3,4" or "objective.kind=of1,of2"."""
    key, equals, listed = text.partition("=")
    if not equals or not listed.strip():
        raise StudyError(f"--vary '{shortened(text)}' must have the form KEY=VALUE,VALUE,...")
    try:
        values = toml_tables(f"values = [{listed}]")["values"]
    except ValueError:
        values = [toml_value(part) for part in listed.split(",")]
    if len(values) == 1 and isinstance(values[0], list):
        values = values[0]  # somebody wrote the brackets of the file
    key = key.strip()
    return key, _lists({key: values}, "--vary")[key]
