"""Images as a lens has them, looked up pixel by pixel in the pinhole images of its windows.

The nearest pixel of a window shows what lies half a pixel beside the ray at most. Which of the
faces around it the ray itself meets first is decided by the faces.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache
from typing import Any, TypeVar

import numpy as np
from numpy.typing import NDArray

from glvis.problem.lens import Lens, SphericalLens, Windows
from glvis.problem.scene import Model
from glvis.visibility.filters import in_camera_frame
from glvis.visibility.occlusion import meets

Floats = NDArray[np.float64]

Pixels = TypeVar("Pixels", bound=np.generic)

# Times as fine as the image the windows are, at least: of the four of their pixels around a middle
# of one of the image, none has its own middle beyond that one's border.
_FINER = 3.0
_SAMPLES = 33  # a side, of the image, by which the windows' size is chosen
_LARGEST = 8192  # pixels a side of a window, at most


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
    around : (3, H, W) int64
        The same of three more pixels around: they and the nearest have the ray between them.
    """

    windows: Windows
    window_size: tuple[int, int]
    place: NDArray[np.int64]
    around: NDArray[np.int64]

    def image(self, windows: Sequence[NDArray[Pixels]], nothing: Any = 0) -> NDArray[Pixels]:
        """Return the image (H, W, ...) of windows (h, w, ...), row 0 on top: nearest, no filter."""
        pixels = np.concatenate([one.reshape(-1, *one.shape[2:]) for one in windows])
        image: NDArray[Pixels] = pixels[np.maximum(self.place, 0)]
        image[self.place < 0] = nothing
        return image

    def rays(self, places: NDArray[np.integer]) -> Floats:
        """Return the directions (3, n) of pixels of the windows, by ``place``: x, y and depth."""
        width, height = self.window_size
        tan_x, tan_y = self.windows.tan_half.tolist()
        row, column = np.divmod(places, width)
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
    window, across, down = windows.places(*lens.directions(u, v))
    inside = window >= 0
    at = across[inside] * size[0], down[inside] * size[1]
    column, row = (np.minimum(a.astype(np.int64), n - 1) for a, n in zip(at, size, strict=True))
    beside, over = (  # the next pixel towards which the ray lies
        np.clip(c + np.where(a - c < 0.5, -1, 1), 0, n - 1)
        for a, c, n in zip(at, (column, row), size, strict=True)
    )
    first = window[inside] * size[1]
    place = np.full((height, width), -1, dtype=np.int64)
    around = np.zeros((3, height, width), dtype=np.int64)
    place[inside] = (first + row) * size[0] + column
    for other, (r, c) in enumerate(((row, beside), (over, column), (over, beside))):
        around[other, inside] = (first + r) * size[0] + c
    return Lookup(windows, (size[0], size[1]), place, around)


def ids_by_rays(
    lookup: Lookup,
    windows: Sequence[NDArray[np.uint32]],
    lens: Lens,
    model: Model,
    camera_to_world: Floats,
) -> tuple[NDArray[np.uint32], Floats]:
    """Return the ID image of a lens, and the ray by which each pixel shows its face.

    Where the pixels of a window around a ray show several faces, the one that the ray meets first
    is shown; where it meets none of them, that of the nearest pixel.

    Parameters
    ----------
    lookup : Lookup
        Of the lens at the image's size.
    windows : sequence of (h, w) uint32
        Their ID images: face index + 1, or 0.
    lens : Lens
        Whose.
    model : Model
        The faces.
    camera_to_world : (4, 4) float64
        The pose.

    Returns
    -------
    image : (H, W) uint32
        Face index + 1, 0 where no face is seen.
    rays : (3, H * W) float64
        Directions in the camera frame, pixel by pixel: x right, y up, and depth; of the pixel of a
        window that shows the face.
    """
    image = lookup.image(windows)
    height, width = image.shape
    pixels = np.concatenate([one.ravel() for one in windows])
    found, rays = image.ravel(), np.zeros((3, image.size))
    shown = np.flatnonzero(found)
    places = np.concatenate([lookup.place[None], lookup.around]).reshape(4, -1)[:, shown]
    ids = pixels[places]
    differs = np.flatnonzero((ids[1:] != ids[0]).any(axis=0))
    row, column = np.divmod(shown[differs], width)
    middle = lens.directions((column + 0.5) / width, (row + 0.5) / height)
    corners = in_camera_frame(model.vertices.T, camera_to_world)[:, model.faces.T]
    corners = np.moveaxis(corners, 0, 1)  # corner, coordinate, face
    nearest = np.full(len(differs), np.inf)
    which = np.zeros(len(shown), dtype=np.intp)
    for number, of_pixels in enumerate(ids[:, differs]):
        some = np.flatnonzero(of_pixels)
        candidates = corners[..., of_pixels[some].astype(np.intp) - 1]
        ray = middle[:, some]
        normal = np.cross(candidates[1] - candidates[0], candidates[2] - candidates[0], axis=0)
        with np.errstate(divide="ignore", invalid="ignore"):
            far_off = np.sum(normal * candidates[0], axis=0) / np.sum(normal * ray, axis=0)
        is_first = meets(candidates, ray) & (far_off > 0) & (far_off < nearest[some])
        nearest[some[is_first]] = far_off[is_first]
        which[differs[some[is_first]]] = number
    found[shown] = np.take_along_axis(ids, which[None], axis=0)[0]
    rays[:, shown] = lookup.rays(np.take_along_axis(places, which[None], axis=0)[0])
    return image, rays


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
