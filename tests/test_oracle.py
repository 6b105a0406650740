"""The ray caster that judges the product is itself held to closed forms and to the textbook."""

import math

import numpy as np
import pytest
from support import oracle, shapes
from support.oracle import Eye, Rules

WIDE = Eye(90, 90)


def looking(position, target, up=(0.0, 1.0, 0.0)):
    """A pose by hand, so that these tests need nothing of the product."""
    back = np.subtract(position, target, dtype=float)
    back /= np.linalg.norm(back)
    right = np.cross(up, back)
    right /= np.linalg.norm(right)
    pose = np.eye(4)
    pose[:3] = np.stack([right, np.cross(back, right), back, position], axis=1)
    return pose


FROM_ORIGIN = looking((0, 0, 0), (0, 0, -1))  # the camera frame is the world


def textbook_hit(origin, direction, corners):
    """Möller and Trumbore 1997 for one ray and one triangle, as printed."""
    v0, v1, v2 = corners
    e1, e2 = v1 - v0, v2 - v0
    p = np.cross(direction, e2)
    det = e1 @ p
    if det == 0:
        return math.inf
    s = origin - v0
    u = s @ p / det
    q = np.cross(s, e1)
    v = direction @ q / det
    t = e2 @ q / det
    return t if u >= 0 and v >= 0 and u + v <= 1 and t > 0 else math.inf


# --- the shapes are what they say


@pytest.mark.parametrize(
    ("shape", "euler"),
    [
        (shapes.cube(2.0, (1, 2, 3)), 2),
        (shapes.icosphere(3), 2),
        (shapes.torus(), 0),
        (shapes.blob(np.random.default_rng(1)), 2),
    ],
    ids=["cube", "icosphere", "torus", "blob"],
)
def test_closed_shapes_are_closed_and_wind_outward(shape, euler):
    vertices, faces = shape
    directed = np.concatenate([faces[:, [0, 1]], faces[:, [1, 2]], faces[:, [2, 0]]])
    walked = {tuple(edge) for edge in directed.tolist()}
    assert len(walked) == len(directed)
    assert all((b, a) in walked for a, b in walked)
    assert len(vertices) - len(directed) // 2 + len(faces) == euler
    a, b, c = np.moveaxis(shapes.corners(shape), 1, 0)
    assert np.sum(a * np.cross(b, c)) / 6 > 0  # signed volume


def test_shapes_have_the_areas_of_their_formulas():
    def area(shape):
        return shapes.normals_and_areas(shape)[1].sum()

    assert area(shapes.cube(3.0)) == pytest.approx(54)
    assert area(shapes.plate(2.0, 3.0, tilt_deg=40, cells=(4, 5))) == pytest.approx(6)
    assert area(shapes.icosphere(5, 2.0)) == pytest.approx(4 * math.pi * 4, rel=2e-3)
    assert area(shapes.torus(1.0, 0.25, 128, 64)) == pytest.approx(math.pi**2, rel=2e-3)
    assert area(shapes.tube(1.0, 3.0, 128)) == pytest.approx(6 * math.pi, rel=1e-3)


def test_plate_tilts_its_normal_from_z_towards_minus_y():
    normals, _ = shapes.normals_and_areas(shapes.plate(tilt_deg=30))
    np.testing.assert_allclose(normals, [[0, -0.5, math.sqrt(0.75)]] * 2, atol=1e-12)


# --- rays


@pytest.mark.parametrize("seed", range(5))
def test_rays_meet_what_the_textbook_says(seed):
    rng = np.random.default_rng(seed)
    corners = shapes.corners(shapes.soup(rng, 60))
    directions = rng.normal(size=(80, 3))
    origin = rng.uniform(-1, 1, size=3)
    t, triangle, second = oracle.nearest_hits(origin, directions, corners)
    all_t = np.array([[textbook_hit(origin, d, c) for c in corners] for d in directions])
    ordered = np.sort(all_t, axis=1)
    np.testing.assert_allclose(t, ordered[:, 0], rtol=1e-9)
    np.testing.assert_allclose(second, ordered[:, 1], rtol=1e-9)
    hit = np.isfinite(t)
    assert 10 < hit.sum() < 80
    np.testing.assert_array_equal(triangle, np.where(hit, all_t.argmin(axis=1), -1))


