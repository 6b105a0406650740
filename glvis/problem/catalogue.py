"""The sensors that a study may name without describing them, each number with its source.

They stand in ``sensors.toml``, in the words of a study's table [sensor.NAME], millimetres and
degrees. What nobody has published is absent there, and asked for where it is needed. What makes
a sensor of them is what reads a study's own tables: glvis.study.catalogue_sensors.
"""

from __future__ import annotations

import re
import tomllib
from collections.abc import Collection, Iterable, Mapping
from dataclasses import dataclass, field
from functools import cache
from pathlib import Path
from typing import Any

from glvis.common.hints import command
from glvis.problem.expressions import nearest
from glvis.problem.units import MM_PER_UNIT

Table = Mapping[str, Any]

_FILE = Path(__file__).with_name("sensors.toml")
_ABOUT = ("kind", "maker", "grade", "date", "notes", "price_class", "sources")
_NEEDED = ("resolution", "max_distance")  # of a sensor; the rest has a default or is the lens's
_REFERENCE = re.compile(r"\{([\w-]+)\}")
# Bare names of products that are more than one entry, and which of them are meant.
_TWOFOLD = {
    "d415": "is ambiguous: 'd415-buonamici' is the paper's (66.4 x 39.5 deg, 160 to 350 mm), "
    "'realsense-d415' the maker's sheet",
}


@dataclass(frozen=True)
class Entry:
    """A sensor one can buy, in one mode.

    Attributes
    ----------
    name : str
        As studies name it.
    kind : str
        How it measures, such as "active stereo".
    maker : str
        Whose, and which product.
    grade : str
        "A": the maker's own file was read, or several sources agree; "B": one excerpt, or
        somebody else's numbers that fit the optics.
    date : str
        When the sources were looked at, YYYY-MM-DD.
    table : mapping
        Its numbers in the words of a study's [sensor.NAME]; millimetres and degrees.
    sources : dict of str to str
        Where each number is from, by its key in ``table``, "partner.offset" for an inner one.
    notes : tuple of str
        What else must be known; stated angles among it.
    price_class : str
        "" where it is not known.
    """

    name: str
    kind: str
    maker: str
    grade: str
    date: str
    table: Table
    sources: Mapping[str, str] = field(default_factory=dict)
    notes: tuple[str, ...] = ()
    price_class: str = ""

    @property
    def missing(self) -> tuple[str, ...]:
        """Keys that a study must add, as nobody has published them."""
        return tuple(key for key in _NEEDED if key not in self.table)

    @property
    def lack(self) -> str:
        """What is ``missing`` and where a study gives it, as the end of a sentence; or ""."""
        if not self.missing:
            return ""
        return f"{self.lack_beside(())} in a table [sensor.NAME] with from = '{self.name}'"

    def lack_beside(self, given: Collection[str]) -> str:
        """Return what is ``missing`` but for the keys that are given, in a few words; or ""."""
        lacking = [key for key in self.missing if key not in given]
        if not lacking:
            return ""
        return f"has no {' and '.join(lacking)} in the catalogue; give yours"

    def table_in(self, unit: str) -> dict[str, Any]:
        """Return its table with the lengths in a unit."""
        return scaled(self.table, 1 / MM_PER_UNIT.get(unit, 1.0))

    def source_of(self, key: str) -> str:
        """Return where the number of a key is from, or of the table that it stands in; or ""."""
        return self.sources.get(key) or self.sources.get(key.partition(".")[0], "")


@cache
def entries() -> dict[str, Entry]:
    """Return all sensors of the catalogue by name, in the order of the file."""
    data = tomllib.loads(_FILE.read_text(encoding="utf-8"))
    date, references = data.pop("date"), data.pop("references")
    return {name: _entry(name, table, date, references) for name, table in data.items()}


def find_entry(name: str) -> Entry:
    """Return an entry of the catalogue.

    Raises
    ------
    ValueError
        If there is none of the name, or if it is two.
    """
    found = entries().get(name)
    if found is None:
        raise ValueError(f"sensor '{name}' {complaint(name)}")
    return found


def complaint(name: str, others: Iterable[str] = ()) -> str:
    """Return what is wrong with a name that no sensor has, or with a sensor that lacks a number.

    Parameters
    ----------
    name : str
        As the user wrote it.
    others : iterable of str
        Names beside the catalogue's, such as those of a study's own tables.
    """
    if name in entries():
        return entries()[name].lack
    if name in _TWOFOLD:
        return _TWOFOLD[name]
    hint = _likely(name, [*others, *entries()])
    return f"is unknown{hint}; '{command('sensors')}' lists the catalogue"


def scaled(table: Table, factor: float) -> dict[str, Any]:
    """Return a table of a sensor with all its lengths times a factor.

    Noise is a polynomial in the depth: its coefficient of z^k times factor^(1 - k).
    """
    found = dict(table)
    for key in ("min_distance", "max_distance"):
        if key in found:
            found[key] = found[key] * factor
    if "partner" in found:
        offset = [value * factor for value in found["partner"]["offset"]]
        found["partner"] = {**found["partner"], "offset": offset}
    if "polynomial" in found.get("noise", {}):
        terms = enumerate(found["noise"]["polynomial"])
        polynomial = [value * factor ** (1 - power) for power, value in terms]
        found["noise"] = {**found["noise"], "polynomial": polynomial}
    if "focus" in found:
        lengths = {k: v if k == "f_number" else v * factor for k, v in found["focus"].items()}
        found["focus"] = lengths
    return found


def _entry(name: str, table: Table, date: str, references: Mapping[str, str]) -> Entry:
    """Return an entry of the file; a source may name several keys, and references in braces."""
    sources = {
        key: _REFERENCE.sub(lambda found: references[found[1]], text)
        for keys, text in table["sources"].items()
        for key in keys.split()
    }
    return Entry(
        name,
        table["kind"],
        table["maker"],
        table["grade"],
        table.get("date", date),
        {key: value for key, value in table.items() if key not in _ABOUT},
        sources,
        tuple(table.get("notes", ())),
        table.get("price_class", ""),
    )


def _likely(name: str, known: list[str]) -> str:
    """Return "; did you mean ...?" for what was probably meant, or ""."""
    longer = [one for one in known if f"-{name}-" in f"-{one}-"]
    if longer:
        return f"; did you mean {' or '.join(map(repr, longer[:3]))}?"
    # with other digits it is another product: d415 is no slip of d435
    return nearest(name, [one for one in known if _digits(one) == _digits(name)])


def _digits(name: str) -> str:
    return "".join(filter(str.isdigit, name))
