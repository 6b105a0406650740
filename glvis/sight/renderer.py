"""Draws surfaces into ID and depth buffers. Poses in; pixels a face, ID and depth images out.

On a software rasteriser one small framebuffer, used over and over, stays in the cache. On
hardware many views are drawn before any is read back; how many is ``tiles``. Each has a framebuffer
of its own, for where a view lies in a larger one would decide how its edges are rounded. Images
are turned once, here: row 0 is the top row for everybody else.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Any

import moderngl
import numpy as np
from numpy.typing import NDArray

from glvis.camera import projection_matrix, rigid_inverse
from glvis.errors import MachineError
from glvis.sight.context import Held, gl_context, gl_info, unbind_framebuffer
from glvis.sight.surface import Surface, compiled
from glvis.sight.views import Views

Floats = NDArray[np.float64]
Bools = NDArray[np.bool_]
Window = tuple[int, ...]  # left, bottom, width, height, pixels

# Of ID buffers that hardware fills before they are read back: bytes, and framebuffers, of which
# there would be hundreds of thousands where images are small.
_HARDWARE_BATCH_BYTES, _HARDWARE_BATCH = 64 << 20, 256
# The viewport is this odd number of times as wide and high as the image, which lies in its
# middle, so that hardly any face is cut by the sides of the clip volume: a software rasteriser
# cuts faces slowly, while what falls outside the image costs nothing.
_GUARD = 3


@dataclass(frozen=True, eq=False)
class Selection:
    """What N views draw of a surface.

    Attributes
    ----------
    surface : Surface
        Of which model.
    mask : (N, C) or (N, F) bool
        Clusters to draw, or single faces where ``by_face``.
    cull_backs : (N,) bool
        In which views back faces are left out one by one too.
    by_face : bool
        How to read ``mask``.
    """

    surface: Surface
    mask: Bools
    cull_backs: Bools
    by_face: bool = False

    def draw(self, program: Any, view: int) -> None:
        """Draw what one of the views has chosen."""
        context = gl_context()
        if self.cull_backs[view]:
            context.enable(moderngl.CULL_FACE)
        else:
            context.disable(moderngl.CULL_FACE)
        self.surface.draw(program, self.mask[view], self.by_face)


class Renderer(Held):
    """Framebuffers of one resolution and the two draws into them; a context manager.

    Parameters
    ----------
    resolution : tuple of int
        Pixels (width, height) of every view.
    tiles : int, optional
        Views that are drawn before they are read back. One by default on a software
        rasteriser, whose small framebuffer then stays in the cache; as many as are read back
        well at once on hardware.
    """

    def __init__(self, resolution: tuple[int, int], tiles: int | None = None) -> None:
        context = gl_context()
        self.resolution = resolution
        width, height = resolution
        limit = int(context.info["GL_MAX_TEXTURE_SIZE"])
        if max(resolution) > limit:
            raise MachineError(
                f"resolution {width} x {height} exceeds this driver's limit of {limit} pixels"
            )
        if tiles is None:
            # their depths must fit into a storage buffer, where there is such a thing
            most = context.info.get("GL_MAX_SHADER_STORAGE_BLOCK_SIZE") or _HARDWARE_BATCH_BYTES
            fitting = max(1, min(most, _HARDWARE_BATCH_BYTES) // (4 * width * height))
            tiles = 1 if gl_info().is_software else min(fitting, _HARDWARE_BATCH)
        self.tiles = tiles
        fits = _GUARD * max(resolution) <= min(context.info["GL_MAX_VIEWPORT_DIMS"])
        self._guard = _GUARD if fits else 1
        self._targets = [_Target.of(resolution) for _ in range(tiles)]
        self._windows: list[Window] = []  # of what was drawn last
        self._ids = np.zeros((tiles, height, width), dtype=np.uint32)
        self._depths = np.zeros((tiles, height, width), dtype=np.float32)

    def release(self) -> None:
        """Give the GPU's memory back."""
        unbind_framebuffer()
        for target in self._targets:
            target.release()

    def id_images(
        self,
        views: Views,
        selections: Sequence[Selection],
        *,
        origin: Floats,
        refused_hide: bool = True,
    ) -> Iterator[tuple[int, NDArray[np.uint32]]]:
        """Yield ID images in batches: index of the first view, and (n, H, W) uint32.

        A pixel holds the index + 1 of the nearest face, or 0 where there is none, the sensor
        refuses it, or it belongs to an obstacle. The arrays are valid until the next batch.

        Parameters
        ----------
        views : Views
            N cameras of this renderer's resolution.
        selections : sequence of Selection
            What to draw of each surface.
        origin : (3,) float64
            As the surfaces were made with.
        refused_hide : bool
            Whether back and too oblique faces hide what lies behind them.
        """
        for first, n in self.batches(
            views, selections, origin=origin, with_ids=True, refused_hide=refused_hide
        ):
            yield first, self.read_ids(n)

    def depth_images(
        self, views: Views, selections: Sequence[Selection], *, origin: Floats
    ) -> Iterator[tuple[int, NDArray[np.float32]]]:
        """Yield depth buffers in batches: index of the first view, and (n, H, W) float32.

        Values are OpenGL's, in [0, 1]; see ``depth_along_axis``. The arrays are valid until
        the next batch.
        """
        for first, n in self.batches(views, selections, origin=origin):
            yield first, self.read_depths(n)

    def read_ids(self, n: int) -> NDArray[np.uint32]:
        """Return the ID images of the batch drawn last, (n, H, W)."""
        for target, ids in zip(self._targets[:n], self._ids, strict=False):
            target.with_ids.read_into(ids, components=1, dtype="u4", alignment=4)
        return self._ids[:n, ::-1]

    def read_windows(self) -> list[NDArray[np.uint32]]:
        """Return what was wanted of each ID image of the batch drawn last, (height, width)."""
        parts = []
        for target, ids, window in zip(self._targets, self._ids, self._windows, strict=False):
            _, _, width, height = window
            part = ids.reshape(-1)[: width * height].reshape(height, width)
            target.with_ids.read_into(part, viewport=window, components=1, dtype="u4", alignment=4)
            parts.append(part[::-1])
        return parts

    def read_depths(self, n: int) -> NDArray[np.float32]:
        """Return the depth buffers of the batch drawn last, (n, H, W)."""
        for target, depths in zip(self._targets[:n], self._depths, strict=False):
            target.depth_only.read_into(
                depths, attachment=-1, components=1, dtype="f4", alignment=4
            )
        return self._depths[:n, ::-1]

    def use_depths(self, tile: int, unit: int) -> None:
        """Bind a depth buffer of the batch drawn last as a texture; its rows count upwards."""
        depths = self._targets[tile].depths
        depths.compare_func = ""
        depths.filter = (moderngl.NEAREST, moderngl.NEAREST)
        depths.use(unit)

    def batches(
        self,
        views: Views,
        selections: Sequence[Selection],
        *,
        origin: Floats,
        with_ids: bool = False,
        refused_hide: bool = True,
        behind_cast: bool = False,
        windows: NDArray[np.intp] | None = None,
    ) -> Iterator[tuple[int, int]]:
        """Draw the views, ``tiles`` at a time; yield the first view and the number drawn.

        Parameters
        ----------
        views, selections, origin, refused_hide
            As for ``id_images``.
        with_ids : bool
            Whether IDs are wanted beside depths.
        behind_cast : bool
            Whether what a Caster has cast hides IDs.
        windows : (N, 4) int, optional
            Left, bottom, width and height of what is wanted of each image; the rest is left as
            it was.
        """
        context = gl_context()
        defines = ["REFUSED_HIDE"] * refused_hide + ["BEHIND_CAST"] * behind_cast
        program = compiled("id_buffer", *defines) if with_ids else compiled("depth")
        width, height = self.resolution
        side = self._guard // 2
        # wider than the image: see _GUARD
        viewport = (-side * width, -side * height, self._guard * width, self._guard * height)
        uniforms = _uniforms(views, self.resolution, self.tiles, self._guard, origin, program)
        wanted = [(0, 0, width, height)] * len(views) if windows is None else windows.tolist()
        for first in range(0, len(views), self.tiles):
            self._windows = [tuple(window) for window in wanted[first : first + self.tiles]]
            for view, window in enumerate(self._windows, start=first):
                target = self._targets[view - first]
                framebuffer = target.with_ids if with_ids else target.depth_only
                # The full state, so that no draw depends on the one before.
                context.enable_only(moderngl.DEPTH_TEST)
                context.depth_func = "<"
                context.front_face, context.cull_face = "ccw", "back"
                framebuffer.use()
                framebuffer.scissor = window
                framebuffer.clear(0.0, 0.0, 0.0, 0.0, depth=1.0)
                framebuffer.viewport = viewport
                for name, rows in uniforms.items():
                    write(program, name, rows[view])
                for selection in selections:
                    selection.draw(program, view)
            yield first, len(self._windows)


