"""Points asked about on the GPU: maps are NumPy's, however the work is cut."""

import re

import numpy as np
import pytest
from support import shapes
from support.one_sensor import DOWN, looking, random_poses, seen, sensor

from glvis.errors import MachineError
from glvis.problem.camera import look_along
from glvis.problem.scene import Model
from glvis.problem.visibility_options import VisibilityOptions
from glvis.visibility import batch, cast, points, selftest, surface
from glvis.visibility.cast import Caster
from glvis.visibility.culling import cull
from glvis.visibility.maps import LocalMaps, MapJob, MapScene

pytestmark = pytest.mark.skipif(not cast.has_compute(), reason="this driver has no compute shaders")

OPTIONS = [
    {"criterion": criterion, "incidence": incidence}
    for criterion in ("pixels", "centroid")
    for incidence in ("ray", "axis")
]
DEVICE = sensor(
    hfov_deg=60, vfov_deg=45, resolution=(180, 140), near=0.3, far=3.4, max_incidence_deg=75
)

LINE = shapes.triangle((-1, 0, -1), (1, 0, -1), (2, 0, -1))  # without area
BEHIND = shapes.plate(1, center=(0, 0, 2))  # the eye


def scene(seed):
    """Return a body, what hides it, and poses around and inside."""
    rng = np.random.default_rng(seed)
    body = [shapes.blob(rng), shapes.torus(), shapes.tube(), shapes.soup(rng)][seed % 4]
    obstacle = shapes.moved(shapes.blob(rng, 2, 0.4), rng.normal(size=3))
    poses = [random_poses(rng, 4), random_poses(rng, 2, 1.0), random_poses(rng, 2, 0.1)]
    return body, obstacle, np.concatenate(poses)


def visible(seed, *, casts=True, device=DEVICE, **options):
    body, obstacle, poses = scene(seed)
    with looking(body, [obstacle], casts=casts, **options) as made:
        return made.looks(poses, device)


def no_numpy(*_):
    raise AssertionError("NumPy was asked")


@pytest.fixture
def shaders(monkeypatch):
    """Return a function that has the shaders compiled anew with a text replaced by another."""
    caches = [selftest.can_cast, surface.compiled_compute]
    source = surface.shader_source

    def replaced(text, other):
        found = []

        def changed(name, *defines):
            found.append(text in source(name, *defines))
            return source(name, *defines).replace(text, other)

        monkeypatch.setattr(surface, "shader_source", changed)
        for cached in caches:
            cached.cache_clear()
        return found

    yield replaced
    for cached in caches:
        cached.cache_clear()


@pytest.mark.parametrize("options", OPTIONS, ids=lambda o: "-".join(o.values()))
def test_maps_are_those_of_numpy(options):
    differing = seen = 0
    for seed in range(8):
        cast, numpy = (visible(seed, casts=casts, **options) for casts in (True, False))
        differing += np.count_nonzero(cast != numpy)
        seen += np.count_nonzero(numpy)
    # a point that a face's edge just hides, or not, is hidden up to rounding of float32
    assert seen > 2000 and differing <= 2e-4 * seen


@pytest.mark.parametrize("options", OPTIONS[::2], ids=lambda o: "-".join(o.values()))
@pytest.mark.parametrize(("name", "value"), [("_MOST_RECORDS", 3000), ("_MOST_CELLS", 10_000)])
def test_views_that_do_not_fit_at_once_are_seen_in_turn(name, value, options, monkeypatch):
    whole, numbers, bind = visible(1, **options), [], Caster._see
    monkeypatch.setattr(cast, name, value)
    monkeypatch.setattr(
        Caster, "_see", lambda self, *rest: numbers.append(len(rest[1])) or bind(self, *rest)
    )
    assert np.array_equal(whole, visible(1, **options))
    assert len(numbers) > 1 and sum(numbers) == len(whole)


@pytest.mark.parametrize("seed", range(4))
def test_maps_do_not_depend_on_the_grid(seed, monkeypatch):
    whole = visible(seed)
    for fewest, most in ((1, 1), (3, 7), (500, 500)):
        monkeypatch.setattr(points, "_FEWEST", fewest)
        monkeypatch.setattr(points, "_MOST", most)
        assert np.count_nonzero(whole != visible(seed)) <= 2e-4 * np.count_nonzero(whole)


@pytest.mark.parametrize("most", [1, 3])
def test_work_beyond_one_dispatch_becomes_more_columns(most, monkeypatch):
    whole = visible(0)
    monkeypatch.setattr(batch, "MOST_GROUPS", most)
    assert np.array_equal(whole, visible(0))