def test_bundles_lose_no_hit(rng, monkeypatch):
    corners = shapes.corners(shapes.soup(rng, 500, 0.5))
    directions = rng.normal(size=(3000, 3)) * rng.uniform(0.1, 10, size=(3000, 1))
    bundled = oracle.nearest_hits(np.zeros(3), directions, corners)
    monkeypatch.setattr(oracle._Fan, "reached_by", lambda self, _: np.arange(len(self.t_det)))
    plain = oracle.nearest_hits(np.zeros(3), directions, corners)
    for ours, every in zip(bundled, plain, strict=True):
        np.testing.assert_allclose(ours, every, rtol=1e-12)


def test_rays_may_start_at_points_of_their_own(rng):
    corners = shapes.corners(shapes.icosphere(2))
    origins = rng.normal(size=(20, 3)) * 3
    t, triangle, second = oracle.nearest_hits(origins, -origins, corners)
    for r in range(20):
        one = oracle.nearest_hits(origins[r], -origins[r : r + 1], corners)
        assert (t[r], triangle[r], second[r]) == (one[0][0], one[1][0], one[2][0])
    outside = np.linalg.norm(origins, axis=1) > 1
    near = np.linalg.norm(origins[outside] * (1 - t[outside, None]), axis=1)
    np.testing.assert_allclose(near, 1, atol=0.1)  # first the near side ...
    far = np.linalg.norm(origins[outside] * (1 - second[outside, None]), axis=1)
    np.testing.assert_allclose(far, 1, atol=0.1)
    assert np.all(second > t)  # ... then the far one


def test_rays_through_shared_edges_never_slip_through():
    wall = shapes.corners(shapes.plate(2.0, center=(0, 0, -1), cells=(4, 4)))
    grid = np.linspace(-1, 1, 33)[1:-1]
    x, y = np.meshgrid(grid, grid)
    rays = np.stack([x.ravel(), y.ravel(), -np.ones(x.size)], axis=1)
    t, _, second = oracle.nearest_hits(np.zeros(3), rays, wall)
    np.testing.assert_allclose(t, 1, rtol=1e-12)
    assert np.isfinite(second).any()  # some of them met two faces at once


def test_triangles_without_area_are_never_met():
    flat = np.array([[[-1, 0, -1], [0, 0, -1], [1, 0, -1]], [[0, 0, -2]] * 3], dtype=float)
    t, triangle, _ = oracle.nearest_hits(np.zeros(3), np.array([[0, 0, -1.0]]), flat)
    assert t[0] == math.inf
    assert triangle[0] == -1


# --- pictures


def test_picture_has_its_first_row_on_top_and_depth_along_the_axis():
    top = shapes.plate(1.0, center=(0, 0.5, -1))
    right = shapes.plate(1.0, center=(0.5, -0.5, -2))
    image = oracle.id_image(
        FROM_ORIGIN, (0.5, 0.5), (4, 4), shapes.corners(shapes.merged(top, right))
    )
    #  the plate at 1 covers the upper half; the one at 2 spans x, -y in 0 .. 1/2 of the picture
    seen = image.ids > 0
    np.testing.assert_array_equal(seen, [[1, 1, 1, 1], [1, 1, 1, 1], [0, 0, 1, 1], [0, 0, 1, 1]])
    np.testing.assert_allclose(image.depth[:2], 1)
    np.testing.assert_allclose(image.depth[2:, 2:], 2)
    assert np.all(image.ids[2:, 2:] >= 3)


