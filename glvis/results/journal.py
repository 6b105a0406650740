"""Files of one folder: written whole, put into their places, never outside of it.

New files are made in a folder inside, the staging, and renamed into place when all are there. What
is to be done is written down first, in a journal beside them; from then on whoever opens the
folder next does the rest: a process may be killed between any two steps.
"""

from __future__ import annotations

import errno
import json
import os
import shutil
from collections.abc import Iterable, Iterator
from contextlib import contextmanager, suppress
from pathlib import Path, PurePosixPath

from glvis.errors import MachineError, StudyError

JOURNAL = "journal.json"


def put_in_place(
    staging: Path, path: Path, old: Iterable[str], indices: Iterable[str], *, renews: bool = False
) -> None:
    """Rename all files of ``staging`` into the folder around it; remove the other old ones.

    Somebody else's file in the way is kept under another name.

    Parameters
    ----------
    staging : Path
        Folder in ``path`` with nothing but the new files; it goes in the end.
    path : Path
        The folder.
    old : iterable of str
        Files in ``path`` that are to be replaced, relative paths with "/".
    indices : iterable of str
        Files that say that all others are there: the old ones go first, the new ones come last.
    renews : bool
        Leave the old ones of ``indices`` until the new ones come: what they say stays true.

    Raises
    ------
    StudyError
        If a folder of a file is a symbolic link.
    OSError
        If a file cannot be renamed; it and all that follow stay in ``staging``.
    """
    new, old = files_below(staging), sorted(old)
    refuse_links(path, [*new, *old])
    todo = {"new": new, "old": old, "last": sorted(indices), "renews": renews}
    write_whole(staging / JOURNAL, json.dumps(todo, indent=1))
    _go_on(staging, path)


def settle(path: Path, stagings: Iterable[str]) -> None:
    """Do what is left of a `put_in_place` that was broken off, if there was one.

    Parameters
    ----------
    path : Path
        The folder; may be missing.
    stagings : iterable of str
        Names of what may be a staging in it.

    Raises
    ------
    StudyError
        If a journal is broken, or a symbolic link would lead outside.
    OSError
        If a file cannot be renamed.
    """
    refuse_links(path, (), stagings)
    for name in stagings:
        if is_settled_by_next(path / name):
            _go_on(path / name, path)


def is_settled_by_next(staging: Path) -> bool:
    """Return whether all files of a staging are whole and only need to be put in place."""
    return (staging / JOURNAL).is_file()


def refuse_links(path: Path, names: Iterable[str], folders: Iterable[str] = ()) -> None:
    """Raise StudyError if a folder in ``path``, or one that a file is in, is a symbolic link."""
    found = {folder for name in names for folder in PurePosixPath(name).parents}
    for folder in sorted(found.union(map(PurePosixPath, folders)) - {PurePosixPath(".")}):
        if (path / folder).is_symlink():
            raise StudyError(
                f"{path / folder}: is a symbolic link; inside a result none is followed; remove it"
            )


def is_inside(name: object) -> bool:
    """Return whether a name of a list that anybody may have written stays in its folder."""
    if not isinstance(name, str) or "\0" in name or (os.sep == "\\" and {"\\", ":"} & {*name}):
        return False
    return not {"", "..", "."} & set(name.split("/"))


def files_below(folder: Path) -> list[str]:
    """Return the files in a folder and its folders, as sorted relative paths with "/"."""
    return sorted(p.relative_to(folder).as_posix() for p in folder.rglob("*") if p.is_file())


def remove_files(path: Path, names: Iterable[str]) -> None:
    """Remove files of a folder, and the folders inside that hold nothing without them."""
    folders: set[PurePosixPath] = set()
    for name in names:
        with suppress(FileNotFoundError, NotADirectoryError):
            (path / name).unlink()
        folders.update(PurePosixPath(name).parents)
    for folder in sorted(folders - {PurePosixPath(".")}, reverse=True):
        with suppress(NotADirectoryError):
            remove_if_empty(path / folder)


def remove_if_empty(folder: Path) -> None:
    """Remove a folder unless something is in it."""
    try:
        folder.rmdir()
    except OSError as error:
        if error.errno not in (errno.ENOTEMPTY, errno.EEXIST, errno.ENOENT):
            raise


def made_folders(path: Path) -> list[Path]:
    """Make a folder and those above it; return the new ones, outermost first."""
    missing = [folder for folder in (path, *path.parents) if not folder.exists()]
    for folder in reversed(missing):  # mkdir(parents=True) goes as deep as the path
        folder.mkdir(exist_ok=True)
    return missing[::-1]


@contextmanager
def whole_file(path: Path) -> Iterator[Path]:
    """Give a path to write a file to; until it is whole, the one before stays in its place."""
    part = path.with_name(f"{path.name}.part")
    part.unlink(missing_ok=True)  # left over from a kill, or a link to somewhere else
    try:
        yield part
    except OSError:
        with suppress(OSError):
            part.unlink()
        raise
    part.replace(path)


def write_whole(path: Path, text: str) -> None:
    """Write a text file; until it is whole, the one before stays."""
    with whole_file(path) as part:
        part.write_text(text, encoding="utf-8")


@contextmanager
def machine_errors(path: Path) -> Iterator[None]:
    """Say in one line what the file system refused."""
    try:
        yield
    except (FileExistsError, NotADirectoryError) as error:
        raise StudyError(f"{path}: cannot be a folder: {error.filename} is a file") from error
    except OSError as error:
        raise MachineError(f"{path}: cannot be written to: {error.strerror or error}") from error


def _go_on(staging: Path, path: Path) -> None:
    """Do what a journal says and was not done yet, in any number of attempts."""
    new, old, last, renews = _read_journal(staging / JOURNAL)
    refuse_links(path, new | old)
    for name in sorted(last & old):
        if not renews and (name not in new or (staging / name).exists()):
            (path / name).unlink(missing_ok=True)
    for name in sorted(new - last):
        _put(staging / name, path, name, is_own=name in old)
    remove_files(path, sorted(old - new))
    for name in sorted(new & last):
        _put(staging / name, path, name, is_own=name in old)
    shutil.rmtree(staging)


def _put(source: Path, path: Path, name: str, *, is_own: bool) -> None:
    """Rename a file into its place, unless that was done before."""
    if not source.exists():
        return
    for folder in reversed(PurePosixPath(name).parents[:-1]):
        if (path / folder).exists() and not (path / folder).is_dir():
            _keep(path / folder)
        if not (path / folder).is_dir():
            (path / folder).mkdir()
    target = path / name
    if (target.exists() and not is_own) or target.is_dir():
        _keep(target)
    source.replace(target)


def _keep(found: Path) -> None:
    """Give what somebody else has put in the way another name."""
    number, kept = 1, found.with_name(f"{found.name}.kept")
    while kept.exists():
        number += 1
        kept = found.with_name(f"{found.name}.kept-{number}")
    found.rename(kept)


def _read_journal(path: Path) -> tuple[set[str], set[str], set[str], bool]:
    """Return the new and the old files, which come last, and whether the old index stays."""
    try:
        found = json.loads(path.read_text(encoding="utf-8"))
        lists = [found[key] for key in ("new", "old", "last")]
        renews = found["renews"]
    except (KeyError, TypeError, ValueError, RecursionError):
        lists, renews = [], None
    if not isinstance(renews, bool) or not all(
        isinstance(names, list) and all(map(is_inside, names)) for names in lists
    ):
        raise StudyError(f"{path}: is no journal of glvis; remove {path.parent} to start anew")
    new, old, last = map(set, lists)
    return new, old, last, renews
