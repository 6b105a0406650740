"""Colours by how good the best view of a face is, and by how many projectors light it.

See ``evaluation.view_quality`` and ``evaluation.interference`` for what the numbers are.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from glvis.common.palette import OKABE_ITO, SEEN_COLOR, rgb
from glvis.evaluation.interference import Interference, rival_groups
from glvis.evaluation.view_quality import (
    LARGEST_IS_BEST,
    a_metre,
    is_known,
    quality_of_views,
)
from glvis.pictures.bars import Bar
from glvis.pictures.coloring import (
    KINDS,
    Coloring,
    Seen,
    Swatch,
    opaque,
    share,
    unseen_swatch,
    with_unseen,
)
from glvis.pictures.places import number
from glvis.problem.pieces import share_of
from glvis.problem.sensor import Sensor
from glvis.problem.units import fine_unit

Floats = NDArray[np.float64]

QUALITIES = ("pixel-size", "density", "depth-error", "blur")
INTERFERENCE = "interference"
EVERY_KIND = (*KINDS, *QUALITIES, INTERFERENCE)

_OUTLIERS = 0.5  # percent of the faces that may lie beyond either end of a colour bar
_MANY_FOLD = 5.0  # from the low to the high end, beyond which a bar is one of factors
_SHARPEST = 0.1  # pixels; less blur is of no meaning, and a scale of factors has no zero
_UNKNOWN = rgb("#9AA1AB")  # seen by sensors that do not state what the number follows from
# Lit by 0, 1, 2 ... projectors: grey and blue are good, then ever darker orange.
_LIT = (SEEN_COLOR, rgb(OKABE_ITO[4]), rgb("#F2A65A"), rgb(OKABE_ITO[5]), rgb("#8A3A00"))

# Pixels a metre by EN 62676-4:2015; the edition of 2025 has further steps and the same 125 and 250.
_LEVELS = {
    "inspect": 1000.0,
    "identify": 250.0,
    "recognise": 125.0,
    "observe": 62.5,
    "detect": 25.0,
    "monitor": 12.5,
}


@dataclass(frozen=True)
class _Words:
    """What is said of a quality: title, label of the bar, unit ("" is a length) and note."""

    title: str
    label: str
    unit: str
    note: str


_WORDS = {
    "pixel-size": _Words(
        "How finely a face is seen",
        "smallest pixel size",
        "",
        "Length that a pixel spans on the surface, for the sensor that sees the face most finely.",
    ),
    "density": _Words(
        "How densely a face is seen",
        "largest pixel density",
        "pixels/m",
        "For the sensor that sees the face most densely; without incidence, as in EN 62676-4, "
        "whose levels of 2015 are named.",
    ),
    "depth-error": _Words(
        "How exactly depth is measured",
        "smallest depth error, 1 σ",
        "",
        "Standard deviation along the optical axis, for the sensor that measures the face most "
        "exactly.",
    ),
    "blur": _Words(
        "How sharply a face is seen",
        "smallest blur",
        "pixels",
        "Diameter of the circle of confusion, for the sensor that sees the face most sharply; "
        "below 1 pixel it is in focus.",
    ),
}


def check_kinds(kinds: Sequence[str], sensors: Sequence[Sensor]) -> None:
    """Raise ValueError where a colouring is none, or says nothing of some sensors."""
    for kind in kinds:
        if kind not in EVERY_KIND:
            raise ValueError(f"color = '{kind}' must be one of {', '.join(EVERY_KIND)}")
        if kind in QUALITIES and not is_known(_field(kind), sensors):
            key = "noise" if kind == "depth-error" else "focus"
            raise ValueError(
                f"color = '{kind}' needs a sensor that states its {key}; none does, see [sensor] "
                f"{key}"
            )
        if kind == INTERFERENCE and not rival_groups(sensors):
            raise ValueError(
                f"color = '{kind}' needs two sensors whose 'emits' is the same; there are none"
            )


@dataclass(frozen=True)
class Scale:
    """A colour bar for one of ``QUALITIES``, and the factor from its numbers to the bar's unit."""

    bar: Bar
    factor: float


def quality_scale(kind: str, seen: Sequence[Seen]) -> Scale:
    """Return the scale for one of ``QUALITIES`` that suits all of some models."""
    values = np.concatenate([best_of(kind, one) for one in seen])
    values, words = values[np.isfinite(values)], _WORDS[kind]
    if not len(values):
        values = np.ones(1)  # nobody sees anything: any bar does
    factor, unit = 1.0, words.unit
    if not unit:
        factor, unit = fine_unit(float(np.median(values)), seen[0].unit)
    values = values * factor
    if kind == "blur":
        values = np.maximum(values, _SHARPEST)
    low, high = np.percentile(values, [_OUTLIERS, 100 - _OUTLIERS]).tolist()
    low, high = _rounded(low, up=False), _rounded(high, up=True) or 1.0
    if low == high:
        low, high = low / 2, high * 2
    is_log = 0 < low < high / _MANY_FOLD
    if not is_log and kind == "blur":
        low = 0.0
    goes_on = bool(values.min() < low) or (kind == "blur" and is_log), bool(values.max() > high)
    is_falling = _field(kind) in LARGEST_IS_BEST
    return Scale(Bar(low, high, words.label, unit, is_log, is_falling, goes_on), factor)


