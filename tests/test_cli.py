"""The command line: from a file to a result folder, and what it says on the way."""

import io
import json
import math
import os
import signal
import subprocess
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from support.two_cubes import SMALL, write_two_cubes

import glvis
from glvis.cli.app import main
from glvis.cli.terminal import _Lines, duration, say, table
from glvis.errors import MachineError
from glvis.pictures.writing import write_views
from glvis.results.journal import files_below
from glvis.results.reading import read_result
from glvis.search.placement import Progress

EXPORTS = ["README.txt", "blender_scene.py", "colmap/cameras.txt", "colmap/images.txt"]
EXPORTS += ["colmap/points3D.txt", "cube.ply", "ros/sensors.urdf", "ros/static_transforms.sh"]
EXPORTS += ["scene.glb", "small.ply"]
DATA = ["coverage.csv", *(f"exports/{name}" for name in EXPORTS), "mounting.txt", "poses.csv"]
DATA += ["report.html", "result.json", "sensors.csv", "study.toml", "trace.csv", "visibility.npz"]
BROKEN_OFF = ["checkpoint.npz", *DATA]
SEARCHED = sorted([*BROKEN_OFF, "reach.npz"])


@pytest.fixture
def study(tmp_path):
    (tmp_path / "study").mkdir()
    return write_two_cubes(tmp_path / "study")


@pytest.fixture
def glvis_cli(capsys):
    """Run the command line in this process; return exit code, output and errors."""

    def run(*arguments) -> tuple[int, str, str]:
        words = [str(argument) for argument in arguments]
        if words[0] == "optimize" and "--workers" not in words and "--help" not in words:
            words += ["--workers", "1"]  # others take seconds to start
        code = main(words)
        out, err = capsys.readouterr()
        return code, out, err

    return run


def index_of(folder: Path) -> dict:
    return json.loads((folder / "result.json").read_text())


@pytest.mark.parametrize("option", ["--version", "-V"])
def test_version_is_printed(glvis_cli, option):
    assert glvis_cli(option) == (0, f"glvis {glvis.__version__}\n", "")


@pytest.mark.parametrize(
    ("words", "offered"),
    [("glvis opt", ["optimize"]), ("glvis optimize --no", ["--no-pictures", "--no-meshes"])],
)
def test_shells_complete_commands_and_options(words, offered):
    done = subprocess.run(
        [sys.executable, "-m", "glvis"],
        env=os.environ
        | {"_GLVIS_COMPLETE": "complete_bash", "COMP_WORDS": words}
        | {"COMP_CWORD": str(len(words.split()) - 1)},
        capture_output=True,
        text=True,
        check=True,
    )
    assert (done.stdout.split(), done.stderr) == (offered, "")


def test_help_runs_on_over_the_lines_of_its_source(glvis_cli):
    _, out, _ = glvis_cli("optimize", "--help")
    text = " ".join(out.split())
    assert "The state of the search is kept after every iteration: what was killed goes" in text
    lines = [line.strip() for line in out.splitlines()]
    first = next(k for k, line in enumerate(lines) if line.startswith("Ctrl-C ends"))
    assert len(lines[first]) + len(lines[first + 1].split()[0]) > 70  # no line ends early


@pytest.mark.parametrize("command", ["check", "evaluate", "optimize", "render", "doctor"])
def test_help_of_every_command_ends_well(glvis_cli, command):
    code, out, _ = glvis_cli(command, "--help")
    assert code == 0
    assert f"glvis {command}" in out


def test_help_needs_no_mesh_library_and_no_opengl():
    code = (
        "import sys; from glvis.cli.app import main; assert main(['--help']) == 0; "
        "heavy = {'trimesh', 'moderngl', 'pydantic', 'pyswarms', 'scipy'} & set(sys.modules); "
        "assert not heavy, heavy"
    )
    subprocess.run([sys.executable, "-c", code], check=True, stdout=subprocess.DEVNULL)


