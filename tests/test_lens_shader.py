"""The lens in the shader and in NumPy say the same of every direction."""

import math

import moderngl
import numpy as np
import pytest
from support.lens_kinds import SENSORS

from glvis.problem.lens import Pinhole
from glvis.problem.visibility_options import VisibilityOptions
from glvis.visibility.context import gl_context, unbind_framebuffer
from glvis.visibility.filters import Limits, measured
from glvis.visibility.glsl import SHADER_DIR
from glvis.visibility.lens_uniforms import LENS, lens_uniforms

VERTEX = """#version 430 core
#include "lens.glsl"
in vec3 direction;
out float is_inside;
out float far_off;
void main() {
    is_inside = float(in_image(direction));
    far_off = measured(direction);
}
"""
OTHERS = {
    name: device
    for name, device in SENSORS.items()
    if not isinstance(device.lens, Pinhole) or device.distance == "range"
}


def by_shader(limits: Limits, directions: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return whether directions (n, 3) are in the image, and how far off they are measured."""
    context = gl_context()
    text = VERTEX.replace('#include "lens.glsl"', (SHADER_DIR / "lens.glsl").read_text())
    program = context.program(vertex_shader=text, varyings=["is_inside", "far_off"])
    block = context.buffer(lens_uniforms(limits))
    block.bind_to_uniform_block(1)
    points = context.buffer(directions.astype("f4"))
    found = context.buffer(reserve=8 * len(directions))
    array = context.vertex_array(program, [(points, "3f", "direction")])
    unbind_framebuffer()
    array.transform(found, moderngl.POINTS, vertices=len(directions))
    values = np.frombuffer(found.read(), dtype="f4").reshape(-1, 2)
    for part in (array, found, points, block, program):
        part.release()
    return values[:, 0] > 0.5, values[:, 1]


@pytest.mark.skipif(gl_context().version_code < 430, reason="this driver has no compute shaders")
@pytest.mark.parametrize("name", OTHERS)
def test_the_shader_has_the_same_image(name):
    limits = Limits.of(OTHERS[name], VisibilityOptions())
    rng = np.random.default_rng(5)
    directions = rng.normal(size=(20_000, 3)) * rng.uniform(0.1, 1000, size=(20_000, 1))
    directions = directions.astype(np.float32).astype(float)
    inside, far_off = by_shader(limits, directions)
    x, y, depth = directions.T
    expected = limits.lens.contains(x, y, depth)
    assert (expected.any() and not expected.all()) or name == "spherical 360 x 180"
    if not isinstance(limits.lens, Pinhole):  # of which the window is the image
        # rounding may decide on a direction at the border
        assert np.count_nonzero(inside != expected) <= 2
    assert far_off == pytest.approx(measured(x, y, depth, limits), rel=1e-6, abs=1e-6)


def test_the_block_is_laid_out_as_the_shader_reads_it():
    offsets = {name: LENS.fields[name][1] for name in LENS.names}
    assert offsets == {
        "image": 0,
        "coefficients": 16,
        "end": 48,
        "kind": 52,
        "by_range": 56,
        "filler": 60,
    }
    assert LENS.itemsize == 64


@pytest.mark.parametrize("name", SENSORS)
def test_a_plain_pinhole_needs_no_block(name):
    limits = Limits.of(SENSORS[name], VisibilityOptions())
    is_plain = isinstance(limits.lens, Pinhole) and not limits.by_range
    assert (lens_uniforms(limits) is None) == is_plain


def test_an_end_at_ninety_degrees_is_a_number():
    (block,) = lens_uniforms(Limits.of(SENSORS["opencv"], VisibilityOptions()))
    assert math.isfinite(block["end"]) and block["end"] > 0
