"""The judge of visibility maps: rays in float64 to points of faces, each free or not.

Like ``oracle.py`` it is plain NumPy and imports nothing of glvis; unlike it, it is quick enough
for thousands of faces and hundreds of poses, and it knows what rounding leaves open. Its rules
are those of the project's method:

- A ray to a point is free where nothing lies before the point by more than 1e-9 of the way. So
  faces that coincide do not hide each other: each that faces the sensor and passes is seen.
- Both sides of every face hide, whatever the filters say of it; faces of no area never count.
- Nothing nearer than a thousandth of the reach hides, and what is seen of points there is left
  open.
  The reach is maxD, or four times the depth of the deepest vertex where that is less.

A sample is *doubtful* where float32 numbers cannot tell: where a limit of a filter or an
occluder's edge is nearer than rounding, or where an occluder's plane passes before the point, but
by less than a few float32 steps of the scene's coordinates. Doubtful samples excuse a map either
way, and are counted. Faces that coincide in the file's own numbers are never doubtful: a map must
show them all.

Names: F faces of the model, T triangles that hide (model and obstacles), R rays. All is done in
the camera frame, x right, y up, the sensor looks along -z from the origin.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from support.oracle import Eye, part_centroids, pixel_directions

NEAREST = 1e-3  # share of the reach before which nothing hides
DEEPEST = 4.0  # times the depth of the scene: no view reaches further
_SHARE = 1e-6  # of the distance: rounding of directions and depths
_CLEAR = 2e-7  # of the distance: rounding of how far a point is from an occluder's plane
_STEPS = 4  # float32 steps of the scene's coordinates: rounding of all that is relative to them
_BEFORE = 1e-9  # share of the way by which an occluder is nearer
_SLACK = 1e-13  # of an edge, as a direction: a ray through a shared edge meets one face at least
_BLOCK = 1 << 16  # rays x triangles tested at once
_PLANES_OFF = 1.001  # the engine may put its near plane this factor nearer


@dataclass(frozen=True)
class Verdict:
    """Of R samples: which pass and are free, and of which rounding leaves that open; (R,) bool."""

    free: np.ndarray
    doubtful: np.ndarray

    @property
    def surely(self) -> np.ndarray:
        """Free whatever rounding does."""
        return self.free & ~self.doubtful

    @property
    def possibly(self) -> np.ndarray:
        """Free or doubtful."""
        return self.free | self.doubtful


class Fan:
    """Triangles as rays from the camera frame's origin meet them.

    Parameters
    ----------
    corners : (T, 3, 3) float64
        Of the camera frame.
    clip : float
        Depth before which nothing hides.

    Attributes
    ----------
    height, width : (T,) float64
        Of the eye above each plane, on its front; of each triangle across its longest edge.
    has_area, hides : (T,) bool
        ``hides`` leaves out those that the eye sees exactly edge-on.
    low, high : (T, 2) float64
        Boxes in the image plane at unit depth around what lies beyond ``clip``.
    """

    def __init__(self, corners: np.ndarray, clip: float) -> None:
        a, b, c = np.moveaxis(corners, 1, 0)
        edges = [b - a, c - b, a - c]
        cross = np.cross(edges[0], c - a)
        double = np.linalg.norm(cross, axis=1)
        self.has_area = double > 0
        normal = cross / np.where(self.has_area, double, 1)[:, None]
        self.height = -np.sum(normal * a, axis=1)
        longest = np.max([np.linalg.norm(edge, axis=1) for edge in edges], axis=0)
        self.width = double / np.where(longest > 0, longest, 1)
        reach = np.linalg.norm(corners, axis=2).max(axis=1)
        self.hides = self.has_area & (np.abs(self.height) > 1e-13 * reach)
        side = -np.sign(self.height)[:, None]
        planes = []
        for start, edge in zip((a, b, c), edges, strict=True):
            plane = np.cross(start, edge) * side
            length = np.linalg.norm(plane, axis=1)[:, None]
            planes.append(plane / np.where(length > 0, length, 1))
        # d @ planes >= 0 for all three inside the triangle's cone; d @ nearness is 1 in its plane
        self._planes = np.stack(planes, axis=1)  # (T, 3, 3)
        self.nearness = np.zeros((len(corners), 3))
        some = self.hides
        self.nearness[some] = (normal * side)[some] / np.abs(self.height[some])[:, None]
        self.low, self.high = _image_boxes(
            corners, 0.99 * clip if clip else 1e-12 * float(np.abs(corners).max())
        )

    def meets(self, rays: np.ndarray, some: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return how far inside triangles rays (r, 3) are, as angles, and the nearness, (r, k).

        Nearness is 1 where the triangle's plane is at the ray's end, 2 at half the way.
        """
        inside = rays @ self._planes[some, 0].T
        np.minimum(inside, rays @ self._planes[some, 1].T, out=inside)
        np.minimum(inside, rays @ self._planes[some, 2].T, out=inside)
        inside /= np.linalg.norm(rays, axis=1)[:, None]
        return inside, rays @ self.nearness[some].T

    def cells(self, directions: np.ndarray) -> Iterator[tuple[np.ndarray, np.ndarray]]:
        """Yield rays (r,) and triangles (k,) so that all that may meet are together once.

        ``directions`` (R, 3) point away from the eye, before it.
        """
        if not len(directions):
            return
        tangent = directions[:, :2] / -directions[:, 2:]
        corner = tangent.min(axis=0)
        extent = np.maximum(np.ptp(tangent, axis=0), 1e-9)
        pad = 1e-4 * (1 + np.abs(tangent).max())
        alive = np.flatnonzero(
            self.hides
            & np.all((self.high >= corner - pad) & (self.low <= corner + extent + pad), axis=1)
        )
        n = int(np.clip(math.sqrt(len(directions) / 24), 1, 48 if len(alive) < 50_000 else 128))
        scale = n / extent
        first = _cell_of(self.low[alive] - pad - corner, scale, n)
        spans = _cell_of(self.high[alive] + pad - corner, scale, n) - first + 1
        counts = spans[:, 0] * spans[:, 1]
        triangle = np.repeat(np.arange(len(alive)), counts)
        nth = np.arange(len(triangle)) - np.repeat(np.cumsum(counts) - counts, counts)
        down, along = np.divmod(nth, spans[triangle, 0])
        column, row = first[triangle, 0] + along, first[triangle, 1] + down
        triangle = alive[triangle]
        meets = np.ones(len(triangle), dtype=bool)
        for k in range(3):  # a long triangle aslant fills little of its box
            plane = self._planes[triangle, k]
            most = plane[:, 0] * (corner[0] + (column + 0.5) / scale[0]) - plane[:, 2]
            most += plane[:, 1] * (corner[1] + (row + 0.5) / scale[1])
            most += (np.abs(plane[:, :2]) / scale).sum(axis=1) / 2
            meets &= most > -2 * pad
        cell, triangle = (row * n + column)[meets], triangle[meets]
        order = np.argsort(cell, kind="stable")
        triangle = triangle[order]
        begins = np.searchsorted(cell[order], np.arange(n * n + 1))
        at = _cell_of(tangent - corner, scale, n) @ [1, n]
        rays = np.argsort(at, kind="stable")
        ray_begins = np.searchsorted(at[rays], np.arange(n * n + 1))
        for here in np.flatnonzero(np.diff(ray_begins)):
            some = triangle[begins[here] : begins[here + 1]]
            mine = rays[ray_begins[here] : ray_begins[here + 1]]
            step = max(1, _BLOCK // max(1, len(some)))
            for start in range(0, len(mine), step):
                yield mine[start : start + step], some


def _cell_of(place: np.ndarray, scale: np.ndarray, n: int) -> np.ndarray:
    """Return column and row (N, 2) of places in an n x n grid, the outermost for all beyond."""
    return np.clip(place * scale, 0, n - 1).astype(np.int64)


def _image_boxes(corners: np.ndarray, near: float) -> tuple[np.ndarray, np.ndarray]:
    """Return boxes around triangles in the image plane at unit depth, low and high (T, 2).

    Of what is deeper than ``near``; inverted where nothing is.
    """
    low = np.full((len(corners), 2), np.inf)
    high = np.full((len(corners), 2), -np.inf)

    def widen(points: np.ndarray, which: np.ndarray) -> None:
        tangent = points[which, :2] / -points[which, 2:]
        low[which] = np.minimum(low[which], tangent)
        high[which] = np.maximum(high[which], tangent)

    for k in range(3):
        start, end = corners[:, k], corners[:, (k + 1) % 3]
        before, after = -start[:, 2] >= near, -end[:, 2] >= near
        widen(start, before)
        crosses = before != after
        along = np.where(crosses, (-near - start[:, 2]), 0)
        along /= np.where(crosses, end[:, 2] - start[:, 2], 1)
        cut = start + along[:, None] * (end - start)
        cut[:, 2] = -near
        widen(cut, crosses)
    return low, high


def roundings(own: np.ndarray, everything: np.ndarray) -> np.ndarray:
    """Return to which lengths float32 holds triangles (T, 3, 3), relative to the model's, (T,)."""
    middle = (own.min(axis=(0, 1)) + own.max(axis=(0, 1))) / 2
    return _STEPS * 2.0**-23 * np.linalg.norm(everything - middle, axis=2).max(axis=1)


def has_area(own: np.ndarray) -> np.ndarray:
    """Return which triangles (F, 3, 3) have an area in the file's own numbers, (F,) bool.

    Turned by a pose, a line is a triangle of rounding.
    """
    cross = np.cross(own[:, 1] - own[:, 0], own[:, 2] - own[:, 0])
    return (cross != 0).any(axis=1)


class Hiding:
    """What hides points from the origin of a frame, and of which rounding leaves that open.

    Parameters
    ----------
    fan : Fan
        The triangles.
    rounding : float
        Of coordinates, a length.
    nearest, certain : float
        Nothing hides before the one depth; between the two it is left open.
    """

    def __init__(self, fan: Fan, rounding: float, nearest: float, certain: float) -> None:
        self._fan, self._rounding = fan, rounding
        self.nearest, self.certain = nearest, certain

    def hidden(self, points: np.ndarray, own: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return which points something hides, and of which rounding leaves that open."""
        surely, possibly, margin = self._before(points, own)
        unsure = np.flatnonzero(possibly & ~surely)
        hidden, doubtful = surely.copy(), np.zeros(len(points), dtype=bool)
        if len(unsure):
            # Most are near an edge that two occluders share: shifted rays know.
            hides, frees = [], []
            for shifted, is_bad in self._shifted(points[unsure], own[unsure], margin[unsure]):
                hides_here, may, _ = self._before(shifted, own[unsure], exactly=True)
                hides.append(hides_here & ~is_bad)
                frees.append(~may & ~is_bad)
            all_hide, all_free = np.all(hides, axis=0), np.all(frees, axis=0)
            hidden[unsure] = ~frees[0]
            doubtful[unsure] = ~all_hide & ~all_free
        return hidden, doubtful

    def _shifted(
        self, points: np.ndarray, own: np.ndarray, margin: np.ndarray
    ) -> Iterator[tuple[np.ndarray, np.ndarray]]:
        """Yield the points themselves, and as rays a margin beside them meet their planes."""
        yield points, np.zeros(len(points), dtype=bool)
        aside = (margin * np.linalg.norm(points, axis=1))[:, None]
        for x, y in ((1, 0.3), (-0.3, 1), (-1, -0.3), (0.3, -1)):
            moved = points + aside * np.array([x, y, 0.0])
            share = np.sum(moved * self._fan.nearness[own], axis=1)
            is_bad = np.abs(share - 1) > 0.5
            yield moved / np.where(is_bad, 1, share)[:, None], is_bad

    def _before(
        self, points: np.ndarray, own: np.ndarray, *, exactly: bool = False
    ) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Return before which points something lies surely, and possibly, (R,) bool each.

        And the largest angle (R,) by which rounding may move an edge of what possibly does, for
        which nothing is allowed where ``exactly``.
        """
        surely, possibly = np.zeros(len(points), dtype=bool), np.zeros(len(points), dtype=bool)
        widest = np.zeros(len(points))
        length = np.linalg.norm(points, axis=1)
        for rays, some in self._fan.cells(points):
            inside, nearness = self._fan.meets(points[rays], some)
            inside[some[None, :] == own[rays, None]] = -1
            # a first sieve: rounding moves what is nearest most, and that is at the clip plane
            if exactly:
                least = -_SLACK
            else:
                least = -_SHARE - self._rounding * (nearness / length[rays, None])
            row, column = np.nonzero((nearness > 1 + _BEFORE) & (inside >= least))
            if not len(row):
                continue
            inside, nearness = inside[row, column], nearness[row, column]
            ray, face = rays[row], some[column]
            margin = _SHARE + self._rounding * nearness / length[ray]
            inner = -_SLACK if exactly else margin
            clear = (nearness - 1) * np.abs(self._fan.height[face])
            depth = -points[ray, 2]
            sure = (inside >= inner) & (clear > _CLEAR * length[ray] + self._rounding)
            sure &= depth >= self.certain * nearness
            possible = depth >= self.nearest * nearness
            surely[ray[sure]] = True
            possibly[ray[possible]] = True
            np.maximum.at(widest, ray[possible], margin[possible])
        return surely, possibly, widest

    def shown(self, rays: np.ndarray, n: int) -> tuple[np.ndarray, ...]:
        """Return what rays (R, 3) of unit depth may meet first, of P pairs.

        Which ray, which of the first ``n`` triangles, how near it is (1 over its depth), and
        whether it surely is the first; of triangles that coincide each is.
        """
        ray, face, inside, near = self._met(rays)
        length = np.linalg.norm(rays, axis=1)[ray]
        margin = _SHARE + self._rounding * near / length
        # of each ray the nearest that rounding may show, and the nearest that it must
        outer, inner = np.zeros(len(rays)), np.zeros(len(rays))
        may, must = inside >= -margin, inside >= margin
        must &= near * self.certain <= 1
        np.maximum.at(outer, ray[may], near[may])
        np.maximum.at(inner, ray[must], near[must])
        is_first = must & (near == inner[ray])
        height = np.zeros(len(rays))
        height[ray[is_first]] = np.abs(self._fan.height[face[is_first]])
        clear = (inner[ray] / near - 1) * height[ray]
        shows = may & (clear <= _CLEAR * length / near + self._rounding)
        shows &= face < n  # obstacles show and are not counted
        surely = must & (near >= outer[ray] * (1 - _BEFORE))
        return ray[shows], face[shows], near[shows], surely[shows]

    def _met(self, rays: np.ndarray) -> tuple[np.ndarray, ...]:
        """Return which rays (R, 3) of unit depth meet which triangles, near their edges as well.

        Of P pairs: ray, triangle, the angle inside, the nearness; of what may hide alone.
        """
        # rounding moves the edges of what is nearest most
        margin = min(_SHARE + self._rounding / max(self.nearest, 1e-300), 1e-3)
        found: list[tuple[np.ndarray, ...]] = []
        for mine, some in self._fan.cells(rays):
            inside, near = self._fan.meets(rays[mine], some)
            row, column = np.nonzero((inside >= -margin) & (near > 0))
            found.append((mine[row], some[column], inside[row, column], near[row, column]))
        if not found:
            none = np.zeros(0, dtype=np.int64)
            return none, none, np.zeros(0), np.zeros(0)
        ray, face, inside, near = map(np.concatenate, zip(*found, strict=True))
        beyond = near * self.nearest <= 1
        return ray[beyond], face[beyond], inside[beyond], near[beyond]


class Judge:
    """One sensor before one model.

    Parameters
    ----------
    pose : (4, 4) float64
        Camera to world.
    eye : Eye
        The sensor's angles and limits.
    triangles, obstacles : (F, 3, 3), (O, 3, 3) float64
        The model, and what only hides.

    Attributes
    ----------
    clip : float
        Depth before which nothing hides.
    """

    def __init__(
        self,
        pose: np.ndarray,
        eye: Eye,
        triangles: np.ndarray,
        obstacles: np.ndarray | None = None,
    ) -> None:
        pose, own = np.asarray(pose, dtype=float), np.asarray(triangles, dtype=float)
        others = np.zeros((0, 3, 3)) if obstacles is None else np.asarray(obstacles, dtype=float)
        everything = np.concatenate([own, others])
        self.eye, self.n = eye, len(own)
        self._corners = (everything - pose[:3, 3]) @ pose[:3, :3]
        deepest = -float(self._corners[..., 2].min())
        self.clip = NEAREST * min(eye.max_distance, DEEPEST * max(deepest, 0.0))
        self._fan = Fan(self._corners, self.clip)
        self._roundings = roundings(own, everything)
        self._rounding = float(self._roundings.max())
        self._has_area = self._fan.has_area[: self.n] & has_area(own)
        nearest, certain = self.clip * (1 - _SHARE) / _PLANES_OFF, self.clip * (1 + _SHARE)
        self._hiding = Hiding(self._fan, self._rounding, nearest, certain)
        self._pixels: dict[tuple[int, int], tuple[np.ndarray, np.ndarray]] = {}

    def centroids(self) -> Verdict:
        """Return the verdict on each face's centre of mass, (F,)."""
        return self.look(self._corners[: self.n].mean(axis=1), np.arange(self.n))

    def shares(self, n: int = 8, faces: np.ndarray | None = None) -> tuple[np.ndarray, np.ndarray]:
        """Return the shares of n * n points of faces that are surely and possibly seen, (f,) each.

        The points are the centroids of the face's n * n congruent parts; ``faces`` (f,) int are
        all where not given.
        """
        faces = np.arange(self.n) if faces is None else faces
        some = np.flatnonzero(self._may_pass(faces))
        weights = part_centroids(n)
        surely, possibly = np.zeros(len(faces)), np.zeros(len(faces))
        step = max(1, (1 << 20) // len(weights))
        for first in range(0, len(some), step):
            part = some[first : first + step]
            points = np.einsum("pk,fkx->fpx", weights, self._corners[faces[part]])
            own = np.repeat(faces[part], len(weights))
            verdict = self.look(points.reshape(-1, 3), own)
            surely[part] = verdict.surely.reshape(len(part), -1).mean(axis=1)
            possibly[part] = verdict.possibly.reshape(len(part), -1).mean(axis=1)
        return surely, possibly

    def pixels(self, resolution: tuple[int, int]) -> tuple[np.ndarray, np.ndarray]:
        """Return in how many pixels each face is surely and possibly seen, (F,) int each.

        By rays through the pixels' centres; of faces that coincide each is seen.
        """
        if resolution not in self._pixels:
            self._pixels[resolution] = self._count_pixels(resolution)
        return self._pixels[resolution]

    def look(self, points: np.ndarray, own: np.ndarray) -> Verdict:
        """Return the verdict on points (R, 3) of faces ``own`` (R,)."""
        margin = self._margin(points, own)
        is_open = (np.abs(margin) < 1) | (-points[:, 2] < self.clip * (1 + _SHARE))
        free, doubtful = np.zeros(len(own), dtype=bool), np.zeros(len(own), dtype=bool)
        some = np.flatnonzero((margin > -1) & self._has_area[own])
        hidden, unsure = self._hiding.hidden(points[some], own[some])
        free[some] = ~hidden & (margin[some] > 0)
        doubtful[some] = unsure | (is_open[some] & ~hidden)
        return Verdict(free, doubtful)

    # --- filters

    def _margin(self, points: np.ndarray, own: np.ndarray) -> np.ndarray:
        """Return by how many roundings points pass all filters, (R,); below 0 they do not."""
        eye, depth = self.eye, -points[:, 2]
        length = np.maximum(np.linalg.norm(points, axis=1), 1e-300)
        rounding = _SHARE + self._rounding / length
        turning = rounding + self._turning(own)
        cosine = self._fan.height[own] / length
        tan_x, tan_y = eye.tan_half
        passing = [
            depth / length / rounding,
            (depth - eye.min_distance) / length / rounding,
            (tan_x * depth - np.abs(points[:, 0])) / length / rounding,
            (tan_y * depth - np.abs(points[:, 1])) / length / rounding,
            cosine / turning,
            (cosine - math.cos(math.radians(min(eye.max_incidence_deg, 90.0)))) / turning,
        ]
        if math.isfinite(eye.max_distance):
            passing.append((eye.max_distance - depth) / length / rounding)
        return np.min(passing, axis=0)

    def _may_pass(self, faces: np.ndarray) -> np.ndarray:
        """Return which faces (f,) may look at the eye and lie in the image, (f,) bool."""
        low, high = self._fan.low[faces], self._fan.high[faces]
        tan = np.array(self.eye.tan_half) * (1 + 1e-4)
        inside = np.all((low <= tan) & (high >= -tan), axis=1)
        # not quite: seen from far or edge-on, rounding may turn a face to the eye
        reach = np.linalg.norm(self._corners[faces], axis=2).max(axis=1)
        turning = _SHARE + self._turning(faces)
        towards = self._fan.height[faces] > -turning * reach - self._rounding
        return inside & self._has_area[faces] & towards

    def _turning(self, faces: np.ndarray) -> np.ndarray:
        """Return by which angles rounding may turn faces (f,), in radians, (f,)."""
        return self._roundings[faces] / np.maximum(self._fan.width[faces], 1e-300)

    # --- pixels

    def _count_pixels(self, resolution: tuple[int, int]) -> tuple[np.ndarray, np.ndarray]:
        rays = pixel_directions(np.eye(4), self.eye.tan_half, resolution).reshape(-1, 3)
        ray, face, near, surely = self._hiding.shown(rays, self.n)
        passes = self._margin(rays[ray] / near[:, None], face)
        surely = surely & (passes > 1) & self._has_area[face]
        return (
            np.bincount(face[surely], minlength=self.n),
            np.bincount(face[passes > -1], minlength=self.n),
        )
