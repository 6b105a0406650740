"""The schema that editors read is one, takes what studies may hold, and lies where they look."""

import itertools
import json
import tomllib
from pathlib import Path

import jsonschema
import pytest

from glvis.cli.app import main
from glvis.study.json_schema import DIRECTIVE, SCHEMA_FILE, schema_text, study_schema
from glvis.study.loading import load_study
from glvis.study.starter import EXAMPLES, write_starter

SCENES = Path(__file__).resolve().parents[1] / "scenes"
SCHEMA = jsonschema.Draft7Validator(study_schema())


def complaints(text: str) -> list[str]:
    """Return what an editor would say of a study."""
    return [error.message for error in SCHEMA.iter_errors(tomllib.loads(text))]


def test_it_is_a_schema_of_draft_7():
    jsonschema.Draft7Validator.check_schema(study_schema())


def test_it_speaks_of_no_null_since_toml_has_none():
    assert "null" not in schema_text()


@pytest.mark.parametrize("path", sorted(SCENES.glob("*.toml")), ids=lambda path: path.stem)
def test_shipped_studies_follow_it_and_name_it_in_their_first_line(path):
    text = path.read_text(encoding="utf-8")
    assert complaints(text) == []
    assert text.startswith(f"{DIRECTIVE}\n#")


def test_the_schema_beside_the_shipped_studies_is_the_one_that_is_printed(capsys):
    assert main(["schema"]) == 0
    printed = capsys.readouterr().out
    assert json.loads(printed) == study_schema()
    told = f"glvis schema -o scenes/{SCHEMA_FILE} makes it anew"
    assert (SCENES / SCHEMA_FILE).read_text(encoding="utf-8") == printed, told


def test_it_is_written_into_a_file(tmp_path, capsys):
    path = tmp_path / SCHEMA_FILE
    assert main(["schema", "-o", str(path)]) == 0
    assert path.read_text(encoding="utf-8") == schema_text()
    assert str(path) in capsys.readouterr().out


def test_a_file_that_cannot_be_written_is_one_line(tmp_path, capsys):
    path = tmp_path / "gone" / "a.json"
    assert main(["schema", "-o", str(path)]) == 1
    assert capsys.readouterr().err.startswith(f"error: {path}: cannot be written to: ")


def test_it_takes_the_place_of_no_study(tmp_path, capsys):
    path = write_starter(tmp_path, example="arm")
    before = path.read_bytes()
    assert main(["schema", "-o", str(path)]) == 2
    assert capsys.readouterr().err == (
        f"error: -o {path}: must end in .json, as study.schema.json\n"
    )
    assert path.read_bytes() == before


@pytest.mark.parametrize("example", EXAMPLES)
def test_a_first_study_follows_the_schema_that_lies_beside_it(tmp_path, example):
    text = write_starter(tmp_path, example=example).read_text(encoding="utf-8")
    assert complaints(text) == []
    first, _, _ = text.partition("\n")
    assert first == f"#:schema {SCHEMA_FILE}"
    assert (tmp_path / SCHEMA_FILE).read_text(encoding="utf-8") == schema_text()


def test_a_study_as_run_names_the_schema_where_it_lies(tmp_path):
    study = load_study(write_starter(tmp_path, example="arm"), ["swarm.seed=2"])
    first, _, rest = study.text.partition("\n")
    assert first == f"#:schema {tmp_path.resolve() / SCHEMA_FILE}"
    assert "#:schema" not in rest
    (tmp_path / "elsewhere").mkdir()
    again = tmp_path / "elsewhere" / "study.toml"
    again.write_text(study.text, encoding="utf-8")
    assert load_study(again).text == study.text


@pytest.mark.parametrize("line", ["#:schema https://x.org/study.json", "# a comment: a:b"])
def test_other_first_lines_stay_as_they_are(tmp_path, line):
    path = write_starter(tmp_path, example="arm")
    text = path.read_text(encoding="utf-8").replace(DIRECTIVE, line)
    path.write_text(text, encoding="utf-8")
    assert load_study(path).text.startswith(f"{line}\n")


@pytest.mark.parametrize(
    "line",
    [
        'sensor.eye = { hfov_deg = 60, vfov_deg = 40, resolution = [9, 9], max_distance = "2 m" }',
        "visibility.resolution = [64, 48]",
        "scene = { models = ['a.stl'], max_edge = '5 mm', flip = ['a'] }",
        "variables.height = { min = '10 cm', max = 200, start = '0.15 m' }",
        "vary = { mounts = [1, 2], swarm.inertia = [[0.1, 1.0]] }",
        "swarm.inertia = [0.1, 1]",
    ],
)
def test_what_a_study_may_say_is_taken(line):
    table = line.partition(".")[0].partition(" ")[0]
    parts = {"scene": "scene.models = ['a.stl']", table: line}
    mount = "mount = [{ name = 'A', sensor = 'eye', position = [0, 'h', 1], aim = [0, 0, 1] }]"
    assert complaints("\n".join([*parts.values(), mount])) == []


@pytest.mark.parametrize(
    "line",
    [
        "visibility.criterion = 'pixel'",
        "objective.by_area = 1",
        "swarm.particles = 3.5",
        "swarm.particle = 3",
        "sweep.mounts = [1, 2]",
        "variables.height = { min = 1 }",
        "sensor.eye = { hfov_deg = '60 mm' }",
    ],
)
def test_slips_are_marked(line):
    scene = "scene.models = ['a.stl']"
    mount = "mount = [{ name = 'A', sensor = 'eye', position = [0, 0, 1], aim = [0, 0, 1] }]"
    assert complaints(f"{scene}\n{mount}") == []
    assert len(complaints(f"{scene}\n{mount}\n{line}")) >= 1


def test_each_key_is_explained():
    tables = [study_schema(), *study_schema()["$defs"].values()]
    values = itertools.chain.from_iterable(table["properties"].items() for table in tables)
    assert [key for key, value in values if "description" not in value and "$ref" not in value] == [
        "sensor", "mount",
    ]  # fmt: skip
