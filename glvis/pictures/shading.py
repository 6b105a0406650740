"""Draws surfaces and lines for people: softly shaded colour images, and depth along the axis.

Counting is the renderer's business; here a face has a colour and a picture has form. Positions
are float32 relative to an origin near the scene. Images are turned once, on read-back: row 0 is
the top row.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cache
from typing import Any

import moderngl
import numpy as np
from numpy.typing import ArrayLike, NDArray

from glvis.errors import MachineError
from glvis.pictures.framing import Eye
from glvis.pictures.normals import corner_normals
from glvis.problem.camera import rigid_inverse
from glvis.visibility.context import Held, gl_context, unbind_framebuffer
from glvis.visibility.glsl import shader_source

Floats = NDArray[np.float64]
Image = NDArray[np.uint8]

_BACKGROUND = (1.0, 1.0, 1.0)  # prints as paper
_STEPS_BACK = 8.0  # of the depth buffer, by which backs of faces recede: more than rounding takes
_KEY_LIGHT = (-0.45, 0.65, 0.75)  # over the viewer's left shoulder, in the eye's frame
_HIDDEN_OPACITY = 0.22  # of lines behind a surface
_CREVICE = 0.022  # reach of what darkens crevices, of the picture's height
_FEW = 1e-4  # share of an image that nobody looks at: backs between samples at outlines
_OUTLINE, _STRIPE = 1.1, 9.0  # width of outlines, and from stripe to stripe, in pixels


@dataclass(frozen=True, eq=False)
class Lines:
    """Straight lines to be drawn over surfaces, faint where hidden.

    Attributes
    ----------
    ends : (N, 2, 3) float
        World frame.
    colors : (N, 4) uint8
        sRGB and opacity.
    widths : (N,) float
        In units of ``Canvas.image``'s ``pixel``.
    """

    ends: ArrayLike
    colors: ArrayLike
    widths: ArrayLike

    def __len__(self) -> int:
        return len(np.asarray(self.ends))


class Solid:
    """One mesh on the GPU, ready to be painted; a face has one colour.

    Parameters
    ----------
    vertices, faces : (V, 3) float, (F, 3) int
        World frame, scene unit; counter-clockwise seen from the front.
    origin : (3,) float
        World point that float32 positions are relative to; the same for all solids of a picture.
    has_backs : bool
        Whether backs of faces are drawn; without them one looks into a room from outside.
    """

    def __init__(
        self,
        vertices: ArrayLike,
        faces: ArrayLike,
        origin: ArrayLike,
        *,
        has_backs: bool = True,
    ) -> None:
        context = gl_context()
        self.has_backs = has_backs
        points, corners = np.asarray(vertices, dtype=float), np.asarray(faces)
        self.n_faces = len(corners)
        packed = np.concatenate(
            [(points - np.asarray(origin))[corners], corner_normals(points, corners)], axis=2
        ).astype(np.float32)
        self._vertices = context.buffer(packed)
        self._colors = context.buffer(reserve=12 * self.n_faces, dynamic=True)
        self._array = context.vertex_array(
            _program("shaded"),
            [(self._vertices, "3f 3f", "position", "normal"), (self._colors, "4f1", "tint")],
        )

    def paint(self, colors: ArrayLike) -> None:
        """Give each face a colour: (F, 3) or (F, 4) uint8, sRGB; opacity below 191 is striped."""
        wanted = np.asarray(colors, dtype=np.uint8)
        if wanted.shape not in ((self.n_faces, 3), (self.n_faces, 4)):
            raise ValueError(f"{self.n_faces} faces need as many colours, got {wanted.shape}")
        rgba = np.full((self.n_faces, 4), 255, dtype=np.uint8)
        rgba[:, : wanted.shape[1]] = wanted
        self._colors.write(np.repeat(rgba, 3, axis=0))

    def draw(self) -> None:
        """Draw with the program's uniforms as they are."""
        self._array.render(moderngl.TRIANGLES)

    def release(self) -> None:
        """Give the GPU's memory back."""
        for part in (self._array, self._vertices, self._colors):
            part.release()


