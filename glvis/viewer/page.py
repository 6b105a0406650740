"""Makes report.html: one page with the scene, the maps and the tables, opened from disk.

Everything the page shows is handed over as arrays and text in ``PageData``; this module packs
it and knows nothing of studies, searches or OpenGL. The page itself lies in ``glvis/viewer``.
"""

from __future__ import annotations

import base64
import json
import math
import zlib
from collections.abc import Sequence
from dataclasses import dataclass, field
from functools import cache
from html import escape
from pathlib import Path
from string import Template
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from glvis.common.palette import (
    OBSTACLE_COLOR,
    SEEN_COLOR,
    hex_color,
    overlap_colors,
    sensor_colors,
)
from glvis.problem.units import unit_word
from glvis.visibility.filters import Refusal
from glvis.visibility.glsl import shader_source

_VIEWER = Path(__file__).resolve().parent
# One script, in this order: a page opened from disk may not import modules from beside it.
_SCRIPTS = ("math", "mesh", "coverage", "draw", "camera", "glyphs", "panel", "controls", "main")
_SHADERS = tuple(
    f"viewer_{name}.{stage}.glsl" for name in ("mesh", "id", "line") for stage in ("vert", "frag")
)
_DIM_COLOR = (168, 174, 184)  # faces that do not matter while one sensor is looked at


# Why a sensor does not see a face, in the few words that a line of the page has room for.
_REFUSALS = {
    Refusal.OUTSIDE: "outside its view",
    Refusal.TURNED_AWAY: "faces away",
    Refusal.TOO_FAR: "too far",
    Refusal.TOO_NEAR: "too near",
    Refusal.TOO_OBLIQUE: "too oblique",
    Refusal.NONE: "hidden",
}


@dataclass(frozen=True, eq=False)
class PageModel:
    """A model and its visibility map.

    Attributes
    ----------
    name : str
        As the page calls it.
    vertices : (V, 3) float
        World frame, the study's unit.
    faces : (F, 3) int
        Indices into ``vertices``, counter-clockwise seen from outside.
    visible : (S, F) bool
        Which sensor sees which face.
    piece_of : (F,) int or None
        Where faces were cut: which of the file's faces each one is a piece of. The page then tells
        shares of the area instead of the faces.
    refusals : (S, F) int or None
        Which filter of each sensor refuses each face first, by ``filters.Refusal``; without them
        the page does not say why a face is not seen.
    """

    name: str
    vertices: ArrayLike = field(repr=False)
    faces: ArrayLike = field(repr=False)
    visible: ArrayLike = field(repr=False)
    piece_of: ArrayLike | None = field(default=None, repr=False)
    refusals: ArrayLike | None = field(default=None, repr=False)


@dataclass(frozen=True, eq=False)
class PageObstacle:
    """What hides and is never counted: vertices (V, 3) in the world frame, faces (F, 3)."""

    name: str
    vertices: ArrayLike = field(repr=False)
    faces: ArrayLike = field(repr=False)


@dataclass(frozen=True, eq=False)
class PageSensor:
    """A placed sensor.

    Attributes
    ----------
    name, kind : str
        Of this one ("A1"), and what it is ("d415").
    camera_to_world : (4, 4) float
        Pose; x right, y up, looking along -z.
    tan_half : (2,) float
        Tangents of the half opening angles along x and y.
    min_distance, max_distance : float
        Working range as depth along the optical axis, the study's unit.
    max_incidence : float
        Radians.
    resolution : (2,) int
        Pixels, width and height.
    color : str
        "#RRGGBB"; empty takes the palette's colour for its place in the list.
    """

    name: str
    kind: str
    camera_to_world: ArrayLike
    tan_half: ArrayLike
    min_distance: float
    max_distance: float
    max_incidence: float = math.pi / 2
    resolution: tuple[int, int] = (1280, 720)
    color: str = ""


@dataclass(frozen=True)
class PageTable:
    """A table: rows as long as the header; numbers are formatted by the page, text is not."""

    title: str
    header: Sequence[str]
    rows: Sequence[Sequence[str | float]]
    note: str = ""


@dataclass(frozen=True, eq=False)
class PageTrace:
    """The search: (N,) iteration, best and mean objective; NaN where there is none."""

    iteration: ArrayLike
    best: ArrayLike
    mean: ArrayLike


