"""A search that is broken off goes on as if nothing had been, or says why it cannot."""

import os
import signal
import subprocess
import sys
from functools import partial
from pathlib import Path

import numpy as np
import pytest
from support.ball_and_ring import SMALL, write_ball_and_ring
from support.equal_results import assert_same_placements

import glvis
from glvis.errors import MachineError, StudyError
from glvis.search.auto_options import AutoOptions
from glvis.search.checkpoint import read_checkpoint, write_checkpoint
from glvis.search.placement import evaluate_poses, place_sensors
from glvis.study.loading import load_study


@pytest.fixture
def study(tmp_path, rng):
    return load_study(write_ball_and_ring(tmp_path, rng))


@pytest.fixture
def path(tmp_path):
    return tmp_path / "checkpoint.npz"


class Broken(Exception):
    pass


def break_after(iteration):
    def on_iteration(progress):
        if progress.iteration == iteration:
            raise Broken

    return on_iteration


@pytest.mark.parametrize("workers", [1, 2])
def test_search_broken_after_any_iteration_ends_with_the_numbers_of_an_unbroken_one(
    study, path, workers
):
    unbroken = place_sensors(study)
    for iteration in range(4):
        with pytest.raises(Broken):
            place_sensors(
                study,
                checkpoint=path,
                resume=iteration > 0,
                on_iteration=break_after(iteration),
            )
    resumed = place_sensors(study, workers=workers, checkpoint=path, resume=True)
    assert_same_placements(resumed, unbroken)
    assert resumed.warnings == ()
    seconds = [row.seconds for row in resumed.trace]
    assert seconds == sorted(seconds) and resumed.seconds >= seconds[-1]


