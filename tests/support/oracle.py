"""An independent ray caster in plain NumPy float64: what a sensor sees, without OpenGL.

Möller and Trumbore's test of a ray against a triangle, "Fast, minimum storage ray-triangle
intersection" (1997), for all rays against all triangles that a bundle of rays can reach. It
imports nothing of glvis, so that a shared mistake cannot hide. The rules of visibility are those
of the paper's Sec. 2.1 as this project reads them: pinhole at the origin of the camera frame
(x right, y up, looking along -z), image row 0 on top, distances as depth along the optical axis.

Names: R rays, F faces of the model, T triangles that hide (model and obstacles), H x W pixels.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from dataclasses import dataclass

import numpy as np

_EDGE = 1e-12  # barycentric slack: a ray through a shared edge hits at least one of its faces
_BUNDLE = 256  # rays tested together
_BLOCK = 1 << 20  # rays x triangles tested at once
_BACK_TOLERANCE = math.radians(20)  # CropBack of the paper, on the optical axis


@dataclass(frozen=True)
class Eye:
    """A sensor in degrees and scene units; ``of`` reads a ``glvis.Sensor`` by its attributes."""

    hfov_deg: float
    vfov_deg: float
    min_distance: float = 0.0
    max_distance: float = math.inf
    max_incidence_deg: float = 90.0

    @classmethod
    def of(cls, sensor) -> Eye:
        return cls(
            math.degrees(sensor.lens.hfov),
            math.degrees(sensor.lens.vfov),
            sensor.min_distance,
            sensor.max_distance,
            math.degrees(sensor.max_incidence),
        )

    @property
    def tan_half(self) -> tuple[float, float]:
        return math.tan(math.radians(self.hfov_deg / 2)), math.tan(math.radians(self.vfov_deg / 2))


@dataclass(frozen=True)
class Rules:
    """How a map is judged: ``incidence`` "ray" or "axis", ``occlusion`` "physical" or "paper".

    ``semantics = "paper"`` decides all else: centroid rays, CropFOV that keeps a face with any
    vertex inside, CropBack with 20 degrees on the axis, CropNear that drops a face with any
    vertex nearer than minD. ``clip_near`` is the depth before which nothing hides.
    """

    incidence: str = "ray"
    occlusion: str = "physical"
    semantics: str = ""
    clip_near: float = 0.0

    def __post_init__(self) -> None:
        if self.semantics == "paper":
            object.__setattr__(self, "incidence", "axis")
            object.__setattr__(self, "occlusion", "paper")


@dataclass(frozen=True)
class IdImage:
    """The truth of one picture, (H, W) each.

    ``ids`` is face + 1 of what each pixel's centre sees first, 0 for nothing; ``depth`` along the
    axis, inf for nothing; ``gap`` how much deeper the second hit lies, inf where there is none.
    """

    ids: np.ndarray
    depth: np.ndarray
    gap: np.ndarray
    camera_to_world: np.ndarray
    tan_half: tuple[float, float]
    triangles: np.ndarray


# --- rays against triangles


class _Fan:
    """Triangles seen from one point: Möller and Trumbore with the ray's origin held fixed.

    With s = origin - v0 the test's determinants are each one dot product of the direction with a
    vector of the triangle: det = d.(e2 x e1), u det = d.(e2 x s), v det = d.(s x e1), and
    t det = e2.(s x e1) does not depend on the ray.
    """

    def __init__(self, origin: np.ndarray, triangles: np.ndarray) -> None:
        v0, v1, v2 = np.moveaxis(np.asarray(triangles, dtype=float), 1, 0)
        e1, e2, s = v1 - v0, v2 - v0, origin - v0
        self.n_det = np.cross(e2, e1)
        self.n_u = np.cross(e2, s)
        self.n_v = np.cross(s, e1)
        self.t_det = np.sum(e2 * self.n_v, axis=1)
        centre = (v0 + v1 + v2) / 3
        radius = np.linalg.norm(triangles - centre[:, None], axis=2).max(axis=1)
        towards = centre - origin
        distance = np.linalg.norm(towards, axis=1)
        self.towards = towards / np.maximum(distance, 1e-300)[:, None]
        # half angle under which the bounding sphere appears; pi for one around the origin
        ratio = radius / np.maximum(distance, 1e-300)
        self.spread = np.where(ratio < 1, np.arcsin(np.minimum(ratio, 1)), math.pi)

    def reached_by(self, directions: np.ndarray) -> np.ndarray:
        """Return the triangles (C,) whose bounding spheres meet the cone around the rays."""
        unit = directions / np.linalg.norm(directions, axis=1, keepdims=True)
        axis = unit.mean(axis=0)
        length = np.linalg.norm(axis)
        if length < 1e-3:
            return np.arange(len(self.t_det))
        axis /= length
        half = _angle(unit @ axis).max()
        return np.flatnonzero(_angle(self.towards @ axis) <= half + self.spread + 1e-6)

    def hits(self, directions: np.ndarray, some: np.ndarray) -> np.ndarray:
        """Return t (R, C) of the triangles ``some`` (C,), inf where missed or behind."""
        det = directions @ self.n_det[some].T
        u = directions @ self.n_u[some].T
        v = directions @ self.n_v[some].T
        sign = np.sign(det)
        slack = -_EDGE * np.abs(det)
        u, v, det = u * sign, v * sign, np.abs(det)
        t_det = self.t_det[some] * sign
        inside = (u >= slack) & (v >= slack) & (det - u - v >= slack) & (det > 0) & (t_det > 0)
        return np.divide(t_det, det, out=np.full(det.shape, math.inf), where=inside)


def _angle(cosine: np.ndarray) -> np.ndarray:
    return np.arccos(np.clip(cosine, -1, 1))


def _bundles(directions: np.ndarray) -> Iterator[np.ndarray]:
    """Split rays into groups of near directions, each an index array of at most _BUNDLE."""
    unit = directions / np.linalg.norm(directions, axis=1, keepdims=True)
    waiting = [np.arange(len(unit))] if len(unit) else []
    while waiting:
        group = waiting.pop()
        if len(group) <= _BUNDLE:
            yield group
            continue
        component = unit[group, np.argmax(np.ptp(unit[group], axis=0))]
        order = np.argpartition(component, len(group) // 2)
        waiting += [group[order[: len(group) // 2]], group[order[len(group) // 2 :]]]


def _blocks(
    origin: np.ndarray, directions: np.ndarray, triangles: np.ndarray
) -> Iterator[tuple[np.ndarray, np.ndarray, np.ndarray]]:
    """Yield rays (r,), triangles (c,) and t (r, c) so that every possible hit is in one of them."""
    fan = _Fan(origin, triangles)
    for group in _bundles(directions):
        some = fan.reached_by(directions[group])
        step = max(1, _BLOCK // max(1, len(some)))
        for start in range(0, len(group), step):
            rays = group[start : start + step]
            yield rays, some, fan.hits(directions[rays], some)


def nearest_hits(
    origin: np.ndarray,
    directions: np.ndarray,
    triangles: np.ndarray,
    *,
    t_min: np.ndarray | float = 0.0,
    ignored: Callable[[np.ndarray, np.ndarray], np.ndarray] | None = None,
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return what rays meet first.

    Parameters
    ----------
    origin : (3,) or (R, 3) float
        One point for all rays, or one each (slower).
    directions : (R, 3) float
        Of any length > 0; t counts in it.
    triangles : (T, 3, 3) float
        Corners; either side is hit, triangles without area never.
    t_min : float or (R,) float
        Hits before it do not count.
    ignored : callable, optional
        ``ignored(rays (r,), triangles (c,)) -> (r, c) bool``: pairs that do not count.

    Returns
    -------
    t : (R,) float64, inf where nothing is met
    triangle : (R,) int64, -1 where nothing is met; the first of several at the same t
    second_t : (R,) float64
        Of the next hit; the same t again where two triangles are met at once.
    """
    directions = np.asarray(directions, dtype=float)
    origin = np.asarray(origin, dtype=float)
    n = len(directions)
    t, second = np.full(n, math.inf), np.full(n, math.inf)
    triangle = np.full(n, -1)
    if len(triangles) == 0:
        return t, triangle, second
    if origin.ndim == 2:
        own = np.broadcast_to(np.asarray(t_min, dtype=float), (n,))
        for r in range(n):
            skip = None if ignored is None else (lambda _, c, r=r: ignored(np.array([r]), c))
            t[r], triangle[r], second[r] = (
                result[0]
                for result in nearest_hits(
                    origin[r], directions[r : r + 1], triangles, t_min=own[r], ignored=skip
                )
            )
        return t, triangle, second
    t_min = np.broadcast_to(np.asarray(t_min, dtype=float), (n,))
    for rays, some, hit in _blocks(origin, directions, triangles):
        if len(some) == 0:
            continue
        hit[hit < t_min[rays, None]] = math.inf
        if ignored is not None:
            hit[ignored(rays, some)] = math.inf
        first = hit.argmin(axis=1)
        rows = np.arange(len(rays))
        t[rays] = hit[rows, first]
        triangle[rays] = np.where(np.isfinite(t[rays]), some[first], -1)
        hit[rows, first] = math.inf
        second[rays] = hit.min(axis=1)
    return t, triangle, second


