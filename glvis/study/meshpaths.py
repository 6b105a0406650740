"""Which mesh files a study means: names and patterns beside it, each file once and by its stem."""

from __future__ import annotations

import fnmatch
import os
from collections import Counter
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path

from glvis.common.complaints import shortened
from glvis.common.files import WITHOUT_BACKSLASH, is_one_line, is_unicode, printable
from glvis.errors import StudyError

_MOST_LOOKED_AT = 100_000  # files and folders that patterns of a study may lead through
_MAGIC = frozenset("*?[")
_ANY_DEPTH = "**"
NAMES_KEY = "sensors"  # of visibility.npz, beside one key a model


def mesh_paths(patterns: Sequence[str], folder: Path, key: str) -> list[Path]:
    """Return the absolute paths of meshes; a pattern's files come sorted by name.

    Parameters
    ----------
    patterns : sequence of str
        Names, or patterns with ``*``, ``?``, ``[...]`` and ``**`` (folders of any depth).
    folder : Path
        Absolute; what they are relative to.
    key : str
        Of the study, for messages.

    Raises
    ------
    StudyError
        If a pattern matches no file or leads through too many, or a name cannot be one.
    """
    found: list[Path] = []
    for pattern in patterns:
        plain = folder / pattern
        if _is_file(plain, key) or not _MAGIC & {*pattern}:
            if (advice := _advice(pattern)) and not plain.exists():
                raise StudyError(
                    f"{key} = '{shortened(printable(pattern))}' does not exist{advice}"
                )
            found.append(plain)
            continue
        matches = sorted(_Walk(pattern).files(folder), key=str)
        if not matches:
            raise StudyError(
                f"{key} = '{shortened(printable(pattern))}' matches no file in {folder}"
                f"{_advice(pattern)}"
            )
        found += matches
    for path in found:
        if not is_unicode(str(path)):
            raise StudyError(
                f"{key}: {printable(path)} has a name that is no UTF-8, which no result can hold; "
                "rename the file or its folder"
            )
        if not is_one_line(path.stem):
            raise StudyError(
                f"{key}: {printable(path)} has a line break or control in its name; rename it"
            )
    return found


def check_names(models: Sequence[Path], obstacles: Sequence[Path]) -> None:
    """Refuse models that results could not tell apart, and models in their own way.

    Raises
    ------
    StudyError
        The two that are alike.
    """
    # not Path.resolve, which refuses links that lead in a circle: whoever reads them will
    real = {file: os.path.realpath(file) for file in (*models, *obstacles)}
    files = Counter(real[file] for file in models)
    stems: dict[str, Path] = {}
    for file in models:
        if files[real[file]] > 1:
            raise StudyError(f"models: {file.name} is there twice")
        other = stems.setdefault(file.stem, file)
        if other is not file:
            raise StudyError(
                f"models: {other} and {file} have the same name '{file.stem}', "
                "by which results are filed; rename one"
            )
        if file.stem == NAMES_KEY:
            raise StudyError(f"models: a model cannot be called '{NAMES_KEY}'; rename {file.name}")
    for file in obstacles:
        if real[file] in files:
            raise StudyError(f"{file.name} is both a model and an obstacle")


def _advice(pattern: str) -> str:
    """Return what to do about a path as Windows writes it, or as TOML read its backslashes."""
    return f"; {WITHOUT_BACKSLASH}" if "\\" in pattern or not is_one_line(pattern) else ""


def _is_file(path: Path, key: str) -> bool:
    """Return whether there is a file of that name, or say why there cannot be one."""
    try:
        return path.is_file()
    except OSError as error:  # such as a name that is too long
        raise StudyError(f"{key} = '{shortened(path.name)}': {error.strerror}") from None


class _Walk:
    """Looks for the files of one pattern, and gives up where it would never end."""

    def __init__(self, pattern: str) -> None:
        self._pattern = pattern
        self._left = _MOST_LOOKED_AT

    def files(self, folder: Path) -> set[Path]:
        """Return all files below a folder that match."""
        parts = Path(self._pattern).parts
        if parts and Path(parts[0]).is_absolute():
            folder, parts = Path(parts[0]), parts[1:]
        try:
            return {path for path in self._below(folder, parts) if _is(path.is_file)}
        except RecursionError:
            raise self._too_much() from None

    def _below(self, folder: Path, parts: Sequence[str]) -> Iterator[Path]:
        if not parts:
            yield folder
            return
        first, rest = parts[0], parts[1:]
        if first == _ANY_DEPTH:
            yield from self._below(folder, rest)
            for entry in self._entries(folder):
                if not entry.name.startswith("."):
                    if _is(entry.is_dir):
                        if not _leads_back(entry):
                            yield from self._below(folder / entry.name, parts)
                    elif not rest:
                        yield folder / entry.name
        elif _MAGIC & {*first}:
            for entry in self._entries(folder):
                is_shown = not entry.name.startswith(".") or first.startswith(".")
                if is_shown and fnmatch.fnmatch(entry.name, first):
                    yield from self._below(folder / entry.name, rest)
        else:
            yield from self._below(folder / first, rest)

    def _entries(self, folder: Path) -> Iterator[os.DirEntry[str]]:
        """Yield what lies in a folder; nothing of one that is none or may not be read."""
        try:
            with os.scandir(folder) as entries:
                for entry in entries:
                    self._left -= 1
                    if self._left < 0:
                        raise self._too_much()
                    yield entry
        except OSError:
            return

    def _too_much(self) -> StudyError:
        return StudyError(
            f"'{shortened(self._pattern)}' leads through more than {_MOST_LOOKED_AT:,} files; "
            "name a folder nearer to the meshes"
        )


def _is(question: Callable[[], bool]) -> bool:
    """Return what a file says of itself, False where we may not ask."""
    try:
        return question()
    except OSError:
        return False


def _leads_back(entry: os.DirEntry[str]) -> bool:
    """Return whether a folder is a link to one that it lies in."""
    if not entry.is_symlink():
        return False
    above = Path(os.path.realpath(Path(entry.path).parent))
    return above.is_relative_to(os.path.realpath(entry.path))
