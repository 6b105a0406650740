"""Layouts side by side: who sees what, how far sensors moved, names and pictures."""

import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from PIL import Image
from support.two_cubes import SMALL, write_two_cubes

from glvis.cli.app import main
from glvis.cli.compare_words import comparison_lines, comparison_rows
from glvis.common.palette import SEEN_COLOR, UNSEEN_COLOR
from glvis.pictures.scenesheets import subtitle
from glvis.problem.camera import look_along
from glvis.reports.compare import (
    BOTH,
    FIRST,
    NEITHER,
    SECOND,
    Layout,
    _difference_sheet,
    difference,
    difference_coloring,
    named,
    sensor_moves,
    shared_models,
    write_comparison,
)
from glvis.results.journal import files_below
from glvis.search.placement import evaluate_poses
from glvis.study.loading import load_study


@pytest.fixture(scope="module")
def layouts(tmp_path_factory):
    folder = tmp_path_factory.mktemp("study")
    study = load_study(write_two_cubes(folder))
    poses = study.rig.poses(study.rig.start)
    poses[2] = look_along([0, 0, -4], [0, 0, 1], 0.0, study.up)  # from below instead
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
    other = evaluate_poses(load_study(write_two_cubes(tmp_path, text)))
    assert [m[0] for m in sensor_moves(layouts[0].placement, other)] == ["A", "B"]


def test_what_only_rounding_moved_has_not_moved(layouts):
    first = layouts[0].placement
    poses = first.camera_to_world.copy()
    poses[:, :3, 3] += 1e-13
    poses[0, 0, 1] += 1e-15
    again = Layout("again", replace(first, camera_to_world=poses))
    assert all(far > 0 for _, far, _ in sensor_moves(first, again.placement))
    lines = list(comparison_lines([layouts[0], again]))
    start = next(k for k, line in enumerate(lines) if line.startswith("  sensor  moved"))
    assert [line.split() for line in lines[start + 1 : start + 4]] == [
        ["A", "0", "0"], ["B", "0", "0"], ["C", "0", "0"],
    ]  # fmt: skip


def test_only_equal_meshes_are_compared_face_by_face(layouts, tmp_path):
    text = SMALL.replace("[scene]", "[scene]\nscale = 1.5")
    other = Layout("larger", evaluate_poses(load_study(write_two_cubes(tmp_path, text))))
    assert shared_models([*layouts, other]) == []
    assert shared_models(layouts) == ["cube", "small"]
    lines = list(comparison_lines([layouts[0], other]))
    assert lines[-1].startswith("No model is the same mesh in all layouts")


def inches(text: str) -> str:
    """Return the small study with every length of its rig and meshes in inches instead of mm."""
    numbers = (
        "min = 2, max = 6, start = 3 }, 3, 3]",
        "position = [0, 0, 4]",
        "max_distance = 12",
    )
    for old in numbers:
        assert old in text
        new = re.sub(r"\d+", lambda found: repr(int(found[0]) / 25.4), old)
        text = text.replace(old, new)
    return text.replace("[scene]", f'unit = "in"\n[scene]\nscale = {1 / 25.4!r}')


def test_lengths_of_other_units_are_converted(layouts, tmp_path):
    first = layouts[0].placement
    other = evaluate_poses(load_study(write_two_cubes(tmp_path, inches(SMALL))))
    assert not np.allclose(other.camera_to_world, first.camera_to_world)
    for name, far, turn in sensor_moves(first, other):
        assert far == pytest.approx(0, abs=1e-9), name
        assert turn == pytest.approx(0, abs=1e-9), name
    poses = other.camera_to_world.copy()
    poses[2, 0, 3] += 1
    moved = replace(other, camera_to_world=poses)
    assert sensor_moves(first, moved)[2][1] == pytest.approx(25.4)  # in the unit of the first
    assert sensor_moves(moved, first)[2][1] == pytest.approx(1)