def test_picture_tells_how_far_the_second_hit_lies_and_leaves_obstacles_without_id():
    near, far = shapes.plate(0.5, center=(0, 0, -1)), shapes.plate(9.0, center=(0, 0, -3))
    triangles = shapes.corners(shapes.merged(far, near))
    image = oracle.id_image(FROM_ORIGIN, (0.5, 0.5), (8, 8), triangles, n_faces=2)
    hidden = np.zeros((8, 8), dtype=bool)
    hidden[2:6, 2:6] = True
    np.testing.assert_array_equal(image.ids == 0, hidden)
    np.testing.assert_allclose(image.depth[hidden], 1)
    # two faces of a plate are met at once along its diagonal
    expected = np.where(hidden, 2, np.inf)
    expected[np.eye(8, dtype=bool)[::-1]] = 0
    np.testing.assert_allclose(image.gap, expected)


def test_picture_ends_at_clip_far_and_begins_at_clip_near():
    triangles = shapes.corners(
        shapes.merged(shapes.plate(9.0, center=(0, 0, -1)), shapes.plate(9.0, center=(0, 0, -3)))
    )
    kept = oracle.id_image(FROM_ORIGIN, (0.5, 0.5), (2, 2), triangles, clip_near=1.5)
    np.testing.assert_allclose(kept.depth, 3)
    none = oracle.id_image(FROM_ORIGIN, (0.5, 0.5), (2, 2), triangles, clip_near=1.5, clip_far=2.5)
    assert not none.ids.any()
    assert np.all(np.isinf(none.depth))


def test_disagreement_excuses_an_edge_moved_by_less_than_stated_and_nothing_more():
    def picture(offset):
        plate = shapes.plate(1.0, center=(offset, 0, -1))
        wall = shapes.plate(9.0, center=(0, 0, -3))
        corners = shapes.corners(shapes.merged(plate, wall))
        return oracle.id_image(FROM_ORIGIN, (1.0, 1.0), (40, 40), corners)

    pixel = 2 / 40
    truth = picture(0.49 * pixel)  # its edges pass by 0.01 pixels from pixel centres
    ids = picture(0.51 * pixel).ids
    moved = ids != truth.ids
    assert moved.sum() >= 40  # a column of twenty pixels on either side
    excused, wrong = oracle.disagreement(truth, ids, edge_px=1 / 32)
    np.testing.assert_array_equal(excused, moved)
    assert not wrong.any()
    excused, wrong = oracle.disagreement(truth, ids, edge_px=1 / 200)
    np.testing.assert_array_equal(wrong, moved)
    assert not excused.any()
    excused, wrong = oracle.disagreement(truth, np.where(truth.ids <= 2, 3, truth.ids))
    assert wrong.sum() >= 390  # the plate claimed to be a wall: no excuse inside of it


def test_disagreement_never_excuses_a_gap_between_two_faces_that_share_an_edge():
    plate, wall = shapes.plate(3.0, center=(0, 0, -1)), shapes.plate(9.0, center=(0, 0, -3))
    truth = oracle.id_image(
        FROM_ORIGIN, (1.0, 1.0), (10, 10), shapes.corners(shapes.merged(plate, wall))
    )
    on_the_edge = np.eye(10, dtype=bool)[::-1]
    for claim in (0, 3, 4):  # nothing, or the wall behind
        excused, wrong = oracle.disagreement(truth, np.where(on_the_edge, claim, truth.ids))
        np.testing.assert_array_equal(wrong, on_the_edge)
        assert not excused.any()
    # which of the two it is may differ
    excused, wrong = oracle.disagreement(truth, np.where(on_the_edge, 3 - truth.ids, truth.ids))
    np.testing.assert_array_equal(excused, on_the_edge)