@dataclass(frozen=True, eq=False)
class _Target:
    """What one view is drawn into.

    Attributes
    ----------
    ids, depths : Any
        Textures.
    with_ids, depth_only : Any
        Framebuffers of both, and of depths alone.
    """

    ids: Any
    depths: Any
    with_ids: Any
    depth_only: Any

    @classmethod
    def of(cls, resolution: tuple[int, int]) -> _Target:
        """Return one of so many pixels (width, height)."""
        context = gl_context()
        ids = context.texture(resolution, 1, dtype="u4", alignment=4)
        depths = context.depth_texture(resolution, alignment=4)
        both = context.framebuffer([ids], depths), context.framebuffer([], depths)
        return cls(ids, depths, *both)

    def release(self) -> None:
        """Give the GPU's memory back."""
        for part in (self.with_ids, self.depth_only, self.ids, self.depths):
            part.release()


def faces_in_images(
    images: Sequence[NDArray[np.uint32]] | NDArray[np.uint32], n_faces: int, min_pixels: int = 1
) -> Bools:
    """Return which faces show in at least ``min_pixels`` pixels of n ID images, (n, F) bool."""
    seen = np.zeros((len(images), n_faces + 1), dtype=bool)
    for flags, image in zip(seen, images, strict=True):
        ids = image[::-1].ravel()  # as the GPU left it: no copy
        # neighbours along a row mostly show the same face: look at each run once
        begins = np.concatenate([[0], np.flatnonzero(ids[1:] != ids[:-1]) + 1])
        faces = ids[begins].astype(np.intp)
        if min_pixels == 1:
            flags[faces] = True
        else:
            pixels = np.diff(begins, append=len(ids))
            flags[:] = np.bincount(faces, pixels, minlength=n_faces + 1) >= min_pixels
    return seen[:, 1:]


