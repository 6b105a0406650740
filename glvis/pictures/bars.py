"""Colour bars: numbers as colours of a perceptually even ramp."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from glvis.common.palette import rgb

Floats = NDArray[np.float64]
Colors = NDArray[np.uint8]

# Viridis (van der Walt and Smith 2015, CC0), light first: light is near and square.
_RAMP = ("#FDE725", "#ADDC30", "#5EC962", "#28AE80", "#21918C", "#2C728E", "#3B528B", "#472D7B")


@dataclass(frozen=True)
class Bar:
    """A colour bar over values low to high, with the name of the quantity and its unit.

    Attributes
    ----------
    low, high : float
        Its ends.
    label, unit : str
        What it shows.
    is_log : bool
        Whether equal steps are equal factors; low is above 0 then.
    is_falling : bool
        Whether the largest values are light, as good ones are, instead of the smallest.
    goes_on : (bool, bool)
        Whether there are values below low, and above high.
    """

    low: float
    high: float
    label: str
    unit: str
    is_log: bool = False
    is_falling: bool = False
    goes_on: tuple[bool, bool] = (False, False)

    def share(self, values: ArrayLike) -> Floats:
        """Return how far along the bar values are: 0 at its low end, 1 at its high end."""
        low, high = self.low, self.high
        at = np.clip(np.asarray(values, dtype=float), low, high)
        if self.is_log:
            low, high, at = math.log(low), math.log(high), np.log(at)
        found: Floats = (at - low) / max(high - low, 1e-300)
        return found

    def colors(self, values: ArrayLike) -> Colors:
        """Return colours (..., 3) uint8 of values; outside, the end's."""
        share = self.share(values)
        return ramp_colors(1 - share if self.is_falling else share, 0.0, 1.0)


def ramp_colors(value: Floats, low: float, high: float) -> Colors:
    """Return colours (..., 3) uint8 of values between low and high; outside, the end's."""
    table = np.array([rgb(color) for color in _RAMP], dtype=float)
    at = np.clip((value - low) / max(high - low, 1e-300), 0, 1) * (len(table) - 1)
    i = np.minimum(at.astype(int), len(table) - 2)
    t = (at - i)[..., None]
    return np.round(table[i] * (1 - t) + table[i + 1] * t).astype(np.uint8)
