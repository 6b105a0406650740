"""The study file's format as a JSON schema, from which editors complete, explain and check.

Keys, types and defaults come from ``schema.py``, the words from ``keys.py``. What pydantic writes
is for JSON; a study is TOML, which has no null, and may give a length a unit of its own.
"""

from __future__ import annotations

import json
from typing import Any

from glvis.problem.units import MM_PER_UNIT
from glvis.study.keys import KEY_TABLES
from glvis.study.lengths import may_be_length
from glvis.study.schema import FreeTable, MirrorTable, StudyTable
from glvis.study.sensor_table import FocusTable, PartnerTable, SensorTable

SCHEMA_FILE = "study.schema.json"  # beside a study, which names it in its first line
DIRECTIVE = f"#:schema {SCHEMA_FILE}"  # as Taplo, and with it Even Better TOML, reads it
_NUMBER, _NULL = {"type": "number"}, {"type": "null"}
_LENGTH = {
    "type": "string",
    "pattern": rf"^\s*[-+]?[0-9.]+([eE][-+]?[0-9]+)?\s*({'|'.join(MM_PER_UNIT)})\s*$",
}
# Which tables take lengths, and within which of a study's; others take a text for a number.
_WITH_LENGTHS = {
    FreeTable: "mount", MirrorTable: "mount", SensorTable: "sensor", PartnerTable: "sensor",
    FocusTable: "sensor",
}  # fmt: skip


def study_schema() -> dict[str, Any]:
    """Return the JSON schema of a study file, draft 7.

    It knows the keys, their types, choices, defaults and meanings. Ranges, and what keys mean
    together, are known to ``load_study`` alone.
    """
    found = StudyTable.model_json_schema()
    tables = found["$defs"] | {StudyTable.__name__: found}
    for table in KEY_TABLES:
        if table.schema:
            definition = tables[table.schema.__name__]
            definition["description"] = table.about
            for key, meaning in table.meanings.items():
                definition["properties"][key]["description"] = meaning
        else:
            found["properties"][table.name.strip("[]")]["description"] = table.about
    found["description"] = "A study of glvis: where to put cameras and depth sensors."
    for kind, table_name in _WITH_LENGTHS.items():
        properties = tables[kind.__name__]["properties"]
        for key, value in properties.items():
            properties[key] = _or_length(value) if may_be_length(table_name, key) else value
    head = {"$schema": "http://json-schema.org/draft-07/schema#", "title": "glvis study"}
    return head | _for_toml(found)


def schema_text() -> str:
    """Return the JSON schema of a study file as the text of a file."""
    return json.dumps(study_schema(), indent=2) + "\n"


def _or_length(node: Any) -> Any:
    """Return a schema whose numbers may also be lengths with a unit."""
    if isinstance(node, list):
        return [_or_length(part) for part in node]
    if not isinstance(node, dict):
        return node
    if node.get("type") == "number":
        return {k: v for k, v in node.items() if k != "type"} | {"anyOf": [_NUMBER, _LENGTH]}
    return {key: _or_length(value) for key, value in node.items()}


def _for_toml(node: Any) -> Any:
    """Return a schema without nulls, defaults of whole tables and titles that repeat a key."""
    if isinstance(node, list):
        return [_for_toml(part) for part in node]
    if not isinstance(node, dict):
        return node
    kept = {
        key: {name: _for_toml(value) for name, value in part.items()}
        if key in ("properties", "$defs")
        else _for_toml(part)
        for key, part in node.items()
        if key != "title" and not (key == "default" and isinstance(part, dict | None))
    }
    choices = [choice for choice in kept.get("anyOf", ()) if choice != _NULL]
    if len(choices) == 1:
        del kept["anyOf"]
        return choices[0] | kept
    return kept | ({"anyOf": choices} if choices else {})
