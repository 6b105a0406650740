"""The surrogate: exact where nothing hides anything, and what it learns of occlusion."""

from dataclasses import replace

import numpy as np
import pytest
from support.ball_and_ring import SMALL, write_ball_and_ring
from support.shapes import icosphere, write_off

from glvis.evaluation.evaluator import Evaluator
from glvis.problem.visibility_options import VisibilityOptions
from glvis.search.auto_options import AutoOptions
from glvis.search.surrogate import Occlusion, Surrogate
from glvis.study.loading import load_study
from glvis.visibility.filters import Limits, faces_in_camera, pass_filters

# one convex body seen from around it, by centres of mass: only the filters decide
CONVEX = (
    SMALL.replace('"ball.off", "ring.off"', '"tiny.off"')
    .replace('obstacles = ["post.off"]', "")
    .replace('resolution = "sensor"', 'criterion = "centroid"')
)


def positions(study, n, rng):
    low, high = study.rig.bounds.T
    return low + (high - low) * rng.random((n, len(low)))


@pytest.mark.parametrize("kind", ["of1", "of3"])
def test_surrogate_is_the_value_where_nothing_hides_anything(tmp_path, rng, kind):
    study = load_study(write_ball_and_ring(tmp_path, rng, CONVEX), [f"objective.kind={kind}"])
    x = positions(study, 100, rng)
    with Evaluator(study) as evaluator:
        surrogate = Surrogate(study)
        assert np.allclose(surrogate(x, None), evaluator(x), atol=1e-12)
        of_one = [float(values[0]) for values in evaluator.each(x, (1,))]
        assert np.allclose(surrogate(x, (1,)), of_one, atol=1e-12)


@pytest.mark.parametrize("by_area", ["false", "true"])
def test_surrogate_of_counts_knows_how_many_faces_it_does_not_look_at(tmp_path, rng, by_area):
    two_sizes = CONVEX.replace('"tiny.off"', '"tiny.off", "fine.off"')
    path = write_ball_and_ring(tmp_path, rng, two_sizes)
    write_off(tmp_path / "fine.off", icosphere(4))
    study = load_study(path, ["objective.normalize=false", f"objective.by_area={by_area}"])
    x = positions(study, 100, rng)
    with Evaluator(study) as evaluator:
        values, predicted = evaluator(x), Surrogate(study)(x, None)
    assert 0.9 < predicted.mean() / values.mean() < 1.1
    assert np.corrcoef(predicted, values)[0, 1] > 0.9


def test_surrogate_looks_at_some_faces_only_and_ranks_as_maps_do(tmp_path, rng):
    study = load_study(write_ball_and_ring(tmp_path, rng), ["objective.kind=of1"])
    x = positions(study, 200, rng)
    with Evaluator(study) as evaluator:
        values, predicted = evaluator(x), Surrogate(study, AutoOptions(faces=100))(x, None)
        assert evaluator.maps_rendered == 2 * 2 * 200  # none of them for the surrogate
    ranks = [np.argsort(np.argsort(v)) for v in (values, predicted)]
    assert np.corrcoef(*ranks)[0, 1] > 0.6


def test_surrogate_of_a_position_does_not_depend_on_its_neighbours(tmp_path, rng):
    study = load_study(write_ball_and_ring(tmp_path, rng))
    x, surrogate = positions(study, 150, rng), Surrogate(study)
    together = surrogate(x, None)
    assert together.shape == (150,)
    assert [float(surrogate(row[None], None)[0]) for row in x[::10]] == together[::10].tolist()
    assert np.array_equal(surrogate(np.concatenate([x, x[:1]]), None)[[0, -1]], together[[0, 0]])


def test_surrogate_ranks_better_after_it_has_learned_from_maps(tmp_path, rng):
    study = load_study(write_ball_and_ring(tmp_path, rng), ["objective.kind=of1"])
    x, taught = positions(study, 200, rng), positions(study, 300, rng)
    surrogate, noted = Surrogate(study), []
    with Evaluator(study) as evaluator:
        values = evaluator(x)
        before = surrogate(x, None)
        list(evaluator.each(taught, None, lambda maps: noted.append(surrogate.sample(maps))))
    which = surrogate.unknown(taught, None)
    surrogate.learn(taught, None, which, np.array(noted)[which[:, 0], which[:, 1]])
    far_off = [np.abs(predicted - values).mean() for predicted in (before, surrogate(x, None))]
    assert far_off[1] < 0.5 * far_off[0]
    # sampled faces of a pose it was taught are known; only those between the filters differ
    assert np.abs(surrogate(taught, None) - evaluator_values(study, taught)).mean() < far_off[1]


def evaluator_values(study, x):
    with Evaluator(study) as evaluator:
        return evaluator(x)


def test_surrogate_learns_each_pose_once_and_no_more_than_it_may(tmp_path, rng):
    study = load_study(write_ball_and_ring(tmp_path, rng))
    surrogate, x = Surrogate(study, AutoOptions(poses=5)), positions(study, 3, rng)
    x[1, :2] = x[0, :2]  # the first sensor stays
    which = surrogate.unknown(np.concatenate([x, x]), None)
    assert which.tolist() == [[0, 0], [0, 1], [1, 1], [2, 0], [2, 1]]
    surrogate.learn(x, None, which[:3], np.zeros((3, surrogate.faces), bool))
    assert surrogate.unknown(x, None).tolist() == [[2, 0], [2, 1]]
    assert surrogate.unknown(x, (1,)).tolist() == [[2, 0]]
    assert not surrogate.is_full
    more = positions(study, 9, rng)
    which = surrogate.unknown(more, None)
    assert len(which) == 2
    surrogate.learn(more, None, which, np.zeros((2, surrogate.faces), bool))
    assert surrogate.is_full and len(surrogate.unknown(x, None)) == 0


