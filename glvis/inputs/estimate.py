"""What a study will cost and how fine its pictures are, before it is run."""

from __future__ import annotations

import math
import time
from dataclasses import dataclass

import numpy as np

from glvis.inputs.scene import Model
from glvis.inputs.sensor import Sensor, working_distance
from glvis.inputs.study import Study
from glvis.optim.evaluator import Evaluator
from glvis.optim.search_options import MAPS
from glvis.sight.context import GlInfo, rasterising_in_this_thread

_MOST_SAMPLES = 12


@dataclass(frozen=True)
class Cost:
    """A measured guess at what a full run takes.

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
    """

    evaluation_seconds: float
    samples: int
    maps: int
    run_maps: int
    max_seconds: float
    gl: GlInfo

    def run_seconds(self, workers: int = 1) -> float:
        """Return what a full run takes at most."""
        rendering = self.evaluation_seconds * self.run_maps / self.maps / workers
        return min(rendering, self.max_seconds)


def measured_cost(study: Study, *, max_seconds: float = 3.0) -> Cost:
    """Return what an evaluation costs here, measured on random positions within the bounds.

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
        return Cost(
            float(np.median(times)),
            len(times),
            len(study.sensors) * len(study.models),
            run_maps(study),
            study.max_seconds or math.inf,
            evaluator.gl,
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
