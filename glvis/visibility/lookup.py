"""Images as a lens has them, looked up pixel by pixel in the pinhole images of its windows."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache
from typing import Any, TypeVar

import numpy as np
from numpy.typing import NDArray

from glvis.problem.lens import Lens, SphericalLens

Pixels = TypeVar("Pixels", bound=np.generic)

_SAMPLES = 33  # a side, of the image, by which the windows' size is chosen
_LARGEST = 8192  # pixels a side of a window, at most: more than every OpenGL draws


@dataclass(frozen=True, eq=False)
class Lookup:
    """Where each pixel of a lens's image lies in its windows.

    Attributes
    ----------
    window_size : tuple of int
        Pixels (width, height) of every window: none coarser than the image itself.
    place : (H, W) int64
        Index into the pixels of all windows, one after the other; -1 where there is no ray.
    """

    window_size: tuple[int, int]
    place: NDArray[np.int64]

    def image(self, windows: Sequence[NDArray[Pixels]], nothing: Any = 0) -> NDArray[Pixels]:
        """Return the image (H, W, ...) of windows (h, w, ...), row 0 on top: nearest, no filter."""
        pixels = np.concatenate([one.reshape(-1, *one.shape[2:]) for one in windows])
        image: NDArray[Pixels] = pixels[np.maximum(self.place, 0)]
        image[self.place < 0] = nothing
        return image


@lru_cache(maxsize=16)
def lookup_of(lens: Lens, resolution: tuple[int, int], finer: float = 1.0) -> Lookup:
    """Return where the pixels of a lens's image are found.

    Parameters
    ----------
    lens : Lens
        What is not a pinhole.
    resolution : tuple of int
        Pixels (width, height) of the image.
    finer : float
        Times as fine as the image the windows are, at least.
    """
    width, height = resolution
    windows = lens.windows
    tan_x, tan_y = windows.tan_half.tolist()
    focal = finer * _finest(lens, resolution)
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
    return Lookup((size[0], size[1]), place)


def _finest(lens: Lens, resolution: tuple[int, int]) -> float:
    """Return the most pixels that a unit of tangent takes anywhere in the image."""
    if isinstance(lens, SphericalLens):  # at the poles columns crowd, but show the same
        return max(share * n for share, n in zip(lens.focal, resolution, strict=True))
    u, v = np.meshgrid(*[np.linspace(0, 1, _SAMPLES)] * 2)
    directions = lens.directions(u.ravel(), v.ravel())
    x, y, depth = directions[:, np.isfinite(directions[0])]
    density = lens.image_a_steradian(x, y, depth) * resolution[0] * resolution[1]
    most = 0.0
    for turn in lens.windows.window_to_camera:
        back = turn.T[2] @ np.stack([x, y, -depth])
        # an area of tangents at cosine c takes c^3 of it as a solid angle
        in_window = np.where(-back > 0, density * np.maximum(-back, 0.0) ** 3, 0.0)
        most = max(most, float(np.nanmax(in_window, initial=0.0)))
    return math.sqrt(most)
