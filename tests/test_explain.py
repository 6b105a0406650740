"""Why surface stays unseen: one reason a face, the same that plain rays give."""

import math
from dataclasses import replace

import numpy as np
import pytest
from support import oracle, shapes
from support.two_cubes import SMALL, write_two_cubes

from glvis.cli.explain_words import explain_lines, facing_words
from glvis.evaluation.checks import study_warnings
from glvis.problem.regions import regions
from glvis.problem.scene import Model
from glvis.problem.visibility_options import VisibilityOptions
from glvis.results.explain import REASONS, SEEN, unseen_reasons, values_without
from glvis.search.placement import evaluate_poses
from glvis.study.loading import load_study
from glvis.study.starter import write_starter
from glvis.study.starter_study import Choices

ARM = """
up = [0, 1, 0]
[scene]
models = ["{data}/arms/arm2.stl"]
max_edge = "off"
obstacles = ["{data}/arms/holder.stl"]
[[mount]]
name = "A"
sensor = "d415-buonamici"
position = [212, -212, 136]
aim = [0, 0, 0]
mirror = {{ plane = "yz", name = "B" }}
[[mount]]
name = "C"
sensor = "d415-buonamici"
position = [150, 120, -120]
aim = [0, 0, -60]
roll_deg = 20
"""


def triangles_of(model: Model) -> np.ndarray:
    return model.vertices[model.faces]


def reasons_by_rays(placement, m: int) -> np.ndarray:
    """Return the reason of each face, seen or not, sensor by sensor, with plain rays."""
    study, model = placement.study, placement.study.models[m]
    own = triangles_of(model)
    others = np.concatenate([np.zeros((0, 3, 3)), *map(triangles_of, study.obstacles)])
    centre = own.mean(axis=1)
    closest = np.zeros(len(own), dtype=int)
    for sensor, pose in zip(study.sensors, placement.camera_to_world, strict=True):
        eye = oracle.Eye.of(sensor)
        way = centre - pose[:3, 3]
        x, y, depth = way @ pose[:3, 0], way @ pose[:3, 1], -way @ pose[:3, 2]
        slope = -np.sum(model.normals * way, axis=1) / np.linalg.norm(way, axis=1)
        steps = [
            (depth > 0) & (abs(x) <= eye.tan_half[0] * depth) & (abs(y) <= eye.tan_half[1] * depth),
            slope > 0,
            depth <= eye.max_distance,
            depth >= eye.min_distance,
            slope >= math.cos(math.radians(eye.max_incidence_deg)),
        ]
        passed = np.cumprod(steps, axis=0).sum(axis=0)  # rules kept before the first that refuses
        rays = np.flatnonzero(passed == 5)
        by_itself = oracle.is_hidden(pose[:3, 3], centre[rays], rays, own)
        by_any = oracle.is_hidden(pose[:3, 3], centre[rays], rays, np.concatenate([own, others]))
        itself, other = map(REASONS.index, ("hidden by the model", "hidden by an obstacle"))
        passed[rays] = np.where(by_itself, itself, np.where(by_any, other, other + 1))
        closest = np.maximum(closest, passed)
    return closest


def assert_reasons_are_those_of_rays(placement, m: int, allowed: float) -> None:
    """Compare the areas of the reasons; ``allowed`` is the share of the area that may differ."""
    model = placement.study.models[m]
    found = unseen_reasons(placement)[m]
    unseen = placement.maps[m].counts == 0
    assert np.array_equal(found != SEEN, unseen)
    assert not (found == REASONS.index("seen from behind")).any()
    areas = [model.areas[found == k].sum() for k in range(len(REASONS))]
    assert sum(areas) == pytest.approx(model.areas[unseen].sum(), rel=1e-12)
    truth = reasons_by_rays(placement, m)
    differs = unseen & (found != truth)
    assert model.areas[differs].sum() <= allowed * model.areas.sum()


def test_reasons_on_an_arm_are_those_of_rays(shared_data, tmp_path):
    (tmp_path / "study.toml").write_text(ARM.format(data=shared_data))
    placement = evaluate_poses(load_study(tmp_path / "study.toml"))
    found = unseen_reasons(placement)[0]
    told = {REASONS[k] for k in np.unique(found[found != SEEN])}
    hidden = {"hidden by the model", "hidden by an obstacle"}
    assert told >= {"turned away", "too far", "too oblique", *hidden}
    assert_reasons_are_those_of_rays(placement, 0, 0.002)


