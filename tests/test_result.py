"""The result folder: whole or not at all, exact, and never at the cost of what is there."""

import csv
import json
import math
import os
from pathlib import Path

import numpy as np
import pytest
from support import shapes
from support.two_cubes import SMALL, write_two_cubes

from glvis.errors import MachineError, StudyError
from glvis.results.folder import ResultFolder, renewed_files, result_folder
from glvis.results.journal import files_below
from glvis.results.reading import read_result
from glvis.results.result import (
    sensor_poses,
    write_data,
    write_npz,
    write_summary,
)
from glvis.results.tables import model_rows, sensor_rows
from glvis.search.placement import TraceRow, evaluate_poses, place_sensors
from glvis.study.loading import load_study


@pytest.fixture(scope="module")
def study(tmp_path_factory):
    return load_study(write_two_cubes(tmp_path_factory.mktemp("study")))


@pytest.fixture(scope="module")
def placement(study):
    return place_sensors(study)


@pytest.fixture
def written(placement, tmp_path):
    with result_folder(tmp_path / "out") as folder:
        write_data(placement, folder.staging)
        write_summary(placement, folder.staging)
    return tmp_path / "out"


def rows_of(path: Path) -> list[dict[str, str]]:
    with path.open(newline="") as file:
        return list(csv.DictReader(file))


def test_a_result_read_back_is_the_one_that_was_written(placement, written):
    again = read_result(written)
    for name in ("value", "start_value", "stop_reason", "seed", "seconds", "evaluations",
                 "maps_rendered", "gl", "workers", "warnings", "trace"):  # fmt: skip
        assert getattr(again, name) == getattr(placement, name), name
    for name in ("position", "camera_to_world", "values_by_model"):
        assert np.array_equal(getattr(again, name), getattr(placement, name)), name
    for old, new in zip(placement.maps, again.maps, strict=True):
        assert np.array_equal(old.visible, new.visible)
        assert (old.model_name, old.sensor_names) == (new.model_name, new.sensor_names)
    assert again.study.text == placement.study.text


def test_a_result_of_older_defaults_is_read_as_it_was_made(placement, written):
    text = (written / "study.toml").read_text()
    kept = '[objective]\nkind = "of3"\nby_area = false\n'
    assert kept in text
    for left in ("", '[objective]\nkind = "of3"\n'):
        (written / "study.toml").write_text(text.replace(kept, left))
        assert read_result(written).study.objective == placement.study.objective


def test_poses_in_json_are_exact_and_agree_with_each_other(placement, written):
    index = json.loads((written / "result.json").read_text())
    assert [pose["name"] for pose in index["poses"]] == ["A", "B", "C"]
    for pose, matrix in zip(index["poses"], placement.camera_to_world, strict=True):
        assert np.array_equal(pose["camera_to_world"], matrix)  # bit for bit
        assert pose["position"] == matrix[:3, 3].tolist()
        assert pose["direction"] == (-matrix[:3, 2]).tolist()
        assert math.isclose(math.hypot(*pose["direction"]), 1.0, abs_tol=1e-15)
        assert pose["sensor"] == "eye"
    twin, own = index["poses"][1], index["poses"][0]
    assert twin["position"][0] == -own["position"][0]
    assert index["poses"][2]["roll_deg"] == pytest.approx(30, abs=1e-12)
    assert index["poses"][2]["elevation_deg"] == pytest.approx(-90)


def test_rows_of_models_count_what_the_maps_show(study, placement, written):
    rows = rows_of(written / "coverage.csv")
    assert [row["model"] for row in rows] == ["cube", "small", "mean"]
    index = json.loads((written / "result.json").read_text())
    for row, entry, found in zip(rows, index["models"], placement.maps, strict=False):
        counts = found.visible.sum(axis=0)
        assert int(row["seen_by_all_cameras"]) == counts.sum() == entry["seen_by_all_cameras"]
        assert int(row["unique_seen"]) == (counts > 0).sum() == entry["unique_seen"]
        assert int(row["total"]) == 12 == entry["total"]
        assert float(row["percentage"]) == 100 * (counts > 0).mean() == entry["percentage"]
        # all faces of a cube have the same area
        assert float(row["area_percentage"]) == pytest.approx(float(row["percentage"]))
        for n in (2, 3):
            share = (counts >= n).mean()
            assert float(row[f"seen_by_{n}_percentage"]) == 100 * share
            assert entry["share_seen_by"][str(n)] == share
    mean = rows[-1]
    assert float(mean["percentage"]) == np.mean([float(row["percentage"]) for row in rows[:2]])
    assert float(mean["value"]) == pytest.approx(placement.value)
    assert index["objective"]["value"] == placement.value
    assert index["objective"]["terms"]["of3"] == pytest.approx(placement.value)


