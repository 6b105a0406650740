"""A first study, written for a mesh or an example: commented, and it runs as it is."""

from __future__ import annotations

import math
import os
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from glvis.camera import Intrinsics
from glvis.errors import MachineError, StudyError
from glvis.hints import command
from glvis.inputs.scene import Model, load_model
from glvis.inputs.schema import MM_PER_UNIT, catalogue
from glvis.inputs.sensor import Sensor
from glvis.inputs.starter_meshes import ROOM, arm, room, write_stl
from glvis.inputs.starter_texts import (
    ARM_TEXT,
    COVERAGE_TEXT,
    PART_MOUNT_TEXT,
    PART_TEXT,
    ROOM_MOUNT_TEXT,
    ROOM_TEXT,
    search_table,
)

Floats = NDArray[np.float64]

EXAMPLES = ("arm", "kitchen", "room")
STUDY = "study.toml"
_ELEVATION = math.radians(30)  # of the sensors about a part, above and below in turns
_OWN_FOV = (60.0, 45.0)  # of a sensor made to measure, degrees
_SMALLEST = 0.15  # radius of a part for a known sensor, of its maxD
_UPS = {"x": [1, 0, 0], "y": [0, 1, 0], "z": [0, 0, 1]}


def write_starter(
    directory: Path,
    models: Sequence[Path] = (),
    *,
    example: str | None = None,
    unit: str = "mm",
    sensors: int | None = None,
    up: str = "z",
) -> Path:
    """Write a study and, for an example, its mesh into a folder; return the study's path.

    Parameters
    ----------
    directory : Path
        Made where it is missing; a study that is there is never replaced.
    models : sequence of Path
        Meshes to be seen; without them an example is made.
    example : str, optional
        "arm", "kitchen" or "room"; "arm" if there are no models.
    unit : str
        Of the meshes' lengths.
    sensors : int, optional
        How many.
    up : str
        "x", "y" or "z".

    Raises
    ------
    StudyError
        If a choice is none, a mesh cannot be read, or there is a study already.
    MachineError
        If the folder cannot be written to.
    """
    if models and example:
        raise StudyError("--model and --example exclude each other")
    if example and example not in EXAMPLES:
        raise StudyError(f"--example {example}: must be one of {', '.join(EXAMPLES)}")
    if unit not in MM_PER_UNIT:
        raise StudyError(f"--unit {unit}: must be one of {', '.join(MM_PER_UNIT)}")
    if up not in _UPS:
        raise StudyError(f"--up {up}: must be one of x, y, z")
    if not models and unit != "mm":
        raise StudyError("--unit: is for the meshes of --model; the examples are in mm")
    if not models and sensors and (example or "arm") == "arm":
        raise StudyError("--sensors: the arm's scanner has eight; it is for --model and rooms")
    path = directory / STUDY
    if path.exists():
        raise StudyError(f"{path}: is there already; choose another folder")
    meshes = [_loaded(model) for model in models]
    try:
        directory.mkdir(parents=True, exist_ok=True)
        if meshes:
            text = _part_study(_names(models, directory), meshes, unit, sensors or 4, up)
        elif (example or "arm") == "arm":
            write_stl(directory / "arm.stl", arm())
            text = ARM_TEXT
        else:
            name = str(example)
            write_stl(directory / f"{name}.stl", room(name))
            text = _room_study(name, sensors or 3)
        path.write_text(text, encoding="utf-8")
    except (FileExistsError, NotADirectoryError):
        raise StudyError(f"{directory}: cannot be a folder: there is a file") from None
    except OSError as error:
        raise MachineError(f"{directory}: cannot be written to: {error.strerror}") from error
    return path


def next_commands(study: Path) -> list[str]:
    """Return the three commands that come next."""
    out = study.parent / "out"
    return [
        command("check", study),
        command("optimize", study, "-o", out),
        command("explain", out),
    ]


@dataclass(frozen=True)
class _Fit:
    """A sensor and the distance from which it sees a whole part."""

    sensor: Sensor
    distance: float
    is_known: bool


def fitting_sensor(radius: float, unit: str) -> tuple[Sensor, float]:
    """Return a sensor for a part of some radius, and the distance of its centre.

    One of the catalogue where it has the whole part in view and range, else one made to measure.

    Parameters
    ----------
    radius : float
        Of the sphere around the part, in ``unit``.
    unit : str
        Of lengths.
    """
    fit = _fit(radius, unit)
    return fit.sensor, fit.distance


def _fit(radius: float, unit: str) -> _Fit:
    for sensor in catalogue(unit).values():
        half = min(sensor.intrinsics.hfov, sensor.intrinsics.vfov) / 2
        distance = max(sensor.min_distance + radius, radius / math.sin(half))
        # Heights may take a sensor a fifth farther away; and a small part would be few pixels.
        fits = 1.2 * distance + radius <= sensor.max_distance
        if fits and radius >= _SMALLEST * sensor.max_distance:
            return _Fit(sensor, distance, True)
    distance = radius / math.sin(math.radians(min(_OWN_FOV)) / 2)
    own = Sensor(
        "camera",
        Intrinsics.from_degrees(*_OWN_FOV),
        (1280, 960),
        float(_short(0.4 * distance)),
        float(_short(1.8 * distance)),
        math.radians(70),
    )
    return _Fit(own, distance, False)


