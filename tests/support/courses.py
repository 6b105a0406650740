"""Search problems without a scene: functions whose best place is known, with maps counted."""

from __future__ import annotations

import math

import numpy as np
from methods import METHODS as FOR_COMPARISON

from glvis.search.box import Box
from glvis.search.methods import SCRIPTS
from glvis.search.script import Problem

ALL_METHODS = SCRIPTS | FOR_COMPARISON

PAIR = ((0, 1), (2, 3))  # two mounts of two variables each
SHARED = ((0, 1), (0, 1), (0, 2), (0, 2))  # two mirrored mounts at one height


def problem(moved_by, *, max_maps=1500, seed=1, start=0.1, models=1, most_poses=10_000):
    """Return a problem in the unit cube; ``moved_by`` lists the columns of each sensor."""
    moved_by = tuple(frozenset(columns) for columns in moved_by)
    d = 1 + max(column for columns in moved_by for column in columns)
    return Problem(
        box=Box(np.tile([0.0, 1.0], (d, 1))),
        start=np.full(d, start),
        moved_by=moved_by,
        models=models,
        max_maps=max_maps,
        most_poses=most_poses,
        pose_keys=lambda x: [x[sorted(columns)].tobytes() for columns in moved_by],
        rng=np.random.default_rng(seed),
    )


class Course:
    """Evaluates a function of positions and counts maps as an evaluator would."""

    def __init__(self, search, function, moved_by, models=1):
        self.search, self.function, self.moved_by = search, function, moved_by
        self.models, self.seen, self.asks = models, set(), []

    def run(self, most=math.inf):
        while self.search.stop_reason is None and len(self.asks) < most:
            x = self.search.ask()
            sensors = self.search.sensors
            looking = range(len(self.moved_by)) if sensors is None else sensors
            before, cost = len(self.seen), self.search.cost
            self.seen |= {row[sorted(self.moved_by[s])].tobytes() for row in x for s in looking}
            assert self.models * (len(self.seen) - before) <= cost, self.search.method
            self.asks.append((x, sensors, self.search.method))
            values = np.array([self.function(row, looking) for row in x])
            self.search.tell(values, self.models * len(self.seen))
        return self.search


def bowl(x, looking, at=0.7):
    """Return minus the squared distance from a place; the same for every subset."""
    return -float(np.sum((x - at) ** 2))
