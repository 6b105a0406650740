"""Culling never changes a picture: whole ID images with and without it, over many seeds."""

import numpy as np
import pytest
from support import shapes
from support.one_sensor import looking, random_poses, sensor

from glvis.problem.camera import look_along
from glvis.problem.scene import Model
from glvis.visibility.clusters import Clusters
from glvis.visibility.culling import clusters_in_frustum, cull, most_height
from glvis.visibility.renderer import Renderer, Selection


def clusters_of(shape, size=None) -> Clusters:
    return Clusters.of(Model.from_arrays("shape", *shape), size)


def pictures(made, views, selection, refused_hide):
    with Renderer((96, 72)) as renderer:
        return np.concatenate(
            [
                np.array(images)
                for _, images in renderer.id_images(
                    views, [selection], origin=np.zeros(3), refused_hide=refused_hide
                )
            ]
        )


def half_a_blob(rng):
    """A body with a hole, as a scan cut off at the elbow has."""
    vertices, faces = shapes.blob(rng)
    keep = vertices[faces][:, :, 2].max(axis=1) < 0.5
    return vertices, faces[keep]


BODIES = {
    "closed": shapes.blob,
    "two closed": lambda rng: shapes.merged(
        shapes.blob(rng), shapes.moved(shapes.torus(), (1.5, 0, 0))
    ),
    "with a hole": half_a_blob,
    "tube": lambda rng: shapes.tube(),
    "inside out": lambda rng: shapes.flipped(shapes.blob(rng)),
    "soup": shapes.soup,
    "plates": lambda rng: shapes.merged(
        shapes.plate(2, center=(0, 0, 1)), shapes.plate(2, center=(0, 0, -1), tilt_deg=30)
    ),
}


@pytest.mark.parametrize("occlusion", ["physical", "paper"])
@pytest.mark.parametrize("body", BODIES)
@pytest.mark.parametrize("seed", range(4))
def test_culling_never_changes_an_id_image(body, seed, occlusion):
    rng = np.random.default_rng(seed)
    shape = BODIES[body](rng)
    # from outside, from close by, and from inside the hull
    poses = np.concatenate(
        [random_poses(rng, 12), random_poses(rng, 8, 1.2), random_poses(rng, 8, 0.4)]
    )
    with looking(shape, occlusion=occlusion, resolution=(96, 72)) as made:
        views = made.views(poses, sensor(hfov_deg=70, vfov_deg=50, far=3.5))
        left = cull(made.scene, views)
        mask = left.countable if occlusion == "paper" else left.occludes
        culled = Selection(made.surface, mask)
        everything = Selection(made.surface, np.ones_like(culled.mask))
        hide = occlusion == "physical"
        pictured = pictures(made, views, culled, hide)
        assert np.array_equal(pictured, pictures(made, views, everything, hide))
    assert (pictured > 0).any()


@pytest.mark.parametrize("seed", range(6))
def test_culled_clusters_hold_no_face_that_could_show(seed):
    rng = np.random.default_rng(seed)
    shape = shapes.blob(rng)
    poses = random_poses(rng, 20, rng.uniform(0.3, 4))
    device = sensor(hfov_deg=50, vfov_deg=30, far=3.0, max_incidence_deg=60)
    with looking(shape) as made:
        views = made.views(poses, device)
        culled = cull(made.scene, views)
        clusters = made.surface.clusters
        faces = clusters.order.reshape(-1, clusters.size)
        model = clusters.model
        towards = (views.eye[:, None] - model.centroids) * model.normals
        is_front = towards.sum(axis=2) > 0
        height = most_height(made.scene, views.eye)
        assert not (is_front[:, faces].any(axis=2) & (height < 0)).any()
        corners = model.vertices[model.faces]
        points = np.concatenate([corners, np.ones((*corners.shape[:2], 1))], axis=2)
        inside = np.einsum("nkd,fcd->nfck", views.planes, points) >= 0
        shows = inside.all(axis=3).any(axis=2)
        assert not (
            shows[:, faces].any(axis=2) & ~clusters_in_frustum(made.scene, views.planes)
        ).any()
        # every corner's ray, for a pixel may show any part of a face
        rays = views.eye[:, None, None] - corners
        cosine = np.sum(rays * model.normals[:, None], axis=3) / np.linalg.norm(rays, axis=3)
        counts = shows & (cosine.max(axis=2) >= 0.5)
        assert not (counts[:, faces].any(axis=2) & ~culled.countable).any()


def test_clusters_that_are_too_oblique_are_no_candidates():
    device = sensor(far=30, max_incidence_deg=30)
    pose = look_along([0, 0, 20], [0, 0, -1], up=(0, 1, 0))[None]
    with looking(shapes.icosphere(5)) as made:
        culled = cull(made.scene, made.views(pose, device))
        # seen from 20 radii, 30 degrees of incidence are 28.6 at the middle of a sphere, and
        # (1 - cos 28.6) / 2 = 0.061 of it; about half faces the eye
        assert 0.061 < culled.countable.mean() < 0.15
        assert culled.occludes.mean() > 0.45


def test_every_face_with_area_is_in_one_cluster(rng):
    vertices, faces = shapes.blob(rng, 2)
    broken = vertices, np.insert(faces, 7, [3, 3, 4], axis=0)
    for size in (1, 4, 64):
        clusters = clusters_of(broken, size)
        assert len(clusters.order) == size * len(clusters)
        assert sorted(set(clusters.order.tolist())) == [k for k in range(len(broken[1])) if k != 7]
        last = np.arange(len(clusters)) == len(clusters) - 1
        assert np.array_equal(clusters.order[clusters.places_in(last)], clusters.order[-size:])


def test_a_mesh_without_area_to_draw_has_no_clusters():
    vertices, faces = shapes.plate(1)
    model = Model.from_arrays("plate", vertices, faces)
    object.__setattr__(model, "areas", np.zeros(len(faces)))
    assert len(Clusters.of(model)) == 0
