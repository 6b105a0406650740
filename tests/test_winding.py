"""Windings: which faces disagree with their neighbours, which bodies are inside out, what is in."""

import numpy as np
import pytest
from support import rooms
from support.shapes import (
    Shape,
    blob,
    cube,
    flipped,
    icosphere,
    merged,
    moved,
    plate,
    soup,
    torus,
    tube,
)

from glvis.problem.scene import SUFFIXES, Model, load_model
from glvis.problem.winding import (
    encloses,
    is_closed,
    is_in_solid,
    looks_inwards,
    winding,
    winding_numbers,
)


def model(shape: Shape) -> Model:
    return Model.from_arrays("shape", *shape)


def loose(shape: Shape, digits: float = 1e-7) -> Shape:
    """Return a shape of single faces whose corners differ in the last digits."""
    points = shape[0][shape[1].ravel()]
    noise = np.random.default_rng(0).uniform(-1, 1, points.shape)
    return points + digits * np.ptp(points) * noise, np.arange(len(points)).reshape(-1, 3)


@pytest.mark.parametrize("shape", [cube(), icosphere(3), torus(), tube(), plate(cells=(3, 3))])
def test_a_good_surface_has_nothing_against_it(shape):
    found = winding(model(shape))
    assert found.disputed_edges == 0
    assert not (found.against.any() or found.doubled.any() or found.inside_out.any())


@pytest.mark.parametrize("seed", range(5))
def test_the_faces_that_were_turned_are_found(seed):
    rng = np.random.default_rng(seed)
    vertices, faces = blob(rng)
    turned = rng.random(len(faces)) < 0.3
    faces = np.where(turned[:, None], faces[:, ::-1], faces)
    found = winding(model((vertices, faces)))
    assert np.array_equal(found.against, turned)
    assert not found.inside_out.any()
    assert np.array_equal(winding(model((vertices, faces[:, ::-1]))).against, turned)
    assert winding(model((vertices, faces[:, ::-1]))).inside_out.all()


@pytest.mark.parametrize("shape", [icosphere(3), torus(), tube(), blob(np.random.default_rng(1))])
def test_near_vertices_are_one_and_holes_are_closed(shape):
    assert winding(model(loose(shape))).open_edges == winding(model(shape)).open_edges
    for one in (shape, loose(shape), (shape[0], shape[1][1:])):
        assert not winding(model(one)).inside_out.any()
        assert winding(model(flipped(one))).inside_out.all()
        assert winding(model(flipped(moved(one, (1e3, 0, 0))))).inside_out.all()


def test_what_is_open_has_no_inside():
    assert not winding(model(flipped(plate(cells=(4, 4))))).inside_out.any()
    assert not winding(model(soup(np.random.default_rng(0)))).inside_out.any()


def test_a_moebius_strip_has_no_right_side():
    u = 2 * np.pi * np.arange(40) / 40
    rim = [
        np.stack(
            [
                (1 + r * np.cos(u / 2)) * np.cos(u),
                (1 + r * np.cos(u / 2)) * np.sin(u),
                r * np.sin(u / 2),
            ],
            1,
        )
        for r in (-0.3, 0.3)
    ]
    rows = [(i, 40 + i, (i + 1) if i < 39 else 40) for i in range(40)]
    rows += [(40 + i, 41 + i if i < 39 else 0, (i + 1) if i < 39 else 40) for i in range(40)]
    found = winding(model((np.concatenate(rim), np.array(rows))))
    assert found.disputed_edges == 1
    assert not found.against.any()


def test_sheets_from_both_sides_are_doubled_and_no_dispute():
    ball = icosphere(2)
    found = winding(model(merged(ball, flipped(ball), cube(1, (5, 0, 0)))))
    assert found.doubled.sum() == 2 * len(ball[1])
    assert (found.disputed_edges, found.open_edges) == (0, 0)


def test_winding_numbers_count_bodies():
    shape = merged(icosphere(2, 3.0), icosphere(2, 1.0), flipped(icosphere(2, 5.0, (20, 0, 0))))
    points = [(0, 0, 0), (2, 0, 0), (9, 0, 0), (20, 0, 0), (-50, 1, 2)]
    assert winding_numbers(model(shape), points) == pytest.approx([2, 1, 0, -1, 0], abs=1e-9)


def test_a_disc_of_a_plane_has_its_solid_angle():
    half = winding_numbers(model(plate(2.0, cells=(8, 8))), [(0, 0, -1), (0, 0, 1)])
    angle = 4 * np.arctan(1 / np.sqrt(3)) / (4 * np.pi)  # a square of 2 from a distance of 1
    assert half == pytest.approx([angle, -angle])


def test_solid_is_what_is_enclosed_and_in_a_room_what_is_not_free():
    ball = model(icosphere(3, 2.0))
    assert is_in_solid(ball, [(0, 0, 0), (3, 0, 0)]).tolist() == [True, False]
    assert not is_in_solid(model(flipped(icosphere(3, 2.0))), [(3, 0, 0)]).any()
    room = model(rooms.room())
    assert looks_inwards(room)
    places = [(3.0, 0.8, 2.0), (0.3, 1.0, 0.5), (5.5, 4.0, 1.0), (-1, 2, 1)]
    assert is_in_solid(room, places).tolist() == [False, True, True, True]


def test_a_room_encloses_what_stands_in_it():
    places = [(3.0, 0.8, 2.0), (4.9, 2.0, 1.5), (0.3, 1.0, 0.5)]  # the last in a cabinet
    room = model(rooms.room())
    assert encloses(room, places)
    assert not encloses(room, [(-1.0, 2, 1), (9.0, 2, 1)])
    assert not encloses(model(icosphere(2, 9.0)), places)


def test_real_meshes(shared_data):
    found = {
        p.name: load_model(p)
        for p in sorted(shared_data.rglob("*"))
        if p.suffix.lower() in SUFFIXES
    }
    assert [name for name, m in found.items() if looks_inwards(m)] == ["kitchen.stl"]
    for name, m in found.items():
        assert not winding(m).inside_out.any(), name
        if name not in ("kitchen.stl", "chair_model.obj"):  # furniture without backs, sheets
            assert winding(m.flipped()).inside_out.mean() > 0.99, name
    assert found["featuretype.STL"].boundary_edges == 576
    assert winding(found["featuretype.STL"]).open_edges == 0
    assert is_closed(found["featuretype.STL"])
    assert not is_closed(found["chair_model.obj"]) and not is_closed(found["arm1.stl"])
    assert winding(found["chair_model.obj"]).doubled.all()
    assert winding(found["chair_model.obj"]).disputed_edges == 0