SPHERE = """
[scene]
models = ["ball.off"]
max_edge = "off"
obstacles = ["plate.off"]
[sensor.eye]
hfov_deg = 30
vfov_deg = 30
resolution = [400, 400]
min_distance = 8
max_distance = 10
max_incidence_deg = 80
[[mount]]
name = "A"
sensor = "eye"
position = [0, 0, 10]
direction = [0, 0, -1]
[[mount]]
name = "B"
sensor = "eye"
position = [1, 9.5, 0]
direction = [0, -1, 0]
"""


@pytest.fixture(scope="module")
def ball(tmp_path_factory):
    """A ball of radius 3 before two eyes, a plate between it and one of them."""
    folder = tmp_path_factory.mktemp("ball")
    vertices, faces = shapes.icosphere(4, 3.0)
    shapes.write_off(folder / "ball.off", (vertices, faces))
    shapes.write_off(folder / "plate.off", shapes.plate(1.0, center=(0, 0, 8)))
    (folder / "study.toml").write_text(SPHERE)
    return evaluate_poses(load_study(folder / "study.toml"))


def with_sensors(placement, chosen: slice):
    """Return a placement with some of its sensors alone."""
    study = placement.study
    rig = replace(study.rig, sensor_names=study.rig.sensor_names[chosen])
    return replace(
        placement,
        study=replace(study, sensors=study.sensors[chosen], rig=rig),
        camera_to_world=placement.camera_to_world[chosen],
        maps=tuple(replace(found, visible=found.visible[chosen]) for found in placement.maps),
    )


def test_reasons_on_a_ball_are_those_of_rays(ball):
    assert_reasons_are_those_of_rays(ball, 0, 0.002)


def test_what_lies_too_near_or_behind_is_told_by_formula(ball):
    model = ball.study.models[0]
    alone = with_sensors(ball, slice(0, 1))
    alone = replace(alone, study=replace(alone.study, obstacles=()))
    found = unseen_reasons(alone)[0]
    z = model.centroids[:, 2]
    way = np.array([0, 0, 10]) - model.centroids
    slope = np.sum(way * model.normals, axis=1)
    off = np.linalg.norm(model.centroids[:, :2], axis=1)
    clear = off < 0.9 * math.tan(math.radians(15)) * (10 - z)  # well inside the cone of view
    facing = slope > 0.05
    assert set(found[clear & facing & (z > 2.05)]) <= {REASONS.index("too near")}
    assert set(found[clear & facing & (z < -0.05)]) <= {REASONS.index("too far")}
    assert set(found[clear & (slope < -0.05)]) == {REASONS.index("turned away")}
    outside = np.abs(model.centroids[:, :2]).max(axis=1) > 1.1 * math.tan(math.radians(15)) * (
        10 - z
    )
    assert set(found[outside]) == {REASONS.index("nothing looks there")}


def test_faces_between_the_pixels_are_told_apart_from_hidden_ones(ball):
    coarse = replace(ball.study, visibility=VisibilityOptions(resolution=(12, 12)))
    found = unseen_reasons(evaluate_poses(coarse))[0]
    fine = ball.maps[0].counts > 0
    is_small = found == REASONS.index("smaller than a pixel")
    assert is_small.sum() > 50
    assert fine[is_small].mean() > 0.98


def test_a_mesh_that_is_inside_out_is_seen_from_behind(ball):
    model = ball.study.models[0]
    turned = replace(ball.study, models=(model.flipped(),))
    found = unseen_reasons(evaluate_poses(turned))[0]
    assert np.array_equal(found == REASONS.index("seen from behind"), ball.maps[0].counts > 0)


def test_a_cad_part_that_is_inside_out_is_seen_from_behind_and_not_hidden(tmp_path, shared_data):
    part = shared_data / "parts" / "featuretype.STL"
    path = write_starter(tmp_path / "s", [part], choices=Choices(sensors=2))
    turned = load_study(path, ["scene.max_edge=off", "scene.flip=true"])
    assert any("inside out" in line for line in study_warnings(turned))
    found = evaluate_poses(turned)
    assert found.maps[0].counts.astype(bool).mean() < 0.05
    (model,), (reasons,) = turned.models, unseen_reasons(found)
    behind = model.areas[reasons == REASONS.index("seen from behind")].sum()
    proper = evaluate_poses(load_study(path, ["scene.max_edge=off"]))
    seen = model.areas[proper.maps[0].counts > 0].sum()
    assert behind > 0.98 * seen > 0.5 * model.areas.sum()


