"""One study set up for pictures: models, obstacles and sensors on the GPU, and eyes for them.

The join between what is shown (studies, maps, colours) and how it is drawn (shading); knows
nothing of sheets and files.
"""

from __future__ import annotations

from functools import cached_property

import numpy as np
from numpy.typing import ArrayLike, NDArray

from glvis.common.palette import NO_RAY, OBSTACLE_COLOR, sensor_colors
from glvis.pictures.coloring import Seen
from glvis.pictures.framing import Eye, View, fitted_eye, standard_views, towards_eye
from glvis.pictures.glyphs import frustum_corners, sensor_bodies, sensor_lines
from glvis.pictures.shading import Canvas, Lines, Solid
from glvis.pictures.throughlens import SAMPLES, look_ups, range_factors, wider, window_size
from glvis.problem.camera import projection_matrix
from glvis.problem.lens import Pinhole
from glvis.problem.study import Study
from glvis.problem.winding import encloses
from glvis.visibility.context import Held
from glvis.visibility.visibility_map import VisibilityMap

Floats = NDArray[np.float64]
Colors = NDArray[np.uint8]

_BODY = 0.032  # size of a sensor's body, of the diagonal of models and sensors together
_FAR = 1e3  # depths beyond this many maxD are cut off in a sensor's own view
_CLIP_NEAR = 1e-3  # of maxD
_DIRECTIONS = 400  # that extreme points of a large mesh are looked for in
_SMALL_MESH = 20_000  # vertices that need no such reduction
_STANDS = 0.02  # share of the area that lacks an underside where things stand on a floor
VEIL = 0.3  # opacity of obstacles that shall hide nothing
_AIM = (64, 64)  # pixels of a picture whose middle says what a sensor aims at
_OPPOSITE = 0.25  # cosine below which the first view shows a face too obliquely to judge it


