"""Coarser occluders: what merging keeps, when they are used, and that maps stay what rays see."""

import numpy as np
import oracle
import pytest
import shapes
from scipy.spatial import cKDTree
from sight import DOWN, mapper, random_poses, sensor

from glvis.camera import camera_to_world
from glvis.inputs.scene import Model
from glvis.sight import coarser
from glvis.sight.clusters import Clusters

# A closed ring, so thin that many times its thickness goes into the cells below.
THIN = {"major": 1.0, "minor": 0.01, "nu": 800, "nv": 12}


def merged(shape, cell):
    model = Model.from_arrays("shape", *shape)
    return model, coarser.merged(model, Clusters.of(model).boundary_vertices, cell)


@pytest.mark.parametrize("cell", [0.05, 0.1, 0.3])
def test_merging_moves_no_vertex_out_of_its_cell_and_closes_what_was_closed(cell):
    rng = np.random.default_rng(1)
    for shape in (shapes.blob(rng, 5), shapes.torus(nu=120, nv=60), shapes.torus(**THIN)):
        fine, coarse = merged(shape, cell)
        assert fine.is_closed and coarse.n_faces < fine.n_faces
        # an edge has two faces, or four where two parts touch: one face alone would be a gap
        assert coarse.boundary_edges == 0
        distance, _ = cKDTree(fine.vertices).query(coarse.vertices)
        assert distance.max() <= np.sqrt(3) * cell


def test_a_sphere_keeps_its_place_and_its_winding():
    fine, coarse = merged(shapes.icosphere(6), 0.1)  # 81,920 faces with edges of 0.02
    assert coarse.n_faces < 0.1 * fine.n_faces
    radius = np.linalg.norm(coarse.vertices, axis=1)
    # the mean of a cap as wide as a cell's diagonal lies below the sphere by less than its height
    assert radius.max() <= 1 and radius.min() > np.sqrt(1 - 3 * 0.05**2) - 1e-3
    outwards = np.sum(coarse.normals * coarse.centroids, axis=1)
    assert np.average(outwards > 0, weights=coarse.areas) > 0.99


def test_a_ring_thinner_than_a_cell_keeps_its_thickness():
    fine, coarse = merged(shapes.torus(**THIN), 0.08)
    assert coarse.n_faces < 0.3 * fine.n_faces
    ring = np.hypot(coarse.vertices[:, 0], coarse.vertices[:, 1])
    assert np.ptp(coarse.vertices[:, 2]) > 0.012 and np.ptp(ring) > 0.012  # of 0.02


def test_vertices_on_a_boundary_stay():
    fine, coarse = merged(shapes.plate(1.0, cells=(60, 60)), 0.2)
    edge = fine.vertices[np.abs(fine.vertices[:, :2]).max(axis=1) == 0.5]
    assert len(edge) == 240 and coarse.n_faces < 0.3 * fine.n_faces
    kept = {tuple(row) for row in coarse.vertices.tolist()}
    assert all(tuple(row) in kept for row in edge.tolist())


def test_triangles_that_share_no_vertex_are_left_alone():
    fine, coarse = merged(shapes.soup(np.random.default_rng(0)), 5.0)
    assert np.array_equal(coarse.vertices[coarse.faces], fine.vertices[fine.faces])


def test_a_sheet_modelled_from_both_sides_keeps_its_rim():
    strip = shapes.plate(2.0, 0.04, cells=(100, 4))
    fine, coarse = merged(shapes.merged(strip, shapes.flipped(strip)), 0.1)
    assert fine.boundary_edges == 0  # at the rim each edge has two faces
    assert np.allclose(coarse.bounds, fine.bounds)
    assert np.isclose(coarse.areas.sum(), fine.areas.sum())


def test_what_no_edge_joins_stays_apart():
    left = shapes.plate(1.0, cells=(40, 40))
    both = Model.from_arrays("two", *shapes.merged(left, shapes.moved(left, (1.02, 0, 0))))
    nothing = np.zeros(0, dtype=int)  # as if the rims were no boundary
    coarse = coarser.merged(both, nothing, 0.3)
    assert coarse.n_faces < 0.1 * both.n_faces
    x = coarse.vertices[coarse.faces][..., 0]
    assert np.all((x.max(axis=1) <= 0.5) | (x.min(axis=1) >= 0.52))


@pytest.fixture
def for_small_models(monkeypatch):
    """Let small models have coarser occluders too."""
    monkeypatch.setattr(coarser, "_FROM_FACES", 0)
    monkeypatch.setattr(coarser, "_MOST_OF_SIZE", 1 / 16)


