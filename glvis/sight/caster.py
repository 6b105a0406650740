"""Visibility maps where OpenGL 4.3 is there: small faces are cast in a compute shader, not drawn.

A rasteriser sets up every triangle, and for a triangle of a few pixels that is nearly all of
its cost. Here each view's clusters are parted by the size of their faces in pixels: the small
ones are cast, one invocation a face (``shaders/cast.comp.glsl``), the large ones are drawn as
ever. A second pass judges every face against both depths; by their centres alone, one invocation
judges a cluster and has its word of bits to itself, for atomic operations are slow in software.
Images stay where they are: what is read back is one bit a face, and the IDs of drawn faces where
pixels count.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from glvis.sight.clusters import Clusters, Joined
from glvis.sight.context import gl_context
from glvis.sight.renderer import Renderer, Selection, faces_in_images
from glvis.sight.surface import compiled_compute
from glvis.sight.views import NEAREST, Views
from glvis.sight.worklist import VIEW, OfViews, Request, Rules, WorkList

Floats = NDArray[np.float64]
Bools = NDArray[np.bool_]

_VERSION = 430  # compute shaders and storage buffers
# Pixels along an edge up to which a face is cast; beyond, drawing is as fast on llvmpipe, which
# also leaves a loop, and so a face, after 65,535 pixels. Where a usual face is larger than _LARGE,
# much is drawn anyway, and what is small beside it too.
_SMALL, _SMALL_AMONG_LARGE, _LARGE = 64.0, 8.0, 16.0
_CLUSTERS, _DEPTH, _SEEN = range(3)  # storage buffers of the shader
_FACES, _DRAWN = range(2)  # its textures


def has_compute() -> bool:
    """Return whether this process's OpenGL has compute shaders."""
    return int(gl_context().version_code) >= _VERSION


def can_hold(resolution: tuple[int, int]) -> bool:
    """Return whether a view of this many pixels fits into a storage buffer."""
    limit = gl_context().info["GL_MAX_SHADER_STORAGE_BLOCK_SIZE"]
    return 4 * resolution[0] * resolution[1] <= limit


@dataclass(frozen=True, eq=False)
class Look:
    """What N views are asked of a model.

    Attributes
    ----------
    targets : Selection
        What they see of the model that is counted.
    candidates : (N, C) bool
        Its clusters that may have a face to count.
    hiding : sequence of Selection
        What they see of what only hides.
    rules : Rules
        What counts.
    renderer : Renderer
        Draws the large faces; has the resolution and the number of views at once.
    """

    targets: Selection
    candidates: Bools
    hiding: Sequence[Selection]
    rules: Rules
    renderer: Renderer

    @property
    def clusters(self) -> Clusters:
        """Of what is counted."""
        return self.targets.surface.clusters

    @property
    def selections(self) -> Sequence[Selection]:
        """All that may hide something."""
        return [self.targets, *self.hiding]


