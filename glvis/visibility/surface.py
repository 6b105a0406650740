"""Models on the GPU: what a draw and a cast take of them, and the programs that do it.

What is fast on a software rasteriser: few vertices, in an order that keeps neighbours together,
and indices of no more faces than can show. Faces come sorted by cluster; a draw of IDs makes
vertex i the last one of face i, so that it can carry what belongs to the face. A cast wants few
fetches: two a face, in which its corners are packed.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import cache
from typing import Any

import moderngl
import numpy as np
from numpy.typing import NDArray

from glvis.errors import MachineError
from glvis.visibility.clusters import Clusters
from glvis.visibility.context import gl_context, gl_info
from glvis.visibility.glsl import shader_source

Floats = NDArray[np.float64]
Bools = NDArray[np.bool_]

VERTEX = np.dtype([("position", "f4", 3), ("face_id", "u4"), ("normal", "f4", 3)])
# As the shaders have it: words of a packed face, bits of a coordinate; faces and clusters a line
# of their textures.
_WORDS, _BITS, _FACES_A_LINE = 8, 28, 2048
_CLUSTERS_A_LINE = 1024
_FORMATS = {"position": "3f", "face_id": "1u", "normal": "3f"}  # as moderngl writes them


class Surface:
    """One model on the GPU, in the layout of each kind of draw that was asked for.

    Parameters
    ----------
    clusters : Clusters
        The model, its faces sorted.
    origin : (3,) float64
        World point that float32 positions are relative to.
    is_target : bool
        Whether faces are counted; the ID of an obstacle's faces is 0.

    Attributes
    ----------
    lattice : tuple of float
        Where packed corners lie: the lattice's middle relative to the origin, and its step.
    """

    def __init__(self, clusters: Clusters, origin: Floats, is_target: bool) -> None:
        self.clusters, self._origin, self._is_target = clusters, origin, is_target
        self._layouts: dict[str, Layout] = {}
        self._textures: dict[str, Any] = {}
        middle, step = _lattice(clusters)
        self.lattice = (*(middle - origin).tolist(), step)

    def draw(self, program: Any, mask: Bools) -> None:
        """Draw chosen clusters (C,) bool, if any."""
        if not mask.any():
            return
        self._layout("ids" if "face_id" in program else "positions").draw(program, mask)

    def use_packed(self, unit: int) -> None:
        """Bind the faces' corners as a texture, for the shaders that cast."""
        self._use("packed", unit, lambda: (packed(self.clusters), _FACES_A_LINE, _WORDS // 4))

    def use_centres(self, unit: int) -> None:
        """Bind the faces' centres of mass, longest edges and normals, two texels a face."""
        self._use("centres", unit, lambda: (self._centres(), _FACES_A_LINE, 2))

    def use_boxes(self, unit: int) -> None:
        """Bind the box around each cluster, two texels each: see keep.comp.glsl."""
        self._use("boxes", unit, lambda: (self._boxes(), _CLUSTERS_A_LINE, 2))

    def release(self) -> None:
        """Give the GPU's memory back."""
        for part in (*self._layouts.values(), *self._textures.values()):
            part.release()
        self._layouts.clear()
        self._textures.clear()

    def _use(self, name: str, unit: int, rows: Callable[[], tuple[NDArray[Any], int, int]]) -> None:
        """Bind a texture, made when first used of rows, rows a line and texels a row."""
        if name not in self._textures:
            self._textures[name] = _texture(*rows())
        self._textures[name].use(unit)

    def _centres(self) -> NDArray[np.uint32]:
        """Return centre, edge and normal of each face in the order of the clusters, (F', 8)."""
        model, order = self.clusters.model, self.clusters.order
        rows = np.zeros((len(order), 8), dtype=np.float32)
        rows[:, :3] = model.centroids[order] - self._origin
        rows[:, 3] = self.clusters.table.longest
        rows[:, 4:7] = model.normals[order]
        return rows.view(np.uint32)

    def _boxes(self) -> NDArray[np.float32]:
        """Return middle and half extent of the box around each cluster, (C, 8)."""
        low, high = self.clusters.box
        rows = np.zeros((len(low), 8), dtype=np.float32)
        rows[:, :3] = (low + high) / 2 - self._origin
        rows[:, 4:7] = (high - low) / 2
        return rows

    def _layout(self, name: str) -> Layout:
        if name not in self._layouts:
            if name == "ids":
                rows = _provoking_layout(self.clusters, self._origin, self._is_target)
            else:
                rows = _position_layout(self.clusters, self._origin)
            self._layouts[name] = Layout(*rows)
        return self._layouts[name]


class Layout:
    """Vertices that stay on the GPU, and room for the indices of one draw."""

    def __init__(self, vertices: NDArray[np.void], indices: NDArray[np.uint32]) -> None:
        context = gl_context()
        self._faces = indices
        self._names = vertices.dtype.names or ()
        self._vertices = context.buffer(vertices)
        self._indices = context.buffer(reserve=indices.nbytes, dynamic=True)
        self._arrays: dict[Any, Any] = {}

    def draw(self, program: Any, mask: Bools) -> None:
        """Draw the chosen ones of equal runs of faces, as many as the mask is long."""
        chosen = self._faces.reshape(len(mask), -1).take(np.flatnonzero(mask), axis=0)
        if not chosen.size:
            return
        if program not in self._arrays:
            content = " ".join(_FORMATS[name] for name in self._names)
            self._arrays[program] = gl_context().vertex_array(
                program, [(self._vertices, content, *self._names)], self._indices
            )
        self._indices.write(chosen)
        self._arrays[program].render(moderngl.TRIANGLES, vertices=chosen.size)

    def release(self) -> None:
        """Give the GPU's memory back."""
        for part in (*self._arrays.values(), self._indices, self._vertices):
            part.release()


def _provoking_layout(
    clusters: Clusters, origin: Floats, is_target: bool
) -> tuple[NDArray[np.void], NDArray[np.uint32]]:
    """Return vertices and (F', 3) indices in which vertex i is the last one of face i.

    OpenGL takes flat attributes from the last vertex of a triangle, so vertex i may carry what
    belongs to face i and still serve its neighbours as a mere position: about one vertex a
    face instead of three, and neighbours lie side by side.
    """
    model = clusters.model
    faces = model.faces[clusters.order]
    n = len(faces)
    serves = np.full(len(model.vertices), -1, dtype=np.int64)
    serves[faces[:, 2]] = np.arange(n)
    used = np.zeros(len(model.vertices), dtype=bool)
    used[faces[:, :2]] = True
    extra = np.flatnonzero(used & (serves < 0))  # never the last vertex of a face
    serves[extra] = n + np.arange(len(extra))
    vertices = np.zeros(n + len(extra), dtype=VERTEX)
    vertices["position"][:n] = model.vertices[faces[:, 2]] - origin
    vertices["position"][n:] = model.vertices[extra] - origin
    if is_target:
        vertices["face_id"][:n] = clusters.order + 1
        vertices["normal"][:n] = model.normals[clusters.order]
    indices = np.zeros((n, 3), dtype=np.uint32)
    indices[:, :2] = serves[faces[:, :2]]
    indices[:, 2] = np.arange(n)
    return vertices, indices


def _position_layout(
    clusters: Clusters, origin: Floats
) -> tuple[NDArray[np.void], NDArray[np.uint32]]:
    """Return vertices, each once and in the order the faces come to them, and (F', 3) indices."""
    faces = clusters.model.faces[clusters.order]
    corners = faces.ravel()
    first = np.full(len(clusters.model.vertices), len(corners), dtype=np.int64)
    np.minimum.at(first, corners, np.arange(len(corners)))
    used = np.flatnonzero(first < len(corners))
    used = used[np.argsort(first[used])]
    number = np.zeros(len(first), dtype=np.uint32)
    number[used] = np.arange(len(used))
    vertices = np.zeros(len(used), dtype=[("position", "f4", 3)])
    vertices["position"] = clusters.model.vertices[used] - origin
    return vertices, number[faces]


def packed(clusters: Clusters) -> NDArray[np.uint32]:
    """Return the corners of each face in the order of its cluster, on a lattice, (F', 8) words.

    Nine coordinates of 28 bits a face, so that corners that faces share stay shared. Faces of a
    millionth of the model's extent keep their shape, those of a ten millionth do not.
    """
    middle, step = _lattice(clusters)
    model = clusters.model
    places = np.rint((model.vertices - middle) / step).astype(np.int32) + (1 << (_BITS - 1))
    corners = places.view(np.uint32)
    faces = model.faces[clusters.order]
    words = np.zeros((len(faces), _WORDS), dtype=np.uint32)
    for word in range(_WORDS):
        words[:, word] = corners[faces[:, word // 3], word % 3]
    last = corners[faces[:, 2], 2]
    spare = 32 - _BITS  # bits of each word that the last coordinate is spread over
    for word in range(_BITS // spare):
        words[:, word] |= (last >> (spare * word) & ((1 << spare) - 1)) << _BITS
    return words


def _lattice(clusters: Clusters) -> tuple[Floats, float]:
    """Return the middle (3,) and the step of a model's lattice, scene unit."""
    extent = float(np.ptp(clusters.model.bounds, axis=0).max())
    return clusters.middle, max(extent, np.finfo(np.float32).tiny) / (2**_BITS - 2)


def _texture(rows: NDArray[Any], rows_a_line: int, texels: int) -> Any:
    """Return a texture of rows of some texels each, so many rows a line; zeros fill the last."""
    lines = max(1, -(-len(rows) // rows_a_line))
    filled = np.zeros((lines * rows_a_line, rows.shape[1]), dtype=rows.dtype)
    filled[: len(rows)] = rows
    kind = "u4" if rows.dtype == np.uint32 else "f4"
    return texture_of((rows_a_line * texels, lines), 4, kind, filled)


def texture_of(size: tuple[int, int], components: int, kind: str, values: Any = None) -> Any:
    """Return a texture of numbers ("u4" or "f4") that are fetched as they are."""
    texture = gl_context().texture(size, components, values, dtype=kind, alignment=4)
    texture.filter = (moderngl.NEAREST, moderngl.NEAREST)
    return texture


@cache
def compiled_compute(name: str, *defines: str) -> Any:
    """Return the compiled compute shader ``shaders/<name>.comp.glsl``."""
    file = f"{name}.comp.glsl"
    return _compiled(file, lambda: gl_context().compute_shader(shader_source(file, *defines)))


@cache
def compiled(name: str, *defines: str) -> Any:
    """Return the compiled program of ``shaders/<name>.*.glsl``."""
    return _compiled(
        f"{name}.*.glsl",
        lambda: gl_context().program(
            vertex_shader=shader_source(f"{name}.vert.glsl", *defines),
            fragment_shader=shader_source(f"{name}.frag.glsl", *defines),
        ),
    )


def _compiled(files: str, compiler: Callable[[], Any]) -> Any:
    try:
        return compiler()
    except moderngl.Error as error:
        info = gl_info()
        raise MachineError(
            f"shaders/{files} did not compile on {info.renderer} ({info.version}): {error}"
        ) from error
