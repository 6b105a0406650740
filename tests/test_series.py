"""Many runs by one command: folders, tables, plots, and going on after a break."""

import csv
import json
import os
import shutil
import signal
import statistics
import subprocess
import sys
from pathlib import Path

import pytest
from PIL import Image
from support.two_cubes import SMALL, write_two_cubes

import glvis
from glvis.cli.app import main
from glvis.errors import MachineError
from glvis.pictures.writing import write_views
from glvis.results.journal import files_below
from glvis.results.reading import read_result

VARY = "\n[vary]\nmounts = [1, 2]\n"


@pytest.fixture
def study(tmp_path):
    (tmp_path / "study").mkdir()
    return write_two_cubes(tmp_path / "study")


@pytest.fixture(scope="module")
def results(tmp_path_factory):
    """A study, a search of it and a series of one, in folders of one folder."""
    folder = tmp_path_factory.mktemp("results")
    (folder / "home").mkdir()
    study = str(write_two_cubes(folder / "home"))
    for name, more in (("one", []), ("many", ["--repeats", "1"])):
        words = ["-o", str(folder / name), "--no-pictures", "--workers", "1", *more]
        assert main(["optimize", study, *words]) == 0
    return folder


@pytest.fixture
def run(capsys):
    def run(*arguments, pictures=False) -> tuple[int, str, str]:
        words = [str(argument) for argument in arguments]
        if words[0] == "optimize" and "--help" not in words:
            words += ["--workers", "1"] + ([] if pictures else ["--no-pictures"])
        code = main(words)
        out, err = capsys.readouterr()
        return code, out, err

    return run


def rows_of(path: Path) -> list[dict[str, str]]:
    with path.open(newline="") as file:
        return list(csv.DictReader(file))


def index_of(path: Path) -> dict:
    return json.loads(path.read_text())


def told(folder: Path) -> dict[str, bytes]:
    """Return all that must be the same however often a series was broken off."""
    names = [path.name for path in folder.iterdir() if path.suffix in (".csv", ".json", ".toml")]
    assert names
    return {name: (folder / name).read_bytes() for name in names}


def test_repeats_are_ordinary_results_with_other_seeds_and_a_table(run, study, tmp_path):
    out = tmp_path / "out"
    code, text, err = run("optimize", study, "-o", out, "--repeats", "3")
    assert code == 0
    assert err.count("iteration 2/2") == 3 and "run-03 of 3 (seed 3)\n" in err
    rows = rows_of(out / "repeats.csv")
    runs = [read_result(out / row["run"]) for row in rows]
    assert [row["run"] for row in rows] == ["run-01", "run-02", "run-03"]
    assert [placement.seed for placement in runs] == [1, 2, 3]
    assert [float(row["value"]) for row in rows] == [placement.value for placement in runs]
    assert run("optimize", study, "-o", tmp_path / "two", "--seed", "2")[0] == 0
    one, two = (index_of(path / "result.json") for path in (out / "run-02", tmp_path / "two"))
    del one["run"], two["run"]
    assert one == two

    index = index_of(out / "repeats.json")
    (point,) = index["points"]
    best = max(runs, key=lambda placement: placement.value)
    assert read_result(out / point["best"]).value == point["value"]["best"] == best.value
    assert point["value"]["std"] == statistics.stdev(placement.value for placement in runs)
    assert (index["planned"], index["finished"], index["best"]) == (3, 3, point["best"])
    assert [row["max_position_from_best"] for row in rows if row["run"] == point["best"]] == ["0.0"]
    assert f"\nBest: {out / point['best']}\n" in text
    assert "Poses differ from the best run's by " in text
    with Image.open(out / "repeats.png") as plot:
        assert plot.size == (1600, 1000)
    assert sorted(path.name for path in out.iterdir()) == [
        "repeats.csv", "repeats.json", "repeats.png", "run-01", "run-02", "run-03", "study.toml",
    ]  # fmt: skip


