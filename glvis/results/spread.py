"""How much the runs of a series differ: values, coverage, and how far their poses lie apart."""

from __future__ import annotations

import statistics
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import linear_sum_assignment

from glvis.errors import StudyError
from glvis.problem.camera import distance_and_angle
from glvis.problem.sensor import Sensor
from glvis.results.folder import INDEX
from glvis.results.reading import result_index
from glvis.results.vary import Plan, PlannedRun, Point
from glvis.search.estimate import working_distance
from glvis.search.placement import INTERRUPTED

_HALF_TURN = np.diag([-1.0, -1.0, 1.0, 1.0])  # of roll


@dataclass(frozen=True, eq=False)
class Outcome:
    """What one run found, as its ``result.json`` says.

    Attributes
    ----------
    run : PlannedRun
        Which one.
    value : float
        Of the objective.
    percentage, area_percentage : float
        Of the faces and of the area, seen by a sensor; means over models.
    iterations, evaluations, maps_rendered : int
        That it took.
    stop_reason : str
        Why it ended.
    camera_to_world : (S, 4, 4) float64
        Poses.
    """

    run: PlannedRun
    value: float
    percentage: float
    area_percentage: float
    iterations: int
    evaluations: int
    maps_rendered: int
    stop_reason: str
    camera_to_world: NDArray[np.float64]

    @property
    def is_finished(self) -> bool:
        """Whether the search ended by itself."""
        return not self.stop_reason.startswith(INTERRUPTED)


@dataclass(frozen=True)
class Statistic:
    """Of one number over the finished runs of a point.

    Attributes
    ----------
    mean, best, worst : float
        The largest is the best.
    std : float or None
        Standard deviation of the sample (n - 1); None of one run.
    """

    mean: float
    std: float | None
    best: float
    worst: float


@dataclass(frozen=True)
class Apart:
    """How far the sensors of a layout lie from those of another.

    Attributes
    ----------
    mean_position, max_position : float
        Distances, the study's unit.
    mean_angle_deg, max_angle_deg : float
        Angles of the turns, degrees.
    """

    mean_position: float
    max_position: float
    mean_angle_deg: float
    max_angle_deg: float


@dataclass(frozen=True, eq=False)
class Spread:
    """The runs of one point.

    Attributes
    ----------
    point : Point
        What they were run with.
    outcomes : tuple of Outcome
        Those that finished.
    best : Outcome or None
        With the largest value; the first of several.
    value, percentage, area_percentage : Statistic or None
        Of ``outcomes``; None where there are none.
    distances : tuple of Apart
        Of each of ``outcomes`` from the best one.
    apart : Apart or None
        Of all but the best: mean of the means, largest of the largest; None without others.
    """

    point: Point
    outcomes: tuple[Outcome, ...]
    best: Outcome | None
    value: Statistic | None
    percentage: Statistic | None
    area_percentage: Statistic | None
    distances: tuple[Apart, ...]
    apart: Apart | None


def outcome_of(directory: Path, run: PlannedRun) -> Outcome | None:
    """Return what a run has found, or None where it has no result yet.

    Parameters
    ----------
    directory : Path
        Folder of the series.
    run : PlannedRun
        One of its runs.

    Raises
    ------
    StudyError
        If its result cannot be read.
    """
    path = directory / run.name / INDEX
    if not path.exists():
        return None
    index = result_index(path)
    search = index.search
    if len(index.poses) != len(run.point.sensors):
        raise StudyError(f"{path}: is no result of this run: it has other sensors")
    return Outcome(
        run=run,
        value=index.objective.value,
        percentage=index.mean.percentage,
        area_percentage=index.mean.area_percentage,
        iterations=search.iterations,
        evaluations=search.evaluations,
        maps_rendered=search.maps_rendered,
        stop_reason=search.stop_reason,
        camera_to_world=np.array([pose.camera_to_world for pose in index.poses], float),
    )


def outcomes_of(directory: Path, plan: Plan) -> list[Outcome]:
    """Return what the runs of a series have found so far, in their order."""
    found = (outcome_of(directory, run) for run in plan.runs)
    return [outcome for outcome in found if outcome]


def spread(point: Point, outcomes: Sequence[Outcome]) -> Spread:
    """Return how much the finished runs of a point differ.

    Parameters
    ----------
    point : Point
        Which one.
    outcomes : sequence of Outcome
        Of all points.
    """
    own = tuple(one for one in outcomes if one.run.point == point and one.is_finished)
    if not own:
        return Spread(point, (), None, None, None, None, (), None)
    best = max(own, key=lambda one: one.value)
    distances = tuple(apart(one, best) for one in own)
    others = [far for one, far in zip(own, distances, strict=True) if one is not best]
    return Spread(
        point,
        own,
        best,
        _statistic([one.value for one in own]),
        _statistic([one.percentage for one in own]),
        _statistic([one.area_percentage for one in own]),
        distances,
        _over_all(others) if others else None,
    )


def apart(one: Outcome, other: Outcome) -> Apart:
    """Return how far two layouts of the same sensors lie apart.

    Sensors of one kind may have changed places: they are paired so that, all in all, they differ
    least. Half a turn of roll brings a sensor's rectangle back and counts as none.
    """
    sensors = one.run.point.sensors
    distance, angle = _differences(one.camera_to_world, other.camera_to_world)
    pairs = _paired(distance, angle, sensors)
    far, turn = distance[pairs], np.degrees(angle[pairs])
    return Apart(float(far.mean()), float(far.max()), float(turn.mean()), float(turn.max()))


def _differences(
    a: NDArray[np.float64], b: NDArray[np.float64]
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return distances and angles (S, S), radians, of all sensors of one layout to all of another.

    A pixel grid that is turned by half a turn about its axis sees the same.
    """
    distance, angle = distance_and_angle(a[:, None], b[None])
    _, turned = distance_and_angle(a[:, None], b[None] @ _HALF_TURN)
    return distance, np.minimum(angle, turned)


def _paired(
    distance: NDArray[np.float64], angle: NDArray[np.float64], sensors: Sequence[Sensor]
) -> tuple[NDArray[np.intp], NDArray[np.intp]]:
    """Return which sensor is which: rows (S,) and columns (S,), kinds kept.

    A turn counts by how far it moves the middle of the working range.
    """
    reach = np.array([working_distance(sensor) for sensor in sensors])
    cost = distance + reach[:, None] * angle
    kinds = np.array([sensor.name for sensor in sensors])
    rows, columns = [], []
    for kind in dict.fromkeys(kinds.tolist()):
        own = np.flatnonzero(kinds == kind)
        first, second = linear_sum_assignment(cost[np.ix_(own, own)])
        rows.append(own[first])
        columns.append(own[second])
    return np.concatenate(rows), np.concatenate(columns)


def _over_all(found: Sequence[Apart]) -> Apart:
    """Return mean of means and largest of largest."""
    return Apart(
        float(np.mean([one.mean_position for one in found])),
        max(one.max_position for one in found),
        float(np.mean([one.mean_angle_deg for one in found])),
        max(one.max_angle_deg for one in found),
    )


def _statistic(numbers: Sequence[float]) -> Statistic:
    std = statistics.stdev(numbers) if len(numbers) > 1 else None
    return Statistic(statistics.fmean(numbers), std, max(numbers), min(numbers))