def test_a_plate_over_very_many_cells_hides_a_fine_wall(shaders):
    wall = shapes.plate(3, center=(0, 0, -3), cells=(100, 100))
    plate = shapes.plate(1, center=(0.303, 0.002, -1.5))
    x, y, _ = shapes.corners(wall).mean(axis=1).T
    # the plate's shadow is twice as large as the plate
    free = (np.abs(x - 0.606) > 1) | (np.abs(y - 0.004) > 1)
    device = sensor(far=3.2)

    def seen(casts):
        with looking(wall, [plate], casts=casts, criterion="centroid") as made:
            cells = points.grid_size(device.lens.windows.tan_half, made.model, device.max_distance)
            assert np.prod(cells) * (0.5 / np.tan(np.radians(30)) / 1.5) ** 2 > 4096
            return made.looks(DOWN[None], device)[0]

    assert np.array_equal(seen(True), free) and np.array_equal(seen(False), free)
    # it is the second run that finds what at least one of the plate's faces hides
    shaders("uint face = listed[first_spread + gl_WorkGroupID.x];", "uint face = 0u; return;")
    assert np.count_nonzero(seen(True) & ~free) > 1000


def test_large_occluders_that_cross_hide_together():
    wall = shapes.plate(1, center=(0, 0, -3), cells=(60, 60))
    rng = np.random.default_rng(3)
    large = shapes.moved(shapes.soup(rng, 200, 1.0, 0.7), (0, 0, -1.8))
    with looking(wall, [large], casts=True) as made:
        cast = made.looks(DOWN[None], sensor(far=3.2))
    with looking(wall, [large], casts=False) as made:
        assert np.array_equal(cast, made.looks(DOWN[None], sensor(far=3.2)))


@pytest.mark.parametrize("options", OPTIONS[::2], ids=lambda o: "-".join(o.values()))
def test_where_the_driver_gives_up_numpy_makes_the_same_map(options, monkeypatch):
    body, hides, poses = scene(1)
    parts = MapScene(
        (Model.from_arrays("body", *body),),
        (Model.from_arrays("hides", *hides),),
        (DEVICE,),
        VisibilityOptions(**options),
    )

    def made():
        maps = LocalMaps(parts)
        try:
            return next(maps.make([MapJob(0, poses)]))
        finally:
            maps.release()

    assert selftest.can_cast()  # before the driver gives up
    with monkeypatch.context() as patch:
        patch.setattr("glvis.visibility.cast.visible_of", no_numpy)
        cast = made()
    monkeypatch.setattr(Caster, "_has_finished", lambda self: False)
    with pytest.raises(AssertionError, match="NumPy"), monkeypatch.context() as patch:
        patch.setattr("glvis.visibility.cast.visible_of", no_numpy)
        made()
    assert cast.any() and np.array_equal(cast, made())


def test_a_loop_that_is_cut_short_is_reported(shaders):
    shaders("if (y > to.y) break;", "break;")
    body, obstacle, poses = scene(0)
    with looking(body, [obstacle], casts=True) as made:
        views, caster = made.views(poses, DEVICE), Caster()
        try:
            culled = cull(made.scene, views)
            assert caster.answer(made.question(DEVICE), views, culled) is None
        finally:
            caster.release()


@pytest.mark.parametrize("options", OPTIONS[::2], ids=lambda o: "-".join(o.values()))
@pytest.mark.parametrize(
    ("shape", "poses"),
    [
        (shapes.merged(LINE, BEHIND), DOWN[None]),
        (BEHIND, DOWN[None]),
        (shapes.flipped(shapes.plate(1, center=(0, 0, -2))), DOWN[None]),  # looks away
        (shapes.plate(1, center=(0, 0, -2)), np.zeros((0, 4, 4))),
    ],
)
def test_nothing_to_see_makes_empty_maps(shape, poses, options):
    with looking(shape, [shapes.plate(1, center=(0, 0, -1))], casts=True, **options) as made:
        found = made.looks(poses, sensor())
    assert found.shape == (len(poses), len(shape[1])) and not found.any()


def test_an_obstacle_without_area_hides_nothing():
    hides = shapes.merged(LINE, BEHIND)
    with looking(shapes.plate(1, center=(0, 0, -2)), [hides], casts=True) as made:
        assert made.looks(DOWN[None], sensor()).all()


