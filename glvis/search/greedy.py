"""Greedy placement and exchange: many random poses of one group of sensors at a time.

The pose with the largest gain is placed first, then each pose is exchanged for better ones beside
the others. A pose is rendered once and valued in the company of many others: where groups are
separable, choosing again costs no maps.

References
----------
Nemhauser, Wolsey, Fisher, "An Analysis of Approximations for Maximizing Submodular Set
Functions", Mathematical Programming 14, 1978: greedy choice. Teitz, Bart, "Heuristic Methods for
Estimating the Generalized Vertex Median of a Weighted Graph", Operations Research 16, 1968:
exchange.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from glvis.search.script import Floats, Problem, Script

METHOD = "greedy"
_AT_ONCE = 256  # layouts asked for at once


@dataclass(frozen=True, eq=False)
class SensorGroup:
    """A group of sensors that the same variables move, such as a mount and its mirror image.

    Attributes
    ----------
    columns : (d,) int
        Columns of these variables in a position (D,).
    sensors : tuple of int
        Sensors that they move.
    is_separable : bool
        Whether they move no other sensors.
    kind : object
        Groups of one kind stand in the same places for the same values of their variables.
    """

    columns: NDArray[np.intp]
    sensors: tuple[int, ...]
    is_separable: bool
    kind: object


def sensor_groups(problem: Problem) -> list[SensorGroup]:
    """Return the groups of sensors that have variables, in the order of their sensors."""
    sensors_of: dict[frozenset[int], list[int]] = {}
    for sensor, moving in enumerate(problem.moved_by):
        if moving:
            sensors_of.setdefault(moving, []).append(sensor)
    groups = []
    for moving, sensors in sensors_of.items():
        columns = np.array(sorted(moving))
        is_separable = not any(moving & other for other in sensors_of if other != moving)
        kind = _kind(problem, columns, sensors) if is_separable else moving
        groups.append(SensorGroup(columns, tuple(sensors), is_separable, kind))
    return groups


def _kind(problem: Problem, columns: NDArray[np.intp], sensors: list[int]) -> object:
    """Return what tells groups apart: their box, and where they stand at one place in it."""
    box = problem.box
    x = box.bounds[:, 0].copy()
    x[columns] += box.range[columns] * np.linspace(0.1, 0.8, len(columns))  # nothing special
    poses = problem.pose_keys(x)
    bounds, periodic = box.bounds[columns], box.periodic[columns]
    return bounds.tobytes(), periodic.tobytes(), tuple(poses[s] for s in sensors)


def place_greedily(problem: Problem, maps: int, starts: int = 1) -> Script:
    """Return layouts, best first: positions (K, D) and their values (K,), K <= ``starts``.

    Parameters
    ----------
    problem : Problem
        What is searched.
    maps : int
        To spend, about.
    starts : int
        Layouts to make; each but the first begins with another of the good first choices.
    """
    groups = sensor_groups(problem)
    draws = _draw_by_kind(problem, groups, maps)
    found: dict[bytes, tuple[float, Floats]] = {}
    for number in range(starts):
        x = yield from _place_one_by_one(problem, groups, draws, is_best_first=number == 0)
        value, x = yield from exchange(problem, groups, draws, x)
        found[x.tobytes()] = (value, x)
        if not all(group.is_separable for group in groups):
            break  # another start would cost as many maps again
    best = sorted(found.values(), key=lambda entry: -entry[0])
    return np.stack([x for _, x in best]), np.array([value for value, _ in best])


def _draw_by_kind(problem: Problem, groups: list[SensorGroup], maps: int) -> dict[object, Floats]:
    """Return random values (N, d) of the variables of each kind of group."""
    first_of = {group.kind: group for group in reversed(groups)}
    pose_maps = problem.models * sum(len(group.sensors) for group in first_of.values())
    kept = problem.most_poses // (2 * sum(len(group.sensors) for group in first_of.values()))
    n = max(problem.options.draws_least, min(maps // pose_maps, kept))
    return {group.kind: draw(problem, group, n) for group in first_of.values()}


def draw(problem: Problem, group: SensorGroup, n: int) -> Floats:
    """Return random values (n, d) of a group's variables, each the best predicted of many."""
    options, among = problem.options, problem.options.draw_predicted
    drawn = problem.box.uniform(n * among, problem.rng, options.reach)[:, group.columns]
    x = np.repeat(problem.start[None], len(drawn), axis=0)
    x[:, group.columns] = drawn
    best = problem.surrogate(x, group.sensors).reshape(n, among).argmax(axis=1)
    return drawn.reshape(n, among, -1)[np.arange(n), best]