def test_what_only_one_sensor_sees_is_what_its_loss_costs(placement):
    for s, row in enumerate(sensor_rows(placement.study.models, placement.maps)):
        lost = [
            found.visible.any(axis=0).sum() - np.delete(found.visible, s, axis=0).any(axis=0).sum()
            for found in placement.maps
        ]
        assert row.only_it == sum(lost)
        assert row.only_it_percentage == pytest.approx(100 * np.mean(lost) / 12)
        assert row.seen == sum(found.visible[s].sum() for found in placement.maps)


def test_area_percentage_weighs_faces_by_their_area(study):
    found = evaluate_poses(study).maps[0]
    model = study.models[0]
    row = model_rows([model], [found], study.objective)[0]
    assert row.area_percentage == pytest.approx(
        100 * model.areas[found.visible.any(axis=0)].sum() / 6.0
    )


def test_maps_are_filed_by_stem_beside_the_names_of_the_sensors(placement, written):
    with np.load(written / "visibility.npz") as arrays:
        assert sorted(arrays) == ["cube", "sensors", "small"]
        assert arrays["sensors"].tolist() == ["A", "B", "C"]
        assert arrays["cube"].dtype == bool
        assert np.array_equal(arrays["cube"], placement.maps[0].visible)


def test_models_may_be_called_like_arguments_of_savez(tmp_path):
    arrays = {"file": np.ones((2, 3), bool), "allow_pickle": np.zeros(2, bool)}
    write_npz(tmp_path / "x.npz", arrays)
    with np.load(tmp_path / "x.npz") as found:
        assert all(np.array_equal(found[name], array) for name, array in arrays.items())


def test_trace_has_a_row_an_iteration(placement, written):
    rows = rows_of(written / "trace.csv")
    assert list(rows[0]) == list(TraceRow._fields)
    assert [int(row["iteration"]) for row in rows] == [0, 1, 2]
    assert [float(row["best"]) for row in rows] == [row.best for row in placement.trace]


def test_equal_runs_write_equal_bytes_but_for_times_and_driver(study, placement, tmp_path):
    folders = []
    for name, found in (("one", placement), ("two", place_sensors(study))):
        with result_folder(tmp_path / name) as folder:
            write_data(found, folder.staging)
            write_summary(found, folder.staging)
        folders.append(tmp_path / name)
    one, two = folders
    for name in ("study.toml", "coverage.csv", "sensors.csv", "visibility.npz"):
        assert (one / name).read_bytes() == (two / name).read_bytes(), name
    indices = [json.loads((folder / "result.json").read_text()) for folder in folders]
    for index in indices:
        del index["run"]
    assert indices[0] == indices[1]


def test_result_names_all_its_files(written):
    index = json.loads((written / "result.json").read_text())
    assert index["files"] == files_below(written)


def test_renewed_files_replace_theirs_and_leave_all_else(written):
    before = json.loads((written / "result.json").read_text())
    (written / "notes.txt").write_text("mine")
    with renewed_files(written, ["views/"]) as staging:
        (staging / "views").mkdir()
        (staging / "views" / "A.png").write_text("old")
        (staging / "views" / "gone.png").write_text("old")
    (written / "views" / "photo.jpg").write_text("mine")
    with renewed_files(written, ["views/"]) as staging:
        (staging / "views").mkdir()
        (staging / "views" / "A.png").write_text("new")
    after = json.loads((written / "result.json").read_text())
    assert after.pop("files") == sorted([*before.pop("files"), "views/A.png"])
    assert after == before
    assert (written / "views" / "A.png").read_text() == "new"
    assert files_below(written / "views") == ["A.png", "photo.jpg"]
    with renewed_files(written) as staging:
        (staging / "poses.csv").touch()
    again = json.loads((written / "result.json").read_text())["files"]
    assert "views/A.png" in again
    assert "poses.csv" in again


def test_failed_renewal_changes_nothing(written):
    before = {name: (written / name).read_bytes() for name in files_below(written)}
    with pytest.raises(RuntimeError), renewed_files(written, ["views/"]) as staging:
        (staging / "views").mkdir()
        raise RuntimeError
    assert {name: (written / name).read_bytes() for name in files_below(written)} == before
    assert not list(written.glob("unfinished*"))


