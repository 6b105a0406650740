"""Maps of the engine held against the judge: poses about any mesh, the ways maps are made, sums.

A way is a criterion, a resolution and whether compute shaders may be used. All ways of a pose are
held against one judgement of it.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field
from itertools import product

import numpy as np

from glvis.problem.camera import look_along
from glvis.problem.sensor import Sensor
from glvis.visibility.selftest import can_cast
from support.figures import Figures, Truth
from support.lens_oracle import judge_of
from support.one_sensor import looking, sensor
from support.shapes import Shape

AROUND, SQUARE, INSIDE, NEAR, BESIDE = "around", "square", "inside", "near", "beside"
PLACES = (AROUND, SQUARE, INSIDE, NEAR, BESIDE)


@dataclass(frozen=True)
class Way:
    """How a map is made: criterion, resolution ("auto" or "sensor"), by compute shaders or not."""

    criterion: str
    resolution: str
    casts: bool

    def __str__(self) -> str:
        return f"{self.criterion} at {self.resolution}, {'cast' if self.casts else 'drawn'}"


@dataclass(frozen=True)
class Limits:
    """What figures may be, in percent and as an intersection over union.

    ``excused_percent`` is the share of faces that rounding may decide: more, and nothing is shown.
    """

    wrong_percent: float = 0.1
    missed_percent: float = 0.5
    iou: float = 0.999
    missed_any_percent: float = 100.0
    excused_percent: float = 1.0

    def share(self, way: Way, figures: Figures) -> float:
        """Return the worst figure of a way as a share of its limit; above 1 it is beyond."""
        shares = [figures.excused_percent / self.excused_percent]
        if way.criterion == "centroid":
            shares.append((1 - figures.iou) / (1 - self.iou))
        else:
            shares.append(figures.wrong_percent / self.wrong_percent)
            shares.append(figures.missed_percent / self.missed_percent)
            if way.resolution == "auto":
                shares.append(figures.missed_any_percent / self.missed_any_percent)
        return max(shares)


@dataclass
class Verdicts:
    """Figures of one mesh by way, pose for pose (N long), what each pose is, and the limits."""

    name: str
    n_faces: int
    by_pose: dict[Way, list[Figures]] = field(default_factory=dict)
    poses: list[str] = field(default_factory=list)
    limits: Limits = field(default_factory=Limits)

    @property
    def badness(self) -> float:
        """How far the worst figure of all ways is beyond its limit, above 1: beyond."""
        return max(self.limits.share(way, self.total(way)) for way in self.by_pose)

    def total(self, way: Way) -> Figures:
        """Return the figures of a way over all poses."""
        total = Figures()
        for one in self.by_pose[way]:
            total += one
        return total

    def broken(self) -> list[str]:
        """Return a line for each way beyond the limits, with its worst pose."""
        lines = []
        for way, figures in self.by_pose.items():
            total = self.total(way)
            if self.limits.share(way, total) <= 1:
                continue
            if way.criterion == "centroid":
                faults = [one.either - one.both for one in figures]
            elif self.limits.missed_any_percent < 100:
                faults = [one.wrong + one.missed_any for one in figures]
            else:
                faults = [one.wrong + one.missed for one in figures]
            worst = int(np.argmax(faults))
            lines.append(
                f"{self.name}, {way}: {described(way, total)}; worst {self.poses[worst]}: "
                f"{described(way, figures[worst])}"
            )
        return lines

    def __iadd__(self, other: Verdicts) -> Verdicts:
        for way, figures in other.by_pose.items():
            self.by_pose.setdefault(way, []).extend(figures)
        self.poses += other.poses
        return self


def described(way: Way, figures: Figures) -> str:
    """Return the figures of a way in words."""
    if way.criterion == "centroid":
        return f"IoU {figures.iou:.4f} of {figures.either} faces, {figures.excused} excused"
    return (
        f"{figures.wrong_percent:.3f} % of {figures.seen} wrongly seen, "
        f"{figures.missed_percent:.3f} % of {figures.half} half visible missed, "
        f"{figures.missed_any_percent:.3f} % of {figures.any} that show at all, "
        f"{figures.excused} excused"
    )


def ways(
    criteria: Iterable[str] = ("pixels", "centroid"),
    resolutions: Iterable[str] = ("auto", "sensor"),
) -> list[Way]:
    """Return the ways that this machine's OpenGL has."""
    return [Way(*one) for one in product(criteria, resolutions, [False, True][: 1 + can_cast()])]