def test_series_over_the_number_of_mounts(run, study, tmp_path):
    study.write_text(SMALL + VARY)
    out = tmp_path / "out"
    code, text, _ = run("optimize", study, "-o", out, "--repeats", "2", "--set", "title=Cubes")
    assert code == 0
    rows = rows_of(out / "runs.csv")
    found = [read_result(out / f"run-0{k}") for k in range(1, 5)]
    assert [row["mounts"] for row in rows] == ["1", "2", "1", "2"]
    assert [placement.seed for placement in found] == [1, 1, 2, 2]
    assert [len(placement.study.sensors) for placement in found] == [2, 3, 2, 3]
    assert [placement.study.title for placement in found[:2]] == [
        "Cubes (mounts = 1)", "Cubes (mounts = 2)",
    ]  # fmt: skip
    assert "[vary]" not in (out / "run-01" / "study.toml").read_text()
    points = rows_of(out / "vary.csv")
    for k, point in enumerate(points):
        values = [placement.value for placement in found[k::2]]
        assert float(point["value_mean"]) == statistics.fmean(values)
        assert float(point["value_std"]) == statistics.stdev(values)
        assert (point["mounts"], point["sensors"], point["finished"]) == (
            str(k + 1),
            str(k + 2),
            "2",
        )
        assert read_result(out / point["best"]).value == max(values)
    with Image.open(out / "vary.png") as plot:
        assert plot.size == (1600, 1000)
    assert [line.split()[:3] for line in text.splitlines()[1:3]] == [
        ["1", "2", "2"],
        ["2", "3", "2"],
    ]


def test_plot_of_a_grid_runs_along_the_numbers_with_a_line_for_the_rest(
    run, study, tmp_path, monkeypatch
):
    drawn = {}
    monkeypatch.setattr(
        "glvis.reports.series_tables.write_vary",
        lambda path, panels, **options: path.touch() or drawn.update(options, panels=panels),
    )
    out = tmp_path / "out"
    options = ("--vary", "visibility.criterion=pixels,centroid", "--vary", "mount.C.roll_deg=0,45")
    assert run("optimize", study, "-o", out, *options, "--repeats", "2")[0] == 0
    assert (drawn["x_label"], drawn["are_numbers"]) == ("mount.C.roll [deg]", True)
    assert drawn["ticks"] == [(0.0, "0"), (45.0, "45")]
    value, seen = drawn["panels"]
    assert (value.quantity, seen.quantity) == ("OF3", "faces seen [%]")
    rows = rows_of(out / "runs.csv")
    for panel, column in ((value, "value"), (seen, "percentage")):
        assert [line.label for line in panel.lines] == [
            "visibility.criterion = 'pixels'", "visibility.criterion = 'centroid'",
        ]  # fmt: skip
        # run-01 to run-04 are the combinations, the rest the same with the next seed
        numbers = [[float(rows[k][column]), float(rows[k + 4][column])] for k in range(4)]
        assert [values for line in panel.lines for values in line.values] == numbers


def test_values_by_area_and_by_faces_have_no_common_axis(run, study, tmp_path, monkeypatch):
    drawn = []

    def write(path, panels, **options):
        path.touch()
        drawn.extend(panel.quantity for panel in panels)

    monkeypatch.setattr("glvis.reports.series_tables.write_vary", write)
    out = tmp_path / "out"
    assert run("optimize", study, "-o", out, "--vary", "objective.by_area=false,true")[0] == 0
    assert drawn == ["faces seen [%]", "area seen [%]"]
    points = json.loads((out / "vary.json").read_text())["points"]
    assert [point["objective"] for point in points] == ["OF3", "OF3 by area"]


def test_other_commands_work_on_a_run_and_name_one_where_the_series_is_given(run, study, tmp_path):
    out = tmp_path / "out"
    run("optimize", study, "-o", out, "--vary", "objective.kind=of1,of2", "--vary", "mounts=2")
    assert run("explain", out / "run-02")[0] == 0
    assert run("compare", out / "run-01", out / "run-02")[0] == 0
    code, _, err = run("explain", out)
    fact = "does not exist; the folder holds many runs, name one, such as"
    assert (code, err) == (2, f"error: {out / 'result.json'}: {fact} {out / 'run-01'}\n")


def test_the_runs_and_their_cost_are_told_before_anything_starts(run, study, tmp_path):
    study.write_text(SMALL + VARY)
    before = files_below(tmp_path)
    code, dry, err = run("optimize", study, "--repeats", "2", "--dry-run")
    more = "and at most as many again to learn what is within reach"
    assert (code, err) == (0, "")
    assert [" ".join(line.split()) for line in dry.splitlines()] == [
        "4 runs: 2 combinations of the varied values, 2 seeds each",
        "mounts runs seeds sensors variables maps a run, at most maps",
        "1 run-01, run-03 1, 2 2 1 48 96",
        "2 run-02, run-04 1, 2 3 1 72 144",
        f"At most 240 maps in all, {more}",
    ]
    code, text, _ = run("check", study)
    assert code == 0
    assert "\n2 runs: 2 combinations of the varied values\n" in text
    assert text.endswith(f"\nAt most 120 maps in all, {more}\n")
    study.write_text(SMALL + VARY.replace("2", "3"))
    assert run("check", study)[:2] == (2, "")
    study.write_text(SMALL + VARY)
    assert files_below(tmp_path) == before