def is_hidden(
    origin: np.ndarray,
    points: np.ndarray,
    own: np.ndarray,
    triangles: np.ndarray,
    *,
    t_min: np.ndarray | float = 0.0,
    ignored: Callable[[np.ndarray, np.ndarray], np.ndarray] | None = None,
    tolerance: float = 1e-9,
) -> np.ndarray:
    """Return (R,) bool: something other than triangle ``own`` (R,) lies before each point.

    ``tolerance`` is the share of the way, before the point, in which nothing hides it.
    """

    def skipped(rays: np.ndarray, some: np.ndarray) -> np.ndarray:
        mine = some[None, :] == own[rays, None]
        return mine if ignored is None else mine | ignored(rays, some)

    t, _, _ = nearest_hits(origin, points - origin, triangles, t_min=t_min, ignored=skipped)
    return t < 1 - tolerance


# --- pictures


def pixel_directions(
    camera_to_world: np.ndarray, tan_half: tuple[float, float], resolution: tuple[int, int]
) -> np.ndarray:
    """Return (H, W, 3) rays through the pixel centres, as long as one unit of depth."""
    width, height = resolution
    x = (2 * (np.arange(width) + 0.5) / width - 1) * tan_half[0]
    y = (1 - 2 * (np.arange(height) + 0.5) / height) * tan_half[1]
    right, up, back = np.asarray(camera_to_world, dtype=float)[:3, :3].T
    return x[None, :, None] * right + y[:, None, None] * up - back


