"""Pieces of large faces: a face counts whole, so a map is only as true as its faces are small.

Faces are cut as studies are loaded, maps, objectives and search work on the pieces, and results
are folded back: what is told of the file's own face follows from the area of its pieces.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from glvis.problem.scene import Model, Pieces
from glvis.problem.sensor import Sensor, working_distance
from glvis.problem.visibility_options import VisibilityOptions, render_resolution

Floats = NDArray[np.float64]
Bools = NDArray[np.bool_]
Integers = NDArray[np.int64]

# Share of the shorter side of what a sensor sees at working distance: a face with a longer edge is
# large. By centroids, a furnished room of 172 m2 (tests/support/rooms.py) cut to that is 0.2 points
# of area off at most in the ten layouts of tools/bench.py --only room and 0.6 in what the search
# finds.
LARGE = 1 / 10
# Edges of pieces, as the same share. A piece counts by its centre without bias, but whole as soon
# as a pixel shows it: that adds half a piece all along the edge of what is seen. In the same
# layouts, by pixels, 1/10 is 3.4 points too large at worst, 1/20 1.4, 1/25 1.0, 1/30 0.8 and 1/36
# 0.5, as in what the search finds.
_PIECE = {"pixels": 1 / 36, "centroid": LARGE}
# Pixels along a piece's edge at working distance, at least, where pixels alone decide and would
# miss smaller pieces seen obliquely from afar: in these layouts at the sensor's 512 x 424, 12 are
# 0.1 to 0.8 points too large, 7 up to 2.1 too small.
_FEWEST_PIXELS = 12
# Share of a model's area that large faces hold, at least, for "auto" to cut it: as much as the
# whole error is to be, so that a hole closed by one large face does not cut a scan of a million.
WORTH_CUTTING = 0.01
# Pieces that "auto" adds to all models together, at most. With nearly as many in the room a map
# takes 13 ms in place of 2; what needs more is so large beside what a sensor sees that the pieces
# along the edge of that, however long, are a small part of it.
MOST_ADDED = 250_000
_COARSER = 2**0.25  # step of the edges where there would be more: midpoints halve them anyway
_MOST_PIECES = 4_000_000  # of a model; as many faces take 1.8 GiB in all


def cut_models(
    models: Sequence[Model],
    max_edge: float | str,
    sensors: Sequence[Sensor],
    options: VisibilityOptions,
) -> tuple[Model, ...]:
    """Return models whose faces are small enough; a model that needs no cut is the same object.

    Parameters
    ----------
    models : sequence of Model
        As their files have them.
    max_edge : float or str
        Longest edge that a piece may have, scene unit; "auto" follows from what the sensors see,
        "off" cuts nothing.
    sensors : sequence of Sensor
        Who looks, for "auto".
    options : VisibilityOptions
        By what pieces will count, for "auto".

    Raises
    ------
    ValueError
        If a length would cut a model into more pieces than fit in memory.
    """
    if max_edge == "off":
        return tuple(models)
    if max_edge == "auto":
        return _cut_by_view(models, sensors, options)
    return tuple(cut(model, float(max_edge)) for model in models)


def cut(model: Model, max_edge: float, most: int = _MOST_PIECES) -> Model:
    """Return a model with every edge longer than ``max_edge`` halved until none is.

    An edge is split by its own length alone, so both of its faces get the same vertices on it and
    what was closed stays closed. Pieces of a face follow each other, in the order of the file.

    Parameters
    ----------
    model : Model
        As its file has it.
    max_edge : float
        Scene unit, > 0.
    most : int
        Faces that the result may have.

    Raises
    ------
    ValueError
        If there would be more.
    """
    vertices = model.vertices
    left = np.flatnonzero(faces_beyond(model, max_edge))  # a face without a long edge is done
    if not len(left):
        return model
    small = np.ones(model.n_faces, dtype=bool)
    small[left] = False
    parts, owners = [model.faces[small]], [np.flatnonzero(small)]
    faces, n_done = model.faces[left].astype(np.int64), model.n_faces - len(left)
    while len(faces):
        ends = np.stack([faces, np.roll(faces, -1, axis=1)], axis=2)
        way = vertices[ends[..., 0]] - vertices[ends[..., 1]]
        is_long = np.linalg.norm(way, axis=2) > max_edge
        splits = is_long.sum(axis=1)
        if n_done + len(faces) + int(splits.sum()) > most:
            raise ValueError(
                f"max_edge = {max_edge:g} cuts {model.name} into more than {most:,} pieces; "
                "must be longer"
            )
        pairs = np.sort(ends[is_long], axis=1)
        unique, which = np.unique(pairs[:, 0] * len(vertices) + pairs[:, 1], return_inverse=True)
        low, high = np.divmod(unique, len(vertices))
        middle = np.zeros_like(faces)  # of each face's edges, where they are split
        middle[is_long] = len(vertices) + which.reshape(-1)
        vertices = np.concatenate([vertices, (vertices[low] + vertices[high]) / 2])
        parts.append(faces[splits == 0].astype(np.int32))
        owners.append(left[splits == 0])
        n_done += len(owners[-1])
        finer, whose = [], []
        for n, split in enumerate((_in_two, _in_three, _in_four), start=1):
            some = np.flatnonzero(splits == n)
            finer.append(split(faces[some], middle[some], is_long[some], vertices).reshape(-1, 3))
            whose.append(np.repeat(left[some], n + 1))
        faces, left = np.concatenate(finer), np.concatenate(whose)
    owner = np.concatenate(owners).astype(np.int32)
    order = np.argsort(owner, kind="stable")
    ordered, owner = np.concatenate(parts)[order], owner[order]
    for array in (vertices, ordered, owner):
        array.flags.writeable = False
    pieces = Pieces(model, owner, max_edge)
    return Model(model.name, vertices, ordered, model.path, pieces, model.parts)


def view_side(model: Model, sensor: Sensor) -> float:
    """Return the shorter side of what a sensor sees of a model, scene unit.

    Of its image at working distance, and of the model no more than its diagonal.
    """
    side = 2 * float(sensor.lens.tan_half.min()) * working_distance(sensor)
    return min(side, float(np.linalg.norm(np.ptp(model.bounds, axis=0))))


def large_limit(model: Model, sensors: Sequence[Sensor]) -> float:
    """Return the length beyond which an edge of a model is large to one of the sensors."""
    return LARGE * min(view_side(model, sensor) for sensor in sensors)


def faces_beyond(model: Model, edge: float) -> Bools:
    """Return which faces of a model have a longer edge than that, (F,) bool."""
    found = np.zeros(model.n_faces, dtype=bool)
    if model.longest_edge <= edge:
        return found
    for i in range(3):
        side = model.vertices[model.faces[:, i]] - model.vertices[model.faces[:, i - 1]]
        found |= np.linalg.norm(side, axis=1) > edge
    return found


def noun_of_shares(models: Sequence[Model], by_area: bool = False) -> str:
    """Return what the parts of models that people read of are shares of: "faces" or "area".

    Of the area where the objective is ``by_area``, or one of the models was cut: pieces are no
    faces of the file, and how many there are means nothing. Else of the number of faces, as the
    paper counts.
    """
    return "area" if by_area or any(model.pieces for model in models) else "faces"


def share_of(model: Model, chosen: Bools, noun: str) -> float:
    """Return the share of a model, by "faces" or "area", that some of its faces (F,) are."""
    if noun == "faces":
        return float(chosen.mean())
    return float(model.areas[chosen].sum() / model.areas.sum())


def pieces_words(model: Model, unit: str) -> str:
    """Return in a sentence what was cut, or "" where nothing was."""
    if model.pieces is None:
        return ""
    pieces = np.bincount(model.pieces.file_face)
    is_cut = pieces > 1
    areas = model.file.areas
    return (
        f"{model.name}: {np.count_nonzero(is_cut):,} faces hold "
        f"{100 * areas[is_cut].sum() / areas.sum():.0f} % of the area; cut into "
        f"{pieces[is_cut].sum():,} pieces, edges up to {model.pieces.max_edge:.3g} {unit}"
    )


def _cut_by_view(
    models: Sequence[Model], sensors: Sequence[Sensor], options: VisibilityOptions
) -> tuple[Model, ...]:
    """Return models cut as finely as the sensors' views ask for, and the bound allows."""
    edges = {}
    for m, model in enumerate(models):
        edge = _piece_edge(model, sensors, options)
        is_large = faces_beyond(model, max(large_limit(model, sensors), edge))
        if model.areas[is_large].sum() > WORTH_CUTTING * model.areas.sum():
            edges[m] = edge
    # no piece is larger than the triangle of three such edges: fewer pieces cannot do
    fewest = sum(models[m].areas.sum() / edge**2 for m, edge in edges.items()) * 4 / math.sqrt(3)
    factor = max(1.0, math.sqrt(fewest / (MOST_ADDED + sum(models[m].n_faces for m in edges))))
    while True:
        found, left = list(models), MOST_ADDED
        try:
            for m, edge in edges.items():
                found[m] = cut(models[m], factor * edge, models[m].n_faces + left)
                left -= found[m].n_faces - models[m].n_faces
        except ValueError:
            factor *= _COARSER
            continue
        return tuple(found)


