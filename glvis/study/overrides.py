"""Values from the command line in place of the study file's, and the file as it was run.

The user's comments and order stay: the text that a result keeps is the file with the few
changed values written in.
"""

from __future__ import annotations

import copy
import json
import re
import tomllib
from collections.abc import Iterator, Mapping, Sequence
from typing import Any

import tomlkit
from tomlkit.items import Array as TomlArray

from glvis.common.complaints import shortened
from glvis.common.files import toml_tables
from glvis.errors import StudyError
from glvis.problem.catalogue import complaint, entries, find_entry
from glvis.problem.expressions import nearest
from glvis.study.schema import StudyTable

# Values by the keys (and places in lists) that lead to them.
Changes = dict[tuple[str | int, ...], Any]

REMOVED = object()  # as a value of Changes: what is there goes
MOUNTS = "mounts"  # no key of a study: how many of its mounts stay

# Tables that a file may leave out and an override may open.
_TABLES = ("scene", "visibility", "objective", "swarm", "search", "vary")
_SENSOR_PARTS = ("partner", "noise", "focus")  # tables of a sensor
_BARE = re.compile(r"[A-Za-z0-9_-]+")
_MOST_EDITED = 30_000  # letters; the time that tomlkit takes may grow with their square
_NAME = re.compile(r"[^\W\d]\w*")
_STAR = re.compile(r"(?<![^.])\*(?![^.])")  # a whole part of a dotted key


def overridden(data: dict[str, Any], overrides: Sequence[str]) -> tuple[dict[str, Any], Changes]:
    """Return the tables of a study with some values replaced, and what was replaced.

    Parameters
    ----------
    data : dict
        The file as TOML reads it; left as it is.
    overrides : sequence of str
        "swarm.particles=100", "mount.A1.roll_deg.start=5", "sensor.eye.max_distance=400".
        Mounts go by their name, all of them by "mount.*.sensor". Values are TOML, or else text
        as it stands. "mounts=3" keeps the first three mounts, and drops the variables that only
        the others used.

    Raises
    ------
    StudyError
        If one has no "=", leads to a table that is not there, or keeps more mounts than there
        are.
    """
    data = copy.deepcopy(data)
    changes: Changes = {}
    for text in overrides:
        key, equals, value = text.partition("=")
        try:
            if not equals:
                raise StudyError("must have the form KEY=VALUE")
            if key.strip() == MOUNTS:
                found: Changes = dict.fromkeys(_beyond(toml_value(value), data), REMOVED)
            else:
                found = {
                    _path(parts, data, changes): toml_value(value)
                    for parts in _each_mount(_parts(key.strip()), data)
                }
        except StudyError as error:
            raise StudyError(f"override '{shortened(text)}' {error}") from None
        for path, new in found.items():
            changes.pop(path, None)  # the order of changes is that of the overrides
            changes[path] = new
            _assign(data, path, new)
    return data, changes


def written(source: str, changes: Changes) -> str:
    """Return TOML text with some values replaced and all its comments kept."""
    plain = toml_tables(source)
    for path, value in changes.items():
        _assign(plain, path, value)
    if len(source) > _MOST_EDITED:
        return _plain_toml(plain)
    try:
        document = tomlkit.parse(source)
        for path, value in changes.items():
            _assign(document, path, _item(path, value))
        text = tomlkit.dumps(document)
        if tomllib.loads(text) == plain:
            return text
    except ValueError:
        pass
    # tomlkit cannot edit every way of writing tables; then the values matter more than the
    # comments.
    return _plain_toml(plain)


def toml_value(text: str) -> Any:
    """Return a value as TOML reads it, or the text itself."""
    text = text.strip()
    try:
        found = toml_tables(f"value = {text}")
    except ValueError:
        return text
    return found["value"] if len(found) == 1 else text


def _beyond(count: Any, data: dict[str, Any]) -> Iterator[tuple[str | int, ...]]:
    """Yield what goes where the first ``count`` mounts stay: mounts, variables they alone used."""
    mounts, variables = data.get("mount"), data.get("variables", {})
    if not isinstance(mounts, list) or not isinstance(variables, dict):
        raise StudyError("finds no list of mounts")
    if isinstance(count, bool) or not isinstance(count, int) or not 1 <= count <= len(mounts):
        raise StudyError(
            f"must be a whole number from 1 to {len(mounts)}, the study's mounts "
            "([[mount]] tables; a mirror goes with its mount)"
        )
    for place in reversed(range(count, len(mounts))):  # from the end: the others keep theirs
        yield "mount", place
    still = _used(mounts[:count], variables)
    for name in sorted(_used(mounts[count:], variables) - still):
        yield "variables", name