def test_a_sheet_below_which_sensors_stand_is_seen_from_behind(tmp_path):
    path = write_two_cubes(tmp_path)
    shapes.write_off(tmp_path / "cube.off", shapes.plate(1.0, cells=(3, 3)))
    below = shapes.merged(shapes.plate(1.0, cells=(3, 3)), shapes.cube(0.5, (0, 0, 2)))
    placement = evaluate_poses(load_study(path))
    assert REASONS.index("seen from behind") not in unseen_reasons(placement)[0]
    shapes.write_off(tmp_path / "cube.off", (below[0] * [1, 1, -1], below[1][:, ::-1]))
    (sheet,) = {REASONS[k] for k in unseen_reasons(evaluate_poses(load_study(path)))[0][:18]}
    assert sheet == "seen from behind"


def test_face_without_area_has_no_other_reason(tmp_path):
    path = write_two_cubes(tmp_path)
    vertices, faces = shapes.cube(1.0)
    shapes.write_off(tmp_path / "cube.off", (vertices, np.vstack([faces, [0, 0, 1]])))
    found = unseen_reasons(evaluate_poses(load_study(path)))[0]
    assert REASONS[found[-1]] == "no area"


def test_papers_rules_judge_by_vertices(tmp_path):
    text = SMALL.replace("[scene]", '[visibility]\nsemantics = "paper"\n[scene]')
    text = text.replace("max_distance = 12", "min_distance = 3.6\nmax_distance = 12")
    placement = evaluate_poses(load_study(write_two_cubes(tmp_path, text)))
    # C stands 4 before the cube of width 1 and looks down: its top lies 3.5 away, too near;
    # that of the small one 3.75 away
    tops = [np.flatnonzero(m.normals[:, 2] > 0.9) for m in placement.study.models]
    cube, small = (found.visible[2] for found in placement.maps)
    assert not cube[tops[0]].any()
    assert small[tops[1]].all()
    found = unseen_reasons(with_sensors(placement, slice(2, 3)))[0]
    assert {REASONS[k] for k in found[tops[0]]} == {"too near"}


def test_regions_are_pieces_that_share_edges():
    two = shapes.merged(shapes.cube(1.0), shapes.cube(2.0, center=(5, 0, 0)))
    model = Model.from_arrays("two", *two)
    chosen = np.ones(24, dtype=bool)
    chosen[[2, 3]] = False  # the first cube's +x
    large, small = regions(model, chosen)
    assert (large.n_faces, small.n_faces) == (12, 10)
    assert (large.area, small.area) == pytest.approx((24, 5))
    assert np.allclose(large.centre, [5, 0, 0])
    assert not large.facing.any()  # closed
    assert np.allclose(small.facing, [-1, 0, 0])
    assert regions(model, np.zeros(24, dtype=bool)) == []


def test_faces_that_touch_in_a_corner_are_two_regions():
    model = Model.from_arrays(
        "bow", [[0, 0, 0], [1, 0, 0], [1, 1, 0], [-1, 0, 0], [-1, -1, 0]], [[0, 1, 2], [0, 3, 4]]
    )
    assert len(regions(model, np.ones(2, dtype=bool))) == 2


def test_value_without_a_sensor_is_that_of_a_study_without_it(tmp_path):
    placement = evaluate_poses(load_study(write_two_cubes(tmp_path)))
    study = placement.study
    expected = np.mean(
        [
            study.objective.terms(np.delete(found.visible, 2, axis=0).sum(axis=0), m.areas)["value"]
            for m, found in zip(study.models, placement.maps, strict=True)
        ]
    )
    assert values_without(placement)[2] == pytest.approx(expected)


@pytest.mark.parametrize(
    ("facing", "words"),
    [
        ([0, -1, 0], "-Y"), ([0.7, 0, -0.7], "+X -Z"), ([0, 0, 0], "all sides"),
        ([0.1, 0.2, 0.97], "+Z"),
    ],
)  # fmt: skip
def test_directions_are_told_by_axes(facing, words):
    assert facing_words(np.array(facing)) == words


def test_words_add_up_to_the_unseen_area(ball):
    lines = list(explain_lines(ball))
    (line,) = [line for line in lines if line.startswith("  ball: ")]
    total, *parts = [float(word) for word in line.replace(":", " ").split() if is_number(word)]
    model, counts = ball.study.models[0], ball.maps[0].counts
    assert total == pytest.approx(
        100 * model.areas[counts == 0].sum() / model.areas.sum(), abs=0.051
    )
    assert sum(parts) == pytest.approx(total, abs=0.05 * len(REASONS))
    assert any(line.split()[:1] == ["B"] for line in lines)


def is_number(word: str) -> bool:
    try:
        float(word)
    except ValueError:
        return False
    return True
