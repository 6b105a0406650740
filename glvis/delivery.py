"""A placement becomes a whole result folder: data, pictures, and the index that names them all."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from glvis.errors import MachineError
from glvis.folder import INDEX, ResultFolder
from glvis.placement import Placement
from glvis.result import write_data, write_index


def deliver(
    placement: Placement,
    folder: ResultFolder,
    *,
    warnings: Sequence[str] = (),
    pictures: bool = True,
) -> list[str]:
    """Write everything of a placement into a folder that is still to be committed.

    Pictures that fail, or that Ctrl-C ends, do not cost the result.

    Parameters
    ----------
    placement : Placement
        What was found.
    folder : ResultFolder
        Where it goes.
    warnings : sequence of str
        Sentences to keep with the result.
    pictures : bool
        Whether to make the pictures.

    Returns
    -------
    list of str
        What could not be made, a sentence each.

    Raises
    ------
    MachineError
        If the files cannot be written.
    """
    failures = []
    try:
        write_data(placement, folder.staging)
        if pictures:
            failures = make_pictures(placement, folder.staging, folder.path)
        write_index(placement, folder.staging, [*warnings, *failures])
    except OSError as error:
        raise MachineError(f"{folder.path}: cannot be written to: {error.strerror}") from error
    return failures


def make_pictures(placement: Placement, directory: Path, final: Path) -> list[str]:
    """Make the pictures of a placement; return in a sentence what could not be made."""
    again = f"'glvis render {final}' makes them"
    try:
        write_pictures(placement, directory)
    except KeyboardInterrupt:
        return [f"the pictures were left out on Ctrl-C; {again}"]
    except MachineError as error:
        return [f"the pictures could not be made: {error}; {again}"]
    return []


def write_pictures(placement: Placement, directory: Path) -> None:
    """Write all pictures of a placement into a folder."""


def summary_of_files(directory: Path) -> str:
    """Return in a line what lies in a result folder."""
    return f"Result: {directory} ({INDEX}, coverage.csv, sensors.csv, visibility.npz, views/)"
