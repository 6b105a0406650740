"""Units of length and the axis that is up: what formats say of them, and when to doubt them."""

from __future__ import annotations

import math
import re
import zipfile
from collections.abc import Sequence
from pathlib import Path

MM_PER_UNIT = {"mm": 1.0, "cm": 10.0, "m": 1000.0, "in": 25.4, "inch": 25.4, "ft": 304.8}
# 3MF core specification, 3.4: what the attribute "unit" of a model may be.
_MM_PER_3MF_UNIT = {
    "micron": 0.001,
    "millimeter": 1.0,
    "centimeter": 10.0,
    "inch": 25.4,
    "foot": 304.8,
    "meter": 1000.0,
}
_IMPERIAL = ("in", "inch", "ft")
_FEW_MICROMETRES = 0.02  # millimetres below which these are told in micrometres
UPS = {"x": [1.0, 0.0, 0.0], "y": [0.0, 1.0, 0.0], "z": [0.0, 0.0, 1.0]}
_ROOT_3MF = re.compile(r"<(?:\w+:)?model\b[^>]*?\bunit\s*=\s*[\"'](\w+)[\"']")
_HEAD = 1 << 16  # bytes of a 3MF's model in which its first element stands
# Diagonals of what people put sensors around, millimetres: outside of the first the unit is in
# doubt, inside of the second another one is worth naming.
_PLAUSIBLE = (10.0, 100e3)
_LIKELY = (30.0, 30e3)
_MANY_METRES = 3.0
_LIKELY_UNITS = {"m": "metres", "in": "inches", "mm": "millimetres"}


def mm_per_own_unit(path: Path) -> float | None:
    """Return the millimetres a unit of a file's numbers; None where its format does not say.

    glTF is in metres, 3MF in the unit that it names.
    """
    suffix = path.suffix.lower()
    if suffix == ".glb":
        return MM_PER_UNIT["m"]
    return _mm_per_3mf_unit(path) if suffix == ".3mf" else None


def own_scale(path: Path, unit: str) -> float:
    """Return the factor from a file's numbers to a unit; 1 where its format does not say."""
    millimetres = mm_per_own_unit(path)
    return 1.0 if millimetres is None else millimetres / MM_PER_UNIT[unit]


def own_up(paths: Sequence[Path]) -> str:
    """Return the axis that is up in some files: "y" in glTF, which says so, else "z"."""
    return "y" if paths and all(path.suffix.lower() == ".glb" for path in paths) else "z"


def unit_guess(size: float, unit: str) -> list[str]:
    """Return units that a size makes more likely than its own, likeliest first; none if not odd.

    Parameters
    ----------
    size : float
        Diagonal of a thing, in ``unit``.
    unit : str
        That it is said to be in.
    """
    least, most = _PLAUSIBLE
    if least <= size * MM_PER_UNIT[unit] <= most:
        return []
    least, most = _LIKELY
    found = [other for other in _LIKELY_UNITS if least <= size * MM_PER_UNIT[other] <= most]
    # five inches are a usual part; a thing of five metres seldom comes as STL
    return sorted(found, key="in".__ne__) if size >= _MANY_METRES else found


def guess_words(size: float, guess: Sequence[str]) -> str:
    """Return a question: "are these inches (146 mm) or metres (5.76 m)?"."""
    told = [f"{_LIKELY_UNITS[unit]} ({_length(size * MM_PER_UNIT[unit])})" for unit in guess]
    return f"are these {' or '.join(told)}?"


def unit_words(unit: str) -> str:
    """Return a unit that a guess may name in full: "metres"."""
    return _LIKELY_UNITS[unit]


def short(value: float) -> str:
    """Return a number with three digits, in full: "2000", "0.00173"."""
    if value == 0 or not math.isfinite(value):
        return "0"
    digits = 2 - math.floor(math.log10(abs(value)))
    return trimmed(round(value, digits), digits)


def trimmed(value: float, digits: int) -> str:
    """Return a number with at most so many decimals, none of them a zero at the end."""
    text = f"{value:.{max(0, digits)}f}"
    return text.rstrip("0").rstrip(".") if "." in text else text


def _length(millimetres: float) -> str:
    metres = millimetres / 1000
    return f"{short(metres)} m" if millimetres > 999 else f"{short(millimetres)} mm"


def _mm_per_3mf_unit(path: Path) -> float:
    """Return the millimetres a unit of a 3MF; a broken one is for its reader to refuse."""
    millimetres = _MM_PER_3MF_UNIT["millimeter"]  # the specification's default
    try:
        with zipfile.ZipFile(path) as archive:
            model = next(n for n in archive.namelist() if "3d/3dmodel.model" in n.lower())
            with archive.open(model) as file:
                found = _ROOT_3MF.search(file.read(_HEAD).decode("utf-8", errors="replace"))
    except Exception:  # zip and its methods fail in ways of their own, zlib.error among them
        return millimetres
    return _MM_PER_3MF_UNIT.get(found[1], millimetres) if found else millimetres


def unit_word(unit: str) -> str:
    """Return a unit as it stands in a sentence: "mm", but "inches", as "in" reads as a word."""
    return "inches" if unit in ("in", "inch") else unit


def fine_unit(length: float, unit: str) -> tuple[float, str]:
    """Return the unit that suits a small length, and the factor from another one to it.

    Parameters
    ----------
    length : float
        Of the kind to be told, in ``unit``.
    unit : str
        Of the study. Metric ones give way to µm, mm or m, feet to inches.
    """
    if unit in _IMPERIAL:
        return MM_PER_UNIT[unit] / MM_PER_UNIT["in"], "in"
    if unit not in MM_PER_UNIT:
        return 1.0, unit
    millimetres = MM_PER_UNIT[unit] * length
    if millimetres < _FEW_MICROMETRES:
        return 1000 * MM_PER_UNIT[unit], "µm"
    if millimetres < MM_PER_UNIT["m"]:
        return MM_PER_UNIT[unit], "mm"
    return MM_PER_UNIT[unit] / MM_PER_UNIT["m"], "m"
