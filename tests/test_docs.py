"""The manual: pages that are listed and shown, links that lead somewhere, examples that hold,
and keys as the schema has them."""

import ast
import re
import shlex
import tomllib
from pathlib import Path

import pytest
import typer

import glvis
from glvis.cli.app import app, main
from glvis.cli.manual import read_pages
from glvis.study.keys import KEY_TABLES
from glvis.study.lengths import with_plain_lengths
from glvis.study.schema import StudyTable
from glvis.study.sensor_table import SensorTable

ROOT = Path(__file__).resolve().parents[1]
PAGES = {page.name: page for page in read_pages()}
TEXTS = [
    ROOT / "README.md",
    ROOT / "CONTRIBUTING.md",
    ROOT / "CHANGELOG.md",
    ROOT / "scenes" / "README.md",
    ROOT / "scenes" / "reproduced.md",
    *sorted((ROOT / "glvis" / "docs").glob("*.md")),
]
LINK = re.compile(r"\]\(([^)\s]+)\)")
HERE = {"study", "results", "search", "benchmarks", "cluster", "tuning", "python", "paper"}


def slug(heading: str) -> str:
    """Return the anchor that GitHub gives a heading."""
    return re.sub(r"[^\w\- ]", "", heading.lower()).replace(" ", "-")


def anchors(path: Path) -> set[str]:
    found = re.findall(r"^#+ (.+)$", path.read_text(encoding="utf-8"), flags=re.MULTILINE)
    return {slug(heading) for heading in found}


def rows_below(text: str, heading: str) -> list[list[str]]:
    """Return the cells of the first table below a heading, without its two head lines."""
    below = text.split(f"\n{heading}\n", 1)[1]
    lines = re.search(r"(?:^\|.*\n)+", below, flags=re.MULTILINE).group().splitlines()
    return [[cell.strip() for cell in line.strip("|").split(" | ")] for line in lines[2:]]


def code(cell: str) -> str:
    """Return what a cell shows as code, "" for an empty one."""
    return cell.strip().strip("`")


def test_every_page_is_there_and_says_in_one_line_what_it_tells():
    assert set(PAGES) >= HERE
    for page in PAGES.values():
        assert page.text.startswith("# ")
        assert page.about.endswith(".") and 20 < len(page.about) <= 100


def test_pages_are_listed_with_what_they_tell(capsys):
    assert main(["docs"]) == 0
    out = " ".join(capsys.readouterr().out.split())
    assert all(f"{page.name} {page.about}" in out for page in PAGES.values())


def test_a_page_is_shown_as_it_stands_in_its_file(capsys):
    assert main(["docs", "study"]) == 0
    assert capsys.readouterr().out == PAGES["study"].text


def test_a_page_that_is_none_gives_the_list(capsys):
    assert main(["docs", "serch"]) == 2
    said = capsys.readouterr()
    assert said.out == ""
    assert said.err == (
        f"error: there is no page 'serch'; did you mean 'search'? pages are {', '.join(PAGES)}\n"
    )


@pytest.mark.parametrize("name", ["../docs/study", "/etc/passwd", "study.md"])
def test_no_other_file_is_shown_as_a_page(name, capsys):
    assert main(["docs", name]) == 2
    assert f"there is no page '{name}'" in capsys.readouterr().err


def test_the_readme_is_short():
    assert len((ROOT / "README.md").read_text(encoding="utf-8").splitlines()) <= 130


@pytest.mark.parametrize("path", TEXTS, ids=lambda path: str(path.relative_to(ROOT)))
def test_relative_links_lead_somewhere(path):
    links = [
        link
        for link in LINK.findall(path.read_text(encoding="utf-8"))
        if not link.startswith(("http://", "https://"))
    ]
    for link in links:
        name, _, anchor = link.partition("#")
        target = (path.parent / name) if name else path
        assert target.exists(), f"{path.name}: {link}"
        assert not anchor or anchor in anchors(target), f"{path.name}: {link}"


def test_the_readme_leads_to_every_page():
    text = (ROOT / "README.md").read_text(encoding="utf-8")
    assert [name for name in PAGES if f"glvis/docs/{name}.md" not in text] == []


def blocks(kind: str) -> list[tuple[str, str]]:
    """Return the fenced blocks of a kind in README, manual and CONTRIBUTING: where, and text."""
    found = []
    for path in TEXTS:
        text = path.read_text(encoding="utf-8")
        found += [(path.name, one) for one in re.findall(rf"```{kind}\n(.*?)```", text, re.DOTALL)]
    assert found
    return found


@pytest.mark.parametrize(("name", "text"), blocks("toml"))
def test_studies_that_are_shown_can_be_read(name, text):
    data = with_plain_lengths(tomllib.loads(text))
    if "scene" in data:
        StudyTable.model_validate(data)
        return
    assert name == "sensors.md"  # whose examples are of sensors alone
    for sensor, table in data["sensor"].items():
        checked = SensorTable.model_validate(table)
        if not checked.calibration:  # a file that is not there
            assert checked.to_sensor(sensor).name == sensor


