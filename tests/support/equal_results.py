"""What must come out the same, whoever renders and however often a search is broken off."""

from __future__ import annotations

import numpy as np

from glvis.visibility.maps import LocalMaps, MapJob, MapScene

_EQUAL = ("value", "start_value", "stop_reason", "evaluations", "maps_rendered", "seed", "gl")


def some_jobs(study, rng, least=17):
    """Return jobs of different size by both sensors of the small study."""
    low, high = study.rig.bounds.T
    poses = study.rig.poses(rng.uniform(low, high, size=(least + 26, len(low))))
    return [MapJob(s, poses[k : k + least + 20 * s, s]) for k in (0, 6) for s in (0, 1)]


def assert_same_maps(made, study, jobs):
    """Check that maps are those that this process makes."""
    local = LocalMaps(MapScene.of(study))
    expected = list(local.make(jobs))
    local.release()
    for one, other in zip(made, expected, strict=True):
        assert np.array_equal(one, other) and one.any()


def assert_same_placements(one, other):
    """Check that two placements differ in nothing but times and who rendered."""
    assert np.array_equal(one.position, other.position)
    for name in _EQUAL:
        assert getattr(one, name) == getattr(other, name)
    assert [row[:-1] for row in one.trace] == [row[:-1] for row in other.trace]
    for first, second in zip(one.maps, other.maps, strict=True):
        assert np.array_equal(first.visible, second.visible)
