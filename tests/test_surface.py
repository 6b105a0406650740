"""Faces packed for the compute shader: what comes out of the words is what went in."""

import numpy as np
import pytest
import shapes

from glvis.inputs.scene import Model
from glvis.sight.clusters import Clusters
from glvis.sight.surface import packed


def unpacked(words):
    """Return corners (F, 3, 3) on the lattice, counted from its middle, as the shader does."""
    words = words.astype(np.int64)
    low, high = words & (2**28 - 1), words >> 28
    last = sum(high[:, k] << (4 * k) for k in range(7))
    return np.concatenate([low, last[:, None]], axis=1).reshape(-1, 3, 3) - 2**27


@pytest.mark.parametrize("scale", [1e-3, 1.0, 1e5])
@pytest.mark.parametrize("seed", range(3))
def test_packed_corners_lie_where_they_were_and_stay_shared(seed, scale):
    rng = np.random.default_rng(seed)
    vertices, faces = shapes.blob(rng)
    vertices = scale * (vertices * rng.uniform(0.1, 1, 3) + rng.normal(size=3))
    clusters = Clusters.of(Model.from_arrays("blob", vertices, faces))
    low, high = clusters.model.bounds
    step = (high - low).max() / (2**28 - 2)
    corners = unpacked(packed(clusters)[: len(clusters.order)])
    assert np.abs(corners).max() == 2**27 - 1  # the whole lattice is used, and no more
    places = corners * step + (low + high) / 2
    expected = clusters.model.vertices[clusters.model.faces[clusters.order]]
    assert np.abs(places - expected).max() <= 0.501 * step
    of_vertex = clusters.model.faces[clusters.order].ravel()
    different = np.unique(
        np.concatenate([of_vertex[:, None], corners.reshape(-1, 3)], axis=1), axis=0
    )
    assert len(different) == len(np.unique(of_vertex))


def test_a_model_without_extent_is_packed_too():
    model = Model.from_arrays("flat", [[1, 2, 3], [2, 2, 3], [1, 3, 3]], [[0, 1, 2]])
    corners = unpacked(packed(Clusters.of(model))[:1])
    assert not corners[:, :, 2].any() and corners[0, 0, 0] == -corners[0, 1, 0] != 0