def test_values_of_variables_are_left_out_where_poses_came_from_elsewhere(study, tmp_path):
    poses = np.roll(study.rig.poses(study.rig.start), 1, axis=0)
    with result_folder(tmp_path / "out") as folder:
        found = evaluate_poses(study, poses)
        write_data(found, folder.staging)
        write_summary(found, folder.staging)
    index = json.loads((tmp_path / "out" / "result.json").read_text())
    assert [variable["value"] for variable in index["variables"]] == [None]
    again = read_result(tmp_path / "out")
    assert np.isnan(again.position).all()
    assert np.array_equal(again.camera_to_world, poses)


def test_a_result_of_another_schema_is_refused(written):
    path = written / "result.json"
    path.write_text(json.dumps(json.loads(path.read_text()) | {"glvis_schema": 99}))
    with pytest.raises(StudyError, match="schema version 99 cannot be read, only 1"):
        read_result(written)


def test_a_result_of_changed_meshes_is_refused(placement, written):
    path = written / "result.json"
    index = json.loads(path.read_text())
    index["models"][1]["sha256"] = "0"
    path.write_text(json.dumps(index))
    with pytest.raises(StudyError, match=r"small\.off: has changed since the result was made"):
        read_result(written)


def test_a_result_of_an_assembly_notices_which_part_has_changed(tmp_path):
    text = SMALL.replace("[scene]", '[scene]\nassembly = "both"')
    placement = evaluate_poses(load_study(write_two_cubes(tmp_path, text)))
    with result_folder(tmp_path / "out") as folder:
        write_data(placement, folder.staging)
        write_summary(placement, folder.staging)
    (entry,) = json.loads((tmp_path / "out" / "result.json").read_text())["models"]
    assert [Path(part["file"]).name for part in entry["parts"]] == ["cube.off", "small.off"]
    assert read_result(tmp_path / "out").maps[0].model_name == "both"
    shapes.write_off(tmp_path / "small.off", shapes.cube(0.4))
    with pytest.raises(StudyError, match=r"small\.off: has changed since the result was made"):
        read_result(tmp_path / "out")


def test_a_result_with_a_missing_or_broken_file_is_refused(written):
    (written / "trace.csv").write_text("iteration,best\n")
    with pytest.raises(StudyError, match=r"trace\.csv: must have the columns iteration, method"):
        read_result(written)
    (written / "trace.csv").unlink()
    with pytest.raises(StudyError, match=r"trace\.csv: cannot be read: No such file"):
        read_result(written)
    (written / "visibility.npz").write_bytes(b"PK")
    with pytest.raises(StudyError, match=r"visibility\.npz: is no archive of arrays"):
        read_result(written)


def test_maps_of_another_study_are_refused(placement, written):
    arrays = {found.model_name: found.visible[:, :5] for found in placement.maps}
    write_npz(written / "visibility.npz", arrays | {"sensors": np.array(["A", "B", "C"])})
    with pytest.raises(StudyError, match="its maps are not those of the study"):
        read_result(written)


def test_nothing_of_a_failed_run_is_left(tmp_path):
    with pytest.raises(RuntimeError), result_folder(tmp_path / "a" / "b") as folder:
        (folder.staging / "half.txt").write_text("half")
        raise RuntimeError
    assert list(tmp_path.iterdir()) == []


def test_folders_that_were_there_stay_when_a_run_fails(tmp_path):
    (tmp_path / "out").mkdir()
    with pytest.raises(RuntimeError), result_folder(tmp_path / "out"):
        raise RuntimeError
    assert (tmp_path / "out").is_dir()


def test_a_failed_search_keeps_its_checkpoint_and_says_how_to_go_on(tmp_path):
    out = tmp_path / "out"
    with pytest.raises(MachineError, match=r"boom; .* glvis optimize --resume"):  # noqa: SIM117
        with result_folder(out) as folder:
            folder.checkpoint.write_bytes(b"state")
            raise MachineError("boom")
    with pytest.raises(StudyError, match="holds a search that was cut off; go on with it by"):
        ResultFolder(out)
    again = ResultFolder(out, resume=True)
    assert again.checkpoint.read_bytes() == b"state"
    anew = ResultFolder(out, overwrite=True)
    assert not anew.checkpoint.exists()