def _place_one_by_one(
    problem: Problem,
    groups: list[SensorGroup],
    draws: dict[object, Floats],
    *,
    is_best_first: bool,
) -> Script:
    """Return a layout (D,): each group where it gains most beside those placed before."""
    x = problem.start.copy()
    placed = {sensor for sensor, moving in enumerate(problem.moved_by) if not moving}
    known: set[int] = set()  # variables that are decided
    rendered = set() if is_best_first else {group.kind for group in groups if group.is_separable}
    waiting = list(groups)
    while waiting:
        is_first = len(waiting) == len(groups)
        best_value, best_group, best_x = -np.inf, waiting[0], x
        for group in _next_groups(waiting):
            free = [k for k, column in enumerate(group.columns) if column not in known]
            layouts = np.repeat(x[None], len(draws[group.kind]), axis=0)
            layouts[:, group.columns[free]] = draws[group.kind][:, free]
            active = tuple(sorted({*placed, *group.sensors}))
            moved = () if group.kind in rendered else group.sensors
            values = yield from _evaluate(problem, layouts, moved, active)
            if group.is_separable:
                rendered.add(group.kind)
            choice = int(values.argmax())
            if is_first and not is_best_first:
                kept = max(1, int(problem.options.first_share * len(values)))
                good = np.argsort(-values, kind="stable")[:kept]
                choice = int(problem.rng.choice(good))
            if values[choice] > best_value:
                best_value, best_group, best_x = values[choice], group, layouts[choice]
        x = best_x.copy()
        waiting.remove(best_group)
        placed |= {*best_group.sensors}
        known |= {*best_group.columns.tolist()}
    return x


def _next_groups(waiting: list[SensorGroup]) -> list[SensorGroup]:
    """Return who may be placed next: one of each kind, and one of those that share variables."""
    chosen: dict[object, SensorGroup] = {}
    for group in waiting:
        chosen.setdefault(group.kind if group.is_separable else "shares", group)
    return list(chosen.values())


def exchange(
    problem: Problem, groups: list[SensorGroup], draws: dict[object, Floats], x: Floats
) -> Script:
    """Return value and layout after exchanging poses of separable groups, one at a time.

    ``draws`` are the values (N, d) to choose from by kind of group, all rendered already. Rounds
    go on until none is better (Teitz and Bart 1968).
    """
    options = problem.options
    (value,) = yield from _evaluate(problem, x[None], (), None)
    separable = [group for group in groups if group.is_separable]
    promising = {group.sensors: draws[group.kind] for group in separable}
    for round_ in range(options.exchange_rounds if len(groups) > 1 else 0):
        before = value
        for group in separable:
            poses = promising[group.sensors]
            layouts = np.repeat(x[None], len(poses), axis=0)
            layouts[:, group.columns] = poses
            values = yield from _evaluate(problem, layouts, (), None)
            if round_ == 0:  # what is poor beside these others will not be best beside the next
                kept = max(options.draws_least, math.ceil(options.exchange_share * len(values)))
                best = np.argsort(-values, kind="stable")[:kept]
                promising[group.sensors] = poses[best]
            if values.max() > value:
                value, x = values.max(), layouts[values.argmax()]
        if value == before:
            break
    return value, x


def _evaluate(
    problem: Problem, layouts: Floats, moved: tuple[int, ...], sensors: tuple[int, ...] | None
) -> Script:
    """Return the values (P,) of layouts (P, D) in which ``moved`` stand somewhere new."""
    values = []
    for first in range(0, len(layouts), _AT_ONCE):
        part = layouts[first : first + _AT_ONCE]
        values.append((yield problem.ask(part, moved, METHOD, sensors)))
    return np.concatenate(values)


def search_greedily(problem: Problem) -> Script:
    """Spend everything on greedy placement and exchange."""
    yield problem.ask(problem.start[None], range(len(problem.moved_by)), METHOD)
    yield from place_greedily(problem, problem.left(), problem.options.greedy_starts)
    return "greedy choice and exchanges found no more"