def id_image(
    camera_to_world: np.ndarray,
    tan_half: tuple[float, float],
    resolution: tuple[int, int],
    triangles: np.ndarray,
    *,
    n_faces: int | None = None,
    clip_near: float = 0.0,
    clip_far: float = math.inf,
    ignored: Callable[[np.ndarray, np.ndarray], np.ndarray] | None = None,
) -> IdImage:
    """Return what each pixel's centre sees: both sides of every triangle count.

    Triangles from ``n_faces`` on are obstacles: they hide, are in ``depth``, and have ID 0.
    """
    pose = np.asarray(camera_to_world, dtype=float)
    rays = pixel_directions(pose, tan_half, resolution).reshape(-1, 3)
    t, face, second = nearest_hits(pose[:3, 3], rays, triangles, t_min=clip_near, ignored=ignored)
    beyond = t > clip_far
    t[beyond], face[beyond] = math.inf, -1
    with np.errstate(invalid="ignore"):
        gap = np.where(np.isfinite(second), second - t, math.inf)
    if n_faces is not None:
        face[face >= n_faces] = -1
    shape = resolution[::-1]
    return IdImage(
        (face + 1).astype(np.uint32).reshape(shape),
        t.reshape(shape),
        gap.reshape(shape),
        pose,
        tan_half,
        np.asarray(triangles, dtype=float),
    )


def disagreement(
    truth: IdImage,
    ids: np.ndarray,
    *,
    edge_px: float = 1 / 64,
    depth_slack: float = 1e-4,
    n_faces: int | None = None,
) -> tuple[np.ndarray, np.ndarray]:
    """Sort the pixels where a picture's ``ids`` (H, W) differ from the truth.

    A difference is excused where some ray at most ``edge_px`` pixels beside the pixel's centre
    meets the claimed face, and nothing before it by more than the share ``depth_slack`` of its
    depth. So an edge may be off by that much, but no gap may open along an edge that two faces
    share. ``n_faces`` as in ``id_image``.

    Returns
    -------
    excused, wrong : (H, W) bool
        To be counted by the test, so that the allowance cannot grow unnoticed.
    """
    differs = np.asarray(ids) != truth.ids
    rows, columns = np.nonzero(differs)
    height, width = differs.shape
    pixel = 2 * np.array(truth.tan_half) / (width, height)
    right, up = truth.camera_to_world[:3, :2].T * pixel[:, None]
    centres = pixel_directions(truth.camera_to_world, truth.tan_half, (width, height))
    beside = _disc(65) * edge_px
    rays = centres[rows, columns][:, None] + beside[:, :1] * right + beside[:, 1:] * up
    rays = rays.reshape(-1, 3)
    claims = np.repeat(np.asarray(ids)[rows, columns].astype(np.int64) - 1, len(beside))
    origin = truth.camera_to_world[:3, 3]
    t, face, _ = nearest_hits(origin, rays, truth.triangles)
    if n_faces is not None:
        face[face >= n_faces] = -1
    possible = face == claims
    # not the nearest, but as near as makes no difference
    fan = _Fan(origin, truth.triangles)
    for claim in np.unique(claims[claims >= 0]):
        some = np.flatnonzero(claims == claim)
        claimed_t = fan.hits(rays[some], np.array([claim]))[:, 0]
        possible[some] |= np.isfinite(claimed_t) & (claimed_t * (1 - depth_slack) <= t[some])
    excused = np.zeros_like(differs)
    excused[rows, columns] = possible.reshape(-1, len(beside)).any(axis=1)
    return excused, differs & ~excused


