"""What GLB and 3MF files may unfold to, looked at before anybody reads them whole.

Both tell in a few bytes of millions of vertices and copies. Here only their tables of contents
are read; what a mesh is, readers say.
"""

from __future__ import annotations

import re
import struct
import zipfile
from collections import Counter
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

from glvis.common.files import json_value

_MOST_PARTS = {".glb": 10_000, ".3mf": 1_000}  # copies placed; each takes the reader milliseconds
_MOST_LETTERS = 64_000_000  # of a table of contents
_MOST_PROMISED = 20_000_000  # entries that are not in the file itself, and as many a byte as this:
_PROMISED_A_BYTE = 16
_MOST_UNFOLDED, _MOST_RATIO = 1 << 30, 100  # bytes of XML, and how often as many as are packed
_CHUNK = 1 << 20
_ELEMENT = re.compile(rb"<(?:[\w.-]+:)?(object|component|item)\s([^>]{0,65536})>")
_ID = re.compile(rb"""\b(?:object)?id\s*=\s*["']([^"']*)["']""")


def check_limits(path: Path) -> None:
    """Refuse a GLB or 3MF that unfolds to much more than it holds; other files pass.

    Raises
    ------
    ValueError
        What there is too much of. What is no such file at all passes: its reader knows why.
    OSError
        If it cannot be read.
    """
    suffix = path.suffix.lower()
    if suffix == ".glb":
        _check_glb(path)
    elif suffix == ".3mf":
        _check_3mf(path)


def _check_glb(path: Path) -> None:
    """Count what accessors promise, and parts that nodes place."""
    with path.open("rb") as file:
        head = file.read(20)
        if len(head) < 20 or head[:4] != b"glTF":
            return
        (letters,) = struct.unpack_from("<I", head, 12)
        if letters > _MOST_LETTERS:
            raise ValueError(f"has {letters:,} letters of JSON, more than {_MOST_LETTERS:,}")
        text = file.read(letters).decode("utf-8", "replace")
    try:
        tables = json_value(text.rstrip("\0"))
    except ValueError as error:
        raise ValueError(f"cannot be read as GLB: {error}") from None
    promised = sum(
        _whole(accessor.get("count"))
        for accessor in _tables(tables, "accessors")
        if "bufferView" not in accessor
    )
    if promised > min(_MOST_PROMISED, _PROMISED_A_BYTE * path.stat().st_size):
        raise ValueError(f"promises {promised:,} entries that it does not hold")
    placed = Counter(_whole(node.get("mesh"), -1) for node in _tables(tables, "nodes"))
    parts = sum(
        placed[place] * len(_tables(mesh, "primitives"))
        for place, mesh in enumerate(_tables(tables, "meshes"))
    )
    _check_parts(parts, ".glb")


def _check_3mf(path: Path) -> None:
    """Count the bytes of XML, and the objects that are placed, those inside of others too."""
    try:
        with zipfile.ZipFile(path) as archive:
            models = [m for m in archive.infolist() if m.filename.lower().endswith(".model")]
            for model in models:
                most = min(_MOST_UNFOLDED, _MOST_RATIO * model.compress_size + _CHUNK)
                if model.file_size > most:
                    raise ValueError(
                        f"unfolds from {model.compress_size:,} to {model.file_size:,} bytes of "
                        f"XML, more than {most:,}"
                    )
            parts = sum(_placed(list(_elements(archive, model))) for model in models)
    except (ValueError, OSError):
        raise
    except Exception:  # zip and its methods fail in ways of their own; the reader will say how
        return
    _check_parts(parts, ".3mf")


def _elements(archive: zipfile.ZipFile, model: zipfile.ZipInfo) -> Iterator[tuple[str, bytes]]:
    """Yield objects, components and items of a model in their order, with the ids they name."""
    left = b""
    with archive.open(model) as file:
        while chunk := file.read(_CHUNK):
            text = left + chunk.replace(b"\0", b"")  # UTF-16 has the same letters
            last = text.rfind(b"<")
            left = text[last:] if last >= 0 and len(text) - last < _CHUNK else b""
            for found in _ELEMENT.finditer(text, 0, max(last, 0)):
                name = _ID.search(found[2])
                yield found[1].decode(), name[1] if name else b""


def _placed(elements: list[tuple[str, bytes]]) -> int:
    """Return how many objects are placed, counted through components of components."""
    inside: dict[bytes, list[bytes]] = {}
    items: list[bytes] = []
    own: list[bytes] = []
    for kind, name in elements:
        if kind == "object":
            own = inside.setdefault(name, [])
        else:
            (items if kind == "item" else own).append(name)
    count: dict[bytes, int] = {}
    for _ in range(len(inside) + 1):  # no chain of components is longer, unless it is a circle
        before = dict(count)
        for name, parts in inside.items():
            total = sum(before.get(part, 1) for part in parts) if parts else 1
            count[name] = min(total, _MOST_PARTS[".3mf"] + 1)
        if count == before:
            break
    return sum(count.get(name, 1) for name in items)


def _check_parts(parts: int, suffix: str) -> None:
    most = _MOST_PARTS[suffix]
    if parts > most:
        raise ValueError(
            f"places more than {most:,} parts; join them in the program that it comes from"
        )


def _tables(table: Any, key: str) -> list[Mapping[str, Any]]:
    """Return the tables of a list in JSON, where there is one."""
    found = table.get(key) if isinstance(table, dict) else None
    return [one for one in found if isinstance(one, dict)] if isinstance(found, list) else []


def _whole(value: Any, otherwise: int = 0) -> int:
    return value if isinstance(value, int) and value >= 0 else otherwise
