"""The paper's filters: closed forms, reasons in one order, and shaders that say what NumPy says."""

from itertools import product

import moderngl
import numpy as np
import pytest
from support import shapes
from support.one_sensor import DOWN, random_poses, seen, sensor

from glvis.problem.lens import Pinhole
from glvis.problem.scene import Model
from glvis.problem.visibility_options import VisibilityOptions
from glvis.visibility.context import gl_context, unbind_framebuffer
from glvis.visibility.filters import (
    CameraFaces,
    Limits,
    Refusal,
    crop_back,
    crop_fov,
    crop_near,
    crop_norm,
    faces_in_camera,
    pass_filters,
    refusal,
)
from glvis.visibility.glsl import SHADER_DIR, shader_source

DEVICE = sensor(hfov_deg=70, vfov_deg=50, near=2.0, far=3.6, max_incidence_deg=65)
OPTIONS = {
    "ray": VisibilityOptions(),
    "axis": VisibilityOptions(incidence="axis"),
    "paper": VisibilityOptions.paper(),
}

# Each invocation writes what filters.glsl makes of one point of a face.
OWN = set(Refusal) - {Refusal.OUTSIDE_PARTNER, Refusal.TURNED_FROM_PARTNER}  # of one viewpoint
VERTEX = """#version 330 core
#include "filters.glsl"
in vec2 at; in float depth; in float height; in float distance_squared; in float axis_cos;
uniform vec2 size; uniform vec2 working_range;
uniform float min_ray_cos; uniform float min_axis_cos;
flat out int passes;
void main() {
    passes = int(crop_fov(at, size, depth, working_range.y)) + 2 * int(crop_back(height))
        + 4 * int(crop_norm_by_ray(height, distance_squared, min_ray_cos)
            && crop_norm_by_axis(axis_cos, min_axis_cos))
        + 8 * int(crop_near(depth, working_range.x));
}
"""


def faces_of(seed: int, options: VisibilityOptions) -> CameraFaces:
    """Return a random body's faces as one of some random poses has them, those behind left out."""
    rng = np.random.default_rng(seed)
    model = Model.from_arrays("body", *shapes.soup(rng, 400, 0.6, 3.0))
    faces = faces_in_camera(model, random_poses(rng, 1)[0], options)
    return faces[(faces.points[2] > 0).all(axis=0)]


def by_shader(faces: CameraFaces, limits: Limits) -> np.ndarray:
    """Return CropFOV, CropBack, CropNorm and CropNear by filters.glsl, (4, n) bool."""
    text = VERTEX.replace('#include "filters.glsl"', (SHADER_DIR / "filters.glsl").read_text())
    program = gl_context().program(vertex_shader=text, varyings=["passes"])
    x, y, depth = faces.points[:, 0]
    size = np.array([70.0, 50.0])
    tan = np.array(limits.lens.tan_half)[:, None]
    at = (np.stack([x, y]) / depth / tan + 1) / 2 * size[:, None]
    columns = [*at, depth, faces.heights, faces.distances_squared, faces.normals[2]]
    rows = np.ascontiguousarray(np.stack(columns, axis=1), dtype=np.float32)
    program["size"].value = tuple(size)
    program["working_range"].value = (limits.min_distance, limits.max_distance)
    program["min_ray_cos"].value = limits.min_ray_cos
    program["min_axis_cos"].value = limits.min_axis_cos
    names = ("at", "depth", "height", "distance_squared", "axis_cos")
    source, found = gl_context().buffer(rows), gl_context().buffer(reserve=4 * len(rows))
    array = gl_context().vertex_array(program, [(source, "2f 1f 1f 1f 1f", *names)])
    target = gl_context().simple_framebuffer((1, 1))  # OpenGL wants one, though nothing is drawn
    target.use()
    array.transform(found, moderngl.POINTS, vertices=len(rows))
    bits = np.frombuffer(found.read(), dtype=np.int32)
    unbind_framebuffer()
    for part in (array, program, source, found, target):
        part.release()
    return (bits >> np.arange(4)[:, None] & 1).astype(bool)


