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

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from glvis.sight.context import gl_context
from glvis.sight.culling import Chosen
from glvis.sight.points import Question, beside, reaches, spans
from glvis.sight.surface import Surface, compiled_compute, texture_of
from glvis.sight.views import NEAREST, Views

Floats = NDArray[np.float64]
Bools = NDArray[np.bool_]
Words = NDArray[np.uint32]
Indices = NDArray[np.integer]

_VERSION = 430  # compute shaders and storage buffers
# The block View of view.glsl, name by name; a uniform block may begin at any multiple of 256 bytes.
_VIEW = np.dtype(
    [
        ("world_to_grid", "f4", 16),
        ("lattice", "f4", 4),
        ("eye", "f4", 4),
        ("backwards", "f4", 4),
        ("working_range", "f4", 2),
        ("min_ray_cos", "f4"),
        ("near", "f4"),
        ("size", "i4", 2),
        ("first_row", "i4"),
        ("first_tile_row", "i4"),
        ("first_listed", "u4"),
        ("n_listed", "u4"),
        ("first_kept", "u4"),
        ("first_spread", "u4"),
        ("request", "u4"),
        ("size_log2", "u4"),
        ("groups_a_column", "u4"),
        ("first_record", "u4"),
        ("first_extra", "u4"),
        ("filler", "u4", 19),
    ]
)
_LISTED, _DISPATCHES, _FREE, _UNFINISHED = range(4)  # storage buffers of the shaders
_FACES, _CENTRES, _RECORDS, _HEADS, _BOXES, _TILES = range(6)  # their textures
_RECORDS_OUT, _HEADS_OUT, _TILES_OUT = range(3)  # their images
# As the shaders have them: cells along a tile, invocations a work group, records a line; and the
# work groups that every OpenGL takes along one direction.
_TILE, _GROUP, _RECORDS_A_LINE, _MOST_GROUPS = 8, 64, 2048, 65535
# What views that are looked at together may take: records (16 bytes each, and 4 more) and cells (4
# bytes each). More bring nothing on a CPU, and hardware is busy with so many.
_MOST_RECORDS, _MOST_CELLS = 1 << 21, 1 << 22
_SLACK = 1e-5  # of what faces span in the image, which float32 may round


def has_compute() -> bool:
    """Return whether this process's OpenGL has compute shaders."""
    return int(gl_context().version_code) >= _VERSION


def can_hold(n_faces: int) -> bool:
    """Return whether one view's records of so many faces fit where they must."""
    return _fits(n_faces + _GROUP)  # the last cluster is filled up


def _fits(n_records: int) -> bool:
    """Return whether so many records fit into a storage buffer and a texture."""
    info = gl_context().info
    lines = n_records // _RECORDS_A_LINE + 1
    fits = lines <= int(info["GL_MAX_TEXTURE_SIZE"])
    return fits and 4 * n_records <= int(info["GL_MAX_SHADER_STORAGE_BLOCK_SIZE"])