def test_check_says_what_is_in_a_study(glvis_cli, study):
    code, out, err = glvis_cli("check", study)
    assert (code, err) == (0, "")
    words = [line.split() for line in out.splitlines()]
    assert ["model", "cube", "12", "6", "1.13807", "closed"] in words
    assert ["cube", "eye", "none:", "by", "points", "0.0", "%", "6", "mm"] in words
    assert ["A.position.x", "2", "6", "3"] in words
    assert "eye: 60 x 42 deg, 96 x 64 pixels, 0 to 12 mm" in out
    assert "3 of them: A, B, C" in out
    assert "One evaluation (6 maps): " in out
    assert "A full run of 72 maps: an estimated " in out
    assert "to sample what is within reach" in out
    assert "OpenGL: " in out
    (warning,) = (line for line in out.splitlines() if "Warning" in line)
    assert warning == (
        "Warning: cube: is 1.73 mm across; are these metres (1.73 m) or inches (44 mm)? "
        "unit = 'm' or 'in' (likewise small: 2 models)"
    )
    assert "Warning" not in glvis_cli("check", study, "--set", "unit=m")[1]


def test_check_warns_of_what_will_disappoint(glvis_cli, study):
    code, out, _ = glvis_cli(
        "check", study, "--set", "scene.scale=0.001", "--set", "visibility.resolution=[32, 32]"
    )
    assert code == 0
    assert "Warning: cube: is 0.00173 mm across, the sensors reach 12 mm; is unit = 'mm'" in out
    assert "Warning: cube: 100 % of the faces are smaller than a pixel of eye" in out
    assert out.count("smaller than a pixel") == 1  # not once a model
    assert out.count("(likewise small: 2 models)") >= 2


def test_check_says_what_a_study_leaves_to_defaults(glvis_cli, study):
    assert "(by default" not in glvis_cli("check", study)[1]
    text = study.read_text()
    bare = text.replace('kind = "of3"\nby_area = false\n', "").replace('method = "swarm"\n', "")
    study.write_text(bare)
    _, out, _ = glvis_cli("check", study)
    assert (
        "Objective: OF1 by area; mean over 2 models "
        "(by default: the study does not say objective.kind)\n"
        "Search: auto, seed 1 (by default: the study does not say search.method)\n"
    ) in out
    assert "Warning: [swarm]: its options have no say in 'auto', which searches" in out
    study.write_text(bare.replace("particles = 4\niterations = 2\n", "seed = 3\n"))
    assert "[swarm]" not in glvis_cli("check", study)[1]


def test_check_writes_nothing(glvis_cli, study, tmp_path, monkeypatch):
    (tmp_path / "here").mkdir()
    monkeypatch.chdir(tmp_path / "here")
    before = files_below(tmp_path)
    assert glvis_cli("check", study)[0] == 0
    assert files_below(tmp_path) == before


def test_evaluate_writes_what_the_start_sees(glvis_cli, study, tmp_path):
    code, out, err = glvis_cli("evaluate", study, "-o", tmp_path / "out", "--no-pictures")
    assert (code, err) == (0, "")
    assert files_below(tmp_path / "out") == DATA
    index = index_of(tmp_path / "out")
    assert index["search"]["stop_reason"] == "evaluated only"
    assert index["variables"][0]["value"] == 3.0
    loaded = glvis.load_study(study)
    with glvis.Evaluator(loaded) as evaluator:
        assert index["objective"]["value"] == evaluator(loaded.rig.start)[0]
    assert [line.split()[:2] for line in out.splitlines()][2] == ["cube", str(
        index["models"][0]["seen_by_all_cameras"]
    )]  # fmt: skip


@pytest.mark.parametrize(
    ("command", "below"),
    [
        (["evaluate"], "."),
        (["optimize"], "."),
        (["optimize", "--repeats", "1"], "run-01"),
    ],
)
def test_coloured_meshes_can_be_left_out(glvis_cli, study, tmp_path, command, below):
    out = tmp_path / "out"
    code, _, _ = glvis_cli(*command, study, "-o", out, "--no-pictures", "--no-meshes")
    assert code == 0
    exports = files_below(out / below / "exports")
    meshes = {name for name in DATA if name.endswith((".ply", ".glb"))}
    assert len(meshes) == 3
    assert {f"exports/{name}" for name in exports} == {
        name for name in DATA if name.startswith("exports/")
    } - meshes
    text = (out / below / "exports" / "README.txt").read_text()
    assert "colmap/" in text and ".ply" not in text and ".glb" not in text
    assert "SURFACES = []" in (out / below / "exports" / "blender_scene.py").read_text()


