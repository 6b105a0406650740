"""What a lens will disappoint with: pixels that see nothing, depths where there are none."""

from __future__ import annotations

import math
from collections.abc import Iterator

import numpy as np

from glvis.problem.calibrated_lens import CalibratedLens
from glvis.problem.lens import Lens
from glvis.problem.sensor import Sensor
from glvis.problem.study import Study

_SAMPLES = 128  # pixels along each side of the image, of which a share is to be told


def lens_warnings(study: Study) -> Iterator[str]:
    """Yield a sentence for each lens of a study's sensors that ends early or sees too wide."""
    for sensor in dict.fromkeys(study.sensors):
        for who, lens in _lenses(sensor):
            blind = _share_without_ray(lens)
            if blind and isinstance(lens, CalibratedLens) and lens.end < lens.max_angle:
                yield (
                    f"{who}: the lens ends inside its own image, {math.degrees(lens.end):.1f} deg "
                    f"from its axis, where its distortion stops growing: {100 * blind:.2g} % of "
                    "the pixels have no ray and see nothing; a calibration with points up to the "
                    "corners mends it, max_angle_deg says that it is meant"
                )
        if sensor.distance == "depth" and _sees_beside(sensor.lens):
            yield (
                f"{sensor.name}: sees more than 180 degrees, and what lies beside or behind it has "
                "no depth along the axis, so that it counts as out of range; set distance = 'range'"
            )


def _lenses(sensor: Sensor) -> Iterator[tuple[str, Lens]]:
    """Yield the lenses of a sensor, each with its owner."""
    yield sensor.name, sensor.lens
    if sensor.partner and sensor.partner.lens != sensor.lens:
        yield f"{sensor.name}, partner", sensor.partner.lens


def _share_without_ray(lens: Lens) -> float:
    """Return the share of the pixels onto which no direction falls."""
    if not lens.has_blind_corners:
        return 0.0
    places = (np.arange(_SAMPLES) + 0.5) / _SAMPLES
    return float(np.isnan(lens.directions(*np.meshgrid(places, places))[0]).mean())


def _sees_beside(lens: Lens) -> bool:
    """Return whether a direction at right angles to the axis, or beyond, is in the image."""
    return bool((lens.outline()[:, 2] < 0).any())
