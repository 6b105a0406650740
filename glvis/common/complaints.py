"""Complaints in one line of this project's words: key, what it got, what is allowed.

Whatever is quoted from a file is cut here, so that no line is longer than a person reads.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any, TypeVar

from pydantic import BaseModel, ValidationError

Kind = TypeVar("Kind", bound=BaseModel)

# pydantic's kinds of error in the words of this project; the rest keep pydantic's own.
_WORDS = {
    "float_type": "must be a number",
    "int_type": "must be a whole number",
    "int_from_float": "must be a whole number",
    "string_type": "must be a text",
    "bool_type": "must be true or false",
    "list_type": "must be a list",
    "tuple_type": "must be a list",
    "dict_type": "must be a table",
    "model_type": "must be a table",
    "model_attributes_type": "must be a table",
    "finite_number": "must be finite",
    "int_parsing_size": "must be a whole number of at most 4300 digits",
}
_QUOTE, _LINE = 80, 480  # letters of what is quoted, and of a whole line
_TAIL = 180  # of a line that is cut: the fact and the advice stand at its end


def shortened(text: str, most: int = _QUOTE) -> str:
    """Return a text that somebody else wrote, to be quoted: one line, its end cut off if long."""
    text = " ".join(text[: 4 * most].split()) + ("..." if len(text) > 4 * most else "")
    return text if len(text) <= most else f"{text[: most - 3]}..."


def one_line(message: str) -> str:
    """Return a whole message in one line; of a long one, head and end."""
    line = " ".join(message.split())
    if len(line) <= _LINE:
        return line
    return f"{line[: _LINE - _TAIL - 5]} ... {line[-_TAIL:]}"


def first_error(error: ValidationError, data: Mapping[str, Any]) -> str:
    """Return the first of pydantic's complaints in one line: key, what it got, what is allowed.

    Parameters
    ----------
    error : ValidationError
        Of ``StudyTable``.
    data : dict
        What was checked; mounts are named from it.
    """
    found = error.errors(include_url=False)[0]
    where, key = located(found["loc"], data)
    kind, got = found["type"], found["input"]
    if kind == "missing":
        table = {"scene": "[scene]", "mount": "[[mount]]"}.get(key)
        return f"{table} is missing" if table and not where else f"{where}'{key}' is missing"
    context = found.get("ctx", {})
    if kind == "value_error":
        text = str(context["error"])
        if isinstance(got, dict | BaseModel):  # the table as a whole
            return f"{where}{key}: {text}" if key else f"{where}{text}"
    elif kind == "literal_error":
        text = f"must be {context['expected']}"
    else:
        text = _WORDS.get(kind, found["msg"])
    if not key:
        return f"{where}{text}, got {as_toml(got)}"
    return f"{where}{key} = {as_toml(got)} {text}"


def located(loc: tuple[str | int, ...], data: Mapping[str, Any]) -> tuple[str, str]:
    """Return the header, as "[sensor.eye] ", and the key, as "resolution[0]", of a place."""
    path = [part for part in loc if not str(part).startswith("<")]
    header = ""
    top = data.get(str(path[0])) if path else None
    if path[:1] == ["mount"] and isinstance(top, list) and len(path) > 1:
        mount = top[int(path[1])]
        name = mount.get("name") if isinstance(mount, dict) else None
        label = f"'{shortened(name)}'" if isinstance(name, str) else f"number {int(path[1]) + 1}"
        header, path = f"[[mount]] {label} ", path[2:]
    elif isinstance(top, dict):
        header, path = f"[{path[0]}] ", path[1:]
        if header == "[sensor] " and path and isinstance(top.get(str(path[0])), dict):
            header, path = f"[sensor.{shortened(str(path[0]))}] ", path[1:]
    return header, _dotted(path)


def checked(kind: type[Kind], value: Any) -> Kind:
    """Return a JSON value as a record of some kind.

    Raises
    ------
    ValueError
        Of the first thing that is wrong: key, what it got, what is allowed.
    """
    try:
        return kind.model_validate(value)
    except ValidationError as error:
        raise ValueError(_first_json_error(error)) from None


def _first_json_error(error: ValidationError) -> str:
    """Return the first of pydantic's complaints about a JSON file in one line."""
    found = error.errors(include_url=False)[0]
    key = _dotted(found["loc"]) or "it"
    if found["type"] == "missing":
        return f"{key} is missing"
    context = found.get("ctx", {})
    text = str(context["error"]) if found["type"] == "value_error" else found["msg"].lower()
    return f"{key} = {as_toml(found['input'])} {_WORDS.get(found['type'], text)}"


def _dotted(path: Sequence[str | int]) -> str:
    """Return "a.b[0]" of keys and places in lists."""
    key = "".join(f"[{part}]" if isinstance(part, int) else f".{part}" for part in path)
    return shortened(key.removeprefix("."))


def as_toml(value: Any) -> str:
    """Return a value as the file spells it, shortened where it is long."""
    match value:
        case bool():
            text = str(value).lower()
        case str():
            text = f"'{value}'"
        case list() | tuple():
            text = f"[{', '.join(map(as_toml, value))}]"
        case dict():
            text = "{ " + ", ".join(f"{k} = {as_toml(v)}" for k, v in value.items()) + " }"
        case _:
            text = str(value)
    return shortened(text)
