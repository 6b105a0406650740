"""Where a picture is taken from: views with names, and eyes that just fit what they must show.

A view is given as seen from the model: azimuth 0 looks at the front, 90 from the right, and
elevation 90 from the top. The front is seen by looking along ``up`` x right, where right is the
world's X (Y where up is X): with Z up that is along +Y. Pure geometry; draws nothing.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from glvis.problem.camera import projection_matrix, rigid_inverse

Floats = NDArray[np.float64]

# Tangent of half the vertical opening angle of pictures in perspective: a 60 mm lens on film.
_PERSPECTIVE = math.tan(math.radians(12.0))
_QUADRANTS = (35.0, 125.0, 215.0, 305.0)  # azimuths of the perspective, degrees
_ELEVATION = 24.0
_SIMILAR = 0.85  # a view that shows this share of what the best one shows is as good


@dataclass(frozen=True, eq=False)
class Eye:
    """A camera for people, in perspective or parallel.

    Attributes
    ----------
    camera_to_world : (4, 4) float64
        Pose; x right, y up, looking along -z.
    camera_to_clip : (4, 4) float64
        Projection.
    focus : (3,) float64
        World point in the middle of what is shown; lengths are true there.
    light : (3,) float64, optional
        World direction towards the light; without it over the viewer's left shoulder.
    """

    camera_to_world: Floats
    camera_to_clip: Floats
    focus: Floats
    light: Floats | None = None

    @property
    def is_parallel(self) -> bool:
        """Whether equal lengths look equal at every depth."""
        return bool(self.camera_to_clip[3, 2] == 0)

    @property
    def world_to_clip(self) -> Floats:
        """Matrix (4, 4) from world to clip space."""
        return self.camera_to_clip @ rigid_inverse(self.camera_to_world)

    def project(self, points: ArrayLike, size: tuple[int, int]) -> Floats:
        """Return pixels (..., 2), x right and y down from the top left corner.

        Points behind the eye come out as NaN.
        """
        p = np.asarray(points, dtype=float)
        clip = p @ self.world_to_clip[:, :3].T + self.world_to_clip[:, 3]
        w = np.where(clip[..., 3:] > 0, clip[..., 3:], np.nan)
        return (clip[..., :2] / w * [0.5, -0.5] + 0.5) * np.asarray(size, dtype=float)

    def pixels_per_length(self, size: tuple[int, int]) -> float:
        """Return how many pixels one scene unit spans, seen square, at the focus."""
        right = self.camera_to_world[:3, 0]
        a, b = self.project(np.stack([self.focus, self.focus + right]), size)
        return float(b[0] - a[0])


@dataclass(frozen=True)
class View:
    """A named direction to look from.

    Attributes
    ----------
    name : str
        For people and file names.
    azimuth_deg, elevation_deg : float
        Of the eye as seen from the scene; see the module's docstring.
    is_parallel : bool
        Parallel projection; else perspective.
    """

    name: str
    azimuth_deg: float
    elevation_deg: float
    is_parallel: bool = True


def level_axes(up: ArrayLike) -> tuple[Floats, Floats, Floats]:
    """Return right, forward and up, unit vectors (3,): what a front view shows as x, depth, y."""
    z = np.asarray(up, dtype=float) / np.linalg.norm(up)
    x = np.array([1.0, 0, 0]) if abs(z[0]) < 0.9 else np.array([0, 1.0, 0])
    x = x - z * (x @ z)
    x /= np.linalg.norm(x)
    return x, np.cross(z, x), z


def towards_eye(up: ArrayLike, azimuth_deg: float, elevation_deg: float) -> Floats:
    """Return the unit direction (3,) from the scene to the eye of a view."""
    right, forward, z = level_axes(up)
    azimuth, elevation = math.radians(azimuth_deg), math.radians(elevation_deg)
    level = right * math.sin(azimuth) - forward * math.cos(azimuth)
    return level * math.cos(elevation) + z * math.sin(elevation)


def direction_angles(up: ArrayLike, direction: ArrayLike) -> tuple[float, float]:
    """Return azimuth and elevation, degrees, of the view from a direction (3,) off the scene."""
    right, forward, z = level_axes(up)
    d = np.asarray(direction, dtype=float)
    level = math.hypot(float(d @ right), float(d @ forward))
    azimuth = math.degrees(math.atan2(float(d @ right), -float(d @ forward))) if level else 0.0
    return azimuth % 360, math.degrees(math.atan2(float(d @ z), level))


def view_axes(up: ArrayLike, view: View) -> Floats:
    """Return right, up and backwards of a view's image as columns (3, 3)."""
    right, forward, _ = level_axes(up)
    azimuth = math.radians(view.azimuth_deg)
    # Turning about up only: defined from the top, too.
    x = right * math.cos(azimuth) + forward * math.sin(azimuth)
    back = towards_eye(up, view.azimuth_deg, view.elevation_deg)
    return np.stack([x, np.cross(back, x), back], axis=1)


