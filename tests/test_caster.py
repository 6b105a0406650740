"""Casting small faces changes no map: against drawing all of them, and against rays."""

import re
from contextlib import ExitStack

import numpy as np
import oracle
import pytest
import shapes
from sight import DOWN, mapper, random_poses, sensor

import glvis.sight.caster
import glvis.sight.clusters
import glvis.sight.worklist
from glvis.camera import camera_to_world
from glvis.sight import selftest, surface
from glvis.sight.caster import Caster
from glvis.sight.views import Views

pytestmark = pytest.mark.skipif(
    not glvis.sight.caster.has_compute(), reason="this driver has no compute shaders"
)

CRITERIA = [
    {"criterion": "centroid"},
    {"criterion": "centroid", "incidence": "axis"},
    {"criterion": "pixels"},
    {"criterion": "pixels", "incidence": "axis"},
    {"criterion": "pixels", "resolution": (90, 70)},
    {"criterion": "pixels", "resolution": (90, 70), "min_pixels": 3},
]
ALL_CAST, NONE_CAST, MIXED = 1e9, 0.0, 10.0  # edges in pixels up to which faces are cast


def cast_up_to(pixels, monkeypatch):
    monkeypatch.setattr(glvis.sight.caster, "_SMALL", pixels)
    monkeypatch.setattr(glvis.sight.caster, "_SMALL_AMONG_LARGE", pixels)


def scene(seed):
    """Return a body, what hides it, poses around and among them, and a sensor."""
    rng = np.random.default_rng(seed)
    body = [shapes.blob(rng), shapes.torus(), shapes.tube(), shapes.soup(rng)][seed % 4]
    obstacle = shapes.moved(shapes.blob(rng, 2, 0.4), rng.normal(size=3))
    poses = np.concatenate([random_poses(rng, 4), random_poses(rng, 2, distance=1.0)])
    device = sensor(
        hfov_deg=60, vfov_deg=45, resolution=(180, 140), near=0.3, far=3.4, max_incidence_deg=75
    )
    return body, obstacle, poses, device


def visible(seed, small, monkeypatch, *, casts=True, tiles=None, **options):
    cast_up_to(small, monkeypatch)
    body, obstacle, poses, device = scene(seed)
    with mapper(body, [obstacle], casts=casts, tiles=tiles, **options) as made:
        return made.looks(poses, device)


@pytest.mark.parametrize("options", CRITERIA, ids=lambda o: "-".join(map(str, o.values())))
@pytest.mark.parametrize("small", [ALL_CAST, MIXED, NONE_CAST], ids=["all", "mixed", "none"])
def test_cast_faces_are_seen_as_drawn_ones(small, options, monkeypatch):
    differing = seen = 0
    for seed in range(8):
        drawn = visible(seed, small, monkeypatch, casts=False, **options)
        cast = visible(seed, small, monkeypatch, **options)
        differing += np.count_nonzero(drawn != cast)
        seen += np.count_nonzero(drawn)
    # a draw moves corners to 1/256 of a pixel, casting does not: faces that a pixel's ray just
    # meets or misses may differ, where only the pixels decide and where an occluder ends
    assert seen > 2000 and differing <= 0.001 * seen


def test_the_mixed_case_above_is_mixed(monkeypatch):
    shares = []
    seen_small = glvis.sight.clusters.Joined.seen_small

    def noted(self, *arguments):
        small = seen_small(self, *arguments)
        shares.extend(small[:, columns].mean() for columns in self.columns)
        return small

    monkeypatch.setattr(glvis.sight.clusters.Joined, "seen_small", noted)
    for seed in range(4):
        visible(seed, MIXED, monkeypatch, criterion="centroid")
        visible(seed, MIXED, monkeypatch, criterion="pixels")
    assert 0.1 < np.median(shares) < 0.9


@pytest.mark.parametrize("options", CRITERIA[:4], ids=lambda o: "-".join(map(str, o.values())))
def test_how_many_views_share_the_buffers_changes_nothing(options, monkeypatch):
    one = visible(1, MIXED, monkeypatch, tiles=1, **options)
    for tiles in (4, 16):
        assert np.array_equal(one, visible(1, MIXED, monkeypatch, tiles=tiles, **options))


