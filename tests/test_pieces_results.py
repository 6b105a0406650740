"""Results of studies whose faces are cut: told of the file's own faces, read back, used again."""

import csv
import json

import numpy as np
import pytest
import trimesh
from support.shapes import cube, icosphere, merged, write_off
from support.two_cubes import SMALL, write_two_cubes

from glvis.cli.app import main
from glvis.errors import StudyError
from glvis.reports.compare import Layout, cut_alike, shared_models
from glvis.reports.export_surfaces import face_colors
from glvis.reports.report import page_data
from glvis.results.explain import SEEN, unseen_reasons
from glvis.results.reading import read_result
from glvis.results.tables import model_rows, sensor_rows, sensor_table
from glvis.results.tolerance import worth
from glvis.search.placement import evaluate_poses, place_sensors
from glvis.search.reach import Sampler
from glvis.study.loading import load_study
from glvis.visibility.folding import fold, fold_counts, folded, seen_share

# The cube's twelve faces are cut, what the other model is made of is small.
CUT = SMALL.replace('max_edge = "off"', "max_edge = 0.3").replace("small.off", "ball.off")
CUT = CUT.replace('method = "swarm"', 'method = "auto"\nmax_maps = 300')


@pytest.fixture(scope="module")
def path(tmp_path_factory):
    folder = tmp_path_factory.mktemp("study")
    write_off(folder / "ball.off", icosphere(3, radius=0.5))
    # a box beside the cube hides a part of its faces, not all of any
    path = write_two_cubes(folder, CUT)
    write_off(folder / "cube.off", merged(cube(1.0), cube(0.4, center=(0.3, 0.9, 0.6))))
    return path


@pytest.fixture(scope="module")
def result(path):
    out = path.parent / "out"
    assert main(["optimize", str(path), "-o", str(out), "--workers", "1"]) == 0
    return out


@pytest.fixture(scope="module")
def placement(result):
    return read_result(result)


@pytest.fixture
def run(capsys):
    def run(*arguments) -> str:
        code = main([str(argument) for argument in arguments])
        out, err = capsys.readouterr()
        assert code == 0, err
        return out

    return run


def rows_of(path):
    with path.open(newline="") as file:
        return list(csv.DictReader(file))


def test_only_what_is_large_is_cut(placement):
    first, ball = placement.study.models
    assert first.pieces
    assert first.file.n_faces == 24
    assert ball.pieces is None


def test_maps_are_filed_of_the_files_faces(result, placement):
    model, found = placement.study.models[0], placement.maps[0]
    with np.load(result / "visibility.npz") as arrays:
        assert sorted(arrays) == [
            "ball", "cube", "cube:piece_of", "cube:pieces", "cube:seen_share", "sensors",
        ]  # fmt: skip
        assert arrays["cube"].shape == (3, 24)
        assert arrays["cube"].dtype == bool
        share, visible = fold(found.visible, model)
        np.testing.assert_array_equal(arrays["cube"], visible)
        np.testing.assert_array_equal(arrays["cube:seen_share"], share.astype(np.float32))
        np.testing.assert_array_equal(arrays["cube:pieces"], found.visible)
        np.testing.assert_array_equal(arrays["cube:piece_of"], model.pieces.file_face)
        np.testing.assert_array_equal(arrays["ball"], placement.maps[1].visible)
        # some faces are seen in part only, or this tells nothing
        assert ((share > 0.05) & (share < 0.95)).any()
    with np.load(result / "reach.npz") as arrays:
        assert sorted(arrays) == ["ball", "cube", "cube:pieces"]
        by = placement.reach.sensors[0]
        np.testing.assert_array_equal(arrays["cube"], fold_counts(by, model))
        np.testing.assert_array_equal(arrays["cube:pieces"], by)


def test_counts_are_of_the_files_faces_and_areas_of_what_is_seen(result, placement):
    study = placement.study
    model, found = study.models[0], placement.maps[0]
    row = rows_of(result / "coverage.csv")[0]
    entry = json.loads((result / "result.json").read_text())["models"][0]
    _, visible = fold(found.visible, model)
    assert int(row["total"]) == 24
    assert int(row["seen_by_all_cameras"]) == visible.sum()
    counts = visible.sum(axis=0)
    assert int(row["unique_seen"]) == (counts > 0).sum()
    assert float(row["percentage"]) == 100 * (counts > 0).mean()
    together = seen_share(found.counts > 0, model)
    area = 100 * (together * model.file.areas).sum() / model.file.areas.sum()
    assert float(row["area_percentage"]) == pytest.approx(area)
    assert entry["area_share_seen_by"]["1"] == pytest.approx(area / 100)
    assert entry["pieces"] == model.n_faces
    assert entry["max_edge"] == 0.3
    assert float(row["seen_by_2_percentage"]) == 100 * (counts >= 2).mean()


