"""The folder a run writes: refused before the run starts, filled whole when it has ended.

Files are written into ``unfinished/`` inside the folder and renamed into place at the end,
``result.json`` last: a folder without it holds no result. What is inside already and was not
written by glvis is never touched.
"""

from __future__ import annotations

import errno
import filecmp
import json
import re
import shutil
from collections.abc import Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from glvis.errors import MachineError, StudyError
from glvis.hints import command
from glvis.inputs.files import read_json

INDEX = "result.json"  # names every file of the result; written last
CHECKPOINT = "checkpoint.npz"
STUDY = "study.toml"
SERIES = ("sweep.json", "repeats.json")  # the index of a folder with many runs
_STAGING = "unfinished"
_MOST_BYTES = 16_000_000  # of an index; of sixty sensors and two hundred models it has 500 kB
_LONGEST_NAME = 4096  # letters of a file in the folder
# a list of numbers over several lines; a text in JSON never has a line break inside
_NUMBERS = re.compile(r'\[(\n[^\[\]{}"]*)\]')


class ResultFolder:
    """A folder for one result.

    Parameters
    ----------
    path : Path
        The folder; made where it is missing.
    overwrite : bool
        Take the place of a result that is there.
    resume : bool
        Go on with the run that was cut off here, or with the finished one.

    Attributes
    ----------
    staging : Path
        Where files are to be written before `commit`.

    Raises
    ------
    StudyError
        If the path is a file, or the folder holds something that may not be replaced.
    MachineError
        If the folder cannot be written to.
    """

    def __init__(self, path: Path, *, overwrite: bool = False, resume: bool = False) -> None:
        self.path = path
        self.staging = path / _STAGING
        with machine_errors(path):
            if path.exists() and not path.is_dir():
                raise StudyError(f"{path}: is a file; the result needs a folder")
            if resume:
                self._refuse_nothing_to_go_on_with()
            else:
                self._refuse_what_is_there(overwrite)
            self._made = made_folders(path)
            try:
                if self.staging.exists() and not resume:
                    shutil.rmtree(self.staging)
                self.staging.mkdir(exist_ok=True)
                if resume:
                    self._take_back()
                (self.staging / INDEX).touch()  # a folder may exist and yet take no file
                (self.staging / INDEX).unlink()
            except OSError:
                self._remove_empty()
                raise

    @property
    def checkpoint(self) -> Path:
        """Where the state of the search is kept while it runs, and after."""
        return self.staging / CHECKPOINT

    def keep_study(self, text: str) -> None:
        """Write the study as run beside the checkpoint, for a search to go on from."""
        with machine_errors(self.path):
            (self.staging / STUDY).write_text(text, encoding="utf-8")

    def commit(self) -> None:
        """Put the files of ``staging`` in their places; those of an older result go.

        Raises
        ------
        MachineError
            If a file cannot be renamed; those not yet in place stay in ``staging``.
        """
        with machine_errors(self.path):
            old = manifest(self.path)
            (self.path / INDEX).unlink(missing_ok=True)
            _put_in_place(self.staging, self.path, old)

    def discard(self) -> bool:
        """Remove what was written, unless a search can go on from it; return whether it can."""
        finished = self.path / CHECKPOINT
        if self.checkpoint.exists() and not (
            finished.exists() and filecmp.cmp(self.checkpoint, finished, shallow=False)
        ):
            return True
        shutil.rmtree(self.staging, ignore_errors=True)
        self._remove_empty()
        return False

    def _refuse_what_is_there(self, overwrite: bool) -> None:
        """Raise if the folder holds what this run may not replace."""
        inside = sorted(entry.name for entry in self.path.iterdir()) if self.path.exists() else []
        if not inside:
            return
        if not overwrite and (self.staging / CHECKPOINT).exists():
            raise StudyError(
                f"{self.path}: holds a search that was cut off; go on with it by "
                f"--resume {self.path}, or start anew with --overwrite"
            )
        if INDEX in inside:
            manifest(self.path)  # or it is somebody else's result.json
            if not overwrite:
                raise StudyError(
                    f"{self.path}: holds a result already; replace it with --overwrite "
                    "or choose another folder"
                )
        elif inside != [_STAGING]:
            shown = ", ".join(inside[:3]) + (", ..." if len(inside) > 3 else "")
            raise StudyError(
                f"{self.path}: is not empty and holds no result of glvis ({shown}); "
                "choose another folder"
            )

    def _refuse_nothing_to_go_on_with(self) -> None:
        """Raise unless a search was cut off here, or ended and kept its state."""
        if self.checkpoint.exists():
            return
        for name in (STUDY, CHECKPOINT):
            if not self._finished(name).is_file():
                raise StudyError(
                    f"{self.path}: holds no search that could go on ({name} is missing)"
                )

    def _take_back(self) -> None:
        """Copy checkpoint and study of a finished result into ``staging``, to go on from."""
        if not self.checkpoint.exists():
            for name in (STUDY, CHECKPOINT):  # the checkpoint last: it says that all is there
                if self._finished(name) != self.staging / name:
                    shutil.copyfile(self._finished(name), self.staging / name)

    def _finished(self, name: str) -> Path:
        """Return a file of a result; the study of one killed in `commit` may not be there yet."""
        is_late = name == STUDY and not (self.path / name).exists()
        return (self.staging if is_late else self.path) / name

    def _remove_empty(self) -> None:
        """Remove the folders that were made for this run and hold nothing."""
        for folder in reversed(self._made):
            remove_if_empty(folder)


