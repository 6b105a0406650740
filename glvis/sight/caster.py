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
from functools import lru_cache
from typing import Any

import numpy as np
from numpy.typing import NDArray

from glvis.sight.clusters import Clusters
from glvis.sight.context import gl_context
from glvis.sight.renderer import Renderer, Selection, faces_in_images
from glvis.sight.surface import compiled_compute
from glvis.sight.views import NEAREST, Views

Floats = NDArray[np.float64]
Bools = NDArray[np.bool_]

_VERSION = 430  # compute shaders and storage buffers
# Pixels along an edge up to which a face is cast. Beyond, drawing is as fast on llvmpipe; where
# a usual face is larger than _LARGE, much is drawn anyway, and what is small beside it too.
_SMALL, _SMALL_AMONG_LARGE, _LARGE = 32.0, 8.0, 6.0
_CLUSTERS, _DEPTH, _SEEN = range(3)  # storage buffers of the shader
_DRAWN = 4  # its texture of drawn depths
# Invocations a work group, as the shader says, and the groups that every OpenGL takes at once.
_GROUP, _MOST_GROUPS = 64, 65535

# What the shader is told of a view and its work, View in cast.comp.glsl. A uniform block may
# begin at any multiple of 256 bytes.
_TOLD = np.dtype(
    [
        ("world_to_camera", "f4", (4, 4)),
        ("tangent_to_pixel", "f4", 4),
        ("working_range", "f4", 2),
        ("min_cos", "f4", 2),
        ("clip", "f4", 2),
        ("tolerance", "f4"),
        ("cull_backs", "f4"),
        ("size", "i4", 2),
        ("first_row", "i4"),
        ("min_pixels", "i4"),
        ("work", "u4", 4),
        ("", "V112"),
    ]
)


def has_compute() -> bool:
    """Return whether this process's OpenGL has compute shaders."""
    return int(gl_context().version_code) >= _VERSION


def can_hold(resolution: tuple[int, int]) -> bool:
    """Return whether a view of this many pixels fits into a storage buffer."""
    limit = gl_context().info["GL_MAX_SHADER_STORAGE_BLOCK_SIZE"]
    return 4 * resolution[0] * resolution[1] <= limit


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

    @property
    def defines(self) -> list[str]:
        """Names that the shader knows them by."""
        pixels = ["COUNT_PIXELS"] * (self.min_pixels > 0)
        return ["JUDGE", *pixels, *["LOOK_AT_CENTRE"] * self.by_centre]


