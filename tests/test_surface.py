"""What goes to the GPU: faces packed for the compute shader, and the text of the shaders."""

import numpy as np
import pytest
from support import shapes

from glvis.errors import MachineError
from glvis.problem.scene import Model
from glvis.visibility import glsl, surface
from glvis.visibility.cast import has_compute
from glvis.visibility.clusters import Clusters
from glvis.visibility.surface import packed


def unpacked(words):
    """Return corners (F, 3, 3) on the lattice, counted from its middle, as the shader does."""
    words = words.astype(np.int64)
    low, high = words & (2**28 - 1), words >> 28
    last = sum(high[:, k] << (4 * k) for k in range(7))
    return np.concatenate([low, last[:, None]], axis=1).reshape(-1, 3, 3) - 2**27


@pytest.mark.parametrize("scale", [1e-3, 1.0, 1e5])
@pytest.mark.parametrize("seed", range(3))
def test_packed_corners_lie_where_they_were_and_stay_shared(seed, scale):
    rng = np.random.default_rng(seed)
    vertices, faces = shapes.blob(rng)
    vertices = scale * (vertices * rng.uniform(0.1, 1, 3) + rng.normal(size=3))
    clusters = Clusters.of(Model.from_arrays("blob", vertices, faces))
    low, high = clusters.model.bounds
    step = (high - low).max() / (2**28 - 2)
    corners = unpacked(packed(clusters)[: len(clusters.order)])
    assert np.abs(corners).max() == 2**27 - 1  # the whole lattice is used, and no more
    places = corners * step + (low + high) / 2
    expected = clusters.model.vertices[clusters.model.faces[clusters.order]]
    assert np.abs(places - expected).max() <= 0.501 * step
    of_vertex = clusters.model.faces[clusters.order].ravel()
    different = np.unique(
        np.concatenate([of_vertex[:, None], corners.reshape(-1, 3)], axis=1), axis=0
    )
    assert len(different) == len(np.unique(of_vertex))


def test_a_model_without_extent_is_packed_too():
    model = Model.from_arrays("flat", [[1, 2, 3], [2, 2, 3], [1, 3, 3]], [[0, 1, 2]])
    corners = unpacked(packed(Clusters.of(model))[:1])
    assert not corners[:, :, 2].any() and corners[0, 0, 0] == -corners[0, 1, 0] != 0


@pytest.fixture
def shader(tmp_path, monkeypatch):
    """Return a function that writes shader files, by name, and returns the text of the first."""
    monkeypatch.setattr(glsl, "SHADER_DIR", tmp_path)

    def written(files, *defines):
        for name, text in files.items():
            (tmp_path / name).write_text(text)
        return glsl.shader_source(next(iter(files)), *defines)

    caches = [glsl.shader_source, surface.compiled_compute]
    for cached in caches:
        cached.cache_clear()
    yield written
    for cached in caches:
        cached.cache_clear()


def test_names_are_defined_under_the_version_line(shader):
    text = shader({"a.glsl": "#version 430 core\nint a;\n"}, "ONE", "TWO 2")
    assert text == "#version 430 core\n#define ONE\n#define TWO 2\n#line 2 0\nint a;\n"


def test_an_included_file_stands_where_its_line_was_and_lines_keep_their_numbers(shader):
    text = shader(
        {"a.glsl": '#version 430 core\n#include "b.glsl"\nint a;\n', "b.glsl": "int b;\n\n"}
    )
    assert text == "#version 430 core\n#line 2 0\n#line 1 1\nint b;\n#line 3 0\nint a;\n"


def test_a_file_stands_once_at_each_place_that_includes_it(shader):
    one = '#include "b.glsl"\n'
    text = shader({"a.glsl": f"#version 430 core\n{one}int a;\n{one}", "b.glsl": "int b;\n"})
    assert text.count("int b;") == 2 and text.endswith("int b;\n#line 5 0\n")


@pytest.mark.parametrize(
    "line", [' #include "b.glsl"', '// #include "b.glsl"', "#include <b.glsl>"]
)
def test_only_a_line_that_is_an_include_and_nothing_else_is_one(line, shader):
    text = shader({"a.glsl": f"#version 430 core\n{line}\n", "b.glsl": "int b;\n"})
    assert text == f"#version 430 core\n#line 2 0\n{line}\n"


def test_an_unknown_file_to_include_is_an_error(shader):
    with pytest.raises(FileNotFoundError, match=r"nowhere\.glsl"):
        shader({"a.glsl": '#version 430 core\n#include "nowhere.glsl"\n'})


@pytest.mark.skipif(not has_compute(), reason="this driver has no compute shaders")
@pytest.mark.parametrize(
    ("own", "included", "line"), [("int a = q;", "int b;", 6), ("", "\nint b = q;", 2)]
)
def test_the_driver_tells_the_line_of_the_file_that_is_wrong(own, included, line, shader):
    own = f'layout(local_size_x = 1) in;\n#include "b.glsl"\n\nvoid main() {{\n{own}\n}}\n'
    shader({"a.comp.glsl": f"#version 430 core\n{own}", "b.glsl": included})
    # Mesa forgets which source string it was
    with pytest.raises(MachineError, match=rf"\b[01][:(]{line}\b"):
        surface.compiled_compute("a")
