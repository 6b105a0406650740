"""A first study of the user's meshes: what they are is guessed, and what was guessed is said."""

from __future__ import annotations

import math
import os
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from glvis.errors import StudyError
from glvis.problem.scene import Model, joined, load_model
from glvis.problem.units import (
    MM_PER_UNIT,
    UPS,
    guess_words,
    mm_per_own_unit,
    own_scale,
    own_up,
    short,
    unit_guess,
    unit_words,
)
from glvis.problem.winding import looks_inwards
from glvis.study.starter_layout import (
    GUESSED_SENSORS,
    PLACES,
    Fit,
    fitting_sensor,
    guessed_place,
    part_mounts,
    room_mounts,
    sensor_for_room,
)
from glvis.study.starter_texts import AREA_TEXT, MESH_TEXT, WHERE_TEXTS, search_table

_WITHIN_ANOTHER = 0.5  # of the smaller box that two meshes share: they stand for each other
_PART_SENSORS, _ROOM_SENSORS = 4, 3
_TAKEN_FOR = {
    "around": "a part that is held, seen from all around",
    "above": "a thing that stands on a floor, seen from around and above",
    "room": "a room, seen from within",
}


@dataclass(frozen=True)
class Choices:
    """What the user says of meshes; what is None is guessed.

    Attributes
    ----------
    unit : str or None
        Of the study, and of the meshes' numbers where their format does not say.
    sensors : int or None
        How many.
    sensor : str or None
        Which one of the catalogue.
    up : str or None
        "x", "y" or "z".
    place : str or None
        Where sensors stand: "around", "above" a floor, or in a "room".
    together : bool or None
        Whether several meshes are one thing, or are looked at one by one.
    """

    unit: str | None = None
    sensors: int | None = None
    sensor: str | None = None
    up: str | None = None
    place: str | None = None
    together: bool | None = None


ALL_GUESSED = Choices()


def study_of_meshes(
    files: Sequence[Path],
    directory: Path,
    choices: Choices,
    on_remark: Callable[[str], None],
) -> str:
    """Return the text of a study of some meshes.

    Parameters
    ----------
    files : sequence of Path
        At least one mesh.
    directory : Path
        Where the study will lie.
    choices : Choices
        What the user says.
    on_remark : callable
        Is told what was found and guessed, a line each.

    Raises
    ------
    StudyError
        If a mesh cannot be read.
    """
    unit = choices.unit or _own_unit(files)
    meshes = [_loaded(file, unit) for file in files]
    is_one = len(meshes) > 1 and not _stand_for_each_other(meshes)
    if choices.together is not None:
        is_one = len(meshes) > 1 and choices.together
    whole = joined("assembly", meshes) if len(meshes) > 1 else meshes[0]
    guess = _guessed_unit(files, whole, unit) if choices.unit is None else []
    doubted = unit
    if guess and not any(map(mm_per_own_unit, files)):
        unit = guess[0]
    size = np.ptp(whole.bounds, axis=0)
    up, place = choices.up or own_up(files), choices.place or guessed_place(whole, unit)
    if place == "room":
        n = choices.sensors or _ROOM_SENSORS
        fit = sensor_for_room(float(np.linalg.norm(size)), unit, choices.sensor)
        mounts = room_mounts(whole, fit, n, unit, up)
    else:
        n = choices.sensors or _PART_SENSORS
        fit = fitting_sensor(float(np.linalg.norm(size)) / 2, unit, choices.sensor)
        mounts = part_mounts(whole, fit, n, up, place)
    across = " x ".join(short(value) for value in size)
    other = " (or: --up y)" if choices.up is None and up == "z" else ""  # most assets have y
    on_remark(f"{_listed(meshes)}: {across} {unit} in all, {up} is up{other}")
    for line in (
        *_doubts(whole, doubted, guess, unit),
        *(_remarks_of_several(meshes, is_one) if choices.together is None else ()),
        *_remarks(place, choices.place is None, fit, unit),
    ):
        on_remark(line)
    return MESH_TEXT.format(
        title=f"{_listed(meshes)}{', assembled' if is_one else ''}, {n} sensors",
        unit=unit,
        up=[int(value) for value in UPS[up]],
        models=", ".join(f'"{name}"' for name in _names(files, directory)),
        several=_several_text(len(meshes), is_one),
        across=across,
        sensor=_sensor_text(fit, unit),
        where=WHERE_TEXTS[place],
        mounts="\n".join(mounts),
        search=AREA_TEXT + search_table(n, 1 if is_one else len(meshes)),
    )


def _own_unit(files: Sequence[Path]) -> str:
    """Return the unit in which all files say that they are, "mm" where they say none or several."""
    own = {mm_per_own_unit(file) for file in files}
    return next((unit for unit, mm in MM_PER_UNIT.items() if own == {mm}), "mm")


def _stand_for_each_other(meshes: Sequence[Model]) -> bool:
    """Return whether each mesh fills the place of each other one, as six people's arms do."""
    return len(meshes) > 1 and all(share > _WITHIN_ANOTHER for share in _shared(meshes))