class Caster:
    """The passes, and what they share: buffers and textures that grow with what they hold."""

    def __init__(self) -> None:
        self._buffers: dict[str, Any] = {}
        self._textures: dict[str, Any] = {}

    def release(self) -> None:
        """Give the GPU's memory back."""
        for part in (*self._buffers.values(), *self._textures.values()):
            part.release()
        self._buffers.clear()
        self._textures.clear()

    def visible(
        self, views: Views, question: Question, chosen: Mapping[Surface, Chosen], origin: Floats
    ) -> Bools | None:
        """Return which faces each view sees, (N, F) bool; None where the driver gave up on a face.

        llvmpipe does where a face covers too many cells or points. Then NumPy must find it.

        Parameters
        ----------
        views : Views
            N cameras.
        question : Question
            Of which surface, what hides it, and which of its points count.
        chosen : mapping
            What the views keep of these surfaces.
        origin : (3,) float64
            As the surfaces were made with.
        """
        clusters = question.targets.clusters
        visible = np.zeros((len(views), clusters.model.n_faces), dtype=bool)
        width, height = question.grid
        at_once = min(
            _MOST_RECORDS // max(1, len(clusters.order)),
            _MOST_CELLS // (width * height),
            int(gl_context().info["GL_MAX_TEXTURE_SIZE"]) // height,
        )
        at_once = max(1, at_once) if len(clusters) else len(views) + 1
        for first in range(0, len(views), at_once):
            some = slice(first, first + at_once)
            batch = _Batch.of(views, some, question, chosen, origin)
            if not self._see(batch, views.camera_to_world[some], visible[some]):
                return None
        return visible

    def _see(self, batch: _Batch, poses: Floats, visible: Bools) -> bool:
        """Mark what the views of a batch see, in place, (n, F) bool; return if all is found."""
        if not batch.asked.rows["n_listed"].any():
            return True
        clusters = batch.question.targets.clusters
        n_records = len(visible) * len(clusters.order)
        self._bind(batch, n_records)
        self._run("ask", batch.asked, clusters.size)
        self._hide(batch, batch.asked.rows["n_listed"] > 0)
        # a record is a place in the order of the clusters
        view, place = np.divmod(self._free(0, n_records), len(clusters.order))
        visible[view, clusters.order[place]] = True
        finished, large = self._has_finished(), batch.question.large
        if not large:
            return finished
        faces = _LargeFaces.of(batch, poses, visible)
        for parts in (large.few, large.many):
            closer = faces.unseen(batch, parts, visible)
            if not len(closer.entries):
                continue
            if not _fits(n_records + parts**2 * len(closer.entries)):
                return False
            self._bind(batch, n_records, closer)
            self._run("ask", closer.list, parts**2, f"PARTS {parts}")
            self._hide(batch, closer.list.rows["n_listed"] > 0)
            free = self._free(n_records, parts**2 * len(closer.entries))
            view, place = np.divmod(free, len(clusters.order))
            visible[view, clusters.order[place]] = True
            finished &= self._has_finished()
        return finished

    def _has_finished(self) -> bool:
        """Return whether no face was given up on since all was bound."""
        return not any(self._buffers["unfinished"].read(4))

    def _hide(self, batch: _Batch, asks: Bools) -> None:
        """Find what is hidden of the points that some views (n,) bool have asked about."""
        context = gl_context()
        context.memory_barrier()
        for surface, all_occluders in zip(batch.question.hiding, batch.hiding, strict=True):
            occluders = all_occluders.only(asks)
            surface.use_boxes(_BOXES)
            surface.use_packed(_FACES)
            self._run("keep", occluders, 1, in_columns=False)
            context.memory_barrier()
            for second, defines in enumerate(([], ["SPREAD"])):
                hide = compiled_compute("hide", *defines)
                for row in np.flatnonzero(occluders.rows["n_listed"]).tolist():
                    self._tell(occluders, row)
                    request = int(occluders.rows["request"][row]) + second
                    hide.run_indirect(self._buffers["dispatches"], 16 * request)
                context.memory_barrier()

    def _run(
        self, name: str, clusters: _List, invocations: int, *defines: str, in_columns: bool = True
    ) -> None:
        """Run a pass with so many invocations for each that is listed, view by view."""
        program = compiled_compute(name, *defines)
        listed = clusters.rows["n_listed"]
        groups = -(-listed.astype(np.int64) * invocations // _GROUP)
        for row in np.flatnonzero(listed).tolist():
            self._tell(clusters, row)
            column = int(clusters.rows["groups_a_column"][row]) if in_columns else 1
            program.run(-(-int(groups[row]) // column), column)

    def _tell(self, clusters: _List, row: int) -> None:
        offset = _VIEW.itemsize * (clusters.first_row + row)
        self._buffers["told"].bind_to_uniform_block(0, offset=offset, size=_VIEW.itemsize)

    def _bind(self, batch: _Batch, n_records: int, closer: _Closer | None = None) -> None:
        """Send what is told of a batch, and bind all that the passes share; no point is asked yet.

        Records of what was asked before are left as they are, where points are asked about.
        """
        lists = [batch.asked, *batch.hiding, *([closer.list] if closer else [])]
        self._hold("told", np.concatenate([one.rows for one in lists]))
        self._hold("dispatches", batch.dispatches).bind_to_storage_buffer(_DISPATCHES)
        unfinished = self._hold("unfinished", np.zeros(1, dtype=np.uint32))
        unfinished.bind_to_storage_buffer(_UNFINISHED)
        listed = np.concatenate([batch.listed, *([closer.entries] if closer else [])])
        self._hold("listed", listed).bind_to_storage_buffer(_LISTED)
        n_free = n_records + (closer.parts**2 * len(closer.entries) if closer else 0)
        free = self._room("free", 4 * n_free)
        free.clear()
        free.bind_to_storage_buffer(_FREE)
        records = self._texture("records", 4, (_RECORDS_A_LINE, -(-n_free // _RECORDS_A_LINE)))
        records.bind_to_image(_RECORDS_OUT, read=False, write=True)
        records.use(_RECORDS)
        n, (width, height) = len(batch.asked.rows), batch.question.grid
        self._clear("heads", _HEADS, _HEADS_OUT, (width, n * height))
        across, up = _tiles(batch.question.grid)
        self._clear("tiles", _TILES, _TILES_OUT, (across, n * up))
        targets = batch.question.targets
        targets.use_packed(_FACES)
        targets.use_centres(_CENTRES)

    def _free(self, first: int, number: int) -> Words:
        """Return the records of faces' centres that some records, all in all, found free."""
        words = self._buffers["free"].read(4 * number, offset=4 * first)
        found = np.frombuffer(words, dtype=np.uint32)
        return found[found > 0] - 1

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
        texture = self._textures.get(name)
        if texture is None or texture.width != size[0] or texture.height < size[1]:
            if texture is not None:
                texture.release()
            texture = texture_of(size, components, "u4")
            self._textures[name] = texture
        return texture


@dataclass(frozen=True, eq=False)
class _List:
    """What n views are told of one surface, and where its clusters are listed for each.

    Attributes
    ----------
    rows : (n,) _VIEW
        One a view.
    first_row : int
        Where they begin in all that is told.
    """

    rows: NDArray[np.void]
    first_row: int

    def only(self, views: Bools) -> _List:
        """Return the same with nothing listed for other views than some, (n,) bool."""
        rows = self.rows.copy()
        rows["n_listed"][~views] = 0
        return _List(rows, self.first_row)


@dataclass(frozen=True, eq=False)
class _Batch:
    """What the shaders are told of n views that are looked at together.

    Attributes
    ----------
    question : Question
        What is asked.
    asked : _List
        Clusters that may have a face to count.
    candidates : (n, C) bool
        The same.
    tan_half : (n, 2) float64
        Tangents of the views' half opening angles.
    hiding : list of _List
        Clusters in the frusta, of each surface that hides.
    listed : (L,) uint32
        All lists, and room for what is kept of them.
    dispatches : (2 * n * surfaces, 4) uint32
        Work groups and number of the clusters that are kept, and of faces that cover many cells,
        as long as there are none.
    """

    question: Question
    asked: _List
    candidates: Bools
    tan_half: Floats
    hiding: list[_List]
    listed: Words
    dispatches: Words

    @classmethod
    def of(
        cls,
        views: Views,
        some: slice,
        question: Question,
        chosen: Mapping[Surface, Chosen],
        origin: Floats,
    ) -> _Batch:
        """Return the batch of some of the views; all else as for ``Caster.visible``."""
        told = _of_views(views, some, question, origin)
        n = len(told)
        asked, hiding, parts, first = None, [], [], 0
        masks = [(question.targets, chosen[question.targets].candidates)]
        masks += [(surface, chosen[surface].to_draw.mask) for surface in question.hiding]
        for number, (surface, mask) in enumerate(masks):
            entries, begin, n_listed, groups = _listed(mask[some], surface)
            rows = told.copy()
            rows["lattice"] = surface.lattice
            rows["size_log2"] = surface.clusters.size.bit_length() - 1
            rows["groups_a_column"] = groups
            rows["first_listed"], rows["n_listed"] = first + begin, n_listed
            parts.append(entries)
            first += len(entries)
            if number:
                rows["request"] = 2 * ((number - 1) * n + np.arange(n))
                rows["first_kept"] = first + begin
                rows["first_spread"] = first + len(entries) + begin
                parts.append(np.zeros(2 * len(entries), dtype=np.uint32))
                first += 2 * len(entries)
                hiding.append(_List(rows, number * n))
            else:
                rows["first_record"] = len(surface.clusters.order) * np.arange(n)
                asked = _List(rows, 0)
        assert asked is not None
        dispatches = np.ones((len(hiding), n, 2, 4), dtype=np.uint32)
        dispatches[..., [0, 3]] = 0
        for request, one in zip(dispatches, hiding, strict=True):
            request[:, 0, 1] = one.rows["groups_a_column"]
        return cls(
            question,
            asked,
            masks[0][1][some],
            views.tan_half[some],
            hiding,
            np.concatenate(parts),
            dispatches.reshape(-1, 4),
        )


@dataclass(frozen=True, eq=False)
class _Closer:
    """Faces of the targets that are looked at in several points, view by view.

    Attributes
    ----------
    parts : int
        Points are the centres of mass of a face's parts x parts congruent parts.
    entries : (K,) uint32
        Places + 1 in the order of the clusters; a view's are filled up by zeros.
    list : _List
        What is told.
    """

    parts: int
    entries: Words
    list: _List


@dataclass(frozen=True, eq=False)
class _LargeFaces:
    """Faces of the targets that are large in the image and of which the centre is not free.

    Attributes
    ----------
    view, place : (K,) int
        Which view of a batch, and place in the order of the clusters; view by view.
    shares : (K,) float64
        Of the image's width or height, that they span.
    """

    view: Indices
    place: Indices
    shares: Floats

    @classmethod
    def of(cls, batch: _Batch, poses: Floats, visible: Bools) -> _LargeFaces:
        """Return those of a batch, from poses (n, 4, 4), whose centre is not visible (n, F)."""
        question, rows, half = batch.question, batch.asked.rows, batch.tan_half
        clusters = question.targets.clusters
        model, table = clusters.model, clusters.table
        assert question.large is not None
        near = rows["near"].astype(float)
        backwards, eyes = poses[:, :3, 2], poses[:, :3, 3]
        reach = np.sum(backwards * eyes, axis=1)
        # an edge of length e spans at most e sqrt(1 + t^2) / depth at tangents up to t
        span = (np.sqrt(1 + half**2) / (2 * half)).max(axis=1) / question.large.least
        span *= 1 + _SLACK
        centre, radius = clusters.sphere
        depth = reach[:, None] - backwards @ centre[:3] - radius
        depth = np.maximum(depth, near[:, None]) / span[:, None]
        maybe = table.longest.reshape(1, -1, clusters.size) >= depth[..., None]
        maybe &= batch.candidates[..., None]
        view, place = np.nonzero(maybe.reshape(len(poses), -1))
        unseen = ~visible[view, table.index[place]]
        view, place = view[unseen], place[unseen]
        # of a face that looks at the eye, and may be large and steep enough
        to_eye = eyes[view].T - table.centroids[:, place]
        edge, normal = table.longest[place], table.normals[:, place]
        height = np.sum(normal * to_eye, axis=0)
        distance = np.sqrt(np.sum(to_eye**2, axis=0)) - edge
        depth = np.sum(backwards[view].T * to_eye, axis=0) - edge
        kept = (height > 0) & (edge * span[view] >= np.maximum(depth, near[view]))
        kept &= height >= (1 - _SLACK) * rows["min_ray_cos"][view] * distance
        view, place = view[kept], place[kept]
        corners = model.vertices[model.faces[table.index[place]]] - eyes[view, None]
        corners = np.moveaxis(np.matmul(corners, poses[view, :3, :3]), 0, 2)
        corners[:, 2] *= -1
        kept = reaches(corners, half[view].T, rows["working_range"][view].T)
        view, place, corners = view[kept], place[kept], corners[..., kept]
        shares = spans(corners, half[view].T, near[view])
        kept = shares >= question.large.least
        return cls(view[kept], place[kept], shares[kept])

    def unseen(self, batch: _Batch, parts: int, visible: Bools) -> _Closer:
        """Return those of which no point is visible (n, F) yet, to be looked at in parts."""
        clusters, rows, large = (
            batch.question.targets.clusters,
            batch.asked.rows,
            batch.question.large,
        )
        assert large is not None
        face = clusters.order[self.place]
        unseen = ~visible[self.view, face]
        touches = np.zeros(len(face), dtype=bool)
        if parts != large.few:
            for k in np.unique(self.view).tolist():
                mine = slice(*np.searchsorted(self.view, [k, k + 1]))
                touches[mine] = beside(clusters.model, visible[k], face[mine])
        some = np.flatnonzero(unseen & large.are_looked_at(parts, self.shares, touches))
        most = int(np.bincount(self.view[some], minlength=1).max()) * parts**2
        groups = max(1, -(-most // (_GROUP * _MOST_GROUPS)))
        multiple = groups * _GROUP // parts**2
        entries, begin, n = _filled(self.view[some], self.place[some], len(rows), multiple)
        told = rows.copy()
        told["first_listed"], told["n_listed"] = len(batch.listed) + begin, n
        told["groups_a_column"] = groups
        told["first_extra"] = len(clusters.order) * len(rows) + parts**2 * begin
        return _Closer(parts, entries, _List(told, len(rows) * (1 + len(batch.hiding))))


def _listed(mask: Bools, surface: Surface) -> tuple[Words, Indices, Indices, int]:
    """Return clusters (n, C) bool as a list, view by view, and where and how each view has them.

    Clusters + 1, (L,); where each view's begin, (n,); how many it has, (n,); and how many work
    groups make up a column. A view's list is filled up by zeros to whole columns.
    """
    size = surface.clusters.size
    groups = max(1, -(-len(surface.clusters.order) // (_GROUP * _MOST_GROUPS)))
    column = groups * _GROUP // size
    view, cluster = np.nonzero(mask)
    entries, begin, n_listed = _filled(view, cluster, len(mask), column)
    return entries, begin, n_listed, groups


def _filled(view: Indices, place: Indices, n: int, multiple: int) -> tuple[Words, Indices, Indices]:
    """Return places (K,) + 1 as a list, and where each of n views has its own, and how many.

    A view's are filled up by zeros to a multiple of some number.
    """
    n_listed = np.bincount(view, minlength=n)
    room = -(-n_listed // multiple) * multiple
    begin = np.cumsum(room) - room
    entries = np.zeros(int(room.sum()), dtype=np.uint32)
    entries[np.arange(len(view)) + (begin - (np.cumsum(n_listed) - n_listed))[view]] = place + 1
    return entries, begin, n_listed


def _tiles(grid: tuple[int, int]) -> tuple[int, int]:
    """Return the tiles (columns, rows) of a grid's cells."""
    return -(-grid[0] // _TILE), -(-grid[1] // _TILE)


def _of_views(views: Views, some: slice, question: Question, origin: Floats) -> NDArray[np.void]:
    """Return what is told of each view alone, the rest 0, (n,) _VIEW."""
    to_camera = views.world_to_camera[some].copy()
    to_camera[:, :3, 3] += to_camera[:, :3, :3] @ origin
    to_camera[:, 2] *= -1  # depth instead of z
    scale = np.array(question.grid) / 2 / views.tan_half[some]
    to_grid = to_camera.copy()
    to_grid[:, :2] *= scale[..., None]
    told = np.zeros(len(to_grid), dtype=_VIEW)
    told["world_to_grid"] = np.swapaxes(to_grid, 1, 2).reshape(-1, 16)  # by column
    told["eye"][:, :3] = views.eye[some] - origin
    told["backwards"][:, :3] = views.camera_to_world[some, :3, 2]
    told["backwards"][:, 3] = views.min_axis_cos[some]
    told["working_range"][:, 0] = views.min_distance[some]
    told["working_range"][:, 1] = views.max_distance[some]
    told["min_ray_cos"] = views.min_ray_cos[some]
    told["near"] = NEAREST * views.max_distance[some]
    told["size"] = question.grid
    number = np.arange(len(told))
    told["first_row"] = question.grid[1] * number
    told["first_tile_row"] = _tiles(question.grid)[1] * number
    return told
