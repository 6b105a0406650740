"""What a killed process leaves: the folder as it is before each change of the file system.

A process that is killed leaves the files as they are, whatever it had in mind. So one run that is
watched shows every state that a kill can leave, and each of them is then gone on from.
"""

from __future__ import annotations

import os
import signal
import sys
import threading
import time
import zipfile
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from io import BytesIO
from itertools import count
from pathlib import Path

import numpy as np

from glvis.results.lock import LOCK

_CHANGES = ("os.mkdir", "os.rename", "os.remove", "os.rmdir", "os.link", "os.symlink")
_SETTLED = 0.1  # seconds after which a time stamp tells a file from the same one written again
_watchers: list[Callable[[str, tuple], None]] = []  # a hook cannot be taken away again

State = dict[str, bytes | None]  # files by name, None for folders; the folder itself is "."


def _hook(event: str, args: tuple) -> None:
    if _watchers and (event == "open" or event in _CHANGES):
        for watcher in tuple(_watchers):
            watcher(event, args)


sys.addaudithook(_hook)


class Folder:
    """A folder whose whole content is taken down, and brought back."""

    def __init__(self, root: Path) -> None:
        self.root = root
        self._known: dict[tuple[str, int, int, int], bytes] = {}

    def state(self) -> State:
        """Return all that is in the folder; what had not changed is not read again."""
        if not self.root.is_dir():
            return {}
        found: State = {".": None}
        for path in self.root.rglob("*"):
            name = path.relative_to(self.root).as_posix()
            found[name] = None if path.is_dir() else self._read(path)
        return found

    def put(self, state: State) -> None:
        """Make the folder what it was."""
        now = self.state()
        for name in sorted({*now} - {*state}, reverse=True):
            path = self.root / name
            path.unlink() if now[name] is not None else path.rmdir()
        for name, content in sorted(state.items()):
            if name not in now or content != now[name]:
                if content is None:
                    (self.root / name).mkdir()
                else:
                    (self.root / name).write_bytes(content)

    def _read(self, path: Path) -> bytes:
        if path.name == LOCK:  # to open and close it would let go of it
            return b""
        stat = path.stat()
        key = (str(path), stat.st_ino, stat.st_mtime_ns, stat.st_size)
        if key not in self._known:
            content = path.read_bytes()
            if time.time() - stat.st_mtime < _SETTLED:
                return content
            self._known[key] = content
        return self._known[key]


class Watch:
    """Keeps the states that kills before each change in a folder would leave.

    A file that is being written is left empty, and half of it, besides.
    """

    def __init__(self, folder: Folder) -> None:
        self.states: list[
            tuple[str, State]
        ] = []  # what was about to be done, and all that is there
        self._folder = folder
        self._is_busy = threading.local()
        self._lock = threading.Lock()
        self._written: Path | None = None  # the file that was opened last

    def see(self, event: str, args: tuple) -> None:
        """Keep the folder before something is changed in it."""
        if getattr(self._is_busy, "now", False) or not is_change(self._folder.root, event, args):
            return
        self._is_busy.now = True
        try:
            with self._lock:
                self._keep(event, args[0])
        finally:
            self._is_busy.now = False

    def _keep(self, event: str, path: object) -> None:
        state = self._folder.state()
        written = self._written and self._written.relative_to(self._folder.root).as_posix()
        if written and (content := state.get(written)):
            half = content[: len(content) // 2]
            self.states.append((f"half of {written} is written", {**state, written: half}))
        self._written = None
        self.states.append((f"{event} {path}", state))
        if event == "open":
            opened = Path(os.fsdecode(path))
            self._written = opened
            name = opened.relative_to(self._folder.root).as_posix()
            self.states.append((f"{name} is opened", {**state, name: b""}))


def is_change(root: Path, event: str, args: tuple) -> bool:
    """Return whether an event of Python's audit is about to change something in a folder."""
    path = args[0]
    is_ours = isinstance(path, str | bytes | os.PathLike) and Path(
        os.fsdecode(path)
    ).is_relative_to(root)
    if event == "open":
        return is_ours and bool(args[2] & (os.O_WRONLY | os.O_RDWR))
    # shutil.rmtree names what it removes from within a folder
    return is_ours or (event in ("os.remove", "os.rmdir") and args[-1] != -1)


def die_at(root: Path, number: int) -> None:
    """Let this process be killed before its change of a folder with this number."""
    numbers = count()

    def watch(event: str, args: tuple) -> None:
        if is_change(root, event, args) and next(numbers) == number:
            os.kill(os.getpid(), signal.SIGKILL)

    _watchers.append(watch)


@contextmanager
def watched(folder: Folder) -> Iterator[Watch]:
    """Watch what is changed in a folder."""
    watch = Watch(folder)
    _watchers.append(watch.see)
    try:
        yield watch
    finally:
        _watchers.remove(watch.see)


def told(state: State) -> State:
    """Return a state with the arrays of checkpoints in place of their bytes: zip notes the time."""
    return {
        name: _arrays(content) if content and name.endswith(".npz") else content
        for name, content in state.items()
    }


def _arrays(content: bytes) -> bytes:
    if not zipfile.is_zipfile(BytesIO(content)):  # half of one
        return content
    with np.load(BytesIO(content)) as arrays:
        return b"".join(name.encode() + arrays[name].tobytes() for name in sorted(arrays.files))
