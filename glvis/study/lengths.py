"""Lengths with a unit of their own, such as "200 mm", in the unit of a study."""

from __future__ import annotations

import math
import re
from typing import Any

from glvis.problem.units import MM_PER_UNIT

_LENGTH = re.compile(r"([-+]?[0-9.]+(?:[eE][-+]?[0-9]+)?)\s*([a-z]+)")
# Tables with lengths, and keys in them that are none: names and files, pixels and shares.
_OTHER: dict[str, tuple[str, ...]] = {
    "scene": ("models", "obstacles", "assembly"),
    "sensor": (
        "from", "calibration", "lens", "role", "emits", "resolution", "focal_px", "centre_px",
        "distortion", "subpixel", "polynomial", "f_number", "cost",
    ),
    "variables": (),
    "mount": ("name", "sensor"),
}  # fmt: skip


def length_in(unit: str, text: str) -> float | None:
    """Return a length such as "200 mm" in another unit, None where the text is no length."""
    found = _LENGTH.fullmatch(text.strip())
    if not found or found[2] not in MM_PER_UNIT:
        return None
    try:
        value = float(found[1]) * MM_PER_UNIT[found[2]] / MM_PER_UNIT[unit]
    except ValueError:
        return None
    return value if math.isfinite(value) else None


def with_plain_lengths(data: dict[str, Any]) -> dict[str, Any]:
    """Return the tables of a study with each length that has its own unit as a plain number.

    Parameters
    ----------
    data : dict
        As TOML reads it, not yet checked; left as it is.
    """
    unit = data.get("unit", "mm")
    if not isinstance(unit, str) or unit not in MM_PER_UNIT:
        return data
    return {
        table: _plain(value, unit, table) if table in _OTHER else value
        for table, value in data.items()
    }


def may_be_length(table: str, key: str) -> bool:
    """Return whether a key somewhere in a table of a study may have a unit of its own."""
    return not key.endswith("_deg") and key not in _OTHER[table]


def _plain(node: Any, unit: str, table: str) -> Any:
    if isinstance(node, list):
        return [_plain(entry, unit, table) for entry in node]
    if isinstance(node, dict):  # which may be a sensor that is called as a key is
        return {
            key: _plain(value, unit, table)
            if may_be_length(table, key) or (isinstance(value, dict) and key in _OTHER[table])
            else value
            for key, value in node.items()
        }
    if isinstance(node, str):
        length = length_in(unit, node)
        return node if length is None else length
    return node
