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

from glvis.errors import MachineError
from glvis.problem.camera import projection_matrix, rigid_inverse
from glvis.visibility.context import Held, gl_context, gl_info, unbind_framebuffer
from glvis.visibility.surface import Surface, compiled
from glvis.visibility.views import Views

Floats = NDArray[np.float64]
Bools = NDArray[np.bool_]

# Of ID buffers that hardware fills before they are read back: bytes, and framebuffers, of which
# there would be hundreds of thousands where images are small.
_HARDWARE_BATCH_BYTES, _HARDWARE_BATCH = 64 << 20, 256
# The viewport is this odd number of times as wide and high as the image, which lies in its
# middle, so that hardly any face is cut by the sides of the clip volume: a software rasteriser
# cuts faces slowly, while what falls outside the image costs nothing.
_GUARD = 3
# What recedes is drawn farther away by as much as rounding takes of depths of float32 and of a
# buffer of 24 bits: a share of its depth, or so many steps of OpenGL's own depth. That is good
# enough where the clip planes lie at most so many times apart, and quicker, as no shader need write
# depths.
_BACK, _STEPS_BACK, _APART = 1e-6, 8.0, 8.0


@dataclass(frozen=True, eq=False)
class Selection:
    """What the windows of some views draw of a surface, R of them.

    Attributes
    ----------
    surface : Surface
        Of which model.
    mask : (R, C) bool
        Clusters to draw.
    sides : str
        Of its faces: "front", "back", or "both".
    recedes : bool
        Whether what lies in one place with it is drawn before it, and keeps the pixel.
    """

    surface: Surface
    mask: Bools
    sides: str = "both"
    recedes: bool = False


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
            fitting = max(1, _HARDWARE_BATCH_BYTES // (4 * width * height))
            tiles = 1 if gl_info().is_software else min(fitting, _HARDWARE_BATCH)
        self.tiles = tiles
        fits = _GUARD * max(resolution) <= min(context.info["GL_MAX_VIEWPORT_DIMS"])
        self._guard = _GUARD if fits else 1
        self._targets = [_Target.of(resolution) for _ in range(tiles)]
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
        """Yield ID images in batches: index of the first window, and (n, H, W) uint32.

        A pixel holds the index + 1 of the nearest face, or 0 where there is none, the sensor
        refuses it, or it belongs to an obstacle. The arrays are valid until the next batch.

        Parameters
        ----------
        views : Views
            Their R windows are drawn at this renderer's resolution.
        selections : sequence of Selection
            What to draw of each surface.
        origin : (3,) float64
            As the surfaces were made with.
        refused_hide : bool
            Whether back and too oblique faces hide what lies behind them.
        """
        for first, n in self._batches(views, selections, origin, refused_hide):
            yield first, self._read_ids(n)

    def _read_ids(self, n: int) -> NDArray[np.uint32]:
        """Return the ID images of the batch drawn last, (n, H, W)."""
        for target, ids in zip(self._targets[:n], self._ids, strict=False):
            target.framebuffer.read_into(ids, components=1, dtype="u4", alignment=4)
        return self._ids[:n, ::-1]

    def read_depths(self, n: int) -> NDArray[np.float32]:
        """Return the depth buffers of the batch drawn last, (n, H, W)."""
        for target, depths in zip(self._targets[:n], self._depths, strict=False):
            target.framebuffer.read_into(
                depths, attachment=-1, components=1, dtype="f4", alignment=4
            )
        return self._depths[:n, ::-1]

    def _batches(
        self, views: Views, selections: Sequence[Selection], origin: Floats, refused_hide: bool
    ) -> Iterator[tuple[int, int]]:
        """Draw the windows, ``tiles`` at a time; yield the first one and the number drawn."""
        context = gl_context()
        windows = views.windows
        is_even = windows.clip_far > _APART * windows.clip_near
        is_own = views.is_straight and not views.limits.by_range
        defines = [*["REFUSED_HIDE"] * refused_hide, *["LENS"] * (not is_own)]
        programs = {
            even: compiled("id_buffer", *defines, *["EVEN_DEPTH"] * even)
            for even in np.unique(is_even).tolist()
        }
        width, height = self.resolution
        side = self._guard // 2
        # wider than the image: see _GUARD
        viewport = (-side * width, -side * height, self._guard * width, self._guard * height)
        uniforms = {
            even: _uniforms(views, self.resolution, self._guard, origin, program)
            for even, program in programs.items()
        }
        for first in range(0, len(windows), self.tiles):
            n = min(self.tiles, len(windows) - first)
            for view, target in enumerate(self._targets[:n], start=first):
                framebuffer = target.framebuffer
                # The full state, so that no draw depends on the one before.
                context.enable_only(moderngl.DEPTH_TEST)
                context.depth_func = "<"
                framebuffer.use()
                framebuffer.clear(0.0, 0.0, 0.0, 0.0, depth=1.0)
                framebuffer.viewport = viewport
                even = bool(is_even[view])
                program = programs[even]
                for name, rows in uniforms[even].items():
                    write(program, name, rows[view])
                for one in selections:
                    write(program, "back", np.float32(_BACK if one.recedes else 0))
                    steps = _STEPS_BACK if one.recedes and not even else 0.0
                    context.polygon_offset = 0.0, steps
                    if one.sides == "both":
                        context.disable(moderngl.CULL_FACE)
                    else:
                        context.enable(moderngl.CULL_FACE)
                        context.cull_face = "back" if one.sides == "front" else "front"
                    one.surface.draw(program, one.mask[view])
                context.polygon_offset = 0.0, 0.0
            yield first, n


@dataclass(frozen=True, eq=False)
class _Target:
    """What one view is drawn into.

    Attributes
    ----------
    ids, depths : Any
        Textures.
    framebuffer : Any
        Of both.
    """

    ids: Any
    depths: Any
    framebuffer: Any

    @classmethod
    def of(cls, resolution: tuple[int, int]) -> _Target:
        """Return one of so many pixels (width, height)."""
        context = gl_context()
        ids = context.texture(resolution, 1, dtype="u4", alignment=4)
        depths = context.depth_texture(resolution, alignment=4)
        return cls(ids, depths, context.framebuffer([ids], depths))

    def release(self) -> None:
        """Give the GPU's memory back."""
        for part in (self.framebuffer, self.ids, self.depths):
            part.release()


def pixels_of_faces(image: NDArray[np.uint32], n_faces: int) -> NDArray[np.int64]:
    """Return in how many pixels of an ID image (H, W) each face shows, (F,)."""
    ids = image[::-1].ravel()  # as the GPU left it: no copy
    # neighbours along a row mostly show the same face: look at each run once
    begins = np.concatenate([[0], np.flatnonzero(ids[1:] != ids[:-1]) + 1])
    pixels = np.diff(begins, append=len(ids))
    counts = np.bincount(ids[begins].astype(np.intp), pixels, minlength=n_faces + 1)
    return counts[1:].astype(np.int64)


def write(program: Any, name: str, value: Any) -> None:
    """Set a uniform, if the program has it."""
    member = program.get(name, None)
    if member is not None:
        member.write(value)


def depth_along_axis(depth: NDArray[np.float32], near: float, far: float) -> Floats:
    """Return distances along the optical axis, scene unit, for depth buffer values [0, 1].

    ``near`` and ``far`` are the view's clip planes.
    """
    value = depth.astype(np.float64)
    if far > _APART * near:
        return near + value * (far - near)
    return 2 * far * near / (far + near - (2 * value - 1) * (far - near))


def _uniforms(
    views: Views, resolution: tuple[int, int], guard: int, origin: Floats, program: Any
) -> dict[str, NDArray[Any]]:
    """Return what a program asks for, by name and window; matrices are multiplied in float64."""
    windows, limits = views.windows, views.limits
    pose = windows.camera_to_world.copy()
    pose[:, :3, 3] -= origin
    tan_half = windows.tan_half
    projection = projection_matrix(guard * tan_half, windows.clip_near, windows.clip_far)
    scale = 2 * tan_half / np.asarray(resolution)
    # the sensor's own optical axis, in the frame of the window: right, up and depth
    backwards = np.repeat(views.camera_to_world[:, :3, 2], views.per_view, axis=0)
    axis = -np.einsum("rij,ri->rj", pose[:, :3, :3], backwards) * [1.0, 1.0, -1.0]
    uniforms: dict[str, Any] = {
        "world_to_clip": np.swapaxes(projection @ rigid_inverse(pose), 1, 2),  # columns first
        "eye": pose[:, :3, 3],
        "backwards": backwards,
        "clip_range": np.stack([windows.clip_near, windows.clip_far], axis=1),
        "axis": axis,
    }
    constant = {
        "by_range": int(limits.by_range),
        "pixel_to_tangent": np.concatenate([scale, -tan_half]),
        "min_distance": limits.min_distance,
        "max_distance": limits.max_distance,
        "min_ray_cos": limits.min_ray_cos,
        "min_axis_cos": limits.min_axis_cos,
    }
    uniforms |= {name: [value] * len(windows) for name, value in constant.items()}
    return {
        name: np.ascontiguousarray(rows, dtype=np.int32 if name == "by_range" else np.float32)
        for name, rows in uniforms.items()
        if name in program
    }
