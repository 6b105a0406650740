"""What the command line says: lines, tables of text, and how far a search is."""

from __future__ import annotations

import itertools
import math
import shutil
import sys
import textwrap
import time
from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import contextmanager
from typing import TextIO

from rich.console import Console
from rich.progress import BarColumn, TextColumn
from rich.progress import Progress as Bar

from glvis.search.placement import Progress

_SECONDS_BETWEEN_LINES = 5.0
_MOST_NAMES = 3  # of workers in a line
_GAP = "  "  # before each column of a table
_FILE_COLUMNS = 100  # of paragraphs where there is no terminal
_SHORTEST = 8  # letters that a cut text keeps


def say(text: str = "", *, error: bool = False, to_paste: bool = False) -> None:
    """Write a line to standard output, or to standard error.

    On a terminal it goes on in the next line between words, unless somebody is ``to_paste`` it.
    """
    stream = sys.stderr if error else sys.stdout
    width = _columns(stream)
    if width and not to_paste:
        text = "\n".join(_wrapped(line, width) for line in text.split("\n"))
    stream.write(f"{text}\n")
    stream.flush()


def table(
    header: Sequence[str], rows: Sequence[Sequence[object]], width: int | None = None
) -> list[str]:
    """Return lines with aligned columns: text to the left, numbers to the right.

    Parameters
    ----------
    header : sequence of str
        Of the columns; takes several lines where the table would be too wide.
    rows : sequence of rows
        Numbers, or text; the longest texts are cut where that is not enough.
    width : int, optional
        Columns that there is room for: those of the terminal, without end where there is none.
    """
    body = [[_cell(value) for value in row] for row in rows]
    is_text = [any(map(_is_text, column)) for column in zip(*body, strict=True)]
    room = (width or _columns(sys.stdout) or math.inf) - len(_GAP) * len(header)
    heads = _heads(header, body, room)
    sizes = _widths(heads, body)
    while sum(sizes) > room and (long := _longest(sizes, is_text)) is not None:
        sizes[long] -= 1
    lines = max(map(len, heads), default=0)
    above = zip(*([""] * (lines - len(head)) + head for head in heads), strict=True)
    cells = [
        [_cut(cell, size) for cell, size in zip(row, sizes, strict=True)] for row in [*above, *body]
    ]
    return [
        "".join(
            _GAP + (cell.ljust(size) if left else cell.rjust(size))
            for cell, size, left in zip(row, sizes, is_text, strict=True)
        ).rstrip()
        for row in cells
    ]


def listing(rows: Sequence[Sequence[str]]) -> list[str]:
    """Return lines with short words in columns and the last of each row as a paragraph."""
    sizes = [max(map(len, column)) for column in list(zip(*rows, strict=True))[:-1]]
    width = _columns(sys.stdout) or _FILE_COLUMNS
    lines = []
    for *words, text in rows:
        start = "".join(_GAP + word.ljust(size) for word, size in zip(words, sizes, strict=True))
        start += _GAP
        # narrower than this no paragraph can be read; the terminal breaks the lines then
        room = max(width, len(start) + 3 * _SHORTEST)
        lines += textwrap.wrap(
            text, room, initial_indent=start, subsequent_indent=" " * len(start)
        ) or [start.rstrip()]
    return lines


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


def _columns(stream: TextIO) -> int | None:
    """Return how many letters a line of a terminal holds; None where it goes into a file."""
    is_terminal = stream is not None and not stream.closed and stream.isatty()
    return shutil.get_terminal_size().columns if is_terminal else None


def _wrapped(line: str, width: int) -> str:
    """Return a line as several, broken between words and indented below itself."""
    if len(line) <= width:
        return line
    below = " " * (len(line) - len(line.lstrip()) + 2)
    return textwrap.fill(
        line, width, subsequent_indent=below, break_long_words=False, break_on_hyphens=False
    )


def _heads(header: Sequence[str], body: Sequence[Sequence[str]], room: float) -> list[list[str]]:
    """Return the lines of each column's name, several where that saves room that is needed."""
    heads = [[name] for name in header]
    needed = _widths([[]] * len(header), body)
    longest_first = sorted(range(len(header)), key=lambda k: needed[k] - len(header[k]))
    for lines, k in itertools.product((2, 3, 4), longest_first):
        if sum(_widths(heads, body)) > room and len(header[k]) > needed[k]:
            heads[k] = _in_lines(header[k], lines)
    return heads


def _in_lines(text: str, lines: int) -> list[str]:
    """Return a text in at most so many lines, as narrow as its words allow."""
    sizes = range(max(map(len, text.split())), len(text) + 1)
    return next(found for size in sizes if len(found := textwrap.wrap(text, size)) <= lines)


def _widths(heads: Iterable[Sequence[str]], body: Sequence[Sequence[str]]) -> list[int]:
    """Return the longest cell of each column; heads are lists of lines."""
    return [
        max(len(cell) for cell in ["", *head, *(row[column] for row in body)])
        for column, head in enumerate(heads)
    ]


def _longest(sizes: Sequence[int], is_text: Sequence[bool]) -> int | None:
    """Return the widest column of text that can still be cut."""
    found = [k for k, left in enumerate(is_text) if left and sizes[k] > _SHORTEST]
    return max(found, key=lambda k: sizes[k], default=None)


def _cut(cell: str, size: int) -> str:
    """Return a text without its middle where it is too long: names differ at their ends."""
    if len(cell) <= size:
        return cell
    end = (size - 1) // 2
    return f"{cell[: size - 1 - end]}…{cell[len(cell) - end :]}"


def _cell(value: object) -> str:
    if isinstance(value, float):
        return f"{value:.6g}"
    return f"{value:,}" if isinstance(value, int) else str(value)


def _is_text(cell: str) -> bool:
    """Return whether a cell is no number, its unit left aside; "-" stands for one."""
    try:
        float(cell.replace(",", "").rstrip(" %"))
    except ValueError:
        return cell != "-"
    return False