class Caster:
    """A renderer, and the two passes beside it.

    Parameters
    ----------
    renderer : Renderer
        Draws the large faces; has the resolution and the number of views at once.
    """

    def __init__(self, renderer: Renderer) -> None:
        self.renderer = renderer
        self._stores = {name: _Store() for name in ("nothing", "depth", "told", "clusters", "seen")}

    def release(self) -> None:
        """Give the GPU's memory back, the renderer's too."""
        self.renderer.release()
        for store in self._stores.values():
            store.release()

    def visible(
        self,
        views: Views,
        targets: Selection,
        candidates: Bools,
        hiding: Sequence[Selection],
        rules: Rules,
        *,
        origin: Floats,
    ) -> Bools:
        """Return which faces of the targets each view sees, (N, F) bool.

        Parameters
        ----------
        views : Views
            N cameras of the renderer's resolution.
        targets : Selection
            What they see of the model that is counted.
        candidates : (N, C) bool
            Its clusters that may have a face to count.
        hiding : sequence of Selection
            What they see of what only hides.
        rules : Rules
            What counts.
        origin : (3,) float64
            As the surfaces were made with.
        """
        renderer, n = self.renderer, len(views)
        n_faces = targets.surface.clusters.model.n_faces
        if not n:
            return np.zeros((0, n_faces), dtype=bool)
        selections = [targets, *hiding]
        pixel = (2 * views.tan_half / renderer.resolution).min(axis=1)
        share = _pixels_to_cast(views, targets, pixel) * pixel
        near = NEAREST * views.max_distance
        small = [
            one.surface.clusters.seen_small(views.depth_plane, near, share) for one in selections
        ]
        large = [one.mask & ~is_small for one, is_small in zip(selections, small, strict=True)]
        is_drawn = any(mask.any() for mask in large)
        with_ids = rules.min_pixels > 0 and is_drawn and bool(large[0].any())

        work = _Work()
        casting = [
            work.add(one, [one.mask & is_small], by_face=True)
            for one, is_small in zip(selections, small, strict=True)
        ]
        n_cast = work.n_listed
        to_judge = [candidates & small[0], *[candidates & ~small[0]] * rules.by_centre]
        judging = work.add(targets, to_judge, by_face=rules.min_pixels > 0)
        self._hold("told", _told(work, views, renderer, origin, rules))
        listed = work.clusters
        self._hold("clusters", listed).bind_to_storage_buffer(_CLUSTERS)
        seen = self._hold("seen", np.zeros_like(listed))
        seen.bind_to_storage_buffer(_SEEN)
        cast = compiled_compute("cast")
        judge = compiled_compute("cast", *rules.defines, *["DRAWN"] * is_drawn)
        visible = np.zeros((n, n_faces), dtype=bool)
        windows, to_draw = None, []
        if is_drawn:
            windows = views.windows(targets.surface.clusters.corners, renderer.resolution)
            to_draw = [replace(one, mask=mask) for one, mask in zip(selections, large, strict=True)]
        drawing = renderer.batches(
            views,
            to_draw,
            origin=origin,
            with_ids=with_ids,
            behind_cast=len(work) > 0,
            windows=windows,
        )
        for first in range(0, n, renderer.tiles):
            some = range(first, min(first + renderer.tiles, n))
            if len(work):
                self._clear_depth()
            for one, records in zip(selections, casting, strict=True):
                self._run(cast, one, records, some)
            gl_context().memory_barrier()
            if is_drawn:
                next(drawing)
                renderer.use_depths(_DRAWN)
            self._run(judge, targets, judging, some)
            gl_context().memory_barrier()
            if with_ids:
                images = renderer.read_ids(len(some))
                visible[some] = faces_in_images(images, n_faces, rules.min_pixels)
        words = np.frombuffer(seen.read(listed.nbytes), dtype="<u4") if listed.size else listed
        begin = n_cast
        for view, dispatches in enumerate(judging):
            end = begin + work.n_listed_by(dispatches)
            found = _faces_of(targets.surface.clusters, listed[begin:end], words[begin:end])
            visible[view, found] = True
            begin = end
        return visible

    def _hold(self, name: str, values: NDArray[Any]) -> Any:
        return self._stores[name].holding(values)

    def _clear_depth(self) -> None:
        """Bind depths in which nothing is near."""
        nothing, depth = self._stores["nothing"], self._stores["depth"]
        if nothing.buffer is None:
            width, height = self.renderer.resolution
            far = np.full(self.renderer.tiles * width * height, np.inf, dtype=np.float32)
            nothing.holding(far)
            depth.holding(far)
        gl_context().copy_buffer(depth.buffer, nothing.buffer)
        depth.buffer.bind_to_storage_buffer(_DEPTH)

    def _run(
        self, program: Any, selection: Selection, records: list[_Numbers], some: range
    ) -> None:
        """Dispatch what some views have to do with a surface."""
        selection.surface.use_tables()
        told = self._stores["told"].buffer
        for view in some:
            for record, groups in records[view]:
                told.bind_to_uniform_block(0, offset=record * _TOLD.itemsize, size=_TOLD.itemsize)
                program.run(groups)


_Numbers = list[tuple[int, int]]  # of a view's dispatches: place in what is told, work groups