def _shared(meshes: Sequence[Model]) -> Iterator[float]:
    """Yield of each two meshes the share of the smaller one's box that both boxes have."""
    boxes = [mesh.bounds for mesh in meshes]
    hair = 1e-3 * max(float(np.ptp(box, axis=0).max()) for box in boxes)  # flat ones have a box
    for k, one in enumerate(boxes):
        for other in boxes[:k]:
            both = np.minimum(one[1], other[1]) - np.maximum(one[0], other[0]) + hair
            least = min(float(np.prod(np.ptp(box, axis=0) + hair)) for box in (one, other))
            yield float(np.prod(np.maximum(both, 0))) / least


def _guessed_unit(files: Sequence[Path], whole: Model, unit: str) -> list[str]:
    """Return units that the size makes likelier, likeliest first; a room is hardly in inches."""
    guess = unit_guess(float(np.linalg.norm(np.ptp(whole.bounds, axis=0))), unit)
    return sorted(guess, key="m".__ne__) if looks_inwards(whole) else guess


def _doubts(whole: Model, doubted: str, guess: Sequence[str], taken: str) -> Iterator[str]:
    """Yield a question about the unit, if there is one."""
    if not guess:
        return
    size = float(np.linalg.norm(np.ptp(whole.bounds, axis=0)))
    question = f"Warning: {short(size)} {doubted} across: {guess_words(size, guess)}"
    if taken == doubted:
        yield f"{question} The file says its unit; [scene] scale = ... corrects it"
    else:
        others = " or ".join(f"--unit {unit}" for unit in (*guess[1:], doubted))
        yield f"{question} Taken for {unit_words(taken)} (or: {others})"


def _remarks_of_several(meshes: Sequence[Model], is_one: bool) -> Iterator[str]:
    """Yield what several meshes were taken for."""
    if len(meshes) == 1:
        return
    if not is_one:
        yield (
            f"The {len(meshes)} meshes lie in one place and are looked at one by one "
            "(or: --together)"
        )
        return
    yield f"The {len(meshes)} meshes are taken for one thing together (or: --each)"
    if any(share > _WITHIN_ANOTHER for share in _shared(meshes)):
        yield (
            "Warning: some of them lie in one another; is each in a frame of its own? Put them "
            "together first, as one file"
        )


def _remarks(place: str, is_guessed: bool, fit: Fit, unit: str) -> Iterator[str]:
    """Yield what was guessed and how to say otherwise."""
    if is_guessed:
        others = ", ".join(f"--{other}" for other in PLACES if other != place)
        yield f"Taken for {_TAKEN_FOR[place]} (or: {others})"
    sensor = fit.sensor
    name = sensor.name if fit.is_known else "made to measure"
    others = ", ".join(f"--sensor {other}" for other in GUESSED_SENSORS if other != sensor.name)
    yield (
        f"Sensor: {name}, {short(sensor.min_distance)} to {short(sensor.max_distance)} {unit} "
        f"(or: {others}, others by 'glvis sensors', or yours in the study)"
    )


def _listed(meshes: Sequence[Model]) -> str:
    names = [mesh.name for mesh in meshes]
    return ", ".join(names) if len(names) <= 3 else f"{names[0]} and {len(names) - 1} more"


def _several_text(n: int, is_one: bool) -> str:
    """Return the lines about several meshes, none for one."""
    if is_one:
        return 'assembly = "assembly"          # all together are one model of this name\n'
    if n > 1:
        return '# Each is looked at on its own; assembly = "NAME" makes one model of all.\n'
    return ""


def _sensor_text(fit: Fit, unit: str) -> str:
    """Return the table of a sensor made to measure, or a remark about a known one."""
    sensor = fit.sensor
    digits = 4 if fit.is_known else 5
    hfov, vfov = (f"{math.degrees(value):.{digits}g}" for value in sensor.lens.opening)
    if fit.is_known:
        return (
            f'# The mounts below name "{sensor.name}", which glvis knows: {hfov} x {vfov} deg,\n'
            f"# {short(sensor.min_distance)} to {short(sensor.max_distance)} {unit}; 'glvis "
            f"sensors {sensor.name}' says more. Your own sensor goes into\n"
            "# a table [sensor.NAME] with hfov_deg, vfov_deg, resolution, min_distance, "
            "max_distance and\n# max_incidence_deg.\n"
        )
    return (
        "[sensor.camera]                # made to measure: put the data of yours here\n"
        f"hfov_deg = {hfov}\nvfov_deg = {vfov}\n"
        f"resolution = [{sensor.resolution[0]}, {sensor.resolution[1]}]\n"
        f"min_distance = {short(sensor.min_distance)}"
        "             # depths along the optical axis\n"
        f"max_distance = {short(sensor.max_distance)}\n"
        "max_incidence_deg = 70         # 0: looks straight at a face, 90: sees it edge on\n"
    )


def _loaded(path: Path, unit: str) -> Model:
    try:
        return load_model(path, own_scale(path, unit))
    except ValueError as error:
        raise StudyError(f"--model {path}: {error}") from error


def _names(models: Sequence[Path], directory: Path) -> list[str]:
    """Return the paths of meshes as the study writes them: from there where they are near."""
    near = [Path(os.path.relpath(model, directory)) for model in models]
    return [
        (path if path.parts.count("..") < 2 else model.resolve()).as_posix()
        for path, model in zip(near, models, strict=True)
    ]
