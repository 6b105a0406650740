"""Small pictures compared whole: nearest wins, IDs are exact, nothing is left over."""

from types import SimpleNamespace

import numpy as np
import pytest
from support import shapes
from support.one_sensor import DOWN, looking, random_poses, sensor

from glvis.errors import MachineError
from glvis.problem.camera import look_along
from glvis.problem.lens import Pinhole
from glvis.visibility import renderer as r
from glvis.visibility import selftest, surface
from glvis.visibility.context import gl_info
from glvis.visibility.filters import Limits
from glvis.visibility.views import Views, WindowViews


def views(poses=DOWN, *, tan=1.0, near=0.1, far=100.0, min_distance=0.0, max_distance=50.0):
    poses = np.asarray(poses).reshape(-1, 4, 4)
    n = len(poses)
    limits = Limits(Pinhole.from_tangents(tan, tan), min_distance, max_distance)
    reach, clip_near, clip_far = (np.full(n, z) for z in (far, near, far))
    windows = WindowViews(poses, np.array([tan, tan]), reach, clip_near, clip_far, reach)
    return Views(poses, sensor(), limits, windows)


def ids(shape, poses=DOWN, size=(4, 4), *, tiles=1, refused_hide=True, **view):
    with looking(shape) as made, r.Renderer(size, tiles) as renderer:
        these = views(poses, **view)
        everything = np.ones((len(these), len(made.surface.clusters)), dtype=bool)
        selection = r.Selection(made.surface, everything)
        images = [
            np.array(batch)
            for _, batch in renderer.id_images(
                these, [selection], origin=np.zeros(3), refused_hide=refused_hide
            )
        ]
    return np.concatenate(images)


def test_the_upper_left_triangle_is_the_upper_left_pixels():
    # a wall that fills the picture, parted by the line y = x + 0.1
    vertices = np.array([[-10, -9.8, -2], [10, -9.8, -2], [10, 10.2, -2], [-10, 10.2, -2]])
    image = ids((vertices, [[0, 1, 2], [0, 2, 3]]))[0]
    assert image.tolist() == [[2, 2, 2, 1], [2, 2, 1, 1], [2, 1, 1, 1], [1, 1, 1, 1]]


@pytest.mark.parametrize("order", [(0, 1), (1, 0)])
def test_the_nearer_of_two_plates_wins_in_either_order_of_faces(order):
    near, far = (
        shapes.triangle([-1, -1, -2], [9, -1, -2], [-1, 9, -2]),
        shapes.plate(40, center=(0, 0, -5)),
    )
    both = shapes.merged(*((near, far)[k] for k in order))
    image = ids(both)[0]
    nearest = 1 + (0 if order[0] == 0 else 2)
    assert np.all(image[1:3, 1:3] == nearest) and image[3, 0] != nearest


def test_an_id_beyond_two_to_the_24_and_31_is_exact():
    for face_id in (2**24 + 1, 2**31 + 2**24 + 3, 2**32 - 1):
        vertices = np.zeros(3, dtype=surface.VERTEX)
        vertices["position"] = [[-9, -9, -2], [9, -9, -2], [0, 9, -2]]
        vertices["face_id"][2], vertices["normal"][2] = face_id, (0, 0, 1)
        layout = surface.Layout(vertices, np.array([[0, 1, 2]], dtype=np.uint32))

        class _One:
            """A surface of the one triangle."""

            def draw(self, program, mask, layout=layout):
                layout.draw(program, mask)

        selection = r.Selection(_One(), np.ones((1, 1), dtype=bool))
        with r.Renderer((2, 2)) as renderer:
            for _, images in renderer.id_images(views(), [selection], origin=np.zeros(3)):
                assert images[0].tolist() == [[face_id] * 2] * 2
        layout.release()


def test_a_second_picture_holds_nothing_of_the_first():
    wall = shapes.plate(40, center=(0, 0, -5))
    away = look_along([0, 0, 0], [0, 0, 1], up=(0, 1, 0))
    images = ids(wall, np.stack([DOWN, away, DOWN]))
    assert (images[0] > 0).all() and (images[1] == 0).all() and (images[2] > 0).all()


@pytest.mark.parametrize("tiles", [2, 3, 5])
def test_many_views_at_once_are_the_same_pictures(tiles, rng):
    blob = shapes.blob(rng)
    d = rng.normal(size=(7, 3))
    poses = look_along(-3 * d / np.linalg.norm(d, axis=1, keepdims=True), d, rng.normal(size=7))
    one = ids(blob, poses, (24, 16), tan=0.6)
    assert np.array_equal(ids(blob, poses, (24, 16), tan=0.6, tiles=tiles), one)
    assert (one > 0).any(axis=(1, 2)).all()