class _Work:
    """Collects what is dispatched: what the shader is told each time, and lists of clusters."""

    def __init__(self) -> None:
        # view, whether it culls backs, and its work as the shader is told
        self.dispatches: list[tuple[int, bool, tuple[int, int, int, int]]] = []
        self._lists: list[NDArray[np.intp]] = [np.zeros(0, dtype=np.intp)]
        self.n_listed = 0  # clusters

    def __len__(self) -> int:
        return len(self.dispatches)

    def n_listed_by(self, records: _Numbers) -> int:
        """Return how many clusters some dispatches have."""
        return sum(self.dispatches[record][2][1] for record, _ in records)

    @property
    def clusters(self) -> NDArray[np.uint32]:
        """All clusters."""
        return np.concatenate(self._lists).astype(np.uint32)

    def add(self, selection: Selection, masks: list[Bools], by_face: bool) -> list[_Numbers]:
        """Add chosen clusters of a surface, (N, C) bool each, the first of small faces.

        ``by_face``: an invocation a face of theirs, not a cluster.
        """
        size = selection.surface.clusters.size
        each = size if by_face else 1
        most = _MOST_GROUPS * _GROUP // each
        added: list[_Numbers] = []
        for view in range(len(masks[0])):
            found = [mask[view].nonzero()[0] for mask in masks]
            count = sum(map(len, found))
            added.append([])
            for done in range(0, count, most):
                n, n_small = min(most, count - done), max(0, len(found[0]) - done)
                work = (self.n_listed + done, n, n_small, size.bit_length() - 1)
                added[-1].append((len(self.dispatches), -(-n * each // _GROUP)))
                self.dispatches.append((view, bool(selection.cull_backs[view]), work))
            self._lists += found
            self.n_listed += count
        return added


def _faces_of(
    clusters: Clusters, judged: NDArray[np.uint32], words: NDArray[np.uint32]
) -> NDArray[np.int32]:
    """Return the faces whose bits are set: words (n,) have one for each face of a cluster."""
    some = np.flatnonzero(words)
    words = words[some]
    bits = np.unpackbits(
        words.view(np.uint8).reshape(-1, 4), axis=1, count=clusters.size, bitorder="little"
    )
    faces: NDArray[np.int32] = clusters.order.reshape(-1, clusters.size)[judged[some]]
    return faces[bits.view(bool)]


class _Store:
    """A buffer that grows with what it holds."""

    def __init__(self) -> None:
        self.buffer: Any = None

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


def _pixels_to_cast(views: Views, targets: Selection, pixel: Floats) -> Floats:
    """Return up to how many pixels along an edge each view casts faces, (N,).

    ``pixel`` (N,) is its width at unit depth. A view's map may not depend on the others.
    """
    clusters = targets.surface.clusters
    plane = views.depth_plane
    depth = np.einsum("nk,k->n", plane[:, :3], clusters.middle) + plane[:, 3]
    depth = np.maximum(depth, views.clip_near)
    return np.where(clusters.model.mean_edge > _LARGE * pixel * depth, _SMALL_AMONG_LARGE, _SMALL)


def _told(
    work: _Work, views: Views, renderer: Renderer, origin: Floats, rules: Rules
) -> NDArray[np.void]:
    """Return what the shader is told at each dispatch, (n,) of _TOLD."""
    of_view = [view for view, _, _ in work.dispatches]
    # taken by words, as NumPy is slow at copying field by field
    told = _told_of_all(views, tuple(origin.tolist()))[of_view].view(_TOLD)[:, 0]
    width, height = renderer.resolution
    told["tangent_to_pixel"] = (width / 2, height / 2) * 2
    told["tangent_to_pixel"][:, :2] /= views.tan_half[of_view]
    told["tolerance"] = rules.tolerance
    told["min_pixels"] = max(rules.min_pixels, 1)
    told["size"] = width, height
    told["first_row"] = [height * (view % renderer.tiles) for view in of_view]
    told["cull_backs"] = [cull_backs for _, cull_backs, _ in work.dispatches]
    told["work"] = np.array([numbers for _, _, numbers in work.dispatches]).reshape(-1, 4)
    return told


@lru_cache(maxsize=1)
def _told_of_all(views: Views, origin: tuple[float, float, float]) -> NDArray[np.uint32]:
    """Return what is the same for all models of a scene, words (N, W); matrices by column."""
    told = np.zeros(len(views), dtype=_TOLD)
    to_camera = views.world_to_camera.copy()
    to_camera[:, :3, 3] += to_camera[:, :3, :3] @ np.array(origin)
    to_camera[:, 2] *= -1  # depth instead of z
    told["world_to_camera"] = np.swapaxes(to_camera, 1, 2)
    for name, columns in (
        ("working_range", (views.min_distance, views.max_distance)),
        ("min_cos", (views.min_ray_cos, views.min_axis_cos)),
        ("clip", (views.clip_near, views.clip_far)),
    ):
        told[name][:, 0], told[name][:, 1] = columns
    return told.view(np.uint32).reshape(len(told), -1)
