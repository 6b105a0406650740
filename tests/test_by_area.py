"""What is optimised is what is told: shares are of the area where the objective is."""

from dataclasses import replace

import pytest
from support import two_cubes

from glvis.cli.explain_words import explain_lines
from glvis.cli.tolerance_words import loss_lines
from glvis.cli.wording import result_lines
from glvis.pictures.coloring import coloring
from glvis.pictures.stage import Stage
from glvis.problem.pieces import noun_of_shares
from glvis.reports.compare import Layout, difference_coloring
from glvis.reports.report import page_data
from glvis.results.tables import sensor_table
from glvis.results.tolerance import worth
from glvis.search.placement import evaluate_poses
from glvis.study.loading import load_study


@pytest.fixture(scope="module")
def placements(tmp_path_factory):
    """The same layout, by faces and by area; the cube is stretched so that the two differ."""
    folder = tmp_path_factory.mktemp("study")
    path = two_cubes.write_two_cubes(folder)
    text = (folder / "cube.off").read_text().replace("0.5", "0.9", 3)
    (folder / "cube.off").write_text(text)
    return {
        noun: evaluate_poses(load_study(path, [f"objective.by_area={value}"]))
        for noun, value in (("faces", "false"), ("area", "true"))
    }


@pytest.mark.parametrize("noun", ["faces", "area"])
def test_every_share_is_of_what_the_objective_counts(placements, noun):
    placement = placements[noun]
    study = placement.study
    assert noun_of_shares(study.models, study.objective.by_area) == noun
    assert sensor_table(study.models, placement.maps, study.objective.by_area)[0] == noun
    assert f"in % of the {noun} (mean over models)" in "\n".join(result_lines(placement))
    assert f"is lost without it ({noun}, mean over models)" in "\n".join(explain_lines(placement))
    assert f"{noun} seen %" in "\n".join(loss_lines(placement))
    assert page_data(placement).by_area == (noun == "area")
    with Stage(study, placement.camera_to_world) as stage:
        assert coloring("overlap", stage.show(0, placement.maps[0])).heading == noun


def test_worth_of_a_layout_is_its_share_of_the_area(placements):
    placement = placements["area"]
    shares = [
        model.areas[found.counts > 0].sum() / model.areas.sum()
        for model, found in zip(placement.study.models, placement.maps, strict=True)
    ]
    assert worth(placement).coverage == pytest.approx(sum(shares) / len(shares))


def test_table_of_the_page_begins_with_what_is_optimised(placements):
    headers = {noun: page_data(one).tables[0].header for noun, one in placements.items()}
    assert headers["faces"][:3] == ["model", "seen %", "area seen %"]
    assert headers["area"][:3] == ["model", "area seen %", "seen %"]
    for one in placements.values():
        table = page_data(one).tables[0]
        assert list(table.header[-3:]) == ["faces", "unique seen", "seen, by all sensors"]
        assert all(len(row) == len(table.header) for row in table.rows)


@pytest.mark.parametrize("noun", ["faces", "area"])
def test_map_of_a_difference_says_what_each_layout_sees(placements, noun):
    one = placements[noun]
    blind = [replace(found, visible=found.visible & False) for found in one.maps]
    layouts = Layout("left", one), Layout("right", replace(one, maps=tuple(blind)))
    facts = difference_coloring(*layouts, "small").facts.replace("\u00a0", " ")
    whole = "the area" if noun == "area" else "12 faces"
    assert facts.startswith(f"of {whole} left sees ")
    assert facts.endswith("right 0.0 %")
