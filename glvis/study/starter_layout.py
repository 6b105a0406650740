"""Where a first study puts sensors: about a part, above the floor, within a room.

Boxes and angles only; every place that the bounds allow lies outside of the box of what is looked
at, or within the walls, so that no search can put a sensor into a part or below a floor.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from glvis.problem.lens import Pinhole
from glvis.problem.scene import Model
from glvis.problem.sensor import Sensor
from glvis.problem.units import MM_PER_UNIT, short, trimmed
from glvis.problem.winding import looks_inwards, winding_numbers
from glvis.study.catalogue_sensors import find_sensor
from glvis.study.starter_texts import BOX_MOUNT_TEXT, RING_MOUNT_TEXT

Floats = NDArray[np.float64]

PLACES = ("around", "above", "room")
GUESSED_SENSORS = ("d415-buonamici", "kinect-v2")  # which ones init takes unasked
_ELEVATION = math.radians(30)  # of the sensors about a part, above and below in turns
# Of a sensor made to measure: degrees, and the pixels by which it is one pinhole.
_OWN_FOV, _OWN_PIXELS = (60.0, 46.826), (1280, 960)
_SMALLEST = 0.15  # radius of a part for a known sensor, of its maxD
_FLAT = 0.35  # height of a part, of its width, below which it is looked at from above or below
_ONE_SIDED = 0.5  # of a part's area that looks one way on balance: a sheet without a back
_AIM = 0.2  # how far from a part's middle sensors aim, of its sides
_STANDS = 500.0  # millimetres across, from which on things stand on a floor
_ROOM = 2000.0  # millimetres across, from which on what looks inwards is a room
_ROOM_SENSOR, _LARGEST_ROOM = "kinect-v2", 15_000.0
_OFF_THE_WALL = 300.0  # millimetres
_CEILING = 2500.0  # millimetres above the floor, where a room has none
_HIGH = 0.7  # of a room's height, from which on sensors hang
_DOWN = 0.05  # of a room's height and floor: what lies so high and looks down is a ceiling


@dataclass(frozen=True)
class Fit:
    """A sensor, and from where it looks at a thing.

    Attributes
    ----------
    sensor : Sensor
        Of the catalogue, or made to measure.
    distance : float
        Of the thing's middle, where all of it is in view.
    is_known : bool
        Whether the catalogue has it.
    """

    sensor: Sensor
    distance: float
    is_known: bool

    @property
    def sees_all(self) -> bool:
        """Whether the middle of the thing is in range from where all of it is in view."""
        return self.distance <= self.sensor.max_distance


def guessed_place(model: Model, unit: str) -> str:
    """Return where sensors probably are to stand: "around" a part, "above" a floor, in a "room"."""
    size = float(np.linalg.norm(np.ptp(model.bounds, axis=0))) * MM_PER_UNIT[unit]
    if size >= _ROOM and looks_inwards(model):
        return "room"
    return "above" if size >= _STANDS else "around"


def fitting_sensor(radius: float, unit: str, name: str | None = None) -> Fit:
    """Return a sensor for a part of some radius.

    One of the catalogue where it has the whole part in view and range, else one made to measure.

    Parameters
    ----------
    radius : float
        Of the sphere around the part, in ``unit``.
    unit : str
        Of lengths.
    name : str, optional
        Which one of the catalogue, whether it has the whole part in view or not.
    """
    for sensor in [find_sensor(one, unit) for one in ([name] if name else GUESSED_SENSORS)]:
        half = min(sensor.lens.opening) / 2
        distance = max(sensor.min_distance + radius, radius / math.sin(half))
        # Heights may take a sensor a fifth farther away; and a small part would be few pixels.
        fits = 1.2 * distance + radius <= sensor.max_distance
        if name or (fits and radius >= _SMALLEST * sensor.max_distance):
            return Fit(sensor, distance, True)
    distance = radius / math.sin(math.radians(min(_OWN_FOV)) / 2)
    return Fit(_made_to_measure(0.3 * distance, 1.8 * distance), distance, False)


def sensor_for_room(size: float, unit: str, name: str | None = None) -> Fit:
    """Return a sensor for a room of some diagonal, in ``unit``: from the middle it sees a wall."""
    if name is None and size * MM_PER_UNIT[unit] <= _LARGEST_ROOM:
        name = _ROOM_SENSOR
    if name is None:
        return Fit(_made_to_measure(0.03 * size, 0.75 * size), size / 2, False)
    return Fit(find_sensor(name, unit), size / 2, True)


def _made_to_measure(nearest: float, farthest: float) -> Sensor:
    low, high = float(short(nearest)), float(short(farthest))
    lens = Pinhole.from_degrees(*_OWN_FOV)
    return Sensor("camera", lens, _OWN_PIXELS, low, high, math.radians(70))


def part_mounts(model: Model, fit: Fit, sensors: int, up: str, place: str) -> list[str]:
    """Return the tables of sensors that stand about a part.

    Parameters
    ----------
    model : Model
        The part.
    fit : Fit
        Who looks.
    sensors : int
        How many.
    up : str
        "x", "y" or "z".
    place : str
        "around": from all sides. "above": never below its lowest vertex.
    """
    axis = "xyz".index(up)
    if not fit.sees_all:
        return [_side_mount(model, fit, k, axis, place) for k in range(sensors)]
    low, high = model.bounds
    half = (high - low) / 2
    width = float(np.linalg.norm(np.delete(half, axis)))
    if half[axis] < _FLAT * width:
        return [_flat_mount(model, fit, k, sensors, axis, place) for k in range(sensors)]
    return [_ring_mount(model, fit, k, sensors, axis, place) for k in range(sensors)]


def room_mounts(model: Model, fit: Fit, sensors: int, unit: str, up: str) -> list[str]:
    """Return the tables of sensors within a room, off its walls, that aim at what is in it.

    They start far from each other, where there is no furniture.
    """
    axis = "xyz".index(up)
    low, high = model.bounds.copy()
    inset = np.minimum(_OFF_THE_WALL / MM_PER_UNIT[unit], 0.2 * (high - low))
    floor, top = low[axis], high[axis]
    if not _has_ceiling(model, axis):
        top = max(top, floor + _CEILING / MM_PER_UNIT[unit] + inset[axis])
    low, high = low + inset, high - inset
    low[axis], high[axis] = floor + _HIGH * (top - floor), top - inset[axis]
    start_height = (low[axis] + high[axis]) / 2
    size = float(np.linalg.norm(high - low))
    middle = model.bounds.mean(axis=0)
    mounts = []
    for k, place in enumerate(_free_places(model, low, high, axis, start_height, sensors)):
        position = [_free(low[i], high[i], place[i], size) for i in range(3)]
        aim = [_free(model.bounds[0, i], model.bounds[1, i], middle[i], size) for i in range(3)]
        mounts.append(_box_mount(k, fit, position, aim))
    return mounts


def _has_ceiling(model: Model, axis: int) -> bool:
    """Return whether faces that look down close a room at its top."""
    low, high = model.bounds[:, axis]
    is_high = model.centroids[:, axis] > high - _DOWN * (high - low)
    across = np.prod(np.delete(np.ptp(model.bounds, axis=0), axis))
    seen_down = -(model.areas * model.normals[:, axis])[is_high & (model.normals[:, axis] < -0.5)]
    return bool(seen_down.sum() > _DOWN * across)


def _free_places(
    model: Model, low: Floats, high: Floats, axis: int, height: float, n: int
) -> list[Floats]:
    """Return starts at some height, far from each other and in no furniture."""
    across = [i for i in range(3) if i != axis]
    grid = np.stack(np.meshgrid(*[np.linspace(0.0, 1.0, 7)] * 2, indexing="ij"), axis=-1)
    places = np.zeros((grid.size // 2, 3))
    places[:, across] = low[across] + grid.reshape(-1, 2) * (high - low)[across]
    places[:, axis] = height
    numbers = winding_numbers(model, places)
    places = places[numbers < numbers.min() + 0.5]  # furniture adds one
    chosen = [places[0]]
    while len(chosen) < n:
        gaps = np.linalg.norm(places[:, None] - np.array(chosen)[None], axis=2).min(axis=1)
        chosen.append(places[int(gaps.argmax())])
    return chosen


def _ring_mount(model: Model, fit: Fit, k: int, sensors: int, axis: int, place: str) -> str:
    """Return a sensor on a ring outside of a part's box, at any height."""
    half = np.ptp(model.bounds, axis=0) / 2
    width = float(np.linalg.norm(np.delete(half, axis)))
    level, rise = fit.distance * math.cos(_ELEVATION), fit.distance * math.sin(_ELEVATION)
    nearest = width + max(0.5 * fit.sensor.min_distance, 0.1 * width)
    low, height = -1.3 * rise, rise if k % 2 == 0 else -rise
    if place == "above":  # the floor is the lowest vertex
        low = -0.95 * half[axis]
        height = max(height, 0.3 * rise + low)
    radius = (nearest, max(1.1 * level, 1.2 * nearest), max(level, nearest))
    return _on_ring(model, fit, k, sensors, axis, radius, (low, 1.3 * rise, height))


