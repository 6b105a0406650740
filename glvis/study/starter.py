"""A first study, written for a mesh or an example: commented, and it runs as it is."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path

from glvis.common.hints import command
from glvis.errors import MachineError, StudyError
from glvis.problem.units import MM_PER_UNIT, UPS
from glvis.study.catalogue_sensors import find_sensor
from glvis.study.json_schema import DIRECTIVE, SCHEMA_FILE, schema_text
from glvis.study.meshpaths import mesh_paths
from glvis.study.starter_layout import PLACES, short
from glvis.study.starter_meshes import ROOM, arm, room, write_stl
from glvis.study.starter_study import ALL_GUESSED, Choices, study_of_meshes
from glvis.study.starter_texts import (
    ARM_TEXT,
    COVERAGE_TEXT,
    ROOM_MOUNT_TEXT,
    ROOM_TEXT,
    search_table,
)

EXAMPLES = ("arm", "kitchen", "room")
STUDY = "study.toml"
_ROOM_SENSORS = 3


def write_starter(
    directory: Path,
    models: Sequence[Path] = (),
    *,
    example: str | None = None,
    choices: Choices = ALL_GUESSED,
    on_remark: Callable[[str], None] = lambda line: None,
) -> Path:
    """Write a study and, for an example, its mesh into a folder; return the study's path.

    Beside it lies the schema that its first line names to editors.

    What is not given is guessed from the files.

    Parameters
    ----------
    directory : Path
        Made where it is missing; a study that is there is never replaced.
    models : sequence of Path
        Meshes to be seen, or patterns of their names; without them an example is made.
    example : str, optional
        "arm", "kitchen" or "room"; "arm" if there are no models.
    choices : Choices
        What the user says of the meshes, or of an example how many sensors.
    on_remark : callable
        Is told what was found in the files and guessed, a line each.

    Raises
    ------
    StudyError
        If a choice is none, a mesh is missing or cannot be read, or there is a study already.
    MachineError
        If the folder cannot be written to.
    """
    if models and example:
        raise StudyError("--model and --example exclude each other")
    _check_choice("--example", example, EXAMPLES)
    _check_choice("--unit", choices.unit, tuple(MM_PER_UNIT))
    _check_choice("--up", choices.up, tuple(UPS))
    _check_sensor(choices.sensor)
    _check_choice("place", choices.place, PLACES)
    if not models:
        _check_example(example or "arm", choices)
    path = directory / STUDY
    if path.exists():
        raise StudyError(f"{path}: is there already; choose another folder")
    triangles, mesh_name = None, example or "arm"
    if models:
        files = mesh_paths([str(model) for model in models], Path(), "--model")
        text = study_of_meshes(files, directory, choices, on_remark)
    elif mesh_name == "arm":
        text, triangles = ARM_TEXT, arm()
    else:
        text, triangles = _room_study(mesh_name, choices.sensors or _ROOM_SENSORS), room(mesh_name)
    try:
        directory.mkdir(parents=True, exist_ok=True)
        if triangles is not None:
            write_stl(directory / f"{mesh_name}.stl", triangles)
        (directory / SCHEMA_FILE).write_text(schema_text(), encoding="utf-8")  # for editors
        path.write_text(f"{DIRECTIVE}\n{text}", encoding="utf-8")
    except (FileExistsError, NotADirectoryError):
        raise StudyError(f"{directory}: cannot be a folder: there is a file") from None
    except OSError as error:
        raise MachineError(f"{directory}: cannot be written to: {error.strerror}") from error
    return path


def next_commands(study: Path) -> list[str]:
    """Return the three commands that come next, as a shell takes them."""
    out = study.parent / "out"
    return [
        command("check", study),
        command("optimize", study, "-o", out),
        command("explain", out),
    ]


def _check_choice(option: str, value: str | None, allowed: Sequence[str]) -> None:
    if value is not None and value not in allowed:
        raise StudyError(f"{option} {value}: must be one of {', '.join(allowed)}")


def _check_sensor(name: str | None) -> None:
    """Refuse what the catalogue does not have, or not whole."""
    try:
        if name is not None:
            find_sensor(name, "mm")
    except ValueError as error:
        raise StudyError(f"--sensor: {error}") from None


def _check_example(name: str, choices: Choices) -> None:
    """Refuse what can be said of the user's meshes only."""
    if choices.sensors and name == "arm":
        raise StudyError("--sensors: the arm's scanner has eight; it is for --model and rooms")
    for option, value in vars(choices).items():
        if value is not None and option != "sensors":
            word = {"place": value, "together": "together" if value else "each"}.get(option, option)
            raise StudyError(f"--{word}: is for the meshes of --model; the examples are in mm")


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
                x=short(x),
                y=short(y),
                z=short(z),
                start=", ".join(short(value) for value in (u * x, v * y, 0.8 * z)),
                sx=short(u * x),
                sy=short(v * y),
                sz=short(0.8 * z),
                azimuth=azimuth,
            )
        )
    return ROOM_TEXT.format(
        title=f"{name.capitalize()}, {sensors} Kinect v2",
        model=f"{name}.stl",
        mounts="\n".join(mounts),
        search=COVERAGE_TEXT + search_table(sensors),
    )