def _used(node: Any, variables: Mapping[str, Any]) -> set[str]:
    """Return the variables that texts in nested tables name, and those that these name."""
    if isinstance(node, dict | list):
        parts = node.values() if isinstance(node, dict) else node
        return set().union(*(_used(part, variables) for part in parts))
    names = set(_NAME.findall(node)) & {*variables} if isinstance(node, str) else set()
    others = {name: value for name, value in variables.items() if name not in names}
    return names.union(*(_used(variables[name], others) for name in names))


def _each_mount(parts: list[str], data: Mapping[str, Any]) -> list[list[str]]:
    """Return a dotted key, or one a mount where "*" stands in place of its name."""
    if "*" not in parts:
        return [parts]
    mounts = data.get("mount")
    if parts[:2] != ["mount", "*"] or len(parts) < 3 or not isinstance(mounts, list):
        raise StudyError("has a '*' that stands for no mounts; it is for mount.*.KEY")
    names = [mount.get("name") if isinstance(mount, dict) else None for mount in mounts]
    return [["mount", str(name), *parts[2:]] for name in names]


def _path(parts: list[str], data: dict[str, Any], changes: Changes) -> tuple[str | int, ...]:
    """Return the keys and list places that lead to a value; a missing table may be opened."""
    if parts[0] not in StudyTable.model_fields:
        known = shortened(parts[0])
        raise StudyError(f"is unknown: there is no '{known}' in a study{_hint(parts[0])}")
    path: list[str | int] = []
    node: Any = data
    for depth, part in enumerate(parts):
        is_last = depth == len(parts) - 1
        above = shortened(".".join(map(str, parts[:depth])))
        if isinstance(node, list):
            place = _place(part, node, above)
            path.append(place)
            node = node[place]
            continue
        if not isinstance(node, dict):
            raise StudyError(f"leads nowhere: '{above}' is no table")
        path.append(part)
        if part not in node:
            if is_last and above != "variables":
                break  # the schema knows which keys there are
            if depth == 0 and part in _TABLES:
                node[part] = {}
            elif parts[0] == "sensor" and depth <= 1:
                _open_sensor(parts, data, changes)
            elif parts[0] == "sensor" and depth == 2 and _has_part(node, part):
                _open_part(parts, data, changes)
            else:
                raise StudyError(
                    f"is unknown: there is no '{shortened(part)}' in {above or 'it'}"
                    f"{nearest(part, node)}"
                )
        node = node[part]
    return tuple(path)


def _parts(key: str) -> list[str]:
    """Return the names of a dotted key; a name with a dot in it stands in quotes, "*" need not."""
    plain = _STAR.sub('"*"', key)
    try:
        node: Any = toml_tables(f"{plain} = 0")
    except ValueError:
        raise StudyError(f"has no key that TOML could read: '{shortened(key)}'") from None
    parts = []
    while isinstance(node, dict):
        ((part, node),) = node.items()
        parts.append(part)
    return parts


def _place(part: str, entries: list[Any], above: str) -> int:
    """Return the place in a list, by name (of a mount) or by number from 0."""
    names = [entry.get("name") if isinstance(entry, dict) else None for entry in entries]
    if part in names:
        return names.index(part)
    if part.isdecimal() and int(part) < len(entries):
        return int(part)
    known = [str(name) for name in names if name is not None]
    choice = shortened(", ".join(known)) or f"0 to {len(entries) - 1}"
    raise StudyError(f"is unknown: there is no '{shortened(part)}' in {above}; there are {choice}")


def _open_sensor(parts: Sequence[str], data: dict[str, Any], changes: Changes) -> None:
    """Write a catalogue sensor into the study, so that one of its values can be changed."""
    sensors = data.setdefault("sensor", {})
    if len(parts) < 2 or parts[1] in sensors:
        return
    name = parts[1]
    if name not in entries():
        raise StudyError(f"leads nowhere: sensor '{shortened(name)}' {complaint(name, sensors)}")
    sensors[name] = {"from": name}
    changes["sensor", name] = {"from": name}


