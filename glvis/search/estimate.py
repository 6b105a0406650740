"""What a study will cost and how fine its pictures are, before it is run."""

from __future__ import annotations

import math
import time
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from glvis.evaluation.evaluator import Evaluator
from glvis.problem.pieces import WORTH_CUTTING, faces_beyond, large_limit, share_of
from glvis.problem.scene import Model
from glvis.problem.search_options import MAPS
from glvis.problem.sensor import Sensor, working_distance
from glvis.problem.study import Study
from glvis.search.methods import new_search
from glvis.visibility.context import GlInfo, rasterising_in_this_thread

_MOST_SAMPLES = 12
_FEW_MAPS = 400  # of a search that is measured; it computes as much a map as one of thousands
_POSITIONS = 6  # at which areas by both criteria are compared, the start among them


@dataclass(frozen=True)
class Cost:
    """A measured estimate of what a full run takes.

    Attributes
    ----------
    evaluation_seconds : float
        Of one process for one position, all its maps rendered: the median of ``samples``.
    samples : int
        Positions that were measured.
    maps : int
        Of one evaluation.
    run_maps : int
        That a run may render before its budget, or its number of iterations, ends it; 0 where
        there is nothing to search.
    max_seconds : float
        That the study gives a run; infinite where it does not say.
    gl : GlInfo
        Who drew.
    search_seconds : float
        That the search computes for every map that it has rendered, in one process whatever the
        number of workers, as measured in a search of a few hundred maps.
    """

    evaluation_seconds: float
    samples: int
    maps: int
    run_maps: int
    max_seconds: float
    gl: GlInfo
    search_seconds: float = 0.0

    def map_seconds(self, workers: int = 1) -> float:
        """Return what the maps of a full run take."""
        return self.evaluation_seconds * self.run_maps / self.maps / workers

    def run_seconds(self, workers: int = 1) -> float:
        """Return what a full run takes, its maps and what the search computes."""
        searching = self.search_seconds * self.run_maps
        return min(self.map_seconds(workers) + searching, self.max_seconds)

    def reach_seconds(self, workers: int = 1) -> float:
        """Return what sampling takes at most, after a run, of what is within reach."""
        return min(self.map_seconds(workers), self.max_seconds)


def measured_cost(study: Study, *, max_seconds: float = 3.0) -> Cost:
    """Return what an evaluation costs here, measured on random positions within the bounds.

    What a search takes beside its maps is measured in a small one of the same kind.

    Parameters
    ----------
    study : Study
        What would be run.
    max_seconds : float
        Stop measuring after this time; at least one position is measured.

    Raises
    ------
    MachineError
        Where there is no OpenGL.
    """
    rig = study.rig
    rng = np.random.default_rng(study.swarm.seed)
    low, high = rig.bounds.T
    with rasterising_in_this_thread():
        evaluator = Evaluator(study, cache_bytes=0)
    with evaluator:
        evaluator(rig.start)  # the first one also fills buffers
        times: list[float] = []
        while not times or (len(times) < _MOST_SAMPLES and sum(times) < max_seconds):
            x = rng.uniform(low, high)
            started = time.perf_counter()
            evaluator(x)
            times.append(time.perf_counter() - started)
        evaluation, maps = float(np.median(times)), len(study.sensors) * len(study.models)
        return Cost(
            evaluation,
            len(times),
            maps,
            run_maps(study),
            study.max_seconds or math.inf,
            evaluator.gl,
            _search_seconds(study, max_seconds, evaluation / maps),
        )


def _search_seconds(study: Study, max_seconds: float, map_seconds: float) -> float:
    """Return what a search computes a map, beside rendering it, from one with a small budget.

    The stages of a search share its budget, so a small one has as much of each.
    """
    if not study.variables or study.search.method == "swarm":
        return 0.0  # a swarm computes next to nothing
    budget = min(run_maps(study), _FEW_MAPS, int(max_seconds / map_seconds) + 1)
    small = replace(study, search=replace(study.search, max_maps=budget, max_seconds=None))
    with rasterising_in_this_thread():
        evaluator = Evaluator(small)
    with evaluator:
        search = new_search(small, evaluator.most_poses)
        evaluator(search.best_x)
        begin, computed = time.perf_counter(), 0.0
        while search.stop_reason is None and time.perf_counter() - begin < 2 * max_seconds:
            started = time.perf_counter()
            positions = search.ask()
            computed += time.perf_counter() - started
            by_model = np.array(list(evaluator.each(positions, search.sensors, search.note)))
            started = time.perf_counter()
            search.tell(small.objective.aggregated(by_model), evaluator.maps_rendered)
            computed += time.perf_counter() - started
        return computed / evaluator.maps_rendered