def test_pictures_are_made_of_the_best_run(run, study, tmp_path, monkeypatch):
    def small(*arguments, **options):
        return write_views(*arguments, **options | {"size": (320, 200)})

    monkeypatch.setattr("glvis.reports.delivery.write_views", small)
    out = tmp_path / "out"
    code, _, err = run("optimize", study, "-o", out, "--repeats", "2", pictures=True)
    assert code == 0
    best = index_of(out / "repeats.json")["points"][0]["best"]
    assert f"Making the pictures of {best} ..." in err
    assert [path.parent.name for path in out.glob("*/views")] == [best]
    code, _, err = run("optimize", "--resume", out, pictures=True)
    assert (code, err) == (0, "")  # nothing is left to do


@pytest.mark.parametrize(
    ("error", "fact"),
    [(MachineError("no memory"), "could not be made: no memory"), (KeyboardInterrupt(), "Ctrl-C")],
)
def test_pictures_that_fail_do_not_cost_the_series(run, study, tmp_path, monkeypatch, error, fact):
    def fail(*arguments, **options):
        raise error

    monkeypatch.setattr("glvis.reports.delivery.write_views", fail)
    out = tmp_path / "out"
    code, text, _ = run("optimize", study, "-o", out, "--repeats", "2", pictures=True)
    assert code == 1
    assert "Warning: " in text and fact in text
    assert index_of(out / "repeats.json")["finished"] == 2
    assert read_result(out / "run-01").seed == 1


LONG = SMALL.replace("iterations = 2", "iterations = 20\nstall_iterations = 20")


def started(*arguments, line):
    """Start a series; return when it has said a line that begins so."""
    command = [sys.executable, "-m", "glvis", "optimize", *arguments, "--no-pictures"]
    command += ["--workers", "1"]
    process = subprocess.Popen(command, stderr=subprocess.PIPE, stdout=subprocess.PIPE, text=True)
    for said in process.stderr:
        if said.startswith(line):
            break
    assert "  best " in process.stderr.readline()  # the first iteration of this run
    return process


def test_killed_series_goes_on_to_the_tables_of_an_unbroken_one(run, study, tmp_path):
    study.write_text(LONG + VARY)
    whole, broken = tmp_path / "whole", tmp_path / "broken"
    assert run("optimize", study, "-o", whole, "--repeats", "2")[0] == 0
    with started(study, "-o", broken, "--repeats", "2", line="run-02 of 4") as process:
        process.kill()
    assert index_of(broken / "vary.json")["finished"] == 1
    kept = (broken / "run-01" / "result.json").read_bytes()
    with started("--resume", broken, line="run-03 of 4") as process:
        process.kill()
    study.unlink()  # the series has its own
    code, _, err = run("optimize", "--resume", broken)
    assert code == 0
    assert "run-01" not in err and "run-02" not in err and "run-04 of 4" in err
    assert told(broken) == told(whole)
    assert (broken / "run-01" / "result.json").read_bytes() == kept
    for name in ("run-02", "run-03"):
        first, second = (index_of(path / name / "result.json") for path in (broken, whole))
        del first["run"], second["run"]
        assert first == second


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_interrupted_series_leaves_a_summary_of_what_is_done(run, study, tmp_path, number):
    out, whole = tmp_path / "out", tmp_path / "whole"
    text = SMALL + "stall_iterations = 60\n[vary]\nswarm.iterations = [1, 60, 2]\n"
    study.write_text(text)
    with started(study, "-o", out, line="run-02 of 3") as process:
        process.send_signal(number)
        text, err = process.communicate(timeout=60)
    assert process.returncode == 0
    assert "run-03" not in err
    assert f"\n1 of 3 runs are finished; glvis optimize --resume {out} goes on\n" in text
    assert [row["stop_reason"].split(":")[0] for row in rows_of(out / "runs.csv")] == [
        "finished", "interrupted",
    ]  # fmt: skip
    assert [run["state"] for run in index_of(out / "vary.json")["runs"]] == [
        "finished", "interrupted", "waiting",
    ]  # fmt: skip
    assert read_result(out / "run-02").stop_reason.startswith("interrupted")
    assert (out / "vary.png").exists()
    assert run("optimize", out)[0] == 0  # the same as --resume
    assert run("optimize", study, "-o", whole)[0] == 0
    assert told(out) == told(whole)