def test_evaluate_takes_the_poses_of_another_result(glvis_cli, study, tmp_path):
    one, two = tmp_path / "one", tmp_path / "two"
    glvis_cli("optimize", study, "-o", one, "--no-pictures", "--seed", "5")
    code, _, _ = glvis_cli(
        "evaluate", study, "-o", two, "--no-pictures", "--poses", one / "result.json"
    )
    assert code == 0
    a, b = read_result(one), read_result(two)
    assert np.array_equal(a.camera_to_world, b.camera_to_world)
    assert a.value == b.value
    for first, second in zip(a.maps, b.maps, strict=True):
        assert np.array_equal(first.visible, second.visible)


def test_optimize_writes_a_whole_result(glvis_cli, study, tmp_path):
    out = tmp_path / "out"
    code, text, err = glvis_cli("optimize", study, "-o", out, "--no-pictures")
    assert code == 0
    assert files_below(out) == SEARCHED
    found = read_result(out)
    assert found.value >= found.start_value
    assert found.stop_reason == "finished: all 2 iterations done"
    assert "\nFinished: all 2 iterations done" in text
    assert f"OF3 = {found.value:.6g} (start: {found.start_value:.6g})" in text
    assert err.startswith("iteration 0/2  best ")
    assert f"iteration 2/2  best {found.value:.6g}" in err


def test_settings_and_seed_go_before_the_file_and_stay_with_the_result(glvis_cli, study, tmp_path):
    out = tmp_path / "out"
    code, _, _ = glvis_cli(
        "optimize", study, "-o", out, "--no-pictures", "--seed", "7", "--set",
        "swarm.particles=6", "--set", "mount.C.roll_deg=0",
    )  # fmt: skip
    assert code == 0
    kept = glvis.load_study(out / "study.toml")
    assert (kept.swarm.seed, kept.swarm.particles, kept.swarm.iterations) == (7, 6, 2)
    index = index_of(out)
    assert index["search"]["seed"] == 7
    assert index["search"]["evaluations"] == 18
    assert index["poses"][2]["roll_deg"] == 0


def test_the_kept_study_runs_again_to_the_same_result(glvis_cli, study, tmp_path):
    one, two = tmp_path / "one", tmp_path / "two"
    glvis_cli("optimize", study, "-o", one, "--no-pictures", "--seed", "3")
    glvis_cli("optimize", one / "study.toml", "-o", two, "--no-pictures")
    first, second = index_of(one), index_of(two)
    for index in (first, second):
        del index["run"]
    assert first == second


def test_overwrite_replaces_a_result(glvis_cli, study, tmp_path):
    out = tmp_path / "out"
    glvis_cli("evaluate", study, "-o", out, "--no-pictures")
    code, _, err = glvis_cli("evaluate", study, "-o", out, "--no-pictures")
    assert code == 2
    assert err == (
        f"error: {out}: holds a result already; replace it with --overwrite "
        "or choose another folder\n"
    )
    code, _, _ = glvis_cli("optimize", study, "-o", out, "--no-pictures", "--overwrite")
    assert code == 0
    assert index_of(out)["search"]["stop_reason"].startswith("finished")


def test_nothing_is_written_outside_the_result_folder(glvis_cli, study, tmp_path, monkeypatch):
    (tmp_path / "here").mkdir()
    monkeypatch.chdir(tmp_path / "here")
    before = files_below(tmp_path)
    assert glvis_cli("optimize", study, "-o", "out", "--no-pictures")[0] == 0
    new = set(files_below(tmp_path)) - set(before)
    assert new == {f"here/out/{name}" for name in SEARCHED}