@pytest.mark.parametrize("incidence", ["ray", "axis"])
@pytest.mark.parametrize("seed", range(10))
def test_shaders_filter_as_numpy_does(seed, incidence):
    options = OPTIONS[incidence]
    faces, limits = faces_of(seed, options), Limits.of(DEVICE, options)
    fov, back, norm, near = by_shader(faces, limits)
    x, y, depth = faces.points[:, 0]
    heights, axis_cos = faces.heights, faces.normals[2]
    expected = {
        "fov": (fov, crop_fov(x, y, depth, limits)),
        "back": (back, crop_back(heights, axis_cos, limits)),
        # the shaders ask about the incidence of faces that look here alone
        "norm": (norm & back, crop_norm(heights, faces.distances_squared, axis_cos, limits) & back),
        "near": (near, crop_near(depth, limits)),
    }
    for name, (shader, numpy) in expected.items():
        assert 0 < np.count_nonzero(numpy) < len(numpy), name
        assert np.array_equal(shader, numpy), name  # no random face lies within float32 of a limit


def test_the_shaders_that_make_maps_include_the_filters():
    for name in ("id_buffer.vert.glsl", "id_buffer.frag.glsl", "ask.comp.glsl"):
        assert "bool crop_back(float height)" in shader_source(name)


@pytest.mark.parametrize("name", OPTIONS)
@pytest.mark.parametrize("seed", range(5))
def test_what_passes_is_what_nothing_refuses(seed, name):
    faces, limits = faces_of(seed, OPTIONS[name]), Limits.of(DEVICE, OPTIONS[name])
    found = refusal(faces, limits)
    assert np.array_equal(found == Refusal.NONE, pass_filters(faces, limits))
    assert set(found.tolist()) == {int(reason) for reason in OWN}


@pytest.mark.parametrize(("tilt", "reason"), [(105, Refusal.NONE), (115, Refusal.TURNED_AWAY)])
def test_the_papers_tolerance_of_backs_is_no_reason_either(tilt, reason):
    """Drift 1: a plate that the paper's CropBack keeps was told to be turned away."""
    plate = shapes.plate(0.5, center=(0, 0, -3), tilt_deg=tilt)
    options = VisibilityOptions.paper()
    faces = faces_in_camera(Model.from_arrays("plate", *plate), DOWN, options)
    limits = Limits.of(sensor(far=10), options)
    assert set(refusal(faces, limits).tolist()) == {int(reason)}
    visible = seen(plate, device=sensor(far=10), **vars(options))
    assert visible.all() == (reason == Refusal.NONE)


@pytest.mark.parametrize(("tilt", "is_back"), [(60, False), (-60, True)])
def test_by_axis_a_face_that_shows_its_back_is_turned_away(tilt, is_back):
    """Far off the axis a face may look along it and still show the eye its back."""
    plate = shapes.plate(0.1, center=(0, 2.2, -2), tilt_deg=tilt)
    options = OPTIONS["axis"]
    faces = faces_in_camera(Model.from_arrays("plate", *plate), DOWN, options)
    assert (faces.normals[2] > 0.45).all() and ((faces.heights < 0) == is_back).all()
    found = refusal(faces, Limits.of(sensor(hfov_deg=120, vfov_deg=120, far=10), options))
    assert set(found.tolist()) == {int(Refusal.TURNED_AWAY if is_back else Refusal.NONE)}


def test_reasons_are_asked_in_one_order():
    """Drift 3: the page asked near before far; one point can only be one of them, corners both."""
    order = [
        Refusal.OUTSIDE,
        Refusal.TURNED_AWAY,
        Refusal.TOO_FAR,
        Refusal.TOO_NEAR,
        Refusal.TOO_OBLIQUE,
        Refusal.OUTSIDE_PARTNER,
        Refusal.TURNED_FROM_PARTNER,
        Refusal.NONE,
    ]
    assert sorted(Refusal) == order
    # one corner beyond maxD in view, one nearer than minD beside the image
    points = np.array([[[0.0], [9.0], [9.0]], [[0.0], [0.0], [0.0]], [[4.0], [1.0], [1.0]]])
    limits = Limits(Pinhole.from_tangents(1.0, 1.0), 2.0, 3.0)
    for turn, far in product((-1.0, 1.0), (3.0, 5.0)):
        faces = CameraFaces(np.zeros(1, dtype=int), points, np.array([[0.0], [0.0], [turn]]))
        limits = Limits(Pinhole.from_tangents(1.0, 1.0), 2.0, far)
        expected = Refusal.TOO_FAR if far < 4 else Refusal.TOO_NEAR
        assert refusal(faces, limits)[0] == (expected if turn > 0 else Refusal.TURNED_AWAY)
