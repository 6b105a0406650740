"""Which points of faces nothing hides, where OpenGL 4.3 is there: an irregular Z-buffer.

Alias-free shadow maps (Aila and Laine 2004; Johnson et al. 2005) turned to sensors: points of faces
are put into the cells of a coarse grid over the image, and each face that may hide something is
tested against the points of the cells that it covers. No depth is sampled: every pair is decided by
the planes of the face itself, up to the rounding of float32.

Three compute shaders do that. ``ask`` looks up the points of faces that may count, ``keep`` culls
what lies behind all of them, ``hide`` finds those that the rest hides. First it is each face's
centre that is asked about; where many points of large faces count, then those of the faces whose
centre is not free.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from glvis.problem.visibility_options import VisibilityOptions
from glvis.visibility.batch import (
    GROUP,
    VIEW,
    Batch,
    Question,
    ViewList,
    Viewpoint,
    tiles,
)
from glvis.visibility.clusters import Clusters
from glvis.visibility.context import gl_context
from glvis.visibility.culling import Culled
from glvis.visibility.gpu_scene import GpuScene
from glvis.visibility.large_faces import LargeFaces, PartsOfFaces
from glvis.visibility.points import grid_size, large_faces
from glvis.visibility.rays import visible_of
from glvis.visibility.surface import Surface, compiled_compute, texture_of
from glvis.visibility.views import Views

Floats = NDArray[np.float64]
Bools = NDArray[np.bool_]
Words = NDArray[np.uint32]
Indices = NDArray[np.integer]

_VERSION = 430  # compute shaders and storage buffers
_LISTED, _DISPATCHES, _FREE, _UNFINISHED = range(4)  # storage buffers of the shaders
_FACES, _CENTRES, _RECORDS, _HEADS, _BOXES, _TILES = range(6)  # their textures
_RECORDS_OUT, _HEADS_OUT, _TILES_OUT = range(3)  # their images
# as view.glsl has them
_RECORDS_A_LINE, _LARGE, _LOOKED_UP = 2048, np.uint32(1 << 31), np.uint32(1 << 30)
# What views that are looked at together may take: records (16 bytes each, and 4 more) and cells (4
# bytes each). More bring nothing on a CPU, and hardware is busy with so many.
_MOST_RECORDS, _MOST_CELLS = 1 << 21, 1 << 22


def has_compute() -> bool:
    """Return whether this process's OpenGL has compute shaders."""
    return int(gl_context().version_code) >= _VERSION


def can_hold(n_faces: int) -> bool:
    """Return whether one view's records of so many faces fit where they must."""
    return _fits(n_faces + GROUP)  # the last cluster is filled up


def _fits(n_records: int) -> bool:
    """Return whether so many records fit into a storage buffer and a texture."""
    info = gl_context().info
    lines = n_records // _RECORDS_A_LINE + 1
    fits = lines <= int(info["GL_MAX_TEXTURE_SIZE"])
    return fits and 4 * n_records <= int(info["GL_MAX_SHADER_STORAGE_BLOCK_SIZE"])


def _mark(visible: Bools, records: Words, clusters: Clusters) -> None:
    """Mark the faces, in place (n, F) bool, whose records are given: places view by view."""
    view, place = np.divmod(records.astype(np.intp), len(clusters.order))
    visible.reshape(-1)[view * visible.shape[1] + clusters.order.take(place)] = True