@pytest.mark.parametrize("seed", range(4))
def test_no_ray_slips_through_between_neighbours(seed, monkeypatch):
    rng = np.random.default_rng(seed)
    # a finely cut plate wholly hides a wall, whatever way its cells are turned
    turn = np.linalg.qr(rng.normal(size=(2, 2)))[0]
    vertices, faces = shapes.plate(2.4, center=(0, 0, 0), cells=(90, 70))
    vertices[:, :2] = vertices[:, :2] @ (turn * np.sign(np.linalg.det(turn)))
    plate = (vertices + np.array([0, 0, -2]), faces)
    wall = shapes.plate(1.0, center=(0, 0, -3), cells=(40, 40))
    cast_up_to(ALL_CAST, monkeypatch)
    for size in ((173, 131), (64, 64)):
        with mapper(wall, [plate], casts=True, resolution=size) as made:
            assert not made.looks(DOWN[None], sensor(far=10)).any()
        with mapper(wall, casts=True, resolution=size) as made:
            assert made.looks(DOWN[None], sensor(far=10)).any()


def test_a_face_around_the_eye_is_drawn_and_still_hides(monkeypatch):
    cast_up_to(ALL_CAST, monkeypatch)
    wall = shapes.plate(4, center=(0, 0, -3), cells=(20, 20))
    # a blade that runs from behind the eye to before it, left of the axis
    blade = (
        np.array([[-0.05, -9.0, 1.0], [-0.05, 9.0, 1.0], [-0.05, 0.0, -1.0]]),
        np.array([[0, 1, 2]]),
    )
    for casts in (False, True):
        with mapper(wall, [blade], casts=casts, criterion="centroid") as made:
            seen = made.looks(DOWN[None], sensor(far=10, resolution=(300, 300)))[0]
        left = shapes.corners(wall).mean(axis=1)[:, 0] < -0.5
        right = shapes.corners(wall).mean(axis=1)[:, 0] > 0.0
        assert seen[right].sum() > 50 and seen[left].sum() < 0.2 * seen[right].sum()


def test_the_shader_is_told_what_it_reads():
    source = surface.shader_source("cast.comp.glsl")
    block = re.search(r"uniform View \{(.*?)\};", source, re.DOTALL)[1]
    members = re.findall(r"^\s*(\w+) ([\w, ]+);", block, re.MULTILINE)
    names = [(kind, name) for kind, some in members for name in some.split(", ")]
    words = {"mat4": 16, "vec4": 4, "vec2": 2, "ivec2": 2, "float": 1, "int": 1, "uint": 1}
    told = glvis.sight.worklist.VIEW
    assert [(name, 4 * words[kind]) for kind, name in names] == [
        (name, told[name].itemsize) for name in told.names[:-1]
    ]
    # where std140 puts them: each at a multiple of its own size, of 16 bytes at most
    for name in told.names[:-1]:
        assert told.fields[name][1] % min(16, told[name].itemsize) == 0
    assert told.itemsize == 256


ROW = """    walk.at.x = int(clamp(ceil(left), float(t.from.x), float(t.to.x)));
    walk.end = int(clamp(floor(right), -1.0, float(t.to.x)));
"""
BOX = "    walk.at.x = t.from.x;\n    walk.end = t.to.x;\n"


def slivers(rng):
    """Return faces whose third corner lies almost on the line through the other two."""
    vertices, faces = shapes.soup(rng, 300, 0.3)
    a, b, c = vertices.reshape(-1, 3, 3).swapaxes(0, 1)
    off_line = rng.normal(size=(300, 3)) * 10 ** rng.uniform(-6, -1, (300, 1))
    c[:] = a + rng.uniform(size=(300, 1)) * (b - a) + off_line
    return vertices, faces