class Caster:
    """The two passes, and what they share: buffers that grow with what they hold."""

    def __init__(self) -> None:
        self._stores = {name: _Store() for name in ("nothing", "depth", "told", "clusters", "seen")}
        self._joined: Joined | None = None

    def release(self) -> None:
        """Give the GPU's memory back."""
        for store in self._stores.values():
            store.release()

    def visible(self, views: Views, looks: Sequence[Look], *, origin: Floats) -> list[Bools]:
        """Return which faces each view sees, (N, F) bool a look.

        Parameters
        ----------
        views : Views
            N cameras.
        looks : sequence of Look
            What they look at, one by one; what the GPU is told of all is sent at once.
        origin : (3,) float64
            As the surfaces were made with.
        """
        visible = [
            np.zeros((len(views), look.clusters.model.n_faces), dtype=bool) for look in looks
        ]
        if not len(views) or not looks:
            return visible
        plans = self._plans(views, looks)
        work = WorkList(views, [one for plan in plans for one in plan.requests], origin)
        self._hold("told", work.told)
        self._hold("clusters", work.clusters).bind_to_storage_buffer(_CLUSTERS)
        seen = self._hold("seen", np.zeros_like(work.clusters))
        seen.bind_to_storage_buffer(_SEEN)
        for plan, faces in zip(plans, visible, strict=True):
            self._look(plan, work, views, origin, faces)
        if work.clusters.size:
            _mark(visible, plans, work, np.frombuffer(seen.read(work.clusters.nbytes), dtype="<u4"))
        return visible

    def _plans(self, views: Views, looks: Sequence[Look]) -> list[_Plan]:
        """Return what is cast, drawn and judged of each look."""
        selections = [one for look in looks for one in look.selections]
        joined = self._joined_of([one.surface.clusters for one in selections])
        share = np.repeat(_shares_to_cast(views, looks), [len(one.selections) for one in looks], 0)
        small = joined.seen_small(views.depth_plane, NEAREST * views.max_distance, share)
        mask = np.concatenate([one.mask for one in selections], axis=1)
        cast, drawn = mask & small, mask & ~small
        all_small = bool(small.all())
        plans, columns = [], iter(joined.columns)
        for look in looks:
            mine = [next(columns) for _ in look.selections]
            pairs = list(zip(look.selections, mine, strict=True))
            small_targets = small[:, mine[0]]
            to_judge = [look.candidates & small_targets]
            if look.rules.by_centre and not all_small:
                to_judge.append(look.candidates & ~small_targets)
            by_face = look.rules.min_pixels > 0
            with_what = (look.renderer, look.rules)
            casting = [Request(one, [cast[:, part]], *with_what, True) for one, part in pairs]
            judging = Request(look.targets, to_judge, *with_what, by_face)
            to_draw = []
            if not all_small and any(drawn[:, part].any() for part in mine):
                to_draw = [replace(one, mask=drawn[:, part]) for one, part in pairs]
            plans.append(_Plan(look, casting, judging, to_draw))
        return plans

    def _joined_of(self, clusters: list[Clusters]) -> Joined:
        """Return clusters side by side; mostly they are the same as before."""
        if self._joined is None or self._joined.clusters != clusters:
            self._joined = Joined(clusters)
        return self._joined

    def _look(
        self, plan: _Plan, work: WorkList, views: Views, origin: Floats, visible: Bools
    ) -> None:
        """Run both passes of a look; mark the faces (N, F) that were drawn and show."""
        look, renderer = plan.look, plan.look.renderer
        cast = compiled_compute("cast")
        is_drawn = len(plan.to_draw) > 0
        judge = compiled_compute("cast", *look.rules.defines(is_drawn=is_drawn))
        windows = None
        if is_drawn:
            windows = views.windows(look.clusters.corners, renderer.resolution)
        drawing = renderer.batches(
            views,
            plan.to_draw,
            origin=origin,
            with_ids=plan.with_ids,
            behind_cast=True,
            windows=windows,
        )
        for first in range(0, len(views), renderer.tiles):
            some = slice(first, min(first + renderer.tiles, len(views)))
            self._clear_depth(renderer)
            for request in plan.casting:
                self._run(cast, request, work.dispatches[request][some])
            gl_context().memory_barrier()
            if is_drawn:
                next(drawing)
            for tile, of_view in enumerate(work.dispatches[plan.judging][some]):
                if is_drawn:
                    renderer.use_depths(tile, _DRAWN)
                self._run(judge, plan.judging, [of_view])
            gl_context().memory_barrier()
            if plan.with_ids:
                images = renderer.read_windows()
                visible[some] = faces_in_images(images, visible.shape[1], look.rules.min_pixels)

    def _hold(self, name: str, values: NDArray[Any]) -> Any:
        return self._stores[name].holding(values)

    def _clear_depth(self, renderer: Renderer) -> None:
        """Bind depths in which nothing is near."""
        nothing, depth = self._stores["nothing"], self._stores["depth"]
        width, height = renderer.resolution
        size = 4 * renderer.tiles * width * height
        if nothing.size < size:
            far = np.full(size // 4, np.inf, dtype=np.float32)
            nothing.holding(far)
            depth.holding(far)
        gl_context().copy_buffer(depth.buffer, nothing.buffer, size)
        depth.buffer.bind_to_storage_buffer(_DEPTH)

    def _run(self, program: Any, request: Request, of_views: OfViews) -> None:
        """Do what some views have to do with a surface."""
        request.selection.surface.use_packed(_FACES)
        told = self._stores["told"].buffer
        for of_view in of_views:
            for row, groups in of_view:
                told.bind_to_uniform_block(0, offset=VIEW.itemsize * row, size=VIEW.itemsize)
                program.run(groups)


@dataclass(frozen=True, eq=False)
class _Plan:
    """What is cast, drawn and judged of a look.

    Attributes
    ----------
    look : Look
        Itself.
    casting : sequence of Request
        Small faces of each of its selections.
    judging : Request
        Candidates.
    to_draw : sequence of Selection
        Large faces of each, or nothing where none are large.
    """

    look: Look
    casting: Sequence[Request]
    judging: Request
    to_draw: Sequence[Selection]

    @property
    def requests(self) -> Sequence[Request]:
        """All of them."""
        return [*self.casting, self.judging]

    @cached_property
    def with_ids(self) -> bool:
        """Whether drawn faces are counted."""
        is_drawn = bool(self.to_draw) and bool(self.to_draw[0].mask.any())
        return is_drawn and self.look.rules.min_pixels > 0


def _mark(
    visible: Sequence[Bools], plans: Sequence[_Plan], work: WorkList, words: NDArray[np.uint32]
) -> None:
    """Mark the faces (N, F), by plan, of judged clusters whose bits in words (L,) are set."""
    some = np.flatnonzero(words)
    octets = words[some].view(np.uint8).reshape(-1, 4)
    cluster, view = work.clusters[some], work.view[some]
    judged = np.searchsorted(some, [work.lists[plan.judging] for plan in plans]).tolist()
    for faces, plan, borders in zip(visible, plans, judged, strict=True):
        mine, clusters = slice(*borders), plan.look.clusters
        bits = np.unpackbits(octets[mine], axis=1, count=clusters.size, bitorder="little")
        place = clusters.order.reshape(-1, clusters.size)[cluster[mine]]
        place = place + (view[mine] * faces.shape[1])[:, None]
        faces.reshape(-1)[place[bits.view(bool)]] = True


class _Store:
    """A buffer that grows with what it holds."""

    def __init__(self) -> None:
        self.buffer: Any = None

    @property
    def size(self) -> int:
        """Bytes that it has room for."""
        return self.buffer.size if self.buffer else 0

    def holding(self, values: NDArray[Any]) -> Any:
        """Return the buffer with values at its beginning."""
        if self.buffer is None or self.buffer.size < values.nbytes:
            self.release()
            self.buffer = gl_context().buffer(reserve=max(values.nbytes, 256), dynamic=True)
        if values.nbytes:
            self.buffer.write(values)
        return self.buffer

    def release(self) -> None:
        """Give the memory back."""
        if self.buffer is not None:
            self.buffer.release()
            self.buffer = None


def _shares_to_cast(views: Views, looks: Sequence[Look]) -> Floats:
    """Return up to what share of its depth a face's edge may be long to be cast, (M, N).

    A view's map may not depend on the others.
    """
    sizes = np.array([look.renderer.resolution for look in looks])
    pixel = 2 * (views.tan_half / sizes[:, None]).min(axis=2)  # at unit depth
    x, y, z = np.array([look.clusters.middle for look in looks]).T[:, :, None]
    plane = views.depth_plane
    depth = plane[:, 0] * x + plane[:, 1] * y + plane[:, 2] * z + plane[:, 3]
    edges = np.array([look.clusters.model.mean_edge for look in looks])
    is_large = edges[:, None] > _LARGE * pixel * np.maximum(depth, views.clip_near)
    return np.where(is_large, _SMALL_AMONG_LARGE, _SMALL) * pixel