def corners_of(shape: Shape) -> np.ndarray:
    """Return the triangles' corners, (F, 3, 3) float64."""
    vertices, faces = shape
    return np.asarray(vertices, dtype=float)[faces]


def device_for(shape: Shape, *, limit_deg: float = 80.0, near: float = 0.0) -> Sensor:
    """Return a pinhole of 60 x 45 degrees that reaches three times as far as the mesh is large.

    ``near`` is its least distance as a share of the mesh's size.
    """
    size = size_of(corners_of(shape))[1]
    return sensor(
        hfov_deg=60,
        vfov_deg=45,
        resolution=(320, 240),
        near=near * size,
        far=3 * size,
        max_incidence_deg=limit_deg,
    )


def size_of(corners: np.ndarray) -> tuple[np.ndarray, float]:
    """Return the middle (3,) of the box around triangles and the length of its diagonal."""
    low, high = corners.min(axis=(0, 1)), corners.max(axis=(0, 1))
    return (low + high) / 2, float(np.linalg.norm(high - low))


def rounded(corners: np.ndarray | None, middle: np.ndarray) -> np.ndarray | None:
    """Return triangles (F, 3, 3), if any, as float32 numbers relative to a point (3,) hold them.

    What coincides there coincides in float64 again.
    """
    return None if corners is None else middle + (corners - middle).astype(np.float32)


def poses_about(
    rng: np.random.Generator, corners: np.ndarray, places: Sequence[str] = PLACES
) -> np.ndarray:
    """Return a pose at each of some kinds of places, (N, 4, 4).

    Parameters
    ----------
    corners : (F, 3, 3) float64
        The triangles.
    places : sequence of str
        AROUND at half to one and a half sizes, looks somewhere into the box; SQUARE looks along
        an axis of the world at about the middle; INSIDE anywhere in the box, looks anywhere; NEAR a
        hundredth to a tenth of the size from a face, more often before it than behind, looks at
        it; BESIDE a thirtieth from a face, looks along it.
    """
    middle, size = size_of(corners)
    half = np.ptp(corners, axis=(0, 1)) / 2
    normal = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    area = np.linalg.norm(normal, axis=1)
    made = []
    for place in places:
        aside = rng.normal(size=3)
        if place == AROUND:
            position = middle + size * rng.uniform(0.5, 1.5) * aside / np.linalg.norm(aside)
            direction = middle + half * rng.uniform(-0.7, 0.7, size=3) - position
        elif place == SQUARE:
            axis = int(rng.integers(3))
            direction = np.eye(3)[axis] * rng.choice([-1, 1])
            # a bit aside: in the very plane of a face nobody can say which side is seen
            position = middle - size * (direction + rng.uniform(-0.05, 0.05, size=3))
        elif place == INSIDE:
            position = middle + half * rng.uniform(-0.9, 0.9, size=3)
            direction = aside
        else:
            face = rng.choice(len(corners), p=area / area.sum())
            weights = rng.dirichlet(np.ones(3))
            away = normal[face] / area[face] * rng.choice([-1, 1, 1])
            far = 10 ** rng.uniform(-2, -1) if place == NEAR else 1 / 30
            position = weights @ corners[face] + far * size * away
            along = np.cross(away, aside)
            along /= np.linalg.norm(along)
            direction = along - 0.1 * away if place == BESIDE else 0.6 * along - away
        made.append(look_along(position, direction, float(rng.uniform(-np.pi, np.pi))))
    return np.array(made).reshape(-1, 4, 4)


