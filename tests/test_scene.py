"""Models: shapes whose every number is known, every format, every broken file."""

import json
import pickle
import struct

import numpy as np
import pytest
from support.shapes import (
    corners,
    cube,
    flipped,
    icosphere,
    merged,
    permuted,
    plate,
    soup,
    torus,
    write_3mf,
)

from glvis.problem.scene import SUFFIXES, Model, load_model


def model(shape, name="shape", **options) -> Model:
    return Model.from_arrays(name, *shape, **options)


def binary_stl(triangles, header=b"", promised=None, tail=b"") -> bytes:
    """Return a binary STL of corners (F, 3, 3), all normals zero."""
    count = len(triangles) if promised is None else promised
    rows = b"".join(
        struct.pack("<12fH", 0, 0, 0, *np.asarray(t, dtype=np.float32).ravel(), 0)
        for t in triangles
    )
    return header.ljust(80, b"\0") + struct.pack("<I", count) + rows + tail


def ascii_stl(triangles, name="part") -> str:
    facets = "".join(
        "facet normal 0 0 0\nouter loop\n"
        + "".join(f"vertex {x!r} {y!r} {z!r}\n" for x, y, z in np.asarray(t, dtype=float).tolist())
        + "endloop\nendfacet\n"
        for t in triangles
    )
    return f"solid {name}\n{facets}endsolid {name}\n"


@pytest.fixture
def saved(tmp_path):
    """Write a file and return the model in it."""

    def save(name, content, **options):
        path = tmp_path / name
        if isinstance(content, str):
            content = content.encode()
        path.write_bytes(content)
        return load_model(path, **options)

    return save


def test_cube_has_the_numbers_of_a_cube():
    box = model(cube(2.0, center=(5, 0, 0)), "box")
    assert (box.name, box.path, box.n_faces, len(box.vertices)) == ("box", None, 12, 8)
    np.testing.assert_allclose(box.areas, 2.0)
    np.testing.assert_allclose(box.bounds, [[4, -1, -1], [6, 1, 1]])
    np.testing.assert_allclose(np.abs(box.normals).max(axis=1), 1.0)
    outward = np.einsum("ij,ij->i", box.normals, box.centroids - [5, 0, 0])
    np.testing.assert_allclose(outward, 1.0)
    assert box.mean_edge == pytest.approx((2 + 2 + 2 * np.sqrt(2)) / 3)


@pytest.mark.parametrize("shape", [cube(), icosphere(2), torus()])
def test_closed_shapes_are_closed_and_consistent(shape):
    closed = model(shape)
    assert closed.is_closed and closed.is_consistent
    assert (closed.boundary_edges, closed.inconsistent_edges) == (0, 0)


def test_a_cube_without_one_side_has_four_boundary_edges():
    vertices, faces = cube()
    middle = model((vertices, faces)).centroids
    box = model((vertices, faces[middle[:, 2] < 0.4]))
    assert (box.n_faces, box.boundary_edges, box.is_closed) == (10, 4, False)
    assert box.is_consistent


def test_one_flipped_face_makes_three_edges_inconsistent():
    vertices, faces = cube()
    faces = faces.copy()
    faces[3] = faces[3][::-1]
    box = model((vertices, faces))
    assert box.is_closed and not box.is_consistent
    assert box.inconsistent_edges == 3


def test_three_faces_at_one_edge_are_not_closed():
    fins = [[(0, 0, 0), (0, 0, 1), tip] for tip in ((1, 0, 0), (-1, 1, 0), (-1, -1, 0))]
    fan = Model.from_arrays("fan", np.reshape(fins, (9, 3)), np.arange(9).reshape(3, 3))
    assert len(fan.vertices) == 5
    assert not fan.is_closed and not fan.is_consistent
    assert (fan.boundary_edges, fan.inconsistent_edges) == (6, 2)


def test_turning_the_winding_round_turns_the_normals():
    np.testing.assert_allclose(model(flipped(cube())).normals, -model(cube()).normals)