@dataclass(frozen=True, eq=False)
class PageData:
    """Everything on the page.

    Attributes
    ----------
    title, unit : str
        Of the study.
    up : (3,) float
        World direction that stands upright.
    models, sensors : sequence
        At least one model; visibility maps have one row a sensor.
    obstacles, tables : sequence
        May be empty.
    trace : PageTrace or None
        The search, where there was one.
    facts : sequence of (key, value)
        Objective, stop reason, seed, driver, versions.
    mounting : sequence of str
        Lines for whoever installs the sensors.
    subtitle : str
        One line under the title; empty says what the scene holds.
    incidence : str
        "ray" or "axis": what incidence angles in the readings refer to.
    by_area : bool
        Whether the objective weighs faces by their area: the page then tells shares of the area,
        as where faces were cut.
    """

    title: str
    unit: str
    up: ArrayLike
    models: Sequence[PageModel]
    sensors: Sequence[PageSensor]
    obstacles: Sequence[PageObstacle] = ()
    tables: Sequence[PageTable] = ()
    trace: PageTrace | None = None
    facts: Sequence[tuple[str, str]] = ()
    mounting: Sequence[str] = ()
    subtitle: str = ""
    incidence: str = "ray"
    by_area: bool = False


def write_page(path: Path, data: PageData) -> None:
    """Write the page, UTF-8; it needs no other file and no network.

    Raises
    ------
    ValueError
        If there is no model, or a map, a face or a table row has the wrong shape.
    """
    path.write_text(page_text(data), encoding="utf-8")


def page_text(data: PageData) -> str:
    """Return the page's HTML; see ``write_page``."""
    study, meshes = _packed(data)
    return Template(_viewer_file("page.html")).substitute(
        title=escape(data.title),
        style=_viewer_file("viewer.css"),
        study=_json_in_html(study),
        meshes=base64.b64encode(meshes).decode(),
        script=_script(),
    )


@cache
def _viewer_file(name: str) -> str:
    return (_VIEWER / name).read_text(encoding="utf-8")


@cache
def _script() -> str:
    """Return the page's script: the shaders as strings, then all parts in order."""
    shaders = {name: shader_source(name) for name in _SHADERS}
    parts = [f"const SHADERS = {_json_in_html(shaders)};"]
    parts += [_viewer_file(f"{name}.js") for name in _SCRIPTS]
    return "\n".join(parts)


def _json_in_html(value: Any) -> str:
    """Return JSON that may stand inside a script element: nothing in it can close the element."""
    text = json.dumps(value, ensure_ascii=False, allow_nan=False, separators=(",", ":"))
    return text.replace("<", "\\u003c").replace("\u2028", "\\u2028").replace("\u2029", "\\u2029")


def _packed(data: PageData) -> tuple[dict[str, Any], bytes]:
    """Return the page's JSON header and the deflated bytes of all meshes."""
    if not data.models:
        raise ValueError("a page needs at least one model")
    # Single precision is relative to the middle of the scene, so that far-off frames stay exact.
    first = np.asarray(data.models[0].vertices, dtype=float)
    origin = (first.min(axis=0) + first.max(axis=0)) / 2
    blob = bytearray()
    models = [_pack_model(blob, origin, model, len(data.sensors)) for model in data.models]
    obstacles = [_pack_mesh(blob, origin, obstacle) for obstacle in data.obstacles]
    # as many steps of colour as the pictures have: one for each count that there is
    most = max(int(np.sum(model.visible, axis=0).max(initial=0)) for model in data.models)
    study = {
        "title": data.title,
        "unit": data.unit,
        "up": np.asarray(data.up, dtype=float).tolist(),
        "origin": origin.tolist(),
        "subtitle": data.subtitle or _subtitle(data),
        "incidence": data.incidence,
        "refusals": list(_REFUSALS.values()),
        "byArea": data.by_area or any(model.piece_of is not None for model in data.models),
        "models": models,
        "obstacles": obstacles,
        "sensors": _sensors(data.sensors, origin),
        "colors": {
            "unseen": overlap_colors(0)[0].tolist(),
            "seen": SEEN_COLOR.tolist(),
            "dim": list(_DIM_COLOR),
            "obstacle": OBSTACLE_COLOR.tolist(),
            "overlap": overlap_colors(max(1, most)).tolist(),
        },
        "tables": [_table(table) for table in data.tables],
        "trace": data.trace and _trace(data.trace),
        "facts": [[str(key), str(value)] for key, value in data.facts],
        "mounting": list(data.mounting),
    }
    return study, zlib.compress(bytes(blob), 9 if len(blob) < 2**23 else 6)


def _checked_map(model: PageModel, n_sensors: int) -> NDArray[np.bool_]:
    """Return the model's map (S, F), or say what is wrong with its shape."""
    visible = np.asarray(model.visible, dtype=bool)
    expected = (n_sensors, np.shape(model.faces)[0])
    if visible.shape != expected:
        raise ValueError(
            f"the map of '{model.name}' must have shape {expected}, got {visible.shape}"
        )
    return visible