def test_interrupt_between_two_searches_ends_the_series_too(run, study, tmp_path, monkeypatch):
    def interrupted(*arguments, **options):
        raise KeyboardInterrupt

    out, whole = tmp_path / "out", tmp_path / "whole"
    assert run("optimize", study, "-o", whole, "--repeats", "2")[0] == 0
    monkeypatch.setattr("glvis.reports.series.deliver", interrupted)
    code, text, _ = run("optimize", study, "-o", out, "--repeats", "2")
    assert code == 0
    assert text.startswith("No run has finished\n\n0 of 2 runs are finished; glvis optimize --res")
    monkeypatch.undo()
    assert run("optimize", "--resume", out)[0] == 0
    assert told(out) == told(whole)


def test_repeats_are_added_to_a_finished_series(run, study, tmp_path):
    study.write_text(SMALL + VARY)
    out, whole = tmp_path / "out", tmp_path / "whole"
    assert run("optimize", study, "-o", out)[0] == 0
    code, _, err = run("optimize", "--resume", out, "--repeats", "2")
    assert code == 0
    assert [line for line in err.splitlines() if line.startswith("run-")] == [
        "run-03 of 4 (mounts = 1, seed 2)", "run-04 of 4 (mounts = 2, seed 2)",
    ]  # fmt: skip
    assert run("optimize", study, "-o", whole, "--repeats", "2")[0] == 0
    assert told(out) == told(whole)
    code, _, err = run("optimize", "--resume", out, "--repeats", "1")
    assert (code, err) == (2, f"error: {out}: has 2 repeats, --repeats can only add to them\n")


def test_run_of_a_series_that_was_cut_off_can_go_on_alone(run, study, tmp_path):
    out = tmp_path / "out"
    run("optimize", study, "-o", out, "--repeats", "2")
    assert run("optimize", "--resume", out / "run-01", "--extend", "2")[0] == 0
    assert len(read_result(out / "run-01").trace) == 5


def test_search_killed_while_its_files_took_their_places_goes_on(run, study, tmp_path):
    out, whole = tmp_path / "out", tmp_path / "whole"
    assert run("optimize", study, "-o", whole)[0] == 0
    shutil.copytree(whole, out)
    (out / "result.json").unlink()
    (out / "unfinished").mkdir()
    (out / "study.toml").rename(out / "unfinished" / "study.toml")  # moves after the checkpoint
    assert run("optimize", "--resume", out)[0] == 0
    assert read_result(out).value == read_result(whole).value


def test_series_of_a_study_without_variables_is_evaluated(run, study, tmp_path):
    out = tmp_path / "out"
    code, _, _ = run(
        "optimize", study, "-o", out, "--vary", "mount.A.position.0=3,4", "--set",
        "objective.kind=of1",
    )  # fmt: skip
    assert code == 0
    values = []
    for place in (3, 4):
        loaded = glvis.load_study(study, [f"mount.A.position.0={place}", "objective.kind=of1"])
        values.append(glvis.evaluate_poses(loaded).value)
    assert [float(row["value"]) for row in rows_of(out / "runs.csv")] == values
    assert run("optimize", "--resume", out)[:1] == (0,)


def test_varied_meshes_are_found_from_the_study_s_own_folder(run, study, tmp_path):
    vary = "\n[vary]\nscene.models = [['cube.off'], ['s*.off'], ['cube.off', 'small.off']]\n"
    study.write_text(SMALL + vary)
    out = tmp_path / "out"
    assert run("optimize", study, "-o", out)[0] == 0
    runs = [read_result(out / f"run-0{k}") for k in (1, 2, 3)]
    assert [[model.name for model in found.study.models] for found in runs] == [
        ["cube"], ["small"], ["cube", "small"],
    ]  # fmt: skip
    assert runs[2].study.title == "Two cubes (scene.models = ['cube.off', 'small.off'])"
    assert run("optimize", "--resume", out)[:1] == (0,)


def test_overwrite_replaces_a_series_and_leaves_what_is_not_its_own(run, study, tmp_path):
    out = tmp_path / "out"
    run("optimize", study, "-o", out, "--repeats", "3")
    (out / "notes.txt").write_text("mine")
    (out / "run-02" / "notes.txt").write_text("mine")
    code, _, err = run("optimize", study, "-o", out, "--repeats", "2")
    assert code == 2
    assert err == (
        f"error: {out}: holds a series of runs already; go on with it by --resume {out}, or start "
        "anew with --overwrite\n"
    )
    code, _, _ = run("optimize", study, "-o", out, "--vary", "mounts=1", "--overwrite")
    assert code == 0
    assert sorted(path.name for path in out.iterdir()) == [
        "notes.txt", "run-01", "run-02", "runs.csv", "study.toml", "vary.csv", "vary.json",
        "vary.png",
    ]  # fmt: skip
    assert files_below(out / "run-02") == ["notes.txt"]