@pytest.mark.parametrize(("size", "most"), [((8, 8), 256), ((2048, 2048), 4)])
def test_hardware_draws_many_views_at_once_but_not_without_bound(size, most, monkeypatch):
    monkeypatch.setattr(r, "gl_info", lambda: SimpleNamespace(is_software=False))
    with r.Renderer(size) as renderer:
        assert 1 < renderer.tiles <= most


def test_the_place_among_others_rounds_no_edge_another_way(rng):
    blob = shapes.blob(rng, 4)
    poses = random_poses(rng, 96)
    one = ids(blob, poses, (160, 120), tan=0.6)
    assert np.array_equal(ids(blob, poses[::-1], (160, 120), tan=0.6, tiles=16)[::-1], one)


def test_a_plate_seen_from_behind_shows_no_id_and_hides_or_not_as_asked():
    wall = shapes.plate(40, center=(0, 0, -5))
    scene = shapes.merged(wall, shapes.flipped(shapes.plate(40, center=(0, 0, -2))))
    assert (ids(scene) == 0).all()
    assert set(ids(scene, refused_hide=False).ravel()) <= {1, 2}


def test_depths_are_distances_along_the_axis_in_every_pixel():
    wall = shapes.plate(100, center=(0, 0, -7.5))
    with looking(wall) as made, r.Renderer((6, 3)) as renderer:
        selection = r.Selection(made.surface, np.ones((1, len(made.surface.clusters)), bool))
        for _, _images in renderer.id_images(views(), [selection], origin=np.zeros(3)):
            depth = r.depth_along_axis(renderer.read_depths(1)[0], 0.1, 100.0)
    np.testing.assert_allclose(depth, 7.5, rtol=1e-4)


def test_pixels_are_counted_by_face():
    images = np.array([[[1, 1], [3, 0]], [[2, 2], [2, 2]]], dtype=np.uint32)
    assert [r.pixels_of_faces(image, 3).tolist() for image in images] == [[2, 0, 1], [0, 4, 0]]


def test_frustum_planes_hold_the_corners_of_the_image_and_no_more():
    these = views(tan=0.5, max_distance=10.0)
    inner, outer = 0.499, 0.501
    for x in (-1, 1):
        for y in (-1, 1):
            for depth, inside in ((9.99, True), (10.01, False)):
                point = [inner * x * depth, inner * y * depth, -depth, 1]
                assert np.all(these.planes[0] @ point >= 0) == inside
            assert not np.all(these.planes[0] @ [outer * x * 5, outer * y * 5, -5, 1] >= 0)


def test_a_picture_larger_than_the_driver_can_draw_is_refused():
    with pytest.raises(MachineError, match="exceeds this driver's limit"):
        r.Renderer((1 << 20, 4))


def test_a_shader_that_does_not_compile_is_named(monkeypatch):
    monkeypatch.setattr(
        surface, "shader_source", lambda name, *defines: "#version 330 core\nvoid main("
    )
    with pytest.raises(MachineError, match=r"shaders/broken\.\*\.glsl did not compile on"):
        surface.compiled.__wrapped__("broken")


def test_the_driver_at_hand_passes_the_self_test():
    selftest.check_driver()
    for _, drawn, expected in selftest._pictures():
        assert np.array_equal(drawn, expected)


def test_a_driver_that_draws_wrongly_is_refused(monkeypatch):
    wrong = [("face IDs", np.zeros((1, 2), int), np.array([[1, 2]]))]
    monkeypatch.setattr(selftest, "_pictures", lambda: wrong)
    with pytest.raises(MachineError, match=r"draws face IDs wrongly.*\[\[0, 0\]\].*\[\[1, 2\]\]"):
        selftest.check_driver.__wrapped__()


def test_the_driver_says_who_it_is():
    info = gl_info()
    assert info.backend in ("egl", "osmesa") and info.renderer and info.version
    assert info.is_software == ("llvmpipe" in info.renderer)


def test_what_was_drawn_with_can_be_released_and_made_again(rng):
    body = shapes.blob(rng)
    pictures = [ids(body, DOWN @ moved_back(3), (8, 8)) for _ in range(3)]
    assert (pictures[0] > 0).any()
    assert all(np.array_equal(pictures[0], picture) for picture in pictures)


def moved_back(distance):
    pose = np.eye(4)
    pose[2, 3] = distance
    return pose
