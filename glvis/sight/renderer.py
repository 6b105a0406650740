"""Draws surfaces into ID and depth buffers. Poses in; pixels a face, ID and depth images out.

On a software rasteriser one small framebuffer, used over and over, stays in the cache. On
hardware many views share one tall framebuffer and one read-back; how many is ``tiles``. Images
are turned once, here: row 0 is the top row for everybody else.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
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

_HARDWARE_BATCH_BYTES = 64 << 20  # of ID buffer that hardware fills before it is read back
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

    def __getitem__(self, some: slice) -> Selection:
        return replace(self, mask=self.mask[some], cull_backs=self.cull_backs[some])

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
        Views that share a framebuffer and a read-back. One by default on a software
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
            tiles = 1 if gl_info().is_software else fitting
        self.tiles = min(tiles, limit // height)
        fits = _GUARD * max(resolution) <= min(context.info["GL_MAX_VIEWPORT_DIMS"])
        self._guard = _GUARD if fits else 1
        size = (width, height * self.tiles)
        self._id_texture = context.texture(size, 1, dtype="u4", alignment=4)
        self._depth_texture = context.depth_texture(size, alignment=4)
        self._framebuffer = context.framebuffer([self._id_texture], self._depth_texture)
        self._depth_only = context.framebuffer([], self._depth_texture)
        self._window = (0, 0, *size)
        self._ids = np.zeros((self.tiles, height, width), dtype=np.uint32)
        self._depths = np.zeros((self.tiles, height, width), dtype=np.float32)

    def release(self) -> None:
        """Give the GPU's memory back."""
        unbind_framebuffer()
        for part in (
            self._framebuffer,
            self._depth_only,
            self._id_texture,
            self._depth_texture,
        ):
            part.release()

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
        """Return the ID images of the batch drawn last, (n, H, W), or what its window shows."""
        x, y, width, height = self._window
        ids = self._ids.reshape(-1)[: width * height].reshape(-1, height // self.tiles, width)
        self._framebuffer.read_into(
            ids, viewport=(x, y, width, height), components=1, dtype="u4", alignment=4
        )
        return ids[:n, ::-1]

    def read_depths(self, n: int) -> NDArray[np.float32]:
        """Return the depth buffers of the batch drawn last, (n, H, W)."""
        self._depth_only.read_into(
            self._depths, attachment=-1, components=1, dtype="f4", alignment=4
        )
        return self._depths[:n, ::-1]

    def use_depths(self, unit: int) -> None:
        """Bind the depth buffers of the batch drawn last as a texture; its rows count upwards."""
        self._depth_texture.compare_func = ""
        self._depth_texture.filter = (moderngl.NEAREST, moderngl.NEAREST)
        self._depth_texture.use(unit)

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
            it was. Heeded where a framebuffer holds one view.
        """
        context = gl_context()
        defines = ["REFUSED_HIDE"] * refused_hide + ["BEHIND_CAST"] * behind_cast
        program = compiled("id_buffer", *defines) if with_ids else compiled("depth")
        framebuffer = self._framebuffer if with_ids else self._depth_only
        width, height = self.resolution
        side = self._guard // 2
        uniforms = _uniforms(views, self.resolution, self.tiles, self._guard, origin, program)
        for first in range(0, len(views), self.tiles):
            # The full state, so that no draw depends on the one before.
            context.enable_only(moderngl.DEPTH_TEST)
            context.depth_func = "<"
            context.front_face, context.cull_face = "ccw", "back"
            framebuffer.use()
            self._window = (0, 0, width, height * self.tiles)
            if windows is not None and self.tiles == 1:
                x, y, wide, high = windows[first].tolist()
                self._window = (x, y, wide, high)
            framebuffer.scissor = self._window
            framebuffer.clear(0.0, 0.0, 0.0, 0.0, depth=1.0)
            n = min(self.tiles, len(views) - first)
            for tile in range(n):
                view = first + tile
                # wider than the tile: see _GUARD
                framebuffer.viewport = (
                    -side * width,
                    (tile - side) * height,
                    self._guard * width,
                    self._guard * height,
                )
                if self.tiles > 1:
                    framebuffer.scissor = (0, tile * height, width, height)
                for name, rows in uniforms.items():
                    write(program, name, rows[view])
                for selection in selections:
                    selection.draw(program, view)
            yield first, n


def faces_in_images(images: NDArray[np.uint32], n_faces: int, min_pixels: int = 1) -> Bools:
    """Return which faces show in at least ``min_pixels`` pixels of ID images, (n, F) bool."""
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
    offset = -views.tan_half
    # gl_FragCoord counts from the bottom of the framebuffer, not of the tile
    offset[:, 1] -= scale[:, 1] * resolution[1] * (np.arange(len(views)) % tiles)
    uniforms = {
        "world_to_clip": np.swapaxes(projection @ rigid_inverse(pose), 1, 2),  # columns first
        "eye": pose[:, :3, 3],
        "backwards": pose[:, :3, 2],
        "pixel_to_tangent": np.concatenate([scale, offset], axis=1),
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
    return uniforms | {"image_width": np.full(len(views), resolution[0], dtype=np.int32)}
