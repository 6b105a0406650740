"""Pictures by closed form: which pixel has which colour, what lies in front, which way is up."""

import numpy as np
import pytest
from support.shapes import cube, flipped, icosphere, merged, plate, triangle

from glvis.errors import MachineError
from glvis.pictures.coloring import BACK_COLOR
from glvis.pictures.framing import Eye, View, fitted_eye
from glvis.pictures.normals import corner_normals
from glvis.pictures.shading import Canvas, Lines, Solid
from glvis.problem.camera import look_along, projection_matrix
from glvis.visibility.context import gl_context

UP = (0, 0, 1)
RED, BLUE, WHITE = np.array([200, 30, 20]), np.array([10, 60, 220]), np.array([255, 255, 255])


def solid(shape, color, opacity=255, **options) -> Solid:
    made = Solid(*shape, origin=(0, 0, 0), **options)
    made.paint(np.tile([*color, opacity], (len(shape[1]), 1)))
    return made


def looking_down(size, half_height=None) -> Eye:
    """A parallel eye over the xy plane: one unit is one pixel, the origin in the middle."""
    height = size[1] if half_height is None else 2 * half_height
    half = np.array([height * size[0] / size[1], height]) / 2
    pose = np.eye(4)
    pose[2, 3] = 50.0
    clip = np.diag([1 / half[0], 1 / half[1], -2 / 100, 1.0])
    clip[2, 3] = -1.0
    return Eye(pose, clip, np.zeros(3))


def flat(size, solids, eye=None, **options):
    """A picture without light and shade."""
    with Canvas(size) as canvas:
        return canvas.image(
            eye or looking_down(size), solids, origin=(0, 0, 0), up=UP, relief=0.0, **options
        )


def test_one_looks_through_the_backs_of_a_room():
    size, floor, ceiling = (8, 8), plate(8.0), flipped(plate(8.0, center=(0, 0, 3)))
    closed, opened = (
        flat(size, [solid(merged(floor, ceiling), RED, has_backs=backs)]) for backs in (True, False)
    )
    assert np.abs(closed - BACK_COLOR[:3]).max() <= 1
    assert np.abs(opened - RED).max() <= 1


def test_pixels_inside_a_triangle_have_its_colour_and_no_others():
    size = (20, 16)
    a, b, c = np.array([[-8, -6, 0], [9, -5, 0], [-2, 7, 0]], dtype=float)
    picture = flat(size, [solid(triangle(a, b, c), RED)])
    x, y = np.meshgrid(np.arange(20) + 0.5 - 10, 8 - (np.arange(16) + 0.5))
    # distance inside each edge, pixels
    inside = np.full(x.shape, np.inf)
    for p, q in ((a, b), (b, c), (c, a)):
        along = (q - p)[:2] / np.linalg.norm(q - p)
        inside = np.minimum(inside, along[0] * (y - p[1]) - along[1] * (x - p[0]))
    assert np.abs(picture[inside > 0.75] - RED).max() <= 1
    assert (picture[inside < -0.75] == WHITE).all()
    assert np.count_nonzero(inside > 0.75) > 60


def test_edge_through_the_middle_of_a_pixel_is_half_blended():
    square = triangle([-20, -20, 0], [20, -20, 0], [-20, 20, 0])
    square = (square[0] * [1, 1, 1] + [0, 0, 0], square[1])
    wall = (
        np.array([[-9, -9, 0], [0.5, -9, 0], [0.5, 9, 0], [-9, 9, 0]], float),
        np.array([[0, 1, 2], [0, 2, 3]]),
    )
    picture = flat((8, 8), [solid(wall, RED)])
    expected = (RED + WHITE) / 2
    assert np.abs(picture[4, 4].astype(float) - expected).max() <= 2
    assert np.abs(picture[4, 3].astype(int) - RED).max() <= 1
    assert (picture[4, 5] == WHITE).all()


def test_row_0_is_the_top_and_x_runs_to_the_right():
    picture = flat((10, 10), [solid(plate(2, 2, center=(3, 3, 0)), RED)])
    is_red = (picture != 255).any(axis=2)
    rows, columns = np.nonzero(is_red)
    assert (rows.min(), rows.max()) == (1, 2)
    assert (columns.min(), columns.max()) == (7, 8)