def test_a_finished_search_is_gone_on_with_from_a_copy(tmp_path):
    out = tmp_path / "out"
    out.mkdir()
    (out / "result.json").write_text('{"glvis_schema": 1, "files": []}')
    with pytest.raises(StudyError, match=r"no search that could go on \(study\.toml is missing\)"):
        ResultFolder(out, resume=True)
    (out / "study.toml").write_text("study")
    (out / "checkpoint.npz").write_bytes(b"state")
    folder = ResultFolder(out, resume=True)
    assert folder.checkpoint.read_bytes() == b"state"
    assert (out / "checkpoint.npz").read_bytes() == b"state"


def write_result_of(folder, names, version):
    for name in names:
        path = folder.staging / name
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(version)
    files = [*names, "result.json"]
    (folder.staging / "result.json").write_text(json.dumps({"glvis_schema": 1, "files": files}))


def test_overwrite_replaces_the_old_result_and_leaves_foreign_files_alone(tmp_path):
    out = tmp_path / "out"
    with result_folder(out) as folder:
        write_result_of(folder, ["a.csv", "views/A.png", "views/old.png", "gone/x.png"], "old")
    foreign = {out / "notes.txt": "mine", out / "views" / "photo.jpg": "mine", out / "new": "mine"}
    for path, text in foreign.items():
        path.write_text(text)
    with pytest.raises(StudyError, match="holds a result already; replace it with --overwrite"):
        ResultFolder(out)
    with result_folder(out, overwrite=True) as folder:
        write_result_of(folder, ["a.csv", "views/A.png", "new"], "new")
        assert (out / "a.csv").read_text() == "old"  # until the end
    assert files_below(out) == [
        "a.csv", "new", "new.kept", "notes.txt", "result.json", "views/A.png", "views/photo.jpg",
    ]  # fmt: skip
    assert (out / "new.kept").read_text() == "mine"
    assert (out / "views" / "photo.jpg").read_text() == "mine"
    assert (out / "a.csv").read_text() == (out / "new").read_text() == "new"
    assert not (out / "gone").exists()


def test_a_folder_of_foreign_files_is_refused_even_with_overwrite(tmp_path):
    (tmp_path / "study.toml").write_text("mine")
    for overwrite in (False, True):
        with pytest.raises(StudyError, match=r"holds no result of glvis \(study\.toml\)"):
            ResultFolder(tmp_path, overwrite=overwrite)
    assert files_below(tmp_path) == ["study.toml"]


def test_a_foreign_result_json_is_never_replaced(tmp_path):
    (tmp_path / "result.json").write_text('{"score": 1}')
    with pytest.raises(StudyError, match="is no result of glvis"):
        ResultFolder(tmp_path, overwrite=True)


@pytest.mark.parametrize(
    "name", ["../victim", "/victim", "a//b", "a/../../victim", 7, "a\0b", "a\udc80"]
)
def test_a_list_of_files_that_points_outside_is_refused(tmp_path, name):
    out = tmp_path / "out"
    out.mkdir()
    (tmp_path / "victim").touch()
    (out / "result.json").write_text(json.dumps({"glvis_schema": 1, "files": [name]}))
    with pytest.raises(
        StudyError, match=r"its list of files is broken|has a text that is no Unicode"
    ):
        ResultFolder(out, overwrite=True)
    assert (tmp_path / "victim").exists()


def test_a_file_in_place_of_the_folder_is_refused(tmp_path):
    (tmp_path / "file").touch()
    with pytest.raises(StudyError, match="is a file; the result needs a folder"):
        ResultFolder(tmp_path / "file")
    with pytest.raises(StudyError, match=r"cannot be a folder: .*file"):
        ResultFolder(tmp_path / "file" / "deeper")


@pytest.mark.skipif(not Path("/proc/self").exists(), reason="this system has no /proc")
def test_a_folder_that_cannot_be_written_is_refused_before_the_run():
    with pytest.raises(MachineError, match=r"^/proc/glvis/out: cannot be written to: "):
        ResultFolder(Path("/proc/glvis/out"))


@pytest.mark.skipif(os.geteuid() == 0, reason="permissions do not bind the superuser")
def test_a_folder_without_permission_is_refused_before_the_run(tmp_path):
    tmp_path.chmod(0o500)
    with pytest.raises(MachineError, match="cannot be written to: Permission denied"):
        ResultFolder(tmp_path / "out")


def test_installers_numbers_turn_back_into_the_pose(placement):
    for pose in sensor_poses(placement):
        azimuth, elevation = math.radians(pose["azimuth_deg"]), math.radians(pose["elevation_deg"])
        d = [
            math.cos(azimuth) * math.cos(elevation),
            math.sin(azimuth) * math.cos(elevation),
            math.sin(elevation),
        ]
        assert np.allclose(d, pose["direction"], atol=1e-12)
