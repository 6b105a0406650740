"""What the command line says: lines, tables of text, and how far a search is."""

from __future__ import annotations

import math
import sys
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from typing import TextIO

from rich.console import Console
from rich.progress import BarColumn, TextColumn
from rich.progress import Progress as Bar

from glvis.optim.placement import Progress

_SECONDS_BETWEEN_LINES = 5.0
_MOST_NAMES = 3  # of workers in a line


def say(text: str = "", *, error: bool = False) -> None:
    """Write a line to standard output, or to standard error."""
    stream = sys.stderr if error else sys.stdout
    stream.write(f"{text}\n")
    stream.flush()


def table(header: Sequence[str], rows: Sequence[Sequence[object]]) -> list[str]:
    """Return lines with aligned columns: text to the left, numbers to the right."""
    body = [[_cell(value) for value in row] for row in rows]
    cells = [list(header), *body]
    widths = [max(len(row[column]) for row in cells) for column in range(len(header))]
    is_text = [any(map(_is_text, column)) for column in zip(*body, strict=True)]
    return [
        "  "
        + "  ".join(
            cell.ljust(width) if left else cell.rjust(width)
            for cell, width, left in zip(row, widths, is_text, strict=True)
        ).rstrip()
        for row in cells
    ]


def duration(seconds: float) -> str:
    """Return a time as people say it: "0.4 s", "48 s", "3 min 20 s", "2 h 5 min"."""
    if seconds < 10:
        return f"{seconds:.1f} s"
    whole = round(seconds)
    if whole < 60:
        return f"{whole} s"
    if whole < 3600:
        return f"{whole // 60} min {whole % 60} s"
    return f"{whole // 3600} h {whole % 3600 // 60} min"


@contextmanager
def progress_shown() -> Iterator[Callable[[Progress], None]]:
    """Give what a search tells its progress to: a bar on a terminal, else a line now and then."""
    if sys.stderr.isatty():
        with _bar() as show:
            yield show
    else:
        yield _Lines(sys.stderr)


class _Lines:
    """A line for the first iteration, the last one, and every few seconds between."""

    def __init__(self, stream: TextIO, clock: Callable[[], float] = time.monotonic) -> None:
        self._stream, self._clock = stream, clock
        self._next = 0.0

    def __call__(self, progress: Progress) -> None:
        now = self._clock()
        if now >= self._next or progress.has_ended:
            self._next = now + _SECONDS_BETWEEN_LINES
            say(_progress_line(progress), error=self._stream is sys.stderr)


@contextmanager
def _bar() -> Iterator[Callable[[Progress], None]]:
    columns = (BarColumn(bar_width=20), TextColumn("{task.description}"))
    with Bar(*columns, console=Console(stderr=True), transient=True) as bar:
        task = bar.add_task("the first iteration ...", total=None)

        def show(progress: Progress) -> None:
            bar.update(
                task,
                total=progress.most,
                completed=progress.done,
                description=_progress_line(progress),
            )

        yield show


def _progress_line(progress: Progress) -> str:
    left = progress.seconds_left
    return (
        f"{_done(progress)}  best {progress.best:.6g}  mean {progress.mean:.6g}  "
        f"{_rate(progress.evaluations_per_second)} evaluations/s  "
        f"{duration(left) if math.isfinite(left) else '?'} left{_who(progress.workers)}"
    )


def _done(progress: Progress) -> str:
    """Return how far a search is towards what will end it."""
    if progress.limit == "iterations":
        return f"iteration {progress.done:.0f}/{progress.most:.0f}"
    if progress.limit == "maps":
        return f"{progress.done:,.0f} of {progress.most:,.0f} maps"
    return f"{duration(progress.done)} of {duration(progress.most)}"


def _who(workers: Sequence[str]) -> str:
    """Return workers by name, the first of many."""
    if not workers:
        return ""
    more = len(workers) - _MOST_NAMES
    names = ", ".join(workers[:_MOST_NAMES])
    return f"  by {names}" + (f" and {more} more" if more > 0 else "")


def _rate(value: float) -> str:
    return f"{value:,.0f}" if value >= 100 else f"{value:.3g}"


def _cell(value: object) -> str:
    if isinstance(value, float):
        return f"{value:.6g}"
    return f"{value:,}" if isinstance(value, int) else str(value)


def _is_text(cell: str) -> bool:
    """Return whether a cell is no number, its unit left aside."""
    try:
        float(cell.replace(",", "").rstrip(" %"))
    except ValueError:
        return True
    return False