class Canvas(Held):
    """Framebuffers of one size and the draws into them; a context manager.

    Parameters
    ----------
    size : tuple of int
        Pixels (width, height) of the pictures.
    samples : int
        Per pixel along each side, averaged for smooth edges; fewer where the driver cannot.

    Attributes
    ----------
    shows_backs : bool
        Whether the back of a face shows in the image made last, in more than stray pixels.
    """

    def __init__(self, size: tuple[int, int], samples: int = 2) -> None:
        context = gl_context()
        limit = int(context.info["GL_MAX_TEXTURE_SIZE"])
        if max(size) > limit:
            raise MachineError(
                f"a picture of {size[0]} x {size[1]} pixels exceeds this driver's limit of {limit}"
            )
        self.size, self.samples = size, min(samples, limit // max(size))
        self._fine = (size[0] * self.samples, size[1] * self.samples)
        self._lit = context.texture(self._fine, 4, alignment=4)
        self._over = context.texture(self._fine, 4, alignment=4)
        self._depth = context.depth_texture(self._fine, alignment=4)
        self._depth.compare_func = ""  # read as numbers, not compared
        self._picture = context.texture(size, 4, alignment=4)
        for texture in (self._lit, self._over, self._depth):
            texture.filter = (moderngl.NEAREST, moderngl.NEAREST)
        self._shade = context.framebuffer([self._lit], self._depth)
        self._overlay = context.framebuffer([self._over], self._depth)
        self._develop = context.framebuffer([self._picture])
        self._screen = context.vertex_array(_program("develop"), [])
        self.shows_backs = False

    def release(self) -> None:
        """Give the GPU's memory back."""
        unbind_framebuffer()
        for part in (
            *(self._screen, self._shade, self._overlay, self._develop),
            *(self._lit, self._over, self._depth, self._picture),
        ):
            part.release()

    def image(
        self,
        eye: Eye,
        solids: Sequence[Solid],
        *,
        origin: ArrayLike,
        up: ArrayLike,
        lines: Lines | None = None,
        relief: float = 1.0,
        pixel: float = 1.0,
        cut_away: bool = False,
    ) -> Image:
        """Return a picture (H, W, 3) uint8 of painted solids and lines on white.

        Parameters
        ----------
        eye : Eye
            Where from.
        solids : sequence of Solid
            What to show.
        origin : (3,) float
            As the solids were made with.
        up : (3,) float
            World direction that the sky's light comes from.
        lines : Lines, optional
            Drawn over the solids; faint where a solid hides them.
        relief : float
            How strongly light shapes the colours: 0 leaves them flat, 1 is full.
        pixel : float
            Pixels that a line of width 1 is wide; outlines and stripes follow.
        cut_away : bool
            Whether to leave the backs of faces out, as to look into a room through its walls.
        """
        start = np.asarray(origin, dtype=float)
        fine = pixel * self.samples
        self._draw_solids(eye, solids, start, up, relief, fine, cut_away)
        self._draw_lines(eye, lines, start, fine)
        self._develop_picture(eye, relief, fine)
        width, height = self.size
        raw = self._develop.read(components=4, alignment=1)
        rgba = np.frombuffer(raw, dtype=np.uint8).reshape(height, width, 4)[::-1]
        self.shows_backs = float((rgba[..., 3] == 0).mean()) > _FEW
        return rgba[..., :3]

    def depth(
        self,
        eye: Eye,
        solids: Sequence[Solid],
        *,
        origin: ArrayLike,
        cut_away: bool = False,
    ) -> NDArray[np.float32]:
        """Return distances along the optical axis, scene unit; inf where nothing is.

        One value a sample, not averaged: (H, W) times ``samples``. All else as for ``image``.
        """
        start = np.asarray(origin, dtype=float)
        self._draw_solids(eye, solids, start, (0, 0, 1), 0.0, 1.0, cut_away, in_color=False)
        width, height = self._fine
        raw = self._shade.read(attachment=-1, components=1, dtype="f4", alignment=4)
        z = np.frombuffer(raw, dtype=np.float32).reshape(height, width)[::-1]
        x, y, slope, is_near = _unprojection(eye)
        a, b, c = np.float32(x), np.float32(y), np.float32(slope)
        depths = a / (b + c * z) if is_near else a + c * z
        depths[z >= 1] = np.inf
        return depths

    def _draw_solids(
        self,
        eye: Eye,
        solids: Sequence[Solid],
        origin: Floats,
        up: ArrayLike,
        relief: float,
        pixel: float,
        cut_away: bool,
        *,
        in_color: bool = True,
    ) -> None:
        context, program = gl_context(), _program("shaded")
        # The full state, so that no draw depends on the one before.
        context.enable_only(moderngl.DEPTH_TEST)
        context.depth_func = "<"
        context.front_face = "ccw"
        self._shade.depth_mask = True
        self._shade.use()
        self._shade.viewport = (0, 0, *self._fine)
        self._shade.clear(*_BACKGROUND, 1.0, depth=1.0)
        pose = eye.camera_to_world
        key = pose[:3, :3] @ np.asarray(_KEY_LIGHT) if eye.light is None else eye.light
        program["world_to_clip"].write(_columns_first(_from_origin(eye, origin)))
        program["eye"] = tuple(pose[:3, 2] if eye.is_parallel else pose[:3, 3] - origin)
        program["eye_is_near"] = 0.0 if eye.is_parallel else 1.0
        program["up"] = tuple(np.asarray(up, dtype=float) / np.linalg.norm(up))
        program["key_light"] = tuple(key / np.linalg.norm(key))
        program["stripe"] = _STRIPE * pixel
        program["relief"] = relief
        if not (cut_away or in_color):  # depths do not ask which side it is
            for solid in solids:
                solid.draw()
            return
        # Of a sheet that is modelled from both sides the front shows, wherever one stands.
        context.enable(moderngl.CULL_FACE)
        sides = (("back", 0.0), ("front", _STEPS_BACK))
        for culled, steps_back in sides[:1] if cut_away else sides:
            context.cull_face = culled
            context.polygon_offset = 0.0, steps_back
            for solid in solids:
                if solid.has_backs or culled == "back":
                    solid.draw()
        context.polygon_offset = 0.0, 0.0

    def _draw_lines(self, eye: Eye, lines: Lines | None, origin: Floats, pixel: float) -> None:
        context, program = gl_context(), _program("lines")
        self._overlay.use()
        self._overlay.viewport = (0, 0, *self._fine)
        self._overlay.depth_mask = False  # also spares the depth when clearing
        self._overlay.clear(0.0, 0.0, 0.0, 0.0)
        if lines is None or not len(lines):
            return
        packed = np.zeros(len(lines), dtype=_SEGMENT)
        packed["ends"] = np.asarray(lines.ends, dtype=float) - origin
        packed["color"] = lines.colors
        packed["width"] = np.asarray(lines.widths, dtype=float) * pixel
        buffer = context.buffer(packed)
        array = context.vertex_array(
            program, [(buffer, "3f 3f 4f1 1f/i", "start", "end", "tint", "width")]
        )
        context.enable_only(moderngl.DEPTH_TEST | moderngl.BLEND)
        context.blend_func = moderngl.ONE, moderngl.ONE_MINUS_SRC_ALPHA
        program["world_to_clip"].write(_columns_first(_from_origin(eye, origin)))
        program["viewport"] = self._fine
        for order, opacity in ((">", _HIDDEN_OPACITY), ("<=", 1.0)):
            context.depth_func = order
            program["opacity"] = opacity
            array.render(moderngl.TRIANGLE_STRIP, vertices=4, instances=len(lines))
        array.release()
        buffer.release()

    def _develop_picture(self, eye: Eye, relief: float, pixel: float) -> None:
        context, program = gl_context(), _program("develop")
        context.enable_only(moderngl.NOTHING)
        self._develop.use()
        self._develop.viewport = (0, 0, *self.size)
        height = self._fine[1]
        radius = max(2.0, _CREVICE * height)
        for unit, (name, texture) in enumerate(
            (("lit", self._lit), ("depth", self._depth), ("lines", self._over))
        ):
            texture.use(unit)
            program[name] = unit
        program["samples"] = self.samples
        program["unproject"] = _unprojection(eye)
        program["radius"] = radius
        program["reach"] = radius / eye.pixels_per_length(self._fine)
        program["outline"] = max(1.0, _OUTLINE * pixel)
        program["strength"] = relief
        self._screen.render(moderngl.TRIANGLES, vertices=3)


_SEGMENT = np.dtype([("ends", "f4", (2, 3)), ("color", "u1", 4), ("width", "f4")])


def _from_origin(eye: Eye, origin: Floats) -> Floats:
    """Return the matrix to clip space of positions relative to the origin, in float64."""
    pose = eye.camera_to_world.copy()
    pose[:3, 3] -= origin
    return eye.camera_to_clip @ rigid_inverse(pose)


def _columns_first(matrix: Floats) -> NDArray[np.float32]:
    """Return a matrix as GLSL reads it."""
    return np.ascontiguousarray(matrix.T, dtype=np.float32)


def _unprojection(eye: Eye) -> tuple[float, float, float, float]:
    """Return what turns buffer depths [0, 1] into distances: see develop.frag.glsl."""
    m = eye.camera_to_clip
    if eye.is_parallel:  # 2 z - 1 = m22 (-d) + m23
        return float((1 + m[2, 3]) / m[2, 2]), 0.0, float(-2 / m[2, 2]), 0.0
    # 2 z - 1 = (m22 (-d) + m23) / d
    return float(m[2, 3]), float(m[2, 2]) - 1.0, 2.0, 1.0


@cache
def _program(name: str) -> Any:
    """Return a compiled program of this process's context."""
    vertex = "screen" if name == "develop" else name
    return gl_context().program(
        vertex_shader=shader_source(f"{vertex}.vert.glsl"),
        fragment_shader=shader_source(f"{name}.frag.glsl"),
    )