def test_search_that_learns_goes_on_with_what_it_had_learned(study, path, monkeypatch):
    study = load_study(study.path, ["search.method=auto", "search.max_maps=700"])
    # quick, and the surrogate learns up to some way in
    monkeypatch.setattr(
        "glvis.search.methods.AutoOptions", partial(AutoOptions, poses=150, rounds=1)
    )
    unbroken = place_sensors(study)
    assert {"surrogate", "local search", "restart"} <= {row.method for row in unbroken.trace}
    sizes = []
    for resume, iteration in enumerate((0, 5, 40)):
        with pytest.raises(Broken):
            place_sensors(
                study, checkpoint=path, resume=resume > 0, on_iteration=break_after(iteration)
            )
        learned = read_checkpoint(path, study).search["learned"]
        sizes.append(learned.shape)
    faces = sum(min(600 // len(study.models), model.n_faces) for model in study.models)
    assert sizes[-1] == (150, -(-faces // 8))
    assert sizes[0][0] < sizes[1][0] < 150
    resumed = place_sensors(study, workers=2, checkpoint=path, resume=True)
    assert_same_placements(resumed, unbroken)


def test_search_that_learned_less_than_it_was_told_cannot_go_on(study, path):
    study = load_study(study.path, ["search.method=auto", "search.max_maps=300"])
    with pytest.raises(Broken):
        place_sensors(study, checkpoint=path, on_iteration=break_after(3))
    saved = read_checkpoint(path, study)
    saved.search["learned"] = saved.search["learned"][:-1]
    write_checkpoint(path, saved)
    with pytest.raises(StudyError, match="the search cannot go on"):
        place_sensors(study, checkpoint=path, resume=True)


def test_finished_search_is_told_again(study, path):
    first = place_sensors(study, checkpoint=path)
    assert_same_placements(place_sensors(study, checkpoint=path, resume=True), first)


def test_interrupted_search_goes_on(study, path):
    def interrupt(progress):
        os.kill(os.getpid(), signal.SIGTERM)

    first = place_sensors(study, checkpoint=path, on_iteration=interrupt)
    assert first.stop_reason == "interrupted: SIGTERM" and len(first.trace) == 1
    assert_same_placements(place_sensors(study, checkpoint=path, resume=True), place_sensors(study))


def test_search_killed_at_any_moment_goes_on(study, path):
    script = (
        "import os, signal, sys\nfrom pathlib import Path\n"
        "from glvis.search.placement import place_sensors\n"
        "from glvis.study.loading import load_study\n"
        "from glvis.evaluation import evaluator\n"
        "study, path, calls = load_study(sys.argv[1]), Path(sys.argv[2]), int(sys.argv[3])\n"
        "key = evaluator._key\n"
        "def deadly(*args):\n"
        "    global calls\n"
        "    calls -= 1\n"
        "    if calls == 0:\n"
        "        os.kill(os.getpid(), signal.SIGKILL)\n"
        "    return key(*args)\n"
        "evaluator._key = deadly\n"
        "place_sensors(study, checkpoint=path, resume=path.exists())\n"
    )
    root = str(Path(glvis.__file__).parents[1])
    for poses in (20, 30):  # an iteration looks at 12, and before the first there is the start
        done = subprocess.run(
            [sys.executable, "-c", script, str(study.path), str(path), str(poses)], cwd=root
        )
        assert done.returncode == -signal.SIGKILL
    assert len(read_checkpoint(path, study).trace.splitlines()) == 1 + 2
    assert_same_placements(place_sensors(study, checkpoint=path, resume=True), place_sensors(study))


def test_extension_adds_iterations_to_what_was_done(study, path):
    first = place_sensors(study, checkpoint=path)
    longer = place_sensors(study, checkpoint=path, resume=True, extend=3)
    assert [row.iteration for row in longer.trace] == list(range(8))
    assert [row[:-1] for row in longer.trace[:5]] == [row[:-1] for row in first.trace]
    assert longer.stop_reason.startswith("finished: all 7 iterations done")
    assert longer.evaluations == 6 * 8 and longer.value >= first.value
    whole = place_sensors(load_study(study.path, ["swarm.iterations=7"]))
    assert np.array_equal(whole.position, longer.position)


@pytest.mark.parametrize(
    ("overrides", "change"),
    [
        (["swarm.particles=7"], "swarm.particles: 6 -> 7"),
        (["variables.height.max=3"], "variables.height.max: 2 -> 3"),
        (["mount.B.roll_deg=5"], "mount.B.roll_deg: nothing -> 5"),
        (["objective.weights=set2"], 'objective.weights: nothing -> "set2"'),
        (["mount.A.sensor=kinect-v2"], 'mount.A.sensor: "eye" -> "kinect-v2"'),
    ],
)
def test_study_that_has_changed_is_refused_with_the_change(study, path, overrides, change):
    place_sensors(load_study(study.path, ["swarm.iterations=0"]), checkpoint=path)
    changed = load_study(study.path, ["swarm.iterations=0", *overrides])
    with pytest.raises(StudyError) as error:
        place_sensors(changed, checkpoint=path, resume=True)
    assert str(error.value) == f"{path}: the study has changed since: {change}"


def test_mesh_that_has_changed_is_refused(study, path, tmp_path):
    place_sensors(study, checkpoint=path)
    (tmp_path / "ring.off").write_text((tmp_path / "tiny.off").read_text())
    with pytest.raises(StudyError, match="changed since: mesh ring: other vertices or faces than"):
        place_sensors(load_study(study.path), checkpoint=path, resume=True)


def test_other_models_are_refused(study, path):
    place_sensors(study, checkpoint=path)
    other = load_study(study.path, ['scene.models=["ball.off", "tiny.off"]'])
    with pytest.raises(StudyError, match="meshes: ball, ring, post -> ball, tiny, post"):
        place_sensors(other, checkpoint=path, resume=True)


def test_variables_in_another_order_are_refused(study, path):
    place_sensors(study, checkpoint=path)
    lines = SMALL.splitlines(keepends=True)
    first = next(place for place, line in enumerate(lines) if line.startswith("turn = {"))
    lines[first : first + 2] = lines[first + 1], lines[first]
    study.path.write_text("".join(lines))
    with pytest.raises(StudyError, match=r"order of variables: turn, height, .* -> height, turn, "):
        place_sensors(load_study(study.path), checkpoint=path, resume=True)


def test_title_comments_and_folder_may_change(study, path, tmp_path):
    unbroken = place_sensors(study, checkpoint=path)
    moved = tmp_path / "moved"
    moved.mkdir()
    for file in tmp_path.glob("*.off"):
        file.rename(moved / file.name)
    text = "# looked at again\n" + SMALL.replace('title = "Small"', 'title = "Other"')
    (moved / "small.toml").write_text(text)
    resumed = place_sensors(load_study(moved / "small.toml"), checkpoint=path, resume=True)
    assert_same_placements(resumed, unbroken)


def test_missing_checkpoint_is_named(study, path):
    with pytest.raises(StudyError, match=r"checkpoint\.npz: there is no checkpoint to go on from"):
        place_sensors(study, checkpoint=path, resume=True)


@pytest.mark.parametrize("what", ["text", "cut", "other"])
def test_file_that_is_no_checkpoint_is_refused(study, path, what):
    if what == "text":
        path.write_text("nothing of the kind")
    elif what == "cut":
        place_sensors(study, checkpoint=path)
        path.write_bytes(path.read_bytes()[:2000])
    else:
        np.savez(path, visible=np.zeros(3))
    with pytest.raises(StudyError, match=r"checkpoint\.npz: is no checkpoint of glvis"):
        place_sensors(study, checkpoint=path, resume=True)


def test_checkpoint_of_another_version_is_refused(study, path, monkeypatch):
    monkeypatch.setattr("glvis.search.checkpoint.VERSION", 3)
    place_sensors(study, checkpoint=path)
    monkeypatch.undo()
    with pytest.raises(StudyError, match="of version 3; this glvis reads version 2"):
        place_sensors(study, checkpoint=path, resume=True)


def test_folder_in_the_place_of_a_checkpoint_is_refused(study, path):
    path.mkdir()
    with pytest.raises(StudyError, match=r"checkpoint\.npz: cannot be read: Is a directory"):
        place_sensors(study, checkpoint=path, resume=True)


def test_checkpoint_that_cannot_be_written_at_first_ends_the_run(study, tmp_path):
    with pytest.raises(MachineError, match=r"checkpoint\.npz: cannot be written: No such file"):
        place_sensors(study, checkpoint=tmp_path / "missing" / "checkpoint.npz")


def test_checkpoint_that_cannot_be_written_later_is_a_warning(study, path):
    def block(progress):
        if progress.iteration == 1:
            path.with_name("checkpoint.npz.part").mkdir()

    placement = place_sensors(study, checkpoint=path, on_iteration=block)
    assert_same_placements(placement, place_sensors(study))
    assert placement.warnings == (f"{path}: cannot be written: Is a directory",)


def test_search_that_goes_on_elsewhere_says_so(study, path, monkeypatch):
    place_sensors(study, checkpoint=path)
    from dataclasses import replace

    from glvis.visibility import maps

    info = replace(maps.gl_info(), renderer="another GPU")
    monkeypatch.setattr("glvis.visibility.maps.gl_info", lambda: info)
    (warning,) = place_sensors(study, checkpoint=path, resume=True).warnings
    assert warning.startswith("the search began on ") and "went on on another GPU (" in warning


def test_nothing_is_resumed_or_extended_without_a_checkpoint(study, path):
    with pytest.raises(ValueError, match="resume needs a checkpoint"):
        place_sensors(study, resume=True)
    with pytest.raises(ValueError, match="extend needs resume"):
        place_sensors(study, checkpoint=path, extend=5)


def test_nothing_but_the_checkpoint_is_written(study, tmp_path):
    folder = tmp_path / "run"
    folder.mkdir()
    before = sorted(tmp_path.rglob("*"))
    place_sensors(study, checkpoint=folder / "checkpoint.npz")
    assert sorted({*tmp_path.rglob("*")} - {*before}) == [folder / "checkpoint.npz"]
    assert evaluate_poses(study).trace == ()