def write(program: Any, name: str, value: Any) -> None:
    """Set a uniform, if the program has it."""
    member = program.get(name, None)
    if member is not None:
        member.write(value)


def depth_along_axis(depth: NDArray[np.float32], near: float, far: float) -> Floats:
    """Return distances along the optical axis, scene unit, for depth buffer values [0, 1]."""
    return 2 * far * near / (far + near - (2 * depth.astype(np.float64) - 1) * (far - near))


def _uniforms(
    views: Views,
    resolution: tuple[int, int],
    tiles: int,
    guard: int,
    origin: Floats,
    program: Any,
) -> dict[str, NDArray[Any]]:
    """Return what a program asks for, by name and view; matrices are multiplied in float64."""
    pose = views.camera_to_world.copy()
    pose[:, :3, 3] -= origin
    projection = projection_matrix(guard * views.tan_half, views.clip_near, views.clip_far)
    scale = 2 * views.tan_half / np.asarray(resolution)
    uniforms = {
        "world_to_clip": np.swapaxes(projection @ rigid_inverse(pose), 1, 2),  # columns first
        "eye": pose[:, :3, 3],
        "backwards": pose[:, :3, 2],
        "pixel_to_tangent": np.concatenate([scale, -views.tan_half], axis=1),
        "min_distance": views.min_distance,
        "max_distance": views.max_distance,
        "min_ray_cos": views.min_ray_cos,
        "min_axis_cos": views.min_axis_cos,
    }
    uniforms = {
        name: np.ascontiguousarray(rows, dtype=np.float32)
        for name, rows in uniforms.items()
        if name in program
    }
    first_row = resolution[1] * (np.arange(len(views)) % tiles)
    integers = {"image_width": np.full(len(views), resolution[0]), "first_row": first_row}
    return uniforms | {name: rows.astype(np.int32) for name, rows in integers.items()}
