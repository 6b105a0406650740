"""A placement becomes a whole result folder: data, pictures, the page, and the index of all."""

from __future__ import annotations

import shutil
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

from glvis.common.files import in_one_line
from glvis.common.hints import command
from glvis.errors import MachineError, StudyError
from glvis.evaluation.interference import rival_groups
from glvis.pictures.selection import chosen_pictures
from glvis.pictures.writing import SIZE, write_views
from glvis.reports.export_surfaces import write_surfaces
from glvis.reports.report import page_data
from glvis.results.calibrations import unknown_elsewhere
from glvis.results.export_poses import write_exports, write_poses
from glvis.results.folder import EXPORTS, INDEX, VIEWS, ResultFolder, renewed_files, result_folder
from glvis.results.mounting import mounting_lines
from glvis.results.quality_tables import known_interference
from glvis.results.reading import read_result
from glvis.results.result import write_data, write_summary
from glvis.search.placement import Placement
from glvis.viewer.page import write_page

LEFT_OUT = "left-out.txt"  # in the folder of pictures
PAGE, MOUNTING, POSES = "report.html", "mounting.txt", "poses.csv"
_COMMAND = "glvis render DIR --all-pictures"
_PICTURES = "the pictures"
_LONGEST = 300  # letters of what another library says


@dataclass(frozen=True)
class Look:
    """How pictures are to look.

    Attributes
    ----------
    size : tuple of int
        Pixels (width, height).
    view : (float, float) or None
        Azimuth and elevation, degrees, of pictures in perspective; None chooses.
    color : str or None
        Only the pictures with this colouring.
    also : tuple of str
        Further colourings, beside those made anyway.
    all_pictures : bool
        Every model and sensor, however many there are.
    """

    size: tuple[int, int] = SIZE
    view: tuple[float, float] | None = None
    color: str | None = None
    also: tuple[str, ...] = ()
    all_pictures: bool = False


def deliver(
    placement: Placement,
    folder: ResultFolder,
    *,
    warnings: Sequence[str] = (),
    pictures: bool = True,
    meshes: bool = True,
    look: Look | None = None,
) -> list[str]:
    """Write everything of a placement into a folder that is still to be committed.

    What is made for people and for other tools does not cost the result: where it fails, or
    Ctrl-C ends the pictures, it is left out.

    Parameters
    ----------
    placement : Placement
        What was found.
    folder : ResultFolder
        Where it goes.
    warnings : sequence of str
        Sentences to keep with the result.
    pictures, meshes : bool
        Whether to make the pictures, and coloured meshes for other tools.
    look : Look, optional
        How pictures are to look.

    Returns
    -------
    list of str
        What could not be made, a sentence each.

    Raises
    ------
    MachineError
        If the files cannot be written.
    """
    directory = folder.staging
    told = _left_out(placement, look) if pictures else []
    again = f"; {command('render', folder.path)} makes them"
    wanted: list[tuple[str, Callable[[], object], tuple[str, ...], str]] = [
        (
            "the files for installers and other tools",
            lambda: _write_for_others(placement, directory, meshes),
            (MOUNTING, POSES, EXPORTS),
            "",
        ),
        (
            "the page",
            lambda: write_page(directory / PAGE, page_data(placement, told)),
            (PAGE,),
            again,
        ),
        (_PICTURES, lambda: write_pictures(placement, directory, look), (VIEWS,), again),
    ]
    try:
        write_data(placement, directory)
        failures = [*_unknown_interference(placement)]
        for what, write, names, hint in wanted if pictures else wanted[:-1]:
            if problem := _problem_of(what, write):
                for name in names:
                    _remove(directory / name)
                failures.append(problem + hint)
        failures += unknown_elsewhere(placement.study.sensors)
        write_summary(placement, directory, [*warnings, *failures])
    except OSError as error:
        raise MachineError(f"{folder.path}: cannot be written to: {error.strerror}") from error
    return failures


def save(
    placement: Placement, directory: Path, *, overwrite: bool, pictures: bool, meshes: bool
) -> list[str]:
    """Write everything of a placement into a folder of its own; see ``deliver``.

    Raises
    ------
    StudyError
        If the folder holds something that may not be replaced.
    MachineError
        If the files cannot be written.
    """
    with result_folder(directory, overwrite=overwrite) as folder:
        return deliver(placement, folder, pictures=pictures, meshes=meshes)


