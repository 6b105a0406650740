"""Triangle meshes as they come from files: what there is to see, and what hides it.

A model keeps the faces of its file, all of them and in their order, because visibility maps
are indexed by them. The only module that talks to trimesh.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np
import trimesh  # noqa: TID251
from numpy.typing import ArrayLike, NDArray

from glvis.meshfiles import read_stl

SUFFIXES = (".stl", ".obj", ".ply", ".off", ".glb", ".3mf")

# Odd constants of the splitmix64 finaliser: they spread every input bit over the word.
_MIX = (np.uint64(0xBF58476D1CE4E5B9), np.uint64(0x94D049BB133111EB))


@dataclass(frozen=True, eq=False)
class Model:
    """A triangle mesh in the world frame, lengths in the study's unit.

    Attributes
    ----------
    name : str
        Stem of the file.
    path : Path or None
        Where it came from.
    vertices : (V, 3) float64
        Bitwise identical vertices of the file are one here; none is unused.
    faces : (F, 3) int32
        Indices into ``vertices``, in the order of the file. Faces without area are kept.
    """

    name: str
    vertices: NDArray[np.float64] = field(repr=False)
    faces: NDArray[np.int32] = field(repr=False)
    path: Path | None = None

    @classmethod
    def from_arrays(
        cls,
        name: str,
        vertices: ArrayLike,
        faces: ArrayLike,
        *,
        path: Path | None = None,
        scale: float = 1.0,
    ) -> Model:
        """Return a model of vertices (V, 3) and faces (F, 3), merged and checked.

        Parameters
        ----------
        name : str
            As reports call it.
        vertices : (V, 3) float
            In the world frame. They are merged where bitwise identical, before scaling.
        faces : (F, 3) int
            Indices into ``vertices``, counter-clockwise seen from outside.
        path : Path, optional
            Where it came from.
        scale : float
            Factor on the vertices, > 0.

        Raises
        ------
        ValueError
            If there is no face, an index points nowhere, a vertex is not finite, or no face
            has any area.
        """
        points, corners = np.asarray(vertices), np.asarray(faces)
        if corners.size == 0:
            raise ValueError("has no faces")
        if points.ndim != 2 or points.shape[1] != 3 or corners.ndim != 2 or corners.shape[1] != 3:
            raise ValueError(
                f"needs vertices (V, 3) and faces (F, 3), got {points.shape} and {corners.shape}"
            )
        _check_indices(corners, len(points))
        if not (np.isfinite(scale) and scale > 0):
            raise ValueError(f"scale = {scale:g} must be greater than 0")
        if points.dtype not in (np.float32, np.float64):
            points = points.astype(np.float64)
        _check_finite(points, corners)
        merged, merged_faces = _merged(points, corners)
        merged = merged.astype(np.float64) * scale
        model = cls(name, _read_only(merged), _read_only(merged_faces), path)
        if not model.areas.any():
            raise ValueError(f"has {model.n_faces} faces and none of them has any area")
        return model

    @property
    def n_faces(self) -> int:
        """Number of faces of the file, those without area included."""
        return len(self.faces)

    @cached_property
    def _doubled(self) -> NDArray[np.float64]:
        """Cross products (F, 3) of two edges: twice the area along the normal."""
        a, b, c = (self.vertices[self.faces[:, i]] for i in range(3))
        b -= a
        c -= a
        return _read_only(np.cross(b, c))

    @cached_property
    def areas(self) -> NDArray[np.float64]:
        """Area of each face, (F,) float64, scene unit squared."""
        return _read_only(np.linalg.norm(self._doubled, axis=1) / 2)

    @cached_property
    def normals(self) -> NDArray[np.float64]:
        """Unit normal of each face from its winding, (F, 3) float64; 0 where it has no area."""
        length = 2 * self.areas[:, None]
        return _read_only(
            np.divide(self._doubled, length, out=np.zeros_like(self._doubled), where=length > 0)
        )

    @cached_property
    def centroids(self) -> NDArray[np.float64]:
        """Centre of mass of each face, (F, 3) float64."""
        total = np.zeros((self.n_faces, 3))
        for i in range(3):
            total += self.vertices[self.faces[:, i]]
        return _read_only(total / 3)

    @cached_property
    def bounds(self) -> NDArray[np.float64]:
        """Lower and upper corner of the axis-aligned box, (2, 3) float64."""
        return _read_only(np.stack([self.vertices.min(axis=0), self.vertices.max(axis=0)]))

    @cached_property
    def mean_edge(self) -> float:
        """Mean length of the sides of the faces, scene unit."""
        total = 0.0
        for i in range(3):
            side = self.vertices[self.faces[:, i]] - self.vertices[self.faces[:, i - 1]]
            total += float(np.linalg.norm(side, axis=1).sum())
        return total / (3 * self.n_faces)

    @cached_property
    def _edges(self) -> tuple[int, int, int]:
        """Numbers of edges with one face, with more than two, and walked twice one way."""
        start = self.faces.astype(np.int64).ravel()
        end = np.roll(self.faces, -1, axis=1).astype(np.int64).ravel()
        proper = start != end  # a face that repeats a vertex has a side that is no edge
        start, end = start[proper], end[proper]
        n = len(self.vertices)
        forward = start < end
        undirected = np.where(forward, start * n + end, end * n + start)
        # One sort tells all: the last bit is the direction the edge is walked in.
        keys = np.sort(2 * undirected + forward)
        twice_one_way = int(np.count_nonzero(keys[1:] == keys[:-1]))
        keys >>= 1
        first = np.flatnonzero(np.concatenate([[True], keys[1:] != keys[:-1]]))
        faces_per_edge = np.diff(np.append(first, len(keys)))
        single = int(np.count_nonzero(faces_per_edge == 1))
        return single, int(np.count_nonzero(faces_per_edge > 2)), twice_one_way

    @property
    def boundary_edges(self) -> int:
        """Number of edges that belong to one face only."""
        return self._edges[0]

    @property
    def is_closed(self) -> bool:
        """Whether every edge has exactly two faces."""
        return self._edges[0] == 0 and self._edges[1] == 0

    @property
    def is_consistent(self) -> bool:
        """Whether no edge is walked twice in the same direction, so that normals agree."""
        return self._edges[2] == 0


def load_model(path: str | Path, scale: float = 1.0) -> Model:
    """Return the mesh in a file; several geometries become one, in the order of the file.

    Parameters
    ----------
    path : str or Path
        STL (binary or ASCII), OBJ, PLY, OFF, GLB or 3MF.
    scale : float
        Factor on the vertices, for files in another unit than the study.

    Raises
    ------
    ValueError
        If the file is missing, is no mesh, is cut short, or holds a mesh that has nothing to
        see. The message is the bare fact and does not repeat the path.
    """
    path = Path(path)
    suffix = path.suffix.lower()
    if not path.exists():
        raise ValueError("does not exist")
    if not path.is_file():
        raise ValueError("is not a file")
    if suffix not in SUFFIXES:
        known = ", ".join(SUFFIXES)
        raise ValueError(f"has the suffix '{path.suffix}'; meshes can be read from {known}")
    try:
        if path.stat().st_size == 0:
            raise ValueError("is empty")
        if suffix == ".stl":
            corners = read_stl(path)
            vertices = corners.reshape(-1, 3)
            faces = np.arange(len(vertices), dtype=np.int32).reshape(-1, 3)
        else:
            vertices, faces = _read_by_trimesh(path)
    except OSError as error:
        raise ValueError(f"cannot be read: {error.strerror or error}") from error
    return Model.from_arrays(path.stem, vertices, faces, path=path, scale=scale)


def _read_by_trimesh(path: Path) -> tuple[NDArray[Any], NDArray[Any]]:
    """Return vertices and faces of every geometry of a file, placed by its transforms."""
    kind = path.suffix.lower()[1:]
    try:
        loaded = trimesh.load_scene(
            path, file_type=kind, process=False, maintain_order=True, skip_materials=True
        )
        parts = [part for part in loaded.dump() if isinstance(part, trimesh.Trimesh)]
    except OSError:
        raise
    except Exception as error:  # each of trimesh's readers fails in its own way
        raise ValueError(f"cannot be read as {kind.upper()}: {_first_line(error)}") from error
    if not parts:
        raise ValueError("has no faces")
    offsets = np.cumsum([0] + [len(part.vertices) for part in parts])
    for part in parts:
        _check_indices(np.asarray(part.faces), len(part.vertices))
    faces = [np.asarray(p.faces) + shift for p, shift in zip(parts, offsets, strict=False)]
    return np.concatenate([np.asarray(p.vertices) for p in parts]), np.concatenate(faces)


def _first_line(error: Exception) -> str:
    """Return the first line of a foreign error, or its type where it says nothing."""
    return next(iter(str(error).splitlines()), "") or type(error).__name__


def _read_only(array: NDArray[Any]) -> NDArray[Any]:
    array.flags.writeable = False
    return array


def _check_indices(faces: NDArray[Any], n_vertices: int) -> None:
    """Refuse faces that point at vertices that are not there."""
    if faces.size and (faces.min() < 0 or faces.max() >= n_vertices):
        bad = int(np.flatnonzero(((faces < 0) | (faces >= n_vertices)).any(axis=1))[0])
        raise ValueError(
            f"face {bad} has vertices {faces[bad].tolist()}, there are only {n_vertices}"
        )


def _check_finite(vertices: NDArray[Any], faces: NDArray[Any]) -> None:
    """Refuse vertices that are not numbers, by the first face that has one."""
    finite = np.isfinite(vertices).all(axis=1)
    if finite.all():
        return
    bad = np.flatnonzero(~finite[faces].all(axis=1))
    if len(bad):
        point = vertices[faces[bad[0]][~finite[faces[bad[0]]][0]]]
        where = ", ".join(f"{value:g}" for value in point)
        raise ValueError(
            f"face {bad[0]} has the vertex ({where}); {len(bad)} of {len(faces)} faces "
            "are not finite"
        )


def _merged(vertices: NDArray[Any], faces: NDArray[Any]) -> tuple[NDArray[Any], NDArray[np.int32]]:
    """Return vertices and faces with bitwise identical vertices merged, unused ones dropped.

    Kept vertices stay in the order of their first appearance, so a mesh that repeats none
    keeps its numbers.
    """
    n = len(vertices)
    points = vertices + vertices.dtype.type(0)  # -0.0 is the same place as 0.0
    order = _grouping_order(points)
    is_new = np.ones(n, dtype=bool)
    is_new[1:] = (points[order[1:]] != points[order[:-1]]).any(axis=1)
    group_start = np.flatnonzero(is_new)
    first = np.minimum.reduceat(order, group_start)  # of each group, the one met first
    representative = np.zeros(n, dtype=np.int64)
    representative[order] = np.repeat(first, np.diff(np.append(group_start, n)))
    used = np.zeros(n, dtype=bool)
    used[representative[faces]] = True
    number = np.cumsum(used, dtype=np.int32) - np.int32(1)
    return points[used], number[representative[faces]]


def _grouping_order(points: NDArray[Any]) -> NDArray[np.int64]:
    """Return an order (V,) in which identical points are neighbours.

    Sorting one 64-bit word a point is several times faster than sorting three coordinates;
    where two different points share a word, which would take some 2^32 points, the
    coordinates are sorted after all.
    """
    words: NDArray[Any] = points.view(np.uint32 if points.dtype == np.float32 else np.uint64)
    key = np.zeros(len(points), dtype=np.uint64)
    for column in range(3):
        key ^= words[:, column].astype(np.uint64)
        for shift, factor in zip((30, 27), _MIX, strict=True):
            key ^= key >> np.uint64(shift)
            key *= factor
        key ^= key >> np.uint64(31)
    order = np.argsort(key)
    same_key = key[order[1:]] == key[order[:-1]]
    differs = (points[order[1:]] != points[order[:-1]]).any(axis=1)
    if np.any(same_key & differs):
        return np.lexsort(points.T)
    return order
