"""What ``cast.comp.glsl`` is told: which clusters of which surface each view has to do with.

One list of clusters and one table of numbers serve all views and models that are looked at
together, so that little is sent to the GPU and seldom.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import Any

import numpy as np
from numpy.typing import NDArray

from glvis.sight.renderer import Renderer, Selection
from glvis.sight.views import Views

Bools = NDArray[np.bool_]
Floats = NDArray[np.float64]
OfViews = list[list[tuple[int, int]]]

# What the shader is told at a dispatch: the block View of cast.comp.glsl, name by name, filled up,
# for a uniform block may begin at any multiple of 256 bytes.
VIEW = np.dtype(
    [
        ("world_to_camera", "f4", 16),
        ("working_range", "f4", 2),
        ("min_cos", "f4", 2),
        ("clip", "f4", 2),
        ("unused", "f4", 2),
        ("tangent_to_pixel", "f4", 4),
        ("lattice", "f4", 4),
        ("tolerance", "f4"),
        ("cull_backs", "f4"),
        ("size", "i4", 2),
        ("first_row", "i4"),
        ("min_pixels", "i4"),
        ("size_log2", "u4"),
        ("first_cluster", "u4"),
        ("n_clusters", "u4"),
        ("n_small", "u4"),
        ("filler", "u4", 22),
    ]
)
# What does not depend on the view: of the work, then as above.
_REQUEST = np.dtype(
    [("masks", "i8"), ("clusters", "i8"), ("invocations", "i8"), ("tiles", "i8")]
    + [(name, VIEW[name]) for name in ("size", "min_pixels", "size_log2", "lattice", "tolerance")]
)
# Invocations a work group, as the shader says, and the groups that every OpenGL takes at once.
_GROUP, _MOST_GROUPS = 64, 65535


@dataclass(frozen=True)
class Rules:
    """When a face counts as seen.

    Attributes
    ----------
    min_pixels : int
        By its pixels: in how many it must show; 0 where pixels do not count.
    by_centre : bool
        Or else by its centre of mass, if nothing hides it.
    tolerance : float
        Share of its depth by which something must be nearer to hide a centre.
    """

    min_pixels: int
    by_centre: bool
    tolerance: float

    def defines(self, *, is_drawn: bool) -> list[str]:
        """Return the names that the shader knows them by, where something was drawn or not."""
        named = {"COUNT_PIXELS": self.min_pixels > 0, "LOOK_AT_CENTRE": self.by_centre}
        return ["JUDGE", *(name for name, holds in (named | {"DRAWN": is_drawn}).items() if holds)]


@dataclass(frozen=True, eq=False)
class Request:
    """What N views have to do with a surface of C clusters.

    Attributes
    ----------
    selection : Selection
        Of the surface, and whether backs are culled; its mask does not matter here.
    masks : sequence of (N, C) bool
        One or two: clusters of small faces, and those of large ones after them.
    renderer, rules
        What the views are looked at with.
    by_face : bool
        Whether an invocation has to do with a face of theirs, not a cluster.
    """

    selection: Selection
    masks: Sequence[Bools]
    renderer: Renderer
    rules: Rules
    by_face: bool

    @property
    def numbers(self) -> tuple[Any, ...]:
        """What there is to do, whatever the view: masks, clusters, invocations a cluster, ..."""
        surface, rules = self.selection.surface, self.rules
        faces = surface.clusters.size
        return (
            *(len(self.masks), self.masks[0].shape[1]),
            faces if self.by_face else 1,
            *(self.renderer.tiles, self.renderer.resolution, max(rules.min_pixels, 1)),
            *(faces.bit_length() - 1, surface.lattice, rules.tolerance),
        )


class WorkList:
    """What is told of R requests, worked out for all of them at once.

    Parameters
    ----------
    views : Views
        N of them.
    requests : sequence of Request
        What they ask.
    origin : (3,) float64
        As the surfaces were made with.

    Attributes
    ----------
    clusters : (L,) uint32
        All lists, one after the other: by request, then by view.
    view : (L,) int
        For which view each is listed.
    lists : mapping
        Where those of each request begin and end.
    told : (D,) VIEW
        What the shader is told at each dispatch.
    dispatches : mapping
        Of each request, by view: the place in what is told, and the work groups, of each dispatch.
    """

    def __init__(self, views: Views, requests: Sequence[Request], origin: Floats) -> None:
        n, r = len(views), len(requests)
        numbers = np.array([request.numbers for request in requests], dtype=_REQUEST)
        parts = numbers["masks"]
        # each mask of a request, view by view, is a part of one long row of places
        begin = np.concatenate([[0], np.cumsum(np.repeat(numbers["clusters"], n * parts))])
        listed = np.flatnonzero(np.concatenate([_side_by_side(one.masks) for one in requests]))
        ends = np.searchsorted(listed, begin)
        self.clusters = (listed - np.repeat(begin[:-1], np.diff(ends))).astype(np.uint32)
        # of each request and view, (R, N)
        first = (np.cumsum(n * parts) - n * parts)[:, None] + np.arange(n) * parts[:, None]
        start = ends[first]
        n_small, n_listed = ends[first + 1] - start, ends[first + parts[:, None]] - start
        self.view = np.repeat(np.tile(np.arange(n), r), n_listed.ravel())
        borders = pairwise([*start[:, 0].tolist(), len(listed)])
        self.lists = dict(zip(requests, borders, strict=True))

        # a dispatch has so many work groups at most
        each = numbers["invocations"]
        most = _MOST_GROUPS * _GROUP // each
        needed = -(-n_listed // most[:, None]).ravel()
        of = np.repeat(np.arange(r * n), needed)
        request, view = np.divmod(of, n)
        done = (np.arange(len(of)) - (np.cumsum(needed) - needed)[of]) * most[request]
        left = np.minimum(n_listed.ravel()[of] - done, most[request])

        told = self.told = _of_views(views, origin)[view]
        numbers = numbers[request]
        for name in ("size", "min_pixels", "size_log2", "lattice", "tolerance"):
            told[name] = numbers[name]
        half = numbers["size"] / 2
        told["tangent_to_pixel"][:, :2] = half / views.tan_half[view]
        told["tangent_to_pixel"][:, 2:] = half
        told["cull_backs"] = np.array([one.selection.cull_backs for one in requests])[request, view]
        told["first_row"] = numbers["size"][:, 1] * (view % numbers["tiles"])
        told["first_cluster"], told["n_clusters"] = start.ravel()[of] + done, left
        told["n_small"] = np.maximum(n_small.ravel()[of] - done, 0)

        self.dispatches: dict[Request, OfViews] = {one: [[] for _ in range(n)] for one in requests}
        groups = -(-left * each[request] // _GROUP)
        rows = zip(request.tolist(), view.tolist(), groups.tolist(), strict=True)
        for row, (k, v, n_groups) in enumerate(rows):
            self.dispatches[requests[k]][v].append((row, n_groups))


def _side_by_side(masks: Sequence[Bools]) -> Bools:
    """Return masks (N, C) as one row: view by view, one mask after the other."""
    return (np.concatenate(masks, axis=1) if len(masks) > 1 else masks[0]).ravel()


def _of_views(views: Views, origin: Floats) -> NDArray[np.void]:
    """Return what is told of each view alone, the rest 0, (N,) VIEW."""
    to_camera = views.world_to_camera.copy()
    to_camera[:, :3, 3] += to_camera[:, :3, :3] @ origin
    to_camera[:, 2] *= -1  # depth instead of z
    told = np.zeros(len(views), dtype=VIEW)
    told["world_to_camera"] = np.swapaxes(to_camera, 1, 2).reshape(-1, 16)  # by column
    for name, first, second in (
        ("working_range", views.min_distance, views.max_distance),
        ("min_cos", views.min_ray_cos, views.min_axis_cos),
        ("clip", views.clip_near, views.clip_far),
    ):
        told[name][:, 0], told[name][:, 1] = first, second
    return told
