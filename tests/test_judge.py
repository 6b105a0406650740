"""The judge says what the slow ray caster says, leaves rounding open, and counts right."""

import numpy as np
import pytest
from support import kinds, oracle, shapes
from support.figures import Truth
from support.judge import Judge
from support.oracle import Eye
from support.verdicts import AROUND, INSIDE, NEAR, corners_of, poses_about, size_of

EYE = Eye(60, 60, max_distance=10)


def sheets(*gaps: float) -> np.ndarray:
    """Return sheets of 18 faces each that look at the origin, 2 away and ``gaps`` nearer."""
    return corners_of(
        shapes.merged(*(shapes.plate(1.0, center=(0, 0, gap - 2), cells=(3, 3)) for gap in gaps))
    )


@pytest.mark.parametrize("kind", ["sheet box, wall 1e-3", "soup", "lattice", "faces of no area"])
def test_the_judge_says_what_the_ray_caster_says(kind, rng):
    corners = corners_of(kinds.KINDS[kind]())
    eye = Eye(60, 45, max_distance=3 * size_of(corners)[1], max_incidence_deg=75)
    for pose in poses_about(rng, corners, (AROUND, INSIDE, NEAR)):
        judge = Judge(pose, eye, corners)
        arguments = corners, None, oracle.Rules(clip_near=judge.clip)
        centres = judge.centroids()
        differs = centres.free != oracle.centroid_visible(pose, eye, *arguments)
        assert not (differs & ~centres.doubtful).any()
        assert np.count_nonzero(centres.doubtful) <= 0.01 * len(corners)
        surely, possibly = judge.shares(3)
        share = oracle.point_visibility(pose, eye, *arguments, n=3)
        assert np.all((surely - 1e-9 <= share) & (share <= possibly + 1e-9))
        surely, possibly = judge.pixels((40, 30))
        seen = oracle.pixel_visible(pose, eye, (40, 30), *arguments)
        assert np.all((surely <= seen) & (seen <= possibly))
        assert possibly.sum() - surely.sum() <= 0.02 * 40 * 30


@pytest.mark.parametrize(
    ("gap", "free", "doubtful"),
    [(0.0, True, False), (1e-12, True, False), (1e-8, False, True), (1e-4, False, False)],
)
def test_faces_that_coincide_do_not_hide_and_rounding_is_left_open(gap, free, doubtful):
    verdict = Judge(np.eye(4), EYE, sheets(0, gap)).centroids()
    assert np.all(verdict.free[:18] == free) and np.all(verdict.doubtful[:18] == doubtful)
    assert verdict.surely[18:].all()


def test_pixels_show_every_one_of_faces_that_coincide():
    # aside, so that no ray meets just the line between two faces
    corners = np.add(sheets(0, 0, -1e-3), [0.013, 0, 0])
    surely, possibly = Judge(np.eye(4), EYE, corners).pixels((50, 50))
    assert np.array_equal(surely[:18], surely[18:36]) and (surely[:18] > 20).all()
    assert not possibly[36:].any()


def test_obstacles_hide_and_what_is_very_near_does_not():
    small = corners_of(shapes.plate(0.5, center=(0, 0, -1)))
    hidden = ~Judge(np.eye(4), EYE, sheets(0), small).centroids().free
    assert hidden.all()
    clip = Judge(np.eye(4), EYE, sheets(0)).clip
    assert clip == 1e-3 * min(4 * 2, EYE.max_distance)
    near = corners_of(shapes.plate(0.5, center=(0, 0, -0.99 * clip)))
    assert Judge(np.eye(4), EYE, sheets(0), near).centroids().surely.all()


def test_limits_leave_open_what_is_at_them():
    corners = sheets(0)
    at, before, beyond = (
        Judge(np.eye(4), Eye(60, 60, max_distance=most), corners).centroids()
        for most in (2.0, 2.001, 1.999)
    )
    assert at.doubtful.all() and before.surely.all() and not beyond.possibly.any()
    edge_on = corners_of(shapes.plate(1.0, center=(0, 0, 0), tilt_deg=90))
    assert Judge(np.eye(4), EYE, edge_on - [0, 0, 2]).centroids().doubtful.all()


def test_figures_count_what_is_wrong_and_what_is_missed():
    corners = sheets(0, 0.2)  # the nearer one hides all of the other but a rim
    judge = Judge(np.eye(4), EYE, corners)
    hidden = judge.shares(64)[1] == 0
    free = judge.centroids().surely
    assert hidden.any() and free[18:].all()

    truth, everything, nothing = Truth(judge), np.ones(36, dtype=bool), np.zeros(36, dtype=bool)
    right = truth.of_centroids(free)
    assert right.iou == 1 and right.excused == 0 and right.judged == right.seen == free.sum()
    assert truth.of_centroids(everything).iou == free.sum() / 36
    right = truth.of_pixels(~hidden)
    assert right.wrong == right.missed == 0 and right.seen == 36 - hidden.sum()
    wrong = truth.of_pixels(everything, at_most=1)
    assert wrong.wrong == hidden.sum() and wrong.missed == 0
    blind = truth.of_pixels(nothing, (300, 300))
    assert blind.missed == blind.half >= 18 and blind.missed_any >= blind.half
    # faces of less than two pixels cannot be missed where pixels alone decide
    assert truth.of_pixels(nothing, (4, 4)).half < 18
    right += wrong
    assert right.seen == 72 - hidden.sum() and right.wrong_percent == 100 * wrong.wrong / right.seen
