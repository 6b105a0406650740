"""Greedy start: many random poses of one mount at a time, the best gain first, then exchanges.

A pose is rendered once and looked at in the company of many others: where mounts are
independent, choosing again costs no maps.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from glvis.optim.script import Floats, Problem, Script

METHOD = "greedy"
_AT_ONCE = 256  # positions asked for at once
_ROUNDS = 8  # of exchanges at most
_PROMISING = 0.1  # share of the draws that are looked at again
_GOOD = 0.3  # share of the first choices that other starts begin with
_FEWEST = 8  # draws a mount
_STARTS = 4
# Of so many random poses the one with the best guess is rendered; poses are drawn from a range
# so many times as wide as the variables'. See auto.py for what was measured.
_GUESSES, _REACH = 8, 1.5


@dataclass(frozen=True, eq=False)
class Mount:
    """Sensors that the same variables move.

    Attributes
    ----------
    columns : (d,) int
        The variables.
    sensors : tuple of int
        What they move.
    is_alone : bool
        Whether they move nothing else.
    kind : object
        Mounts of one kind stand in the same places for the same values of their variables.
    """

    columns: NDArray[np.intp]
    sensors: tuple[int, ...]
    is_alone: bool
    kind: object


def mounts_of(problem: Problem) -> list[Mount]:
    """Return the mounts that have variables, in the order of their sensors."""
    groups: dict[frozenset[int], list[int]] = {}
    for sensor, moving in enumerate(problem.moved_by):
        if moving:
            groups.setdefault(moving, []).append(sensor)
    mounts = []
    for moving, sensors in groups.items():
        columns = np.array(sorted(moving))
        is_alone = not any(moving & other for other in groups if other != moving)
        kind = _kind(problem, columns, sensors) if is_alone else moving
        mounts.append(Mount(columns, tuple(sensors), is_alone, kind))
    return mounts


def _kind(problem: Problem, columns: NDArray[np.intp], sensors: list[int]) -> object:
    """Return what tells mounts apart: their box, and where they stand at one place in it."""
    box = problem.box
    x = box.bounds[:, 0].copy()
    x[columns] += box.range[columns] * np.linspace(0.1, 0.8, len(columns))  # nothing special
    views = problem.views(x)
    bounds, periodic = box.bounds[columns], box.periodic[columns]
    return bounds.tobytes(), periodic.tobytes(), tuple(views[s] for s in sensors)


def greedy(problem: Problem, maps: int, starts: int = 1) -> Script:
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
    mounts = mounts_of(problem)
    draws = _draws(problem, mounts, maps)
    found: dict[bytes, tuple[float, Floats]] = {}
    for number in range(starts):
        x = yield from _placed_one_by_one(problem, mounts, draws, is_best_first=number == 0)
        value, x = yield from exchanged(problem, mounts, draws, x)
        found[x.tobytes()] = (value, x)
        if not all(mount.is_alone for mount in mounts):
            break  # another start would cost as many maps again
    best = sorted(found.values(), key=lambda entry: -entry[0])
    return np.stack([x for _, x in best]), np.array([value for value, _ in best])


def _draws(problem: Problem, mounts: list[Mount], maps: int) -> dict[object, Floats]:
    """Return random values (N, d) of the variables of each kind of mount."""
    first_of = {mount.kind: mount for mount in reversed(mounts)}
    pose_maps = problem.models * sum(len(mount.sensors) for mount in first_of.values())
    kept = problem.most_poses // (2 * sum(len(mount.sensors) for mount in first_of.values()))
    n = max(_FEWEST, min(maps // pose_maps, kept))
    return {mount.kind: _drawn(problem, mount, n) for mount in first_of.values()}


def _drawn(problem: Problem, mount: Mount, n: int) -> Floats:
    """Return random values (n, d) of a mount's variables, those with the best guesses of many."""
    drawn = problem.box.uniform(n * _GUESSES, problem.rng, _REACH)[:, mount.columns]
    x = np.repeat(problem.start[None], len(drawn), axis=0)
    x[:, mount.columns] = drawn
    best = problem.guess(x, mount.sensors).reshape(n, _GUESSES).argmax(axis=1)
    return drawn.reshape(n, _GUESSES, -1)[np.arange(n), best]


