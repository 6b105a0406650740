"""Readers of the plain mesh formats: bytes in, triangles in the file's order out.

STL is read here because scanners write it by the million faces and cut it short without a
word; OBJ and OFF because polygons must become triangles where they stand, and general readers
sort them by number of corners and by material. The rest comes through ``scene``. Nothing here
judges a mesh: a reader only says what keeps the bytes from being one.
"""

from __future__ import annotations

import re
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from glvis.common.complaints import shortened

_STL_HEADER = 84
_STL_FACET = np.dtype(
    [("normal", "<f4", 3), ("corners", "<f4", (3, 3)), ("attribute", "<u2")]
)  # 50 bytes, no padding
_ASCII_VERTEX = re.compile(rb"\bvertex\s+(\S+)\s+(\S+)\s+(\S+)")


def read_stl(path: Path) -> NDArray[Any]:
    """Return the corners (F, 3, 3) of an STL file, float32 where binary, float64 where text.

    Raises
    ------
    ValueError
        If the file is no STL, is cut short, or holds more than it promises.
    """
    size = path.stat().st_size
    with path.open("rb") as file:
        head = file.read(_STL_HEADER)
    promised = int.from_bytes(head[80:84], "little") if size >= _STL_HEADER else 0
    found, rest = divmod(size - _STL_HEADER, _STL_FACET.itemsize)
    # Binary files that start with "solid" exist, so the length decides before the word does.
    if size >= _STL_HEADER and promised == found and rest == 0:
        return _binary_corners(path, found)
    if head.lstrip(b"\xef\xbb\xbf \t\r\n")[:5].lower() == b"solid" and b"\0" not in head:
        return _ascii_corners(path.read_bytes())
    if _looks_like_text(head):
        raise ValueError("is text but no STL: it does not start with 'solid'")
    if size < _STL_HEADER:
        raise ValueError(f"is cut short: {size} bytes are less than the header of a binary STL")
    if found < promised:
        raise ValueError(f"is cut short: it promises {promised} faces and holds {found}")
    if found > promised:
        raise ValueError(f"promises {promised} faces and holds {found}: is it an STL?")
    return _binary_corners(path, found)  # a few bytes of padding at the end


def _looks_like_text(head: bytes) -> bool:
    """Return whether nothing in the first bytes speaks against text."""
    return not any(byte < 9 or byte > 126 for byte in head)


def _binary_corners(path: Path, n_faces: int) -> NDArray[np.float32]:
    """Return (F, 3, 3) float32, contiguous; the file itself is mapped, not read twice."""
    if n_faces == 0:
        return np.zeros((0, 3, 3), dtype=np.float32)
    facets = np.memmap(path, dtype=_STL_FACET, mode="r", offset=_STL_HEADER, shape=(n_faces,))
    return np.array(facets["corners"], dtype=np.float32)


def _ascii_corners(text: bytes) -> NDArray[np.float64]:
    """Return (F, 3, 3) float64 of an ASCII STL, all its solids one after the other."""
    text = text.lower()
    opened, closed = len(re.findall(rb"\bfacet\s+normal\b", text)), text.count(b"endfacet")
    rows = _ASCII_VERTEX.findall(text)
    if b"endsolid" not in text:
        raise ValueError("is cut short: an ASCII STL ends with 'endsolid'")
    if opened != closed:
        raise ValueError(f"is cut short: {closed} of {opened} facets end, as an ASCII STL must")
    if len(rows) != 3 * opened:
        raise ValueError(f"is broken: {opened} facets have {len(rows)} vertices")
    try:
        return np.array(rows, dtype=np.bytes_).astype(np.float64).reshape(-1, 3, 3)
    except ValueError:
        word = next(word for row in rows for word in row if not _is_number(word))
        raise ValueError(
            f"is broken: '{shortened(word.decode(errors='replace'))}' is no number"
        ) from None


def _is_number(word: bytes) -> bool:
    try:
        float(word)
    except ValueError:
        return False
    return True


def read_obj(path: Path) -> tuple[NDArray[np.float64], NDArray[np.int64]]:
    """Return vertices (V, 3) and faces (F, 3) of a Wavefront OBJ, groups and materials ignored.

    Raises
    ------
    ValueError
        If a line of a vertex or a face is none.
    """
    vertices: list[list[float]] = []
    polygons: list[list[int]] = []
    text = path.read_text(encoding="utf-8", errors="replace").replace("\\\n", " ")
    for number, line in enumerate(text.splitlines(), start=1):
        words = line.split()
        if not words or words[0] not in ("v", "f"):
            continue
        try:
            if words[0] == "v":
                vertices.append([float(word) for word in words[1:4]])
                if len(vertices[-1]) != 3:
                    raise ValueError
            else:
                corners = [int(word.split("/", 1)[0]) for word in words[1:]]
                # From 1, or backwards from the last vertex so far.
                polygons.append([c - 1 if c > 0 else c + len(vertices) for c in corners])
                if len(corners) < 3 or 0 in corners:
                    raise ValueError
        except ValueError:
            raise ValueError(f"line {number} is broken: '{shortened(line)}'") from None
    return np.array(vertices, dtype=np.float64).reshape(-1, 3), fans(polygons)


def read_off(path: Path) -> tuple[NDArray[np.float64], NDArray[np.int64]]:
    """Return vertices (V, 3) and faces (F, 3) of an OFF file in text form.

    Raises
    ------
    ValueError
        If the file is no such OFF or holds less than it promises.
    """
    text = path.read_text(encoding="utf-8", errors="replace")
    lines = (line.split("#", 1)[0].split() for line in text.splitlines())
    rows = [words for words in lines if words]
    word = rows[0][0] if rows else ""
    if not word.endswith("OFF") or word in ("4OFF", "nOFF") or "BINARY" in rows[0]:
        raise ValueError("is no OFF in text form: it does not start with 'OFF'")
    rows[0] = rows[0][1:]  # the numbers may stand beside the word
    rows = [words for words in rows if words]
    try:
        n_vertices, n_faces = int(rows[0][0]), int(rows[0][1])
    except (IndexError, ValueError):
        raise ValueError("is a broken OFF: it does not say how many vertices and faces") from None
    if len(rows) < 1 + n_vertices + n_faces:
        raise ValueError(
            f"is cut short: it promises {n_vertices} vertices and {n_faces} faces "
            f"and holds {len(rows) - 1} lines"
        )
    try:
        vertices = np.array([w[:3] for w in rows[1 : 1 + n_vertices]], dtype=np.float64)
        faces = rows[1 + n_vertices : 1 + n_vertices + n_faces]
        polygons = [[int(corner) for corner in w[1 : 1 + int(w[0])]] for w in faces]
        if any(len(p) != int(w[0]) for p, w in zip(polygons, faces, strict=True)):
            raise ValueError("a face has fewer corners than it promises")
    except ValueError as error:
        raise ValueError(f"is a broken OFF: {shortened(str(error))}") from None
    return vertices.reshape(-1, 3), fans(polygons)


def fans(polygons: Sequence[Sequence[int]]) -> NDArray[np.int64]:
    """Return triangles (F, 3) of polygons, each a fan about its first corner, in their order.

    Raises
    ------
    ValueError
        If a corner is a number of more than 64 bits.
    """
    triangles = [
        (corners[0], corners[i], corners[i + 1])
        for corners in polygons
        for i in range(1, len(corners) - 1)
    ]
    try:
        return np.array(triangles, dtype=np.int64).reshape(-1, 3)
    except OverflowError:
        raise ValueError("has a face of a vertex whose number has more than 64 bits") from None
