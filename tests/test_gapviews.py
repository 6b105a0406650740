"""What nobody sees is shown: from where, through what, and by which number."""

from dataclasses import replace

import numpy as np
import pytest
from support.shapes import cube, merged, moved, write_off

from glvis.common.palette import UNSEEN_COLOR
from glvis.pictures.coloring import coloring
from glvis.pictures.framing import View, direction_angles, towards_eye
from glvis.pictures.gapviews import gap_views
from glvis.pictures.scenesheets import unseen_sheet
from glvis.pictures.stage import Stage
from glvis.problem.regions import largest_regions
from glvis.search.placement import evaluate_poses
from glvis.study.loading import load_study
from glvis.visibility.visibility_map import VisibilityMap

STUDY = """
title = "Two walls"
[scene]
models = ["walls.off"]
max_edge = "off"
{obstacles}
[sensor.eye]
hfov_deg = 60
vfov_deg = 40
resolution = [64, 48]
max_distance = 40
[[mount]]
name = "A"
sensor = "eye"
position = [0, -20, 4]
aim = [0, 0, 0]
[objective]
kind = "of1"
by_area = true
"""
INNER = [2, 3]  # the faces +x of the left wall: they look into the gap between the two


def block(size, center=(0, 0, 0)):
    box = cube(1.0)
    return moved((box[0] * size, box[1]), center)


@pytest.fixture
def walls(tmp_path):
    """Two high walls near each other; the study, its poses, and a map without the inner face."""

    def made(obstacles=""):
        left, right = (block((2, 12, 12), (x, 0, 0)) for x in (-1.5, 1.5))
        write_off(tmp_path / "walls.off", merged(left, right))
        path = tmp_path / "walls.toml"
        path.write_text(STUDY.format(obstacles=obstacles))
        study = load_study(path)
        (found,) = evaluate_poses(study).maps
        visible = np.ones_like(found.visible)
        visible[:, INNER] = False
        return study, study.rig.poses(np.zeros((1, 0)))[0], replace(found, visible=visible)

    return made


def loud(picture) -> np.ndarray:
    """Where a picture shows the colour of what nobody sees: more red than anything else."""
    r, g, b = np.moveaxis(picture.astype(int), 2, 0)
    return (r > 90) & (r > 2.5 * g) & (r > 1.5 * b)


def shown(stage, view) -> int:
    """Pixels of a small picture that show what nobody sees."""
    return int(loud(stage.picture(stage.eye(view, (320, 240), with_rig=False), (320, 240))).sum())


def panels(sheet) -> np.ndarray:
    """The pictures of a sheet, without its heading and legend."""
    width, height = sheet.size
    return sheet.pixels()[round(0.1 * height) :, : round(0.75 * width)]


def test_largest_gap_between_walls_shows_in_a_panel(walls):
    study, poses, found = walls()
    with Stage(study, poses) as stage:
        seen = stage.show(0, found)
        painted = coloring("unseen", seen)
        stage.paint(painted.colors)
        default = stage.views()["perspective"]
        views = gap_views(stage, default)
        usual = [shown(stage, view) for view in (default, stage.other_side(default))]
        chosen = [shown(stage, view) for view in views.views]
        sheet = unseen_sheet(stage, painted, (640, 400))
    assert max(usual) < 0.5 * max(chosen)
    assert loud(panels(sheet)).sum() > 400
    assert views.hidden_gaps() == []
    assert len(views.gaps) == 1
    assert not np.isnan(views.places[0]).all()


def test_gap_behind_an_obstacle_shows_through_it(walls, tmp_path):
    # right before the inner face and as large: nothing sees past it
    write_off(tmp_path / "lid.off", block((0.2, 12, 12), (-0.5, 0, 0)))
    study, poses, found = walls('obstacles = ["lid.off"]')
    with Stage(study, poses) as stage:
        painted = coloring("unseen", stage.show(0, found))
        stage.paint(painted.colors)
        assert loud(panels(unseen_sheet(stage, painted, (640, 400)))).sum() > 400