def _pack_model(
    blob: bytearray, origin: NDArray[np.float64], model: PageModel, n_sensors: int
) -> dict[str, Any]:
    """Append a model to the bytes and return where it lies; mesh.js reads it back.

    To what a mesh has come a map, one bit a face; the faces that pieces belong to, as differences,
    which never fall; and the refusals, a byte each.
    """
    visible = _checked_map(model, n_sensors)
    entry = _pack_mesh(blob, origin, model)
    bits = np.packbits(visible, axis=1, bitorder="little")
    entry["visible"] = _append(blob, bits.tobytes())
    if model.piece_of is not None:
        owners = np.diff(np.asarray(model.piece_of, dtype=np.int64), prepend=0)
        entry["pieceOf"] = _append(blob, _byte_planes(owners.astype("<u4")))
    if model.refusals is not None:
        # of a face that is seen nobody asks: the commonest number deflates best
        refusals = np.array(model.refusals, dtype=np.uint8)
        if refusals.shape != visible.shape:
            raise ValueError(
                f"the refusals of '{model.name}' must have shape {visible.shape}, "
                f"got {refusals.shape}"
            )
        refusals[visible] = Refusal.OUTSIDE
        entry["refusals"] = _append(blob, refusals.tobytes())
    return entry


def _pack_mesh(
    blob: bytearray, origin: NDArray[np.float64], mesh: PageModel | PageObstacle
) -> dict[str, Any]:
    """Append a mesh to the bytes and return where it lies; mesh.js reads it back.

    Vertices are float32, faces the differences of successive indices with the sign in the
    lowest bit; both as byte planes, which deflate far better.
    """
    vertices = np.asarray(mesh.vertices, dtype=float)
    faces = np.asarray(mesh.faces, dtype=np.int64)
    if faces.ndim != 2 or faces.shape[1] != 3 or faces.size == 0:
        raise ValueError(f"faces of '{mesh.name}' must have shape (F, 3), got {faces.shape}")
    if faces.min() < 0 or faces.max() >= len(vertices):
        raise ValueError(f"faces of '{mesh.name}' must index its {len(vertices)} vertices")
    steps = np.diff(faces.ravel(), prepend=0)
    entry: dict[str, Any] = {"name": mesh.name, "nVertices": len(vertices), "nFaces": len(faces)}
    entry["vertices"] = _append(blob, _byte_planes((vertices - origin).astype("<f4")))
    entry["faces"] = _append(blob, _byte_planes(((steps << 1) ^ (steps >> 63)).astype("<u4")))
    return entry


def _byte_planes(words: NDArray[Any]) -> bytes:
    """Return all first bytes, then all second bytes, ... of 4-byte words."""
    return words.reshape(-1, 1).view(np.uint8).T.tobytes()


def _append(blob: bytearray, piece: bytes) -> int:
    """Append and return the offset."""
    offset = len(blob)
    blob += piece
    return offset


def _sensors(sensors: Sequence[PageSensor], origin: NDArray[np.float64]) -> list[dict[str, Any]]:
    colors = [hex_color(color) for color in sensor_colors(len(sensors))]
    entries = []
    for sensor, color in zip(sensors, colors, strict=True):
        pose = np.array(sensor.camera_to_world, dtype=float)
        pose[:3, 3] -= origin
        entries.append(
            {
                "name": sensor.name,
                "kind": sensor.kind,
                "camera_to_world": pose.tolist(),
                "tan_half": np.asarray(sensor.tan_half, dtype=float).tolist(),
                "min_distance": float(sensor.min_distance),
                "max_distance": float(sensor.max_distance),
                "max_incidence": float(sensor.max_incidence),
                "resolution": [int(n) for n in sensor.resolution],
                "color": sensor.color or color,
            }
        )
    return entries


def _table(table: PageTable) -> dict[str, Any]:
    for row in table.rows:
        if len(row) != len(table.header):
            raise ValueError(
                f"table '{table.title}' has {len(table.header)} columns, a row has {len(row)}"
            )
    rows = [[_cell(value) for value in row] for row in table.rows]
    return {
        "title": table.title,
        "note": table.note,
        "header": list(table.header),
        "rows": rows,
    }


def _cell(value: str | float) -> str | float | None:
    """Return a cell as JSON can hold it; NaN and infinity become empty."""
    if isinstance(value, str):
        return value
    number = float(value)
    return number if math.isfinite(number) else None


def _trace(trace: PageTrace) -> dict[str, list[float | None]]:
    columns = {"iteration": trace.iteration, "best": trace.best, "mean": trace.mean}
    return {
        name: [float(x) if math.isfinite(x) else None for x in np.asarray(column, dtype=float)]
        for name, column in columns.items()
    }


def _subtitle(data: PageData) -> str:
    """Return what the scene holds, in a line."""
    kinds = sorted({sensor.kind for sensor in data.sensors})
    return ", ".join(
        [
            _count(len(data.sensors), "sensor") + (f" ({', '.join(kinds)})" if kinds else ""),
            _count(len(data.models), "model"),
            *([_count(len(data.obstacles), "obstacle")] if data.obstacles else []),
            f"lengths in {unit_word(data.unit)}",
        ]
    )


def _count(n: int, noun: str) -> str:
    return f"{n} {noun}" + ("" if n == 1 else "s")
