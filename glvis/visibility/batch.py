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
from glvis.visibility.gpu_scene import GpuScene
from glvis.visibility.lens_uniforms import lens_uniforms
from glvis.visibility.points import Large
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
        ("right", "f4", 4),
        ("up", "f4", 4),
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
        ("filler", "u4", 10),
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
    grids : list of tuple of int
        Cells (columns, rows) of the windows by which points are looked up, of each viewpoint.
    large : Large, optional
        Which faces are judged by several points; None: none are.
    """

    scene: GpuScene
    target: Surface
    grids: Sequence[tuple[int, int]]
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
class Viewpoint:
    """One optical centre of n views in a batch: K windows of each, R = n K rows.

    Attributes
    ----------
    grid : tuple of int
        Cells (columns, rows) of each window.
    lens : (1,) LENS, optional
        Where the windows are not the image, or its range is not depth.
    defines : list of str
        What the shader that asks is told by.
    poses : (R, 4, 4) float64
        Of the windows, camera to world.
    tan_half : (2,) float64
        Tangents of the windows' half opening angles.
    near : (R,) float64
        Depth before which nothing hides, scene unit.
    depth_range : tuple of float
        See ``Views.depth_range``.
    asking : ViewList
        Clusters that may have a face to count.
    hiding : list of ViewList
        Clusters in the windows, of each surface that hides.
    """

    grid: tuple[int, int]
    lens: NDArray[np.void] | None
    defines: Sequence[str]
    poses: Floats
    tan_half: Floats
    near: Floats
    depth_range: tuple[float, float]
    asking: ViewList
    hiding: list[ViewList]


@dataclass(frozen=True, eq=False)
class Batch:
    """The dispatch table of n views that go to the GPU together.

    Attributes
    ----------
    question : Question
        The query.
    n : int
        Views.
    viewpoints : list of Viewpoint
        The sensor's own and, where it has a partner, the second.
    listed : (L,) uint32
        All lists, and room for what is kept of them.
    dispatches : (D, 4) uint32
        Work groups and number of the clusters that are kept, and of faces that cover many cells,
        as long as there are none: two rows for each window and surface.
    """

    question: Question
    n: int
    viewpoints: list[Viewpoint]
    listed: Words
    dispatches: Words

    @classmethod
    def of(cls, views: Views, some: slice, question: Question, culled: Culled) -> Batch:
        """Return the batch of some of the views, of what all of them keep of the scene."""
        table = _Table()
        n = len(views.camera_to_world[some])
        viewpoints = []
        countable = culled.countable[some, question.scene.columns[question.target]]
        kept_by = zip(views.viewpoints, culled.viewpoints, question.grids, strict=True)
        for one, kept, grid in kept_by:
            windows = slice(some.start * one.per_view, some.stop * one.per_view)
            rows = _of_windows(one, some, windows, question, grid)
            occludes = kept.occludes[windows]
            asks = np.repeat(countable, one.per_view, axis=0)
            if one.per_view > 1:  # one alone counts nothing outside itself
                asks = asks & occludes[:, question.scene.columns[question.target]]
            asking = table.listed(rows, asks, question.target)
            of_view = np.arange(n).repeat(one.per_view)
            asking.rows["first_record"] = len(question.target.clusters.order) * of_view
            hiding = [
                table.hiding(rows, occludes[:, question.scene.columns[surface]], surface)
                for surface in question.occluders
            ]
            lens = lens_uniforms(one.limits)
            defines = [
                *["LENS"] * (lens is not None),
                *["WINDOWS"] * (one.per_view > 1),
                *["PARTNER"] * one.is_partner,
            ]
            viewpoints.append(
                Viewpoint(
                    grid,
                    lens,
                    defines,
                    one.windows.camera_to_world[windows],
                    one.windows.tan_half,
                    one.windows.near[windows],
                    one.depth_range,
                    asking,
                    hiding,
                )
            )
        dispatches = np.concatenate(table.dispatches)
        return cls(question, n, viewpoints, np.concatenate(table.parts), dispatches)

    @property
    def lists(self) -> list[ViewList]:
        """All lists, in the order of their rows."""
        return [one for eye in self.viewpoints for one in (eye.asking, *eye.hiding)]


class _Table:
    """Lists of a batch while it grows."""

    def __init__(self) -> None:
        self.parts: list[Words] = []
        self.dispatches: list[Words] = []
        self._entries = self._rows = self._requests = 0

    def listed(self, rows: NDArray[np.void], mask: Bools, surface: Surface) -> ViewList:
        """Return the list of clusters (R, C) bool of a surface, for windows (R,)."""
        entries, begin, n_listed, groups = _listed(mask, surface)
        rows = rows.copy()
        rows["lattice"] = surface.lattice
        rows["size_log2"] = surface.clusters.size.bit_length() - 1
        rows["groups_a_column"] = groups
        rows["first_listed"], rows["n_listed"] = self._entries + begin, n_listed
        self._append(entries)
        found = ViewList(rows, self._rows)
        self._rows += len(rows)
        return found

    def hiding(self, rows: NDArray[np.void], mask: Bools, surface: Surface) -> ViewList:
        """Return the same of what hides, with room for what is kept of it, and dispatches."""
        found = self.listed(rows, mask, surface)
        first, n_entries = self._entries - len(self.parts[-1]), len(self.parts[-1])
        begin = found.rows["first_listed"] - first
        found.rows["request"] = 2 * (self._requests + np.arange(len(rows)))
        found.rows["first_kept"] = self._entries + begin
        found.rows["first_spread"] = self._entries + n_entries + begin
        self._append(np.zeros(2 * n_entries, dtype=np.uint32))
        requests = np.ones((len(rows), 2, 4), dtype=np.uint32)
        requests[..., [0, 3]] = 0
        requests[:, 0, 1] = found.rows["groups_a_column"]
        self.dispatches.append(requests.reshape(-1, 4))
        self._requests += len(rows)
        return found

    def _append(self, entries: Words) -> None:
        self.parts.append(entries)
        self._entries += len(entries)


def _listed(mask: Bools, surface: Surface) -> tuple[Words, Indices, Indices, int]:
    """Return clusters (n, C) bool as a list, view by view, and where and how each view has them.

    Clusters + 1, (L,); where each view's begin, (n,); how many it has, (n,); and how many work
    groups make up a column. A view's list is filled up by zeros to whole columns.
    """
    size = surface.clusters.size
    groups = max(1, -(-len(surface.clusters.order) // (GROUP * MOST_GROUPS)))
    column = groups * GROUP // size
    view, cluster = np.divmod(np.flatnonzero(mask), mask.shape[1])
    entries, begin, n_listed = filled(view, cluster, len(mask), column)
    return entries, begin, n_listed, groups


def filled(view: Indices, place: Indices, n: int, multiple: int) -> tuple[Words, Indices, Indices]:
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


def _of_windows(
    views: Views, some: slice, windows: slice, question: Question, grid: tuple[int, int]
) -> NDArray[np.void]:
    """Return the uniforms of each window of some views, the rest 0, (R,) VIEW."""
    origin, limits, half = question.scene.origin, views.limits, views.windows.tan_half
    to_camera = views.windows.world_to_camera[windows].copy()
    to_camera[:, :3, 3] += to_camera[:, :3, :3] @ origin
    to_camera[:, 2] *= -1  # depth instead of z
    to_grid = to_camera.copy()
    to_grid[:, :2] *= (np.array(grid) / 2 / half)[:, None]
    uniforms = np.zeros(len(to_grid), dtype=VIEW)
    poses = np.repeat(views.camera_to_world[some], views.per_view, axis=0)
    uniforms["world_to_grid"] = np.swapaxes(to_grid, 1, 2).reshape(-1, 16)  # by column
    uniforms["eye"][:, :3] = poses[:, :3, 3] - origin
    uniforms["right"][:, :3], uniforms["up"][:, :3] = poses[:, :3, 0], poses[:, :3, 1]
    uniforms["backwards"][:, :3] = poses[:, :3, 2]
    uniforms["backwards"][:, 3] = limits.min_axis_cos
    uniforms["working_range"] = limits.min_distance, limits.max_distance
    uniforms["min_ray_cos"] = limits.min_ray_cos
    uniforms["near"] = views.windows.near[windows]
    uniforms["size"] = grid
    if question.large:
        # an edge of length e spans at most e sqrt(1 + t^2) / depth at tangents up to t
        span = (np.sqrt(1 + half**2) / (2 * half)).max() / question.large.least
        if views.per_view > 1:  # and the range is up to so many times the depth
            span *= np.sqrt(1 + np.sum(half**2))
        uniforms["span"] = (1 + _SLACK) * span
    number = np.arange(len(uniforms))
    uniforms["first_row"] = grid[1] * number
    uniforms["first_tile_row"] = tiles(grid)[1] * number
    return uniforms
