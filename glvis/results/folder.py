"""The folder a run writes: refused before the run starts, filled whole when it has ended.

Files are written into ``unfinished/`` inside the folder and renamed into place at the end,
``result.json`` last: a folder without it holds no result. What is inside already and was not
written by glvis is never touched. A run that is killed at any moment can go on; see ``files``.
"""

from __future__ import annotations

import filecmp
import json
import re
import shutil
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from glvis.common.files import read_json
from glvis.common.hints import command
from glvis.errors import MachineError, StudyError
from glvis.results.journal import (
    files_below,
    is_inside,
    is_settled_by_next,
    machine_errors,
    made_folders,
    put_in_place,
    refuse_links,
    remove_if_empty,
    settle,
    whole_file,
    write_whole,
)
from glvis.results.lock import LOCK, held

INDEX = "result.json"  # names every file of the result; written last
CHECKPOINT = "checkpoint.npz"
STUDY = "study.toml"
VIEWS, EXPORTS = "views", "exports"  # folders inside
# The index of a folder with many runs; the last one is by builds that said sweep for vary.
SERIES = ("vary.json", "repeats.json", "sweep.json")
_MOST_BYTES = 16_000_000  # of an index; of sixty sensors and two hundred models it has 500 kB
STAGING, RENEWAL = "unfinished", "unfinished-files"  # of a run; of what goes with results
OWN = (STAGING, RENEWAL, LOCK)  # what may be left over from a process that was killed
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
    goes_on : bool
        Whether there is the state of a search to go on from; without it the search that was
        killed before its first iteration begins anew.

    Raises
    ------
    StudyError
        If the path is a file, or the folder holds something that may not be replaced.
    MachineError
        If the folder cannot be written to.
    """

    def __init__(self, path: Path, *, overwrite: bool = False, resume: bool = False) -> None:
        self.path = path
        self.staging = path / STAGING
        self.goes_on, self._resumes = False, resume
        with machine_errors(path):
            if path.exists() and not path.is_dir():
                raise StudyError(f"{path}: is a file; the result needs a folder")
            settle(path, (STAGING, RENEWAL))
            refuse_links(path, manifest(path), (VIEWS, EXPORTS))
            if resume:
                self._refuse_nothing_to_go_on_with()
            else:
                self._refuse_what_is_there(overwrite)
            path.mkdir(parents=True, exist_ok=True)
            shutil.rmtree(path / RENEWAL, ignore_errors=True)
            self._clear(resume)
            try:
                (self.staging / INDEX).touch()  # a folder may exist and yet take no file
                (self.staging / INDEX).unlink()
            except OSError:
                remove_if_empty(self.staging)
                raise

    @property
    def checkpoint(self) -> Path:
        """Where the state of the search is kept while it runs, and after."""
        return self.staging / CHECKPOINT

    def keep_study(self, text: str) -> None:
        """Write the study as run beside the checkpoint, for a search to go on from."""
        with machine_errors(self.path):
            write_whole(self.staging / STUDY, text)

    def commit(self) -> None:
        """Put the files of ``staging`` in their places; those of an older result go.

        Raises
        ------
        StudyError
            If a symbolic link would lead outside.
        MachineError
            If a file cannot be renamed; those not yet in place stay in ``staging``.
        """
        with machine_errors(self.path):
            put_in_place(self.staging, self.path, manifest(self.path), [INDEX])

    def discard(self) -> bool:
        """Remove what was written, unless a search can go on from it; return whether it can."""
        if is_settled_by_next(self.staging) or (self._resumes and not self.goes_on):
            return True
        finished = self.path / CHECKPOINT
        if self.checkpoint.exists() and not (
            finished.exists() and filecmp.cmp(self.checkpoint, finished, shallow=False)
        ):
            return True
        shutil.rmtree(self.staging, ignore_errors=True)
        return False

    def _refuse_what_is_there(self, overwrite: bool) -> None:
        """Raise if the folder holds what this run may not replace."""
        inside = sorted(entry.name for entry in self.path.iterdir()) if self.path.exists() else []
        inside = [name for name in inside if name not in OWN]
        is_cut_off = self.checkpoint.exists()
        if is_cut_off and not overwrite:
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
        elif inside and not is_cut_off:
            shown = ", ".join(inside[:3]) + (", ..." if len(inside) > 3 else "")
            raise StudyError(
                f"{self.path}: is not empty and holds no result of glvis ({shown}); "
                "choose another folder"
            )

    def _refuse_nothing_to_go_on_with(self) -> None:
        """Raise unless a search was cut off here, or ended and kept its state."""
        for name in (STUDY, CHECKPOINT):
            if (self.staging / name).is_symlink():
                raise StudyError(f"{self.staging / name}: is a symbolic link; remove it")
        if self.checkpoint.exists() or self._begins():
            return
        for name in (STUDY, CHECKPOINT):
            if not self._finished(name).is_file():
                raise StudyError(
                    f"{self.path}: holds no search that could go on ({name} is missing)"
                )

    def _begins(self) -> bool:
        """Return whether a search was cut off before it had any state."""
        kept, finished = self.staging / STUDY, self.path / STUDY
        if self.checkpoint.exists() or not kept.is_file():
            return False
        if not (self.path / CHECKPOINT).is_file():
            return True
        return finished.is_file() and not filecmp.cmp(kept, finished, shallow=False)

    def _clear(self, resume: bool) -> None:
        """Leave in ``staging`` what a search goes on from, and nothing else."""
        study, keeps = None, set()
        if resume and (self.checkpoint.exists() or self._begins()):
            self.goes_on, keeps = self.checkpoint.exists(), {STUDY, CHECKPOINT}
        elif resume:
            self.goes_on, study = True, self._finished(STUDY).read_bytes()
        for entry in self.staging.iterdir() if self.staging.exists() else ():
            if entry.is_dir() and not entry.is_symlink():
                shutil.rmtree(entry)
            elif entry.name not in keeps:
                entry.unlink()
        self.staging.mkdir(exist_ok=True)
        if study is not None:
            with whole_file(self.staging / STUDY) as part:
                part.write_bytes(study)
            # the checkpoint last: it says that all is there
            with whole_file(self.checkpoint) as part:
                shutil.copyfile(self.path / CHECKPOINT, part)

    def _finished(self, name: str) -> Path:
        """Return a file of a result; the study of one killed in `commit` may not be there yet."""
        is_late = name == STUDY and not (self.path / name).exists()
        return (self.staging if is_late else self.path) / name


@contextmanager
def own_folder(path: Path) -> Iterator[None]:
    """Make a folder and keep it to this process; it goes in the end if nothing is in it."""
    if path.exists() and not path.is_dir():
        yield  # to be refused by those who know what it is for
        return
    with machine_errors(path):
        made = made_folders(path)
    try:
        with held(path):
            yield
    finally:
        with machine_errors(path):
            for folder in reversed(made):
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

    Raises
    ------
    StudyError
        If another process writes into the folder, or ``ResultFolder`` refuses it.
    MachineError
        If it cannot be written to.
    """
    with own_folder(path):
        folder = ResultFolder(path, overwrite=overwrite, resume=resume)
        try:
            yield folder
            folder.commit()
        except BaseException as error:
            is_left = folder.discard()
            if is_settled_by_next(folder.staging) and isinstance(error, StudyError | MachineError):
                raise type(error)(
                    f"{error}; the result is whole: what writes into {path} next puts the rest "
                    "in place"
                ) from error
            if is_left and isinstance(error, MachineError):
                raise MachineError(
                    f"{error}; the search can go on from where it was: "
                    f"{command('optimize', '--resume', series or path)}"
                ) from error
            raise


