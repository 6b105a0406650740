"""What counts as visible: one closed form a rule of method and paper (Sec. 2.1)."""

import math

import numpy as np
import pytest
from support import shapes
from support.one_sensor import random_poses, seen, sensor

from glvis.problem.camera import look_along
from glvis.problem.visibility_options import VisibilityOptions, asks_about_points, render_resolution
from glvis.visibility.visibility_map import VisibilityMap

BOTH = pytest.mark.parametrize("criterion", ["pixels", "centroid"])


@BOTH
def test_a_sphere_shows_the_share_that_geometry_says_and_a_finer_mesh_comes_closer(criterion):
    errors = np.zeros((2, 3))
    for i, subdivisions in enumerate((2, 5)):
        for k, distance in enumerate((1.5, 2.0, 5.0)):
            sphere = shapes.icosphere(subdivisions, center=(0, 0, -distance))
            areas = shapes.normals_and_areas(sphere)[1]
            fov = 2 * math.degrees(math.asin(1 / distance)) + 2  # the sphere fills the picture
            visible = seen(
                sphere,
                device=sensor(hfov_deg=fov, vfov_deg=fov),
                criterion=criterion,
                resolution=(1200, 1200),
            )
            truth = (1 - 1 / distance) / 2  # of a sphere of radius 1
            errors[i, k] = abs(areas[visible].sum() / areas.sum() - truth)
    assert errors[1].sum() < errors[0].sum() / 2 and errors[1].max() < 0.003


@BOTH
def test_from_the_diagonal_a_cube_shows_exactly_three_sides(criterion):
    pose = look_along([3, 3, 3], [-1, -1, -1])
    visible = seen(shapes.cube(), pose, criterion=criterion)
    # pairs of faces: -x, +x, -y, +y, -z, +z
    assert visible.tolist() == [False, False, True, True] * 3


@BOTH
def test_a_plate_hides_of_a_wall_what_the_pinhole_projects_it_on(criterion):
    half, near, far = 0.5, 2.0, 6.0
    wall = shapes.plate(12, center=(0, 0, -far), cells=(60, 60))
    plate = shapes.plate(2 * half, center=(0, 0, -near))
    visible = seen(
        wall,
        obstacles=[plate],
        device=sensor(hfov_deg=100, vfov_deg=100),
        criterion=criterion,
        resolution=(600, 600),
    )
    x, y, _ = shapes.corners(wall).mean(axis=1).T
    shadow = half * far / near
    cell = 12 / 60
    inside = (np.abs(x) < shadow - cell) & (np.abs(y) < shadow - cell)
    outside = (np.abs(x) > shadow + cell) | (np.abs(y) > shadow + cell)
    assert not visible[inside].any() and visible[outside].all() and inside.sum() > 300


@BOTH
def test_a_wall_shows_the_rectangle_of_the_field_of_view(criterion):
    z, device = 5.0, sensor(hfov_deg=66.4, vfov_deg=39.5, resolution=(640, 360))
    wall = shapes.plate(12, center=(0, 0, -z), cells=(120, 120))
    visible = seen(wall, device=device, criterion=criterion, resolution=(640, 360))
    x, y, _ = np.abs(shapes.corners(wall).mean(axis=1).T)
    width, height = z * math.tan(math.radians(33.2)), z * math.tan(math.radians(19.75))
    cell = 0.1
    inside = (x < width - cell) & (y < height - cell)
    outside = (x > width + cell) | (y > height + cell)
    assert visible[inside].all() and not visible[outside].any()
    assert inside.sum() > 4000 and outside.sum() > 4000


@BOTH
@pytest.mark.parametrize("incidence", ["ray", "axis"])
@pytest.mark.parametrize(
    ("tilt", "counted"), [(0, True), (69.9, True), (70.1, False), (180, False)]
)
def test_a_tilted_plate_counts_up_to_the_largest_incidence(criterion, incidence, tilt, counted):
    plate = shapes.plate(0.01, center=(0, 0, -2), tilt_deg=tilt)  # small: one ray for all of it
    device = sensor(hfov_deg=1, vfov_deg=1, max_incidence_deg=70)
    visible = seen(
        plate, device=device, criterion=criterion, incidence=incidence, resolution=(400, 400)
    )
    assert visible.tolist() == [counted] * 2


@BOTH
def test_incidence_by_ray_and_by_axis_differ_off_the_axis(criterion):
    # 40 degrees beside the axis, facing along the axis: 0 degrees by the axis, 40 by the ray
    x = 5 * math.tan(math.radians(40))
    plate = shapes.plate(0.2, center=(x, 0, -5))
    device = sensor(hfov_deg=100, vfov_deg=100, max_incidence_deg=30)
    options = {"criterion": criterion, "resolution": (400, 400)}
    assert not seen(plate, device=device, incidence="ray", **options).any()
    assert seen(plate, device=device, incidence="axis", **options).all()


