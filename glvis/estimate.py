"""What a study will cost and how fine its pictures are, before it is run."""

from __future__ import annotations

import math
import time
from dataclasses import dataclass

import numpy as np

from glvis.context import GlInfo
from glvis.evaluator import Evaluator
from glvis.scene import Model
from glvis.sensor import Sensor
from glvis.study import Study

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
    evaluations : int
        Of a run that stops at no rule but its number of iterations.
    gl : GlInfo
        Who drew.
    """

    evaluation_seconds: float
    samples: int
    maps: int
    evaluations: int
    gl: GlInfo

    @property
    def run_seconds(self) -> float:
        """Of a full run in one process."""
        return self.evaluation_seconds * self.evaluations


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
    options, rig = study.swarm, study.rig
    rng = np.random.default_rng(options.seed)
    low, high = rig.bounds.T
    with Evaluator(study, cache_bytes=0) as evaluator:
        evaluator(rig.start)  # the first one also fills buffers
        times: list[float] = []
        while len(times) < _MOST_SAMPLES and sum(times) < max_seconds:
            x = rng.uniform(low, high)
            started = time.perf_counter()
            evaluator(x)
            times.append(time.perf_counter() - started)
        return Cost(
            float(np.median(times)),
            len(times),
            len(study.sensors) * len(study.models),
            options.particles * (options.iterations + 1) if study.variables else 1,
            evaluator.gl,
        )


def working_distance(sensor: Sensor) -> float:
    """Return the middle of a sensor's working range, the study's unit."""
    return (sensor.min_distance + sensor.max_distance) / 2


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
