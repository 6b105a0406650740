"""Readers of the plain mesh formats: bytes in, triangles in the file's order out.

STL is read here because scanners write it by the million faces and cut it short without a
word; the rest comes through ``scene``. Nothing here judges a mesh: a reader only says what
keeps the bytes from being one.
"""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

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
    if head.lstrip()[:5].lower() == b"solid" and b"\0" not in head:
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
    opened, closed = len(re.findall(rb"\bfacet\b", text)), text.count(b"endfacet")
    rows = _ASCII_VERTEX.findall(text)
    if b"endsolid" not in text or opened != closed:
        raise ValueError(f"is cut short: {closed} of {opened} facets end, as an ASCII STL must")
    if len(rows) != 3 * opened:
        raise ValueError(f"is broken: {opened} facets have {len(rows)} vertices")
    try:
        return np.array(rows, dtype=np.bytes_).astype(np.float64).reshape(-1, 3, 3)
    except ValueError as error:
        raise ValueError(f"is broken: {error}") from None