def scene():
    rng = np.random.default_rng(1)
    ring = shapes.moved(shapes.torus(1.0, 0.02, 400, 8), (0, 0, 1.2))
    body = shapes.merged(shapes.blob(rng, 4), ring)
    return body, random_poses(rng, 3), sensor(resolution=(100, 100), far=6, max_incidence_deg=80)


@pytest.mark.parametrize("casts", [True, False], ids=["cast", "drawn"])
def test_maps_by_centre_are_as_with_all_faces_and_as_rays_see(casts, monkeypatch, for_small_models):
    body, poses, device = scene()
    maps, used = [], []
    for fewest in (0, 10**9):
        monkeypatch.setattr(coarser, "_FROM_FACES", fewest)
        with mapper(body, casts=casts, criterion="centroid", resolution=(100, 100)) as made:
            maps.append(made.looks(poses, device))
            used.append(bool(made._stand_ins._made))
    assert used == [True, False]
    eye = oracle.Eye.of(device)
    truth = np.stack([oracle.centroid_visible(pose, eye, shapes.corners(body)) for pose in poses])
    coarse, fine = (np.count_nonzero(m & truth) / np.count_nonzero(m | truth) for m in maps)
    assert truth.sum() > 3000 and np.any(maps[0] != maps[1])
    assert coarse > 0.98 and coarse > fine - 0.01


def test_a_thin_ring_still_hides(monkeypatch, for_small_models):
    wall = shapes.plate(6, center=(0, 0, -4), cells=(100, 100))
    ring = shapes.moved(shapes.torus(1.0, 0.02, 400, 8), (0, 0, -3))
    device = sensor(far=10, resolution=(200, 200))  # a pixel is 0.017 wide at the ring
    hidden = []
    for fewest in (0, 10**9):
        monkeypatch.setattr(coarser, "_FROM_FACES", fewest)
        with mapper(wall, [ring], criterion="centroid", resolution=(200, 200)) as made:
            hidden.append(~made.looks(DOWN[None], device)[0])
    with mapper(wall, criterion="centroid", resolution=(200, 200)) as made:
        free = made.looks(DOWN[None], device)[0]
    assert np.count_nonzero(hidden[1] & free) > 200
    assert np.count_nonzero(hidden[0] & hidden[1]) > 0.95 * np.count_nonzero(hidden[1])
    assert np.count_nonzero(hidden[0]) < 1.05 * np.count_nonzero(hidden[1])


def test_a_views_level_follows_from_its_pose_alone(for_small_models):
    body, _, device = scene()
    far_to_near = [
        camera_to_world([0, 0.1, d], [0, 0, -1], up=(0, 1, 0)) for d in (8, 5, 3, 1.4, 0)
    ]
    poses = np.stack(far_to_near)
    with mapper(body, criterion="centroid", resolution=(100, 100)) as made:
        together = made.looks(poses, device)
        levels = coarser._levels(made.surface, made.views(poses, device), (100, 100))
    assert np.all(np.diff(levels) <= 0) and levels[0] > levels[-1] == 0
    for pose, seen in zip(poses[::-1], together[::-1], strict=True):
        with mapper(body, criterion="centroid", resolution=(100, 100)) as made:
            assert np.array_equal(made.looks(pose[None], device)[0], seen)


@pytest.mark.parametrize(("most", "is_used"), [(2**19, True), (4, False)])
def test_cells_too_many_to_be_numbered_are_not_made(most, is_used, for_small_models, monkeypatch):
    monkeypatch.setattr(coarser, "_MOST_CELLS", most)
    body, poses, device = scene()
    with mapper(body, criterion="centroid", resolution=(100, 100)) as made:
        made.looks(poses, device)
        assert bool(made._stand_ins._made) == is_used


def test_a_mesh_of_separate_triangles_is_not_copied(for_small_models):
    vertices, faces = shapes.icosphere(4)
    apart = vertices[faces].reshape(-1, 3) * (1 + 1e-9 * np.arange(3 * len(faces))[:, None])
    poses = random_poses(np.random.default_rng(0), 2, distance=4)
    with mapper((apart, np.arange(len(apart)).reshape(-1, 3)), criterion="centroid") as made:
        assert made.looks(poses, sensor()).any()
        assert made._stand_ins._made and not any(made._stand_ins._made.values())


def test_pixels_are_counted_behind_the_faces_themselves(for_small_models):
    body, poses, device = scene()
    with mapper(body, criterion="pixels") as made:
        assert made.looks(poses, device).any()
        assert not made._stand_ins._made