def test_pictures_that_fail_do_not_cost_the_result(glvis_cli, study, tmp_path, monkeypatch):
    def no_pictures(placement, directory, look):
        (directory / "views").mkdir()
        (directory / "views" / "half.png").touch()
        raise MachineError("no more memory on the GPU")

    monkeypatch.setattr("glvis.reports.delivery.write_pictures", no_pictures)
    out = tmp_path / "out"
    code, text, _ = glvis_cli("evaluate", study, "-o", out)
    assert code == 1
    assert "Warning: the pictures could not be made: no more memory on the GPU; glvis" in text
    assert files_below(out) == DATA
    (warning,) = index_of(out)["warnings"]
    assert warning.endswith(f"no more memory on the GPU; glvis render {out} makes them")


def test_ctrl_c_while_pictures_are_made_leaves_the_result(glvis_cli, study, tmp_path, monkeypatch):
    def interrupted(placement, directory, look):
        raise KeyboardInterrupt

    monkeypatch.setattr("glvis.reports.delivery.write_pictures", interrupted)
    code, text, _ = glvis_cli("evaluate", study, "-o", tmp_path / "out")
    assert code == 1
    assert "Warning: the pictures were left out on Ctrl-C; glvis render" in text
    assert files_below(tmp_path / "out") == DATA


def test_pictures_come_with_a_result_and_can_be_made_again(glvis_cli, study, tmp_path, monkeypatch):
    def small(*arguments, **options):
        return write_views(*arguments, **options | {"size": (320, 200)})

    monkeypatch.setattr("glvis.reports.delivery.write_views", small)
    out = tmp_path / "out"
    code, text, err = glvis_cli("optimize", study, "-o", out)
    assert code == 0
    assert err.endswith("Making the pictures ...\n")
    views = sorted((out / "views").glob("*.png"))
    assert {"cube-sensor-perspective.png", "sensor-C.png", "convergence.png"} <= {
        path.name for path in views
    }
    assert index_of(out)["files"] == files_below(out)
    assert "(report.html, views/, result.json, " in text
    (out / "views" / "notes.txt").write_text("mine")
    first = {path: path.read_bytes() for path in views}
    for path in views[::2]:
        path.unlink()
    code, text, _ = glvis_cli("render", out)
    assert code == 0
    assert text.startswith(f"{len(views)} pictures in {out}: views/")
    assert {path: path.read_bytes() for path in views} == first
    assert (out / "views" / "notes.txt").read_text() == "mine"


def test_one_kind_of_picture_is_made_as_asked(glvis_cli, study, tmp_path):
    out = tmp_path / "out"
    glvis_cli("evaluate", study, "-o", out, "--no-pictures")
    code, text, _ = glvis_cli("render", out, "--color", "unseen", "--size", "400x300")
    assert code == 0
    names = ["views/cube-unseen.png", "views/small-unseen.png"]
    assert text == f"2 pictures in {out}: {', '.join(names)}\n"
    assert index_of(out)["files"] == files_below(out) == sorted([*DATA, *names])
    picture = (out / names[0]).read_bytes()
    assert picture[16:24] == bytes([0, 0, 1, 0x90, 0, 0, 1, 0x2C])  # 400 x 300
    code, _, _ = glvis_cli(
        "render", out, "--color", "unseen", "--size", "400x300", "--view", "90,0"
    )
    assert code == 0
    assert (out / names[0]).read_bytes() != picture


def test_a_single_picture_is_told_as_one(glvis_cli, study, tmp_path):
    study.write_text(study.read_text().replace('"cube.off", "small.off"', '"cube.off"'))
    out = tmp_path / "out"
    glvis_cli("evaluate", study, "-o", out, "--no-pictures")
    _, text, _ = glvis_cli("render", out, "--color", "unseen")
    assert text == f"1 picture in {out}: views/cube-unseen.png\n"


