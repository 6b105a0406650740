"""Gives each face of a model a colour that means something, and the legend that says what.

By sensor, by how many see it, by the smallest incidence or distance it is seen at, or by
whether anyone sees it at all; ``qualitycolors`` has how good the views are, and interference.
Arrays and words only; draws nothing.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from glvis.common.palette import (
    OBSTACLE_COLOR,
    SEEN_COLOR,
    UNSEEN_COLOR,
    overlap_colors,
    rgb,
    sensor_colors,
)
from glvis.pictures.bars import Bar
from glvis.pictures.places import length_words, number
from glvis.problem.field import partner_words
from glvis.problem.pieces import noun_of_shares, share_of
from glvis.problem.scene import Model
from glvis.problem.sensor import Sensor
from glvis.problem.visibility_options import VisibilityOptions
from glvis.visibility.filters import incidence_cos
from glvis.visibility.visibility_map import VisibilityMap

Floats = NDArray[np.float64]
Colors = NDArray[np.uint8]

KINDS = ("sensor", "overlap", "incidence", "distance", "unseen")
STRIPED = 128  # opacity that marks striped faces, see shading.Solid.paint
BACK_COLOR = rgb("#504C49")  # as shaded.frag.glsl has it
_MAX_ROWS = 36  # of a legend


@dataclass(frozen=True, eq=False)
class Swatch:
    """A row of a legend: colour (3,) uint8, what it means, and how much of it there is."""

    color: Colors
    label: str
    value: str = ""
    is_striped: bool = False


@dataclass(frozen=True, eq=False)
class Coloring:
    """The colours of a model's faces and what they mean.

    Attributes
    ----------
    title : str
        What the colours answer.
    colors : (F, 4) uint8
        sRGB and opacity; see ``shading.Solid.paint``.
    swatches : sequence of Swatch
        Legend.
    bar : Bar or None
        Colour bar.
    note : str
        What a reader must know besides.
    heading : str
        Over the values of the swatches.
    facts : str
        What is seen in all, in a few words; empty takes those of the map.
    """

    title: str
    colors: Colors = field(repr=False)
    swatches: Sequence[Swatch]
    bar: Bar | None = None
    note: str = ""
    heading: str = "faces"
    facts: str = ""


@dataclass(frozen=True, eq=False)
class Seen:
    """How one model's faces are seen by placed sensors.

    Attributes
    ----------
    model : Model
        F faces.
    map : VisibilityMap
        Which of the S sensors sees which face.
    sensors : sequence of Sensor
        S of them.
    camera_to_world : (S, 4, 4) float64
        Poses.
    unit : str
        Of lengths.
    by_axis : bool
        Whether incidence means the angle to the optical axis instead of the ray.
    by_area : bool
        Whether the objective weighs faces by their area, and shares are therefore of the area.
    most : int
        Most sensors that see one face of any model shown beside this one, so that a count has
        the same colour on all.
    """

    model: Model
    map: VisibilityMap
    sensors: Sequence[Sensor]
    camera_to_world: Floats
    unit: str
    by_axis: bool = False
    by_area: bool = False
    most: int = 1

    @property
    def noun(self) -> str:
        """What shares are shares of: "faces" or "area"; see ``noun_of_shares``."""
        return noun_of_shares([self.model], self.by_area)

    def share(self, chosen: NDArray[np.bool_]) -> str:
        """Return the share of some faces (F,), see ``noun``, in percent."""
        return share(share_of(self.model, chosen, self.noun))

    def incidence(self, s: int) -> Floats:
        """Return the angle between each face's normal and the way to sensor ``s``, (F,) rad."""
        options = VisibilityOptions(incidence="axis" if self.by_axis else "ray")
        normals, points = self.model.normals, self.model.centroids
        cos = incidence_cos(normals, points, self.camera_to_world[s], options)
        return np.arccos(np.clip(cos, -1, 1))

    def depth(self, s: int) -> Floats:
        """Return each centroid's distance as sensor ``s`` measures it, (F,) scene unit.

        Along the optical axis, or from the optical centre where its range is one.
        """
        pose = self.camera_to_world[s]
        away = pose[:3, 3] - self.model.centroids
        if self.sensors[s].distance == "range":
            return np.asarray(np.linalg.norm(away, axis=1))
        return away @ pose[:3, 2]

    def least(self, quantity: Callable[[int], Floats]) -> tuple[Floats, NDArray[np.int64]]:
        """Return the smallest of a quantity over the sensors that see a face, and which one.

        Parameters
        ----------
        quantity : callable
            ``incidence`` or ``depth``.

        Returns
        -------
        value : (F,) float64
            Inf where no sensor sees the face.
        sensor : (F,) int64
            Index, -1 where none.
        """
        value = np.full(self.model.n_faces, np.inf)
        which = np.full(self.model.n_faces, -1, dtype=np.int64)
        for s, visible in enumerate(self.map.visible):
            new = quantity(s)
            is_less = visible & (new < value)
            value[is_less], which[is_less] = new[is_less], s
        return value, which


