"""Places on a sheet: boxes, grids, round numbers, and labels that keep out of each other's way."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

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
    """Return a length for people: "200 mm", but "2 inches", which no one takes for a word."""
    word = "inches" if unit in ("in", "inch") else unit
    return f"{number(value)}\u00a0{'inch' if word == 'inches' and value == 1 else word}"


def ticks(low: float, high: float, wanted: int = 5) -> list[float]:
    """Return round numbers from low to high, and the two ends."""
    step = round_length((high - low) / (wanted - 1) * 1.5)
    first, last = math.ceil(low / step), math.floor(high / step)
    inner = [float(f"{k * step:.10g}") for k in range(first, last + 1)]
    clear = [v for v in inner if low + 0.4 * step < v < high - 0.4 * step]
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
    taken = [_rectangle(places[k], (2 * clear, 2 * clear)) for k in shown]
    chosen: dict[int, Floats] = {}
    for i, k in enumerate(shown):
        others = taken[:i] + taken[i + 1 :]
        costs = []
        spots = _spots(places[k], clear, sizes[k])
        for spot in spots:
            area = _rectangle(spot, sizes[k])
            outside = sum(max(0.0, -v) for v in area[:2])
            outside += sum(max(0.0, v - limit) for v, limit in zip(area[2:], room, strict=True))
            hit = sum(_overlap(area, other) for other in others)
            costs.append(1e4 * outside + 10 * hit + float(np.linalg.norm(spot - places[k])))
        chosen[k] = spots[int(np.argmin(costs))]
        taken.append(_rectangle(chosen[k], sizes[k]))
    return chosen


def _spots(place: Floats, clear: float, size: tuple[float, float]) -> list[Floats]:
    """Return centres to try for a label about a place."""
    spots = []
    for ring in (1.0, 1.6, 2.4, 3.4):
        for eighth in range(16):
            angle = eighth * math.pi / 8
            direction = np.array([math.cos(angle), math.sin(angle)])
            spots.append(place + direction * (clear * ring + np.array(size) / 2))
    return spots


def _rectangle(centre: Floats, size: tuple[float, float]) -> tuple[float, float, float, float]:
    """Return left, top, right, bottom."""
    x, y = centre
    return x - size[0] / 2, y - size[1] / 2, x + size[0] / 2, y + size[1] / 2


def _overlap(a: Sequence[float], b: Sequence[float]) -> float:
    """Return the common area of two rectangles (left, top, right, bottom)."""
    width = min(a[2], b[2]) - max(a[0], b[0])
    height = min(a[3], b[3]) - max(a[1], b[1])
    return float(max(0.0, width) * max(0.0, height))
