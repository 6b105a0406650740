"""How a layout compares with what could be seen at best: rows for files, the page and people."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from glvis.problem.scene import Model
from glvis.search.placement import Placement
from glvis.search.reach import Reach
from glvis.visibility.folding import fold_counts, folded
from glvis.visibility.visibility_map import VisibilityMap


@dataclass(frozen=True)
class ReachRow:
    """What of one model could be seen, and how much of that a layout sees.

    Attributes
    ----------
    name : str
        Of the model.
    percentage, area_percentage : float
        Of the faces and of the area, that some allowed pose sees.
    seen_of_it, area_seen_of_it : float
        Percentage of that which the layout sees; 100 where there is nothing to see.
    shares_by : tuple of float
        Entry n - 1 is the share of the faces that at least n sensors could see, n = 1 ... S.
    """

    name: str
    percentage: float
    area_percentage: float
    seen_of_it: float
    area_seen_of_it: float
    shares_by: tuple[float, ...]


def reach_rows(
    models: Sequence[Model], maps: Sequence[VisibilityMap], reach: Reach
) -> list[ReachRow]:
    """Return one row a model, in their order, and of several models their mean."""
    rows = []
    for model, found, by in zip(models, maps, reach.sensors, strict=True):
        seen, within = found.counts > 0, by > 0
        area, area_seen = float(model.areas[within].sum()), float(model.areas[seen].sum())
        by_faces = fold_counts(by, model)  # counts and their shares are of the file's faces
        n_seen = folded(found, model).n_unique
        n_within = np.count_nonzero(by_faces)
        rows.append(
            ReachRow(
                model.name,
                100 * n_within / model.file.n_faces,
                100 * area / float(model.areas.sum()),
                100 * n_seen / n_within if n_within else 100.0,
                100 * area_seen / area if area else 100.0,
                tuple(float((by_faces >= n).mean()) for n in range(1, len(found.sensor_names) + 1)),
            )
        )
    return [*rows, _mean(rows)] if len(rows) > 1 else rows


def reach_table(placement: Placement, most: int) -> tuple[list[str], list[list[str | float]]]:
    """Return header and rows for people, with columns up to ``most`` sensors; empty if unknown."""
    if placement.reach is None:
        return [], []
    rows = reach_rows(placement.study.models, placement.maps, placement.reach)
    header = ["model", "reachable %", "of it seen %", "reachable area %", "of it seen %"]
    body: list[list[str | float]] = [
        [
            row.name,
            row.percentage,
            row.seen_of_it,
            row.area_percentage,
            row.area_seen_of_it,
            *(100 * share for share in row.shares_by[1:most]),
        ]
        for row in rows
    ]
    return [*header, *(f"by {n}+ %" for n in range(2, most + 1))], body


def reach_words(reach: Reach) -> str:
    """Return in a sentence what the table stands on."""
    return (
        f"Within reach is what some allowed pose sees, by 2+ what that many sensors could see; "
        f"{reach.positions:,} random positions were tried ({reach.maps_rendered:,} maps besides "
        f"the search's), the later half of them added {100 * reach.growth:.1f} %."
    )


def _mean(rows: Sequence[ReachRow]) -> ReachRow:
    """Return the means over models."""
    names = ("percentage", "area_percentage", "seen_of_it", "area_seen_of_it")
    means = {name: float(np.mean([getattr(row, name) for row in rows])) for name in names}
    shares = np.mean([row.shares_by for row in rows], axis=0)
    return ReachRow("mean", shares_by=tuple(shares.tolist()), **means)
