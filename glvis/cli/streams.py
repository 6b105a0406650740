"""Standard output and standard error that end no run: full, closed, or with nobody listening."""

from __future__ import annotations

import os
import signal
import sys
import threading
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager, suppress
from pathlib import Path
from typing import Any, TextIO


class Patient:
    """A text stream that goes on without a word when nothing can be written to it any more.

    Parameters
    ----------
    stream : TextIO
        What is written to.

    Attributes
    ----------
    error : OSError or None
        Why something could not be written; None where the reader has gone away (``| head``).
    """

    def __init__(self, stream: TextIO) -> None:
        self._stream = stream
        self.error: OSError | None = None

    def write(self, text: str) -> int:
        """Write a text; return its length."""
        with self._patience():
            self._stream.write(text)
        return len(text)

    def flush(self) -> None:
        """Hand on what was written."""
        with self._patience():
            self._stream.flush()

    def __getattr__(self, name: str) -> Any:
        return getattr(self._stream, name)

    @contextmanager
    def _patience(self) -> Iterator[None]:
        try:
            yield
        except OSError as error:
            if not isinstance(error, BrokenPipeError):
                self.error = self.error or error
            with suppress(OSError, ValueError):  # what waits to be written goes nowhere
                nowhere = os.open(os.devnull, os.O_WRONLY)
                os.dup2(nowhere, self._stream.fileno())
                os.close(nowhere)
                self._stream.flush()


@contextmanager
def patient_streams() -> Iterator[tuple[Patient, Patient]]:
    """Give standard output and standard error as streams that end no run."""
    before = sys.stdout, sys.stderr
    with ExitStack() as stack:
        streams = []
        for stream in before:
            if stream is None:  # closed at the start; nothing that is opened shall take its number
                stream = stack.enter_context(Path(os.devnull).open("w", encoding="utf-8"))
            if hasattr(stream, "reconfigure"):  # names in letters that this terminal lacks
                stream.reconfigure(errors="replace")
            streams.append(Patient(stream))
        out, error = streams
        sys.stdout, sys.stderr = out, error
        try:
            yield out, error
        finally:
            out.flush()
            error.flush()
            sys.stdout, sys.stderr = before


@contextmanager
def ended_as_by_ctrl_c() -> Iterator[None]:
    """Let SIGHUP, of a terminal that is closed, raise KeyboardInterrupt as Ctrl-C does.

    SIGTERM ends what is no search at once, also where Python has no say any more.
    """
    number = getattr(signal, "SIGHUP", None)  # Windows has none
    if (
        number is None
        or threading.current_thread() is not threading.main_thread()
        or signal.getsignal(number) is not signal.SIG_DFL  # nohup ignores it
    ):
        yield
        return
    signal.signal(number, signal.default_int_handler)
    try:
        yield
    finally:
        signal.signal(number, signal.SIG_DFL)