def coloring(kind: str, seen: Seen) -> Coloring:
    """Return the colours of a model's faces for one of ``KINDS``."""
    if kind not in KINDS:
        raise ValueError(f"color = '{kind}' must be one of {', '.join(KINDS)}")
    return _KINDS[kind](seen)


def share(part: float) -> str:
    """Return a share in percent that never rounds something to nothing or to all."""
    percent = 100 * part
    if 0 < percent < 0.05:
        return "<\u00a00.1\u00a0%"
    if 99.95 <= percent < 100:
        return ">\u00a099.9\u00a0%"
    return f"{percent:.1f}\u00a0%"


def seen_by_one(seen: Seen, s: int, colors: Colors) -> Coloring:
    """Return the colours of what sensor ``s`` sees, and of what it refuses."""
    visible = seen.map.visible[s]
    sensor = seen.sensors[s]
    name = seen.map.sensor_names[s]
    angle = f"{math.degrees(sensor.max_incidence):g}°"
    last = "hidden, or outside the picture"
    if sensor.partner:
        last = f"hidden, outside the picture, or not seen by its {partner_words(sensor)}"
    return Coloring(
        f"{name}: what it sees",
        opaque(np.where(visible[:, None], colors[s], SEEN_COLOR)),
        [
            Swatch(colors[s], f"seen by {name}", seen.share(visible)),
            Swatch(SEEN_COLOR, "not counted", seen.share(~visible)),
        ],
        note=f"Not counted: nearer than {length_words(sensor.min_distance, seen.unit)}, "
        f"farther than {length_words(sensor.max_distance, seen.unit)}, more oblique than {angle}, "
        f"{last}.",
        heading=seen.noun,
    )


def obstacle_swatch(opacity: float = 1.0) -> Swatch:
    """Return the legend's row for obstacles, on white where they are seen through."""
    color = np.round(255 - opacity * (255.0 - OBSTACLE_COLOR)).astype(np.uint8)
    return Swatch(color, "obstacle" if opacity == 1 else "obstacle, faint")


def back_swatch() -> Swatch:
    """Return the legend's row for the backs of surfaces."""
    return Swatch(BACK_COLOR, "back of a face")


def unseen_swatch(seen: Seen) -> Swatch:
    """Return the legend's row for faces that nobody sees."""
    return Swatch(UNSEEN_COLOR, "no sensor", seen.share(seen.map.counts == 0), is_striped=True)


def _by_sensor(seen: Seen) -> Coloring:
    _, which = seen.least(seen.incidence)
    colors = sensor_colors(len(seen.sensors))
    rows = [
        Swatch(color, name, seen.share(visible))
        for color, name, visible in zip(
            colors, seen.map.sensor_names, seen.map.visible, strict=True
        )
    ]
    if len(rows) > _MAX_ROWS:
        more = len(rows) - _MAX_ROWS + 1
        rows = [*rows[: _MAX_ROWS - 1], Swatch(rgb("#FFFFFF"), f"and {more} more")]
    return Coloring(
        "Which sensor sees which face",
        with_unseen(colors[which] if len(colors) else np.zeros((len(which), 3)), which < 0),
        [*rows, unseen_swatch(seen)],
        note="A face seen by several sensors has the colour of the one that sees it most "
        "squarely. Shares count every face that a sensor sees, so they overlap.",
        heading="sees",
    )


