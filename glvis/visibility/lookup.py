"""Images as a lens has them, looked up pixel by pixel in the pinhole images of its windows."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache
from typing import Any, TypeVar

import numpy as np
from numpy.typing import NDArray

from glvis.problem.lens import Lens, SphericalLens, Windows

Floats = NDArray[np.float64]

Pixels = TypeVar("Pixels", bound=np.generic)

# Times as fine as the image the windows are, at least: so the middle of the nearest of their pixels
# is never beyond the border of one of the image.
_FINER = math.sqrt(2)
_SAMPLES = 33  # a side, of the image, by which the windows' size is chosen
_LARGEST = 8192  # pixels a side of a window, at most: more than every OpenGL draws


@dataclass(frozen=True, eq=False)
class Lookup:
    """Where each pixel of a lens's image lies in its windows.

    Attributes
    ----------
    windows : Windows
        Of the lens.
    window_size : tuple of int
        Pixels (width, height) of every window: none coarser than the image itself.
    place : (H, W) int64
        Index into the pixels of all windows, one after the other; -1 where there is no ray.
    """

    windows: Windows
    window_size: tuple[int, int]
    place: NDArray[np.int64]

    def image(self, windows: Sequence[NDArray[Pixels]], nothing: Any = 0) -> NDArray[Pixels]:
        """Return the image (H, W, ...) of windows (h, w, ...), row 0 on top: nearest, no filter."""
        pixels = np.concatenate([one.reshape(-1, *one.shape[2:]) for one in windows])
        image: NDArray[Pixels] = pixels[np.maximum(self.place, 0)]
        image[self.place < 0] = nothing
        return image

    def rays(self, pixels: NDArray[np.integer]) -> Floats:
        """Return the directions (3, n) that pixels (n,) of the flat image show: x, y and depth.

        They are those of the windows' own pixels, by which faces are told apart.
        """
        width, height = self.window_size
        tan_x, tan_y = self.windows.tan_half.tolist()
        row, column = np.divmod(self.place.ravel()[pixels], width)
        number, row = np.divmod(row, height)
        x, y = (2 * (column + 0.5) / width - 1) * tan_x, (1 - 2 * (row + 0.5) / height) * tan_y
        in_window = np.stack([x, y, np.full(len(x), -1.0)])
        turns = self.windows.window_to_camera[number]
        right, up, back = np.einsum("nij,jn->in", turns, in_window)
        return np.stack([right, up, -back])


@lru_cache(maxsize=16)
def lookup_of(lens: Lens, resolution: tuple[int, int]) -> Lookup:
    """Return where the pixels of a lens's image are found.

    Parameters
    ----------
    lens : Lens
        What is not a pinhole.
    resolution : tuple of int
        Pixels (width, height) of the image.
    """
    width, height = resolution
    windows = lens.windows
    tan_x, tan_y = windows.tan_half.tolist()
    focal = _FINER * _finest(lens, resolution)
    size = tuple(min(max(1, math.ceil(2 * focal * tan)), _LARGEST) for tan in (tan_x, tan_y))
    u, v = np.meshgrid((np.arange(width) + 0.5) / width, (np.arange(height) + 0.5) / height)
    x, y, depth = lens.directions(u, v)
    place = np.full((height, width), -1, dtype=np.int64)
    with np.errstate(invalid="ignore", divide="ignore"):
        for number, turn in enumerate(windows.window_to_camera):
            right, up, back = np.tensordot(turn.T, np.stack([x, y, -depth]), axes=1)
            across, above = right / -back, up / -back
            inside = (back < 0) & (np.abs(across) <= tan_x) & (np.abs(above) <= tan_y)
            column = ((across[inside] / tan_x + 1) / 2 * size[0]).astype(np.int64)
            row = ((1 - above[inside] / tan_y) / 2 * size[1]).astype(np.int64)
            column, row = np.minimum(column, size[0] - 1), np.minimum(row, size[1] - 1)
            place[inside] = (number * size[1] + row) * size[0] + column
    return Lookup(windows, (size[0], size[1]), place)


def _finest(lens: Lens, resolution: tuple[int, int]) -> float:
    """Return the most pixels that a unit of tangent takes anywhere in the image."""
    if isinstance(lens, SphericalLens):  # at the poles columns crowd, but show the same
        return max(share * n for share, n in zip(lens.focal, resolution, strict=True))
    width, height = resolution
    u, v = (one.ravel() for one in np.meshgrid(*[np.linspace(0, 1, _SAMPLES)] * 2))
    least = math.inf
    flip = np.array([[1.0], [1.0], [-1.0]])
    here = flip * lens.directions(u, v)
    for next_u, next_v in ((1 / width, 0.0), (0.0, 1 / height)):  # towards the middle
        to_u, to_v = u + np.where(u > 0.5, -next_u, next_u), v + np.where(v > 0.5, -next_v, next_v)
        there = flip * lens.directions(to_u, to_v)
        for turn in lens.windows.window_to_camera:
            x, y, back = turn.T @ here
            other_x, other_y, other_back = turn.T @ there
            with np.errstate(invalid="ignore", divide="ignore"):
                before = np.maximum(np.abs(x), np.abs(y)) <= -2 * back  # in the window, or nearly
                apart = np.hypot(x / back - other_x / other_back, y / back - other_y / other_back)
            least = min(least, float(np.nanmin(apart[before], initial=math.inf)))
    return 1 / least