class Stage(Held):
    """One model at a time among obstacles and sensors; a context manager.

    Parameters
    ----------
    study : Study
        Models, obstacles, sensors, up.
    camera_to_world : (S, 4, 4) float64
        Poses of the sensors.

    Attributes
    ----------
    shows_backs : bool
        Whether the back of a face shows in any picture since it was last set to False.
    """

    def __init__(self, study: Study, camera_to_world: ArrayLike) -> None:
        self.study = study
        self.poses = np.asarray(camera_to_world, dtype=float)
        self.colors = sensor_colors(len(study.sensors))
        self.origin = study.models[0].bounds.mean(axis=0)
        self._obstacles = []
        for obstacle in study.obstacles:
            solid = Solid(obstacle.vertices, obstacle.faces, self.origin)
            solid.paint(np.tile(OBSTACLE_COLOR, (obstacle.n_faces, 1)))
            self._obstacles.append(solid)
        vertices, faces, colors = sensor_bodies(
            self.poses, study.sensors, self.colors, self.body_size
        )
        self._bodies = Solid(vertices, faces, self.origin)
        self._bodies.paint(colors)
        self._model: Solid | None = None
        self.shows_backs = False
        self._canvases: dict[tuple[int, int], Canvas] = {}

    def release(self) -> None:
        """Give the GPU's memory back."""
        for solid in (*self._solids(), self._bodies):
            solid.release()
        for canvas in self._canvases.values():
            canvas.release()
        self._canvases.clear()

    @cached_property
    def body_size(self) -> float:
        """Size of a sensor's body, scene unit."""
        corners = [model.bounds for model in self.study.models]
        points = np.concatenate([*corners, self.poses[:, :3, 3]])
        return _BODY * float(np.linalg.norm(np.ptp(points, axis=0)))

    @cached_property
    def centres(self) -> Floats:
        """Optical centres of sensors, then of their second viewpoints, (N, 3) world frame."""
        seconds = [
            sensor.partner.poses(pose)[:3, 3]
            for sensor, pose in zip(self.study.sensors, self.poses, strict=True)
            if sensor.partner
        ]
        return np.concatenate([self.poses[:, :3, 3], np.array(seconds).reshape(-1, 3)])

    @cached_property
    def is_room(self) -> bool:
        """Whether sensors look from within, so that people look in through backs of walls."""
        low = np.min([model.bounds[0] for model in self.study.models], axis=0)
        high = np.max([model.bounds[1] for model in self.study.models], axis=0)
        centres = self.poses[:, :3, 3]
        return bool(2 * ((centres > low) & (centres < high)).all(axis=1).sum() > len(centres))

    def seen_of(self, index: int, seen_map: VisibilityMap) -> Seen:
        """Return how a model is seen, without showing it."""
        study = self.study
        return Seen(
            study.models[index],
            seen_map,
            study.sensors,
            self.poses,
            study.unit,
            study.visibility.incidence == "axis",
            study.objective.by_area,
        )

    def show(self, index: int, seen_map: VisibilityMap) -> Seen:
        """Put a model on the stage; return how it is seen."""
        model = self.study.models[index]
        if self._model is not None:
            self._model.release()
        is_room = encloses(model.file, self.poses[:, :3, 3])
        self._model = Solid(model.vertices, model.faces, self.origin, has_backs=not is_room)
        self.seen = self.seen_of(index, seen_map)
        self.close_points = extreme_points(model.vertices)
        bodies = self.centres[:, None] + self.body_size * _CUBE
        others = [extreme_points(obstacle.vertices) for obstacle in self.study.obstacles]
        self.rig_points = np.concatenate([self.close_points, bodies.reshape(-1, 3), *others])
        self._aims: Floats | None = None
        return self.seen

    def aims(self) -> Floats:
        """Return how far along its axis each sensor meets a surface, (S,); inf for none."""
        if self._aims is None:
            looks = (self.depth(self.sensor_eye(s), _AIM)[0] for s in range(len(self.poses)))
            self._aims = np.array([float(_middle(depths).min()) for depths in looks])
        return self._aims

    def paint(self, colors: Colors) -> None:
        """Give the model's faces colours (F, 4)."""
        if self._model is None:
            raise ValueError("no model is on the stage")
        self._model.paint(colors)

    def views(self) -> dict[str, View]:
        """Return perspective, top, front and side of the model on the stage."""
        model = self.seen.model
        return standard_views(
            self.study.up, model.normals, model.areas, np.ptp(model.bounds, axis=0)
        )

    def other_side(self, view: View) -> View:
        """Return the view in perspective that shows most of what another one does not."""
        model, up = self.seen.model, self.study.up
        toward = towards_eye(up, view.azimuth_deg, view.elevation_deg)
        missed = model.areas * (model.normals @ toward < _OPPOSITE)
        net = model.areas @ model.normals  # zero for a closed surface
        best, best_score = view, -1e300
        low = -abs(view.elevation_deg)
        stands = net @ np.asarray(up) > _STANDS * model.areas.sum()
        for turn in (180.0, 90.0, 270.0):  # the first of those that are about as good
            for elevation in (-low,) if stands else (low, -low):
                azimuth = (view.azimuth_deg + turn) % 360
                back = towards_eye(up, azimuth, elevation)
                # an open surface is not looked at from behind
                behind = min(0.0, 2 * float(net @ back))
                score = float(missed @ np.maximum(model.normals @ back, 0)) + behind
                if score - best_score > 0.02 * abs(score):
                    best, best_score = View("other side", azimuth, elevation, False), score
        return best

    def eye(self, view: View, size: tuple[int, int], *, with_rig: bool) -> Eye:
        """Return the eye that fits the model, or model, obstacles and sensors, into a picture.

        Parameters
        ----------
        view : View
            Where from.
        size : tuple of int
            Pixels of the picture.
        with_rig : bool
            Whether the sensors, their frusta and obstacles must be seen as well.
        """
        points = self.close_points
        if with_rig:
            frusta = frustum_corners(self.poses, self.study.sensors, self.body_size, self.aims())
            points = np.concatenate([self.rig_points, *frusta])
        return fitted_eye(self.study.up, view, points, size[0] / size[1])

    def sensor_eye(self, s: int) -> Eye:
        """Return the eye of sensor ``s``, as a pinhole: what it sees, as it sees it."""
        return self._eye_of(s, self.poses[s], self.study.sensors[s].lens.tan_half)

    def _eye_of(self, s: int, pose: Floats, tan_half: Floats, light: Floats | None = None) -> Eye:
        """Return the eye at a pose about the centre of sensor ``s``, which gives it its range."""
        sensor = self.study.sensors[s]
        points = [part.vertices for part in (self.seen.model, *self.study.obstacles)]
        depth = np.concatenate([(pose[:3, 3] - p) @ pose[:3, 2] for p in points])
        reach = sensor.max_distance
        far = float(np.clip(1.01 * depth.max(), reach, _FAR * reach))
        near = float(np.clip(0.9 * depth.min(), _CLIP_NEAR * reach, 0.5 * far))
        clip = projection_matrix(tan_half, near, far)
        middle = (sensor.min_distance + sensor.max_distance) / 2
        return Eye(pose, clip, pose[:3, 3] - middle * pose[:3, 2], light)

    def _window_eyes(self, s: int) -> list[Eye]:
        """Return the eyes of the windows of a sensor's lens, all under one light."""
        windows = wider(self.study.sensors[s].lens.windows)
        # over the shoulder is another place for each of several
        light = None if windows.is_straight else np.asarray(self.study.up, dtype=float)
        pose = np.tile(self.poses[s], (len(windows), 1, 1))
        pose[:, :3, :3] = pose[:, :3, :3] @ windows.window_to_camera
        return [self._eye_of(s, one, windows.tan_half, light) for one in pose]

    def sensor_picture(self, s: int, size: tuple[int, int], *, pixel: float = 1.0) -> Colors:
        """Return the image (H, W, 3) uint8 of sensor ``s``, by its own lens.

        Where its lens has no ray stands ``NO_RAY``. All else as for ``picture``.
        """
        lens = self.study.sensors[s].lens
        if isinstance(lens, Pinhole):
            return self.picture(self.sensor_eye(s), size, pixel=pixel)
        needed = window_size(lens, size)
        scaled = pixel * needed[1] / size[1] if len(lens.windows) == 1 else pixel
        images = [self.picture(eye, needed, pixel=scaled) for eye in self._window_eyes(s)]
        total = np.zeros((size[1], size[0], 3), dtype=np.float32)
        for sample in look_ups(lens, size):
            total += sample.colors(images, NO_RAY)
        return np.round(total / SAMPLES**2).astype(np.uint8)

    def sensor_distances(self, s: int, size: tuple[int, int]) -> tuple[NDArray[np.float32], int]:
        """Return what sensor ``s`` measures: depths or ranges, and samples a pixel along a side.

        As ``depth`` returns them; NaN where its lens has no ray.
        """
        sensor = self.study.sensors[s]
        if isinstance(sensor.lens, Pinhole):
            depths, samples = self.depth(self.sensor_eye(s), size)
            if sensor.distance == "range":
                fine = (size[0] * samples, size[1] * samples)
                depths = (depths * range_factors(sensor.lens, fine)).astype(np.float32)
            return depths, samples
        needed = window_size(sensor.lens, size)
        images = [self.depth(eye, needed)[0] for eye in self._window_eyes(s)]
        found = np.zeros((size[1] * SAMPLES, size[0] * SAMPLES), dtype=np.float32)
        for sample in look_ups(sensor.lens, size):
            values = sample.distances(images, by_range=sensor.distance == "range")
            found[sample.row :: SAMPLES, sample.column :: SAMPLES] = values
        return found, SAMPLES

    def picture(
        self,
        eye: Eye,
        size: tuple[int, int],
        *,
        with_rig: bool = False,
        with_frusta: bool = False,
        pixel: float = 1.0,
        relief: float = 1.0,
        cut_away: bool = False,
        veiled: bool = False,
    ) -> Colors:
        """Return a picture (H, W, 3) uint8 of the painted model.

        Parameters
        ----------
        eye : Eye
            Where from.
        size : tuple of int
            Pixels (width, height).
        with_rig, with_frusta : bool
            Whether to draw the sensors, and their frusta.
        pixel : float
            Pixels that a line of width 1 is wide.
        relief, cut_away : float, bool
            As for ``Canvas.image``.
        veiled : bool
            Whether obstacles are faint, so that what they hide is seen through them.
        """
        lines, solids = None, self._solids()
        if with_rig:
            ends, colors, widths = sensor_lines(
                self.poses,
                self.study.sensors,
                self.colors,
                self.body_size,
                self.aims(),
                with_frusta=with_frusta,
            )
            lines = Lines(ends, colors, widths)
            solids.append(self._bodies)
        canvas = self._canvas(size)

        def drawn(things: list[Solid]) -> Colors:
            image = canvas.image(
                eye,
                things,
                origin=self.origin,
                up=self.study.up,
                lines=lines,
                relief=relief,
                pixel=pixel,
                cut_away=cut_away,
            )
            self.shows_backs |= canvas.shows_backs
            return image

        image = drawn(solids)
        if veiled and self._obstacles:
            without = drawn([solid for solid in solids if solid not in self._obstacles])
            image = np.round(VEIL * image + (1 - VEIL) * without).astype(np.uint8)
        return image

    def depth(
        self,
        eye: Eye,
        size: tuple[int, int],
        *,
        cut_away: bool = False,
        obstacles: bool = True,
    ) -> tuple[NDArray[np.float32], int]:
        """Return distances along the axis, and how many samples a pixel has along each side."""
        canvas, solids = self._canvas(size), self._solids(obstacles)
        depths = canvas.depth(eye, solids, origin=self.origin, cut_away=cut_away)
        return depths, canvas.samples

    def is_hidden(
        self,
        points: Floats,
        eye: Eye,
        size: tuple[int, int],
        *,
        cut_away: bool = False,
        obstacles: bool = True,
    ) -> NDArray[np.bool_]:
        """Return which points (N, 3) lie behind the model or an obstacle in a picture, (N,)."""
        depths, samples = self.depth(eye, size, cut_away=cut_away, obstacles=obstacles)
        pixels = samples * eye.project(points, size)
        height, width = depths.shape
        inside = np.asarray(((pixels >= 0) & (pixels < [width, height])).all(axis=1))
        column, row = np.where(inside[:, None], pixels, 0).astype(int).T
        own = (eye.camera_to_world[:3, 3] - points) @ eye.camera_to_world[:3, 2]
        return np.asarray(inside & (depths[row, column] < own))

    def _solids(self, obstacles: bool = True) -> list[Solid]:
        model = [self._model] if self._model else []
        return [*model, *self._obstacles] if obstacles else model

    def _canvas(self, size: tuple[int, int]) -> Canvas:
        if size not in self._canvases:
            self._canvases[size] = Canvas(size)
        return self._canvases[size]


_CUBE = np.array([(x, y, z) for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)], dtype=float)


def _middle(image: NDArray[np.float32]) -> NDArray[np.float32]:
    """Return the four values in the middle of an image (H, W)."""
    row, column = image.shape[0] // 2, image.shape[1] // 2
    return image[row - 1 : row + 1, column - 1 : column + 1]


def extreme_points(points: ArrayLike) -> Floats:
    """Return points (N, 3) among those given that reach as far in every direction, nearly."""
    p = np.asarray(points, dtype=float)
    if len(p) <= _SMALL_MESH:
        return p
    k = np.arange(_DIRECTIONS)
    z, turn = 1 - (2 * k + 1) / _DIRECTIONS, np.pi * (3 - 5**0.5) * k  # a Fibonacci sphere
    r = np.sqrt(1 - z**2)
    directions = np.stack([r * np.cos(turn), r * np.sin(turn), z], axis=1)
    return p[np.unique([int(np.argmax(p @ direction)) for direction in directions])]