def test_triangle_up_right_in_the_world_is_up_right_in_the_front_view():
    shape = merged(cube(10.0), cube(1.0, center=(3, -6, 3)))
    eye = fitted_eye(UP, View("front", 0, 0), shape[0], 1.0)
    colors = np.repeat([[*BLUE, 255], [*RED, 255]], 12, axis=0)
    made = Solid(*shape, origin=(0, 0, 0))
    made.paint(colors)
    picture = flat((60, 60), [made], eye)
    rows, columns = np.nonzero(np.abs(picture.astype(int) - RED).max(axis=2) < 3)
    assert rows.mean() < 25
    assert columns.mean() > 35


@pytest.mark.parametrize("order", [(0, 1), (1, 0)])
def test_nearer_face_is_seen_whatever_is_drawn_first(order):
    near, far = solid(plate(4, 4, center=(0, 0, 5)), RED), solid(plate(8, 8), BLUE)
    picture = flat((10, 10), [(near, far)[k] for k in order])
    assert np.abs(picture[5, 5].astype(int) - RED).max() <= 1
    assert np.abs(picture[2, 2].astype(int) - BLUE).max() <= 1


def test_back_of_a_face_has_the_colour_that_the_legend_names():
    vertices, faces = plate(8, 8)
    picture = flat((10, 10), [solid((vertices, faces[:, ::-1]), RED)])
    assert np.abs(picture[5, 5].astype(int) - BACK_COLOR).max() <= 1


def test_striped_faces_show_their_colour_and_a_darker_one():
    picture = flat((60, 60), [solid(plate(50, 50), RED, opacity=128)])
    inner = picture[10:50, 10:50].reshape(-1, 3).astype(int)
    is_plain = np.abs(inner - RED).max(axis=1) <= 1
    is_dark = inner[:, 0] < 0.75 * RED[0]
    assert 0.4 < is_plain.mean() < 0.8
    assert 0.15 < is_dark.mean() < 0.5


@pytest.mark.parametrize("is_parallel", [True, False])
def test_oblique_plane_is_lit_evenly_and_darkened_nowhere(is_parallel):
    wall = plate(30, 30)
    eye = fitted_eye(UP, View("any", 30, 35, is_parallel), wall[0], 1.0)
    with Canvas((80, 80)) as canvas:
        picture = canvas.image(eye, [solid(wall, RED)], origin=(0, 0, 0), up=UP)
    inner = picture[36:44, 36:44].reshape(-1, 3).astype(int)
    assert (inner != 255).any()
    assert np.ptp(inner, axis=0).max() <= (1 if is_parallel else 4)


def test_light_comes_from_above_left():
    ball = icosphere(4, 8.0)
    with Canvas((40, 40)) as canvas:
        made = solid(ball, (180, 180, 180))
        eye = fitted_eye(UP, View("front", 0, 0), ball[0], 1.0)
        picture = canvas.image(eye, [made], origin=(0, 0, 0), up=UP)[..., 0].astype(int)
    assert picture[12, 12] > picture[28, 28] + 30


def test_valley_is_darker_than_its_slopes():
    slope = plate(20, 20, center=(0, -10, 0))
    valley = merged(
        (slope[0] - [0, 0, 1] * slope[0][:, 1:2], slope[1]),
        (slope[0] * [1, -1, 1] - [0, 0, 1] * slope[0][:, 1:2], slope[1][:, ::-1]),
    )
    with Canvas((200, 200)) as canvas:
        made = solid(valley, (180, 180, 180))
        eye = looking_down((200, 200), 15)
        picture = canvas.image(eye, [made], origin=(0, 0, 0), up=UP).astype(int)
    assert picture[99, 100, 0] < 0.7 * picture[60, 100, 0]
    assert picture[100, 100, 0] < 0.7 * picture[140, 100, 0]


@pytest.mark.parametrize("distance", [0.5, 3.0, 9.0])
def test_depth_of_a_wall_is_its_distance_along_the_axis(distance):
    pose = look_along([0, 0, 0], [0, 1, 0])
    eye = Eye(pose, projection_matrix([1.0, 1.0], 0.01, 10.0), np.array([0, 1.0, 0]))
    wall = plate(100, 100, tilt_deg=90)
    with Canvas((16, 16)) as canvas:
        made = Solid(wall[0] + [0, distance, 0], wall[1], origin=(0, 0, 0))
        made.paint(np.zeros((2, 3)))
        depth = canvas.depth(eye, [made], origin=(0, 0, 0))
    assert depth.shape == (16 * canvas.samples, 16 * canvas.samples)
    np.testing.assert_allclose(depth, distance, rtol=1e-3)