@pytest.mark.parametrize(
    ("arguments", "fact"),
    [
        (["--color", "red"], "color = 'red' must be one of sensor, overlap, incidence, dist"),
        (["--size", "10x10"], "size = 10 x 10 must be at least 200 x 200 pixels"),
        (["--size", "400"], "--size 400: must be two numbers with 'x' between, as 1920x1080"),
        (["--view", "up"], "--view up: must be two numbers with ',' between, as 30,20"),
    ],
)
def test_wrong_wishes_for_pictures_are_refused(glvis_cli, study, tmp_path, arguments, fact):
    out = tmp_path / "out"
    glvis_cli("evaluate", study, "-o", out, "--no-pictures")
    code, text, err = glvis_cli("render", out, *arguments)
    assert (code, text) == (2, "")
    assert err.startswith(f"error: {fact}")
    assert files_below(out) == DATA


def test_a_folder_without_result_cannot_be_rendered(glvis_cli, tmp_path):
    code, _, err = glvis_cli("render", tmp_path)
    assert (code, err) == (2, f"error: {tmp_path / 'result.json'}: does not exist\n")


def test_doctor_names_the_driver(glvis_cli):
    code, out, err = glvis_cli("doctor")
    assert (code, err) == (0, "")
    assert "OpenGL: " in out
    assert out.endswith("The driver draws the known scene of the self-test as it should\n")


QUICK = ["--no-pictures", "--workers", "1"]
ENDLESS = "iterations = 1000000\nstall_iterations = 1000000"


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM, signal.SIGHUP])
def test_interrupted_search_ends_in_a_complete_result(tmp_path, number):
    (tmp_path / "study").mkdir()
    study = write_two_cubes(tmp_path / "study", SMALL.replace("iterations = 2", ENDLESS))
    out = tmp_path / "out"
    command = [sys.executable, "-m", "glvis", "optimize", study, "-o", out, *QUICK]
    with subprocess.Popen(command, stderr=subprocess.PIPE, stdout=subprocess.PIPE, text=True) as p:
        try:
            assert p.stderr.readline().startswith("iteration 0/1000000")
            p.send_signal(number)
            text, _ = p.communicate(timeout=60)
        finally:
            p.kill()
    assert p.returncode == 0
    assert "\nInterrupted: " in text
    assert files_below(out) == BROKEN_OFF
    found = read_result(out)
    assert found.stop_reason.startswith("interrupted: ")
    assert found.value >= found.start_value


def started(*arguments) -> subprocess.Popen:
    """Start a search that has no end, and return when its first iteration is done."""
    command = [sys.executable, "-m", "glvis", "optimize", *arguments, *QUICK]
    process = subprocess.Popen(command, stderr=subprocess.PIPE, stdout=subprocess.PIPE, text=True)
    assert "  best " in process.stderr.readline()
    return process


def test_killed_search_goes_on_to_the_result_of_an_unbroken_one(glvis_cli, tmp_path):
    (tmp_path / "study").mkdir()
    text = SMALL.replace("iterations = 2", "iterations = 300\nstall_iterations = 300")
    study = write_two_cubes(tmp_path / "study", text)
    broken, whole = tmp_path / "broken", tmp_path / "whole"
    with started(study, "-o", broken) as process:
        process.kill()
    kept = ["unfinished.lock", "unfinished/checkpoint.npz", "unfinished/study.toml"]
    assert files_below(broken) in (kept, sorted([*kept, "unfinished/checkpoint.npz.part"]))
    code, _, err = glvis_cli("optimize", study, "-o", broken, "--no-pictures")
    assert code == 2
    assert err.startswith(f"error: {broken}: holds a search that was cut off; go on with it by")
    code, _, err = glvis_cli("optimize", "--resume", broken, "--seed", "9", "--no-pictures")
    assert code == 2
    assert "the study has changed since: swarm.seed: nothing -> 9" in err
    assert glvis_cli("optimize", "--resume", broken, "--no-pictures")[0] == 0
    assert glvis_cli("optimize", study, "-o", whole, "--no-pictures")[0] == 0
    assert files_below(broken) == SEARCHED
    first, second = index_of(broken), index_of(whole)
    for index in (first, second):
        del index["run"]
    assert first == second