def test_gap_inside_a_closed_body_is_said_to_be_out_of_sight(tmp_path, walls):
    write_off(tmp_path / "inner.off", block((1, 1, 1)))
    study, poses, _ = walls()
    write_off(tmp_path / "walls.off", merged(block((4, 4, 4)), block((1, 1, 1))))
    study = load_study(tmp_path / "walls.toml")
    (found,) = evaluate_poses(study).maps
    visible = np.ones_like(found.visible)
    visible[:, 12:] = False
    with Stage(study, poses) as stage:
        painted = coloring("unseen", stage.show(0, replace(found, visible=visible)))
        stage.paint(painted.colors)
        views = gap_views(stage, stage.views()["perspective"])
    assert views.hidden_gaps() == [1]
    assert len(views.views) == 2


def test_a_wanted_view_stays_and_the_other_panel_shows_the_gap(walls):
    study, poses, found = walls()
    with Stage(study, poses) as stage:
        painted = coloring("unseen", stage.show(0, found))
        stage.paint(painted.colors)
        wanted = View("perspective", 90.0, 10.0, is_parallel=False)
        views = gap_views(stage, wanted, is_fixed=True)
    assert views.views[0] is wanted
    assert np.isnan(views.places[0][0]).all()
    assert not np.isnan(views.places[0][1]).any()


def test_views_are_the_same_each_time(walls):
    study, poses, found = walls()
    angles = []
    for _ in range(2):
        with Stage(study, poses) as stage:
            stage.show(0, found)
            views = gap_views(stage, stage.views()["perspective"]).views
            angles.append([(view.azimuth_deg, view.elevation_deg) for view in views])
    assert angles[0] == angles[1]


def test_nothing_unseen_leaves_the_views_of_other_pictures(walls):
    study, poses, found = walls()
    with Stage(study, poses) as stage:
        stage.show(0, replace(found, visible=np.ones_like(found.visible)))
        first = stage.views()["perspective"]
        views = gap_views(stage, first)
    assert views.views[0] is first
    assert (len(views.views), views.gaps) == (2, [])


@pytest.mark.parametrize("angles", [(0, 0), (35, 24), (300, -60), (180, 10)])
def test_angles_of_a_direction_are_those_of_the_view_from_there(angles):
    found = direction_angles((0, 0, 1), towards_eye((0, 0, 1), *angles))
    np.testing.assert_allclose(found, angles, atol=1e-9)


def test_only_regions_worth_telling_are_told(walls):
    study, _, found = walls()
    model = study.models[0]
    (gap,) = largest_regions(model, found.counts == 0)
    assert gap.area == pytest.approx(144)
    assert sorted(gap.faces.tolist()) == INNER
    every_other = np.arange(model.n_faces) % 2 == 0  # pieces that share no edge
    assert len(largest_regions(model, every_other)) == 4


def test_gap_of_a_real_part_that_two_fixed_views_missed_shows(shared_data, tmp_path):
    mesh = shared_data / "parts" / "featuretype.STL"
    if not mesh.is_file():
        pytest.skip(f"{mesh} is not there; the gap of that part is not looked for")
    text = STUDY.format(obstacles="").replace("walls.off", str(mesh))
    (tmp_path / "part.toml").write_text(text)
    study = load_study(tmp_path / "part.toml")
    model = study.models[0]
    # as told by 'explain' of a layout: around (2.2, 0, 0.2) inches, facing +X -Z
    slope = (model.normals[:, 0] > 0.3) & (model.normals[:, 2] < -0.3)
    unseen = slope & (np.abs(model.centroids[:, [0, 2]] - [2.2, 0.2]) < 0.4).all(axis=1)
    assert 0.02 < model.areas[unseen].sum() / model.areas.sum() < 0.05
    found = VisibilityMap(model.name, study.sensor_names, ~unseen[None])
    with Stage(study, study.rig.poses(np.zeros((1, 0)))[0]) as stage:
        painted = coloring("unseen", stage.show(0, found))
        stage.paint(painted.colors)
        views = gap_views(stage, stage.views()["perspective"])
        assert max(shown(stage, view) for view in views.views) > 100
        assert loud(panels(unseen_sheet(stage, painted, (640, 400)))).sum() > 100


def test_loud_means_the_colour_of_what_nobody_sees():
    assert loud(np.array(UNSEEN_COLOR).reshape(1, 1, 3)).all()
    assert not loud(np.array([[[200, 206, 214]]])).any()