def quality_coloring(kind: str, seen: Seen, scale: Scale | None = None) -> Coloring:
    """Return the colours of a model's faces by one of ``QUALITIES``.

    Parameters
    ----------
    kind : str
        Which.
    seen : Seen
        How the model is seen.
    scale : Scale, optional
        To keep to, such as that of several models; see ``quality_scale``.
    """
    scale, words = scale or quality_scale(kind, [seen]), _WORDS[kind]
    bar, value = scale.bar, best_of(kind, seen) * scale.factor
    is_unseen, has_number = seen.map.counts == 0, np.isfinite(value)
    colors = bar.colors(np.where(has_number, value, bar.low))
    colors[~has_number] = _UNKNOWN
    note = words.note
    if has_number.any():
        median = number(float(f"{np.median(value[has_number]):.3g}"))
        note = f"Median {median}\u00a0{bar.unit}. {note}"
    rows = [unseen_swatch(seen)]
    if kind == "density":
        rows = [*_level_rows(seen, value, bar), *rows]
    if (is_mute := ~has_number & ~is_unseen).any():
        rows.append(Swatch(_UNKNOWN, "seen, not stated", seen.share(is_mute)))
    return Coloring(words.title, with_unseen(colors, is_unseen), rows, bar, note, seen.noun)


def interference_coloring(seen: Seen, found: Interference, m: int) -> Coloring:
    """Return the colours of a model's faces by how many projectors of one group light them.

    Parameters
    ----------
    seen : Seen
        The model.
    found : Interference
        What the projectors light.
    m : int
        Index of the model among those of the interference.
    """
    model, counts = seen.model, found.most(m)
    last = min(int(counts.max(initial=0)), len(_LIT) - 1)
    rows = []
    for n in range(max(last, 2) + 1):
        part = counts >= n if n == max(last, 2) else counts == n
        label = "no projector" if n == 0 else f"{n} projector{'' if n == 1 else 's'}"
        if n == max(last, 2) and counts.max(initial=0) > n:
            label += " or more"
        rows.append(Swatch(_LIT[n], label, share(share_of(model, part, "area"))))
    colors = np.array(_LIT)[np.minimum(counts, len(_LIT) - 1)]
    names = seen.map.sensor_names
    groups = [
        f"'{group}': {', '.join(names[s] for s in members)}"
        for group, members in zip(found.groups, found.members, strict=True)
    ]
    disturbed = share(found.disturbed_share(m, model))
    return Coloring(
        "Where projectors disturb each other",
        opaque(colors),
        rows,
        note="Lit as far as the sensor's range and up to 90°, whether its camera sees it or not; "
        f"only projectors of one group count together. {_plural('Group', groups)} "
        f"{'; '.join(groups)}.",
        heading="area",
        facts=f"{disturbed} of the area lit by two or more projectors of one group",
    )


def best_of(kind: str, seen: Seen) -> Floats:
    """Return the best number of each face over the sensors that see it, (F,).

    In the study's unit, densities in pixels a metre; NaN where there is none.
    """
    model, poses = seen.model, seen.camera_to_world
    quality = quality_of_views(model.centroids, model.normals, poses, seen.sensors)
    value, _ = quality.best(_field(kind), seen.map.visible)
    return a_metre(value, seen.unit) if kind == "density" else value


def _field(kind: str) -> str:
    """Return the name that ``view_quality.NAMES`` has for one of ``QUALITIES``."""
    return kind.replace("-", "_")


def _plural(noun: str, things: Sequence[object]) -> str:
    return noun if len(things) == 1 else f"{noun}s"


def _level_rows(seen: Seen, value: Floats, bar: Bar) -> list[Swatch]:
    """Return a row for each level of EN 62676-4 that some faces reach and some do not."""
    known = np.where(np.isfinite(value), value, 0.0)
    rows = []
    for name, least in _LEVELS.items():
        reached = known >= least
        if reached.any() and (~reached[known > 0]).any():
            label = f"{name}: ≥ {number(least)}"
            rows.append(Swatch(bar.colors(least), label, seen.share(reached)))
    return rows


def _rounded(value: float, *, up: bool) -> float:
    """Return a number rounded to two digits, up or down; 0 of what is not above it."""
    if value <= 0:
        return 0.0
    step = 10.0 ** (math.floor(math.log10(value)) - 1)
    whole = (math.ceil if up else math.floor)(round(value / step, 9))
    return float(f"{whole * step:.2g}")