@contextmanager
def result_folder(
    path: Path, *, overwrite: bool = False, resume: bool = False, series: Path | None = None
) -> Iterator[ResultFolder]:
    """Give a folder to write into; commit it at the end, discard it if something is raised.

    Parameters
    ----------
    path, overwrite, resume
        See ``ResultFolder``.
    series : Path, optional
        Folder of the series that the run belongs to, and that one goes on with.
    """
    folder = ResultFolder(path, overwrite=overwrite, resume=resume)
    try:
        yield folder
        folder.commit()
    except BaseException as error:
        if folder.discard() and isinstance(error, MachineError):
            raise MachineError(
                f"{error}; the search can go on from where it was: "
                f"{command('optimize', '--resume', series or path)}"
            ) from error
        raise


@contextmanager
def renewed_files(path: Path, prefixes: Sequence[str] = ()) -> Iterator[Path]:
    """Give a folder to write into; its files take their places in a result at the end.

    Parameters
    ----------
    path : Path
        A folder with a result.
    prefixes : sequence of str
        Files of the result that begin so, as "views/", go unless they are written anew.
    """
    staging = path / f"{_STAGING}-files"
    with machine_errors(path):
        shutil.rmtree(staging, ignore_errors=True)
        staging.mkdir()
    try:
        yield staging
        with machine_errors(path):
            kept, new = manifest(path), files_below(staging)
            old = [name for name in kept if name.startswith(tuple(prefixes)) or name in new]
            names = {*kept} - {*old} | {*new}
            _put_in_place(staging, path, old)
            write_index(path / INDEX, read_index(path / INDEX) | {"files": sorted(names)})
    finally:
        shutil.rmtree(staging, ignore_errors=True)


def remove_result(path: Path) -> None:
    """Remove a result, whole or unfinished; and its folder, where nothing else is inside."""
    if path.is_dir():
        with machine_errors(path):
            _remove(path, manifest(path))
            shutil.rmtree(path / _STAGING, ignore_errors=True)
            remove_if_empty(path)


def can_resume(path: Path) -> bool:
    """Return whether a folder holds the state of a search, cut off or ended."""
    return any((folder / CHECKPOINT).is_file() for folder in (path, path / _STAGING))


def files_below(folder: Path) -> list[str]:
    """Return the files in a folder and its folders, as sorted relative paths with "/"."""
    return sorted(p.relative_to(folder).as_posix() for p in folder.rglob("*") if p.is_file())


def manifest(folder: Path) -> list[str]:
    """Return the files that the result in a folder consists of; none where there is no result.

    Raises
    ------
    StudyError
        If ``result.json`` is not glvis' own.
    """
    path = folder / INDEX
    if not path.exists():
        return []
    names = read_index(path).get("files")
    if not isinstance(names, list) or not all(_is_inside(name) for name in names):
        raise StudyError(f"{path}: is no result of glvis: its list of files is broken")
    return names