def test_depth_is_infinite_where_nothing_is_and_right_in_parallel_projection():
    with Canvas((10, 10)) as canvas:
        made = solid(plate(4, 4, center=(0, 0, 7)), RED)
        depth = canvas.depth(looking_down((10, 10)), [made], origin=(0, 0, 0))
    assert np.isinf(depth[0, 0])
    np.testing.assert_allclose(depth[10, 10], 43, rtol=1e-5)  # the eye is 50 above


def test_line_has_its_width_and_colour_and_is_faint_behind_a_face():
    line = Lines([[[-9, 0, 0], [9, 0, 0]]], [[*BLUE, 255]], [4.0])
    hides = solid(plate(8, 18, center=(4, 0, 3)), WHITE)
    picture = flat((20, 20), [hides], lines=line).astype(int)
    rows = np.flatnonzero((picture[:, 4] != 255).any(axis=1))
    assert (rows.min(), rows.max()) == (8, 11)
    assert np.abs(picture[9:11, 4] - BLUE).max() <= 2
    hidden = picture[10, 14]
    assert 255 - hidden[0] < 0.4 * (255 - BLUE[0])
    assert hidden[0] < 250


def test_line_that_passes_the_eye_is_cut_and_not_turned_round():
    pose = look_along([0, 0, 0], [0, 1, 0])
    eye = Eye(pose, projection_matrix([1.0, 1.0], 0.1, 10.0), np.array([0, 1.0, 0]))
    line = Lines([[[0.5, 5, 0], [0.5, -5, 0]]], [[*BLUE, 255]], [3.0])
    picture = flat((40, 40), [], eye, lines=line)
    _, columns = np.nonzero((picture != 255).any(axis=2))
    assert columns.min() >= 20  # only to the right of the axis
    assert columns.max() == 39


def test_pixel_widens_lines():
    line = Lines([[[-9, 0, 0], [9, 0, 0]]], [[*BLUE, 255]], [2.0])
    thin, thick = (flat((20, 20), [], lines=line, pixel=p) for p in (1.0, 3.0))
    assert (thin[:, 10] != 255).any(axis=1).sum() == 2
    assert (thick[:, 10] != 255).any(axis=1).sum() == 6


def test_far_off_frame_is_drawn_as_exactly_as_a_near_one():
    far = np.array([4e6, -7e6, 1e6])
    near_ball, eyes = icosphere(2, 3.0), []
    pictures = []
    for origin in (np.zeros(3), far):
        shape = (near_ball[0] + origin, near_ball[1])
        eye = fitted_eye(UP, View("any", 20, 30), shape[0], 1.0)
        made = Solid(*shape, origin=origin)
        made.paint(np.tile(RED, (len(shape[1]), 1)))
        with Canvas((40, 40)) as canvas:
            pictures.append(canvas.image(eye, [made], origin=origin, up=UP).astype(int))
        eyes.append(eye)
    assert np.abs(pictures[0] - pictures[1]).max() <= 3


def test_corner_normals_are_smooth_on_a_ball_and_sharp_on_a_cube():
    vertices, faces = icosphere(3)
    np.testing.assert_allclose(
        np.sum(corner_normals(vertices, faces) * vertices[faces], axis=2), 1, atol=2e-3
    )
    box = cube()
    normals = corner_normals(*box)
    expected = np.repeat(np.vstack([-np.eye(3), np.eye(3)])[[0, 3, 1, 4, 2, 5]], 2, axis=0)
    np.testing.assert_allclose(normals, np.repeat(expected[:, None], 3, axis=1), atol=1e-12)


def filleted_block():
    """A flat top of large triangles, a quarter round of small ones, and a flat side."""
    angles = np.radians(np.linspace(0, 90, 7))
    arc = [(np.sin(a), np.cos(a)) for a in angles]
    # with narrow strips beside the round, as meshers make them
    profile = [(-20, 1), (-0.03, 1), *arc, (1, -0.03), (1, -20)]  # x, z
    y = np.linspace(0, 30, 12)
    vertices = np.array([(x, v, z) for x, z in profile for v in y])
    n, m = len(profile), len(y)
    at = np.arange(n * m).reshape(n, m)
    a, b, c, d = at[:-1, :-1], at[1:, :-1], at[1:, 1:], at[:-1, 1:]
    quads = np.stack([a, b, c, d], axis=2).reshape(-1, 4)
    faces = np.concatenate([quads[:, [0, 1, 2]], quads[:, [0, 2, 3]]])
    return vertices, faces


