"""What the page shows, as arrays and text: models, obstacles, sensors, tables, the search."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, field

from numpy.typing import ArrayLike

from glvis.problem.sensor import Sensor


@dataclass(frozen=True, eq=False)
class PageQuality:
    """A number that tells how well each sensor sees each face, the smallest being the best.

    Attributes
    ----------
    label : str
        What is said, with # for the number and its unit, such as "depth error #".
    unit : str
        Of the values.
    values : (S, F) float
        NaN where there is none.
    """

    label: str
    unit: str
    values: ArrayLike = field(repr=False)


@dataclass(frozen=True, eq=False)
class PageModel:
    """A model and its visibility map.

    Attributes
    ----------
    name : str
        As the page calls it.
    vertices : (V, 3) float
        World frame, the study's unit.
    faces : (F, 3) int
        Indices into ``vertices``, counter-clockwise seen from outside.
    visible : (S, F) bool
        Which sensor sees which face.
    piece_of : (F,) int or None
        Where faces were cut: which of the file's faces each one is a piece of. The page then tells
        shares of the area instead of the faces.
    refusals : (S, F) int or None
        Which filter of each sensor refuses each face first, by ``filters.Refusal``; without them
        the page does not say why a face is not seen.
    qualities : sequence of PageQuality
        How good each view is, told of the face under the pointer.
    """

    name: str
    vertices: ArrayLike = field(repr=False)
    faces: ArrayLike = field(repr=False)
    visible: ArrayLike = field(repr=False)
    piece_of: ArrayLike | None = field(default=None, repr=False)
    refusals: ArrayLike | None = field(default=None, repr=False)
    qualities: Sequence[PageQuality] = ()


@dataclass(frozen=True, eq=False)
class PageObstacle:
    """What hides and is never counted: vertices (V, 3) in the world frame, faces (F, 3)."""

    name: str
    vertices: ArrayLike = field(repr=False)
    faces: ArrayLike = field(repr=False)


@dataclass(frozen=True, eq=False)
class PageSensor:
    """A placed sensor.

    Attributes
    ----------
    name, kind : str
        Of this one ("A1"), and what it is ("kinect-v2").
    camera_to_world : (4, 4) float
        Pose; x right, y up, looking along -z.
    tan_half : (2,) float
        Tangents of the half opening angles along x and y, of the pinhole that one looks through.
    min_distance, max_distance : float
        Working range, the study's unit.
    max_incidence : float
        Radians.
    resolution : (2,) int
        Pixels, width and height.
    color : str
        "#RRGGBB"; empty takes the palette's colour for its place in the list.
    whole : Sensor, optional
        What else there is to it: lens, range or depth, second viewpoint. Without it, it is an
        ideal pinhole whose range is depth along the optical axis.
    """

    name: str
    kind: str
    camera_to_world: ArrayLike
    tan_half: ArrayLike
    min_distance: float
    max_distance: float
    max_incidence: float = math.pi / 2
    resolution: tuple[int, int] = (1280, 720)
    color: str = ""
    whole: Sensor | None = None

    @classmethod
    def of(cls, name: str, sensor: Sensor, camera_to_world: ArrayLike) -> PageSensor:
        """Return a sensor under a name, at a pose (4, 4)."""
        return cls(
            name,
            sensor.name,
            camera_to_world,
            sensor.lens.tan_half,
            sensor.min_distance,
            sensor.max_distance,
            sensor.max_incidence,
            sensor.resolution,
            whole=None if sensor.is_ideal else sensor,
        )


@dataclass(frozen=True)
class PageTable:
    """A table: rows as long as the header; numbers are formatted by the page, text is not."""

    title: str
    header: Sequence[str]
    rows: Sequence[Sequence[str | float]]
    note: str = ""


@dataclass(frozen=True, eq=False)
class PageTrace:
    """The search: (N,) iteration, best and mean objective; NaN where there is none."""

    iteration: ArrayLike
    best: ArrayLike
    mean: ArrayLike


@dataclass(frozen=True, eq=False)
class PageData:
    """Everything on the page.

    Attributes
    ----------
    title, unit : str
        Of the study.
    up : (3,) float
        World direction that stands upright.
    models, sensors : sequence
        At least one model; visibility maps have one row a sensor.
    obstacles, tables : sequence
        May be empty.
    trace : PageTrace or None
        The search, where there was one.
    facts : sequence of (key, value)
        Objective, stop reason, seed, driver, versions.
    mounting : sequence of str
        Lines for whoever installs the sensors.
    subtitle : str
        One line under the title; empty says what the scene holds.
    incidence : str
        "ray" or "axis": what incidence angles in the readings refer to.
    by_area : bool
        Whether the objective weighs faces by their area: the page then tells shares of the area,
        as where faces were cut.
    """

    title: str
    unit: str
    up: ArrayLike
    models: Sequence[PageModel]
    sensors: Sequence[PageSensor]
    obstacles: Sequence[PageObstacle] = ()
    tables: Sequence[PageTable] = ()
    trace: PageTrace | None = None
    facts: Sequence[tuple[str, str]] = ()
    mounting: Sequence[str] = ()
    subtitle: str = ""
    incidence: str = "ray"
    by_area: bool = False