def test_disagreement_excuses_a_swap_of_two_faces_at_one_depth():
    plates = [shapes.plate(3.0, center=(0, 0, z)) for z in (-1, -1 - 1e-6)]
    truth = oracle.id_image(
        FROM_ORIGIN, (1.0, 1.0), (10, 10), shapes.corners(shapes.merged(*plates))
    )
    swapped = truth.ids + 2
    excused, wrong = oracle.disagreement(truth, swapped, depth_slack=1e-5)
    assert excused.all()
    excused, wrong = oracle.disagreement(truth, swapped, depth_slack=1e-7)
    assert wrong.sum() == 100


# --- visibility maps: closed forms


@pytest.mark.parametrize("distance", [1.5, 3.0])
def test_visible_part_of_a_sphere_is_half_of_one_minus_r_over_d(distance, rng):
    directions = rng.normal(size=(4, 3))
    directions /= np.linalg.norm(directions, axis=1, keepdims=True)
    errors = []
    for subdivisions in (1, 3):
        sphere = shapes.icosphere(subdivisions)
        _, area = shapes.normals_and_areas(sphere)
        seen = [
            oracle.point_visibility(
                looking(distance * d, (0, 0, 0)), Eye(150, 150), shapes.corners(sphere), n=4
            )
            for d in directions
        ]
        errors.append(abs(np.mean(seen, axis=0) @ area / area.sum() - (1 - 1 / distance) / 2))
    assert errors[1] < 0.01
    assert errors[1] < errors[0] / 2


def test_cube_shows_three_sides_from_its_diagonal():
    corners = shapes.corners(shapes.cube())
    pose = looking((3, 3, 3), (0, 0, 0))
    three_sides = [False, True] * 3
    expected = np.repeat(three_sides, 2)
    np.testing.assert_array_equal(oracle.centroid_visible(pose, WIDE, corners), expected)
    np.testing.assert_array_equal(oracle.point_visibility(pose, WIDE, corners) > 0, expected)
    counts = oracle.pixel_visible(pose, WIDE, (64, 64), corners)
    np.testing.assert_array_equal(counts > 0, expected)


def test_near_plate_is_not_counted_but_still_hides_the_wall():
    a, z1, z2 = 0.2, 1.0, 3.0
    plate, wall = shapes.plate(2 * a, center=(0, 0, -z1)), shapes.plate(4.0, center=(0, 0, -z2))
    model = shapes.merged(plate, wall)
    n = 64
    share = oracle.point_visibility(
        FROM_ORIGIN, Eye(90, 90, min_distance=1.5), shapes.corners(model), n=n
    )
    assert np.all(share[:2] == 0)
    _, area = shapes.normals_and_areas(wall)
    shadow = (2 * a * z2 / z1) ** 2
    assert (1 - share[2:]) @ area == pytest.approx(shadow, rel=0.03)
    # without the limit it is counted
    assert oracle.centroid_visible(FROM_ORIGIN, WIDE, shapes.corners(model))[:2].all()


def test_wall_shows_a_rectangle_of_twice_z_tan_half_angle():
    eye, z = Eye(66.4, 39.5), 200.0
    wall = shapes.corners(shapes.plate(400.0, center=(0, 0, -z), cells=(80, 80)))
    centroids = wall.mean(axis=1)
    expected = (np.abs(centroids[:, 0]) <= z * math.tan(math.radians(33.2))) & (
        np.abs(centroids[:, 1]) <= z * math.tan(math.radians(19.75))
    )
    np.testing.assert_array_equal(oracle.centroid_visible(FROM_ORIGIN, eye, wall), expected)
    assert expected.sum() * 25 / 2 == pytest.approx(
        4 * z * z * math.tan(math.radians(33.2)) * math.tan(math.radians(19.75)), rel=0.05
    )