class Caster:
    """The passes, and what they share: buffers and textures that grow with what they hold."""

    def __init__(self) -> None:
        self._buffers: dict[str, Any] = {}
        self._textures: dict[tuple[str, int], Any] = {}  # by width, too: models take turns
        self._grids: dict[tuple[Surface, tuple[float, ...]], tuple[int, int]] = {}

    def release(self) -> None:
        """Give the GPU's memory back."""
        for part in (*self._buffers.values(), *self._textures.values()):
            part.release()
        self._buffers.clear()
        self._textures.clear()

    def visible(
        self, scene: GpuScene, views: Views, culled: Culled, options: VisibilityOptions
    ) -> list[Bools]:
        """Return which faces of each model views see, (N, F) bool each.

        llvmpipe gives up on a face that covers too many cells or points; then NumPy decides.

        Parameters
        ----------
        scene : GpuScene
            Models and what hides them.
        views : Views
            N poses of a sensor.
        culled : Culled
            What they keep of the scene.
        options : VisibilityOptions
            What counts as visible; occlusion is "physical".
        """
        found = []
        for target in scene.targets:
            grids = [self._grid(target, one) for one in views.viewpoints]
            question = Question(scene, target, grids, large_faces(options))
            visible = self.answer(question, views, culled)
            if visible is None:
                visible = visible_of(scene, target, views, culled, options)
            found.append(visible)
        return found

    def answer(self, question: Question, views: Views, culled: Culled) -> Bools | None:
        """Return which faces of one model views see, (N, F); None where the driver gave up."""
        clusters = question.target.clusters
        visible = np.zeros((len(views), clusters.model.n_faces), dtype=bool)
        lines = max(
            one.per_view * height
            for one, (_, height) in zip(views.viewpoints, question.grids, strict=True)
        )
        at_once = min(
            _MOST_RECORDS // max(1, len(clusters.order)),
            _MOST_CELLS // (max(width for width, _ in question.grids) * lines),
            int(gl_context().info["GL_MAX_TEXTURE_SIZE"]) // lines,
        )
        at_once = max(1, at_once) if len(clusters) else len(views) + 1
        for first in range(0, len(views), at_once):
            some = slice(first, first + at_once)
            batch = Batch.of(views, some, question, culled)
            if not self._see(batch, visible[some]):
                return None
        return visible

    def _grid(self, target: Surface, views: Views) -> tuple[int, int]:
        windows = views.windows
        far = float(windows.farthest.max(initial=np.finfo(float).tiny))
        # to the next power of two: a few grids serve all poses
        far = min(views.limits.max_distance, 2.0 ** math.ceil(math.log2(far)))
        key = target, (*windows.tan_half.tolist(), far)
        if key not in self._grids:
            self._grids[key] = grid_size(windows.tan_half, target.clusters.model, far)
        return self._grids[key]

    def _see(self, batch: Batch, visible: Bools) -> bool:
        """Mark what the views of a batch see, in place, (n, F) bool; return if all is found."""
        eyes = [eye.asking for eye in batch.viewpoints]
        if not eyes[0].rows["n_listed"].any():
            return True
        clusters = batch.question.target.clusters
        n_records = len(visible) * len(clusters.order)
        self._bind(batch, n_records)
        self._ask(batch, eyes, clusters.size)
        free, marked = self._found(0, n_records)
        _mark(visible, free, clusters)
        finished, large = self._has_finished(), batch.question.large
        if not large:
            return finished
        faces = LargeFaces.of(batch, marked)
        for parts in (large.few, large.many):
            several = faces.unseen(batch, parts, visible)
            if not len(several.entries):
                continue
            if not _fits(n_records + parts**2 * len(several.entries)):
                return False
            self._bind(batch, n_records, several)
            self._ask(batch, several.lists, parts**2, f"PARTS {parts}")
            free, _ = self._found(n_records, parts**2 * len(several.entries))
            _mark(visible, free, clusters)
            finished &= self._has_finished()
        return finished

    def _ask(self, batch: Batch, lists: Sequence[ViewList], points: int, *defines: str) -> None:
        """Find which points are free, so many of each entry of the lists of the viewpoints."""
        for eye, asking in zip(batch.viewpoints, lists, strict=True):
            n, (width, height) = len(asking.rows), eye.grid
            self._clear("heads", _HEADS, _HEADS_OUT, (width, n * height))
            across, up = tiles(eye.grid)
            self._clear("tiles", _TILES, _TILES_OUT, (across, n * up))
            batch.question.target.use_packed(_FACES)
            batch.question.target.use_centres(_CENTRES)
            if eye.lens is not None:
                self._hold("lens", eye.lens).bind_to_uniform_block(1)
            listed = asking.rows["n_listed"]
            self._run("ask", asking, listed * points, *defines, *eye.defines)
            self._hide(batch, eye, listed > 0)

    def _has_finished(self) -> bool:
        """Return whether no face was given up on since all was bound."""
        return not any(self._buffers["unfinished"].read(4))

    def _hide(self, batch: Batch, eye: Viewpoint, asks: Bools) -> None:
        """Find what is hidden of the points that some windows (R,) bool have asked about."""
        context = gl_context()
        context.memory_barrier()
        for surface, occluders in zip(batch.question.occluders, eye.hiding, strict=True):
            surface.use_boxes(_BOXES)
            surface.use_packed(_FACES)
            listed = np.where(asks, occluders.rows["n_listed"], 0)
            self._run("keep", occluders, listed, in_columns=False)
            context.memory_barrier()
            rows = np.flatnonzero(listed)
            requests = occluders.rows["request"][rows]
            for second, defines in enumerate(([], ["SPREAD"])):
                hide = compiled_compute("hide", *defines)
                for row, request in zip(rows.tolist(), (requests + second).tolist(), strict=True):
                    self._tell(occluders, row)
                    hide.run_indirect(self._buffers["dispatches"], 16 * request)
                context.memory_barrier()

    def _run(
        self,
        name: str,
        clusters: ViewList,
        invocations: Indices,
        *defines: str,
        in_columns: bool = True,
    ) -> None:
        """Run a pass with so many invocations (n,) for each view; none where that is 0."""
        program = compiled_compute(name, *defines)
        columns = clusters.rows["groups_a_column"] if in_columns else np.ones(len(clusters.rows))
        across = np.ceil(invocations / (GROUP * columns))
        for row in np.flatnonzero(invocations).tolist():
            self._tell(clusters, row)
            program.run(int(across[row]), int(columns[row]))

    def _tell(self, clusters: ViewList, row: int) -> None:
        offset = VIEW.itemsize * (clusters.first_row + row)
        self._buffers["told"].bind_to_uniform_block(0, offset=offset, size=VIEW.itemsize)

    def _bind(self, batch: Batch, n_records: int, several: PartsOfFaces | None = None) -> None:
        """Send what is told of a batch, and bind all that the passes share; no point is asked yet.

        Records of what was asked before are left as they are, where points are asked about.
        """
        lists = [*batch.lists, *(several.lists if several else [])]
        # as bytes: NumPy joins tables slowly
        told = [one.rows.view(f"V{VIEW.itemsize}") for one in lists]
        self._hold("told", np.concatenate(told))
        self._hold("dispatches", batch.dispatches).bind_to_storage_buffer(_DISPATCHES)
        unfinished = self._hold("unfinished", np.zeros(1, dtype=np.uint32))
        unfinished.bind_to_storage_buffer(_UNFINISHED)
        listed = np.concatenate([batch.listed, *([several.entries] if several else [])])
        self._hold("listed", listed).bind_to_storage_buffer(_LISTED)
        n_free = n_records + (several.parts**2 * len(several.entries) if several else 0)
        free = self._room("free", 4 * n_free)
        free.clear()
        free.bind_to_storage_buffer(_FREE)
        records = self._texture("records", 4, (_RECORDS_A_LINE, -(-n_free // _RECORDS_A_LINE)))
        records.bind_to_image(_RECORDS_OUT, read=False, write=True)
        records.use(_RECORDS)

    def _found(self, first: int, number: int) -> tuple[Words, Words]:
        """Return what some records, all in all, were found to be.

        The records of faces' centres that are free, or of which a point is; and of those that are
        not, which may be large.
        """
        words = self._buffers["free"].read(4 * number, offset=4 * first)
        found = np.frombuffer(words, dtype=np.uint32)
        free = found & ~(_LARGE | _LOOKED_UP)
        return free[free > 0] - 1, np.flatnonzero(found == _LARGE).astype(np.uint32)

    def _clear(self, name: str, unit: int, image: int, size: tuple[int, int]) -> None:
        """Bind a texture of words (width, height) that are 0."""
        texture = self._texture(name, 1, size)
        nothing = self._buffers.get("nothing")
        n_bytes = 4 * texture.width * texture.height
        if nothing is None or nothing.size < n_bytes:
            nothing = self._room("nothing", n_bytes)
            nothing.clear()
        texture.write(nothing)
        texture.bind_to_image(image, read=True, write=True)
        texture.use(unit)

    def _hold(self, name: str, values: NDArray[Any]) -> Any:
        """Return a buffer with values at its beginning."""
        buffer = self._room(name, values.nbytes)
        buffer.write(np.ascontiguousarray(values))
        return buffer

    def _room(self, name: str, n_bytes: int) -> Any:
        """Return a buffer of at least so many bytes."""
        buffer = self._buffers.get(name)
        if buffer is None or buffer.size < n_bytes:
            if buffer is not None:
                buffer.release()
            buffer = gl_context().buffer(reserve=max(n_bytes, 256), dynamic=True)
            self._buffers[name] = buffer
        return buffer

    def _texture(self, name: str, components: int, size: tuple[int, int]) -> Any:
        """Return a texture of words, at least so high and of just this width."""
        key = (name, size[0])
        texture = self._textures.get(key)
        if texture is None or texture.height < size[1]:
            if texture is not None:
                texture.release()
            texture = texture_of(size, components, "u4")
            self._textures[key] = texture
        return texture
