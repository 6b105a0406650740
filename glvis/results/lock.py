"""One process at a time writes into a folder; what the system knows of that ends with the process.

The lock is SQLite's, on an empty file: SQLite knows how to lock a file on every system, and the
system lets go of it when the process ends, however it ends. A file that is left over from a
killed process locks nothing.
"""

from __future__ import annotations

import os
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Any

from glvis.errors import StudyError

LOCK = "unfinished.lock"
_TRIES = 10  # another process may remove the file while this one opens it


@contextmanager
def held(path: Path) -> Iterator[None]:
    """Keep an existing folder to this process while it writes there.

    Where files cannot be locked, as on some network drives, all goes on without.

    Raises
    ------
    StudyError
        If another process is at work in the folder, or the lock is a symbolic link.
    """
    lock = path / LOCK
    if lock.is_symlink():
        raise StudyError(f"{lock}: is a symbolic link; none is followed; remove it")
    connection = _locked(lock)
    try:
        yield
    finally:
        if connection:
            try:
                with suppress(OSError):  # while it is held: nobody else can hold this file
                    lock.unlink()
            finally:
                connection.close()
            if os.name == "nt":  # no file that is open can be removed
                with suppress(OSError):
                    lock.unlink()


def _locked(lock: Path) -> Any:
    """Return what holds the lock while it is open, None where files cannot be locked."""
    for _ in range(_TRIES):
        try:
            lock.touch()
            before = lock.stat().st_ino
        except OSError:
            return None
        connection, is_taken = _connected(lock)
        if is_taken and _can_lock(lock.parent):
            raise StudyError(
                f"{lock.parent}: another glvis is at work in this folder; wait until it has ended "
                "or choose another folder"
            )
        if connection is None:  # nothing can be locked here
            with suppress(OSError):
                lock.unlink()
            return None
        with suppress(OSError):
            if lock.stat().st_ino == before:
                return connection
        connection.close()  # of a file that was removed meanwhile
    return None


def _connected(lock: Path) -> tuple[Any, bool]:
    """Return what holds a lock, or None and whether somebody else holds it."""
    try:
        import sqlite3
    except ImportError:  # a Python that was built without
        return None, False
    connection = None
    try:
        connection = sqlite3.connect(lock, timeout=0, isolation_level=None, check_same_thread=False)
        connection.execute("PRAGMA journal_mode = OFF")  # no second file
        connection.execute("BEGIN EXCLUSIVE")
    except sqlite3.Error as error:
        if connection:
            connection.close()
        return None, getattr(error, "sqlite_errorcode", None) == sqlite3.SQLITE_BUSY
    return connection, False


def _can_lock(folder: Path) -> bool:
    """Return whether a new file can be locked: drives without locks call every file taken."""
    try:
        with tempfile.TemporaryDirectory(prefix=f"{LOCK}-", dir=folder) as scratch:
            connection, _ = _connected(Path(scratch) / LOCK)
            if connection:
                connection.close()
            return connection is not None
    except OSError:
        return True