@pytest.mark.parametrize(("tilt", "seen"), [(0, True), (69.9, True), (70.1, False), (89, False)])
@pytest.mark.parametrize("sign", [-1, 1])
def test_tilted_plate_counts_up_to_the_incidence_limit(tilt, seen, sign):
    eye = Eye(60, 60, max_incidence_deg=70)
    # small, so that all of its rays have nearly the same direction
    plate = shapes.corners(shapes.plate(1e-3, center=(0, 0, -2), tilt_deg=sign * tilt))
    assert np.all(oracle.centroid_visible(FROM_ORIGIN, eye, plate) == seen)
    assert np.all((oracle.point_visibility(FROM_ORIGIN, eye, plate) > 0) == seen)


def test_incidence_is_measured_to_the_ray_or_to_the_axis():
    # 40 degrees off the axis, tilted by 60 away from it: 60 to the axis, 20 to the ray
    y = -2 * math.tan(math.radians(40))
    plate = shapes.corners(shapes.plate(1e-3, center=(0, y, -2), tilt_deg=-60))
    for limit, by_ray, by_axis in ((15, False, False), (25, True, False), (65, True, True)):
        eye = Eye(90, 90, max_incidence_deg=limit)
        seen = oracle.centroid_visible(FROM_ORIGIN, eye, plate)
        assert np.all(seen == by_ray)
        seen = oracle.centroid_visible(FROM_ORIGIN, eye, plate, rules=Rules(incidence="axis"))
        assert np.all(seen == by_axis)


def test_obstacle_hides_from_either_side_and_is_never_counted():
    wall = shapes.corners(shapes.plate(4.0, center=(0, 0, -3), cells=(8, 8)))
    obstacle = shapes.plate(0.4, center=(0, 0, -1))
    free = oracle.centroid_visible(FROM_ORIGIN, WIDE, wall)
    assert free.all()
    inner = np.abs(wall.mean(axis=1)[:, :2]).max(axis=1) < 0.6
    for one_side in (obstacle, shapes.flipped(obstacle)):
        hidden = oracle.centroid_visible(FROM_ORIGIN, WIDE, wall, shapes.corners(one_side))
        np.testing.assert_array_equal(hidden, ~inner)
        pixels = oracle.pixel_visible(FROM_ORIGIN, WIDE, (40, 40), wall, shapes.corners(one_side))
        assert pixels.shape == (len(wall),)
        free_pixels = oracle.pixel_visible(FROM_ORIGIN, WIDE, (40, 40), wall)
        assert free_pixels.sum() - pixels.sum() == (40 * 0.2) ** 2


SHOWS_ITS_BACK = shapes.flipped(shapes.plate(1.0, center=(0, 0, -1)))
TOO_OBLIQUE = shapes.plate(1.0, center=(0, 0, -1), tilt_deg=80)  # a band, 0.17 high


@pytest.mark.parametrize("screen", [SHOWS_ITS_BACK, TOO_OBLIQUE], ids=["back", "oblique"])
@pytest.mark.parametrize("incidence", ["ray", "axis"])
def test_refused_faces_hide_in_the_physical_reading_and_not_in_the_papers(screen, incidence):
    wall = shapes.plate(0.5, center=(0, 0, -3))
    model = shapes.corners(shapes.merged(wall, screen))
    eye = Eye(60, 60, max_incidence_deg=70)
    alone = oracle.pixel_visible(FROM_ORIGIN, eye, (40, 40), shapes.corners(wall))
    for occlusion, seen in (("physical", False), ("paper", True)):
        rules = Rules(occlusion=occlusion, incidence=incidence)
        got = oracle.centroid_visible(FROM_ORIGIN, eye, model, rules=rules)
        np.testing.assert_array_equal(got, [seen, seen, False, False])
        pixels = oracle.pixel_visible(FROM_ORIGIN, eye, (40, 40), model, rules=rules)
        if seen:
            np.testing.assert_array_equal(pixels, [*alone, 0, 0])
        else:
            assert pixels.sum() < alone.sum()
            assert not pixels[2:].any()


