"""Triangle meshes as they come from files: what there is to see, and what hides it.

A model keeps the faces of its file, all of them and in their order, because visibility maps
are indexed by them; large ones may be cut into pieces later, see ``pieces.py``. The only module
that talks to trimesh.
"""

from __future__ import annotations

import logging
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, fields
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from glvis.common.complaints import shortened
from glvis.problem.meshfiles import fans, read_obj, read_off, read_stl
from glvis.problem.meshlimits import check_limits
from glvis.problem.welding import merged_where_identical

_LOG = logging.getLogger(__name__)

SUFFIXES = (".stl", ".obj", ".ply", ".off", ".glb", ".3mf")

_FARTHEST = 1e12  # scene units; a file with larger numbers is broken
_LARGE = 20_000_000  # bytes, from which on reading takes seconds and is told
_SMALLEST = 1e-9  # scene units across; squares of squares leave the range of single floats


@dataclass(frozen=True, eq=False)
class Pieces:
    """Where the faces of a model come from that was cut.

    Attributes
    ----------
    file : Model
        As its file has it, F_file faces.
    file_face : (F,) int32
        Which of them each face of the cut model is a piece of; never falls.
    max_edge : float
        Longest edge that was allowed, scene unit.
    """

    file: Model
    file_face: NDArray[np.int32] = field(repr=False)
    max_edge: float


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
    pieces : Pieces or None
        Where the faces come from, if they are not those of the file.
    parts : tuple of Path
        Files whose faces follow each other in this model, where they are several.
    """

    name: str
    vertices: NDArray[np.float64] = field(repr=False)
    faces: NDArray[np.int32] = field(repr=False)
    path: Path | None = None
    pieces: Pieces | None = field(default=None, repr=False)
    parts: tuple[Path, ...] = field(default=(), repr=False)

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
        if corners.dtype.kind not in "iu":
            raise ValueError(f"faces must be whole numbers, got {corners.dtype}")
        _check_indices(corners, len(points))
        if not (np.isfinite(scale) and scale > 0):
            raise ValueError(f"scale = {scale:g} must be greater than 0")
        if points.dtype not in (np.float32, np.float64):
            points = points.astype(np.float64)
        _check_sane(points, corners, _FARTHEST / scale)
        merged, merged_faces = merged_where_identical(points, corners)
        merged = merged.astype(np.float64) * scale
        model = cls(name, _read_only(merged), _read_only(merged_faces), path)
        if not model.areas.any():
            raise ValueError(f"has {model.n_faces} faces and none of them has any area")
        across = float(np.ptp(model.bounds, axis=0).max())
        if across < _SMALLEST:
            raise ValueError(f"is {across:.3g} across, less than {_SMALLEST:g}; is its unit right?")
        return model

    def flipped(self) -> Model:
        """Return the model with all normals the other way, faces in the same order and uncut."""
        faces = _read_only(self.faces[:, [0, 2, 1]])
        return Model(self.name, self.vertices, faces, self.path, parts=self.parts)

    def __getstate__(self) -> dict[str, Any]:
        """Return what other processes are sent; what follows from it they work out themselves."""
        return {mine.name: getattr(self, mine.name) for mine in fields(self)}

    @property
    def n_faces(self) -> int:
        """Number of faces, those without area included; of pieces where faces were cut."""
        return len(self.faces)

    @property
    def file(self) -> Model:
        """The model as its file has it: this one, unless its faces were cut."""
        return self if self.pieces is None else self.pieces.file

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

    @property
    def mean_edge(self) -> float:
        """Mean length of the sides of the faces, scene unit."""
        return self._edge_lengths[0]

    @property
    def longest_edge(self) -> float:
        """Length of the longest side of any face, scene unit."""
        return self._edge_lengths[1]

    @cached_property
    def _edge_lengths(self) -> tuple[float, float]:
        """Mean and largest length of the sides of the faces."""
        total = longest = 0.0
        for i in range(3):
            side = self.vertices[self.faces[:, i]] - self.vertices[self.faces[:, i - 1]]
            length = np.linalg.norm(side, axis=1)
            total += float(length.sum())
            longest = max(longest, float(length.max()))
        return total / (3 * self.n_faces), longest

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
    def inconsistent_edges(self) -> int:
        """Number of edges that two faces walk in the same direction."""
        return self._edges[2]

    @property
    def is_closed(self) -> bool:
        """Whether every edge has exactly two faces."""
        return self.boundary_edges == 0 and self._edges[1] == 0

    @property
    def is_consistent(self) -> bool:
        """Whether no edge is walked twice in the same direction, so that normals agree."""
        return self.inconsistent_edges == 0


def joined(name: str, models: Sequence[Model]) -> Model:
    """Return models as one, each where it is, faces in their order."""
    starts = np.cumsum([0, *(len(model.vertices) for model in models[:-1])])
    return Model(
        name,
        _read_only(np.concatenate([model.vertices for model in models])),
        _read_only(
            np.concatenate([m.faces + np.int32(n) for m, n in zip(models, starts, strict=True)])
        ),
        parts=tuple(model.path for model in models if model.path),
    )


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
    try:
        if not path.exists():
            raise ValueError("does not exist")
        if not path.is_file():
            raise ValueError("is not a file")
        if suffix not in SUFFIXES:
            known = ", ".join(SUFFIXES)
            raise ValueError(f"has the suffix '{path.suffix}'; meshes can be read from {known}")
        if path.stat().st_size == 0:
            raise ValueError("is empty")
        check_limits(path)
        size = path.stat().st_size
        if size >= _LARGE:
            _LOG.info("Reading %s, %.0f MB ...", path.name, size / 1e6)
        with np.errstate(all="ignore"):  # numbers cast to nonsense are refused below
            vertices, faces = _READERS.get(suffix, _read_by_trimesh)(path)
    except OSError as error:
        raise ValueError(f"cannot be read: {error.strerror or error}") from error
    except MemoryError:
        raise ValueError("is larger than the memory of this machine") from None
    return Model.from_arrays(path.stem, vertices, faces, path=path, scale=scale)


def _read_stl(path: Path) -> tuple[NDArray[Any], NDArray[Any]]:
    """Return the corners of an STL as vertices, three a face."""
    vertices = read_stl(path).reshape(-1, 3)
    return vertices, np.arange(len(vertices), dtype=np.int32).reshape(-1, 3)


_READERS: dict[str, Callable[[Path], tuple[NDArray[Any], NDArray[Any]]]] = {
    ".stl": _read_stl,
    ".obj": read_obj,
    ".off": read_off,
}


def _read_by_trimesh(path: Path) -> tuple[NDArray[Any], NDArray[Any]]:
    """Return vertices and faces of every geometry of a file, placed by its transforms."""
    # half a second to import, and STL, OBJ and OFF do without
    import trimesh

    kind = path.suffix[1:].upper()
    try:
        loaded = trimesh.load_scene(
            path, file_type=kind.lower(), process=False, skip_materials=True, fix_texture=False
        )
        in_file = list(loaded.geometry)  # the scene graph has an order of its own
        parts = sorted(
            (part for part in loaded.dump() if isinstance(part, trimesh.Trimesh)),
            key=lambda part: in_file.index(part.metadata["name"]),
        )
    except OSError:
        raise
    except ImportError as error:
        raise ValueError(f"cannot be read as {kind}: {error}") from error
    except Exception as error:  # each of trimesh's readers fails in its own way
        raise ValueError(f"cannot be read as {kind}: {_first_line(error)}") from error
    if not parts:
        raise ValueError("has no faces")
    vertices, faces, n = [], [], 0
    for part in parts:
        corners = _faces_in_order(part)
        _check_indices(corners, len(part.vertices))
        vertices.append(np.asarray(part.vertices))
        faces.append(corners + n)
        n += len(part.vertices)
    return np.concatenate(vertices), np.concatenate(faces)


def _faces_in_order(part: Any) -> NDArray[np.int64]:
    """Return the triangles of a part; where PLY has polygons, trimesh shuffles them."""
    raw = part.metadata.get("_ply_raw", {}).get("face", {}).get("data")
    if isinstance(raw, dict):
        raw = next((raw[key] for key in ("vertex_indices", "vertex_index") if key in raw), None)
    elif raw is not None and raw.dtype.names:
        names = raw.dtype.names
        key = next((n for n in names if n in ("vertex_indices", "vertex_index")), names[0])
        raw = raw[key]["f1"]
    if raw is None or (isinstance(raw, np.ndarray) and raw.ndim == 2 and raw.shape[1] == 3):
        return np.asarray(part.faces, dtype=np.int64)
    return fans([[int(corner) for corner in polygon] for polygon in raw])


def _first_line(error: Exception) -> str:
    """Return the first line of a foreign error, or its type where it says nothing."""
    return shortened(next(iter(str(error).splitlines()), ""), 200) or type(error).__name__


def _read_only(array: NDArray[Any]) -> NDArray[Any]:
    array.flags.writeable = False
    return array


def _check_indices(faces: NDArray[Any], n_vertices: int) -> None:
    """Refuse faces that point at vertices that are not there."""
    if faces.size and (faces.min() < 0 or faces.max() >= n_vertices):
        bad = int(np.flatnonzero(((faces < 0) | (faces >= n_vertices)).any(axis=1))[0])
        raise ValueError(
            f"has a face {bad} of vertices {faces[bad].tolist()}, but only {n_vertices} vertices"
        )


def _check_sane(vertices: NDArray[Any], faces: NDArray[Any], limit: float) -> None:
    """Refuse vertices that are not numbers or absurdly far, by the first face that has one."""
    is_sane = (np.abs(vertices) <= limit).all(axis=1)  # NaN is not
    if is_sane.all():
        return
    is_bad = ~is_sane[faces]
    bad = np.flatnonzero(is_bad.any(axis=1))
    if len(bad):
        face = bad[0]
        point = ", ".join(f"{value:g}" for value in vertices[faces[face][is_bad[face]][0]])
        raise ValueError(
            f"has impossible vertices in {len(bad)} of {len(faces)} faces: face {face} at ({point})"
        )
