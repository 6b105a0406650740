"""Packs what the page shows: a description as JSON, and meshes and maps as bytes."""

from __future__ import annotations

import math
import zlib
from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from glvis.common.palette import (
    OBSTACLE_COLOR,
    SEEN_COLOR,
    hex_color,
    overlap_colors,
    rgb,
    second_tones,
    sensor_colors,
)
from glvis.problem.field import (
    Field,
    body_tangents,
    common_border,
    field_of,
    lens_words,
    partner_field,
    partner_words,
)
from glvis.problem.sensor import Sensor
from glvis.problem.units import unit_word
from glvis.viewer.page_data import (
    PageData,
    PageModel,
    PageObstacle,
    PageQuality,
    PageSensor,
    PageTable,
    PageTrace,
)
from glvis.visibility.filters import Refusal

_DIGITS = 6  # of directions and places of lines: a millionth of a unit is not to be seen
_DIM_COLOR = (168, 174, 184)  # faces that do not matter while one sensor is looked at

# Why a sensor does not see a face, in the few words that a line of the page has room for.
_REFUSALS = {
    Refusal.OUTSIDE: "outside its view",
    Refusal.TURNED_AWAY: "faces away",
    Refusal.TOO_FAR: "too far",
    Refusal.TOO_NEAR: "too near",
    Refusal.TOO_OBLIQUE: "too oblique",
    Refusal.OUTSIDE_PARTNER: "outside the partner's image",
    Refusal.TURNED_FROM_PARTNER: "turned from the partner",
    Refusal.NONE: "hidden",
}

_MOST_FOLD = 1e-3  # of a number's largest value: less is told as so much


def packed(data: PageData) -> tuple[dict[str, Any], bytes]:
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
    which never fall; and the refusals and how good each view is, a byte each.
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
    entry["qualities"] = [_pack_quality(blob, one, visible) for one in model.qualities]
    return entry


def _pack_quality(
    blob: bytearray, quality: PageQuality, visible: NDArray[np.bool_]
) -> dict[str, Any]:
    """Append a number of each view as a byte and return where it lies; mesh.js reads it back.

    0 is none; 1 to 255 are equal factors from low to high, as two digits are all that is told.
    """
    values = np.array(quality.values, dtype=float)
    if values.shape != visible.shape:
        raise ValueError(
            f"the values of '{quality.label}' must have shape {visible.shape}, got {values.shape}"
        )
    known = visible & np.isfinite(values)
    high = float(values[known].max(initial=0.0)) or 1.0
    low = max(float(values[known].min(initial=high)), _MOST_FOLD * high)
    steps = np.zeros(visible.shape, dtype=np.uint8)
    share = np.log(np.maximum(values[known], low) / low) / (math.log(high / low) or 1.0)
    steps[known] = 1 + np.round(254 * share)
    return {
        "label": quality.label,
        "unit": quality.unit,
        "low": low,
        "high": high,
        "steps": _append(blob, steps.tobytes()),
    }


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
        own = sensor.color or color
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
                "color": own,
                **({} if sensor.whole is None else _whole(sensor.whole, rgb(own))),
            }
        )
    return entries


def _whole(sensor: Sensor, color: NDArray[np.uint8]) -> dict[str, Any]:
    """Return what a page must know of a sensor that is no ideal pinhole; glyphs.js draws it."""
    lens, second = sensor.lens, partner_field(sensor)
    shared = [common_border(sensor, at) for at in (sensor.min_distance, sensor.max_distance)]
    return {
        "lens": lens.kind,
        "words": lens_words(lens),
        "opening": np.degrees(lens.opening).round(6).tolist(),
        "distance": sensor.distance,
        "body": body_tangents(lens).tolist(),
        "field": _field(field_of(sensor)),
        "second": second
        and {
            "role": partner_words(sensor),
            "field": _field(second),
            "pose": sensor.partner and sensor.partner.partner_to_sensor.tolist(),
            "body": sensor.partner and body_tangents(sensor.partner.lens).tolist(),
            "colors": [hex_color(second_tones(color, on_dark=dark)) for dark in (False, True)],
            "common": [border.round(_DIGITS).tolist() for border in shared if len(border)],
        },
    }


def _field(field: Field) -> dict[str, Any]:
    """Return the lines of a field of view."""
    return {
        "centre": field.centre.tolist(),
        "flat": field.is_flat,
        "borders": [line.round(_DIGITS).tolist() for line in field.borders],
        "ribs": [line.round(_DIGITS).tolist() for line in field.ribs],
        "rays": field.rays.round(_DIGITS).tolist(),
    }


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