@BOTH
def test_a_near_plate_is_not_counted_but_still_hides_the_wall(criterion):
    scene = shapes.merged(shapes.plate(10, center=(0, 0, -5)), shapes.plate(1, center=(0, 0, -0.4)))
    device = sensor(near=1.0)
    assert not seen(scene, device=device, criterion=criterion, resolution=(200, 200)).any()
    assert seen(scene, device=sensor(), criterion=criterion, resolution=(200, 200)).tolist() == [
        *(False, False),
        *(True, True),
    ]


@pytest.mark.parametrize("far", [400.0, 1e6, 1e12])
@pytest.mark.parametrize(
    "options",
    [
        {"criterion": "centroid", "resolution": "auto"},
        {"criterion": "centroid", "resolution": "auto", "casts": False},
        {"resolution": "auto"},
        {"resolution": (200, 200)},
        {"semantics": "paper", "criterion": "centroid", "incidence": "axis", "occlusion": "paper"},
    ],
    ids=["cast", "rays", "pixels", "drawn", "paper"],
)
def test_a_range_without_end_moves_nothing(options, far):
    # a hundredth of the wall's depth before the eye, far below a thousandth of such a range
    plate = shapes.plate(2, center=(0, 0, -3))
    wall = shapes.plate(300, center=(0, 0, -300), cells=(30, 30))
    visible = seen(wall, obstacles=[plate], device=sensor(far=far), **options)
    assert np.array_equal(visible, seen(wall, obstacles=[plate], device=sensor(far=400), **options))
    off = np.abs(wall[0][wall[1]].mean(axis=1)[:, :2]).max(axis=1)  # the shadow ends at 100
    assert not visible[off < 95].any() and visible[off > 105].all()


@BOTH
def test_beyond_the_far_end_of_the_range_nothing_counts(criterion):
    wall = shapes.plate(4, center=(0, 0, -5))
    assert seen(wall, device=sensor(far=5.01), criterion=criterion).all()
    assert not seen(wall, device=sensor(far=4.99), criterion=criterion).any()


@BOTH
def test_an_obstacle_hides_from_both_its_sides_and_is_never_counted(criterion):
    wall = shapes.plate(4, center=(0, 0, -5))
    plate = shapes.plate(4, center=(0, 0, -2))
    for obstacle in (plate, shapes.flipped(plate)):
        visible = seen(wall, obstacles=[obstacle], criterion=criterion)
        assert visible.shape == (2,) and not visible.any()


@BOTH
def test_back_and_oblique_faces_hide_physically_but_not_in_the_paper(criterion):
    wall = shapes.plate(4, center=(0, 0, -5))
    back = shapes.flipped(shapes.plate(4, center=(0, 0, -2)))
    scene = shapes.merged(wall, back)
    options = {"criterion": criterion, "resolution": (200, 200)}
    assert not seen(scene, occlusion="physical", **options).any()
    assert seen(scene, occlusion="paper", **options).tolist() == [True, True, False, False]
    oblique = shapes.plate(40, 4, center=(0, 0, -2.5), tilt_deg=60)
    scene = shapes.merged(shapes.plate(1, center=(0, 0, -5)), oblique)
    device = sensor(max_incidence_deg=45)
    assert seen(scene, device=device, occlusion="paper", **options)[:2].all()
    assert not seen(scene, device=device, occlusion="physical", **options)[:2].any()


def test_a_face_without_area_is_never_visible_and_keeps_its_place():
    vertices, faces = shapes.plate(2, center=(0, 0, -3))
    broken = vertices, np.insert(faces, 1, [0, 0, 1], axis=0)
    for options in ({}, {"criterion": "centroid"}, {"semantics": "paper", **PAPER}):
        assert seen(broken, **options).tolist() == [True, False, True]


PAPER = {"criterion": "centroid", "incidence": "axis", "occlusion": "paper"}


def test_the_paper_keeps_a_face_with_one_vertex_in_view_though_its_centre_is_outside():
    # the field ends at x = 2.9 at this depth; one vertex at 2, the centre at 4
    face = shapes.triangle([2, 0, -5], [5, 0, -5], [5, 1, -5])
    assert seen(face, semantics="paper", **PAPER).tolist() == [True]
    assert seen(face, criterion="centroid").tolist() == [False]


def test_the_paper_drops_a_face_with_any_vertex_too_near():
    # from depth 1 to 3, centre at 2.3: by its centre it is in range
    face = shapes.triangle([-0.3, 0, -1], [0.3, 0, -3], [0, 0.9, -3])
    device = sensor(near=2, max_incidence_deg=90)
    turned = (
        shapes.flipped(face) if not seen(face, device=device, criterion="centroid").any() else face
    )
    assert seen(turned, device=device, criterion="centroid").tolist() == [True]
    assert seen(turned, device=device, semantics="paper", **PAPER).tolist() == [False]


@pytest.mark.parametrize(("tilt", "kept"), [(105, True), (115, False)])
def test_the_paper_tolerates_backs_up_to_twenty_degrees_past_edge_on(tilt, kept):
    plate = shapes.plate(0.5, center=(0, 0, -3), tilt_deg=tilt)
    assert seen(plate, semantics="paper", **PAPER).tolist() == [kept] * 2
    assert not seen(plate, criterion="centroid").any()


