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
from glvis.sight.surface import Surface
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
class Dispatches:
    """What N views have to do with a surface.

    Attributes
    ----------
    surface : Surface
        Whose clusters.
    whole : slice
        Where those of all views are listed.
    n_listed : (N,) int
        How many for each.
    records : list of list of tuple
        By view: the place in what is told, and the work groups, of each dispatch.
    """

    surface: Surface
    whole: slice
    n_listed: NDArray[np.intp]
    records: list[list[tuple[int, int]]]


class WorkList:
    """Collects dispatches.

    Parameters
    ----------
    views : Views
        N of them.
    """

    def __init__(self, views: Views) -> None:
        self._views = views
        self._tan_half = views.tan_half.tolist()
        self._lists: list[NDArray[np.intp]] = [np.zeros(0, dtype=np.intp)]
        self._n_listed = 0
        # of each dispatch: its view, and what it is told
        self._of: list[int] = []
        self._floats: list[tuple[float, ...]] = []
        self._integers: list[tuple[int, ...]] = []

    @property
    def clusters(self) -> NDArray[np.uint32]:
        """All lists, one after the other."""
        return np.concatenate(self._lists).astype(np.uint32)

    def add(
        self,
        selection: Selection,
        masks: Sequence[Bools],
        renderer: Renderer,
        rules: Rules,
        *,
        by_face: bool,
    ) -> Dispatches:
        """Add clusters of a surface; return what is to be dispatched.

        Parameters
        ----------
        selection : Selection
            Whose they are, and whether backs are culled; its mask does not matter here.
        masks : sequence of (N, C) bool
            One or two: those of small faces, and those of large ones after them.
        renderer, rules
            What the views are looked at with.
        by_face : bool
            Whether an invocation has to do with a face of theirs, not a cluster.
        """
        n_clusters = masks[0].shape[1]
        mask = np.concatenate(masks, axis=1) if len(masks) > 1 else masks[0]
        places = np.flatnonzero(mask)
        # where each view's begin, and its first that is not small
        marks = np.arange(len(mask) + 1)[:, None] * mask.shape[1] + [0, n_clusters]
        begin, large = np.searchsorted(places, marks).T
        n_listed, n_small = begin[1:] - begin[:-1], (large - begin)[:-1]
        self._lists.append(places % max(n_clusters, 1))

        width, height = renderer.resolution
        lattice, size = selection.surface.lattice.tolist(), selection.surface.clusters.size
        each = size if by_face else 1
        most = _MOST_GROUPS * _GROUP // each
        first_listed = self._n_listed
        records: list[list[tuple[int, int]]] = []
        for view, (count, small) in enumerate(
            zip(n_listed.tolist(), n_small.tolist(), strict=True)
        ):
            tan_x, tan_y = self._tan_half[view]
            to_pixel = (width / 2 / tan_x, height / 2 / tan_y, width / 2, height / 2)
            floats = (*to_pixel, *lattice, rules.tolerance, float(selection.cull_backs[view]))
            image = (width, height, height * (view % renderer.tiles), max(rules.min_pixels, 1))
            records.append([])
            for done in range(0, count, most):
                n = min(most, count - done)
                records[-1].append((len(self._of), -(-n * each // _GROUP)))
                self._of.append(view)
                self._floats.append(floats)
                listed = (self._n_listed + done, n, max(0, small - done))
                self._integers.append((*image, *listed, size.bit_length() - 1))
            self._n_listed += count
        whole = slice(first_listed, self._n_listed)
        return Dispatches(selection.surface, whole, n_listed, records)

    def told(self, origin: Floats) -> NDArray[np.uint32]:
        """Return what the shader is told at each dispatch, TOLD_BYTES a row.

        Parameters
        ----------
        origin : (3,) float64
            As the surfaces were made with.
        """
        views = self._views
        to_camera = views.world_to_camera.copy()
        to_camera[:, :3, 3] += to_camera[:, :3, :3] @ origin
        to_camera[:, 2] *= -1  # depth instead of z
        of_view = np.zeros((len(views), _WORDS), dtype=np.uint32)
        floats = of_view[:, _OF_VIEW].view(np.float32)
        floats[:, :16] = np.swapaxes(to_camera, 1, 2).reshape(-1, 16)  # by column
        floats[:, 16], floats[:, 17] = views.min_distance, views.max_distance
        floats[:, 18], floats[:, 19] = views.min_ray_cos, views.min_axis_cos
        floats[:, 20], floats[:, 21] = views.clip_near, views.clip_far
        told = of_view[self._of]
        if self._of:
            told[:, _FLOATS].view(np.float32)[:] = self._floats
            told[:, _INTEGERS] = self._integers
        return told