def judged(
    name: str,
    shape: Shape,
    poses: np.ndarray,
    device: Sensor,
    obstacles: Sequence[Shape] = (),
    *,
    those: Iterable[Way] | None = None,
    words: Sequence[str] = (),
    at_most: int = 120,
    in_single: bool = False,
) -> Verdicts:
    """Return the figures of all maps of a mesh from N poses.

    Parameters
    ----------
    poses : (N, 4, 4) float64
        Camera to world.
    obstacles : sequence of Shape
        What only hides.
    those : iterable of Way, optional
        Not all.
    words : sequence of str
        What each pose is, for people.
    at_most : int
        As of ``Truth.of_pixels``.
    in_single : bool
        Whether rays meet the mesh as float32 numbers hold it: for gaps that those close.
    """
    corners = corners_of(shape)
    hiding = np.concatenate([corners_of(one) for one in obstacles]) if obstacles else None
    those = ways() if those is None else list(those)
    maps = {way: _maps(way, shape, poses, device, obstacles, corners) for way in those}
    if in_single:
        middle, _ = size_of(corners)
        corners, hiding = rounded(corners, middle), rounded(hiding, middle)
    result = Verdicts(name, len(corners), {way: [] for way in those})
    for i, pose in enumerate(poses):
        truth = Truth(judge_of(pose, device, corners, hiding))
        eye, towards = np.round(pose[:3, 3], 6).tolist(), np.round(-pose[:3, 2], 6).tolist()
        word = words[i] if i < len(words) else ""
        result.poses.append(f"pose {word} at {eye} towards {towards}".replace("  ", " "))
        for way in those:
            if way.criterion == "centroid":
                figures = truth.of_centroids(maps[way][i])
            else:
                pixels = device.resolution if way.resolution == "sensor" else None
                figures = truth.of_pixels(maps[way][i], pixels, at_most=at_most)
            result.by_pose[way].append(figures)
    return result


def _maps(way, shape, poses, device, obstacles, corners) -> np.ndarray:
    """Return the engine's maps, (N, F) bool."""
    options = {"criterion": way.criterion, "resolution": way.resolution}
    origin, _ = size_of(corners)
    with looking(shape, obstacles, origin=origin, casts=way.casts, **options) as made:
        return made.looks(np.asarray(poses), device)


def row(verdicts: Verdicts, columns: Iterable[Way]) -> str:
    """Return a line of a table: wrong / missed by pixels, IoU by centres, way by way."""
    cells = []
    for way in columns:
        by_centre = way.criterion == "centroid"
        if way not in verdicts.by_pose:
            cells.append(f"{'':{6 if by_centre else 15}}")
            continue
        total = verdicts.total(way)
        if by_centre:
            cells.append(f"{total.iou:.4f}")
        else:
            cells.append(f"{total.wrong_percent:6.2f} /{total.missed_percent:7.2f}")
    totals = [verdicts.total(way) for way in verdicts.by_pose]
    excused = max(total.excused_percent for total in totals)
    return (
        f"{verdicts.name:28.28} {verdicts.n_faces:6d} {totals[0].seen:6d} {excused:5.2f} % | "
        + " | ".join(cells)
    )


def head(those: Iterable[Way]) -> str:
    """Return the table's first line."""
    cells = []
    for way in those:
        how = "cast" if way.casts else "draw"
        word = f"{way.resolution[:6]} {how}"
        cells.append(f"{word:>15}" if way.criterion == "pixels" else f"IoU {word[0]}{how[0]}")
    return f"{'mesh':28} {'faces':>6} {'seen':>6} excused | " + " | ".join(cells)


class Table(list[Verdicts]):
    """What a file of tests found; prints itself at the end of pytest's report.

    ``title`` heads it, ``columns`` are its ways.
    """

    def __init__(self, title: str, columns: Iterable[Way]) -> None:
        super().__init__()
        self._title, self._columns = title, list(columns)

    def pytest_terminal_summary(self, terminalreporter, config) -> None:
        if not self:
            return
        rows = sorted(self, key=lambda one: one.badness, reverse=True)
        shown = rows if config.getoption("--all-meshes") else rows[:8]
        terminalreporter.section(f"{self._title}: {len(shown)} of {len(rows)}, worst first")
        terminalreporter.write_line(head(self._columns))
        for one in shown:
            terminalreporter.write_line(row(one, self._columns))