def _flat_mount(model: Model, fit: Fit, k: int, sensors: int, axis: int, place: str) -> str:
    """Return a sensor over a flat part, or under it in turns, where it may stand right above."""
    half = float(np.ptp(model.bounds, axis=0)[axis]) / 2
    nearest = half + max(0.7 * fit.sensor.min_distance, 0.1 * fit.distance)
    farthest = max(0.8 * fit.distance, 1.2 * nearest)
    level, rise = fit.distance * math.cos(_ELEVATION), fit.distance * math.sin(_ELEVATION)
    height = (nearest, farthest, min(max(rise, nearest), farthest))
    on_balance = float(model.areas @ model.normals[:, axis]) / float(model.areas.sum())
    is_under = k % 2 == 1 and place != "above"
    if abs(on_balance) > _ONE_SIDED:
        is_under = on_balance < 0
    if is_under:
        height = (-height[1], -height[0], -height[2])
    return _on_ring(model, fit, k, sensors, axis, (0.0, level, level), height)


def _side_mount(model: Model, fit: Fit, k: int, axis: int, place: str) -> str:
    """Return a sensor before one side of a part that it cannot see whole; each has another side."""
    low, high = model.bounds
    size = float(np.linalg.norm(high - low))
    across = [i for i in range(3) if i != axis]
    sides = [(across[0], 1), (across[1], 1), (across[0], 0), (across[1], 0), (axis, 1), (axis, 0)]
    normal, is_upper = sides[k % (5 if place == "above" else 6)]
    gap = fit.sensor.max_distance - fit.sensor.min_distance
    near, far = fit.sensor.min_distance, fit.sensor.min_distance + 0.8 * gap
    middle = (low + high) / 2
    position = []
    for i in range(3):
        bounds = low[i], high[i], middle[i]
        if i == normal:
            outwards = (near, far, (near + far) / 2)
            bounds = tuple(high[i] + d if is_upper else low[i] - d for d in outwards)
        position.append(_free(*bounds, size))
    aim = [_free(low[i], high[i], middle[i], size) for i in range(3)]
    return _box_mount(k, fit, position, aim)


