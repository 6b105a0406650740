"""Places on a sheet: boxes, grids, round numbers, and labels that keep out of each other's way."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from glvis.problem.units import unit_word

Floats = NDArray[np.float64]
Colors = NDArray[np.uint8]

_NICE = (1, 2, 5)


@dataclass(frozen=True)
class Box:
    """A rectangle of pixels."""

    x: int
    y: int
    width: int
    height: int

    @property
    def size(self) -> tuple[int, int]:
        """Pixels (width, height)."""
        return self.width, self.height

    @property
    def right(self) -> int:
        """First column beyond."""
        return self.x + self.width

    @property
    def bottom(self) -> int:
        """First row beyond."""
        return self.y + self.height


def grid(box: Box, columns: int, rows: int, gap: int) -> list[Box]:
    """Return the cells of a box, row by row."""
    width = (box.width - gap * (columns - 1)) // columns
    height = (box.height - gap * (rows - 1)) // rows
    return [
        Box(box.x + i * (width + gap), box.y + j * (height + gap), width, height)
        for j in range(rows)
        for i in range(columns)
    ]


def halves(box: Box, part: float, gap: int, *, stacked: bool) -> list[Box]:
    """Return two boxes that share one, the first with a part of it, side by side or stacked."""
    if stacked:
        first = round(part * (box.height - gap))
        below = box.y + first + gap
        return [
            Box(box.x, box.y, box.width, first),
            Box(box.x, below, box.width, box.bottom - below),
        ]
    first = round(part * (box.width - gap))
    beside = box.x + first + gap
    return [
        Box(box.x, box.y, first, box.height),
        Box(beside, box.y, box.right - beside, box.height),
    ]


def readable(color: Colors) -> tuple[int, ...]:
    """Return a colour dark enough for text on white."""
    c = np.asarray(color, dtype=float)
    light = float(c @ [0.2126, 0.7152, 0.0722]) / 255
    return tuple(int(v) for v in np.round(c * min(1.0, 0.40 / max(light, 1e-3))))


def round_length(longest: float) -> float:
    """Return the largest 1, 2 or 5 times a power of ten that is not longer."""
    power = 10.0 ** math.floor(math.log10(longest))
    length = max(n * power for n in _NICE if n * power <= longest * (1 + 1e-9))
    return float(f"{length:.0e}")


def number(value: float) -> str:
    """Return a number for people: no exponent where it can be helped, thousands by commas."""
    text = f"{value:.6g}"
    if "e" in text and abs(value) >= 1:
        text = f"{value:.0f}"
    elif "e" in text and abs(value) >= 1e-6:
        text = f"{value:.12f}".rstrip("0")
    whole, _, rest = text.partition(".")
    if len(whole.lstrip("-")) > 3 and "e" not in text:
        whole = f"{int(whole):,}"
    return (f"{whole}.{rest}" if rest else whole).replace("-", "−")


def length_words(value: float, unit: str) -> str:
    """Return a length for people: "200 mm", "2 inches"."""
    word = unit_word(unit)
    return f"{number(value)}\u00a0{'inch' if word == 'inches' and value == 1 else word}"


def ticks(low: float, high: float, wanted: int = 5) -> list[float]:
    """Return round numbers from low to high, and the two ends."""
    step = round_length((high - low) / (wanted - 1) * 1.5)
    first, last = math.ceil(low / step), math.floor(high / step)
    inner = [float(f"{k * step:.10g}") for k in range(first, last + 1)]
    clear = [v for v in inner if low + 0.4 * step < v < high - 0.4 * step]
    return [low, *clear, high]


def log_ticks(low: float, high: float, wanted: int = 7) -> list[float]:
    """Return round numbers from low to high for a scale of factors, and the two ends."""
    decades = range(math.floor(math.log10(low)), math.ceil(math.log10(high)) + 1)
    span = math.log(high / low)
    for steps in (_NICE, (1, 3), (1,)):
        inner = [float(f"{n}e{k}") for k in decades for n in steps]
        # no nearer to an end than a line of text is high
        clear = [v for v in inner if 0.07 < math.log(v / low) / span < 0.93]
        if len(clear) <= wanted:
            break
    return [low, *clear, high]


def label_places(
    places: Floats, sizes: Sequence[tuple[float, float]], clear: float, room: tuple[int, int]
) -> dict[int, Floats]:
    """Return the centres of labels beside their places, by index.

    Parameters
    ----------
    places : (N, 2) float
        Pixels; NaN or outside the room is left out.
    sizes : sequence of (width, height)
        Of the N labels, pixels.
    clear : float
        Pixels to keep free around each place.
    room : tuple of int
        Pixels (width, height) that labels must stay in.
    """
    at = np.nan_to_num(places, nan=-1.0)
    shown = np.flatnonzero(((at >= 0) & (at < room)).all(axis=1)).tolist()
    # left, top, right, bottom of what is taken: the places, then the labels one by one
    taken = np.array([_rectangles(places[k], (2 * clear, 2 * clear)) for k in shown]).reshape(-1, 4)
    chosen: dict[int, Floats] = {}
    for i, k in enumerate(shown):
        spots = _spots(places[k], clear, sizes[k])
        areas = _rectangles(spots, sizes[k])
        outside = np.maximum(-areas[:, :2], 0) + np.maximum(areas[:, 2:] - room, 0)
        hit = _overlaps(areas, np.delete(taken, i, axis=0)).sum(axis=1)
        apart = np.linalg.norm(spots - places[k], axis=1)
        chosen[k] = spots[int(np.argmin(1e4 * outside.sum(axis=1) + 10 * hit + apart))]
        taken = np.vstack([taken, _rectangles(chosen[k], sizes[k])])
    return chosen


def _spots(place: Floats, clear: float, size: tuple[float, float]) -> Floats:
    """Return centres (N, 2) to try for a label about a place."""
    ring, turn = np.meshgrid((1.0, 1.6, 2.4, 3.4), np.arange(16) * math.pi / 8, indexing="ij")
    directions = np.stack([np.cos(turn), np.sin(turn)], axis=2)
    return (place + directions * (clear * ring[..., None] + np.array(size) / 2)).reshape(-1, 2)


def _rectangles(centres: Floats, size: tuple[float, float]) -> Floats:
    """Return left, top, right, bottom (..., 4) about centres (..., 2)."""
    half = np.array(size) / 2
    return np.concatenate([centres - half, centres + half], axis=-1)


def _overlaps(a: Floats, b: Floats) -> Floats:
    """Return the common area of rectangles (A, 4) with others (B, 4), (A, B)."""
    low = np.maximum(a[:, None, :2], b[None, :, :2])
    high = np.minimum(a[:, None, 2:], b[None, :, 2:])
    return np.maximum(high - low, 0).prod(axis=2)