@pytest.mark.parametrize(("name", "text"), blocks("sh"))
def test_commands_that_are_shown_exist_with_all_their_options(name, text):
    commands = typer.main.get_command(app).commands
    for line in text.splitlines():
        words = shlex.split(line, comments=True)
        if words[:1] == ["glvis"]:  # read, not run
            commands[words[1]].make_context(words[1], words[2:])
        elif words and "/" in words[0]:
            assert (ROOT / words[0]).exists() or words[0].startswith(".venv/"), line


@pytest.mark.parametrize(("name", "text"), blocks("python"))
def test_python_that_is_shown_uses_public_names(name, text):
    ast.parse(text)
    assert set(re.findall(r"\bglvis\.(\w+)", text)) <= set(glvis.__all__)


def test_commands_of_the_text_exist():
    commands = set(typer.main.get_command(app).commands)
    for path in TEXTS:
        text = path.read_text(encoding="utf-8")
        assert set(re.findall(r"`glvis ([a-z]+)", text)) <= commands, path.name


# How an example of a table becomes part of a study; the rest of one that is whole.
SCENE = '[scene]\nmodels = ["part.stl"]\n'
SENSOR = {"hfov_deg": "66", "vfov_deg": "40", "resolution": "[64, 48]", "max_distance": "9"}
MOUNT = {"name": '"A"', "sensor": '"kinect-v2"', "position": "[0, 0, 0]", "aim": "[0, 0, 1]"}
RING = {"axis": '"z"', "radius": "1", "angle_deg": "0", "height": "0"}
ANGLES = {"azimuth_deg": "0", "elevation_deg": "0"}
MIRROR = {"name": '"B"', "normal": "[1, 0, 0]"}
IN_SENSOR = {
    "partner": {"offset": "[1, 0, 0]"},
    "noise": {},
    "focus": {"focal_length": "1", "f_number": "1", "distance": "2", "pixel_pitch": "1"},
}
FREE = {"min": "-1000", "max": "1000"}
RIVALS = {"position": "ring", "ring": "position", "aim": "direction", "direction": "aim"}
RIVALS |= {"plane": "normal", "normal": "plane"}


def with_example(usual: dict[str, str], key: str, example: str) -> dict[str, str]:
    """Return the keys of a table with an example in place of its own, or of what it excludes."""
    kept = {name: value for name, value in usual.items() if name not in (key, RIVALS.get(key))}
    return kept | {key: example}


def lines(values: dict[str, str]) -> str:
    return "".join(f"{key} = {value}\n" for key, value in values.items())


def inline(values: dict[str, str]) -> str:
    return "{ " + ", ".join(f"{key} = {value}" for key, value in values.items()) + " }"


def study_with(table: str, key: str, example: str) -> str:
    """Return a study, TOML, that holds one key with its example in its table."""
    mount = "[[mount]]\n" + lines(MOUNT)
    variables = "[variables]\nheight = { min = 0, max = 9 }\n"
    whole = SCENE + mount + variables
    if table == "a study":
        return f"{key} = {example}\n{whole}"
    if table == "[scene]":
        return f"[scene]\n{lines(with_example({'models': SCENE[17:-1]}, key, example))}{mount}"
    if table == "[sensor.NAME]":
        return f"{whole}[sensor.camera]\n{lines(with_example(SENSOR, key, example))}"
    if table == "[variables]":
        return f"{SCENE}{mount}[variables]\nheight = {example}\n"
    if table == "[[mount]]":
        return f"{SCENE}[[mount]]\n{lines(with_example(MOUNT, key, example))}{variables}"
    if table in IN_SENSOR:
        value = inline(with_example(IN_SENSOR[table], key, example))
        return f"{whole}[sensor.camera]\n{lines(with_example(SENSOR, table, value))}"
    within = {"ring": RING, "direction": ANGLES, "mirror": MIRROR}
    if table in within:
        value = inline(with_example(within[table], key, example))
        return f"{SCENE}[[mount]]\n{lines(with_example(MOUNT, table, value))}{variables}"
    if table == "{ min, max }":
        return f"{SCENE}{mount}[variables]\nx = {inline(with_example(FREE, key, example))}\n"
    return f"{whole}{table}\n{key} = {example}\n"


@pytest.mark.parametrize("table", KEY_TABLES, ids=lambda table: table.name)
def test_the_page_about_studies_has_every_key_as_the_schema_has_it(table):
    shown = rows_below(PAGES["study"].text, f"### {table.name}")
    assert f"### {table.name}\n\n{table.about}\n" in PAGES["study"].text
    told = [(code(key), code(default), meaning) for key, _, default, _, meaning in shown]
    assert told == list(table.rows())
    for key, unit, *_ in shown:
        assert not code(key).endswith("_deg") or unit == "degrees"


@pytest.mark.parametrize("table", KEY_TABLES, ids=lambda table: table.name)
def test_every_example_of_a_key_is_one_that_a_study_may_have(table):
    for key, _, _, example, _ in rows_below(PAGES["study"].text, f"### {table.name}"):
        name, value = code(example).split(" = ", 1)
        assert name == code(key) or code(key) in ("NAME", "KEY")
        text = study_with(table.name, name, value)
        StudyTable.model_validate(with_plain_lengths(tomllib.loads(text)))
