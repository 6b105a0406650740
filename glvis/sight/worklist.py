"""What ``cast.comp.glsl`` is told: which clusters of which surface each view has to do with.

One list of clusters and one table of numbers serve all views and models that are looked at
together, so that little is sent to the GPU and seldom.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from glvis.sight.renderer import Renderer, Selection
from glvis.sight.views import Views

Bools = NDArray[np.bool_]
Floats = NDArray[np.float64]

# What the shader is told of a view and its work, View in cast.comp.glsl, in words: of the view
# alone, then floats, then integers. A uniform block may begin at any multiple of 64 of them.
_WORDS = 64
TOLD_BYTES = 4 * _WORDS
_OF_VIEW, _FLOATS, _INTEGERS = slice(0, 24), slice(24, 34), slice(34, 42)
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
    def integers(self) -> tuple[int, ...]:
        """Masks, clusters, invocations a cluster, and what the shader is told of any view.

        That is width and height, then the views that share a buffer, in whose place the shader
        has the first row of one, the least pixels of a face, and the size of clusters.
        """
        size = self.selection.surface.clusters.size
        return (
            len(self.masks),
            self.masks[0].shape[1],
            size if self.by_face else 1,
            *self.renderer.resolution,
            self.renderer.tiles,
            max(self.rules.min_pixels, 1),
            size.bit_length() - 1,
        )

    @property
    def floats(self) -> tuple[float, ...]:
        """What the shader is told of any view in floats."""
        return (*self.selection.surface.lattice.tolist(), self.rules.tolerance)


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
    begin : (R + 1,) int
        Where the lists of each request begin; the last is where all end.
    told : (D, words) uint32
        What the shader is told at each dispatch, TOLD_BYTES a row.
    dispatches : list of list of list of tuple
        By request and view: the row in what is told, and the work groups, of each dispatch.
    """

    def __init__(self, views: Views, requests: Sequence[Request], origin: Floats) -> None:
        n, r = len(views), len(requests)
        integers = np.array([request.integers for request in requests])
        parts, n_clusters, each = integers[:, :3].T
        # each mask of a request, view by view, is a part of one long row of places
        begin = np.concatenate([[0], np.cumsum(np.repeat(n_clusters, n * parts))])
        listed = np.flatnonzero(np.concatenate([_side_by_side(one.masks) for one in requests]))
        ends = np.searchsorted(listed, begin)
        self.clusters = (listed - np.repeat(begin[:-1], np.diff(ends))).astype(np.uint32)
        # of each request and view, (R, N)
        first = (np.cumsum(n * parts) - n * parts)[:, None] + np.arange(n) * parts[:, None]
        start = ends[first]
        n_small, n_listed = ends[first + 1] - start, ends[first + parts[:, None]] - start
        self.view = np.repeat(np.tile(np.arange(n), r), n_listed.ravel())
        self.begin = np.append(start[:, 0], len(listed))

        # a dispatch has so many work groups at most
        most = _MOST_GROUPS * _GROUP // each
        needed = -(-n_listed // most[:, None]).ravel()
        of = np.repeat(np.arange(r * n), needed)
        request, view = np.divmod(of, n)
        done = (np.arange(len(of)) - (np.cumsum(needed) - needed)[of]) * most[request]
        left = np.minimum(n_listed.ravel()[of] - done, most[request])
        groups = -(-left * each[request] // _GROUP)

        self.told = _of_views(views, origin)[view]
        told = self.told[:, _INTEGERS]
        told[:, :5] = integers[request, 3:]
        told[:, 2] = told[:, 1] * (view % told[:, 2])  # of this view in depth
        told[:, 5], told[:, 6] = start.ravel()[of] + done, left
        told[:, 7] = np.maximum(n_small.ravel()[of] - done, 0)
        half = integers[request, 3:5] / 2
        floats = self.told[:, _FLOATS].view(np.float32)
        floats[:, :2], floats[:, 2:4] = half / views.tan_half[view], half
        floats[:, 4:9] = np.array([one.floats for one in requests])[request]
        floats[:, 9] = np.array([one.selection.cull_backs for one in requests])[request, view]

        self.dispatches: list[list[list[tuple[int, int]]]] = [
            [[] for _ in range(n)] for _ in range(r)
        ]
        numbers = zip(request.tolist(), view.tolist(), groups.tolist(), strict=True)
        for row, (of_request, of_view, n_groups) in enumerate(numbers):
            self.dispatches[of_request][of_view].append((row, n_groups))


def _side_by_side(masks: Sequence[Bools]) -> Bools:
    """Return masks (N, C) as one row: view by view, one mask after the other."""
    return (np.concatenate(masks, axis=1) if len(masks) > 1 else masks[0]).ravel()


def _of_views(views: Views, origin: Floats) -> NDArray[np.uint32]:
    """Return what is told of each view alone, the rest 0, (N, words)."""
    to_camera = views.world_to_camera.copy()
    to_camera[:, :3, 3] += to_camera[:, :3, :3] @ origin
    to_camera[:, 2] *= -1  # depth instead of z
    told = np.zeros((len(views), _WORDS), dtype=np.uint32)
    floats = told[:, _OF_VIEW].view(np.float32)
    floats[:, :16] = np.swapaxes(to_camera, 1, 2).reshape(-1, 16)  # by column
    floats[:, 16], floats[:, 17] = views.min_distance, views.max_distance
    floats[:, 18], floats[:, 19] = views.min_ray_cos, views.min_axis_cos
    floats[:, 20], floats[:, 21] = views.clip_near, views.clip_far
    return told
