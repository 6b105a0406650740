"""The sensors of the catalogue, read as the tables of a study are."""

from __future__ import annotations

from functools import cache

from glvis.problem.catalogue import entries, find_entry
from glvis.problem.sensor import Sensor
from glvis.study.sensor_table import SensorTable


def catalogue(unit: str) -> dict[str, Sensor]:
    """Return the sensors that a study may name as they are, all lengths in its unit."""
    return dict(_complete(unit))


def find_sensor(name: str, unit: str) -> Sensor:
    """Return a sensor of the catalogue, all lengths in a study's unit.

    Raises
    ------
    ValueError
        If there is none of the name, if it is two, or if it lacks a number; in one line that
        begins with "sensor 'NAME'".
    """
    entry = find_entry(name)
    if entry.missing:
        raise ValueError(f"sensor '{name}' {entry.lack}")
    return SensorTable.model_validate(entry.table_in(unit)).to_sensor(name)


@cache
def _complete(unit: str) -> dict[str, Sensor]:
    names = [name for name, entry in entries().items() if not entry.missing]
    return {name: find_sensor(name, unit) for name in names}