def wall_of(viewpoints, targets):
    """Return whether targets (n, 3) are free from viewpoints (P, 3): no wall at x = 0 to z = 1."""
    share = viewpoints[:, None, 0] / (viewpoints[:, None, 0] - targets[None, :, 0])
    height = viewpoints[:, None, 2] + share * (targets[None, :, 2] - viewpoints[:, None, 2])
    return height > 1


def test_nothing_hides_anything_as_long_as_nothing_is_known():
    assert Occlusion(3).predict_free(np.zeros((2, 3))).tolist() == [[True] * 3] * 2


def test_viewpoint_in_the_same_place_decides_for_what_it_looked_at():
    occlusion = Occlusion(3)
    far = np.array([[9.0, 0, 0], [0, 9, 0], [0, 0, 9]])
    occlusion.learn(far, np.ones((3, 3), bool), np.ones((3, 3), bool))
    assert occlusion.predict_free(np.zeros((1, 3))).all()
    in_view = np.array([[True, True, False]])
    occlusion.learn(np.zeros((1, 3)), in_view, np.array([[True, False, False]]))
    assert occlusion.predict_free(np.zeros((1, 3))).tolist() == [[True, False, True]]


def test_face_that_no_near_viewpoint_looked_at_is_taken_for_free():
    occlusion = Occlusion(2)
    near, far = np.arange(16)[:, None] / 100 * np.ones(3), np.full((3, 3), 99.0)
    in_view = np.array([[False, True]] * 16)
    occlusion.learn(near, in_view, ~in_view & in_view)
    occlusion.learn(far, np.ones((3, 2), bool), np.zeros((3, 2), bool))
    assert occlusion.predict_free(np.zeros((1, 3))).tolist() == [[True, False]]
    assert occlusion.predict_free(far[:1]).tolist() == [[False, False]]


@pytest.mark.parametrize(("seen_by", "free"), [(0, False), (4, False), (6, True), (16, True)])
def test_face_is_free_where_a_third_of_the_votes_say_so(seen_by, free):
    turn = np.arange(16) * 2 * np.pi / 16  # all at the same distance
    viewpoints = np.stack([np.cos(turn), np.sin(turn), 0 * turn], axis=1)
    occlusion = Occlusion(1)
    occlusion.learn(viewpoints, np.ones((16, 1), bool), (np.arange(16) < seen_by)[:, None])
    assert occlusion.predict_free(np.zeros((1, 3))).tolist() == [[free]]


def test_it_does_not_matter_in_how_many_lots_it_learns(rng):
    viewpoints, seen = rng.random((400, 3)), rng.random((400, 5)) < 0.5
    in_view = seen | (rng.random((400, 5)) < 0.5)
    at_once, one_by_one = Occlusion(5), Occlusion(5)
    at_once.learn(viewpoints, in_view, seen)
    for k in range(400):
        one_by_one.learn(viewpoints[k : k + 1], in_view[k : k + 1], seen[k : k + 1])
        one_by_one.predict_free(viewpoints[:1])
    places = rng.random((30, 3))
    assert np.array_equal(at_once.predict_free(places), one_by_one.predict_free(places))


def test_wall_is_learned_from_what_it_hid(rng):
    targets = rng.uniform([-4, -2, 0], [-1, 2, 2], (60, 3))
    viewpoints, places = rng.uniform([1, -2, 0], [4, 2, 4], (2, 500, 3))
    in_view = rng.random((500, 60)) < 0.3  # each looks at some only
    occlusion = Occlusion(60)
    occlusion.learn(viewpoints, in_view, in_view & wall_of(viewpoints, targets))
    wrong = occlusion.predict_free(places) != wall_of(places, targets)
    assert 0.2 < wall_of(places, targets).mean() < 0.8
    assert wrong.mean() < 0.06


AXIS = {"criterion": "centroid", "incidence": "axis"}


@pytest.mark.parametrize("options", [VisibilityOptions(**AXIS), VisibilityOptions.paper()])
def test_surrogate_filters_by_the_studys_own_rule(tmp_path, rng, options):
    """Drift 2: incidence was measured by the ray even where the study says by the axis."""
    study = replace(load_study(write_ball_and_ring(tmp_path, rng, CONVEX)), visibility=options)
    sensor = replace(study.sensors[0], max_incidence=np.radians(40))
    poses = study.rig.poses(positions(study, 40, rng))[:, 0]
    surrogate, (model,) = Surrogate(study), study.models
    limits = Limits.of(sensor, options)
    # by its centre each, whatever the study's rule for corners
    faces = [faces_in_camera(model, pose, VisibilityOptions(**AXIS)) for pose in poses]
    expected = np.stack([pass_filters(one, limits) for one in faces])
    by_ray = np.stack([pass_filters(one, Limits.of(sensor, VisibilityOptions())) for one in faces])
    assert surrogate.faces == model.n_faces and np.count_nonzero(expected != by_ray) > 10
    assert np.array_equal(surrogate._filter(poses, sensor), expected)