def test_sensors_are_told_by_area(result, placement):
    study = placement.study
    rows = sensor_rows(study.models, placement.maps)
    noun, table = sensor_table(study.models, placement.maps)
    assert noun == "area"
    for s, (row, told, filed) in enumerate(
        zip(rows, table, rows_of(result / "sensors.csv"), strict=True)
    ):
        sees, alone = [], []
        for model, found in zip(study.models, placement.maps, strict=True):
            share = model.areas / model.areas.sum()
            sees.append(share[found.visible[s]].sum())
            alone.append(share[found.visible[s] & (found.counts == 1)].sum())
        assert told == (row.name, row.area_percentage, row.only_it_area_percentage)
        assert row.area_percentage == pytest.approx(100 * np.mean(sees))
        assert row.only_it_area_percentage == pytest.approx(100 * np.mean(alone))
        assert float(filed["area_percentage"]) == row.area_percentage


def test_what_only_one_sensor_sees_of_the_files_faces_is_lost_without_it(placement):
    model, found = placement.study.models[0], placement.maps[0]
    _, visible = fold(found.visible, model)
    for s, row in enumerate(sensor_rows([model], [found])):
        left = np.delete(visible, s, axis=0).any(axis=0)
        assert row.only_it == visible.any(axis=0).sum() - left.sum()
        assert row.seen == visible[s].sum()


def test_a_result_is_read_back_as_it_was(path, placement):
    again = place_sensors(load_study(path), sampler=Sampler())
    assert again.value == placement.value
    for a, b in zip(again.maps, placement.maps, strict=True):
        np.testing.assert_array_equal(a.visible, b.visible)
    for a, b in zip(again.reach.sensors, placement.reach.sensors, strict=True):
        np.testing.assert_array_equal(a, b)


def test_a_result_from_before_faces_were_cut_is_read_as_it_was_made(path, run, tmp_path):
    run("evaluate", path, "-o", tmp_path / "out", "--no-pictures", "--set", "scene.max_edge=off")
    study = tmp_path / "out" / "study.toml"
    study.write_text(study.read_text().replace('max_edge = "off"\n', ""))
    again = read_result(tmp_path / "out")
    assert again.study.models[0].pieces is None
    assert again.maps[0].visible.shape == (3, 24)


def test_pieces_that_are_not_those_of_the_result_are_refused(run, path, tmp_path):
    run("evaluate", path, "-o", tmp_path / "out", "--no-pictures")
    study = tmp_path / "out" / "study.toml"
    study.write_text(study.read_text().replace("max_edge = 0.3", "max_edge = 0.2"))
    with pytest.raises(StudyError, match=r"cube was cut into \d+ pieces by the glvis that made"):
        read_result(tmp_path / "out")


def test_a_search_goes_on_where_it_was(run, path, tmp_path):
    out = tmp_path / "out"
    swarm = ["--set", "search.method=swarm", "--workers", "1", "--no-pictures"]
    run("optimize", path, "-o", out, *swarm)
    run("optimize", path, "-o", tmp_path / "whole", *swarm, "--set", "swarm.iterations=4")
    run("optimize", "--resume", out, "--extend", "2", "--workers", "1", "--no-pictures")
    assert read_result(out).value == read_result(tmp_path / "whole").value


def test_workers_make_the_same_maps(path, placement):
    again = place_sensors(load_study(path), workers=2)
    for a, b in zip(again.maps, placement.maps, strict=True):
        np.testing.assert_array_equal(a.visible, b.visible)


def test_explain_tells_of_pieces(run, result, placement):
    out = run("explain", result)
    assert "lost without it (area, mean over models)" in out
    assert "  pieces  " in out
    (reasons, _) = unseen_reasons(placement)
    np.testing.assert_array_equal(reasons == SEEN, placement.maps[0].counts > 0)


def test_tolerance_tells_the_area(run, result, placement, tmp_path):
    out = run("tolerance", result, "--position", "1", "--samples", "3", "--lose")
    assert out.count("area seen %") == 2
    study = placement.study
    rows = model_rows(study.models, placement.maps, study.objective)
    areas = [row.area_percentage for row in rows]
    assert 100 * worth(placement).coverage == pytest.approx(np.mean(areas))
    out = run("tolerance", result, "--round", "1,5deg", "-o", tmp_path / "rounded")
    assert "% of the area instead of" in out
    assert read_result(tmp_path / "rounded").study.models[0].pieces