def test_a_face_without_area_stays_and_has_no_normal():
    vertices, faces = cube()
    broken = np.concatenate([faces[:5], [[2, 2, 3]], faces[5:]])
    box = model((vertices, broken))
    assert box.n_faces == 13
    assert box.areas[5] == 0
    np.testing.assert_array_equal(box.normals[5], 0)
    np.testing.assert_array_equal(np.delete(box.normals, 5, axis=0), model(cube()).normals)


def test_scale_multiplies_lengths():
    small, large = model(cube()), model(cube(), scale=25.4)
    np.testing.assert_allclose(large.vertices, small.vertices * 25.4)
    assert large.mean_edge == pytest.approx(25.4 * small.mean_edge)
    np.testing.assert_allclose(large.normals, small.normals)


def test_arrays_cannot_be_written():
    box = model(cube())
    names = ("vertices", "faces", "areas", "normals", "centroids", "bounds")
    for array in (getattr(box, name) for name in names):
        with pytest.raises(ValueError, match="read-only"):
            array[0] = 0


def test_types_are_those_the_renderer_reads():
    box = model((cube()[0].astype(np.float32), cube()[1].astype(np.uint64)))
    assert (box.vertices.dtype, box.faces.dtype) == (np.float64, np.int32)
    whole = Model.from_arrays("t", [[0, 0, 0], [1, 0, 0], [0, 1, 0]], [[0, 1, 2]])
    assert whole.areas.tolist() == [0.5]


@pytest.mark.parametrize("seed", range(20))
def test_merging_changes_no_corner_and_leaves_no_twin(seed):
    rng = np.random.default_rng(seed)
    dtype = (np.float32, np.float64)[seed % 2]
    points = rng.integers(-4, 5, size=(150, 3)).astype(dtype) / dtype(7)
    points[rng.random(points.shape) < 0.1] *= dtype(-0.0)
    faces = rng.integers(0, len(points), size=(400, 3))
    found = Model.from_arrays("m", points, faces)
    np.testing.assert_array_equal(found.vertices[found.faces], points[faces].astype(float))
    assert len(np.unique(found.vertices, axis=0)) == len(found.vertices)
    assert set(found.faces.ravel()) == set(range(len(found.vertices)))


@pytest.mark.parametrize("seed", range(5))
def test_permuting_and_repeating_faces_permutes_the_model(seed):
    rng = np.random.default_rng(seed)
    shape = merged(soup(rng, 60), icosphere(1))
    order = rng.integers(0, len(shape[1]), size=300)
    one, other = model(shape), model(permuted(shape, order))
    for name in ("areas", "normals", "centroids"):
        np.testing.assert_array_equal(getattr(other, name), getattr(one, name)[order])


def test_vertices_that_repeat_nowhere_keep_their_numbers():
    vertices, faces = icosphere(2)
    np.testing.assert_array_equal(model((vertices, faces)).faces, faces)
    np.testing.assert_array_equal(model((vertices, faces)).vertices, vertices)


def test_vertices_that_no_face_uses_are_dropped_whatever_they_are():
    vertices, faces = cube()
    far = np.array([[1e6, 0, 0], [np.nan, np.inf, 0]])
    box = Model.from_arrays("box", np.concatenate([far, vertices]), faces + 2)
    np.testing.assert_array_equal(box.vertices, vertices)
    np.testing.assert_array_equal(box.faces, faces)


def test_points_that_differ_in_the_last_bit_stay_apart():
    a = np.float32(1)
    points = np.array([[a, 0, 0], [np.nextafter(a, np.float32(2)), 0, 0], [0, 1, 0]], np.float32)
    assert len(Model.from_arrays("m", points, [[0, 1, 2]]).vertices) == 3


def test_binary_stl_comes_back_face_by_face(saved):
    sphere = icosphere(2)
    found = saved("ball.stl", binary_stl(corners(sphere)))
    assert found.name == "ball" and found.path.name == "ball.stl"
    assert found.is_closed and len(found.vertices) == len(sphere[0])
    single = corners(sphere).astype(np.float32)
    np.testing.assert_array_equal(found.vertices[found.faces], single)


def test_ascii_stl_comes_back_face_by_face_in_full_precision(saved):
    sphere = icosphere(1)
    text = ascii_stl(corners(sphere)[:30]) + ascii_stl(corners(sphere)[30:], "a second facet")
    found = saved("ball.stl", text)
    np.testing.assert_array_equal(found.vertices[found.faces], corners(sphere))
    shouted = saved("loud.STL", text.upper().replace("\n", "\r\n"))
    np.testing.assert_array_equal(shouted.vertices[shouted.faces], corners(sphere))