def test_meshes_in_other_units_are_not_compared_face_by_face(layouts, tmp_path):
    text = SMALL.replace("[scene]", 'unit = "in"\n[scene]')  # the same numbers, another size
    other = Layout("inches", evaluate_poses(load_study(write_two_cubes(tmp_path, text))))
    assert shared_models([layouts[0], other]) == []
    lines = list(comparison_lines([layouts[0], other]))
    assert lines[-1].startswith("No model is the same mesh in one unit in all layouts")
    assert ["sensor", "moved", "[mm]", "turned", "[deg]"] in [line.split() for line in lines]


def test_difference_picture_says_which_layout_its_subtitle_is_about(layouts, monkeypatch):
    said = []
    monkeypatch.setattr(
        "glvis.reports.compare.close_sheet", lambda stage, painted: said.append(subtitle(stage))
    )
    _difference_sheet(*layouts, "cube")
    assert len(said) == 1 and said[0].startswith("below · ")


def test_layouts_without_a_common_mesh_are_not_drawn(layouts, tmp_path, capsys):
    folders = []
    for name, text in (("one", SMALL), ("two", SMALL.replace("[scene]", "[scene]\nscale = 2"))):
        (tmp_path / f"{name}-study").mkdir()
        study = str(write_two_cubes(tmp_path / f"{name}-study", text))
        folders.append(str(tmp_path / name))
        assert main(["evaluate", study, "-o", folders[-1], "--no-pictures"]) == 0
    capsys.readouterr()
    assert main(["compare", *folders, "-o", str(tmp_path / "compared")]) == 2
    assert "no model is the same mesh in all layouts" in capsys.readouterr().err
    assert not (tmp_path / "compared").exists()


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


def test_values_by_area_and_by_faces_are_told_apart(layouts):
    first = layouts[0].placement
    study = replace(first.study, objective=replace(first.study.objective, by_area=True))
    rows = comparison_rows([layouts[0], Layout("area", replace(first, study=study))])
    (row,) = (row for row in rows if row[0] == "objective")
    assert [text.split(" ", 1)[1] for text in row[1:]] == ["(OF3)", "(OF3 by area)"]


def test_names_are_as_long_as_they_must_be_to_differ(layouts):
    placement = layouts[0].placement
    paths = [Path("/runs/a/out"), Path("/runs/b/out")]
    assert [layout.name for layout in named(paths, [placement] * 2)] == ["a/out", "b/out"]
    paths = [Path("/runs/a"), Path("/runs/b")]
    assert [layout.name for layout in named(paths, [placement] * 2)] == ["a", "b"]
    twice = [layout.name for layout in named([paths[0]] * 2, [placement] * 2)]
    assert len(set(twice)) == 2


def test_models_side_by_side_are_drawn_alike_wherever_sensors_stand(layouts, tmp_path, monkeypatch):
    monkeypatch.setattr("glvis.reports.compare._SIZE", (400, 400))
    one = layouts[0].placement
    far = one.camera_to_world.copy()
    far[:, :3, 3] *= 5
    others = [layouts[0], Layout("far", replace(one, camera_to_world=far))]
    monkeypatch.setattr("glvis.reports.compare.cut_alike", lambda given: given)
    (picture, *_) = write_comparison(others, tmp_path)
    upper = np.array(Image.open(picture).convert("RGB"))[60:190].astype(int)  # the model alone
    near, far_off = upper[:, :260], upper[:, 400:660]
    assert (near != 255).any(axis=2).mean() > 0.1
    assert np.abs(near - far_off).max(axis=2).max() < 3


def test_pictures_come_into_a_new_folder(tmp_path, capsys, monkeypatch):
    monkeypatch.setattr("glvis.reports.compare._SIZE", (300, 300))
    (tmp_path / "study").mkdir()
    text = SMALL.replace('"cube.off", "small.off"', '"cube.off"')
    study = str(write_two_cubes(tmp_path / "study", text))
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
