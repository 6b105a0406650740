"""The image of a lens out of pinhole images: each pixel is looked up by the way it looks.

OpenGL draws pinholes only. The windows of a lens, pinhole images that hold all it sees, are drawn
a little wider than they need be, and of each pixel of the lens's own image the direction says in
which window, and where in it, its colour or its depth lies. Pure geometry; draws nothing.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import lru_cache
from itertools import product

import numpy as np
from numpy.typing import NDArray

from glvis.problem.lens import Lens, Windows

Floats = NDArray[np.float64]
Places = NDArray[np.intp]
Colors = NDArray[np.uint8]

SAMPLES = 2  # a pixel along each side, looked up one by one and averaged
_WIDER = 1.1  # windows are drawn so much wider: outlines and crevices look at what is beside
_FINER = 1.6  # pixels of a window, of those of the image at its middle
_LARGEST = 4096  # pixels of a window's side
_CELLS = 256  # along each side of the grid between whose nodes directions are straight


@dataclass(frozen=True, eq=False)
class LookUp:
    """Where one sample of each pixel (H, W) of a lens's image lies in the lens's windows.

    Attributes
    ----------
    row, column : int
        Of the sample in its pixel.
    windows : Windows
        As they are drawn.
    window : (H, W) int
        Which of them; -1 where the pixel has no ray.
    u, v : (H, W) float64
        Shares of the window's width and height, from the left and from the top.
    """

    row: int
    column: int
    windows: Windows
    window: Places
    u: Floats
    v: Floats

    def distances(
        self, depths: Sequence[NDArray[np.float32]], *, by_range: bool
    ) -> NDArray[np.float32]:
        """Return depths along the lens's axis, or ranges from its centre, (H, W).

        Parameters
        ----------
        depths : sequence of (h, w) float32
            Along the axis of each window; the nearest one counts, where it lies itself.
        by_range : bool
            Whether to return ranges.

        Returns
        -------
        distances : (H, W) float32
            NaN where there is no ray.
        """
        height, width = depths[0].shape
        row = np.clip((self.v * height).astype(np.intp), 0, height - 1)
        column = np.clip((self.u * width).astype(np.intp), 0, width - 1)
        tan_x, tan_y = self.windows.tan_half.tolist()
        x = (2 * (np.arange(width) + 0.5) / width - 1) * tan_x
        y = (1 - 2 * (np.arange(height) + 0.5) / height) * tan_y
        found = np.full(self.window.shape, np.nan, dtype=np.float32)
        for k, (image, turn) in enumerate(zip(depths, self.windows.window_to_camera, strict=True)):
            here = self.window == k
            i, j = row[here], column[here]
            a, b = x[j], y[i]
            back = turn[2, 0] * a + turn[2, 1] * b - turn[2, 2]
            factor = np.sqrt(a * a + b * b + 1) if by_range else -back
            # what is at no depth is at none along any axis
            found[here] = np.where(np.isinf(image[i, j]), np.inf, image[i, j] * factor)
        return found

    def colors(self, images: Sequence[Colors], missing: Colors) -> NDArray[np.float32]:
        """Return the colours (H, W, 3) of images, one a window, mixed from the four around."""
        height, width = images[0].shape[:2]
        top, below = _neighbours(self.v, height)
        left, beside = _neighbours(self.u, width)
        found = np.zeros((*self.window.shape, 3), dtype=np.float32)
        found[self.window < 0] = missing
        for k, image in enumerate(images):
            here = self.window == k
            i, j = top[here], left[here]
            a, b = below[here][:, None], beside[here][:, None]
            upper = (1 - b) * image[i, j] + b * image[i, j + 1]
            lower = (1 - b) * image[i + 1, j] + b * image[i + 1, j + 1]
            found[here] = (1 - a) * upper + a * lower
        return found


def _neighbours(share: Floats, pixels: int) -> tuple[Places, NDArray[np.float32]]:
    """Return the pixel before each place, and how far it is from its middle to the next one's."""
    at = np.clip(share * pixels - 0.5, 0, pixels - 1)
    first = np.minimum(at.astype(np.intp), pixels - 2)
    return first, (at - first).astype(np.float32)


def wider(windows: Windows) -> Windows:
    """Return the windows as they are drawn."""
    return Windows(windows.window_to_camera, windows.tan_half * _WIDER)


def window_size(lens: Lens, size: tuple[int, int]) -> tuple[int, int]:
    """Return the pixels (width, height) that a lens's windows need for its image to be sharp."""
    fine = _FINER * max(n * share for n, share in zip(size, lens.focal, strict=True))
    pixels = 2 * wider(lens.windows).tan_half * fine
    across, up = np.clip(np.ceil(pixels * min(1.0, _LARGEST / pixels.max())), 8, _LARGEST)
    return int(across), int(up)


def look_ups(lens: Lens, size: tuple[int, int]) -> Iterator[LookUp]:
    """Yield where the samples of the pixels of an image (width, height) lie, one a pixel a turn."""
    windows = wider(lens.windows)
    for row, column in product(range(SAMPLES), repeat=2):
        u = (np.arange(size[0]) + (column + 0.5) / SAMPLES) / size[0]
        v = (np.arange(size[1]) + (row + 0.5) / SAMPLES) / size[1]
        yield LookUp(row, column, windows, *windows.places(*_directions(lens, u, v)))


def range_factors(lens: Lens, size: tuple[int, int]) -> Floats:
    """Return range over depth at the middles of an image's pixels (width, height), (H, W)."""
    u, v = ((np.arange(n) + 0.5) / n for n in size)
    return np.asarray(1 / _directions(lens, u, v)[2])


def _directions(lens: Lens, u: Floats, v: Floats) -> Floats:
    """Return directions (3, H, W) of columns u (W,) and rows v (H,); NaN where there is no ray.

    By a grid of places and straight lines between them, with an error of a hundredth of a pixel;
    by the lens itself where the field ends.
    """
    known = _at_nodes(lens)
    (left, a), (top, b) = _cells(u), _cells(v)
    rows = known[:, top] * (1 - b)[:, None] + known[:, top + 1] * b[:, None]
    found = rows[:, :, left] * (1 - a) + rows[:, :, left + 1] * a
    has = np.isfinite(known[0])
    if has.all():
        return found
    # what has no ray at one corner may have some within; so may its neighbours' other side
    reach = np.pad(has, 1)
    near = np.zeros_like(has)
    for i, j in product(range(3), repeat=2):
        near |= reach[i : i + has.shape[0], j : j + has.shape[1]]
    is_near = near[np.ix_(top, left)] | near[np.ix_(top + 1, left + 1)]
    unsure = is_near & ~np.isfinite(found[0])
    row, column = np.nonzero(unsure)
    found[:, row, column] = lens.directions(u[column], v[row])
    return found


@lru_cache(maxsize=4)
def _at_nodes(lens: Lens) -> Floats:
    """Return the directions (3, N, N) of the grid's nodes."""
    nodes = np.linspace(0, 1, _CELLS + 1)
    return lens.directions(nodes[None, :], nodes[:, None])


def _cells(share: Floats) -> tuple[Places, Floats]:
    """Return the cell of the grid that holds each share, and how far in it lies."""
    cell = np.minimum((share * _CELLS).astype(np.intp), _CELLS - 1)
    return cell, share * _CELLS - cell