def test_binary_stl_that_starts_with_solid_is_read_as_binary(saved):
    assert saved("a.stl", binary_stl(corners(cube()), header=b"solid exported")).n_faces == 12


def test_ascii_stl_may_start_with_a_byte_order_mark(saved):
    assert saved("a.stl", "\ufeff" + ascii_stl(corners(cube()))).n_faces == 12


def test_a_large_stl_has_one_vertex_where_its_faces_meet(saved):
    n = 200
    x, y = np.meshgrid(np.arange(n + 1.0), np.arange(n + 1.0), indexing="ij")
    points = np.stack([x, y, np.sin(x) * np.cos(y)], axis=-1).reshape(-1, 3)
    first = (np.arange(n)[:, None] * (n + 1) + np.arange(n)).ravel()
    quads = np.stack([first, first + n + 1, first + n + 2, first + 1], axis=1)
    faces = np.concatenate([quads[:, [0, 1, 2]], quads[:, [0, 2, 3]]])
    facets = np.zeros(len(faces), dtype="(12,)<f4, <u2")
    facets["f0"][:, 3:] = points[faces].reshape(-1, 9)
    head = b"\0" * 80 + struct.pack("<I", len(faces))
    found = saved("sheet.stl", head + facets.tobytes())
    assert len(found.vertices) == (n + 1) ** 2
    assert found.boundary_edges == 4 * n and found.is_consistent
    np.testing.assert_array_equal(found.vertices[found.faces], points.astype(np.float32)[faces])


def test_a_few_bytes_of_padding_after_a_binary_stl_do_not_matter(saved):
    assert saved("a.stl", binary_stl(corners(cube()), tail=b"\0\0\xff")).n_faces == 12


QUADS = [(0, 1, 2, 3), (7, 6, 5, 4), (0, 4, 5, 1), (1, 5, 6, 2), (2, 6, 7, 3)]
TRIANGLES = [(3, 7, 4), (3, 4, 0)]
SQUARES = [(x, y, z) for z in (0, 1) for x, y in ((0, 0), (0, 1), (1, 1), (1, 0))]
IN_ORDER = [
    *((0, 1, 2), (0, 2, 3), (7, 6, 5), (7, 5, 4), (3, 7, 4), (0, 4, 5), (0, 5, 1)),
    *((1, 5, 6), (1, 6, 2), (2, 6, 7), (2, 7, 3), (3, 4, 0)),
]
MIXED = [*QUADS[:2], TRIANGLES[0], *QUADS[2:], TRIANGLES[1]]


def obj(polygons, between="") -> str:
    lines = [f"v {x} {y} {z} 0.5 0.5 0.5" for x, y, z in SQUARES]
    lines += ["vn 0 0 1", "vt 0 0"]
    for p in polygons:
        lines += [between, "f " + " ".join(f"{c + 1}/1/1" for c in p)]
    return "\n".join(lines)


def off(polygons, header="OFF\n") -> str:
    lines = [f"{header}{len(SQUARES)} {len(polygons)} 0  # counts"]
    lines += [f"{x} {y} {z}" for x, y, z in SQUARES]
    lines += [f"{len(p)} {' '.join(map(str, p))} 255 0 0" for p in polygons]
    return "\n".join(lines)


def ply(polygons, binary=False) -> bytes:
    kind = "binary_little_endian" if binary else "ascii"
    head = (
        f"ply\nformat {kind} 1.0\nelement vertex {len(SQUARES)}\nproperty float x\n"
        f"property float y\nproperty float z\nelement face {len(polygons)}\n"
        "property list uchar int vertex_indices\nend_header\n"
    ).encode()
    if binary:
        body = b"".join(struct.pack("<3f", *v) for v in SQUARES)
        return head + body + b"".join(struct.pack(f"<B{len(p)}i", len(p), *p) for p in polygons)
    rows = [" ".join(map(str, v)) for v in SQUARES]
    rows += [f"{len(p)} {' '.join(map(str, p))}" for p in polygons]
    return head + "\n".join(rows).encode() + b"\n"


