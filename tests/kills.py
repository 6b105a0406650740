"""What a killed process leaves: the folder as it is before each change of the file system.

A process that is killed leaves the files as they are, whatever it had in mind. So one run that is
watched shows every state that a kill can leave, and each of them is then gone on from.
"""

from __future__ import annotations

import os
import shutil
import sys
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path

import numpy as np

from glvis.outputs.lock import LOCK

_CHANGES = ("os.mkdir", "os.rename", "os.remove", "os.rmdir", "os.link", "os.symlink")
_watchers: list[Callable[[str, tuple], None]] = []  # a hook cannot be taken away again


def _hook(event: str, args: tuple) -> None:
    if _watchers and (event == "open" or event in _CHANGES):
        for watcher in tuple(_watchers):
            watcher(event, args)


sys.addaudithook(_hook)


class Watch:
    """Keeps what a kill before each change below a folder would leave, as folders of their own.

    A file that is being written is left empty, and half of it, besides.
    """

    def __init__(self, root: Path, kept: Path) -> None:
        self.root, self.kept = root, kept
        self.names: list[str] = []  # what was about to be done, by number
        self._is_busy = threading.local()
        self._lock = threading.Lock()
        self._written: Path | None = None  # the file that was opened last

    def folders(self) -> list[Path]:
        """Return what was kept, in order."""
        return [self.kept / str(number) for number in range(len(self.names))]

    def see(self, event: str, args: tuple) -> None:
        """Keep the folder before something is changed in it."""
        if getattr(self._is_busy, "now", False):
            return
        self._is_busy.now = True
        try:
            with self._lock:
                self._see(event, args)
        finally:
            self._is_busy.now = False

    def _see(self, event: str, args: tuple) -> None:
        path = args[0]
        if event == "open":
            flags = args[2]
            if not flags & (os.O_WRONLY | os.O_RDWR) or not self._is_ours(path):
                return
        elif not (self._is_ours(path) or (event != "os.rename" and args[-1] not in (-1, None))):
            return
        if self._written and self._written.is_file():
            half = self._written.stat().st_size // 2
            self._keep(f"half of {self._written.name} is written", self._written, half)
        self._written = None
        self._keep(f"{event} {path}")
        if event == "open":
            self._written = Path(os.fsdecode(path))
            if self._written.name != LOCK:
                self._keep(f"opened {path}", self._written, 0)

    def _is_ours(self, path: object) -> bool:
        if not isinstance(path, str | bytes | os.PathLike):
            return False
        return Path(os.fsdecode(path)).is_relative_to(self.root)

    def _keep(self, name: str, torn: Path | None = None, size: int = 0) -> None:
        copy = self.kept / str(len(self.names))
        if self.root.exists():
            shutil.copytree(self.root, copy, ignore=shutil.ignore_patterns(LOCK), symlinks=True)
            for lock in self.root.rglob(LOCK):  # to open and close it would let go of it
                (copy / lock.relative_to(self.root)).touch()
        if torn is not None:
            place = copy / torn.relative_to(self.root)
            with place.open("r+b" if place.exists() else "wb") as file:
                file.truncate(size)
        self.names.append(name)


@contextmanager
def watched(root: Path, kept: Path) -> Iterator[Watch]:
    """Watch what is changed below a folder."""
    watch = Watch(root, kept)
    _watchers.append(watch.see)
    try:
        yield watch
    finally:
        _watchers.remove(watch.see)


def contents(folder: Path) -> dict[str, object]:
    """Return all that is in a folder, by name; of checkpoints the arrays, as zip notes the time."""
    found: dict[str, object] = {}
    for path in sorted(folder.rglob("*")):
        name = path.relative_to(folder).as_posix()
        found[name] = _bytes_of(path) if path.is_file() else "folder"
    return found


def _bytes_of(path: Path) -> bytes:
    if path.suffix == ".npz" and path.stat().st_size:
        try:
            with np.load(path) as arrays:
                return b"".join(
                    name.encode() + arrays[name].tobytes() for name in sorted(arrays.files)
                )
        except (ValueError, OSError, EOFError, KeyError):
            pass  # half of one
        except Exception as error:  # zipfile.BadZipFile
            assert "zip" in type(error).__name__.lower(), error
    return path.read_bytes()
