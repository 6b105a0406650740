"""A furnished room whose floor and walls are two triangles each: areas seen are true or warned of.

The room comes from formulas, the truth from rays to a grid of points on its surfaces; see rooms.py.
"""

import numpy as np
import pytest
from support import oracle, rooms

from glvis.cli.app import main
from glvis.cli.wording import large_face_warnings
from glvis.evaluation.evaluator import Evaluator
from glvis.problem.camera import look_along
from glvis.search.estimate import large_faces
from glvis.search.placement import place_sensors
from glvis.study.loading import load_study

POINT = 1.0  # percent of the area


def area_seen(model, seen) -> float:
    return 100 * model.areas[seen.counts > 0].sum() / model.areas.sum()


@pytest.fixture(scope="module", params=["pixels", "centroid"])
def study(request, tmp_path_factory):
    """The room as it is studied by default: ``max_edge`` is not named."""
    folder = tmp_path_factory.mktemp("room")
    return load_study(rooms.write_room_study(folder, criterion=request.param))


def test_the_room_is_what_it_is_said_to_be(study):
    whole = study.models[0].file
    assert whole.n_faces == 12 * (1 + len(rooms.FURNITURE))
    assert whole.is_closed
    width, depth, _ = rooms.SIZE
    np.testing.assert_allclose(whole.areas[8:10], width * depth / 2)  # the floor
    np.testing.assert_allclose(whole.normals[8:12, 2], [1, 1, -1, -1])
    _, _, areas = rooms.surface_points(0.1)
    assert areas.sum() == pytest.approx(whole.areas.sum())
    assert areas.sum() == pytest.approx(study.models[0].areas.sum())


def test_the_truth_is_that_of_an_independent_ray_caster(rng, monkeypatch):
    vertices, faces = rooms.room()
    points, normals, _ = rooms.surface_points(0.1)
    for _ in range(5):
        place, aim = (
            rng.uniform([0.1, 0.1, 2.2], [5.9, 4.9, 2.6]),
            rng.uniform([1, 1, 0], [5, 4, 1]),
        )
        pose = look_along(place, aim - place, 0.0, [0, 0, 1])
        found = rooms.sees(pose, points, normals)
        with monkeypatch.context() as patch:
            patch.setattr(rooms, "FURNITURE", ())
            in_view = rooms.sees(pose, points, normals)
        hidden = oracle.is_hidden(
            place, points[in_view], np.full(in_view.sum(), -1), vertices[faces]
        )
        assert hidden.any()
        np.testing.assert_array_equal(found[in_view], ~hidden)
        assert not found[~in_view].any()


def assert_ten_layouts_are_right(study):
    rng = np.random.default_rng(7)
    low, high = study.rig.bounds.T
    with Evaluator(study) as evaluator:
        for _ in range(10):
            poses = study.rig.poses(rng.uniform(low, high))
            (seen,) = evaluator.visibility_of_poses(poses)
            truth = 100 * rooms.true_area_share(poses, 0.02)
            assert area_seen(study.models[0], seen) == pytest.approx(truth, abs=POINT)


def test_area_seen_by_ten_random_layouts_is_that_of_rays(study):
    assert_ten_layouts_are_right(study)


def test_area_seen_by_what_the_search_finds_is_that_of_rays(study):
    found = place_sensors(study, workers=2)
    truth = 100 * rooms.true_area_share(found.camera_to_world, 0.02)
    assert area_seen(study.models[0], found.maps[0]) == pytest.approx(truth, abs=POINT)
    assert truth > 40


def test_at_the_sensors_pixels_it_is_too(tmp_path):
    study = load_study(rooms.write_room_study(tmp_path), ["visibility.resolution=sensor"])
    assert_ten_layouts_are_right(study)


def test_without_the_cut_check_warns(tmp_path, capsys):
    path = rooms.write_room_study(tmp_path, 'max_edge = "off"')
    assert main(["check", str(path)]) == 0
    out = capsys.readouterr().out
    uneven, line = (line for line in out.splitlines() if line.startswith("Warning: "))
    assert uneven.endswith("the objective counts faces; [objective] by_area = true counts area")
    assert line.startswith(
        "Warning: room: 232 faces hold 100 % of the area and each counts whole: "
    )
    assert line.endswith("set [scene] max_edge = 'auto', or a length such as 0.29 (m)")


def test_with_it_check_says_what_was_cut_and_does_not_warn(tmp_path, capsys):
    assert main(["check", str(rooms.write_room_study(tmp_path))]) == 0
    out = capsys.readouterr().out
    assert "Warning" not in out
    assert "  room: 252 faces hold 100 % of the area; cut into 210,544 pieces, edges up to" in out
    assert "Objective: OF1 by faces and pieces" in out


@pytest.mark.parametrize("criterion", ["pixels", "centroid"])
def test_the_warning_tells_what_both_criteria_see(tmp_path, criterion):
    path = rooms.write_room_study(tmp_path, 'max_edge = "off"', criterion)
    (found,) = large_faces(load_study(path))
    assert found.difference > 0.3
    assert found.by_pixels - found.by_centroid == pytest.approx(found.difference, abs=0.1)
    # too long a length is told with how long it was
    (line,) = large_face_warnings(load_study(path, ["scene.max_edge=1.0"]))
    assert line.endswith("set [scene] max_edge shorter than 1 (m)")
    assert large_face_warnings(load_study(path, ["scene.max_edge=0.1"])) == []
