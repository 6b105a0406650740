"""Layouts side by side: who sees what, how far sensors moved, names and pictures."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from studies import SMALL, write_small_study

from glvis.camera import camera_to_world
from glvis.cli import main
from glvis.drawing.palette import SEEN_COLOR, UNSEEN_COLOR
from glvis.inputs.study import load_study
from glvis.optim.placement import evaluate_poses
from glvis.outputs.compare import (
    BOTH,
    FIRST,
    NEITHER,
    SECOND,
    Layout,
    comparison_lines,
    difference,
    difference_coloring,
    named,
    sensor_moves,
    shared_models,
)
from glvis.outputs.files import files_below


@pytest.fixture(scope="module")
def layouts(tmp_path_factory):
    folder = tmp_path_factory.mktemp("study")
    study = load_study(write_small_study(folder))
    poses = study.rig.poses(study.rig.start)
    poses[2] = camera_to_world([0, 0, -4], [0, 0, 1], 0.0, study.up)  # from below instead
    return [
        Layout("start", evaluate_poses(study)),
        Layout("below", evaluate_poses(study, poses)),
    ]


def test_difference_says_who_sees_each_face(layouts):
    first, second = (layout.placement for layout in layouts)
    found = difference(first, second, "cube")
    z = first.study.models[0].normals[:, 2]
    seen = first.maps[0].visible[:2].any(axis=0)  # by A and B, which have not moved
    assert (found[seen] == BOTH).all()
    assert (found[~seen & (z < -0.9)] == SECOND).all()
    assert (found[~seen & (z > -0.9)] == NEITHER).all()
    assert (difference(second, first, "cube")[found == SECOND] == FIRST).all()


def test_colours_follow_the_difference(layouts):
    painted = difference_coloring(*layouts, "cube")
    found = difference(layouts[0].placement, layouts[1].placement, "cube")
    assert (painted.colors[found == BOTH, :3] == SEEN_COLOR).all()
    assert (painted.colors[found == NEITHER, :3] == UNSEEN_COLOR).all()
    assert [swatch.label for swatch in painted.swatches] == [
        "both", "only start", "only below", "neither",
    ]  # fmt: skip
    shares = [float(swatch.value.split("\u00a0")[0]) for swatch in painted.swatches]
    assert sum(shares) == pytest.approx(100, abs=0.2)


def test_moves_are_told_by_distance_and_angle(layouts):
    moves = sensor_moves(*(layout.placement for layout in layouts))
    assert [name for name, _, _ in moves] == ["A", "B", "C"]
    assert moves[0][1:] == (0, 0)
    assert moves[2][1] == pytest.approx(8)
    assert moves[2][2] == pytest.approx(180)


@pytest.mark.parametrize("degrees", [1e-9, 0.5, 90, 179])
def test_small_and_large_turns_are_exact(layouts, degrees):
    first = layouts[0].placement
    poses = first.camera_to_world.copy()
    a = np.radians(degrees)
    turn = [[np.cos(a), -np.sin(a), 0], [np.sin(a), np.cos(a), 0], [0, 0, 1]]
    poses[0, :3, :3] = turn @ poses[0, :3, :3]
    second = replace(first, camera_to_world=poses)
    assert sensor_moves(first, second)[0][2] == pytest.approx(degrees, rel=1e-6)


def test_sensors_of_other_names_are_left_out(layouts, tmp_path):
    text = SMALL.replace('name = "C"', 'name = "top"')
    other = evaluate_poses(load_study(write_small_study(tmp_path, text)))
    assert [m[0] for m in sensor_moves(layouts[0].placement, other)] == ["A", "B"]


def test_only_equal_meshes_are_compared_face_by_face(layouts, tmp_path):
    text = SMALL.replace("[scene]", "[scene]\nscale = 1.5")
    other = Layout("larger", evaluate_poses(load_study(write_small_study(tmp_path, text))))
    assert shared_models([*layouts, other]) == []
    assert shared_models(layouts) == ["cube", "small"]
    lines = list(comparison_lines([layouts[0], other]))
    assert lines[-1].startswith("No model is the same mesh in all layouts")


def test_table_has_a_column_a_layout(layouts):
    lines = [line.split() for line in comparison_lines(layouts)]
    assert lines[0] == ["start", "below"]
    assert ["sensors", "3", "3"] in lines
    values = [f"{layout.placement.value:.4f}" for layout in layouts]
    assert ["OF3", *values] in lines
    seen = [
        f"{100 * np.mean([m.coverage for m in layout.placement.maps]):.2f}" for layout in layouts
    ]
    assert ["seen,", "mean", "%", *seen] in lines


def test_names_are_as_long_as_they_must_be_to_differ(layouts):
    placement = layouts[0].placement
    paths = [Path("/runs/a/out"), Path("/runs/b/out")]
    assert [layout.name for layout in named(paths, [placement] * 2)] == ["a/out", "b/out"]
    paths = [Path("/runs/a"), Path("/runs/b")]
    assert [layout.name for layout in named(paths, [placement] * 2)] == ["a", "b"]
    twice = [layout.name for layout in named([paths[0]] * 2, [placement] * 2)]
    assert len(set(twice)) == 2


def test_pictures_come_into_a_new_folder(tmp_path, capsys, monkeypatch):
    monkeypatch.setattr("glvis.outputs.compare._SIZE", (300, 300))
    (tmp_path / "study").mkdir()
    text = SMALL.replace('"cube.off", "small.off"', '"cube.off"')
    study = str(write_small_study(tmp_path / "study", text))
    for name, setting in (("one", "mount.C.roll_deg=0"), ("two", "mount.C.position=[0, 1, 4]")):
        out = str(tmp_path / name)
        assert main(["evaluate", study, "-o", out, "--no-pictures", "--set", setting]) == 0
    capsys.readouterr()
    folders = [str(tmp_path / name) for name in ("one", "two")]
    out = tmp_path / "compared"
    assert main(["compare", *folders, "-o", str(out)]) == 0
    assert files_below(out) == ["cube-difference.png", "cube-side-by-side.png"]
    text = capsys.readouterr().out
    assert "two against one, % of the faces" in text
    assert text.endswith(f"2 pictures in {out}: cube-side-by-side.png, cube-difference.png\n")
    assert main(["compare", *folders, "-o", str(out)]) == 2
    assert "is not empty" in capsys.readouterr().err
    assert main(["compare", folders[0]]) == 2
    assert capsys.readouterr().err == "error: compare needs two or more results\n"
