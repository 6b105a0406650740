"""The list of all keys is whole, and its defaults are those that studies get."""

import pytest

from glvis.cli.app import main
from glvis.errors import StudyError
from glvis.problem.search_options import METHODS
from glvis.problem.units import MM_PER_UNIT
from glvis.study import schema
from glvis.study.keys import KEY_TABLES, tables_about
from glvis.study.overrides import toml_text
from glvis.study.table import Table

# Keys of a study that are tables, under which name each stands in the list.
TABLES = {"scene": "[scene]", "sensor": "[sensor.NAME]", "visibility": "[visibility]"}
TABLES |= {"variables": "[variables]", "mount": "[[mount]]", "objective": "[objective]"}
TABLES |= {"swarm": "[swarm]", "search": "[search]", "vary": "[vary]"}


def tables_below(kind: type[Table]) -> list[type[Table]]:
    """Return the kinds of tables that no other kind is derived from."""
    return [t for one in kind.__subclasses__() for t in tables_below(one) or [one]]


def test_every_table_of_the_schema_is_listed():
    listed = {table.schema for table in KEY_TABLES if table.schema}
    assert listed == set(tables_below(Table))


@pytest.mark.parametrize("table", [t for t in KEY_TABLES if t.schema], ids=lambda t: t.name)
def test_every_key_of_a_table_is_listed(table):
    known = set(table.schema.fields_by_key())
    if table.schema is schema.StudyTable:
        assert known >= set(TABLES)
        known -= set(TABLES)
    assert set(table.meanings) == known
    assert all(table.meanings.values())


def test_every_table_of_a_study_has_its_own_list():
    assert set(TABLES.values()) <= {table.name for table in KEY_TABLES}


def test_defaults_are_those_of_the_schema():
    told = {(table.name, key): default for table in KEY_TABLES for key, default, _ in table.rows()}
    assert told["[scene]", "models"] == "needed"
    assert told["[sensor.NAME]", "lens"] == '"pinhole"'
    assert told["focus", "f_number"] == "needed"
    assert told["[objective]", "by_area"] == toml_text(schema.ObjectiveTable().by_area) == "true"
    assert told["[search]", "method"] == '"auto"'
    assert told["[swarm]", "particles"] == "300"
    assert told["[swarm]", "objective_limit"] == ""


@pytest.mark.parametrize(
    ("name", "key", "words"),
    [
        ("[search]", "method", METHODS),
        ("[objective]", "kind", ("of1", "of2", "of3")),
        ("a study", "unit", tuple(MM_PER_UNIT)),
    ],
)
def test_every_choice_is_named(name, key, words):
    (table,) = [table for table in KEY_TABLES if table.name == name]
    assert [word for word in words if word not in table.meanings[key]] == []


@pytest.mark.parametrize(
    ("word", "names"),
    [
        ("objective", ["[objective]"]),
        ("sensor", ["[sensor.NAME]"]),
        ("overlap", ["[objective]"]),
        ("max_seconds", ["[search]", "[swarm]"]),
    ],
)
def test_a_table_is_found_by_its_name_or_by_its_keys(word, names):
    assert [table.name for table in tables_about(word)] == names


def test_what_is_no_key_is_refused_with_the_nearest():
    with pytest.raises(StudyError, match="no key 'overlapp' in a study; did you mean 'overlap'"):
        tables_about("overlapp")


def test_the_list_is_printed(capsys):
    assert main(["keys"]) == 0
    out = capsys.readouterr().out
    for key in ("by_area", "aggregate", "cvar_fraction", "overlap", "min_pixels", "scale"):
        assert f"\n  {key} " in out
    assert max(len(line) for line in out.splitlines() if line.startswith("  ")) <= 100