@pytest.mark.parametrize(
    ("name", "content"),
    [
        ("mixed.obj", obj(MIXED)),
        ("materials.obj", obj(MIXED, between="usemtl red\ng left\nusemtl blue\no thing")),
        ("mixed.off", off(MIXED)),
        ("inline.off", off(MIXED, header="OFF ")),
        ("mixed.ply", ply(MIXED)),
    ],
)
def test_polygons_become_triangles_where_they_stand_in_the_file(saved, name, content):
    found = saved(name, content)
    np.testing.assert_array_equal(found.vertices[found.faces], np.array(SQUARES)[IN_ORDER])


@pytest.mark.parametrize("binary", [False, True])
@pytest.mark.parametrize("polygons", [QUADS, [*TRIANGLES, *IN_ORDER]])
def test_ply_of_equal_polygons_keeps_their_order(saved, polygons, binary):
    found = saved("some.ply", ply(polygons, binary))
    expected = saved("some.off", off(polygons))
    np.testing.assert_array_equal(found.vertices[found.faces], expected.vertices[expected.faces])


def test_obj_may_count_backwards_and_break_its_lines(saved):
    found = saved("a.obj", "v 0 0 0\nv 1 0 0\nv 0 1 \\\n0\nf -3 -2 -1\nv 0 0 1\nf 1 -1 2\n")
    np.testing.assert_array_equal(found.faces, [[0, 1, 2], [0, 3, 1]])


def glb(nodes, meshes) -> bytes:
    """Return a GLB of triangle soups: nodes as glTF has them, meshes as corners (F, 3, 3)."""
    blob, accessors, views = b"", [], []
    for triangles in meshes:
        data = np.asarray(triangles, dtype="<f4").reshape(-1, 3)
        views.append({"buffer": 0, "byteOffset": len(blob), "byteLength": data.nbytes})
        accessors.append(
            {
                "bufferView": len(views) - 1,
                "componentType": 5126,
                "count": len(data),
                "type": "VEC3",
                "min": data.min(axis=0).tolist(),
                "max": data.max(axis=0).tolist(),
            }
        )
        blob += data.tobytes()
    tree = {
        "asset": {"version": "2.0"},
        "scene": 0,
        "scenes": [{"nodes": list(range(len(nodes)))}],
        "nodes": nodes,
        "meshes": [{"primitives": [{"attributes": {"POSITION": i}}]} for i in range(len(meshes))],
        "accessors": accessors,
        "bufferViews": views,
        "buffers": [{"byteLength": len(blob)}],
    }
    text = json.dumps(tree).encode()
    text += b" " * (-len(text) % 4)
    chunks = struct.pack("<I4s", len(text), b"JSON") + text
    chunks += struct.pack("<I4s", len(blob), b"BIN\0") + blob
    return struct.pack("<4sII", b"glTF", 2, 12 + len(chunks)) + chunks


def test_glb_parts_come_in_the_order_of_the_file_and_where_it_puts_them(saved):
    parts = [corners(cube()), corners(plate()), corners(icosphere(1))]
    nodes = [{"mesh": 0, "translation": [10, 0, 0]}, {"mesh": 1}, {"mesh": 2, "scale": [2, 2, 2]}]
    found = saved("scene.glb", glb(nodes, parts))
    expected = np.concatenate([parts[0] + [10, 0, 0], parts[1], parts[2] * 2])
    np.testing.assert_allclose(found.vertices[found.faces], expected, atol=1e-6)


def test_glb_keeps_faces_without_area(saved):
    triangles = corners(cube()).copy()
    triangles[4] = triangles[4][0]
    found = saved("flat.glb", glb([{"mesh": 0}], [triangles]))
    assert found.n_faces == 12
    assert np.flatnonzero(found.areas == 0).tolist() == [4]


def test_3mf_comes_back_face_by_face(saved, tmp_path):
    vertices, faces = cube()
    write_3mf(tmp_path / "box.3mf", (vertices, faces))
    found = load_model(tmp_path / "box.3mf")
    np.testing.assert_array_equal(found.vertices[found.faces], corners((vertices, faces)))


