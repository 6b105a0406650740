"""The command that tells what the catalogue of sensors knows, each number with its source."""

from __future__ import annotations

import json
import math
from typing import TYPE_CHECKING, Annotated, Any

import typer

if TYPE_CHECKING:
    from collections.abc import Iterator

    from glvis.problem.catalogue import Entry
    from glvis.problem.lens import Lens

commands = typer.Typer()

_GRADES = {
    "A": "the maker's own files were read, or several sources agree",
    "B": "one excerpt of the maker's, or others' numbers that fit the optics",
}


@commands.command(epilog="Examples:  glvis sensors  and  glvis sensors realsense-d435")
def sensors(
    name: Annotated[
        str, typer.Argument(metavar="NAME", help="Show all numbers of this one, and their sources.")
    ] = "",
    unit: Annotated[str, typer.Option(help="Of lengths: mm, cm, m, in or ft.")] = "mm",
    as_json: Annotated[bool, typer.Option("--json", help="As data, for programs.")] = False,
) -> None:
    """List the sensors that a study may name, or show one: each number with its source.

    What is not listed of a sensor is not known; a study that needs it asks for it.
    """
    from glvis.cli.terminal import say
    from glvis.errors import StudyError
    from glvis.problem.catalogue import entries, find_entry
    from glvis.problem.units import MM_PER_UNIT

    if unit not in MM_PER_UNIT:
        raise StudyError(f"--unit {unit}: must be one of {', '.join(MM_PER_UNIT)}")
    try:
        chosen = [find_entry(name)] if name else list(entries().values())
    except ValueError as error:
        raise StudyError(str(error)) from None
    if as_json:
        say(_as_json(chosen, unit), to_paste=True)
        return
    for line in _lines_of_one(chosen[0], unit) if name else _lines_of_all(chosen, unit):
        say(line)


def _lines_of_all(chosen: list[Entry], unit: str) -> Iterator[str]:
    """Yield the list, each kind of sensors below its name."""
    from glvis.cli.terminal import table
    from glvis.study.lens_table import lens_of

    header = ["name", "field [deg]", "pixels", f"range [{unit}]", "baseline"]
    has_prices = any(entry.price_class for entry in chosen)
    rows = []
    for entry in chosen:
        own = entry.table_in(unit)
        size = own.get("resolution")
        row = [entry.name, _field(lens_of(own)), f"{size[0]} x {size[1]}" if size else ""]
        row += [_range(own), _baseline(own), *([entry.price_class] if has_prices else [])]
        rows.append(row)
    head, *lines = table([*header, *(["price"] if has_prices else [])], rows)
    yield f"{len(chosen)} sensors; 'glvis sensors NAME' shows one, each number with its source."
    yield head
    for kind in dict.fromkeys(entry.kind for entry in chosen):
        yield ""
        yield f"{kind[0].upper()}{kind[1:]}"
        for entry, line in zip(chosen, lines, strict=True):
            if entry.kind == kind:
                yield line


def _lines_of_one(entry: Entry, unit: str) -> Iterator[str]:
    """Yield all numbers of an entry, each with the number of its source, then the sources."""
    from glvis.cli.terminal import listing
    from glvis.problem.units import unit_word
    from glvis.study.lens_table import lens_of

    yield f"{entry.name}: {entry.kind}, {entry.maker}"
    yield f"Lengths in {unit_word(unit)}, angles in degrees; (1) is the number of its source."
    yield ""
    rows = [
        ("field of view", "", f"{_field(lens_of(entry.table))}, along the middle row and column")
    ]
    places: dict[str, int] = {}
    for key, value in _flat(entry.table_in(unit)):
        source = entry.source_of(key)
        place = f"({places.setdefault(source, len(places) + 1)})" if source else ""
        rows.append((key, place, _value(value)))
    if entry.price_class:
        rows.append(("price class", "", entry.price_class))
    yield from listing(rows)
    yield ""
    yield f"Sources, looked at on {entry.date}; grade {entry.grade}: {_GRADES[entry.grade]}."
    yield from listing([(f"({place})", source) for source, place in places.items()])
    if entry.notes:
        yield ""
        yield "Notes"
        yield from listing([("-", note) for note in entry.notes])
    if entry.missing:
        yield ""
        yield f"{entry.name} {entry.lack}."


def _flat(table: dict[str, Any], above: str = "") -> Iterator[tuple[str, Any]]:
    """Yield the keys and values of a table, those of an inner one by dotted keys."""
    for key, value in table.items():
        if isinstance(value, dict):
            yield from _flat(value, f"{above}{key}.")
        else:
            yield f"{above}{key}", value


def _value(value: Any) -> str:
    """Return a value as a study writes it, numbers with six digits."""
    if isinstance(value, list):
        return f"[{', '.join(map(_value, value))}]"
    return f"{value:.6g}" if isinstance(value, float) else str(value)


def _field(lens: Lens) -> str:
    """Return the opening along the middle row and column: "89.6 x 58.3"."""
    return " x ".join(f"{math.degrees(angle):.3g}" for angle in lens.opening)


def _range(table: dict[str, Any]) -> str:
    low, high = (table.get(key) for key in ("min_distance", "max_distance"))
    if high is None:
        return "" if low is None else f"from {_short(low)}"
    return f"{_short(low or 0)} to {_short(high)}"


def _baseline(table: dict[str, Any]) -> str:
    offset = table.get("partner", {}).get("offset")
    return _short(math.hypot(*offset)) if offset else ""


def _short(length: float) -> str:
    """Return a length with four digits, in full."""
    return f"{length:.4g}" if length < 9999.5 else f"{length:.0f}"


def _as_json(chosen: list[Entry], unit: str) -> str:
    found = [
        {
            "name": entry.name,
            "kind": entry.kind,
            "maker": entry.maker,
            "grade": entry.grade,
            "date": entry.date,
            "unit": unit,
            "sensor": entry.table_in(unit),
            "missing": entry.missing,
            "sources": dict(entry.sources),
            "notes": entry.notes,
            "price_class": entry.price_class or None,
        }
        for entry in chosen
    ]
    return json.dumps(found, indent=2, ensure_ascii=False)