def fitted_eye(
    up: ArrayLike, view: View, points: ArrayLike, aspect: float, margin: float = 0.04
) -> Eye:
    """Return the eye of a view that shows all points as large as possible.

    Parameters
    ----------
    up : (3,) float
        World direction that stands upright.
    view : View
        Where from.
    points : (N, 3) float
        What must be seen.
    aspect : float
        Width over height of the picture.
    margin : float
        Share of the picture left free at each side.
    """
    axes = view_axes(up, view)
    seen = np.asarray(points, dtype=float) @ axes  # x, y, towards the eye
    low, high = seen.min(axis=0), seen.max(axis=0)
    middle = (low + high) / 2
    radius = max(float(np.linalg.norm(high - low)) / 2, 1e-9 * (1 + float(np.abs(middle).max())))
    free = 1 - 2 * margin
    pose = np.eye(4)
    pose[:3, :3] = axes
    if view.is_parallel:
        half = max((high[1] - low[1]) / 2, (high[0] - low[0]) / 2 / aspect, 1e-6 * radius) / free
        pose[:3, 3] = axes @ [middle[0], middle[1], middle[2] + 2.5 * radius]
        clip = np.diag([1 / (half * aspect), 1 / half, -2 / (5 * radius), 1.0])
        clip[2, 3] = -1.0  # depths 0 to 5 radii
        return Eye(pose, clip, axes @ middle)
    tan = np.array([_PERSPECTIVE * aspect, _PERSPECTIVE])
    # A point at (x, z) is inside where |x - at| <= slope (distance - z): two bounds an axis,
    # and the nearest eye meets both.
    slope = tan * free
    upper = (seen[:, :2] + slope * seen[:, 2:]).max(axis=0)
    lower = (-seen[:, :2] + slope * seen[:, 2:]).max(axis=0)
    at = (upper - lower) / 2
    place = max(float(np.max((upper + lower) / (2 * slope))), high[2] + 0.05 * radius)
    pose[:3, 3] = axes @ [*at, place]
    distance = place - middle[2]
    near = max(0.02 * distance, distance - 4 * radius)
    return Eye(pose, projection_matrix(tan, near, distance + 4 * radius), axes @ [*at, middle[2]])


def standard_views(
    up: ArrayLike, normals: ArrayLike, areas: ArrayLike, extent: ArrayLike
) -> dict[str, View]:
    """Return perspective, top, front and side, each from where more of the surface faces.

    Parameters
    ----------
    up : (3,) float
        World direction that stands upright.
    normals, areas : (F, 3), (F,) float
        Of what is to be seen. A closed surface looks alike from opposite sides; furniture
        without backs does not.
    extent : (3,) float
        Size of its box.
    """
    n, area = np.asarray(normals, dtype=float), np.asarray(areas, dtype=float)
    right, forward, _ = level_axes(up)

    def facing(azimuth: float, elevation: float) -> float:
        return float(area @ np.maximum(n @ towards_eye(up, azimuth, elevation), 0))

    def best(*azimuths: float, elevation: float = 0.0) -> float:
        scores = [facing(azimuth, elevation) for azimuth in azimuths]
        return next(
            azimuth
            for azimuth, score in zip(azimuths, scores, strict=True)
            if score >= _SIMILAR * max(scores)
        )

    front, side = best(0.0, 180.0), best(90.0, 270.0)
    perspective = best(*_QUADRANTS, elevation=_ELEVATION)
    size = np.abs(np.asarray(extent, dtype=float))
    if abs(forward) @ size > abs(right) @ size:  # long things are shown from their long side
        perspective += 25.0 if perspective in (35.0, 215.0) else -25.0
    return {
        "perspective": View("perspective", perspective, _ELEVATION, is_parallel=False),
        "top": View("top", 0.0, 90.0),
        "front": View("front" if front == 0 else "back", front, 0.0),
        "side": View("right" if side == 90 else "left", side, 0.0),
    }


def axis_label(direction: ArrayLike) -> str:
    """Return "+X", "−Z" … for a direction along a world axis, else nothing."""
    d = np.asarray(direction, dtype=float)
    axis = int(np.argmax(np.abs(d)))
    if abs(d[axis]) < 0.999 * float(np.linalg.norm(d)):
        return ""
    return ("+" if d[axis] > 0 else "−") + "XYZ"[axis]
