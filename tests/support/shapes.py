"""Shapes made by formula: each returns vertices (V, 3) float64 and faces (F, 3) int32.

Closed shapes wind outward. Sizes are full widths unless a name says radius.
"""

from __future__ import annotations

import zipfile
from pathlib import Path

import numpy as np

Shape = tuple[np.ndarray, np.ndarray]


def _shape(vertices, faces) -> Shape:
    return np.asarray(vertices, dtype=float), np.asarray(faces, dtype=np.int32)


def write_off(path: Path, shape: Shape) -> Path:
    """Write a shape as OFF text, exact to the last bit."""
    vertices, faces = shape
    rows = [f"OFF\n{len(vertices)} {len(faces)} 0"]
    rows += [" ".join(map(repr, row)) for row in np.asarray(vertices, dtype=float).tolist()]
    rows += [f"3 {a} {b} {c}" for a, b, c in np.asarray(faces).tolist()]
    path.write_text("\n".join(rows) + "\n")
    return path


def write_3mf(path: Path, shape: Shape, unit: str | None = "millimeter") -> Path:
    """Write a shape as 3MF, one object."""
    vertices, faces = (np.asarray(part).tolist() for part in shape)
    points = "".join(f'<vertex x="{x}" y="{y}" z="{z}"/>' for x, y, z in vertices)
    rows = "".join(f'<triangle v1="{a}" v2="{b}" v3="{c}"/>' for a, b, c in faces)
    of_unit = f'unit="{unit}" ' if unit else ""
    with zipfile.ZipFile(path, "w") as archive:
        archive.writestr(
            "3D/3dmodel.model",
            f'<?xml version="1.0"?><model {of_unit}'
            'xmlns="http://schemas.microsoft.com/3dmanufacturing/core/2015/02"><resources>'
            f'<object id="1" type="model"><mesh><vertices>{points}</vertices>'
            f"<triangles>{rows}</triangles></mesh></object></resources>"
            '<build><item objectid="1"/></build></model>',
        )
    return path


def corners(shape: Shape) -> np.ndarray:
    """Return the triangles' corners, (F, 3, 3)."""
    vertices, faces = shape
    return vertices[faces]


def normals_and_areas(shape: Shape) -> tuple[np.ndarray, np.ndarray]:
    """Return unit normals (F, 3) and areas (F,) of faces that have an area."""
    a, b, c = np.moveaxis(corners(shape), 1, 0)
    cross = np.cross(b - a, c - a)
    double = np.linalg.norm(cross, axis=1)
    return cross / double[:, None], double / 2


def merged(*shapes: Shape) -> Shape:
    """Return several shapes as one; faces keep their order, shape after shape."""
    starts = np.cumsum([0] + [len(vertices) for vertices, _ in shapes[:-1]])
    return _shape(
        np.concatenate([vertices for vertices, _ in shapes]),
        np.concatenate([f + start for (_, f), start in zip(shapes, starts, strict=True)]),
    )


def moved(shape: Shape, offset=(0, 0, 0), rotation=None) -> Shape:
    """Return the shape turned by ``rotation`` (3, 3) and then moved by ``offset``."""
    turn = np.eye(3) if rotation is None else np.asarray(rotation, dtype=float)
    return _shape(shape[0] @ turn.T + np.asarray(offset, dtype=float), shape[1])


def flipped(shape: Shape) -> Shape:
    """Return the shape with its winding turned round: normals point the other way."""
    return _shape(shape[0], shape[1][:, ::-1])


def permuted(shape: Shape, order) -> Shape:
    """Return the shape with its faces in another order."""
    return _shape(shape[0], shape[1][np.asarray(order)])


def triangle(a, b, c) -> Shape:
    """Return one triangle."""
    return _shape([a, b, c], [[0, 1, 2]])


def cube(size: float = 1.0, center=(0, 0, 0)) -> Shape:
    """Return a cube of twelve faces, in pairs: -x, +x, -y, +y, -z, +z."""
    vertices = np.array([[x, y, z] for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)])
    quads = [(0, 1, 3, 2), (4, 6, 7, 5), (0, 4, 5, 1), (2, 3, 7, 6), (0, 2, 6, 4), (1, 5, 7, 3)]
    faces = [face for a, b, c, d in quads for face in ((a, b, c), (a, c, d))]
    return _shape(vertices * size / 2 + np.asarray(center, dtype=float), faces)


def plate(
    width: float = 1.0,
    height: float | None = None,
    center=(0, 0, 0),
    tilt_deg: float = 0.0,
    cells: tuple[int, int] = (1, 1),
) -> Shape:
    """Return a rectangle in the plane z = const with normal +z, tilted about its own x axis.

    ``cells`` along x and y, two faces each; rows go up from the lower left corner. A positive
    tilt turns the normal from +z towards -y.
    """
    height = width if height is None else height
    nx, ny = cells
    x, y = np.meshgrid(np.linspace(-0.5, 0.5, nx + 1), np.linspace(-0.5, 0.5, ny + 1))
    flat = np.stack([width * x.ravel(), height * y.ravel(), np.zeros(x.size)], axis=1)
    tilt = np.radians(tilt_deg)
    cos, sin = np.cos(tilt), np.sin(tilt)
    turn = np.array([[1, 0, 0], [0, cos, -sin], [0, sin, cos]])
    corner = np.add.outer(np.arange(ny) * (nx + 1), np.arange(nx)).ravel()
    a, b, c, d = corner, corner + 1, corner + nx + 2, corner + nx + 1
    faces = np.stack([a, b, c, a, c, d], axis=1).reshape(-1, 3)
    return moved(_shape(flat, faces), center, turn)