def settle_folder(path: Path) -> None:
    """Put in place what a killed process had written whole, and remove what else it has left.

    The state of a search stays.

    Raises
    ------
    StudyError
        If another process is at work there, or a symbolic link would lead outside.
    MachineError
        If the folder cannot be written to.
    """
    with machine_errors(path):
        if is_settled_by_next(path / STAGING) or any(
            (path / name).exists() for name in (RENEWAL, LOCK)
        ):
            with held(path):
                settle(path, (STAGING, RENEWAL))
                shutil.rmtree(path / RENEWAL, ignore_errors=True)


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
    settle_folder(path)
    read_index(path / INDEX)
    staging = path / RENEWAL
    with held(path):
        with machine_errors(path):
            refuse_links(path, manifest(path), (VIEWS, RENEWAL))
            shutil.rmtree(staging, ignore_errors=True)
            staging.mkdir()
        try:
            yield staging
            with machine_errors(path):
                kept, new = manifest(path), files_below(staging)
                old = [name for name in kept if name.startswith(tuple(prefixes)) or name in new]
                names = {*kept} - {*old} | {*new}
                write_index(staging / INDEX, read_index(path / INDEX) | {"files": sorted(names)})
                put_in_place(staging, path, [*old, INDEX], [INDEX], renews=True)
        finally:
            if not is_settled_by_next(staging):
                shutil.rmtree(staging, ignore_errors=True)


def can_resume(path: Path) -> bool:
    """Return whether a folder holds the state of a search, cut off or ended."""
    return any((folder / CHECKPOINT).is_file() for folder in (path, path / STAGING))


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
    if not isinstance(names, list) or not all(map(is_inside, names)):
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
        raise StudyError(f"{path}: does not exist{_hint(path.parent)}") from None
    except NotADirectoryError:
        raise StudyError(f"{path.parent}: is a file, not the folder of a result") from None
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


def series_index(folder: Path) -> Path | None:
    """Return the index of a folder that holds many runs, or None where it is no such folder."""
    return next((folder / name for name in SERIES if (folder / name).is_file()), None)


def _hint(folder: Path) -> str:
    """Return what somebody may have meant by a folder without a result, or nothing."""
    if any(is_settled_by_next(folder / name) for name in (STAGING, RENEWAL)):
        return (
            "; a run was killed while it put its files in place, and what writes into the "
            f"folder next does the rest, as glvis render {folder}"
        )
    if (folder / STAGING / CHECKPOINT).is_file():
        return f"; a search was cut off there: glvis optimize --resume {folder} goes on with it"
    index = series_index(folder)
    runs = sorted(found.parent for found in folder.glob(f"run-*/{INDEX}")) if index else []
    return f"; the folder holds many runs, name one, such as {runs[0]}" if runs else ""