def read_index(path: Path) -> dict[str, Any]:
    """Return what a ``result.json`` says.

    Raises
    ------
    StudyError
        If it is missing, cannot be read, or is not glvis' own.
    """
    try:
        found = read_json(path, _MOST_BYTES)
    except FileNotFoundError:
        raise StudyError(f"{path}: does not exist{_hint_of_runs(path.parent)}") from None
    except OSError as error:
        raise StudyError(f"{path}: cannot be read: {error.strerror}") from None
    except ValueError as error:  # not UTF-8, not JSON, no plain file
        raise StudyError(f"{path}: {error}") from None
    if not isinstance(found, dict) or "glvis_schema" not in found:
        raise StudyError(f"{path}: is no result of glvis")
    return found


def write_index(path: Path, content: Mapping[str, Any]) -> None:
    """Write a JSON file such as ``result.json``, whole or not at all; floats are exact."""
    text = json.dumps(content, indent=1, ensure_ascii=False, allow_nan=False)
    # lists of numbers in one line each, as people write matrices
    text = _NUMBERS.sub(lambda found: "[" + " ".join(found[1].split()) + "]", text)
    write_whole(path, text + "\n")


def write_whole(path: Path, text: str) -> None:
    """Write a text file; until it is whole, the one before stays."""
    part = path.with_name(f"{path.name}.part")
    part.write_text(text, encoding="utf-8")
    part.replace(path)


def series_index(folder: Path) -> Path | None:
    """Return the index of a folder that holds many runs, or None where it is no such folder."""
    return next((folder / name for name in SERIES if (folder / name).is_file()), None)


def _hint_of_runs(folder: Path) -> str:
    """Return which of a folder's runs somebody may have meant, or nothing."""
    index = series_index(folder)
    runs = sorted(found.parent for found in folder.glob(f"run-*/{INDEX}")) if index else []
    return f"; the folder holds many runs, name one, such as {runs[0]}" if runs else ""


def _put_in_place(staging: Path, path: Path, old: Sequence[str]) -> None:
    """Rename all files of ``staging`` into a folder, the index last; remove the other old ones."""
    new = files_below(staging)
    for name in sorted(new, key=INDEX.__eq__):
        target = path / name
        if target.exists() and name not in old:
            target.rename(target.with_name(f"{target.name}.kept"))
        target.parent.mkdir(parents=True, exist_ok=True)
        (staging / name).replace(target)
    _remove(path, set(old) - set(new))
    shutil.rmtree(staging)


def _remove(path: Path, names: Iterable[str]) -> None:
    """Remove files of a folder, and the folders inside that hold nothing without them."""
    for name in names:
        (path / name).unlink(missing_ok=True)
    for folder in sorted({(path / name).parent for name in names} - {path}, reverse=True):
        remove_if_empty(folder)


def _is_inside(name: object) -> bool:
    """Return whether a name of a list that anybody may have written stays in its folder."""
    is_name = isinstance(name, str) and "\0" not in name and 0 < len(name) <= _LONGEST_NAME
    return is_name and not {"", "..", "."} & set(str(name).split("/"))


def made_folders(path: Path) -> list[Path]:
    """Make a folder and those above it; return the new ones, outermost first."""
    missing = [folder for folder in (path, *path.parents) if not folder.exists()]
    path.mkdir(parents=True, exist_ok=True)
    return missing[::-1]


def remove_if_empty(folder: Path) -> None:
    """Remove a folder unless something is in it."""
    try:
        folder.rmdir()
    except OSError as error:
        if error.errno not in (errno.ENOTEMPTY, errno.EEXIST, errno.ENOENT):
            raise


@contextmanager
def machine_errors(path: Path) -> Iterator[None]:
    """Say in one line what the file system refused."""
    try:
        yield
    except (FileExistsError, NotADirectoryError) as error:
        raise StudyError(f"{path}: cannot be a folder: {error.filename} is a file") from error
    except OSError as error:
        raise MachineError(f"{path}: cannot be written to: {error.strerror or error}") from error