def _piece_edge(model: Model, sensors: Sequence[Sensor], options: VisibilityOptions) -> float:
    """Return the longest edge that pieces are to have, scene unit."""
    edges = []
    for sensor in sensors:
        share = _PIECE[options.criterion]
        resolution = render_resolution(options, sensor)
        if resolution:
            across = min(resolution)
            share = max(share, _FEWEST_PIXELS * math.sqrt(options.min_pixels) / across)
        edges.append(share * view_side(model, sensor))
    return min(edges)


# How a face with so many split edges falls apart: from faces (n, 3), the middles of their edges ab,
# bc, ca (n, 3), and which of these are split, to the corners of the parts. The winding stays.


def _in_two(faces: Integers, middle: Integers, is_split: Bools, vertices: Floats) -> Integers:
    (a, b, c), (ab, _, _) = _turned(faces, middle, is_split.argmax(axis=1))
    return np.stack([a, ab, c, ab, b, c], axis=1)


def _in_three(faces: Integers, middle: Integers, is_split: Bools, vertices: Floats) -> Integers:
    (a, b, c), (ab, bc, _) = _turned(faces, middle, (~is_split).argmax(axis=1) + 1)
    # the corner at b goes, what is left has two diagonals: the shorter one makes the better pieces
    lengths = [np.linalg.norm(vertices[p] - vertices[q], axis=1) for p, q in ((a, bc), (c, ab))]
    by_a = np.stack([ab, b, bc, a, ab, bc, a, bc, c], axis=1)
    by_c = np.stack([ab, b, bc, a, ab, c, ab, bc, c], axis=1)
    return np.where((lengths[0] <= lengths[1])[:, None], by_a, by_c)


def _in_four(faces: Integers, middle: Integers, is_split: Bools, vertices: Floats) -> Integers:
    (a, b, c), (ab, bc, ca) = faces.T, middle.T
    return np.stack([a, ab, ca, ab, b, bc, ca, bc, c, ab, bc, ca], axis=1)


def _turned(faces: Integers, middle: Integers, first: Integers) -> tuple[Integers, Integers]:
    """Return corners (3, n) and middles (3, n) that begin with the edge ``first`` (n,)."""
    columns = (first[:, None] + np.arange(3)) % 3
    return np.take_along_axis(faces, columns, 1).T, np.take_along_axis(middle, columns, 1).T
