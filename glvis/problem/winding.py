"""What the winding of a model's faces says: whether neighbours agree, and which way is out.

Judged on the model as a whole, near vertices taken as one and holes closed, for warnings and for
``init``; maps take every face as it is wound.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components

from glvis.problem.scene import Model
from glvis.problem.welding import welded_faces

Floats = NDArray[np.float64]
Bools = NDArray[np.bool_]
Integers = NDArray[np.int64]

# Edges with one face, of all: a body with more has no inside that holes only open.
_SLIGHTLY_OPEN = 0.1
_CLEARLY = 0.01  # of all there is; less is rounding, as of sheets modelled from both sides
_WITHIN = (0.2, 0.5, 0.8)  # of a box, where a room may be free
_SOME_POINTS = 1 << 21  # numbers of a run of solid angles


@dataclass(frozen=True)
class Winding:
    """How the faces of a model are wound.

    Attributes
    ----------
    open_edges : int
        Edges with one face, once near vertices are one.
    disputed_edges : int
        Edges that two faces walk in the same direction.
    against : (F,) bool
        Faces that are wound against the most of those they are connected with.
    doubled : (F,) bool
        Faces that lie on another one of the same corners which looks the other way.
    inside_out : (F,) bool
        Faces of bodies, closed or slightly open, whose normals point inwards; of a body within
        another one, which may be a cavity, none.
    """

    open_edges: int
    disputed_edges: int
    against: Bools
    doubled: Bools
    inside_out: Bools


def winding(model: Model) -> Winding:
    """Return how the faces of a model are wound."""
    faces = model.faces.astype(np.int64)
    if model.boundary_edges:
        faces = welded_faces(model.vertices, model.faces)
    doubled = _doubled(faces)
    own = np.flatnonzero(~doubled & (model.areas > 0))
    start = faces[own].ravel()
    end = np.roll(faces[own], -1, axis=1).ravel()
    face = np.repeat(np.arange(len(own)), 3)
    proper = start != end
    start, end, face = start[proper], end[proper], face[proper]
    is_forward = start < end
    keys = np.where(is_forward, start, end) * len(model.vertices) + np.where(is_forward, end, start)
    order = np.argsort(keys, kind="stable")
    keys, is_forward, face = keys[order], is_forward[order], face[order]
    first = np.flatnonzero(np.diff(keys, prepend=-1))
    count = np.diff(np.append(first, len(keys)))
    pair = first[count == 2]
    a, b, agrees = face[pair], face[pair + 1], is_forward[pair] != is_forward[pair + 1]
    against, body = _minorities(a, b, agrees, model.areas[own])
    single = first[count == 1]
    rim, rim_face = (start[order[single]], end[order[single]]), face[single]
    volume = _volumes(model, own, against, body, rim, rim_face)
    rims, sizes = (np.bincount(b, minlength=len(volume)) for b in (body[rim_face], body))
    is_open = rims > _SLIGHTLY_OPEN * 1.5 * sizes  # a body has 1.5 edges a face
    inverted = _without_cavities(model, own, body, (volume < 0) & ~is_open, (volume > 0) & ~is_open)
    return Winding(
        len(single),
        int(np.count_nonzero(~agrees)),
        _spread(against, own, model.n_faces),
        doubled,
        _spread(inverted[body], own, model.n_faces),
    )


def is_closed(model: Model) -> bool:
    """Return whether a model has no rim, near vertices taken as one; sheets are no bodies."""
    if model.is_closed:
        return True
    found = winding(model)
    return found.open_edges == 0 and not found.doubled.any()


def winding_numbers(model: Model, points: ArrayLike) -> Floats:
    """Return how often a model winds about points, (P,): 1 inside a body, 0 outside of all.

    -1 inside a body that is inside out, such as a room; fractions near openings. The solid angles
    of all faces, by Van Oosterom and Strackee 1983.

    Parameters
    ----------
    model : Model
        Of any faces, open or closed.
    points : (P, 3) float
        In the world frame.
    """
    at = np.asarray(points, dtype=float).reshape(-1, 3)
    total = np.zeros(len(at))
    step = max(1, _SOME_POINTS // max(1, len(at)))
    for begin in range(0, model.n_faces, step):
        corners = model.vertices[model.faces[begin : begin + step]]
        a, b, c = (corners[None, :, i] - at[:, None] for i in range(3))
        la, lb, lc = (np.linalg.norm(side, axis=2) for side in (a, b, c))
        volume = np.einsum("pfi,pfi->pf", a, np.cross(b, c))
        base = (
            la * lb * lc
            + np.einsum("pfi,pfi->pf", a, b) * lc
            + np.einsum("pfi,pfi->pf", b, c) * la
            + np.einsum("pfi,pfi->pf", c, a) * lb
        )
        total += 2 * np.arctan2(volume, base).sum(axis=1)
    return total / (4 * math.pi)


def is_in_solid(model: Model, points: ArrayLike) -> Bools:
    """Return which points (P, 3) lie in solid material of a model, or behind the walls of a room.

    In a room that is seen from within, as soon as one of the points lies in it, all is solid but
    what its surface encloses.
    """
    numbers = winding_numbers(model, points)
    free = 0.0
    at, (low, high) = np.asarray(points, dtype=float), model.bounds
    if looks_inwards(model) and ((at > low) & (at < high)).all(axis=-1).any():
        grid = np.stack(np.meshgrid(*[_WITHIN] * 3), axis=-1).reshape(-1, 3)
        least = winding_numbers(model, low + grid * (high - low)).min()
        free = -1.0 if min(least, numbers.min(initial=0.0)) < -0.9 else 0.0
    return np.asarray(numbers > free + 0.5)


def encloses(model: Model, points: ArrayLike) -> bool:
    """Return whether most of some points (P, 3) lie in the free space of a room, closed or nearly.

    Its walls then stand between the points and whoever looks from outside.
    """
    return looks_inwards(model) and bool(np.median(winding_numbers(model, points)) < -0.5)


def looks_inwards(model: Model) -> bool:
    """Return whether the faces of a model look at its middle more than away from it, as a room's.

    Weighed by area and distance, whatever is missing: walls that are not modelled do not look
    away, furniture stands with its front to the middle.
    """
    from_middle = model.centroids - model.bounds.mean(axis=0)
    flux = np.einsum("ij,ij,i->i", from_middle, model.normals, model.areas)
    return bool(flux.sum() < -_CLEARLY * np.abs(flux).sum())


def _doubled(faces: Integers) -> Bools:
    """Return which faces (F,) have the same corners as another one, the other way round."""
    order = np.argsort(faces, axis=1)
    # a cyclic order of the sorted corners is an even permutation
    is_even = (order[:, 1] - order[:, 0]) % 3 == 1
    corners = np.take_along_axis(faces, order, axis=1)
    in_row = np.lexsort(corners.T)
    is_new = (np.diff(corners[in_row], axis=0, prepend=-1) != 0).any(axis=1)
    same = np.zeros(len(faces), dtype=np.int64)
    same[in_row] = np.cumsum(is_new) - 1
    n = int(is_new.sum())
    ways = [np.bincount(same[is_one], minlength=n) > 0 for is_one in (is_even, ~is_even)]
    return np.asarray((ways[0] & ways[1])[same])


def _minorities(a: Integers, b: Integers, agrees: Bools, areas: Floats) -> tuple[Bools, Integers]:
    """Return which faces (n,) are wound against most of their body, and the body of each.

    Neighbours a and b either agree or not; each face stands twice, as it is and turned round, and
    is connected with its neighbour as that has to be.
    """
    n = len(areas)
    rows = np.concatenate([a, a + n])
    columns = np.concatenate([np.where(agrees, b, b + n), np.where(agrees, b + n, b)])
    twice = coo_array((np.ones(len(rows)), (rows, columns)), shape=(2 * n, 2 * n))
    _, side = connected_components(twice, directed=False)
    once = coo_array((np.ones(len(a)), (a, b)), shape=(n, n))
    bodies, body = connected_components(once, directed=False)
    # of a body's two sides the one with the smaller number; where they are one, nobody is right
    lower = np.full(bodies, 2 * n)
    np.minimum.at(lower, body, np.minimum(side[:n], side[n:]))
    is_lower = side[:n] == lower[body]
    is_moebius = side[:n] == side[n:]
    balance = np.bincount(body, np.where(is_lower, areas, -areas), minlength=bodies)
    return np.where(balance[body] >= 0, ~is_lower, is_lower) & ~is_moebius, body.astype(np.int64)


def _volumes(
    model: Model,
    own: Integers,
    against: Bools,
    body: Integers,
    rim: tuple[Integers, Integers],
    rim_face: Integers,
) -> Floats:
    """Return the signed volume of each body, its minority turned and its holes closed by fans."""
    bodies = int(body.max(initial=-1)) + 1
    middle = model.bounds.mean(axis=0)
    sign = np.where(against, -1.0, 1.0)
    flux = np.einsum(
        "ij,ij,i->i", model.centroids[own] - middle, model.normals[own], model.areas[own]
    )
    total = np.bincount(body, sign * flux, minlength=bodies)
    start, end = rim
    if not len(start):
        return total / 3
    used, place = np.unique(np.concatenate([start, end]), return_inverse=True)
    i, j = place.reshape(2, -1)
    graph = coo_array((np.ones(len(i)), (i, j)), shape=(len(used),) * 2)
    loops, loop = connected_components(graph, directed=False)
    points = model.vertices[used] - middle
    sizes = np.bincount(loop, minlength=loops)
    centre = np.stack([np.bincount(loop, points[:, k]) / sizes for k in range(3)], axis=1)
    # the fan's triangle walks the edge the other way: end, start, centre; six times its volume
    fans = np.einsum("ij,ij->i", np.cross(points[j], points[i]), centre[loop[i]])
    fans = np.bincount(body[rim_face], sign[rim_face] * fans / 2, minlength=bodies)
    return (total + fans) / 3


def _without_cavities(
    model: Model, own: Integers, body: Integers, inverted: Bools, proper: Bools
) -> Bools:
    """Return the inverted bodies that lie in the box of no proper one, (bodies,)."""
    if not inverted.any() or not proper.any():
        return inverted
    low = np.full((len(inverted), 3), math.inf)
    high = -low
    for corner in range(3):
        points = model.vertices[model.faces[own, corner]]
        np.minimum.at(low, body, points)
        np.maximum.at(high, body, points)
    found = inverted.copy()
    for one in np.flatnonzero(inverted):
        within = (low[proper] <= low[one]).all(axis=1) & (high[proper] >= high[one]).all(axis=1)
        found[one] = not within.any()
    return found


def _spread(values: Bools, own: Integers, n_faces: int) -> Bools:
    """Return values of some faces as those of all, False elsewhere."""
    found = np.zeros(n_faces, dtype=bool)
    found[own] = values
    return found