def test_ended_search_is_extended_in_its_folder(glvis_cli, study, tmp_path):
    out = tmp_path / "out"
    glvis_cli("optimize", study, "-o", out, "--no-pictures")
    before = read_result(out)
    code, text, _ = glvis_cli("optimize", out, "--extend", "3", "--no-pictures")
    assert code == 0
    after = read_result(out)
    assert "\nFinished: all 5 iterations done" in text
    assert [row[:9] for row in after.trace[:3]] == [row[:9] for row in before.trace]
    assert len(after.trace) == 6
    assert after.value >= before.value
    assert files_below(out) == SEARCHED


def test_refused_resume_leaves_the_result_as_it_was(glvis_cli, study, tmp_path):
    out = tmp_path / "out"
    glvis_cli("optimize", study, "-o", out, "--no-pictures")
    before = {name: (out / name).read_bytes() for name in files_below(out)}
    code, _, err = glvis_cli("optimize", "--resume", out, "--set", "swarm.particles=5")
    assert code == 2
    assert "the study has changed since: swarm.particles: 4 -> 5" in err
    assert {name: (out / name).read_bytes() for name in files_below(out)} == before


@pytest.mark.parametrize(
    ("arguments", "fact"),
    [
        (["STUDY"], "needs STUDY and -o DIR, or --resume DIR"),
        (["-o", "OUT"], "needs STUDY and -o DIR, or --resume DIR"),
        (["STUDY", "-o", "OUT", "--extend", "3"], "--extend adds to a search that was run"),
        (["--resume", "OUT", "-o", "OUT"], "-o: a search that goes on writes into its own folder"),
        (["--resume", "OUT"], "OUT: holds no search that could go on (study.toml is missing)"),
    ],
)
def test_options_that_do_not_go_together_are_refused(glvis_cli, study, tmp_path, arguments, fact):
    out = tmp_path / "out"
    places = {"STUDY": str(study), "OUT": str(out)}
    code, text, err = glvis_cli("optimize", *(places.get(word, word) for word in arguments))
    assert (code, text) == (2, "")
    assert fact.replace("OUT", str(out)) in err
    assert not out.exists()


def test_a_reader_that_goes_away_does_not_end_a_run(tmp_path, study):
    out = tmp_path / "out"
    command = [sys.executable, "-m", "glvis", "optimize", study, "-o", out, *QUICK]
    with subprocess.Popen(command, stderr=subprocess.PIPE, stdout=subprocess.PIPE) as p:
        p.stdout.close()
        p.stderr.close()
        assert p.wait(timeout=60) == 0
    assert files_below(out) == SEARCHED


@pytest.mark.skipif(not hasattr(os, "openpty"), reason="this system has no pseudo terminals")
def test_a_terminal_gets_a_bar_that_goes_away(tmp_path, study):
    reader, writer = os.openpty()
    command = [sys.executable, "-m", "glvis", "optimize", study, "-o", tmp_path / "out", *QUICK]
    environment = os.environ | {"TERM": "xterm", "COLUMNS": "120"}
    with subprocess.Popen(command, stderr=writer, stdout=subprocess.PIPE, env=environment) as p:
        os.close(writer)
        shown = b""
        while True:
            try:
                part = os.read(reader, 4096)
            except OSError:  # the other end is closed
                break
            if not part:
                break
            shown += part
        os.close(reader)
        said = p.stdout.read()
        assert p.wait(timeout=60) == 0, shown
    assert said.startswith(b"Faces seen\n")
    assert b"iteration 2/2" in shown
    assert b"evaluations/s" in shown
    assert b"\x1b[2K" in shown  # the line is taken back


def progress(iteration: int) -> Progress:
    return Progress(iteration, "iterations", iteration, 100, 130.0, 1.5, 0.25, 40, 8.0)


def test_lines_come_now_and_then_and_at_the_end(capsys):
    now = [0.0]
    show = _Lines(sys.stderr, clock=lambda: now[0])
    for iteration in range(100):
        now[0] = iteration * 1.0
        show(replace(progress(iteration), has_ended=iteration == 99))
    lines = capsys.readouterr().err.splitlines()
    assert [line.split()[1] for line in lines] == [f"{i}/100" for i in [*range(0, 100, 5), 99]]
    assert lines[0] == (
        "iteration 0/100  best 1.5  mean 0.25  8 evaluations/s  2 min 10 s left"
    )  # fmt: skip


