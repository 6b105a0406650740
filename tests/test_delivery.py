"""What is made for people and tools never costs the result; words from elsewhere are lines."""

import json

import pytest
from support.two_cubes import SMALL, write_two_cubes

import glvis
from glvis.cli.app import main

TITLE = 'title = """Two\\nlines\\u0000 and\\u2028a tab\\t"""'
IN_LINES = SMALL.replace('title = "Two cubes"', TITLE)


@pytest.fixture
def study(tmp_path):
    (tmp_path / "study").mkdir()
    return write_two_cubes(tmp_path / "study")


def test_titles_are_one_line(tmp_path):
    path = write_two_cubes(tmp_path, IN_LINES)
    assert glvis.load_study(path).title == "Two lines and a tab"
    assert glvis.load_study(path, ['title=""']).title == "study"


def test_result_of_a_title_of_two_lines_is_whole_with_its_pictures(tmp_path, monkeypatch):
    from glvis.pictures.writing import write_views

    def small(*arguments, **options):
        return write_views(*arguments, **options | {"size": (200, 200), "color": "unseen"})

    monkeypatch.setattr("glvis.reports.delivery.write_views", small)
    path, out = write_two_cubes(tmp_path, IN_LINES), tmp_path / "out"
    assert main(["evaluate", str(path), "-o", str(out)]) == 0
    assert (out / "views" / "cube-unseen.png").exists()
    compile((out / "exports" / "blender_scene.py").read_text(), "blender_scene.py", "exec")


@pytest.mark.parametrize(
    ("part", "missing", "fact"),
    [
        ("write_pictures", "views", "the pictures could not be made: RuntimeError raqm failed"),
        ("write_surfaces", "exports", "files for installers and other tools could not be made: R"),
        ("write_poses", "poses.csv", "files for installers and other tools could not be made: R"),
        ("write_page", "report.html", "the page could not be made: RuntimeError raqm failed xx"),
    ],
)
def test_what_fails_is_a_warning_of_one_line(
    study, tmp_path, capsys, monkeypatch, part, missing, fact
):
    def fail(*arguments, **options):
        raise RuntimeError("raqm\nfailed " + 1000 * "x")

    monkeypatch.setattr(f"glvis.reports.delivery.{part}", fail)
    out = tmp_path / "out"
    more = [] if part == "write_pictures" else ["--no-pictures"]
    assert main(["evaluate", str(study), "-o", str(out), *more]) == 1
    said = capsys.readouterr().out
    assert ("makes them" in said) == (part in ("write_pictures", "write_page"))
    (line,) = [line for line in said.splitlines() if line.startswith("Warning: ")]
    assert fact in line and len(line) < 600
    assert not (out / missing).exists() and missing not in said.splitlines()[-1]
    index = json.loads((out / "result.json").read_text())
    assert index["warnings"] == [line.removeprefix("Warning: ")]
    assert not [name for name in index["files"] if name.startswith(missing)]


def test_pictures_that_fail_when_made_again_are_one_line(study, tmp_path, capsys, monkeypatch):
    def fail(*arguments, **options):
        raise RuntimeError("raqm failed")

    out = tmp_path / "out"
    assert main(["evaluate", str(study), "-o", str(out), "--no-pictures"]) == 0
    monkeypatch.setattr("glvis.reports.delivery.write_views", fail)
    assert main(["render", str(out)]) == 1
    error = capsys.readouterr().err
    fact = "the pictures could not be made: RuntimeError raqm failed"
    assert error == f"error: {out}: {fact}\n"