NAN_STL = corners(cube()).copy()
NAN_STL[7, 1, 2] = np.nan
FAR_STL = corners(cube()).copy()
FAR_STL[3] = 1e30
FLAT_STL = np.zeros((4, 3, 3))


@pytest.mark.parametrize(
    ("name", "content", "message"),
    [
        ("a.stl", b"", "is empty"),
        ("a.obj", b"", "is empty"),
        ("a.step", b"x", "has the suffix '.step'; meshes can be read from .stl, .obj, .ply, "),
        ("a", b"x", "has the suffix ''; meshes can be read from .stl"),
        ("a.stl", "hello\nworld\n", "is text but no STL: it does not start with 'solid'"),
        ("a.stl", b"\0\1\2", "is cut short: 3 bytes are less than the header of a binary STL"),
        (
            "a.stl",
            binary_stl(corners(cube()))[:400],
            "is cut short: it promises 12 faces and holds 6",
        ),
        (
            "a.stl",
            binary_stl(corners(cube()), promised=3),
            "promises 3 faces and holds 12: is it an STL?",
        ),
        ("a.stl", binary_stl([]), "has no faces"),
        ("a.stl", "solid nothing\nendsolid nothing\n", "has no faces"),
        (
            "a.stl",
            ascii_stl(corners(cube()))[:900],
            "is cut short: an ASCII STL ends with 'endsolid'",
        ),
        (
            "a.stl",
            ascii_stl(corners(cube())).replace("endfacet", "", 1),
            "is cut short: 11 of 12 facets end, as an ASCII STL must",
        ),
        (
            "a.stl",
            ascii_stl(corners(cube())).replace("vertex", "vortex", 1),
            "is broken: 12 facets have 35 vertices",
        ),
        (
            "a.stl",
            ascii_stl(corners(cube())).replace("vertex 0.5", "vertex O.5", 1),
            "is broken: 'o.5' is no number",
        ),
        (
            "a.stl",
            binary_stl(NAN_STL),
            "has impossible vertices in 1 of 12 faces: face 7 at (",
        ),
        (
            "a.stl",
            binary_stl(FAR_STL),
            "has impossible vertices in 1 of 12 faces: face 3 at (1e+30, 1e+30, 1e+30)",
        ),
        (
            "a.stl",
            ascii_stl(corners(cube())).replace("vertex 0.5", "vertex inf", 1),
            "has impossible vertices in 1 of 12 faces: face 2 at (inf, -0.5, -0.5)",
        ),
        ("a.stl", binary_stl(FLAT_STL), "has 4 faces and none of them has any area"),
        ("a.obj", "v 0 0 0\nv 1 0 0\nv 0 1 0\n", "has no faces"),
        ("a.obj", "v 0 0 0\nv 1 0 x\n", "line 2 is broken: 'v 1 0 x'"),
        ("a.obj", "v 0 0\n", "line 1 is broken: 'v 0 0'"),
        ("a.obj", "v 0 0 0\nf 1 1\n", "line 2 is broken: 'f 1 1'"),
        ("a.obj", "v 0 0 0\nf 0 1 1\n", "line 2 is broken: 'f 0 1 1'"),
        (
            "a.obj",
            "v 0 0 0\nv 1 0 0\nf 1 2 9\n",
            "has a face 0 of vertices [0, 1, 8], but only 2 vertices",
        ),
        ("a.off", "hello\n", "is no OFF in text form: it does not start with 'OFF'"),
        ("a.off", "OFF BINARY\n1 2 3\n", "is no OFF in text form"),
        ("a.off", "OFF\n", "is a broken OFF: it does not say how many vertices and faces"),
        (
            "a.off",
            off(MIXED)[:60],
            "is cut short: it promises 8 vertices and 7 faces and holds 7 lines",
        ),
        ("a.off", "OFF\n1 1 0\n0 0 0\n4 0 0\n", "a face has fewer corners than it promises"),
        ("a.off", "OFF\n1 1 0\n0 0 zero\n3 0 0 0\n", "is a broken OFF: could not convert"),
        ("a.ply", b"hello\n", "cannot be read as PLY: Not a ply file!"),
        ("a.ply", ply(MIXED, binary=True)[:-9], "cannot be read as PLY: PLY is unexpected length!"),
        ("a.ply", ply([(0, 1, 99)]), "has a face 0 of vertices [0, 1, 99], but only 8 vertices"),
        ("a.glb", b"hello\n" * 20, "cannot be read as GLB: incorrect header on GLB file"),
        ("a.glb", glb([{}], []), "has no faces"),
        ("a.3mf", b"hello\n", "cannot be read as 3MF: "),
    ],
)
def test_what_is_no_mesh_says_why(saved, name, content, message):
    with pytest.raises(ValueError) as caught:
        saved(name, content)
    assert message in str(caught.value)
    assert "\n" not in str(caught.value)