def _disc(n: int) -> np.ndarray:
    """Return n points (n, 2) spread evenly over the unit disc, the first at its centre."""
    k = np.arange(n)
    radius, angle = np.sqrt(k / (n - 1)), k * math.pi * (3 - math.sqrt(5))
    return np.stack([radius * np.cos(angle), radius * np.sin(angle)], axis=1)


# --- visibility maps, the paper's Sec. 2.1 and method of this project


def centroid_visible(
    camera_to_world: np.ndarray,
    eye: Eye,
    triangles: np.ndarray,
    obstacles: np.ndarray | None = None,
    rules: Rules = Rules(),
) -> np.ndarray:
    """Return (F,) bool: the paper's criterion, one ray to the centroid of each face.

    ``triangles`` (F, 3, 3) is the model, ``obstacles`` (O, 3, 3) hides and is never counted.
    """
    view = _View(camera_to_world, eye, triangles, obstacles, rules)
    centroids = view.corners.mean(axis=1)
    if rules.semantics == "paper":
        kept = view.any_vertex_in_field & ~view.removed & view.all_vertices_far_enough
    else:
        kept = view.accepted_points(centroids, np.arange(len(centroids)))
    faces = np.flatnonzero(kept & view.has_area)
    visible = np.zeros(len(centroids), dtype=bool)
    visible[faces] = ~view.hidden(centroids[faces], faces)
    return visible


def point_visibility(
    camera_to_world: np.ndarray,
    eye: Eye,
    triangles: np.ndarray,
    obstacles: np.ndarray | None = None,
    rules: Rules = Rules(),
    *,
    n: int = 8,
) -> np.ndarray:
    """Return (F,) float: the share of n * n points of each face that the sensor sees.

    The points are the centroids of the n * n congruent parts of the face; every filter is
    applied to each of them.
    """
    view = _View(camera_to_world, eye, triangles, obstacles, rules)
    weights = part_centroids(n)
    points = np.einsum("pk,fkx->fpx", weights, view.corners).reshape(-1, 3)
    own = np.repeat(np.arange(len(view.corners)), len(weights))
    rays = np.flatnonzero(view.accepted_points(points, own) & view.has_area[own])
    seen = np.zeros(len(points))
    seen[rays] = ~view.hidden(points[rays], own[rays])
    return seen.reshape(-1, len(weights)).mean(axis=1)


def pixel_visible(
    camera_to_world: np.ndarray,
    eye: Eye,
    resolution: tuple[int, int],
    triangles: np.ndarray,
    obstacles: np.ndarray | None = None,
    rules: Rules = Rules(),
) -> np.ndarray:
    """Return (F,) int: pixels in which each face is seen, by rays through pixel centres."""
    view = _View(camera_to_world, eye, triangles, obstacles, rules)
    rays = pixel_directions(view.pose, eye.tan_half, resolution).reshape(-1, 3)
    ignored = None
    if rules.occlusion == "paper":

        def ignored(some_rays: np.ndarray, some: np.ndarray) -> np.ndarray:
            return view.refused_pairs(rays[some_rays], some)

    t, face, _ = nearest_hits(
        view.origin, rays, view.hiding, t_min=rules.clip_near, ignored=ignored
    )
    pixels = np.flatnonzero((face >= 0) & (face < len(view.corners)))
    points = view.origin + t[pixels, None] * rays[pixels]
    counted = view.accepted_points(points, face[pixels], in_field=True)
    return np.bincount(face[pixels[counted]], minlength=len(view.corners))


def part_centroids(n: int) -> np.ndarray:
    """Return barycentric weights (n * n, 3) of the centroids of a triangle's n * n parts."""
    upright = [(i, j) for i in range(n) for j in range(n - i)]
    inverted = [(i, j) for i in range(n) for j in range(n - 1 - i)]
    a, b = np.array(
        [(3 * i + 1, 3 * j + 1) for i, j in upright] + [(3 * i + 2, 3 * j + 2) for i, j in inverted]
    ).T / (3 * n)
    return np.stack([1 - a - b, a, b], axis=1)


