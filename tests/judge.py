"""The judge of visibility maps: rays in float64 to points of faces, each free or not.

Like ``oracle.py`` it is plain NumPy and imports nothing of glvis; unlike it, it is quick enough
for thousands of faces and hundreds of poses, and it knows what rounding leaves open. Its rules
are those of the project's method:

- A ray to a point is free where nothing lies before the point by more than 1e-9 of the way. So
  faces that coincide do not hide each other: each that faces the sensor and passes is seen.
- Both sides of every face hide, whatever the filters say of it; faces of no area never count.
- Nothing nearer than a thousandth of maxD hides, and what is seen of points there is left open.

A sample is *doubtful* where a limit of a filter or an occluder's edge is nearer than 1e-6 of the
distance, or an occluder lies before it by less than 2e-7 of the way, a few steps of float32.
Doubtful samples excuse a map either way, and are counted.

Names: F faces of the model, T triangles that hide (model and obstacles), R rays. All is done in
the camera frame, x right, y up, the sensor looks along -z from the origin.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass, field, fields

import numpy as np
from oracle import Eye, part_centroids, pixel_directions

NEAREST = 1e-3  # share of maxD before which nothing hides
_MARGIN = 1e-6  # share of the distance within which a limit or an edge is rounding
_BEFORE, _SURELY_BEFORE = 1e-9, 2e-7  # share of the way by which an occluder is nearer
_SLACK = 1e-13  # of an edge, as a direction: a ray through a shared edge meets one face at least
_BLOCK = 1 << 16  # rays x triangles tested at once
_PLANES_OFF = 1.001  # the engine may put its near plane this factor nearer


@dataclass
class Figures:
    """What is counted over the maps of one criterion; sums add up."""

    seen: int = 0  # faces that the maps call visible
    wrong: float = 0.0  # of them those of which no point is
    half: int = 0  # faces at least half visible (and large enough, where pixels decide)
    missed: int = 0  # of them those that the maps leave out
    any: int = 0  # faces of which one of 64 points shows
    missed_any: int = 0
    both: int = 0  # centres free in truth and in the map
    either: int = 0
    excused: int = 0  # doubtful faces on which map and truth would have differed or could have
    judged: int = 0

    def __iadd__(self, other: Figures) -> Figures:
        for one in fields(self):
            setattr(self, one.name, getattr(self, one.name) + getattr(other, one.name))
        return self

    @property
    def wrong_percent(self) -> float:
        """Of the faces called visible."""
        return 100 * self.wrong / max(self.seen, 1)

    @property
    def missed_percent(self) -> float:
        """Of the faces at least half visible."""
        return 100 * self.missed / max(self.half, 1)

    @property
    def missed_any_percent(self) -> float:
        """Of the faces of which one of 64 points shows."""
        return 100 * self.missed_any / max(self.any, 1)

    @property
    def iou(self) -> float:
        """Intersection over union of centres."""
        return self.both / self.either if self.either else 1.0

    @property
    def excused_percent(self) -> float:
        """Of the faces judged."""
        return 100 * self.excused / max(self.judged, 1)


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


@dataclass
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
    """

    pose: np.ndarray
    eye: Eye
    triangles: np.ndarray
    obstacles: np.ndarray | None = None
    _shows: dict[int, bool] = field(default_factory=dict)
    _pixels: dict[tuple[int, int], tuple[np.ndarray, np.ndarray]] = field(default_factory=dict)

    def __post_init__(self) -> None:
        pose = np.asarray(self.pose, dtype=float)
        own = np.asarray(self.triangles, dtype=float)
        others = np.zeros((0, 3, 3)) if self.obstacles is None else self.obstacles
        corners = (np.concatenate([own, others]) - pose[:3, 3]) @ pose[:3, :3]
        self.n = len(own)
        self.corners = corners  # (T, 3, 3), camera frame
        a, b, c = np.moveaxis(corners, 1, 0)
        cross = np.cross(b - a, c - a)
        double = np.linalg.norm(cross, axis=1)
        world = np.cross(own[:, 1] - own[:, 0], own[:, 2] - own[:, 0])
        self.has_area = double > 0
        self.has_area[: self.n] &= (world != 0).any(axis=1)
        normal = cross / np.where(self.has_area, double, 1)[:, None]
        height = -np.sum(normal * a, axis=1)
        self.height = height  # of the eye above each plane, (T,)
        reach = np.linalg.norm(corners, axis=2).max(axis=1)
        edges = [b - a, c - b, a - c]
        longest = np.max([np.linalg.norm(edge, axis=1) for edge in edges], axis=0)
        width = double / np.where(longest > 0, longest, 1)
        self.is_unsure = width < 1e-7 * reach  # its normal is rounding
        self.hides = self.has_area & (np.abs(height) > 1e-13 * reach)
        side = -np.sign(height)[:, None]
        planes = []
        for start, edge in zip((a, b, c), edges, strict=True):
            plane = np.cross(start, edge) * side
            length = np.linalg.norm(plane, axis=1)[:, None]
            planes.append(plane / np.where(length > 0, length, 1))
        with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
            nearness = normal * side / np.abs(height)[:, None]
        nearness[~self.hides] = 0
        # d @ edges >= 0 for all three inside the triangle's cone; d @ nearness is 1 in its plane
        self.edges = np.stack(planes, axis=1)  # (T, 3, 3)
        self.nearness = nearness  # (T, 3)
        most = self.eye.max_distance
        self.clip = NEAREST * most if math.isfinite(most) else 0.0
        self._boxes = self._in_image()

    # --- samples

    def centroids(self) -> Verdict:
        """Return the verdict on each face's centre of mass, (F,)."""
        points = self.corners[: self.n].mean(axis=1)
        return self.look(points, np.arange(self.n))

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
            points = np.einsum("pk,fkx->fpx", weights, self.corners[faces[part]])
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
        open_ = np.abs(margin) < _MARGIN
        open_ |= -points[:, 2] < self.clip * (1 + _MARGIN)
        open_ |= self.is_unsure[own]
        free, doubtful = np.zeros(len(own), dtype=bool), np.zeros(len(own), dtype=bool)
        some = np.flatnonzero((margin > -_MARGIN) & self.has_area[own])
        hidden, unsure = self._hidden(points[some], own[some])
        free[some] = ~hidden & (margin[some] > 0)
        doubtful[some] = unsure | (open_[some] & ~hidden)
        return Verdict(free, doubtful)

    def _margin(self, points: np.ndarray, own: np.ndarray) -> np.ndarray:
        """Return by how much points pass all filters, as shares of the distance; below 0: not."""
        eye, depth = self.eye, -points[:, 2]
        length = np.maximum(np.linalg.norm(points, axis=1), 1e-300)
        cosine = self.height[own] / length
        tan_x, tan_y = eye.tan_half
        passing = [
            depth / length,
            (depth - eye.min_distance) / length,
            (tan_x * depth - np.abs(points[:, 0])) / length,
            (tan_y * depth - np.abs(points[:, 1])) / length,
            cosine,
            cosine - math.cos(math.radians(min(eye.max_incidence_deg, 90.0))),
        ]
        if math.isfinite(eye.max_distance):
            passing.append((eye.max_distance - depth) / length)
        return np.min(passing, axis=0)

    def _may_pass(self, faces: np.ndarray) -> np.ndarray:
        """Return which faces (f,) look at the eye and may lie in the image, (f,) bool."""
        low, high = (box[faces] for box in self._boxes)
        tan = np.array(self.eye.tan_half) * (1 + 1e-5)
        inside = np.all((low <= tan) & (high >= -tan), axis=1)
        return inside & self.has_area[faces] & (self.height[faces] > 0)

    # --- rays against triangles

    def _in_image(self) -> tuple[np.ndarray, np.ndarray]:
        """Return boxes around triangles in the image plane at unit depth, low and high (T, 2).

        Of what is beyond the depth before which nothing hides; inverted where nothing is.
        """
        near = 0.99 * self.clip if self.clip else 1e-12 * float(np.abs(self.corners).max())
        low = np.full((len(self.corners), 2), np.inf)
        high = np.full((len(self.corners), 2), -np.inf)

        def widen(points: np.ndarray, which: np.ndarray) -> None:
            tangent = points[which, :2] / -points[which, 2:]
            low[which] = np.minimum(low[which], tangent)
            high[which] = np.maximum(high[which], tangent)

        for k in range(3):
            start, end = self.corners[:, k], self.corners[:, (k + 1) % 3]
            before, after = -start[:, 2] >= near, -end[:, 2] >= near
            widen(start, before)
            crosses = before != after
            along = np.where(crosses, (-near - start[:, 2]), 0)
            along /= np.where(crosses, end[:, 2] - start[:, 2], 1)
            cut = start + along[:, None] * (end - start)
            cut[:, 2] = -near
            widen(cut, crosses)
        return low, high

    def _cells(self, directions: np.ndarray) -> Iterator[tuple[np.ndarray, np.ndarray]]:
        """Yield rays (r,) and triangles (k,) so that all that may meet are together once.

        ``directions`` (R, 3) point away from the eye, before it.
        """
        if not len(directions):
            return
        tangent = directions[:, :2] / -directions[:, 2:]
        corner = tangent.min(axis=0)
        extent = np.maximum(np.ptp(tangent, axis=0), 1e-9)
        pad = 1e-5 * (1 + np.abs(tangent).max())
        low, high = self._boxes
        alive = np.flatnonzero(
            self.hides & np.all((high >= corner - pad) & (low <= corner + extent + pad), axis=1)
        )
        across = np.clip(math.sqrt(len(directions) / 24), 1, 48 if len(alive) < 50_000 else 128)
        grid = np.array([math.ceil(across), math.ceil(across)])
        scale = grid / extent
        first = np.clip((low[alive] - pad - corner) * scale, 0, grid - 1).astype(np.int64)
        last = np.clip((high[alive] + pad - corner) * scale, 0, grid - 1).astype(np.int64)
        spans = last - first + 1
        counts = spans[:, 0] * spans[:, 1]
        triangle = np.repeat(np.arange(len(alive)), counts)
        nth = np.arange(len(triangle)) - np.repeat(np.cumsum(counts) - counts, counts)
        wide = spans[triangle, 0]
        cell = (first[triangle, 1] + nth // wide) * grid[0] + first[triangle, 0] + nth % wide
        order = np.argsort(cell, kind="stable")
        triangle = alive[triangle[order]]
        begins = np.searchsorted(cell[order], np.arange(grid[0] * grid[1] + 1))
        at = np.clip((tangent - corner) * scale, 0, grid - 1).astype(np.int64)
        ray_cell = at[:, 1] * grid[0] + at[:, 0]
        rays = np.argsort(ray_cell, kind="stable")
        ray_begins = np.searchsorted(ray_cell[rays], np.arange(grid[0] * grid[1] + 1))
        for here in np.flatnonzero(np.diff(ray_begins)):
            some = triangle[begins[here] : begins[here + 1]]
            mine = rays[ray_begins[here] : ray_begins[here + 1]]
            step = max(1, _BLOCK // max(1, len(some)))
            for start in range(0, len(mine), step):
                yield mine[start : start + step], some

    def _meets(self, rays: np.ndarray, some: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return how far inside triangles rays (r, 3) are, as angles, and the nearness, (r, k).

        Nearness times a ray's length is 1 where the triangle's plane is at its end.
        """
        length = np.linalg.norm(rays, axis=1)[:, None]
        inside = rays @ self.edges[some, 0].T
        np.minimum(inside, rays @ self.edges[some, 1].T, out=inside)
        np.minimum(inside, rays @ self.edges[some, 2].T, out=inside)
        inside /= length
        return inside, rays @ self.nearness[some].T

    def _hidden(self, points: np.ndarray, own: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return which points something hides, and of which rounding leaves that open."""
        surely, possibly = self._before(points, own, _MARGIN)
        unsure = np.flatnonzero(possibly & ~surely)
        hidden, doubtful = surely.copy(), np.zeros(len(points), dtype=bool)
        if len(unsure):
            # Most are near an edge that two occluders share: shifted rays know.
            hides, frees = [], []
            for shifted, is_bad in self._shifted(points[unsure], own[unsure]):
                hides_here, may = self._before(shifted, own[unsure], 0.0)
                hides.append(hides_here & ~is_bad)
                frees.append(~may & ~is_bad)
            all_hide, all_free = np.all(hides, axis=0), np.all(frees, axis=0)
            hidden[unsure] = ~frees[0]
            doubtful[unsure] = ~all_hide & ~all_free
        return hidden, doubtful

    def _shifted(
        self, points: np.ndarray, own: np.ndarray
    ) -> Iterator[tuple[np.ndarray, np.ndarray]]:
        """Yield the points themselves, and as rays a margin beside them meet their planes."""
        yield points, np.zeros(len(points), dtype=bool)
        length = np.linalg.norm(points, axis=1)
        for x, y in ((1, 0.3), (-0.3, 1), (-1, -0.3), (0.3, -1)):
            moved = points + _MARGIN * length[:, None] * np.array([x, y, 0.0])
            share = np.sum(moved * self.nearness[own], axis=1)
            is_bad = np.abs(share - 1) > 0.5
            yield moved / np.where(is_bad, 1, share)[:, None], is_bad

    def _before(
        self, points: np.ndarray, own: np.ndarray, margin: float
    ) -> tuple[np.ndarray, np.ndarray]:
        """Return before which points something lies surely, and possibly, (R,) bool each."""
        surely, possibly = np.zeros(len(points), dtype=bool), np.zeros(len(points), dtype=bool)
        inner = margin or -_SLACK
        outer = -margin or -_SLACK
        for rays, some in self._cells(points):
            inside, nearness = self._meets(points[rays], some)
            inside[some[None, :] == own[rays, None]] = -1
            possible = (inside >= outer) & (nearness > 1 + _BEFORE)
            if not possible.any():
                continue
            depth = -points[rays, 2:]
            far_enough = depth >= self.clip * (1 + _MARGIN) * nearness
            sure = possible & (inside >= inner) & (nearness > 1 + _SURELY_BEFORE) & far_enough
            possible &= depth * _PLANES_OFF >= self.clip * (1 - _MARGIN) * nearness
            surely[rays] = sure.any(axis=1)
            possibly[rays] = possible.any(axis=1)
        return surely, possibly

    def _count_pixels(self, resolution: tuple[int, int]) -> tuple[np.ndarray, np.ndarray]:
        rays = pixel_directions(np.eye(4), self.eye.tan_half, resolution).reshape(-1, 3)
        found: list[tuple[np.ndarray, ...]] = []
        for mine, some in self._cells(rays):
            if not len(some):
                continue
            inside, nearness = self._meets(rays[mine], some)
            if self.clip:
                nearness[nearness * self.clip > 1] = 0
            if inside.max() < -_MARGIN:
                continue
            nearest = np.where(inside >= -_SLACK, nearness, 0).max(axis=1)
            inner = np.where(inside >= _MARGIN, nearness, 0).max(axis=1)
            least = np.maximum(inner * (1 - _SURELY_BEFORE), 1e-300)
            row, column = np.nonzero((inside >= -_MARGIN) & (nearness >= least[:, None]))
            near = nearness[row, column]
            is_first = inside[row, column] >= -_SLACK
            is_first &= near >= nearest[row] * (1 - _BEFORE)
            found.append((mine[row], some[column], near, is_first))
        if not found:
            return np.zeros(self.n, dtype=np.int64), np.zeros(self.n, dtype=np.int64)
        ray, face, near, is_first = map(np.concatenate, zip(*found, strict=True))
        own = face < self.n  # obstacles show and are not counted
        ray, face, near, is_first = ray[own], face[own], near[own], is_first[own]
        margin = self._margin(rays[ray] / near[:, None], face)
        surely = np.bincount(face[is_first & (margin > _MARGIN)], minlength=self.n)
        return surely, np.bincount(face[margin > -_MARGIN], minlength=self.n)

    # --- maps

    def of_centroids(self, visible: np.ndarray) -> Figures:
        """Return the figures of a map (F,) made by centres."""
        truth = self._centroids
        sure = ~truth.doubtful
        return Figures(
            seen=int(np.count_nonzero(visible)),
            both=int(np.count_nonzero(visible & truth.free & sure)),
            either=int(np.count_nonzero((visible | truth.free) & sure)),
            excused=int(np.count_nonzero(truth.doubtful)),
            judged=int(np.count_nonzero(self.height[: self.n] > 0)),
        )

    def of_pixels(
        self,
        visible: np.ndarray,
        sensor_pixels: tuple[int, int],
        drawn: tuple[int, int] | None = None,
        *,
        at_most: int = 120,
    ) -> Figures:
        """Return the figures of a map (F,) made by pixels.

        Parameters
        ----------
        visible : (F,) bool
            The map.
        sensor_pixels : (int, int)
            The sensor's own.
        drawn : (int, int), optional
            Those of the image that decided, where it was not the sensor's; where it was, only
            faces that cover two of its pixels' centres can be missed.
        at_most : int
            Suspects of a pose that are looked at closely; of more a share at random.
        """
        surely, possibly = self._points
        covers = self.pixels(sensor_pixels)
        half, shows = surely >= 0.5, surely > 0
        if drawn is None:
            half = half & (covers[0] >= 2)
            shows = shows & (covers[0] >= 2)
        suspects = np.flatnonzero(visible & (possibly == 0) & (covers[1] == 0))
        if drawn is not None and len(suspects):
            suspects = suspects[self.pixels(drawn)[1][suspects] == 0]
        return Figures(
            seen=int(np.count_nonzero(visible)),
            wrong=self._wrong_of(suspects, at_most),
            half=int(np.count_nonzero(half)),
            missed=int(np.count_nonzero(half & ~visible)),
            any=int(np.count_nonzero(shows)),
            missed_any=int(np.count_nonzero(shows & ~visible)),
            excused=int(np.count_nonzero((possibly > 0) & (surely == 0) & visible)),
            judged=int(np.count_nonzero(self.height[: self.n] > 0)),
        )

    def _wrong_of(self, suspects: np.ndarray, at_most: int) -> float:
        """Return of how many suspects (f,) no point shows, by 4,096 points of each."""
        if not len(suspects):
            return 0.0
        # a random choice that is the same for other maps of this pose
        rank = np.random.default_rng(0).permutation(self.n)[suspects]
        chosen = suspects[np.argsort(rank)[:at_most]]
        new = np.array([face for face in chosen if int(face) not in self._shows], dtype=np.int64)
        for n in (16, 64):
            _, possibly = self.shares(n, new)
            self._shows.update(zip(new.tolist(), (possibly > 0).tolist(), strict=True))
            new = new[possibly == 0]
        wrong = sum(not self._shows[int(face)] for face in chosen)
        return wrong * len(suspects) / len(chosen)

    @property
    def _points(self) -> tuple[np.ndarray, np.ndarray]:
        if not hasattr(self, "_kept_points"):
            self._kept_points = self.shares()
        return self._kept_points

    @property
    def _centroids(self) -> Verdict:
        if not hasattr(self, "_kept_centroids"):
            self._kept_centroids = self.centroids()
        return self._kept_centroids
