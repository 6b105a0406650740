"""What a mount is: a place, an orientation, a roll, and which of its numbers may move.

The words of the study file as data; ``mounts`` turns them into poses.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from glvis.problem.expressions import Linear

# Rows of a mount's numbers: the centre (or position), ring radius, angle and height about it,
# three numbers of orientation, the roll.
CENTRE, RADIUS, ANGLE, HEIGHT, ORIENTATION, ROLL = slice(0, 3), 3, 4, 5, slice(6, 9), 9
ROWS = 10

# Columns: where angle 0 points, where angle 90 points, the axis.
RING_AXES = {"x": np.eye(3)[:, [1, 2, 0]], "y": np.eye(3)[:, [2, 0, 1]], "z": np.eye(3)}
PLANES = {"yz": (1.0, 0.0, 0.0), "xz": (0.0, 1.0, 0.0), "xy": (0.0, 0.0, 1.0)}


@dataclass(frozen=True)
class Free:
    """A number that may move, before it has a name; ``start`` defaults to the middle."""

    min: float
    max: float
    start: float | None = None
    periodic: bool | None = None

    def __post_init__(self) -> None:
        if not self.min < self.max:
            raise ValueError(f"min = {self.min:g} must be less than max = {self.max:g}")
        if self.start is not None and not self.min <= self.start <= self.max:
            raise ValueError(f"start = {self.start:g} must lie in [{self.min:g}, {self.max:g}]")


Parameter = float | Free | Linear


@dataclass(frozen=True)
class Ring:
    """A place on a circle about an axis; angle 0 points along the next axis (x, y, z, x)."""

    axis: str
    radius: Parameter
    angle_deg: Parameter
    height: Parameter
    centre: tuple[Parameter, Parameter, Parameter] = (0.0, 0.0, 0.0)


@dataclass(frozen=True)
class Angles:
    """A direction by azimuth and elevation, degrees; see ``camera.direction_from_angles``."""

    azimuth_deg: Parameter
    elevation_deg: Parameter


@dataclass(frozen=True)
class Vector:
    """A direction by its components, of any length > 0."""

    components: tuple[Parameter, Parameter, Parameter]


@dataclass(frozen=True)
class Aim:
    """A direction by the point the sensor looks at."""

    point: tuple[Parameter, Parameter, Parameter]


@dataclass(frozen=True)
class Mirror:
    """A second sensor on the other side of a plane."""

    name: str
    point: tuple[float, float, float]
    normal: tuple[float, float, float]


@dataclass(frozen=True)
class Mount:
    """One sensor, or two where it has a mirror, and what of it may move."""

    name: str
    sensor: str
    place: tuple[Parameter, Parameter, Parameter] | Ring
    orientation: Angles | Vector | Aim
    roll_deg: Parameter = 0.0
    mirror: Mirror | None = None

    def numbers(self) -> Iterator[tuple[int, str, Parameter]]:
        """Yield row, place (as in "A1.ring.height") and parameter of each number."""
        if isinstance(self.place, Ring):
            ring = self.place
            yield from self._triple(CENTRE, "ring.centre", ring.centre)
            yield RADIUS, f"{self.name}.ring.radius", ring.radius
            yield ANGLE, f"{self.name}.ring.angle_deg", ring.angle_deg
            yield HEIGHT, f"{self.name}.ring.height", ring.height
        else:
            yield from self._triple(CENTRE, "position", self.place)
        first = ORIENTATION.start
        match self.orientation:
            case Angles(azimuth, elevation):
                yield first, f"{self.name}.direction.azimuth_deg", azimuth
                yield first + 1, f"{self.name}.direction.elevation_deg", elevation
            case Vector(components):
                yield from self._triple(ORIENTATION, "direction", components)
            case Aim(point):
                yield from self._triple(ORIENTATION, "aim", point)
        yield ROLL, f"{self.name}.roll_deg", self.roll_deg

    def _triple(
        self, rows: slice, label: str, values: Sequence[Parameter]
    ) -> Iterator[tuple[int, str, Parameter]]:
        for row, axis, value in zip(range(rows.start, rows.stop), "xyz", values, strict=True):
            yield row, f"{self.name}.{label}.{axis}", value
