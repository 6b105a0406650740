"""The Python face: names that are found, words that are short, results that are written."""

import pydoc
from dataclasses import replace

import pytest
from support.two_cubes import SMALL, write_two_cubes

import glvis
from glvis.common.notebook import html_table
from glvis.errors import MachineError, StudyError
from glvis.results.folder import files_below

HOSTILE = "<script>alert(1)</script>"


@pytest.fixture(scope="module")
def study(tmp_path_factory):
    text = SMALL.replace("Two cubes", HOSTILE)
    return glvis.load_study(write_two_cubes(tmp_path_factory.mktemp("study"), text))


@pytest.fixture(scope="module")
def placement(study):
    return glvis.place_sensors(study)


def test_all_public_names_are_offered_and_there():
    assert set(glvis.__all__) <= set(dir(glvis))
    assert len(set(dir(glvis))) == len(dir(glvis))
    for name in glvis.__all__:
        assert getattr(glvis, name) is not None
    assert "TYPE_CHECKING" not in dir(glvis) and "import_module" not in dir(glvis)
    with pytest.raises(AttributeError, match="module 'glvis' has no attribute 'nothing'"):
        glvis.nothing  # noqa: B018


def test_help_tells_of_the_public_names():
    text = pydoc.plain(pydoc.render_doc(glvis))
    for name in ("load_study", "place_sensors", "class Placement", "class Evaluator"):
        assert name in text


def test_words_are_short(study, placement):
    assert repr(study) == (f"Study('{HOSTILE}', 2 models, 0 obstacles, 3 sensors, 1 variable, OF3)")
    share = 100 * sum(found.coverage for found in placement.maps) / 2
    assert repr(placement) == (
        f"Placement(OF3 = {placement.value:.4g}, {share:.1f} % of the faces seen, "
        "3 sensors, finished: all 2 iterations done)"
    )
    eye = "Sensor('eye', 60 x 42 deg, 96 x 64 pixels, 0 to 12, incidence up to 90 deg)"
    assert repr(study.sensors[0]) == eye
    assert repr(study.rig) == "Rig(1 variables, sensors A, B, C)"
    assert repr(placement.maps[0]).startswith("VisibilityMap('cube', visible (3, 12), ")
    with glvis.Evaluator(study) as evaluator:
        assert repr(evaluator).startswith("Evaluator(Study('<script>")
        assert len(repr(evaluator)) < 250


def test_the_share_told_is_the_one_that_the_objective_counts(placement):
    study = placement.study
    by_area = replace(
        placement, study=replace(study, objective=replace(study.objective, by_area=True))
    )
    assert "% of the area seen" in repr(by_area)
    assert "area seen %" in by_area._repr_html_()


def test_notebooks_get_tables_in_which_texts_stay_texts(study, placement):
    for one in (study, placement):
        html = one._repr_html_()
        assert "&lt;script&gt;" in html and "<script" not in html
    html = placement._repr_html_()
    assert html.count("<table>") == 2
    x = placement.camera_to_world[0, 0, 3]
    assert f"<td>{x:.4g}</td>" in html
    assert html_table("a", ("b",), [("<", 1234, 0.5)]) == (
        '<table><caption style="text-align:left">a</caption><thead><tr><th>b</th></tr></thead>'
        '<tbody><tr><td style="text-align:left">&lt;</td><td>1,234</td><td>0.5</td></tr></tbody>'
        "</table>"
    )


def test_a_placement_is_saved_as_the_command_line_does(placement, tmp_path):
    out = tmp_path / "out"
    assert placement.save(out, pictures=False, meshes=False) == out
    names = files_below(out)
    for name in ("result.json", "report.html", "visibility.npz", "poses.csv", "mounting.txt"):
        assert name in names
    assert not [name for name in names if name.startswith("views/")]
    assert glvis.read_result(out).value == placement.value
    with pytest.raises(StudyError, match="holds a result already"):
        placement.save(out)
    placement.save(str(out), overwrite=True, pictures=False, meshes=False)
    assert files_below(out) == names


def test_pictures_that_fail_are_a_warning(placement, tmp_path, monkeypatch):
    def refuse(*arguments, **options):
        raise MachineError("no OpenGL today")

    monkeypatch.setattr("glvis.reports.delivery.write_views", refuse)
    with pytest.warns(UserWarning, match="the pictures could not be made: no OpenGL today"):
        placement.save(tmp_path / "out", meshes=False)
    assert (tmp_path / "out" / "result.json").is_file()