def _placed_one_by_one(
    problem: Problem, mounts: list[Mount], draws: dict[object, Floats], *, is_best_first: bool
) -> Script:
    """Return a layout (D,): each mount where it gains most beside those placed before."""
    x = problem.start.copy()
    looking = {sensor for sensor, moving in enumerate(problem.moved_by) if not moving}
    known: set[int] = set()  # variables that are decided
    rendered = set() if is_best_first else {mount.kind for mount in mounts if mount.is_alone}
    waiting = list(mounts)
    while waiting:
        is_first = len(waiting) == len(mounts)
        best_value, best_mount, best_x = -np.inf, waiting[0], x
        for mount in _candidates(waiting):
            free = [k for k, column in enumerate(mount.columns) if column not in known]
            layouts = np.repeat(x[None], len(draws[mount.kind]), axis=0)
            layouts[:, mount.columns[free]] = draws[mount.kind][:, free]
            group = tuple(sorted({*looking, *mount.sensors}))
            moved = () if mount.kind in rendered else mount.sensors
            values = yield from _values(problem, layouts, moved, group)
            if mount.is_alone:
                rendered.add(mount.kind)
            choice = int(values.argmax())
            if is_first and not is_best_first:
                good = np.argsort(-values, kind="stable")[: max(1, int(_GOOD * len(values)))]
                choice = int(problem.rng.choice(good))
            if values[choice] > best_value:
                best_value, best_mount, best_x = values[choice], mount, layouts[choice]
        x = best_x.copy()
        waiting.remove(best_mount)
        looking |= {*best_mount.sensors}
        known |= {*best_mount.columns.tolist()}
    return x


def _candidates(waiting: list[Mount]) -> list[Mount]:
    """Return who may be placed next: of each kind one, of the mounts that share variables one."""
    chosen: dict[object, Mount] = {}
    for mount in waiting:
        chosen.setdefault(mount.kind if mount.is_alone else "shares", mount)
    return list(chosen.values())


def exchanged(
    problem: Problem, mounts: list[Mount], draws: dict[object, Floats], x: Floats
) -> Script:
    """Return value and layout after choosing each independent mount again, beside the others.

    ``draws`` are the values (N, d) to choose from by kind of mount, all rendered already.
    """
    (value,) = yield from _values(problem, x[None], (), None)
    alone = [mount for mount in mounts if mount.is_alone]
    promising = {mount.sensors: draws[mount.kind] for mount in alone}
    for round_ in range(_ROUNDS if len(mounts) > 1 else 0):
        before = value
        for mount in alone:
            poses = promising[mount.sensors]
            layouts = np.repeat(x[None], len(poses), axis=0)
            layouts[:, mount.columns] = poses
            values = yield from _values(problem, layouts, (), None)
            if round_ == 0:  # what is poor beside these others will not be best beside the next
                kept = max(_FEWEST, math.ceil(_PROMISING * len(values)))
                best = np.argsort(-values, kind="stable")[:kept]
                promising[mount.sensors] = poses[best]
            if values.max() > value:
                value, x = values.max(), layouts[values.argmax()]
        if value == before:
            break
    return value, x


def _values(
    problem: Problem, layouts: Floats, moved: tuple[int, ...], sensors: tuple[int, ...] | None
) -> Script:
    """Return the values (P,) of layouts (P, D) in which ``moved`` stand somewhere new."""
    told = []
    for first in range(0, len(layouts), _AT_ONCE):
        part = layouts[first : first + _AT_ONCE]
        told.append((yield problem.ask(part, moved, METHOD, sensors)))
    return np.concatenate(told)


def greedy_alone(problem: Problem) -> Script:
    """Spend everything on greedy choice."""
    yield problem.ask(problem.start[None], range(len(problem.moved_by)), METHOD)
    yield from greedy(problem, problem.left(), _STARTS)
    return "greedy choice and exchanges found no more"