def test_layouts_cut_differently_are_compared_by_the_finer_pieces(run, path, tmp_path, placement):
    study = load_study(path, ["scene.max_edge=0.5"])
    poses = placement.camera_to_world.copy()
    poses[2, 0, 3] += 0.3
    layouts = [Layout("fine", placement), Layout("coarse", evaluate_poses(study, poses))]
    assert shared_models(layouts) == ["ball"]
    alike = cut_alike(layouts)
    assert alike[0].placement is placement
    assert shared_models(alike) == ["cube", "ball"]
    expected = evaluate_poses(placement.study, poses)
    for a, b in zip(alike[1].placement.maps, expected.maps, strict=True):
        np.testing.assert_array_equal(a.visible, b.visible)
    assert alike[1].placement.value == expected.value
    # the other way round it is the first that is looked at again
    assert shared_models(cut_alike(layouts[::-1])) == ["cube", "ball"]


def test_compare_through_the_command_line(run, path, result, tmp_path):
    run("evaluate", path, "-o", tmp_path / "off", "--no-pictures", "--set", "scene.max_edge=off")
    out = run("compare", tmp_path / "off", result, "-o", tmp_path / "compared")
    assert "out against off, % of the area" in out
    assert "\noff is told by the finer pieces of others; by its own its objective was " in out
    assert "\nout is told" not in out
    lines = [line.split() for line in out.splitlines()]
    told = next(line for line in lines if line[:2] == ["area", "seen,"])[-2:]
    rows = [line[1:] for line in lines if line[:1] in (["cube"], ["ball"]) and line[1] != "seen"]
    parts = np.array(rows, dtype=float)
    both, only_off, only_out, _ = parts.mean(axis=0)
    assert [float(value) for value in told] == pytest.approx(
        [both + only_off, both + only_out], abs=0.02
    )
    assert (tmp_path / "compared" / "cube-difference.png").is_file()


def test_surfaces_are_exported_of_the_files_faces_and_of_the_pieces(result, placement):
    model, found = placement.study.models[0], placement.maps[0]
    whole = trimesh.load(result / "exports" / "cube.ply", process=False)
    assert np.allclose(whole.vertices[whole.faces], model.file.vertices[model.file.faces])
    told = whole.metadata["_ply_raw"]["face"]["data"]
    share, is_seen = fold(found.counts > 0, model)
    np.testing.assert_allclose(told["seen_share"].ravel(), share, atol=1e-6)
    np.testing.assert_array_equal(told["seen_by"].ravel(), folded(found, model).counts)
    pieces = trimesh.load(result / "exports" / "pieces" / "cube.ply", process=False)
    assert np.allclose(pieces.vertices[pieces.faces], model.vertices[model.faces])
    told = pieces.metadata["_ply_raw"]["face"]["data"]
    np.testing.assert_array_equal(told["piece_of"].ravel(), model.pieces.file_face)
    np.testing.assert_array_equal(told["seen_by"].ravel(), found.counts)
    # a face has the colour of the most of what is seen of it, or of what is not
    colors = face_colors(placement, 0)
    own = whole.visual.vertex_colors[whole.faces][:, 0, :3]
    for face in range(24):
        some = (model.pieces.file_face == face) & ((found.counts > 0) == is_seen[face])
        unique, which = np.unique(colors[some], axis=0, return_inverse=True)
        most = np.bincount(which.ravel(), model.areas[some])
        assert most[(unique == own[face]).all(axis=1)] == pytest.approx(most.max())
    text = (result / "exports" / "README.txt").read_text()
    assert "pieces/*.ply" in text
    assert "pieces/cube" in (result / "exports" / "blender_scene.py").read_text()


def test_the_page_and_the_pictures_tell_the_area(result, placement):
    data = page_data(placement)
    np.testing.assert_array_equal(
        data.models[0].piece_of, placement.study.models[0].pieces.file_face
    )
    assert data.models[1].piece_of is None
    (sensors,) = [table for table in data.tables if table.title == "Sensors"]
    assert sensors.note.startswith("Of the area, the mean over models.")
    assert (result / "views" / "cube-unseen.png").is_file()
    assert (result / "report.html").is_file()


def test_the_pictures_are_made_again(run, result):
    run("render", result)


def test_series_of_runs_have_pieces_too(run, path, tmp_path):
    out = run(
        "optimize", path, "-o", tmp_path / "two", "--repeats", "2", "--no-pictures",
        "--workers", "1", "--set", "search.max_maps=60",
    )  # fmt: skip
    assert "run-02" in out or (tmp_path / "two" / "run-02").is_dir()
    assert read_result(tmp_path / "two" / "run-02").study.models[0].pieces
