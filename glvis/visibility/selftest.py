"""Draws a known scene and refuses a driver that gets it wrong.

Drivers have been wrong about just what a visibility map stands on: ``gl_PrimitiveID`` on
llvmpipe of Mesa 25.3 to 26.1, integer clears, flat attributes. A wrong map looks plausible, so
it is better to find out before the first one.
"""

from __future__ import annotations

from functools import cache

import numpy as np

from glvis.errors import MachineError
from glvis.problem.camera import look_along
from glvis.problem.lens import Pinhole
from glvis.problem.scene import Model
from glvis.problem.sensor import Sensor
from glvis.visibility.batch import Question
from glvis.visibility.cast import Caster, has_compute
from glvis.visibility.clusters import Clusters
from glvis.visibility.context import gl_info
from glvis.visibility.culling import cull
from glvis.visibility.filters import Limits
from glvis.visibility.gpu_scene import GpuScene
from glvis.visibility.points import Large
from glvis.visibility.renderer import Renderer, Selection, depth_along_axis
from glvis.visibility.surface import Surface
from glvis.visibility.views import Views, WindowViews

_SIZE = 8  # pixels a side: each covers one unit of the wall below


@cache
def can_cast() -> bool:
    """Return whether this process's driver has compute shaders, and casts known scenes rightly."""
    if not has_compute():
        return False
    try:
        return all(
            np.array_equal(_cast(cells, large, grid), _on_wall(cells, large))
            # small faces; two that are larger than the image, by their centres and all over; and a
            # plate that covers very many cells
            for cells, large, grid in (
                ((10, 8), None, _SIZE),
                ((1, 1), None, _SIZE),
                ((1, 1), Large(0.5, 0.5), _SIZE),
                ((10, 8), None, 32 * _SIZE),
            )
        )
    except (MachineError, IndexError):  # its compiler refuses a shader, or it invents records
        return False


@cache
def check_driver() -> None:
    """Draw the known scene once a process.

    Raises
    ------
    MachineError
        Where the driver draws anything else, with what it drew.
    """
    for name, drawn, expected in _pictures():
        if not np.array_equal(drawn, expected):
            info = gl_info()
            raise MachineError(
                f"{info.renderer} ({info.version}) draws {name} wrongly: row by row it gave "
                f"{drawn.tolist()} instead of {expected.tolist()}; update the driver, or choose "
                "another one by GLVIS_GL=egl or GLVIS_GL=osmesa"
            )


def _view() -> Views:
    """Return the view of the scenes here: straight down, 8 x 8 units wide at the wall."""
    sensor = Sensor("self-test", Pinhole.from_degrees(53, 53), (_SIZE, _SIZE), 2, 9)
    pose = look_along([[0, 0, 0]], [[0, 0, -1]], up=(0, 1, 0))
    reach, near, far = np.array([[9.0], [1.0], [10.0]])
    windows = WindowViews(pose, np.array([0.5, 0.5]), reach, near, far, reach)
    return Views(pose, sensor, Limits(Pinhole.from_tangents(0.5, 0.5), 2.0, 9.0), windows)


def _wall_grid(cells: tuple[int, int]) -> tuple[np.ndarray, np.ndarray]:
    """Return the lower left corner and the size of a cell of the wall that is cast, (2,) each.

    Cells are shifted, so that no centre lies where the plate ends. A single one reaches around the
    eye.
    """
    corner, size = np.array([-5.0, -4.0]), np.array([10.0, 8.0])
    return (2 * corner, 2 * size) if cells == (1, 1) else (corner - [0.3, 0.1], size / cells)


def _grid(corner: np.ndarray, cell: np.ndarray, cells: tuple[int, int], z: float) -> Model:
    """Return a grid of cells of two faces, lower right and upper left, that looks towards +z."""
    x, y = (corner[k] + cell[k] * np.arange(cells[k] + 1) for k in range(2))
    points = np.stack([*np.meshgrid(x, y, indexing="ij"), np.full((len(x), len(y)), z)], axis=-1)
    i, j = np.indices(cells).reshape(2, -1)
    a, up = i * len(y) + j, len(y)
    faces = np.stack([[a, a + up, a + up + 1], [a, a + up + 1, a + 1]])
    return Model.from_arrays(
        "self-test", points.reshape(-1, 3), faces.transpose(2, 0, 1).reshape(-1, 3)
    )


def _cast(cells: tuple[int, int], large: Large | None, grid: int) -> np.ndarray:
    """Return which faces of the wall a Caster sees beside the plate."""
    wall = _grid(*_wall_grid(cells), cells, -8.0)
    plate = _grid(np.array([0.0, -2.0]), np.array([2.0, 4.0]), (1, 1), -4.0)
    scene, caster, view = GpuScene([wall], [plate], np.zeros(3)), Caster(), _view()
    try:
        question = Question(scene, scene.targets[0], [(grid, grid)], large)
        found = caster.answer(question, view, cull(scene, view))
        return np.zeros(0) if found is None else found[0]
    finally:
        caster.release()
        scene.release()


def _on_wall(cells: tuple[int, int], large: Large | None) -> np.ndarray:
    """Return the same by hand: the plate hides all of x > 0."""
    if large:  # half of the picture shows both faces
        return np.ones(2, dtype=bool)
    corner, cell = _wall_grid(cells)
    i, j, is_upper = np.indices((*cells, 2)).reshape(3, -1)
    x = corner[0] + cell[0] * (i + (2 - is_upper) / 3)
    y = corner[1] + cell[1] * (j + (1 + is_upper) / 3)
    return (x > -4) & (x < 0) & (np.abs(y) < 4)


def _pictures() -> list[tuple[str, np.ndarray, np.ndarray]]:
    """Return names, what was drawn and what must be."""
    # A wall 8 units below the eye that fills the picture, parted by the line y = 0.8 x, which
    # meets no pixel's middle; before its right half, 4 below the eye, a plate that looks the
    # other way: it hides and has no ID.
    wall = [[-5, -4, -8], [5, -4, -8], [5, 4, -8], [-5, 4, -8]]
    plate = [[0, -2, -4], [2, -2, -4], [2, 2, -4], [0, 2, -4]]
    faces = [[0, 1, 2], [0, 2, 3], [6, 5, 4], [7, 6, 4]]
    model, view = Model.from_arrays("self-test", wall + plate, faces), _view()
    row, column = np.indices((_SIZE, _SIZE))
    x, y = column - 3.5, 3.5 - row  # of the pixels' middles, on the wall
    expected_ids = np.where(x < 0, np.where(y > 0.8 * x, 2, 1), 0)
    drawn_ids = np.zeros_like(expected_ids)
    surface = Surface(Clusters.of(model), np.zeros(3), is_target=True)
    selection = Selection(surface, np.ones((1, len(surface.clusters)), bool))
    with Renderer((_SIZE, _SIZE)) as renderer:
        for _ in range(2):  # the second time over what the first has left
            for _, images in renderer.id_images(view, [selection], origin=np.zeros(3)):
                drawn_ids = images[0].astype(int)
            depth = depth_along_axis(renderer.read_depths(1)[0], 1, 10)
        for _, images in renderer.id_images(view, [], origin=np.zeros(3)):
            nothing = images[0].astype(int)
    surface.release()
    return [
        ("face IDs", drawn_ids, expected_ids),
        ("depths", np.round(depth, 3), np.where(x < 0, 8.0, 4.0)),
        ("an empty scene", nothing, np.zeros_like(nothing)),
    ]
