"""Which pictures are made without being asked for: those that a person would look at.

Chosen by numbers alone, never by the time they take, so that the same result always has the same
pictures.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from glvis.problem.pieces import noun_of_shares, share_of
from glvis.problem.study import Study
from glvis.visibility.visibility_map import VisibilityMap

# As many models and sensors as the paper's arm scanner has are shown one by one: some 60 sheets,
# half a minute on two cores. Of more, those one would look at first; the contact sheets have all.
_MODELS, _WORST_MODELS = 6, 3
_SENSORS, _WORST_SENSORS = 8, 4


@dataclass(frozen=True)
class Chosen:
    """What has pictures of its own.

    Attributes
    ----------
    models, sensors : tuple of int
        Indices of the models with all their sheets, and of the sensors with their views; in the
        order of the study.
    left_out : tuple of str
        A sentence for each kind of picture that was not made.
    """

    models: tuple[int, ...]
    sensors: tuple[int, ...]
    left_out: tuple[str, ...] = ()


def chosen_pictures(
    study: Study, maps: Sequence[VisibilityMap], *, all_pictures: bool = False
) -> Chosen:
    """Return which models and sensors are shown one by one.

    Parameters
    ----------
    study : Study
        What was run.
    maps : sequence of VisibilityMap
        One a model.
    all_pictures : bool
        Whether every one is.
    """
    n_models, n_sensors = len(study.models), len(study.sensors)
    models, sensors, left_out = tuple(range(n_models)), tuple(range(n_sensors)), []
    if all_pictures:
        return Chosen(models, sensors)
    if n_models > _MODELS:
        models = tuple(sorted(worst_models(study, maps)[:_WORST_MODELS]))
        left_out.append(
            f"of {n_models} models the {_WORST_MODELS} seen worst have pictures of their own "
            f"({', '.join(study.models[m].name for m in models)}), the contact sheets show all"
        )
    if n_sensors > _SENSORS:
        sensors = tuple(sorted(_least_seeing(study, maps)[:_WORST_SENSORS]))
        left_out.append(
            f"of {n_sensors} sensors the {_WORST_SENSORS} that see least have views of their own "
            f"({', '.join(study.sensor_names[s] for s in sensors)}), the contact sheets show all"
        )
    return Chosen(models, sensors, tuple(left_out))


def worst_models(study: Study, maps: Sequence[VisibilityMap]) -> list[int]:
    """Return the models from the least seen to the most seen."""
    noun = noun_of_shares(study.models, study.objective.by_area)
    shares = [
        share_of(model, found.counts > 0, noun)
        for model, found in zip(study.models, maps, strict=True)
    ]
    return [int(m) for m in np.argsort(shares, kind="stable")]


def _least_seeing(study: Study, maps: Sequence[VisibilityMap]) -> list[int]:
    """Return the sensors from the one that sees least, the mean over models, to the most."""
    noun = noun_of_shares(study.models, study.objective.by_area)
    shares = [
        [share_of(model, visible, noun) for visible in found.visible]
        for model, found in zip(study.models, maps, strict=True)
    ]
    return [int(s) for s in np.argsort(np.mean(shares, axis=0), kind="stable")]
