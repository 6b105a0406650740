"""Dispatch tables of the shaders that cast: clusters and faces for each view, and their uniforms.

One table of numbers and one list serve all views that are looked at together, so that little is
sent to the GPU and seldom. See ``cast`` for what is done with them.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from glvis.visibility.culling import Culled
from glvis.visibility.filters import may_pass
from glvis.visibility.gpu_scene import GpuScene
from glvis.visibility.points import Large, beside, spans
from glvis.visibility.surface import Surface
from glvis.visibility.views import Views

Floats = NDArray[np.float64]
Bools = NDArray[np.bool_]
Words = NDArray[np.uint32]
Indices = NDArray[np.integer]

# The block View of view.glsl, name by name; a uniform block may begin at any multiple of 256 bytes.
VIEW = np.dtype(
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
        ("span", "f4"),
        ("filler", "u4", 18),
    ]
)
# As the shaders have them: cells along a tile, invocations a work group; and the work groups that
# every OpenGL takes along one direction.
TILE, GROUP, MOST_GROUPS = 8, 64, 65535
_SLACK = 1e-5  # of what faces span in the image, which float32 may round


@dataclass(frozen=True, eq=False)
class Question:
    """A visibility query: N views of one model among its occluders.

    Attributes
    ----------
    scene : GpuScene
        The model's, with its obstacles.
    target : Surface
        Of the model whose faces are counted.
    grid : tuple of int
        Cells (columns, rows) of the image by which points are looked up.
    large : Large, optional
        Which faces are judged by several points; None: none are.
    """

    scene: GpuScene
    target: Surface
    grid: tuple[int, int]
    large: Large | None

    @property
    def occluders(self) -> Sequence[Surface]:
        """All that hides: the model itself, and obstacles."""
        return [self.target, *self.scene.obstacles]


@dataclass(frozen=True, eq=False)
class ViewList:
    """Uniform blocks of n views for one surface, and where its clusters are listed for each.

    Attributes
    ----------
    rows : (n,) VIEW
        One a view.
    first_row : int
        Where they begin among all uniforms.
    """

    rows: NDArray[np.void]
    first_row: int


@dataclass(frozen=True, eq=False)
class Batch:
    """The dispatch table of n views that go to the GPU together.

    Attributes
    ----------
    question : Question
        The query.
    countable : ViewList
        Clusters that may have a face to count.
    tan_half : (2,) float64
        Tangents of the views' half opening angles.
    hiding : list of ViewList
        Clusters in the frusta, of each surface that hides.
    listed : (L,) uint32
        All lists, and room for what is kept of them.
    dispatches : (2 * n * surfaces, 4) uint32
        Work groups and number of the clusters that are kept, and of faces that cover many cells,
        as long as there are none.
    """

    question: Question
    countable: ViewList
    tan_half: Floats
    hiding: list[ViewList]
    listed: Words
    dispatches: Words

    @classmethod
    def of(cls, views: Views, some: slice, question: Question, culled: Culled) -> Batch:
        """Return the batch of some of the views, of what all of them keep of the scene."""
        uniforms = _of_views(views, some, question)
        columns = question.scene.columns
        n = len(uniforms)
        countable, hiding, parts, first = None, [], [], 0
        masks = [(question.target, culled.countable)]
        masks += [(surface, culled.occludes) for surface in question.occluders]
        for number, (surface, mask) in enumerate(masks):
            entries, begin, n_listed, groups = _listed(mask[some, columns[surface]], surface)
            rows = uniforms.copy()
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
                hiding.append(ViewList(rows, number * n))
            else:
                rows["first_record"] = len(surface.clusters.order) * np.arange(n)
                countable = ViewList(rows, 0)
        assert countable is not None
        dispatches = np.ones((len(hiding), n, 2, 4), dtype=np.uint32)
        dispatches[..., [0, 3]] = 0
        for request, one in zip(dispatches, hiding, strict=True):
            request[:, 0, 1] = one.rows["groups_a_column"]
        return cls(
            question,
            countable,
            views.tan_half,
            hiding,
            np.concatenate(parts),
            dispatches.reshape(-1, 4),
        )


@dataclass(frozen=True, eq=False)
class PartsOfFaces:
    """Faces of the targets that are looked at in several points, view by view.

    Attributes
    ----------
    parts : int
        Points are the centres of mass of a face's parts x parts congruent parts.
    entries : (K,) uint32
        Places + 1 in the order of the clusters; a view's are filled up by zeros.
    list : ViewList
        Uniforms and lists.
    """

    parts: int
    entries: Words
    list: ViewList


@dataclass(frozen=True, eq=False)
class LargeFaces:
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
    def of(cls, batch: Batch, poses: Floats, marked: Words) -> LargeFaces:
        """Return those of a batch, from poses (n, 4, 4), among records (K,) that ask has marked."""
        question, rows, half = batch.question, batch.countable.rows, batch.tan_half[:, None]
        clusters = question.target.clusters
        model = clusters.model
        assert question.large is not None
        view, place = np.divmod(marked.astype(np.intp), len(clusters.order))
        corners = model.vertices.take(model.faces.take(clusters.order[place], axis=0), axis=0)
        corners = np.matmul(corners - poses[view, None, :3, 3], poses[view, :3, :3])
        corners = np.moveaxis(corners, 0, 2)
        corners[:, 2] *= -1
        kept = may_pass(corners, half, rows["working_range"][view].T)
        view, place, corners = view[kept], place[kept], corners[..., kept]
        shares = spans(corners, half, rows["near"][view].astype(float))
        kept = shares >= question.large.least
        return cls(view[kept], place[kept], shares[kept])

    def unseen(self, batch: Batch, parts: int, visible: Bools) -> PartsOfFaces:
        """Return those of which no point is visible (n, F) yet, to be looked at in parts."""
        rows, large = batch.countable.rows, batch.question.large
        clusters = batch.question.target.clusters
        assert large is not None
        face = clusters.order[self.place]
        unseen = ~visible[self.view, face]
        touches = np.zeros(len(face), dtype=bool)
        if parts != large.few:
            touches = beside(clusters, visible, self.view, face)
        some = np.flatnonzero(unseen & large.are_looked_at(parts, self.shares, touches))
        most = int(np.bincount(self.view[some], minlength=1).max()) * parts**2
        groups = max(1, -(-most // (GROUP * MOST_GROUPS)))
        multiple = groups * GROUP // parts**2
        entries, begin, n = _filled(self.view[some], self.place[some], len(rows), multiple)
        uniforms = rows.copy()
        uniforms["first_listed"], uniforms["n_listed"] = len(batch.listed) + begin, n
        uniforms["groups_a_column"] = groups
        uniforms["first_extra"] = len(clusters.order) * len(rows) + parts**2 * begin
        return PartsOfFaces(parts, entries, ViewList(uniforms, len(rows) * (1 + len(batch.hiding))))


def _listed(mask: Bools, surface: Surface) -> tuple[Words, Indices, Indices, int]:
    """Return clusters (n, C) bool as a list, view by view, and where and how each view has them.

    Clusters + 1, (L,); where each view's begin, (n,); how many it has, (n,); and how many work
    groups make up a column. A view's list is filled up by zeros to whole columns.
    """
    size = surface.clusters.size
    groups = max(1, -(-len(surface.clusters.order) // (GROUP * MOST_GROUPS)))
    column = groups * GROUP // size
    view, cluster = np.divmod(np.flatnonzero(mask), mask.shape[1])
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


def tiles(grid: tuple[int, int]) -> tuple[int, int]:
    """Return the tiles (columns, rows) of a grid's cells."""
    return -(-grid[0] // TILE), -(-grid[1] // TILE)


def _of_views(views: Views, some: slice, question: Question) -> NDArray[np.void]:
    """Return the uniforms of each view alone, the rest 0, (n,) VIEW."""
    origin, limits, half = question.scene.origin, views.limits, views.tan_half
    to_camera = views.world_to_camera[some].copy()
    to_camera[:, :3, 3] += to_camera[:, :3, :3] @ origin
    to_camera[:, 2] *= -1  # depth instead of z
    to_grid = to_camera.copy()
    to_grid[:, :2] *= (np.array(question.grid) / 2 / half)[:, None]
    uniforms = np.zeros(len(to_grid), dtype=VIEW)
    uniforms["world_to_grid"] = np.swapaxes(to_grid, 1, 2).reshape(-1, 16)  # by column
    uniforms["eye"][:, :3] = views.eye[some] - origin
    uniforms["backwards"][:, :3] = views.camera_to_world[some, :3, 2]
    uniforms["backwards"][:, 3] = limits.min_axis_cos
    uniforms["working_range"] = limits.min_distance, limits.max_distance
    uniforms["min_ray_cos"] = limits.min_ray_cos
    uniforms["near"] = views.near[some]
    uniforms["size"] = question.grid
    if question.large:
        # an edge of length e spans at most e sqrt(1 + t^2) / depth at tangents up to t
        span = (np.sqrt(1 + half**2) / (2 * half)).max() / question.large.least
        uniforms["span"] = (1 + _SLACK) * span
    number = np.arange(len(uniforms))
    uniforms["first_row"] = question.grid[1] * number
    uniforms["first_tile_row"] = tiles(question.grid)[1] * number
    return uniforms