def icosphere(subdivisions: int = 2, radius: float = 1.0, center=(0, 0, 0)) -> Shape:
    """Return a sphere of 20 * 4^subdivisions faces, every vertex at ``radius``."""
    g = (1 + 5**0.5) / 2
    vertices = np.array(
        [
            *((-1, g, 0), (1, g, 0), (-1, -g, 0), (1, -g, 0)),
            *((0, -1, g), (0, 1, g), (0, -1, -g), (0, 1, -g)),
            *((g, 0, -1), (g, 0, 1), (-g, 0, -1), (-g, 0, 1)),
        ]
    ) / np.hypot(1, g)
    faces = np.array(
        [
            *((0, 11, 5), (0, 5, 1), (0, 1, 7), (0, 7, 10), (0, 10, 11)),
            *((1, 5, 9), (5, 11, 4), (11, 10, 2), (10, 7, 6), (7, 1, 8)),
            *((3, 9, 4), (3, 4, 2), (3, 2, 6), (3, 6, 8), (3, 8, 9)),
            *((4, 9, 5), (2, 4, 11), (6, 2, 10), (8, 6, 7), (9, 8, 1)),
        ]
    )
    for _ in range(subdivisions):
        edges = np.sort(faces[:, [[0, 1], [1, 2], [2, 0]]], axis=2).reshape(-1, 2)
        unique, which = np.unique(edges, axis=0, return_inverse=True)
        middle = vertices[unique].mean(axis=1)
        middle /= np.linalg.norm(middle, axis=1, keepdims=True)
        ab, bc, ca = (which.reshape(-1, 3) + len(vertices)).T
        a, b, c = faces.T
        faces = np.stack([a, ab, ca, b, bc, ab, c, ca, bc, ab, bc, ca], axis=1).reshape(-1, 3)
        vertices = np.concatenate([vertices, middle])
    return _shape(vertices * radius + np.asarray(center, dtype=float), faces)


def _grid_faces(nu: int, nv: int, wrap_u: bool, wrap_v: bool) -> np.ndarray:
    """Return the faces of a grid of vertices u * nv + v."""
    u = np.arange(nu if wrap_u else nu - 1)[:, None]
    v = np.arange(nv if wrap_v else nv - 1)[None, :]
    u1, v1 = (u + 1) % nu, (v + 1) % nv
    a, b, c, d = (
        np.broadcast_arrays(p * nv + q, u * v)[0].ravel()
        for p, q in ((u, v), (u1, v), (u1, v1), (u, v1))
    )
    return np.stack([a, b, c, a, c, d], axis=1).reshape(-1, 3)


def torus(major: float = 1.0, minor: float = 0.35, nu: int = 32, nv: int = 16) -> Shape:
    """Return a torus about z: a closed shape that hides parts of itself."""
    u, v = np.meshgrid(
        2 * np.pi * np.arange(nu) / nu, 2 * np.pi * np.arange(nv) / nv, indexing="ij"
    )
    ring = major + minor * np.cos(v)
    vertices = np.stack([ring * np.cos(u), ring * np.sin(u), minor * np.sin(v)], axis=-1)
    return _shape(vertices.reshape(-1, 3), _grid_faces(nu, nv, True, True))


def tube(radius: float = 1.0, length: float = 3.0, nu: int = 24, nv: int = 9) -> Shape:
    """Return a cylinder's side about z, open at both ends, normals outward."""
    u, z = np.meshgrid(
        2 * np.pi * np.arange(nu) / nu, np.linspace(-length / 2, length / 2, nv), indexing="ij"
    )
    vertices = np.stack([radius * np.cos(u), radius * np.sin(u), z], axis=-1)
    return _shape(vertices.reshape(-1, 3), _grid_faces(nu, nv, True, False))


def blob(rng: np.random.Generator, subdivisions: int = 3, radius: float = 1.0) -> Shape:
    """Return a closed, dented body: a sphere whose radius waves between half and one and a half."""
    vertices, faces = icosphere(subdivisions)
    waves = rng.normal(size=(4, 3)) * 3
    phases = rng.uniform(0, 2 * np.pi, size=4)
    height = 1 + 0.125 * np.cos(vertices @ waves.T + phases).sum(axis=1)
    return _shape(vertices * (radius * height)[:, None], faces)


def soup(rng: np.random.Generator, n: int = 200, size: float = 0.3, spread: float = 1.0) -> Shape:
    """Return n separate triangles in no order: open, pierced, seen from both sides."""
    centres = rng.uniform(-spread, spread, size=(n, 1, 3))
    vertices = centres + rng.normal(scale=size, size=(n, 3, 3))
    return _shape(vertices.reshape(-1, 3), np.arange(3 * n).reshape(-1, 3))