@pytest.mark.parametrize(
    ("arguments", "fact"),
    [
        (["STUDY", "-o", "OUT", "--repeats", "0"], "'--repeats'"),
        (["STUDY", "--repeats", "2"], "needs STUDY and -o DIR, or --resume DIR"),
        (["STUDY", "-o", "OUT", "--vary", "mounts=3"], "[vary] with mounts = 3: "),
        (
            ["STUDY", "-o", "OUT", "--sweep", "mounts=1"],
            "--sweep is called --vary now: give it the same KEY=VALUE,VALUE,...",
        ),
        (["STUDY", "-o", "STUDY", "--repeats", "2"], "is a file; the results need a folder"),
        (["STUDY", "-o", "ONE", "--repeats", "2"], "is not empty and holds the result of one run"),
        (["STUDY", "-o", "ONE", "--repeats", "2", "--overwrite"], "holds the result of one run"),
        (["STUDY", "-o", "HOME", "--repeats", "2"], "is not empty and holds no series of glvis"),
        (["STUDY", "-o", "MANY", "--overwrite"], "is not empty and holds no result of glvis"),
        (["--resume", "ONE", "--repeats", "2"], "ONE: holds no series of runs"),
        (["--resume", "MANY", "--extend", "2"], "--extend adds to one search: --resume the folder"),
        (["--resume", "MANY", "--seed", "2"], "--resume: a series goes on with its own study"),
        (["STUDY", "--resume", "MANY"], "--resume: a series goes on with its own study"),
    ],
)
def test_what_cannot_be_is_one_line_and_leaves_all_as_it_was(run, results, arguments, fact):
    places = {word: results / word.lower() for word in ("OUT", "ONE", "MANY", "HOME")}
    places["STUDY"] = places["HOME"] / "study.toml"
    before = {name: (results / name).read_bytes() for name in files_below(results)}
    code, text, err = run("optimize", *(places.get(word, word) for word in arguments))
    (line,) = err.splitlines()
    assert (code, text) == (2, "")
    for word in ("ONE", "MANY"):
        fact = fact.replace(f"{word}:", f"{places[word]}:")
    assert line.startswith("error: ") and fact in line
    assert {name: (results / name).read_bytes() for name in files_below(results)} == before
    assert not places["OUT"].exists()


@pytest.mark.parametrize("command", ["check", "optimize"])
def test_help_names_the_table(run, command):
    assert "[vary]" in run(command, "--help")[1]


def test_old_name_of_an_option_stands_in_no_help(run):
    assert "--sweep" not in run("optimize", "--help")[1]


def test_series_of_a_build_that_said_sweep_goes_on(run, study, tmp_path):
    study.write_text(SMALL + VARY)
    out = tmp_path / "out"
    assert run("optimize", study, "-o", out, "--no-pictures")[0] == 0
    index = json.loads((out / "vary.json").read_text())
    index["sweep"] = index.pop("vary")
    (out / "sweep.json").write_text(json.dumps(index))
    for name in ("vary.json", "vary.csv", "vary.png"):
        (out / name).unlink()
    (out / "sweep.csv").touch()
    assert run("optimize", "--resume", out, "--repeats", "2", "--no-pictures")[0] == 0
    assert index_of(out / "vary.json")["finished"] == 4
    study.write_text(SMALL)
    assert run("optimize", study, "-o", out, "--repeats", "2", "--overwrite")[0] == 0
    assert not {"sweep.json", "sweep.csv", "vary.json"} & set(files_below(out))


@pytest.mark.parametrize("text", ["{}", "no json", '{"glvis_schema": 1, "repeats": "many"}'])
def test_broken_index_is_one_line(run, results, tmp_path, text):
    out = tmp_path / "out"
    shutil.copytree(results / "many", out)
    (out / "repeats.json").write_text(text)
    code, _, err = run("optimize", "--resume", out)
    assert code == 2
    assert err.startswith(f"error: {out / 'repeats.json'}: is no ") and err.count("\n") == 1


def test_no_opengl_is_one_line_and_leaves_nothing(study, tmp_path):
    out = tmp_path / "deep" / "out"
    run = subprocess.run(
        [sys.executable, "-m", "glvis", "optimize", study, "-o", out, "--repeats", "2"],
        env={**os.environ, "GLVIS_GL": "vulkan"}, capture_output=True, text=True, check=False,
    )  # fmt: skip
    assert run.returncode == 1
    assert run.stderr.splitlines()[-1].startswith("error: GLVIS_GL = 'vulkan' must be one of")
    assert not (tmp_path / "deep").exists()