def test_flat_sides_beside_a_fillet_are_even():
    vertices, faces = filleted_block()
    normals = corner_normals(vertices, faces)
    own = np.cross(
        vertices[faces[:, 1]] - vertices[faces[:, 0]], vertices[faces[:, 2]] - vertices[faces[:, 0]]
    )
    own /= np.linalg.norm(own, axis=1, keepdims=True)
    is_flat = (np.abs(own) > 0.9999).any(axis=1)
    assert 0 < is_flat.sum() < len(faces)
    cosine = np.einsum("fck,fk->fc", normals, own)
    lean = np.degrees(np.arccos(np.clip(cosine, -1, 1)))
    assert lean[is_flat].max() < 2.0  # no streaks: even is what is flat
    assert lean[~is_flat].max() > 4.0  # while the round is smooth


def test_normals_of_many_faces_at_a_sharp_vertex_are_those_of_few_at_a_time(monkeypatch):
    vertices, faces = merged(cube(), icosphere(2))
    whole = corner_normals(vertices, faces)
    monkeypatch.setattr("glvis.pictures.normals._PAIRS", 5)
    np.testing.assert_array_equal(corner_normals(vertices, faces), whole)


@pytest.mark.parametrize("elevation", [30, -30])
def test_sheet_modelled_from_both_sides_shows_its_front_wherever_one_stands(elevation):
    red, blue = plate(20, 20, cells=(7, 7)), plate(20, 20, cells=(7, 7))
    both = merged(red, (blue[0], blue[1][:, ::-1]))
    made = Solid(*both, origin=(0, 0, 0))
    made.paint(np.repeat([RED, BLUE], len(red[1]), axis=0))
    eye = fitted_eye(UP, View("any", 20, elevation, is_parallel=False), both[0], 1.0)
    picture = flat((90, 90), [made], eye)
    inner = picture[40:50, 30:60].reshape(-1, 3).astype(int)
    assert (np.abs(inner - (RED if elevation > 0 else BLUE)).max(axis=1) <= 2).all()


def test_table_over_a_floor_smears_nothing_on_it():
    floor, table = plate(60, 60), plate(10, 10, center=(0, 0, 2.5))
    with Canvas((200, 200)) as canvas:
        made = solid(merged(floor, table), (180, 180, 180))
        eye = looking_down((200, 200), 20)
        picture = canvas.image(eye, [made], origin=(0, 0, 0), up=UP)[..., 0].astype(int)
    far, beside = picture[100, 190], picture[100, 126:132]  # the table ends at 125
    assert (np.abs(beside - far) <= 3).all()


def test_canvas_says_whether_it_shows_a_back():
    shown = []
    with Canvas((40, 40)) as canvas:
        for shape in (plate(20, 20), (plate(20, 20)[0], plate(20, 20)[1][:, ::-1])):
            made = solid(shape, RED)
            for cut_away in (False, True):
                canvas.image(
                    looking_down((40, 40)), [made], origin=(0, 0, 0), up=UP, cut_away=cut_away
                )
                shown.append(canvas.shows_backs)
    assert shown == [False, False, True, False]


def test_face_without_area_is_harmless():
    vertices = np.array([[0, 0, 0], [1, 0, 0], [2, 0, 0], [0, 1, 0]], dtype=float)
    normals = corner_normals(vertices, [[0, 1, 2], [0, 1, 3]])
    assert np.isfinite(normals).all()


def test_wrong_number_of_colours_is_refused():
    made = Solid(*cube(), origin=(0, 0, 0))
    with pytest.raises(ValueError, match=r"12 faces need as many colours, got \(3, 4\)"):
        made.paint(np.zeros((3, 4)))


def test_picture_beyond_the_drivers_limit_is_refused():
    limit = gl_context().info["GL_MAX_TEXTURE_SIZE"]
    with pytest.raises(MachineError, match=f"a picture of {limit + 1} x 8 pixels exceeds"):
        Canvas((limit + 1, 8))


def test_large_picture_is_drawn_with_fewer_samples_rather_than_not_at_all():
    limit = gl_context().info["GL_MAX_TEXTURE_SIZE"]
    with Canvas((limit // 2 + 1, 4)) as canvas:
        assert canvas.samples == 1
