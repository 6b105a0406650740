"""Faces that lie in one place: an ID buffer shows one of them a pixel, but all of them are seen.

CAD exports hold faces twice, sheets modelled from both sides, and parts that touch. What float32
cannot tell apart is one place. Pairs are found once a model; where one of a pair shows in a pixel,
the other does too if the pixel's ray meets it.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from glvis.problem.scene import Model
from glvis.problem.sensor import Sensor
from glvis.visibility.occlusion import meets
from glvis.visibility.points import corners_in_camera

Floats = NDArray[np.float64]
Bools = NDArray[np.bool_]
Indices = NDArray[np.integer]

# Of the model's extent, and of a unit normal: bins in which faces of one plane fall together.
_OFFSET_BIN, _NORMAL_BIN = 3e-4, 1e-3
# Of the model's extent: how far apart faces are that float32 can tell apart, its coordinates being
# rounded to 2^-24 of it and each corner by itself.
_APART = 3e-7
_PAIRS = 1 << 20  # looked at together


@dataclass(frozen=True, eq=False)
class Coincident:
    """Which faces of a model lie in one place with others, P pairs, each both ways.

    Attributes
    ----------
    first : (F + 1,) int
        Where each face's partners begin.
    partner : (P,) int
        Faces.
    is_two_sided : bool
        Whether a pair faces opposite ways.
    """

    first: Indices
    partner: Indices
    is_two_sided: bool

    @classmethod
    def of(cls, model: Model) -> Coincident:
        """Return the pairs of a model."""
        one, other = _pairs(model)
        opposite = np.sum(model.normals[one] * model.normals[other], axis=1) < 0
        faces = np.concatenate([one, other])
        order = np.argsort(faces, kind="stable")
        first = np.searchsorted(faces[order], np.arange(model.n_faces + 1))
        return cls(first, np.concatenate([other, one])[order], bool(opposite.any()))

    def pixels_shared(
        self, image: NDArray[np.uint32], model: Model, sensor: Sensor, pose: Floats
    ) -> NDArray[np.int64]:
        """Return in how many further pixels each face shows, (F,): where a partner has the pixel.

        Parameters
        ----------
        image : (H, W) uint32
            Face index + 1 by pixel, row 0 at the top; 0 where no face is seen.
        model : Model
            The faces.
        sensor, pose
            Whose image it is; camera to world (4, 4).
        """
        height, width = image.shape
        number = np.diff(self.first, prepend=0, append=0)[1:-1]
        counts = np.zeros(model.n_faces, dtype=np.int64)
        ids = image.ravel().astype(np.intp)
        pixels = np.flatnonzero(ids)
        pixels = pixels[number[ids[pixels] - 1] > 0]
        shown = ids[pixels] - 1
        if not len(pixels):
            return counts
        n = number[shown]
        place = np.repeat(self.first[shown] - (np.cumsum(n) - n), n) + np.arange(n.sum())
        partner, pixels = self.partner[place], np.repeat(pixels, n)
        # partners that look away are not seen, wherever they are
        towards = np.sum(model.normals * (pose[:3, 3] - model.centroids), axis=1) > 0
        kept = towards[partner]
        partner, pixels = partner[kept], pixels[kept]
        faces, index = np.unique(partner, return_inverse=True)
        corners = corners_in_camera(model, faces, pose)
        row, column = np.divmod(pixels, width)
        ray = sensor.lens.directions((column + 0.5) / width, (row + 0.5) / height)
        is_met = meets(corners[..., index], ray)
        return counts + np.bincount(partner[is_met], minlength=model.n_faces)

    def __len__(self) -> int:
        return len(self.partner)


def _pairs(model: Model) -> tuple[Indices, Indices]:
    """Return faces that lie in one plane and overlap, (K,) each, every pair once."""
    faces = np.flatnonzero(model.areas > 0)
    extent = float(np.ptp(model.bounds, axis=0).max())
    middle = model.bounds.mean(axis=0)
    normals = model.normals[faces]
    offsets = np.sum(normals * (model.centroids[faces] - middle), axis=1)
    planes = np.column_stack([normals / _NORMAL_BIN, offsets / (_OFFSET_BIN * extent)])
    # a plane has two directions; each face stands for both
    faces = np.concatenate([faces, faces])
    values = np.concatenate([planes, -planes])
    found = []
    for shift in (0.0, 0.5):  # what one grid of bins parts, the other does not
        x, y, z, offset = np.floor(values + shift).astype(np.int64).T
        # of normals there are 2^11 bins a coordinate, of offsets less than 2^19
        key = (((x << 11) + y << 11) + z << 20) + offset
        _, group = np.unique(key, return_inverse=True)
        one, other = _overlapping(model, faces, group, _APART * extent)
        one, other = one[one != other], other[one != other]
        found.append(np.minimum(one, other) * model.n_faces + np.maximum(one, other))
    one, other = np.divmod(np.unique(np.concatenate(found)), model.n_faces)
    return one, other


def _overlapping(
    model: Model, faces: Indices, group: Indices, apart: float
) -> tuple[Indices, Indices]:
    """Return faces of the same group (n,) that overlap in one plane, (K,) each."""
    crowded = np.bincount(group)[group] > 1
    faces, group = faces[crowded], group[crowded]
    corners = model.vertices[model.faces[faces]]
    low, high = corners.min(axis=1) - apart, corners.max(axis=1) + apart
    order = np.lexsort([low[:, 0], group])
    faces, group = faces[order], group[order]
    corners, low, high = corners[order], low[order], high[order]
    n = len(faces)
    # along x, those of the group that begin before a face ends follow it
    scale = float(np.ptp(model.bounds[:, 0])) + 4 * apart + 1.0
    start = group * 2 * scale + (low[:, 0] - model.bounds[0, 0])
    last = np.searchsorted(start, group * 2 * scale + (high[:, 0] - model.bounds[0, 0]), "right")
    number = last - np.arange(n) - 1
    found: list[tuple[Indices, Indices]] = []
    ends = np.cumsum(number)
    begin = 0
    while begin < n:
        done = ends[begin - 1] if begin else 0
        end = max(begin + 1, int(np.searchsorted(ends, done + _PAIRS, "right")))
        some = number[begin:end]
        one = np.repeat(np.arange(begin, end), some)
        other = one + 1 + np.arange(len(one)) - np.repeat(np.cumsum(some) - some, some)
        boxes = np.all((low[one] <= high[other]) & (low[other] <= high[one]), axis=1)
        one, other = one[boxes], other[boxes]
        meets = _overlap(corners[one], corners[other], apart)
        found.append((faces[one[meets]], faces[other[meets]]))
        begin = end
    if not found:
        return faces[:0], faces[:0]
    one, other = (np.concatenate(part) for part in zip(*found, strict=True))
    return one, other


def _overlap(one: Floats, other: Floats, apart: float) -> Bools:
    """Return which triangles (K, 3, 3) lie in one plane with others and share area, (K,)."""
    meets = np.ones(len(one), dtype=bool)
    for a, b in ((one, other), (other, one)):
        normal = np.cross(a[:, 1] - a[:, 0], a[:, 2] - a[:, 0])
        normal /= np.linalg.norm(normal, axis=1, keepdims=True)
        height = np.einsum("kcx,kx->kc", b - a[:, :1], normal)
        meets &= (np.abs(height) <= apart).all(axis=1)
        for k in range(3):
            edge = a[:, (k + 1) % 3] - a[:, k]
            inward = np.cross(normal, edge)
            inward /= np.linalg.norm(inward, axis=1, keepdims=True)
            inside = np.einsum("kcx,kx->kc", b - a[:, k : k + 1], inward)
            meets &= inside.max(axis=1) > apart
    return meets
