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

from glvis.sight.clusters import Clusters
from glvis.sight.context import gl_context
from glvis.sight.renderer import Renderer, Selection, faces_in_images
from glvis.sight.surface import compiled_compute
from glvis.sight.views import NEAREST, Views
from glvis.sight.worklist import TOLD_BYTES, Dispatches, Rules, WorkList

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


class Caster:
    """The two passes, and what they share: buffers that grow with what they hold."""

    def __init__(self) -> None:
        self._stores = {name: _Store() for name in ("nothing", "depth", "told", "clusters", "seen")}

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
        work = WorkList(views)
        shares = _shares_to_cast(views, looks)
        plans = [
            _Plan.of(look, views, share, work) for look, share in zip(looks, shares, strict=True)
        ]
        self._hold("told", work.told(origin))
        clusters = work.clusters
        self._hold("clusters", clusters).bind_to_storage_buffer(_CLUSTERS)
        seen = self._hold("seen", np.zeros_like(clusters))
        seen.bind_to_storage_buffer(_SEEN)
        for plan, faces in zip(plans, visible, strict=True):
            self._look(plan, views, origin, faces)
        words = clusters
        if clusters.size:
            words = np.frombuffer(seen.read(clusters.nbytes), dtype="<u4")
        for plan, faces in zip(plans, visible, strict=True):
            _mark(faces, plan, clusters[plan.judging.whole], words[plan.judging.whole])
        return visible

    def _look(self, plan: _Plan, views: Views, origin: Floats, visible: Bools) -> None:
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
            some = range(first, min(first + renderer.tiles, len(views)))
            self._clear_depth(renderer)
            for dispatches in plan.casting:
                self._run(cast, dispatches, some)
            gl_context().memory_barrier()
            if is_drawn:
                next(drawing)
                renderer.use_depths(_DRAWN)
            self._run(judge, plan.judging, some)
            gl_context().memory_barrier()
            if plan.with_ids:
                images = renderer.read_ids(len(some))
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

    def _run(self, program: Any, dispatches: Dispatches, some: range) -> None:
        """Do what some views have to do with a surface."""
        dispatches.surface.use_packed(_FACES)
        told = self._stores["told"].buffer
        for view in some:
            for record, groups in dispatches.records[view]:
                told.bind_to_uniform_block(0, offset=TOLD_BYTES * record, size=TOLD_BYTES)
                program.run(groups)


@dataclass(frozen=True, eq=False)
class _Plan:
    """What is cast, drawn and judged of a look.

    Attributes
    ----------
    look : Look
        Itself.
    casting : sequence of Dispatches
        Small faces of each of its selections.
    judging : Dispatches
        Candidates.
    to_draw : sequence of Selection
        Large faces of each, or nothing where none are large.
    """

    look: Look
    casting: Sequence[Dispatches]
    judging: Dispatches
    to_draw: Sequence[Selection]

    @classmethod
    def of(cls, look: Look, views: Views, share: Floats, work: WorkList) -> _Plan:
        """Return the plan for N views that cast edges up to a share (N,) of their depth."""
        selections = [look.targets, *look.hiding]
        near = NEAREST * views.max_distance
        small = [
            one.surface.clusters.seen_small(views.depth_plane, near, share) for one in selections
        ]
        pairs = list(zip(selections, small, strict=True))
        to_judge = [look.candidates & small[0]]
        if look.rules.by_centre:
            to_judge.append(look.candidates & ~small[0])
        with_what = (look.renderer, look.rules)
        by_face = look.rules.min_pixels > 0
        to_draw = [replace(one, mask=one.mask & ~part) for one, part in pairs]
        return cls(
            look,
            [work.add(one, [one.mask & part], *with_what, by_face=True) for one, part in pairs],
            work.add(look.targets, to_judge, *with_what, by_face=by_face),
            to_draw if any(one.mask.any() for one in to_draw) else [],
        )

    @cached_property
    def with_ids(self) -> bool:
        """Whether drawn faces are counted."""
        is_drawn = bool(self.to_draw) and bool(self.to_draw[0].mask.any())
        return is_drawn and self.look.rules.min_pixels > 0


def _mark(
    visible: Bools, plan: _Plan, listed: NDArray[np.uint32], words: NDArray[np.uint32]
) -> None:
    """Mark the faces (N, F) of judged clusters (n,) whose bits in words (n,) are set."""
    clusters = plan.look.clusters
    some = np.flatnonzero(words)
    octets = words[some].view(np.uint8).reshape(-1, 4)
    bits = np.unpackbits(octets, axis=1, count=clusters.size, bitorder="little").view(bool)
    view = np.repeat(np.arange(len(visible)), plan.judging.n_listed)[some]
    place = (
        clusters.order.reshape(-1, clusters.size)[listed[some]] + (view * visible.shape[1])[:, None]
    )
    visible.reshape(-1)[place[bits]] = True


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