def _on_ring(
    model: Model,
    fit: Fit,
    k: int,
    sensors: int,
    axis: int,
    radius: tuple[float, float, float],
    height: tuple[float, float, float],
) -> str:
    """Return a sensor on a ring about a part's middle; radius and height by low, high, start."""
    low, high = model.bounds
    middle, reach = (low + high) / 2, _AIM * (high - low)
    size = float(np.linalg.norm(high - low))
    aim = [_free(m - r, m + r, m, size) for m, r in zip(middle, reach, strict=True)]
    return RING_MOUNT_TEXT.format(
        name=f"S{k + 1}",
        sensor=fit.sensor.name,
        axis="xyz"[axis],
        radius=_free(*radius, size),
        angle=f"{360 * k / sensors:.4g}",
        height=_free(*height, size),
        centre=", ".join(number(value, size) for value in middle),
        aim=", ".join(aim),
    )


def _box_mount(k: int, fit: Fit, position: list[str], aim: list[str]) -> str:
    return BOX_MOUNT_TEXT.format(
        name=f"S{k + 1}",
        sensor=fit.sensor.name,
        position=",\n  ".join(position),
        aim=", ".join(aim),
    )


def _free(low: float, high: float, start: float, size: float) -> str:
    """Return a number that may move, in a thing of some size; plain where it has no way to go."""
    low, high = min(low, high), max(low, high)
    texts = [number(value, size) for value in (low, high, start)]
    if texts[0] == texts[1]:
        return texts[2]
    return f"{{ min = {texts[0]}, max = {texts[1]}, start = {texts[2]} }}"


def number(value: float, size: float) -> str:
    """Return a coordinate in a thing of some size, to a thousandth of that or finer."""
    digits = 3 - math.floor(math.log10(size)) if size > 0 else 3
    return trimmed(round(value, digits) + 0.0, digits)