def _by_overlap(seen: Seen) -> Coloring:
    counts = seen.map.counts
    colors = overlap_colors(max(seen.most, int(counts.max(initial=0))))
    most = max(int(counts.max(initial=0)), 1)
    last = min(most, _MAX_ROWS - 1)
    rows = [unseen_swatch(seen)]
    for n in range(1, last + 1):
        is_rest = n == last < most
        part = counts >= n if is_rest else counts == n
        label = f"{n} sensor" + ("" if n == 1 else "s") + (" or more" if is_rest else "")
        rows.append(Swatch(colors[n], label, seen.share(part)))
    return Coloring(
        "How many sensors see a face",
        with_unseen(colors[counts], counts == 0),
        rows,
        heading=seen.noun,
    )


def _by_incidence(seen: Seen) -> Coloring:
    value, which = seen.least(seen.incidence)
    limit = max((sensor.max_incidence for sensor in seen.sensors), default=math.pi / 2)
    meant = "the optical axis" if seen.by_axis else "the line of sight"
    return _by_value(
        "How squarely a face is seen",
        seen,
        np.degrees(value),
        which < 0,
        Bar(0.0, math.degrees(limit), "smallest incidence", "°"),
        f"Angle between the face's normal and {meant} of the sensor that sees it most "
        "squarely; 0° looks straight at it.",
    )


_MEASURED = {
    "depth": "along the optical axis",
    "range": "from the optical centre",
    "depth and range": "along the optical axis, or from the centre where it measures range,",
}


def _by_distance(seen: Seen) -> Coloring:
    value, which = seen.least(seen.depth)
    low = min((sensor.min_distance for sensor in seen.sensors), default=0.0)
    high = max((sensor.max_distance for sensor in seen.sensors), default=1.0)
    kinds = " and ".join(sorted({sensor.distance for sensor in seen.sensors})) or "depth"
    return _by_value(
        "From how far a face is seen",
        seen,
        value,
        which < 0,
        Bar(low, high, "smallest distance", seen.unit),
        f"Distance {_MEASURED[kinds]} of the nearest sensor that sees the face.",
    )


def _by_value(
    title: str, seen: Seen, value: Floats, is_unseen: NDArray[np.bool_], bar: Bar, note: str
) -> Coloring:
    colors = bar.colors(np.where(is_unseen, bar.low, value))
    known = value[~is_unseen]
    if len(known):
        median = float(f"{np.median(known):.3g}")
        words = f"{number(median)}°" if bar.unit == "°" else length_words(median, bar.unit)
        note = f"Median {words}. {note}"
    painted = with_unseen(colors, is_unseen)
    return Coloring(title, painted, [unseen_swatch(seen)], bar, note, seen.noun)


def _by_unseen(seen: Seen) -> Coloring:
    is_unseen = seen.map.counts == 0
    parts = "pieces of faces" if seen.model.pieces else "faces"
    colors = np.broadcast_to(SEEN_COLOR, (len(is_unseen), 3))
    return Coloring(
        "What no sensor sees",
        with_unseen(colors, is_unseen),
        [
            unseen_swatch(seen),
            Swatch(SEEN_COLOR, "seen", seen.share(~is_unseen)),
        ],
        note=f"{np.count_nonzero(is_unseen):,} of {len(is_unseen):,} {parts}, "
        f"{share(share_of(seen.model, is_unseen, 'area'))} of the area.",
        heading=seen.noun,
    )


_KINDS: dict[str, Callable[[Seen], Coloring]] = {
    "sensor": _by_sensor,
    "overlap": _by_overlap,
    "incidence": _by_incidence,
    "distance": _by_distance,
    "unseen": _by_unseen,
}


def opaque(colors: NDArray[np.number]) -> Colors:
    """Return colours (F, 4) that are drawn plain."""
    rgba = np.full((len(colors), 4), 255, dtype=np.uint8)
    rgba[:, :3] = colors
    return rgba


def with_unseen(colors: NDArray[np.number], is_unseen: NDArray[np.bool_]) -> Colors:
    """Return colours (F, 4), the unseen faces loud and striped."""
    rgba = opaque(colors)
    rgba[is_unseen] = [*UNSEEN_COLOR, STRIPED]
    return rgba
