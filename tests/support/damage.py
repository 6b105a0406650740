"""Damaged files by a fixed seed: flipped, cut, spliced, and edited by somebody who knows how."""

from __future__ import annotations

import copy
import io
import json
import zipfile
from collections.abc import Callable, Iterator
from typing import Any

import numpy as np

Rng = np.random.Generator

# What an edit puts in place of a value.
_WEIRD: list[Any] = [
    None, True, -1, 0, 10**30, 1e308, -1e300, float("nan"), float("inf"), "", "text", "\0",
    "\ud800", "x" * 3000, "../..", "=1+1", [], [[]], {}, {"a": 1}, [1, 2, 3], [None],
]  # fmt: skip
_NUMBERS = (b"-1", b"1e400", b"nan", b"9" * 31, b"1e-44", b"0x7f", b"", b"\xe4", b"1" * 5000)


def damaged_bytes(data: bytes, rng: Rng) -> bytes:
    """Return a file with a few bytes flipped, cut out, repeated, or put in."""
    found = bytearray(data)
    for _ in range(rng.integers(1, 4)):
        at = int(rng.integers(0, max(1, len(found))))
        until = min(len(found), at + int(rng.integers(1, 64)))
        match rng.integers(0, 6):
            case 0 if found:
                found[at % len(found)] ^= 1 << int(rng.integers(0, 8))
            case 1:
                del found[at:]
            case 2:
                del found[at:until]
            case 3:
                found[at:at] = found[at:until] * int(rng.integers(1, 50))
            case 4:
                found[at:until] = rng.bytes(until - at)
            case _:
                found[at:until] = b"\0" * (until - at)
    return bytes(found)


def damaged_text(data: bytes, rng: Rng) -> bytes:
    """Return a text with words in place of others, lines moved, or damaged as bytes."""
    if rng.random() < 0.3:
        return damaged_bytes(data, rng)
    lines = [line.split(b" ") for line in data.split(b"\n")]
    for _ in range(rng.integers(1, 4)):
        line = lines[rng.integers(0, len(lines))]
        if rng.random() < 0.2:
            lines.insert(int(rng.integers(0, len(lines))), line)
        else:
            line[rng.integers(0, len(line))] = _NUMBERS[rng.integers(0, len(_NUMBERS))]
    return b"\n".join(b" ".join(line) for line in lines)


def damaged_json(data: bytes, rng: Rng) -> bytes:
    """Return JSON with a value missing, replaced, or nested out of reason."""
    if rng.random() < 0.2:
        return damaged_text(data, rng)
    tables = json.loads(data)
    if rng.random() < 0.05:
        return b'{"glvis_schema": 1, "poses": ' + b"[" * 200_000
    for _ in range(rng.integers(1, 3)):
        tables = _edited(tables, rng)
    return json.dumps(tables).encode()


def damaged_npz(data: bytes, rng: Rng) -> bytes:
    """Return an archive of arrays of which one is another, or damaged as bytes."""
    if rng.random() < 0.4:
        return damaged_bytes(data, rng)
    with np.load(io.BytesIO(data)) as content:
        arrays = {name: content[name] for name in content.files}
    name = sorted(arrays)[rng.integers(0, len(arrays))]
    found = arrays[name]
    npy = io.BytesIO()
    match rng.integers(0, 8):
        case 0:
            del arrays[name]
        case 1:
            arrays[name] = found[..., None]
        case 2 if found.ndim:
            arrays[name] = found[: len(found) // 2]
        case 3:
            arrays[name] = np.full(found.shape, "text")
        case 4 if found.dtype.kind in "fiu":
            arrays[name] = np.full_like(found, np.array(-1).astype(found.dtype))
        case 5 if found.dtype.kind == "f":
            arrays[name] = np.full_like(found, np.nan)
        case 6 if found.dtype.kind == "U" and not found.ndim:
            edited = damaged_json(str(found).encode(), rng)
            arrays[name] = np.array(edited.decode("utf-8", "replace").replace("\0", "?"))
        case _:  # an array of petabytes
            head = {"descr": "<f8", "fortran_order": False, "shape": (10**15,)}
            np.lib.format.write_array_header_1_0(npy, head)
    out = io.BytesIO()
    with zipfile.ZipFile(out, "w") as archive:
        for key, array in arrays.items():
            one = io.BytesIO()
            np.lib.format.write_array(one, np.asanyarray(array), allow_pickle=False)
            is_it = key == name and npy.getvalue()
            archive.writestr(f"{key}.npy", npy.getvalue() if is_it else one.getvalue())
    return out.getvalue()


DAMAGE: dict[str, Callable[[bytes, Rng], bytes]] = {
    ".npz": damaged_npz,
    ".json": damaged_json,
    ".csv": damaged_text,
    ".toml": damaged_text,
    ".obj": damaged_text,
    ".off": damaged_text,
}


def damaged(suffix: str, data: bytes, rng: Rng) -> bytes:
    """Return a file of some kind with a damage that fits it."""
    return DAMAGE.get(suffix, damaged_bytes)(data, rng)


def _places(tables: Any) -> Iterator[tuple[Any, Any]]:
    """Yield every (table or list, key) of nested tables."""
    items = tables.items() if isinstance(tables, dict) else enumerate(tables)
    for key, value in list(items):
        yield tables, key
        if isinstance(value, dict | list):
            yield from _places(value)


def _edited(tables: Any, rng: Rng) -> Any:
    tables = copy.deepcopy(tables)
    places = list(_places(tables))
    if not places:
        return tables
    holder, key = places[rng.integers(0, len(places))]
    if rng.random() < 0.25:
        del holder[key]
    else:
        holder[key] = _WEIRD[rng.integers(0, len(_WEIRD))]
    return tables
