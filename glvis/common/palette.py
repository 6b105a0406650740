"""Colours with a meaning, shared by the pictures and the page.

Sensor colours start with the palette of Okabe and Ito, which colour-blind readers can tell
apart, and go on with colours picked for the largest distance (Oklab, under normal, deutan and
protan vision after Machado et al. 2009) from those before and from the greys of obstacles.
A loud colour, drawn with stripes so that it does not hang on hue alone, is kept for faces
that nobody sees and given to no sensor.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

Colors = NDArray[np.uint8]

# Okabe and Ito 2008, "Color Universal Design", without black; strongest contrasts first.
OKABE_ITO = ("#0072B2", "#E69F00", "#009E73", "#CC79A7", "#56B4E9", "#D55E00", "#F0E442")
# From here on: our own, see the module's docstring.
_EXTENSION = (
    *("#932F67", "#3A47F0", "#4FE3A6", "#8F7DF2", "#7A4A10", "#8FE3F2", "#4A2A86"),
    *("#B0487E", "#55CC77"),
)
# Faces seen by 1, 2, ... sensors: light to dark, so that the order survives without hue.
_OVERLAP_RAMP = ("#F6E8A2", "#B3DC9E", "#5FC2B2", "#3A97C6", "#4461B6", "#57318F")

_GOLDEN_TURN = (3 - 5**0.5) / 2  # of a full turn; successive hues stay apart for any number


def rgb(color: str) -> Colors:
    """Return ``"#RRGGBB"`` as (3,) uint8."""
    return np.frombuffer(bytes.fromhex(color.removeprefix("#")), dtype=np.uint8).copy()


def hex_color(color: Colors) -> str:
    """Return (3,) uint8 as ``"#RRGGBB"``."""
    return "#" + bytes(np.asarray(color, dtype=np.uint8)).hex().upper()


UNSEEN_COLOR = rgb("#FF0055")  # faces that no sensor sees
SEEN_COLOR = rgb("#C9CED6")  # faces that are seen, where only the unseen ones matter
OBSTACLE_COLOR = rgb("#6B7079")
_SLATE, _PALE_SLATE, _TOWARDS_SLATE = rgb("#3C4350"), rgb("#D2D8E2"), 0.55  # of second tones
NO_RAY = rgb("#3F4247")  # pixels on which nothing falls: the lens ends before them
OVERLAP_COLORS = np.array([UNSEEN_COLOR, *map(rgb, _OVERLAP_RAMP)])  # counts 0, 1, ... 6


def sensor_colors(n: int) -> Colors:
    """Return colours (n, 3) uint8 for n sensors; the first ones do not depend on n."""
    table = [rgb(color) for color in OKABE_ITO + _EXTENSION]
    table += [_spare_color(i) for i in range(n - len(table))]
    return np.array(table[:n], dtype=np.uint8).reshape(n, 3)


def second_tones(colors: Colors, *, on_dark: bool = False) -> Colors:
    """Return the second tones (N, 3) of colours (N, 3): what belongs to them but is not they."""
    slate = _PALE_SLATE if on_dark else _SLATE
    mixed = (1 - _TOWARDS_SLATE) * np.asarray(colors, dtype=float) + _TOWARDS_SLATE * slate
    return np.round(mixed).astype(np.uint8)


def overlap_colors(n: int) -> Colors:
    """Return colours (n + 1, 3) uint8 for faces seen by 0, 1, ... n sensors.

    Up to six sensors a count has the same colour in every picture; beyond, the ramp is
    stretched over all counts.
    """
    if n < len(OVERLAP_COLORS):
        return OVERLAP_COLORS[: n + 1].copy()
    ramp = OVERLAP_COLORS[1:].astype(float)
    at = np.linspace(0, len(ramp) - 1, n)
    seen = np.stack([np.interp(at, np.arange(len(ramp)), c) for c in ramp.T], axis=1)
    return np.vstack([UNSEEN_COLOR[None], np.round(seen).astype(np.uint8)])


def _spare_color(i: int) -> Colors:
    """Return the i-th colour beyond the table: golden-angle hues on three levels of light."""
    hue, value, saturation = (0.58 + i * _GOLDEN_TURN) % 1, (0.95, 0.6, 0.8)[i % 3], 0.75
    # HSV to RGB: each channel is a clipped tent over the hue circle.
    tent = np.clip(np.abs((hue * 6 + np.array([0.0, 4.0, 2.0])) % 6 - 3) - 1, 0, 1)
    return np.round(255 * value * (1 - saturation * (1 - tent))).astype(np.uint8)
