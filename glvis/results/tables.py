"""What a placement is worth, as rows: a model, a sensor. Plain numbers, no files, no text."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from glvis.problem.objective import Objective
from glvis.problem.pieces import noun_of_shares
from glvis.problem.scene import Model
from glvis.visibility.folding import folded
from glvis.visibility.visibility_map import VisibilityMap


@dataclass(frozen=True)
class ModelRow:
    """One model: the columns of Table 9, and how often faces are seen.

    Faces are those of the file: one in pieces is seen by each sensor that sees at least half of
    its area. So two sensors that see a third of a wall each do not count, but their areas do.

    Attributes
    ----------
    name : str
        Of the model.
    seen_by_all_cameras : int
        Faces seen, each once for every sensor that sees it: T_tot, Eq. (6).
    unique_seen : int
        Faces that at least one sensor sees.
    total : int
        Faces of the model.
    percentage : float
        Of the faces, that at least one sensor sees.
    area_percentage : float
        Of the area, that at least one sensor sees.
    shares_seen_by : tuple of float
        Entry n - 1 is the share of the faces that at least n sensors see, n = 1 ... S.
    terms : dict of str to float
        Of the objective; see ``Objective.terms``.
    """

    name: str
    seen_by_all_cameras: int
    unique_seen: int
    total: int
    percentage: float
    area_percentage: float
    shares_seen_by: tuple[float, ...]
    terms: dict[str, float]


@dataclass(frozen=True)
class SensorRow:
    """What one sensor gives, over all models.

    Attributes
    ----------
    name : str
        Of the sensor.
    seen : int
        Faces it sees.
    seen_percentage : float
        Of a model's faces, the mean over models.
    only_it : int
        Faces that no other sensor sees: what would be lost without it.
    only_it_percentage : float
        Of a model's faces, the mean over models.
    area_percentage, only_it_area_percentage : float
        Of a model's area, the mean over models.
    """

    name: str
    seen: int
    seen_percentage: float
    only_it: int
    only_it_percentage: float
    area_percentage: float
    only_it_area_percentage: float


def model_rows(
    models: Sequence[Model], maps: Sequence[VisibilityMap], objective: Objective
) -> list[ModelRow]:
    """Return one row a model, in their order."""
    rows = []
    for model, found in zip(models, maps, strict=True):
        is_seen = found.visible.any(axis=0)
        n_sensors, whole = len(found.sensor_names), folded(found, model)
        rows.append(
            ModelRow(
                model.name,
                whole.n_total,
                whole.n_unique,
                model.file.n_faces,
                100 * whole.coverage,
                100 * float(model.areas[is_seen].sum() / model.areas.sum()),
                tuple(whole.share_seen_by(n) for n in range(1, n_sensors + 1)),
                objective.terms(found.counts, model.areas),
            )
        )
    return rows


def mean_row(rows: Sequence[ModelRow]) -> dict[str, float]:
    """Return the means over models of what has a meaningful one, by the names of ``ModelRow``."""
    names = ("seen_by_all_cameras", "unique_seen", "total", "percentage", "area_percentage")
    means = {name: float(np.mean([getattr(row, name) for row in rows])) for name in names}
    return means | {
        f"share_seen_by_{n}": float(np.mean([row.shares_seen_by[n - 1] for row in rows]))
        for n in range(1, len(rows[0].shares_seen_by) + 1)
    }


def mean_terms(rows: Sequence[ModelRow]) -> dict[str, float]:
    """Return the mean over models of each term of the objective."""
    return {name: float(np.mean([row.terms[name] for row in rows])) for name in rows[0].terms}


def sensor_rows(models: Sequence[Model], maps: Sequence[VisibilityMap]) -> list[SensorRow]:
    """Return one row a sensor, in their order."""
    whole = [folded(found, model) for model, found in zip(models, maps, strict=True)]
    seen = np.stack([found.visible.sum(axis=1) for found in whole])  # (M, S)
    only = np.stack([_only_one(found).sum(axis=1) for found in whole])
    faces = np.array([model.file.n_faces for model in models])[:, None]
    areas = [model.areas / model.areas.sum() for model in models]
    seen_area = [found.visible @ area for area, found in zip(areas, maps, strict=True)]
    only_area = [_only_one(found) @ area for area, found in zip(areas, maps, strict=True)]
    return [
        SensorRow(name, int(a), float(b), int(c), float(d), float(e), float(f))
        for name, a, b, c, d, e, f in zip(
            maps[0].sensor_names,
            seen.sum(axis=0),
            (100 * seen / faces).mean(axis=0),
            only.sum(axis=0),
            (100 * only / faces).mean(axis=0),
            100 * np.mean(seen_area, axis=0),
            100 * np.mean(only_area, axis=0),
            strict=True,
        )
    ]


def sensor_table(
    models: Sequence[Model], maps: Sequence[VisibilityMap], by_area: bool = False
) -> tuple[str, list[tuple[str, float, float]]]:
    """Return what each sensor sees and what only it sees, for people.

    Parameters
    ----------
    models, maps : sequence of Model, sequence of VisibilityMap
        One map a model.
    by_area : bool
        Whether the objective is by area.

    Returns
    -------
    noun : str
        Of what the percentages are; see ``noun_of_shares``.
    rows : list of (str, float, float)
        Name, percentage seen and percentage that only it sees, the mean over models.
    """
    noun, rows = noun_of_shares(models, by_area), sensor_rows(models, maps)
    if noun == "faces":
        return noun, [(row.name, row.seen_percentage, row.only_it_percentage) for row in rows]
    return noun, [(row.name, row.area_percentage, row.only_it_area_percentage) for row in rows]


def _only_one(found: VisibilityMap) -> NDArray[np.bool_]:
    """Return where a sensor is the only one to see a face or a piece, (S, F) bool."""
    return found.visible & (found.counts == 1)