@pytest.mark.parametrize("options", [{"min_pixels": 1}, {"min_pixels": 4}], ids=str)
@pytest.mark.parametrize("fov_deg", [40, 120, 178])
@pytest.mark.parametrize("kind", ["slivers", "level", "nearly level", "torus"])
def test_walking_from_edge_to_edge_leaves_no_pixel_out(kind, fov_deg, options, monkeypatch):
    cast_up_to(ALL_CAST, monkeypatch)
    rng = np.random.default_rng(7)
    body = {
        "slivers": lambda: slivers(rng),
        "level": lambda: shapes.plate(3, cells=(9, 13)),
        "nearly level": lambda: shapes.plate(3, tilt_deg=1e-4, cells=(3, 2)),
        "torus": shapes.torus,
    }[kind]()
    above = camera_to_world(
        [[0, 0, 2.5], [0.3, 0.2, 2.5], [0.1, 0, 2.5]],
        [[0, 0, -1]],
        up=[[0, 1, 0], [1, 0, 0], [1e-5, 1, 0]],
    )
    poses = np.concatenate([random_poses(rng, 4), random_poses(rng, 3, distance=1.2), above])
    device = sensor(hfov_deg=fov_deg, vfov_deg=0.8 * fov_deg, resolution=(200, 150), far=20)

    def looked():
        surface.compiled_compute.cache_clear()
        obstacle = shapes.soup(np.random.default_rng(8), 60, 0.2)
        with mapper(body, [obstacle], casts=True, resolution=(200, 150), **options) as made:
            return made.looks(poses, device)

    walked, source = looked(), surface.shader_source
    assert ROW in source("cast.comp.glsl")
    monkeypatch.setattr(
        surface,
        "shader_source",
        lambda name, *defines, version=0: source(name, *defines, version=version).replace(ROW, BOX),
    )
    try:
        assert walked.any() and np.array_equal(walked, looked())
    finally:
        surface.compiled_compute.cache_clear()


@pytest.mark.parametrize(
    ("tiles", "small", "cluster"),
    [(None, 64.0, 8), (1, MIXED, 32), (4, ALL_CAST, 1), (16, NONE_CAST, 8)],
)
def test_models_looked_at_together_are_seen_as_each_alone(tiles, small, cluster, monkeypatch):
    monkeypatch.setattr(glvis.sight.clusters, "_SIZE_SMALL", cluster)
    cast_up_to(small, monkeypatch)
    rng = np.random.default_rng(1)
    poses = np.concatenate(
        [random_poses(rng, 4), random_poses(rng, 2, 1.0), random_poses(rng, 2, 30)]
    )
    poses[6:, :3, [0, 2]] *= -1  # these look away
    device = sensor(resolution=(180, 140), near=0.3, far=6, max_incidence_deg=75)
    kinds = [
        (shapes.blob(rng), {"criterion": "pixels", "resolution": (90, 70)}),
        (shapes.torus(), {"criterion": "centroid", "resolution": (180, 140)}),
        (shapes.plate(2, cells=(3, 3)), {"min_pixels": 3, "resolution": (64, 50)}),
        (shapes.plate(500), {"resolution": (120, 200)}),
    ]
    hides = shapes.moved(shapes.blob(rng, 2, 0.4), (0.3, 0.1, 0.9))
    with ExitStack() as stack:
        made = [
            stack.enter_context(mapper(shape, [hides], tiles=tiles, casts=True, **options))
            for shape, options in kinds
        ]
        corners = np.concatenate([one.culling.corners for one in made])

        def seen_by(caster, some, order):
            views = Views.of(some, device, corners)
            looks = [made[k].look(views, device, made[k].culling.chosen(views)) for k in order]
            found = caster.visible(views, looks, origin=np.zeros(3))
            return [found[order.index(k)] for k in sorted(order)]

        alone = []
        for k in range(len(kinds)):
            caster = Caster()
            alone += seen_by(caster, poses, [k])
            caster.release()
        assert all(seen.any() for seen in alone[:3])
        caster = Caster()
        for n, order in (
            (8, [0, 1, 2, 3]),
            (8, [3, 1, 0, 2]),
            (3, [2, 3, 1, 0]),
            (0, [0, 1, 2, 3]),
        ):
            for one, other in zip(alone, seen_by(caster, poses[:n], order), strict=True):
                assert np.array_equal(one[:n], other)
        caster.release()