def test_too_near_faces_hide_in_the_papers_reading_too():
    model = shapes.merged(shapes.plate(0.5, center=(0, 0, -3)), shapes.plate(1, center=(0, 0, -1)))
    eye = Eye(60, 60, min_distance=2)
    for rules in (Rules(), Rules(occlusion="paper"), Rules(semantics="paper")):
        seen = oracle.centroid_visible(FROM_ORIGIN, eye, shapes.corners(model), rules=rules)
        assert not seen.any()


def test_papers_semantics_keeps_a_face_with_any_vertex_in_the_field():
    # centroid outside, one corner inside
    face = shapes.corners(shapes.triangle((0.9, 0, -1), (3, -0.5, -1), (3, 0.5, -1)))
    assert not oracle.centroid_visible(FROM_ORIGIN, WIDE, face)[0]
    assert oracle.centroid_visible(FROM_ORIGIN, WIDE, face, rules=Rules(semantics="paper"))[0]
    # and drops one with no vertex inside whose middle is in full view
    big = shapes.corners(shapes.triangle((-9, -9, -1), (9, -9, -1), (0, 18, -1)))
    assert oracle.centroid_visible(FROM_ORIGIN, WIDE, big)[0]
    assert not oracle.centroid_visible(FROM_ORIGIN, WIDE, big, rules=Rules(semantics="paper"))[0]


def test_papers_semantics_drops_a_face_with_any_vertex_nearer_than_min_distance():
    face = shapes.corners(shapes.triangle((0, -0.1, -0.9), (0.1, 0.1, -1.5), (-0.1, 0.1, -1.5)))
    face = face[:, ::-1] if _faces_away(face) else face
    eye = Eye(90, 90, min_distance=1)
    assert oracle.centroid_visible(FROM_ORIGIN, eye, face)[0]
    assert not oracle.centroid_visible(FROM_ORIGIN, eye, face, rules=Rules(semantics="paper"))[0]


def _faces_away(corners):
    a, b, c = corners[0]
    return np.cross(b - a, c - a) @ (a + b + c) > 0


def test_max_distance_is_a_plane_not_a_sphere():
    y = 2.0  # 45 degrees off the axis at depth 2: distance 2.83 along the ray
    plate = shapes.corners(shapes.plate(1e-3, center=(0, -y, -2)))
    assert oracle.centroid_visible(FROM_ORIGIN, Eye(100, 100, 0, 2.01), plate).all()
    assert not oracle.centroid_visible(FROM_ORIGIN, Eye(100, 100, 0, 1.99), plate).any()


def test_criteria_agree_on_a_body_of_small_faces(rng):
    body = shapes.corners(shapes.blob(rng, 3))
    pose = looking((2, 1, 2), (0, 0, 0))
    eye = Eye(60, 60, max_incidence_deg=70)
    centroid = oracle.centroid_visible(pose, eye, body)
    share = oracle.point_visibility(pose, eye, body)
    pixels = oracle.pixel_visible(pose, eye, (600, 600), body)
    assert 200 < centroid.sum() < 640
    assert np.mean((share > 0.5) == centroid) > 0.99
    assert np.all(pixels[share == 1] > 0)
    assert np.all(pixels[share == 0] <= 2)


def test_part_centroids_are_those_of_congruent_parts():
    weights = oracle.part_centroids(8)
    assert weights.shape == (64, 3)
    np.testing.assert_allclose(weights.sum(axis=1), 1)
    np.testing.assert_allclose(weights.mean(axis=0), 1 / 3)
    assert weights.min() == pytest.approx(1 / 24)
    assert len(np.unique(np.round(weights, 9), axis=0)) == 64


def test_eye_reads_a_sensor_in_degrees():
    from glvis.study.catalogue_sensors import catalogue

    eye = Eye.of(catalogue("mm")["d415-buonamici"])
    assert (eye.hfov_deg, eye.vfov_deg) == pytest.approx((66.4, 39.5))
    assert (eye.min_distance, eye.max_distance) == (160, 350)
    assert eye.max_incidence_deg == pytest.approx(70)