@dataclass(frozen=True)
class LargeFaces:
    """Faces of a model that are large beside what a sensor sees, and what that does to areas.

    Attributes
    ----------
    model : Model
        Cut or not.
    limit : float
        Length beyond which an edge is large, the study's unit.
    n_faces : int
        Large faces, or large pieces where it was cut.
    area_share : float
        Share of the model's area that they hold.
    by_pixels, by_centroid : float
        Share of the area seen by either criterion, the mean over some positions.
    difference : float
        Of the two, at each position without its sign, the mean.
    """

    model: Model
    limit: float
    n_faces: int
    area_share: float
    by_pixels: float
    by_centroid: float
    difference: float


def large_faces(study: Study) -> list[LargeFaces]:
    """Return what large faces do to each model where they hold area that is worth cutting.

    Raises
    ------
    MachineError
        Where there is no OpenGL.
    """
    limits = {model: large_limit(model, study.sensors) for model in study.models}
    beyond = {model: faces_beyond(model, limit) for model, limit in limits.items()}
    shares = {model: share_of(model, chosen, "area") for model, chosen in beyond.items()}
    models = [model for model, share in shares.items() if share > WORTH_CUTTING]
    if not models:
        return []
    by_pixels, by_centroid = (
        _areas_seen(study, criterion, models) for criterion in ("pixels", "centroid")
    )
    return [
        LargeFaces(
            model,
            limits[model],
            int(np.count_nonzero(beyond[model])),
            shares[model],
            float(a.mean()),
            float(b.mean()),
            float(abs(a - b).mean()),
        )
        for model, a, b in zip(models, by_pixels.T, by_centroid.T, strict=True)
    ]


def _areas_seen(study: Study, criterion: str, models: list[Model]) -> NDArray[np.float64]:
    """Return the share of the area of some models (M,) that is seen at some positions, (P, M)."""
    options = replace(study.visibility, criterion=criterion, semantics="", min_pixels=1)
    rig, rng = study.rig, np.random.default_rng(study.swarm.seed)
    count = _POSITIONS if study.variables else 1
    low, high = rig.bounds.T
    positions = rng.uniform(low, high, (count, len(low)))
    positions[0] = rig.start
    with rasterising_in_this_thread():
        evaluator = Evaluator(
            replace(study, models=tuple(models), visibility=options), cache_bytes=0
        )
    with evaluator:
        return np.array(
            [
                [
                    share_of(model, seen.counts > 0, "area")
                    for model, seen in zip(models, maps, strict=True)
                ]
                for maps in evaluator.each_visibility(positions)
            ]
        )


def run_maps(study: Study) -> int:
    """Return how many maps a run may render."""
    if not study.variables:
        return 0
    maps, swarm = len(study.sensors) * len(study.models), study.swarm
    most = study.search.max_maps
    if study.search.method == "swarm":
        planned = swarm.particles * (swarm.iterations + 1) * maps
        return planned if most is None else min(most, planned)
    return MAPS * maps if most is None else most


def share_below_a_pixel(sensor: Sensor, model: Model, resolution: tuple[int, int]) -> float:
    """Return the share of a model's faces that fill less than a pixel at working distance.

    A face counts as it is seen best: its normal towards the sensor.

    Parameters
    ----------
    sensor : Sensor
        Who looks.
    model : Model
        What is looked at.
    resolution : tuple of int
        Pixels (width, height) of the picture.
    """
    pixels_a_unit = np.array(sensor.focal_pixels(resolution)) / working_distance(sensor)
    return float(np.mean(model.areas * math.prod(pixels_a_unit) < 1.0))