def test_the_second_look_finds_faces_between_the_pixels_and_no_hidden_ones():
    # 20,000 faces of a plate in 64 x 64 pixels: most show in none; half of it is hidden
    wall = shapes.plate(2, center=(0, 0, -4), cells=(100, 100))
    cover = shapes.plate(2, center=(-1, 0, -3.9))
    device = sensor(hfov_deg=40, vfov_deg=40, resolution=(64, 64))
    visible = seen(wall, device=device, obstacles=[cover], resolution="auto")
    x = shapes.corners(wall).mean(axis=1)[:, 0]
    assert visible[x > 0.05].all() and not visible[x < -0.05].any()
    sparse = seen(wall, device=device, obstacles=[cover], resolution=(64, 64))
    assert sparse.sum() <= 64 * 64 and not asks_about_points(VisibilityOptions(resolution=(64, 64)))


def test_more_pixels_a_face_are_asked_for_by_min_pixels():
    wall = shapes.plate(4, center=(0, 0, -5), cells=(8, 8))
    few, many = (
        seen(wall, resolution=(32, 32), min_pixels=n, device=sensor(hfov_deg=40, vfov_deg=40))
        for n in (1, 30)
    )
    assert few.sum() == 128 and many.sum() == 0


@pytest.mark.parametrize("seed", range(10))
def test_farther_range_or_larger_incidence_or_no_obstacle_never_takes_a_face_away(seed):
    rng = np.random.default_rng(seed)
    body, obstacle = shapes.blob(rng), shapes.blob(rng, radius=0.3)
    obstacle = shapes.moved(obstacle, rng.normal(size=3))
    poses = random_poses(rng, 4)
    options = {"resolution": (120, 120), "criterion": ("pixels", "centroid")[seed % 2]}
    device = sensor(far=2.6, max_incidence_deg=60)
    base = seen(body, poses, device, [obstacle], **options)
    assert base.any()
    for other, obstacles in (
        (sensor(far=3.5, max_incidence_deg=60), [obstacle]),
        (sensor(far=2.6, max_incidence_deg=80), [obstacle]),
        (device, []),
    ):
        assert not (base & ~seen(body, poses, other, obstacles, **options)).any()


@pytest.mark.parametrize("seed", range(5))
def test_permuting_faces_permutes_the_map(seed):
    rng = np.random.default_rng(seed)
    body, poses = shapes.blob(rng), random_poses(rng, 3)
    order = rng.permutation(len(body[1]))
    for criterion in ("pixels", "centroid"):
        base = seen(body, poses, criterion=criterion)
        assert np.array_equal(
            seen(shapes.permuted(body, order), poses, criterion=criterion), base[:, order]
        )


def test_scaling_scene_and_ranges_together_changes_nothing(rng):
    body, poses = shapes.blob(rng), random_poses(rng, 4)
    for scale in (1e-3, 25.4, 1e4):
        larger = (body[0] * scale, body[1])
        moved = poses.copy()
        moved[:, :3, 3] *= scale
        for criterion in ("pixels", "centroid"):
            base = seen(body, poses, sensor(near=1, far=9), criterion=criterion)
            other = seen(larger, moved, sensor(near=scale, far=9 * scale), criterion=criterion)
            assert np.count_nonzero(base != other) <= 2e-3 * base.size


def test_pixels_decide_at_a_stated_resolution_and_points_else():
    device = sensor(resolution=(1280, 720))
    for options in ({}, {"criterion": "centroid"}, {"criterion": "centroid", "resolution": (9, 7)}):
        assert render_resolution(VisibilityOptions(**options), device) is None
    assert render_resolution(VisibilityOptions(resolution="sensor"), device) == (1280, 720)
    assert render_resolution(VisibilityOptions(resolution=(9, 7)), device) == (9, 7)
    # counting pixels means the sensor's own
    assert render_resolution(VisibilityOptions(min_pixels=3), device) == (1280, 720)


def test_a_map_counts_faces_by_hand():
    visible = np.array([[1, 1, 0, 0], [0, 1, 1, 0]], dtype=bool)
    m = VisibilityMap("m", ("A", "B"), visible)
    assert m.counts.tolist() == [1, 2, 1, 0]
    assert (m.n_unique, m.n_total, m.coverage) == (3, 4, 0.75)
    assert [m.share_seen_by(n) for n in (1, 2, 3)] == [0.75, 0.25, 0.0]


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"criterion": "rays"}, "criterion = 'rays' must be 'pixels' or 'centroid'"),
        ({"incidence": "up"}, "incidence = 'up' must be 'ray' or 'axis'"),
        ({"occlusion": "none"}, "occlusion = 'none' must be 'physical' or 'paper'"),
        ({"min_pixels": 0}, "min_pixels = 0 must be at least 1"),
        ({"resolution": "high"}, "resolution = 'high' must be 'auto', 'sensor'"),
        ({"resolution": (0, 5)}, r"resolution = \[0, 5\] must be at least"),
        ({"semantics": "paper"}, "criterion = 'pixels' contradicts semantics = 'paper'"),
    ],
)
def test_options_that_mean_nothing_are_refused(options, message):
    with pytest.raises(ValueError, match=message):
        VisibilityOptions(**options)
