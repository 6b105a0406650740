"""Reads files that anybody may have written: plain files only, and no larger than told.

A pipe would be waited for, a device never ends, and an archive of a few bytes may unfold to more
than fits in memory. What is read is whole; what it means is the business of a schema.
"""

from __future__ import annotations

import errno
import io
import json
import math
import os
import re
import stat
import tomllib
import unicodedata
import zipfile
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from glvis.common.complaints import shortened

DEEPEST = 40  # tables or lists in each other; a study needs six
WITHOUT_BACKSLASH = "write '/' in place of '\\'"  # of paths that Windows wrote
MOST_TOML = 300_000  # letters; five hundred mounts, and our longest study has 5,000
_MB = 1_000_000
# A dotted key at the beginning of a line, table or entry.
_PART = r"""(?:[\w-]++|"[^"\n]*+"|'[^'\n]*+')[ \t]*+"""
_DEEP_KEY = re.compile(rf"""(?m)(?:^|[\[{{,])[ \t]*+(?:{_PART}\.[ \t]*+){{{DEEPEST}}}""")
# What the reader of TOML says of "C:\parts" and of "C:\Users".
_BACKSLASH = re.compile(r"Unescaped '\\'|hex value")
# Letters that would break a line, and halves of letters, which stand for bytes that are no UTF-8.
_BREAKS = {"Cc", "Cs", "Zl", "Zp"}
_HEADERS = {
    (1, 0): np.lib.format.read_array_header_1_0,
    (2, 0): np.lib.format.read_array_header_2_0,
}


def check_plain(path: Path, most: int) -> None:
    """Refuse what is no plain file or larger than ``most`` bytes.

    Raises
    ------
    ValueError
        The bare fact, without the path.
    OSError
        If there is no such file, or it is a folder.
    """
    found = path.stat()
    if stat.S_ISDIR(found.st_mode):
        raise IsADirectoryError(errno.EISDIR, os.strerror(errno.EISDIR), str(path))
    if not stat.S_ISREG(found.st_mode):
        raise ValueError("is no plain file but a pipe, a socket or a device")
    if found.st_size > most:
        raise ValueError(f"is larger than {most / _MB:.3g} MB, the most that is read")


def read_bytes(path: Path, most: int) -> bytes:
    """Return what a plain file of at most so many bytes holds; errors as of ``check_plain``."""
    check_plain(path, most)
    with path.open("rb") as file:
        return file.read(most)


def read_text(path: Path, most: int) -> str:
    """Return a text in UTF-8, without the mark that Windows puts first, in lines of one kind.

    Raises
    ------
    UnicodeDecodeError
        If it is none; else as of ``check_plain``.
    """
    return io.TextIOWrapper(io.BytesIO(read_bytes(path, most)), encoding="utf-8-sig").read()


def toml_tables(text: str) -> dict[str, Any]:
    """Return the tables of TOML text, no deeper than ``DEEPEST``.

    Raises
    ------
    ValueError
        If it is no TOML, in one line.
    """
    if len(text) > MOST_TOML:  # its reader takes the longer the more there is at once
        raise ValueError(f"is larger than {MOST_TOML / _MB:.3g} MB, the most that is read")
    try:
        if _DEEP_KEY.search(text):  # a key of n parts would take n squared
            raise RecursionError
        found = tomllib.loads(text)
        check_depth(found)
    except tomllib.TOMLDecodeError as error:
        advice = f"; {WITHOUT_BACKSLASH}" if _BACKSLASH.search(str(error)) else ""
        raise ValueError(f"is no TOML: {shortened(str(error), 200)}{advice}") from None
    except RecursionError:
        raise ValueError("is no TOML: nested too deeply") from None
    return found


def read_json(path: Path, most: int) -> Any:
    """Return what a JSON file says, see ``json_value``.

    Raises
    ------
    ValueError
        The bare fact, without the path.
    OSError
        If the file cannot be read.
    """
    try:
        text = read_text(path, most)
    except UnicodeDecodeError as error:
        raise ValueError(f"is no JSON: no text in UTF-8 (byte {error.start})") from None
    return json_value(text)


