"""Maps by every lens and by two viewpoints are right: judged by float64 rays (``lens_oracle.py``).

Meshes by formula, the arms before their holder and the kitchen, from seeded poses: around, inside,
very near to a face and beside one; both criteria, without and with compute shaders (draw, cast).
Limits as of ``test_any_mesh.py``, and as there pytest prints the worst rows at its end, or all with
``--all-meshes``; ``--rounds 5`` looks from five times as many poses. All but one mesh is slow:

    pytest tests/test_lenses_against_rays.py -m "not slow"     # a torus alone
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from support import kinds, shapes
from support.lens_kinds import SENSORS, enlarged
from support.lens_oracle import judge_of
from support.verdicts import (
    AROUND,
    BESIDE,
    INSIDE,
    NEAR,
    Limits,
    Table,
    Verdicts,
    Way,
    corners_of,
    judged,
    poses_about,
    ways,
)

from glvis.problem.camera import look_along
from glvis.problem.scene import load_model
from glvis.problem.sensor import Sensor

AT_AUTO = ways(resolutions=("auto",))


@pytest.fixture(scope="module")
def table(request) -> Table:
    found = Table("lenses against rays", ways())
    request.config.pluginmanager.register(found)
    return found


def torus() -> shapes.Shape:
    return shapes.torus(100.0, 40.0, 64, 32)


def lattice() -> shapes.Shape:
    """Return bars along three axes: large faces, and many holes."""
    vertices, faces = kinds.lattice()
    return vertices * 150, faces


def cave() -> shapes.Shape:
    """Return a dented body in a dented cave that looks inward."""
    rng = np.random.default_rng(3)
    body, hall = shapes.blob(rng, 3, 50.0), shapes.flipped(shapes.blob(rng, 4, 200.0))
    return shapes.merged(shapes.moved(body, (30, -20, 10)), hall)


def assert_right(verdicts: Verdicts, table: Table, least: int = 100) -> None:
    table.append(verdicts)
    broken = verdicts.broken()
    assert not broken, "\n".join(broken)
    for way in verdicts.by_pose:
        seen = verdicts.total(way).seen
        assert seen > least, f"{verdicts.name}, {way}: only {seen} faces are seen"


def seeded(*words: str) -> np.random.Generator:
    return np.random.default_rng(list(" ".join(words).encode()))


def looked_at(
    name: str, shape: shapes.Shape, device: Sensor, places: tuple[str, ...], **more
) -> Verdicts:
    """Return the figures of a mesh from random poses at some kinds of places."""
    poses = poses_about(seeded(name), corners_of(shape), places)
    return judged(name, shape, poses, device, those=AT_AUTO, words=places, **more)


@pytest.mark.parametrize("lens", SENSORS)
@pytest.mark.parametrize(
    "made", [torus, pytest.param(lattice, marks=pytest.mark.slow)], ids=lambda made: made.__name__
)
def test_every_lens_sees_a_mesh_as_rays_see_it(made, lens, table, rounds):
    places = rounds * (AROUND, AROUND, INSIDE, NEAR, BESIDE)
    name = f"{made.__name__}, {lens}"
    verdicts = looked_at(name, made(), SENSORS[lens], places)
    verdicts.limits = Limits(iou=0.998)
    assert_right(verdicts, table)


@pytest.mark.slow
@pytest.mark.parametrize("lens", SENSORS)
def test_what_shows_in_a_lenss_own_pixels_is_seen_at_its_own_resolution(lens, table, rounds):
    wide, high = SENSORS[lens].lens.opening
    width = round((80_000 * wide / high) ** 0.5)
    device = replace(SENSORS[lens], resolution=(width, 80_000 // width))
    places = rounds * (AROUND, AROUND, INSIDE, NEAR, BESIDE)
    shape = torus()
    poses = poses_about(seeded("pixels", lens), corners_of(shape), places)
    those = ways(("pixels",), ("sensor",))
    assert_right(judged(f"pixels, {lens}", shape, poses, device, those=those, words=places), table)


@pytest.mark.slow
@pytest.mark.parametrize("lens", SENSORS)
def test_every_lens_sees_a_cave_from_within(lens, table, rounds):
    places = rounds * 2 * (INSIDE, INSIDE, NEAR, BESIDE)
    verdicts = looked_at(f"cave, {lens}", cave(), SENSORS[lens], places)
    verdicts.limits = Limits(iou=0.998)
    assert_right(verdicts, table, 30)  # pairs see little so near


@pytest.mark.slow
@pytest.mark.parametrize("lens", SENSORS)
@pytest.mark.parametrize("arm", [2, 5])
def test_every_lens_sees_an_arm_before_its_holder(arm, lens, table, rounds, shared_data):
    model, holder = (
        load_model(shared_data / "arms" / f"{name}.stl") for name in (f"arm{arm}", "holder")
    )
    arm_shape, holder_shape = ((one.vertices, one.faces) for one in (model, holder))
    places = rounds * (3 * (AROUND,) + (INSIDE, INSIDE, NEAR, BESIDE))
    verdicts = looked_at(
        f"arm{arm}, {lens}", arm_shape, SENSORS[lens], places, obstacles=[holder_shape]
    )
    verdicts.limits = Limits(iou=0.999)
    assert_right(verdicts, table, 1000)


@pytest.mark.slow
@pytest.mark.parametrize("lens", SENSORS)
@pytest.mark.parametrize("criterion", ["centroid", "pixels"])
def test_every_lens_sees_a_room_of_large_faces(criterion, lens, table, rounds, shared_data):
    model = load_model(shared_data / "kitchen" / "kitchen.stl")
    device = enlarged(SENSORS[lens], 9.0, 5.0)
    rng, corners = seeded("kitchen", lens), model.vertices[model.faces]
    poses = list(poses_about(rng, corners, rounds * (NEAR, BESIDE)))
    while len(poses) < 10 * rounds:
        position = rng.uniform((0, 0, 0), (3000, 3000, 3500))
        target = rng.uniform((0, 0, 0), (3000, 3000, 2000))
        pose = look_along(position, target - position, float(rng.uniform(-np.pi, np.pi)))
        if np.count_nonzero(judge_of(pose, device, corners).centroids().free) > 20:
            poses.append(pose)
    those = [Way(criterion, "auto", way.casts) for way in ways(("pixels",), ("auto",))]
    verdicts = judged(
        f"kitchen, {lens}, {criterion}",
        (model.vertices, model.faces),
        np.array(poses),
        device,
        those=those,
    )
    # from a pose so near to a cupboard that the near plane decides, a few hundred faces are open
    verdicts.limits = Limits(iou=0.998, excused_percent=3.0)
    assert_right(verdicts, table, 300)