class _View:
    """One sensor before one model: the filters of Sec. 2.1.1."""

    def __init__(self, camera_to_world, eye, triangles, obstacles, rules) -> None:
        self.pose = np.asarray(camera_to_world, dtype=float)
        self.eye, self.rules = eye, rules
        self.origin, self.axis = self.pose[:3, 3], -self.pose[:3, 2]
        self.corners = np.asarray(triangles, dtype=float)
        others = np.zeros((0, 3, 3)) if obstacles is None else np.asarray(obstacles, dtype=float)
        self.hiding = np.concatenate([self.corners, others])
        cross = np.cross(
            self.corners[:, 1] - self.corners[:, 0], self.corners[:, 2] - self.corners[:, 0]
        )
        double_area = np.linalg.norm(cross, axis=1)
        self.has_area = double_area > 0
        self.normals = cross / np.where(self.has_area, double_area, 1)[:, None]
        self.cos_incidence = math.cos(math.radians(eye.max_incidence_deg))

    def in_camera(self, points: np.ndarray) -> np.ndarray:
        """Return x, y and depth (..., 3) in the camera frame."""
        return (points - self.origin) @ self.pose[:3, :3] * [1, 1, -1]

    def in_field(self, points: np.ndarray) -> np.ndarray:
        """CropFOV: inside the side planes and not beyond maxD."""
        x, y, depth = np.moveaxis(self.in_camera(points), -1, 0)
        tan_x, tan_y = self.eye.tan_half
        return (
            (depth > 0)
            & (np.abs(x) <= tan_x * depth)
            & (np.abs(y) <= tan_y * depth)
            & (depth <= self.eye.max_distance)
        )

    def accepted_points(
        self, points: np.ndarray, own: np.ndarray, *, in_field: bool = False
    ) -> np.ndarray:
        """Return (R,) bool: points of faces ``own`` pass every filter but the ray test."""
        depth = (points - self.origin) @ self.axis
        if in_field:  # the point of a pixel's ray is inside the side planes by construction
            inside = (depth > 0) & (depth <= self.eye.max_distance)
        else:
            inside = self.in_field(points)
        return (
            inside
            & (depth >= self.eye.min_distance)  # CropNear
            & ~self._refused(points - self.origin, self.normals[own])
        )

    def _refused(self, rays: np.ndarray, normals: np.ndarray) -> np.ndarray:
        """CropBack by the true ray and CropNorm, for rays (R, 3) on faces of normals (R, 3)."""
        towards = -np.sum(rays * normals, axis=-1)
        if self.rules.incidence == "axis":
            oblique = -(normals @ self.axis) < self.cos_incidence
        else:
            oblique = towards < self.cos_incidence * np.linalg.norm(rays, axis=-1)
        return (towards <= 0) | oblique

    def refused_pairs(self, rays: np.ndarray, some: np.ndarray) -> np.ndarray:
        """Return (r, c) bool: what occlusion = "paper" takes away before the ray test."""
        n = len(self.corners)
        pairs = np.zeros((len(rays), len(some)), dtype=bool)
        mine = np.flatnonzero(some < n)  # obstacles always hide
        faces = some[mine]
        if self.rules.semantics == "paper":
            pairs[:, mine] = self.removed[faces]
        else:
            pairs[:, mine] = self._refused(rays[:, None, :], self.normals[faces][None, :, :])
        return pairs

    def hidden(self, points: np.ndarray, own: np.ndarray) -> np.ndarray:
        """Return (R,) bool: the ray test."""
        ignored = None
        if self.rules.occlusion == "paper":

            def ignored(rays: np.ndarray, some: np.ndarray) -> np.ndarray:
                return self.refused_pairs(points[rays] - self.origin, some)

        depth = np.maximum((points - self.origin) @ self.axis, 1e-300)
        return is_hidden(
            self.origin,
            points,
            own,
            self.hiding,
            t_min=self.rules.clip_near / depth,
            ignored=ignored,
        )

    # The paper's own face-by-face filters.

    @property
    def any_vertex_in_field(self) -> np.ndarray:
        """CropFOV of the paper, (F,) bool."""
        return self.in_field(self.corners).any(axis=1)

    @property
    def all_vertices_far_enough(self) -> np.ndarray:
        """CropNear of the paper, (F,) bool."""
        return (self.in_camera(self.corners)[..., 2] >= self.eye.min_distance).all(axis=1)

    @property
    def removed(self) -> np.ndarray:
        """CropBack with its tolerance and CropNorm by the axis, (F,) bool."""
        towards = -(self.normals @ self.axis)
        return (towards < -math.sin(_BACK_TOLERANCE)) | (towards < self.cos_incidence)
