"""The engine against an independent ray caster: whole ID images, and maps of both criteria."""

import numpy as np
import pytest
from support import oracle, shapes
from support.one_sensor import d415, looking, random_poses, sensor

from glvis.problem.camera import look_along
from glvis.problem.scene import load_model
from glvis.visibility.renderer import Renderer, Selection

TABLE_8 = [  # position, direction, roll in degrees
    ((178, -242, 136), (-0.82, 0.55, -0.14), 0),
    ((291, 73, 136), (-0.57, -0.40, -0.72), 0),
    ((216, -208, -136), (-0.77, 0.62, -0.13), 20),
    ((-236, 185, -136), (0.66, -0.74, -0.12), 0),
]


def scenes(rng):
    return {
        "blob": shapes.blob(rng),
        "torus": shapes.torus(),
        "soup": shapes.soup(rng),
        "tube": shapes.tube(),
    }


@pytest.mark.parametrize("name", ["blob", "torus", "soup", "tube"])
@pytest.mark.parametrize("seed", range(3))
def test_id_images_are_what_rays_through_pixel_centres_hit(name, seed):
    rng = np.random.default_rng(seed)
    shape = scenes(rng)[name]
    size = (64, 48)
    device = sensor(hfov_deg=60, vfov_deg=45, resolution=size)
    poses = random_poses(rng, 3)
    with looking(shape) as made, Renderer(size) as renderer:
        views = made.views(poses, device)
        everything = np.ones((len(poses), len(made.surface.clusters)), dtype=bool)
        selection = Selection(made.surface, everything)
        images = np.concatenate(
            [
                np.array(batch)
                for _, batch in renderer.id_images(views, [selection], origin=np.zeros(3))
            ]
        )
    corners = shapes.corners(shape)
    normals, _ = shapes.normals_and_areas(shape)
    differing = 0
    for pose, image, near in zip(poses, images, views.windows.clip_near, strict=True):
        truth = oracle.id_image(pose, tuple(device.lens.tan_half), size, corners, clip_near=near)
        is_front = ((pose[:3, 3] - corners.mean(axis=1)) * normals).sum(axis=1) > 0
        shows_back = (truth.ids > 0) & ~np.append(False, is_front)[truth.ids]
        assert np.count_nonzero(image[shows_back]) <= 3  # a front face that shares its edge
        # our 0 stands for a back face there, which the truth names
        _, wrong = oracle.disagreement(truth, np.where(shows_back, truth.ids, image))
        assert np.count_nonzero(wrong & (image > 0)) == 0
        differing += np.count_nonzero(np.where(shows_back, 0, truth.ids) != image)
    assert (images > 0).any() and differing <= 2e-3 * images.size


RULES = [
    {"criterion": "pixels"},
    {"criterion": "pixels", "incidence": "axis"},
    {"criterion": "pixels", "occlusion": "paper"},
    {"criterion": "centroid"},
    {"criterion": "centroid", "incidence": "axis"},
    {"criterion": "centroid", "occlusion": "paper"},
    {"semantics": "paper", "criterion": "centroid", "incidence": "axis", "occlusion": "paper"},
]


@pytest.mark.parametrize("options", RULES, ids=lambda o: "-".join(o.values()))
def test_maps_are_those_of_the_ray_caster(options):
    differing = total = seen = 0
    for seed in range(3):
        rng = np.random.default_rng(seed)
        body = shapes.blob(rng) if seed % 2 else shapes.torus()
        obstacle = shapes.moved(shapes.blob(rng, 2, 0.4), rng.normal(size=3))
        size = (200, 150)
        device = sensor(
            hfov_deg=60, vfov_deg=45, resolution=size, near=2, far=3.4, max_incidence_deg=70
        )
        poses = random_poses(rng, 2)
        with looking(body, [obstacle], resolution=size, **options) as made:
            visible = made.looks(poses, device)
        rules = oracle.Rules(
            **{k: v for k, v in options.items() if k != "criterion"}, clip_near=3.4e-3
        )
        arguments = (shapes.corners(body), shapes.corners(obstacle), rules)
        for pose, ours in zip(poses, visible, strict=True):
            if options["criterion"] == "pixels":
                theirs = oracle.pixel_visible(pose, oracle.Eye.of(device), size, *arguments) > 0
            else:
                theirs = oracle.centroid_visible(pose, oracle.Eye.of(device), *arguments)
            differing += np.count_nonzero(ours != theirs)
            seen += np.count_nonzero(theirs)
            total += len(theirs)
    # faces at an occluder's edge, a fraction of a pixel to either side
    assert seen > 0.05 * total and differing <= 0.02 * seen


def table_8_poses() -> np.ndarray:
    position, direction, roll = (
        np.array(column, dtype=float) for column in zip(*TABLE_8, strict=True)
    )
    return look_along(position, direction, np.radians(roll), up=(0, 1, 0))


@pytest.mark.parametrize("criterion", ["pixels", "centroid"])
def test_a_real_arm_is_seen_as_rays_see_it(criterion, shared_data):
    arm = load_model(shared_data / "arms" / "arm2.stl")
    device = d415()
    eye = oracle.Eye.of(device)
    poses = table_8_poses()
    corners = arm.vertices[arm.faces]
    with looking((arm.vertices, arm.faces), criterion=criterion) as made:
        visible = made.looks(poses, device)
    wrong = missed = half = both = either = 0
    for pose, ours in zip(poses, visible, strict=True):
        if criterion == "pixels":
            share = oracle.point_visibility(pose, eye, corners, n=8)  # 64 points a face
            wrong += np.count_nonzero(ours & (share == 0))
            half += np.count_nonzero(share >= 0.5)
            missed += np.count_nonzero((share >= 0.5) & ~ours)
        else:
            theirs = oracle.centroid_visible(pose, eye, corners)
            both += np.count_nonzero(ours & theirs)
            either += np.count_nonzero(ours | theirs)
    if criterion == "pixels":
        assert half > 3000 and wrong <= 1e-3 * np.count_nonzero(visible) and missed <= 5e-3 * half
    else:
        assert both >= 0.999 * either and either > 3000
