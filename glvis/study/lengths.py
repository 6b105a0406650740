"""Lengths with a unit of their own, such as "200 mm", in the unit of a study."""

from __future__ import annotations

import math
import re
from typing import Any

from glvis.problem.units import MM_PER_UNIT

_LENGTH = re.compile(r"([-+]?[0-9.]+(?:[eE][-+]?[0-9]+)?)\s*([a-z]+)")
# Tables with lengths, and keys in them whose texts mean something else.
_TABLES = ("scene", "sensor", "variables", "mount")
_OTHER = ("name", "sensor", "models", "obstacles")


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
    return {key: _plain(value, unit) if key in _TABLES else value for key, value in data.items()}


def _plain(node: Any, unit: str) -> Any:
    if isinstance(node, list):
        return [_plain(entry, unit) for entry in node]
    if isinstance(node, dict):
        return {
            key: value if _is_no_length(key, value) else _plain(value, unit)
            for key, value in node.items()
        }
    if isinstance(node, str):
        length = length_in(unit, node)
        return node if length is None else length
    return node


def _is_no_length(key: str, value: Any) -> bool:
    return key.endswith("_deg") or (key in _OTHER and not isinstance(value, dict))