def test_line_tells_of_maps_or_time_where_they_end_the_search(capsys):
    show = _Lines(sys.stderr)
    show(replace(progress(7), limit="maps", done=12300, most=160000, has_ended=True))
    show(replace(progress(7), limit="seconds", done=8.04, most=130, has_ended=True))
    show(replace(progress(7), seconds_left=math.inf, has_ended=True))
    maps, time, unknown = capsys.readouterr().err.splitlines()
    assert maps.startswith("12,300 of 160,000 maps  best 1.5  mean 0.25  ")
    assert time.startswith("8.0 s of 2 min 10 s  best 1.5  ")
    assert unknown.endswith("  8 evaluations/s  ? left")


def test_workers_elsewhere_are_named_the_first_of_many(capsys):
    for names in (("ann", "bob"), tuple("abcde")):
        _Lines(sys.stderr)(replace(progress(0), workers=names))
    first, second = capsys.readouterr().err.splitlines()
    assert first.endswith(" left  by ann, bob") and second.endswith(" left  by a, b, c and 2 more")


def test_times_are_told_as_people_tell_them():
    seconds = {0.04: "0.0 s", 9.94: "9.9 s", 47.6: "48 s", 200: "3 min 20 s", 7500: "2 h 5 min"}
    assert [duration(s) for s in seconds] == list(seconds.values())


def terminal(monkeypatch, columns):
    """Make standard output a terminal; return what is written there."""
    written = io.StringIO()
    written.isatty = lambda: True
    monkeypatch.setenv("COLUMNS", str(columns))
    monkeypatch.setattr("sys.stdout", written)
    return written


WIDE = ("model", "seen by all", "unique", "total", "seen %", "area %")
WIDE += tuple(f"by {n}+ %" for n in (2, 3, 4))


def test_tables_fit_into_the_terminal(monkeypatch):
    terminal(monkeypatch, 80)
    rows = [(f"{name}_franka", 118915, 91375, 202850, *["58.1"] * 5) for name in ("kitchen", "it")]
    lines = table(WIDE, rows)
    assert max(map(len, lines)) <= 80
    assert [" ".join(line.split()) for line in lines[:3]] == [
        "seen by by",
        "model by all unique total seen % area % 2+ % 3+ % by 4+ %",
        "kitchen_franka 118,915 91,375 202,850 58.1 58.1 58.1 58.1 58.1",
    ]
    assert len({line.rindex("1") for line in lines[2:]}) == 1  # still aligned
    narrow = [("arm1", 1, 2, 3, *["58.1"] * 5)]
    assert len(table(WIDE[:6], [row[:6] for row in narrow])) == 2  # nothing is broken without need


def test_names_too_long_for_a_table_lose_their_middle():
    rows = [(f"a_very_long_name_of_a_mesh_{k}", "x" * 60, 5) for k in (1, 2)]
    lines = table(("model", "around", "n"), rows, 60)
    assert max(map(len, lines)) <= 60
    assert [line.split()[0][-2:] for line in lines[1:]] == ["_1", "_2"]
    assert all("…" in line for line in lines[1:])
    assert table(("model", "around", "n"), rows)[1].split()[0] == rows[0][0]  # a file has room


def test_lines_break_between_words_on_a_terminal(monkeypatch):
    written = terminal(monkeypatch, 40)
    say("  Within reach is what some allowed pose sees")
    say(f"  glvis check '{'a path/' * 20}'", to_paste=True)
    lines = written.getvalue().splitlines()
    assert lines[:2] == ["  Within reach is what some allowed pose", "    sees"]
    assert len(lines) == 3


def test_lines_stay_whole_in_a_file(capsys):
    say("word " * 40 + "end")
    assert capsys.readouterr().out == "word " * 40 + "end\n"


def test_tables_align_numbers_right_and_words_left():
    assert table(("name", "n", "share"), [("a", 1234, "5.0 %"), ("long", 7, "45.1 %")]) == [
        "  name      n   share",
        "  a     1,234   5.0 %",
        "  long      7  45.1 %",
    ]