def test_missing_files_and_folders_say_so(tmp_path):
    with pytest.raises(ValueError, match=r"^does not exist$"):
        load_model(tmp_path / "none.stl")
    (tmp_path / "folder.stl").mkdir()
    with pytest.raises(ValueError, match=r"^is not a file$"):
        load_model(tmp_path / "folder.stl")


def test_a_file_that_may_not_be_read_says_so(tmp_path, monkeypatch):
    path = tmp_path / "secret.stl"
    path.write_bytes(binary_stl(corners(cube())))

    def refuse(*args, **kwargs):
        raise PermissionError(13, "Permission denied")

    monkeypatch.setattr(type(path), "open", refuse)  # root may read whatever chmod says
    with pytest.raises(ValueError, match=r"^cannot be read: Permission denied$"):
        load_model(path)


def test_a_reader_that_is_not_installed_is_named(saved, monkeypatch):
    def load_scene(*args, **kwargs):
        raise ModuleNotFoundError("No module named 'lxml'")  # trimesh's has no ``name``

    monkeypatch.setattr("trimesh.load_scene", load_scene)
    message = r"^cannot be read as 3MF: No module named 'lxml'$"
    with pytest.raises(ValueError, match=message):
        saved("a.3mf", b"PK")


@pytest.mark.parametrize(
    ("vertices", "faces", "options", "message"),
    [
        (np.zeros((0, 3)), np.zeros((0, 3), int), {}, "has no faces"),
        (np.zeros((3, 2)), [[0, 1, 2]], {}, r"needs vertices \(V, 3\) and faces \(F, 3\)"),
        (np.zeros((3, 3)), [[0, 1, 2, 0]], {}, r"got \(3, 3\) and \(1, 4\)"),
        (np.eye(3), [[0.0, 1.0, 2.0]], {}, "faces must be whole numbers, got float64"),
        (np.eye(3), [[0, 1, -1]], {}, r"has a face 0 of vertices \[0, 1, -1\]"),
        (np.eye(3), [[0, 1, 2]], {"scale": 0.0}, "scale = 0 must be greater than 0"),
        (np.eye(3), [[0, 1, 2]], {"scale": np.inf}, "scale = inf must be greater than 0"),
        (np.eye(3), [[0, 1, 2]], {"scale": 1e13}, "has impossible vertices in 1 of 1 faces"),
    ],
)
def test_arrays_that_are_no_mesh_say_why(vertices, faces, options, message):
    with pytest.raises(ValueError, match=message):
        Model.from_arrays("m", vertices, faces, **options)


def test_every_suffix_is_tried_above():
    assert set(SUFFIXES) == {".stl", ".obj", ".ply", ".off", ".glb", ".3mf"}


def test_the_real_arms_are_consistent_and_nearly_closed(shared_data):
    for path in sorted((shared_data / "arms").glob("arm*.stl")):
        arm = load_model(path)
        facets = (path.stat().st_size - 84) // 50
        assert arm.n_faces == facets
        assert arm.is_consistent
        assert 0 < arm.boundary_edges < 100  # cut off above the wrist
        assert 2 < arm.mean_edge < 6


def test_other_processes_are_sent_only_what_the_rest_follows_from():
    ball = model(icosphere(3))
    before, centroids = len(pickle.dumps(ball)), ball.centroids
    assert ball.is_closed and ball.areas.any() and len(pickle.dumps(ball)) == before
    assert np.array_equal(pickle.loads(pickle.dumps(ball)).centroids, centroids)