def json_value(text: str) -> Any:
    """Return what a JSON text says: no deeper than ``DEEPEST``, every text of whole letters.

    Raises
    ------
    ValueError
        The bare fact.
    """
    try:
        found = json.loads(text)
        check_depth(found)
    except RecursionError:
        raise ValueError("is no JSON: nested too deeply") from None
    except ValueError as error:
        raise ValueError(f"is no JSON: {shortened(str(error), 200)}") from None
    check_text(found)
    return found


def read_npz(path: Path, most: int) -> dict[str, NDArray[Any]]:
    """Return the arrays of an ``.npz`` archive by name.

    Parameters
    ----------
    path : Path
        The file.
    most : int
        Bytes that all arrays together may have.

    Raises
    ------
    ValueError
        If it is no such archive, holds objects, or promises more than it holds or is read.
    OSError
        If the file cannot be read.
    """
    check_plain(path, most + _MB)
    try:
        with zipfile.ZipFile(path) as archive:
            members = archive.infolist()
            if sum(member.file_size for member in members) > most + _MB:
                raise ValueError(f"unfolds to more than {most / _MB:.3g} MB")
            return {m.filename.removesuffix(".npy"): _array(archive.read(m)) for m in members}
    except OSError as error:
        if error.errno != errno.EINVAL:  # of an offset in the archive, not of the file
            raise
        raise ValueError("is no archive of arrays: it is cut or spliced") from None
    except Exception as error:  # zip, its methods and NumPy's header fail in ways of their own
        fact = shortened(str(error)) or type(error).__name__
        raise ValueError(f"is no archive of arrays: {fact}") from error


def check_depth(tables: Any) -> None:
    """Raise RecursionError where tables and lists are nested deeper than ``DEEPEST``."""
    level, depth = [tables], 0
    while level := [
        inner
        for outer in level
        if isinstance(outer, dict | list)
        for inner in (outer.values() if isinstance(outer, dict) else outer)
    ]:
        depth += 1
        if depth > DEEPEST:
            raise RecursionError


def check_text(tables: Any) -> None:
    """Refuse texts and keys in nested tables that no file could hold: halves of letters."""
    left = [tables]
    while left:
        one = left.pop()
        if isinstance(one, str) and not is_unicode(one):
            raise ValueError("has a text that is no Unicode")
        if isinstance(one, dict):
            left += [*one, *one.values()]
        elif isinstance(one, list):
            left += one


def is_unicode(text: str) -> bool:
    """Return whether a text can be written down; names of bytes that are no UTF-8 cannot."""
    return text.isascii() or not any("\ud800" <= letter <= "\udfff" for letter in text)


def is_one_line(text: str) -> bool:
    """Return whether a text is Unicode without line breaks or other controls."""
    return not any(unicodedata.category(letter) in _BREAKS for letter in text)


def in_one_line(text: str) -> str:
    """Return a text for people in one line: breaks become spaces, other controls go."""
    words = " ".join(text.split())
    return "".join(letter for letter in words if unicodedata.category(letter) not in _BREAKS)


def printable(name: str | os.PathLike[str]) -> str:
    """Return a name with what cannot be printed as escapes, such as bytes that are no UTF-8."""
    text = os.fsencode(name).decode("utf-8", "backslashreplace")
    return "".join(
        letter.encode("unicode_escape").decode() if not is_one_line(letter) else letter
        for letter in text
    )


def _array(data: bytes) -> NDArray[Any]:
    """Return the array of an ``.npy`` file, no more of it than there are bytes."""
    file = io.BytesIO(data)
    version = np.lib.format.read_magic(file)
    shape, is_fortran, dtype = _HEADERS[version](file)
    if dtype.hasobject:
        raise ValueError("it holds objects")
    if min(shape, default=1) < 0 or math.prod(shape) * dtype.itemsize != len(data) - file.tell():
        raise ValueError("an array promises more than it holds")
    flat = np.frombuffer(data, dtype, offset=file.tell())
    return flat.reshape(shape, order="F" if is_fortran else "C").copy()