def _part_study(
    names: Sequence[str], meshes: Sequence[Model], unit: str, sensors: int, up: str
) -> str:
    """Return the study of parts looked at from all around."""
    low = np.min([mesh.bounds[0] for mesh in meshes], axis=0)
    high = np.max([mesh.bounds[1] for mesh in meshes], axis=0)
    centre, size = (low + high) / 2, high - low
    radius = float(np.linalg.norm(size)) / 2
    fit = _fit(radius, unit)
    level, rise = fit.distance * math.cos(_ELEVATION), fit.distance * math.sin(_ELEVATION)
    axis = "xyz".index(up)
    half_sector = 180.0 / sensors
    mounts = []
    for k in range(sensors):
        angle = 2 * half_sector * k
        height = rise if k % 2 == 0 else -rise
        aim = [_short(value) for value in centre]
        aim[axis] = (
            f"{{ min = {_short(centre[axis] - 0.4 * size[axis])}, "
            f"max = {_short(centre[axis] + 0.4 * size[axis])}, start = {_short(centre[axis])} }}"
        )
        if size[axis] <= 1e-9 * radius:  # flat: there is nothing to aim along
            aim[axis] = _short(centre[axis])
        turn = f"min = {angle - half_sector:g}, max = {angle + half_sector:g}, start = {angle:g}"
        mounts.append(
            PART_MOUNT_TEXT.format(
                name=f"S{k + 1}",
                sensor=fit.sensor.name,
                axis=up,
                radius=_short(level),
                turn=turn + (", periodic = true" if sensors == 1 else ""),
                low=_short(-1.3 * rise),
                high=_short(1.3 * rise),
                height=_short(height),
                centre=", ".join(_short(value) for value in centre),
                aim=", ".join(aim),
            )
        )
    models = ", ".join(f'"{name}"' for name in names)
    across = " x ".join(_short(value) for value in size)
    return PART_TEXT.format(
        title=f"{Path(names[0]).stem}, {sensors} sensors",
        unit=unit,
        up=_UPS[up],
        models=models,
        across=across,
        sensor=_sensor_text(fit, unit),
        mounts="\n".join(mounts),
        search=COVERAGE_TEXT + search_table(sensors, len(meshes)),
    )


def _sensor_text(fit: _Fit, unit: str) -> str:
    """Return the table of a sensor made to measure, or a remark about a known one."""
    sensor = fit.sensor
    hfov, vfov = (
        f"{math.degrees(value):.6g}" for value in (sensor.intrinsics.hfov, sensor.intrinsics.vfov)
    )
    if fit.is_known:
        return (
            f'# The mounts below name "{sensor.name}", which glvis knows: {hfov} x {vfov} deg,\n'
            f"# {_short(sensor.min_distance)} to {_short(sensor.max_distance)} {unit}. Your own "
            "sensor goes into a table [sensor.NAME] with hfov_deg,\n"
            "# vfov_deg, resolution, min_distance, max_distance and max_incidence_deg.\n"
        )
    return (
        "[sensor.camera]                # made to measure: put the data of yours here\n"
        f"hfov_deg = {hfov}\nvfov_deg = {vfov}\n"
        f"resolution = [{sensor.resolution[0]}, {sensor.resolution[1]}]\n"
        f"min_distance = {_short(sensor.min_distance)}"
        "             # depths along the optical axis\n"
        f"max_distance = {_short(sensor.max_distance)}\n"
        "max_incidence_deg = 70         # 0: looks straight at a face, 90: sees it edge on\n"
    )


def _room_study(name: str, sensors: int) -> str:
    """Return the study of a room watched by Kinects."""
    x, y, z = ROOM
    corners = [(0.1, 0.1, 45), (0.9, 0.9, 225), (0.9, 0.1, 135), (0.1, 0.9, 315)]
    mounts = []
    for k in range(sensors):
        u, v, azimuth = corners[k % 4]
        mounts.append(
            ROOM_MOUNT_TEXT.format(
                name=f"K{k + 1}",
                x=_short(x),
                y=_short(y),
                z=_short(z),
                start=", ".join(_short(value) for value in (u * x, v * y, 0.8 * z)),
                sx=_short(u * x),
                sy=_short(v * y),
                sz=_short(0.8 * z),
                azimuth=azimuth,
            )
        )
    return ROOM_TEXT.format(
        title=f"{name.capitalize()}, {sensors} Kinect v2",
        model=f"{name}.stl",
        mounts="\n".join(mounts),
        search=COVERAGE_TEXT + search_table(sensors),
    )


def _loaded(path: Path) -> Model:
    try:
        return load_model(path)
    except ValueError as error:
        raise StudyError(f"--model {path}: {error}") from error


def _names(models: Sequence[Path], directory: Path) -> list[str]:
    """Return the paths of meshes as the study writes them: from there where they are near."""
    near = [Path(os.path.relpath(model, directory)) for model in models]
    return [
        (path if path.parts.count("..") < 2 else model.resolve()).as_posix()
        for path, model in zip(near, models, strict=True)
    ]


def _short(value: float) -> str:
    """Return a number with three digits, in full."""
    if value == 0 or not math.isfinite(value):
        return "0"
    digits = 2 - math.floor(math.log10(abs(value)))
    text = f"{round(value, digits):.{max(0, digits)}f}"
    return text.rstrip("0").rstrip(".") if "." in text else text