def test_work_beyond_one_dispatch_is_split(monkeypatch):
    whole = visible(1, MIXED, monkeypatch, criterion="pixels")
    monkeypatch.setattr(glvis.sight.worklist, "_MOST_GROUPS", 3)
    assert np.array_equal(whole, visible(1, MIXED, monkeypatch, criterion="pixels"))


def test_tiny_faces_far_from_the_origin_are_seen_as_rays_see_them(monkeypatch):
    rng = np.random.default_rng(5)
    far_away = np.array([4000.0, -2500.0, 900.0])
    vertices, faces = shapes.icosphere(5)  # 20,480 faces of half a pixel
    body = (vertices + far_away, faces)
    poses = random_poses(rng, 2)
    poses[:, :3, 3] += far_away
    device = sensor(resolution=(120, 120), far=10)
    with mapper(body, casts=True, origin=far_away, criterion="centroid") as made:
        ours = made.looks(poses, device)
    eye = oracle.Eye.of(device)
    theirs = np.stack([oracle.centroid_visible(pose, eye, shapes.corners(body)) for pose in poses])
    assert np.count_nonzero(ours & theirs) >= 0.99 * np.count_nonzero(ours | theirs) > 5000


@pytest.mark.parametrize("criterion", ["centroid", "pixels"])
@pytest.mark.parametrize("seed", range(4))
def test_nothing_is_seen_behind_a_wall_not_even_edge_on(seed, criterion):
    vertices, faces = shapes.blob(np.random.default_rng(seed), 5)
    body = (vertices + np.array([0, 0, -5]), faces)
    wall = shapes.plate(6, center=(0, 0, -1))
    device = sensor(far=20, resolution=(64, 64))
    for casts in (False, True):
        with mapper(body, [wall], casts=casts, criterion=criterion) as made:
            assert not made.looks(DOWN[None], device).any()
        with mapper(body, casts=casts, criterion=criterion) as made:
            assert made.looks(DOWN[None], device).any()


def test_no_poses_make_no_maps():
    with mapper(shapes.cube(), casts=True) as made:
        assert made.looks(np.zeros((0, 4, 4)), sensor()).shape == (0, 12)


@pytest.mark.parametrize(
    ("text", "wrong"),
    [
        ("if (distance > 0.0) atomicMin(", "if (false) atomicMin("),
        ("++pixels;", ";"),
        ("shows = faces && shows_centre", "shows = faces && !shows_centre"),
        ("= t.side <= 0.0 &&", "= t.side >= 0.0 ||"),
        ("min(far, ", "max(far, "),
        ("void main", "void mean"),
    ],
)
def test_a_driver_that_casts_wrongly_is_not_trusted_with_it(text, wrong, monkeypatch):
    assert selftest.can_cast()
    source = surface.shader_source
    assert text in source("cast.comp.glsl")
    monkeypatch.setattr(
        surface,
        "shader_source",
        lambda name, *defines, version=0: source(name, *defines, version=version).replace(
            text, wrong
        ),
    )
    for cached in (selftest.can_cast, surface.compiled_compute):
        cached.cache_clear()
    try:
        assert not selftest.can_cast()
    finally:
        for cached in (selftest.can_cast, surface.compiled_compute):
            cached.cache_clear()


def test_a_driver_that_draws_before_what_was_cast_is_not_trusted_either(monkeypatch):
    source = surface.shader_source
    text = "if (depth > uintBitsToFloat"
    assert text in source("id_buffer.frag.glsl")
    monkeypatch.setattr(
        surface,
        "shader_source",
        lambda name, *defines, version=0: source(name, *defines, version=version).replace(
            text, "if (depth < -uintBitsToFloat"
        ),
    )
    for cached in (selftest.can_cast, surface.compiled):
        cached.cache_clear()
    try:
        assert not selftest.can_cast()
    finally:
        for cached in (selftest.can_cast, surface.compiled):
            cached.cache_clear()