def render_again(directory: Path, look: Look | None = None) -> list[str]:
    """Make the pictures and the page of a result again; return the names of the new files.

    Parameters
    ----------
    directory : Path
        Folder of a result.
    look : Look, optional
        With a ``color``, all other pictures stay as they are.

    Raises
    ------
    StudyError
        If the folder holds no whole result, or the look is none.
    MachineError
        Where there is no OpenGL, or the folder cannot be written to.
    """
    look = look or Look()
    with renewed_files(directory, () if look.color else (f"{VIEWS}/",)) as staging:
        placement = read_result(directory)
        try:
            paths = write_pictures(placement, staging, look)
        except ValueError as error:
            raise StudyError(str(error)) from error
        except (MachineError, OSError):
            raise
        except Exception as error:
            raise MachineError(f"{directory}: {_could_not(_PICTURES, error)}") from error
        told = left_out_lines(directory) if look.color else _left_out(placement, look)
        write_page(staging / PAGE, page_data(placement, told))
        return [path.relative_to(staging).as_posix() for path in paths]


def write_pictures(placement: Placement, directory: Path, look: Look | None = None) -> list[Path]:
    """Write the pictures of a placement into ``views`` in a folder; return their paths."""
    look = look or Look()
    (directory / VIEWS).mkdir()
    sentences = [] if look.color else _left_out(placement, look)
    if sentences:
        text = "".join(f"{sentence}\n" for sentence in sentences)
        (directory / VIEWS / LEFT_OUT).write_text(text, encoding="utf-8")
    return write_views(
        placement.study,
        placement.camera_to_world,
        placement.maps,
        directory / VIEWS,
        trace=placement.trace,
        start_value=placement.start_value,
        size=look.size,
        view=look.view,
        color=look.color,
        also=look.also,
        all_pictures=look.all_pictures,
        interference=placement.interference,
    )


def left_out_lines(directory: Path) -> list[str]:
    """Return what the pictures of a result leave out, and how to get it."""
    path = directory / VIEWS / LEFT_OUT
    if not path.is_file():
        return []
    said = command("render", directory, "--all-pictures")
    return path.read_text(encoding="utf-8").replace(f"'{_COMMAND}'", said).splitlines()


def _left_out(placement: Placement, look: Look | None) -> list[str]:
    """Return in sentences what is not drawn because there is too much of it."""
    all_pictures = look is not None and look.all_pictures
    chosen = chosen_pictures(placement.study, placement.maps, all_pictures=all_pictures)
    if not chosen.left_out:
        return []
    return [f"Pictures: {'; '.join(chosen.left_out)}; '{_COMMAND}' makes all"]


def _unknown_interference(placement: Placement) -> Iterator[str]:
    """Yield a sentence where projectors may disturb each other and nobody here can say."""
    if rival_groups(placement.study.sensors) and known_interference(placement) is None:
        yield "how projectors disturb each other is not told: there is no OpenGL here"


def _write_for_others(placement: Placement, directory: Path, meshes: bool) -> None:
    """Write what installers and other tools read."""
    text = "\n".join(mounting_lines(placement)) + "\n"
    (directory / MOUNTING).write_text(text, encoding="utf-8")
    write_poses(placement, directory / POSES)
    (directory / EXPORTS).mkdir()
    write_exports(placement, directory / EXPORTS, meshes=meshes)
    if meshes:
        write_surfaces(placement, directory / EXPORTS)


def summary_of_files(directory: Path) -> str:
    """Return in a line what lies in a result folder."""
    views = [f"{VIEWS}/"] if (directory / VIEWS).is_dir() else []
    names = [PAGE, *views, INDEX, "coverage.csv", MOUNTING, POSES, f"{EXPORTS}/"]
    there = [name for name in names if (directory / name).exists()]
    return f"Result: {directory} ({', '.join(there)}, ...)"


def _problem_of(what: str, write: Callable[[], object]) -> str:
    """Write something; return in a sentence why it could not be made, or nothing."""
    try:
        write()
    except KeyboardInterrupt:
        if what != _PICTURES:  # the rest takes no time
            raise
        return f"{what} were left out on Ctrl-C"
    except Exception as error:  # of whatever library: the result is worth more
        return _could_not(what, error)
    return ""


def _could_not(what: str, error: Exception) -> str:
    """Return in one line that something failed, and why."""
    why = in_one_line(str(error))[:_LONGEST]
    if not isinstance(error, MachineError | StudyError | OSError):
        why = f"{type(error).__name__} {why}".strip()
    return f"{what} could not be made: {why}"


def _remove(path: Path) -> None:
    """Remove a file or a folder, if it is there."""
    if path.is_dir():
        shutil.rmtree(path, ignore_errors=True)
    else:
        path.unlink(missing_ok=True)