def test_what_was_asked_before_leaves_nothing_behind():
    body, obstacle, poses = scene(0)
    caster = Caster()
    with looking(body, [obstacle], casts=True) as made:

        def asked(some):
            views = made.views(some, DEVICE)
            culled = cull(made.scene, views)
            return caster.visible(made.scene, views, culled, made.options)[0]

        alone = asked(poses[:1])
        asked(poses)
        assert alone.any() and np.array_equal(alone, asked(poses[:1]))
        caster.release()
        assert np.array_equal(alone, asked(poses[:1]))
    caster.release()
    caster.release()


def test_the_shaders_are_told_what_they_read():
    source = surface.shader_source("keep.comp.glsl")
    block = re.search(r"uniform View \{(.*?)\};", source, re.DOTALL)[1]
    names = re.findall(r"^\s*(\w+) (\w+);", block, re.MULTILINE)
    words = {"mat4": 16, "vec4": 4, "vec2": 2, "ivec2": 2, "float": 1, "int": 1, "uint": 1}
    told = batch.VIEW
    assert [(name, 4 * words[kind]) for kind, name in names] == [
        (name, told[name].itemsize) for name in told.names[:-1]
    ]
    # where std140 puts them: each at a multiple of its own size, of 16 bytes at most
    for name in told.names[:-1]:
        assert told.fields[name][1] % min(16, told[name].itemsize) == 0
    assert told.itemsize == 256


@pytest.mark.parametrize(
    ("text", "wrong"),
    [
        ("void main", "void mean"),
        ("if (hides) free[next - 1u] = record.w & LARGE;", ""),
        ("free[next - 1u] = record.w & LARGE;", "free[next - 1u] = 0u;"),
        ("is_large ? LARGE : 0u", "0u"),
        ("&& beyond > d", "&& beyond < d"),
        ("if (hides) break;", "hides = false;"),  # keep
        ("(passes ? own + 1u : 0u)", "(passes ? record + 1u : 0u)"),
        ("crop_back(towards)", "!crop_back(towards)"),
    ],
)
def test_a_driver_that_casts_wrongly_is_not_trusted_with_it(text, wrong, shaders):
    assert selftest.can_cast()
    found = shaders(text, wrong)
    assert not selftest.can_cast() and any(found)


def test_a_shader_that_does_not_compile_is_said_to_be_which(shaders):
    shaders("void main", "void mean")
    with pytest.raises(MachineError, match=r"shaders/hide\.comp\.glsl did not compile on"):
        surface.compiled_compute("hide")


@pytest.mark.parametrize("away", [0, 5, 20])
def test_faces_far_from_the_middle_of_the_scene_do_not_hide_themselves(away, rng):
    turn = np.linalg.qr(rng.normal(size=(3, 3)))[0]
    patch = shapes.plate(0.4, cells=(30, 30))
    patch = (patch[0] @ turn.T + away, patch[1])
    normal = shapes.normals_and_areas(patch)[0][0]
    points = shapes.corners(patch).mean(axis=1)
    height = rng.uniform(0.05, 0.25, size=8)
    position = points[rng.integers(len(points), size=8)] + np.outer(height, normal)
    aside = rng.normal(size=(8, 3))
    poses = look_along(position, -normal + 0.3 * aside)
    device = sensor(far=2.0)
    exact, cast = (
        seen(patch, poses, device, criterion="centroid", casts=casts, origin=np.zeros(3))
        for casts in (False, True)
    )
    assert exact.sum() > 100 and np.count_nonzero(exact != cast) <= 1e-3 * exact.sum()


@pytest.mark.parametrize("roll", [0.0, 1e-11, -1e-10, 1e-9, -1e-9, 1e-8, -1e-8, 1e-7])
@pytest.mark.parametrize("half", [-1, 1])
def test_an_edge_on_the_horizon_limits_only_rows(half, roll):
    wall = shapes.plate(2, center=(0, 0, -3), cells=(60, 60))
    _, y, _ = shapes.corners(wall).mean(axis=1).T
    plate = shapes.plate(1.2, center=(0, 0.6 * half, -1.5))  # one edge at the height of the eye
    pose = look_along([0, 0, 0], [0, 0, -1], roll, up=(0, 1, 0))
    device = sensor(hfov_deg=70, vfov_deg=70, far=3.2)
    with looking(wall, [plate], casts=True, criterion="centroid") as made:
        assert np.array_equal(made.looks(pose[None], device)[0], half * y < 0)