def _has_part(sensor: Mapping[str, Any], part: str) -> bool:
    """Return whether a part that a table of a sensor has not may be opened to set one in it."""
    return part in _SENSOR_PARTS or (part == "resolution" and "from" in sensor)


def _open_part(parts: Sequence[str], data: dict[str, Any], changes: Changes) -> None:
    """Write a part of a sensor into it: that of its entry of the catalogue, or an empty table."""
    sensor, unit = data["sensor"][parts[1]], data.get("unit", "mm")
    entry = sensor.get("from")
    found: Any = {}
    if isinstance(entry, str) and isinstance(unit, str):
        try:
            found = find_entry(entry).table_in(unit).get(parts[2], {})
        except ValueError as error:
            raise StudyError(f"needs an entry of the catalogue: {error}") from None
    sensor[parts[2]] = copy.deepcopy(found)
    changes["sensor", parts[1], parts[2]] = copy.deepcopy(found)


def _hint(name: str) -> str:
    """Return what was meant by a key that is none: one of the tables', or the nearest."""
    for table, field in StudyTable.model_fields.items():
        if name in getattr(field.annotation, "model_fields", {}):  # of tables alone
            return f"; did you mean '{table}.{name}'?"
    return nearest(name, StudyTable.model_fields)


def _item(path: Sequence[str | int], value: Any) -> Any:
    """Return a value as tomlkit is to write it."""
    if isinstance(value, dict) and path[0] == "sensor" and len(path) == 2:
        table = tomlkit.table()
        table.update({key: tomlkit.value(toml_text(entry)) for key, entry in value.items()})
        table.add(tomlkit.nl())
        return table
    if value is REMOVED:
        return value
    item = tomlkit.value(toml_text(value))
    if isinstance(item, TomlArray) and sum(len(str(entry)) for entry in item) > 80:
        item.multiline(True)
    return item


def toml_text(value: Any) -> str:
    """Return a value in TOML on one line, tables in braces."""
    if not isinstance(value, dict):
        return tomlkit.item(value).as_string()
    pairs = (f"{tomlkit.key(key).as_string()} = {toml_text(v)}" for key, v in value.items())
    return "{ " + ", ".join(pairs) + " }"


def _plain_toml(tables: Mapping[str, Any], above: str = "") -> str:
    """Return nested tables as TOML text, values first and then the tables of each table."""
    lines, inner = [], []
    for name, value in tables.items():
        key = name if _BARE.fullmatch(name) else _plain_value(name)
        if isinstance(value, dict):
            inner.append(f"\n[{above}{key}]\n{_plain_toml(value, f'{above}{key}.')}")
        elif isinstance(value, list) and value and all(isinstance(v, dict) for v in value):
            inner += [f"\n[[{above}{key}]]\n{_plain_toml(v, f'{above}{key}.')}" for v in value]
        else:
            lines.append(f"{key} = {_plain_value(value)}\n")
    return "".join([*lines, *inner])


def _plain_value(value: Any) -> str:
    """Return a value as TOML, whatever a file can hold."""
    match value:
        case bool():
            return str(value).lower()
        case str():  # JSON writes texts as TOML does, but for one control
            return json.dumps(value, ensure_ascii=False).replace("\x7f", "\\u007f")
        case list():
            return f"[{', '.join(map(_plain_value, value))}]"
        case dict():
            pairs = (f"{_plain_value(key)} = {_plain_value(v)}" for key, v in value.items())
            return f"{{ {', '.join(pairs)} }}"
    return value.isoformat() if hasattr(value, "isoformat") else str(value)


def _assign(node: Any, path: Sequence[str | int], value: Any) -> None:
    """Set, or remove, a value in nested tables, of plain dicts or of tomlkit."""
    for part in path[:-1]:
        if isinstance(node, dict) and part not in node:
            node[part] = {}
        node = node[part]
    if value is not REMOVED:
        node[path[-1]] = copy.deepcopy(value)
    elif isinstance(node, dict):
        node.pop(path[-1], None)
    else:
        del node[path[-1]]
