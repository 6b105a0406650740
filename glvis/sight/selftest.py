"""Draws a known scene and refuses a driver that gets it wrong.

Drivers have been wrong about just what a visibility map stands on: ``gl_PrimitiveID`` on
llvmpipe of Mesa 25.3 to 26.1, integer clears, flat attributes. A wrong map looks plausible, so
it is better to find out before the first one.
"""

from __future__ import annotations

from functools import cache

import numpy as np

from glvis.camera import camera_to_world
from glvis.errors import MachineError
from glvis.inputs.scene import Model
from glvis.sight.caster import Caster, Rules, has_compute
from glvis.sight.clusters import Clusters
from glvis.sight.context import gl_info
from glvis.sight.renderer import Renderer, Selection, Views, depth_along_axis
from glvis.sight.surface import Surface

_SIZE = 8  # pixels a side: each covers one unit of the wall below


@cache
def can_cast() -> bool:
    """Return whether this process's driver has compute shaders, and they judge a scene right."""
    if not has_compute():
        return False
    model, view = _scene()
    surface = Surface(Clusters.of(model), np.zeros(3), is_target=True)
    everything = np.ones((1, len(surface.clusters)), bool)
    selection = Selection(surface, everything, np.zeros(1, bool))
    caster = Caster(Renderer((_SIZE, _SIZE)))
    try:
        seen = [
            caster.visible(view, selection, everything, [], rules, origin=np.zeros(3))[0].tolist()
            for rules in (Rules(3, False, 0.0), Rules(0, True, 0.1))
        ]
    except MachineError:  # its compiler refuses the shader
        return False
    finally:
        caster.release()
        surface.release()
    # the lower half of the wall has its centre behind the plate, but shows beside it
    return seen == [[True, True, False, False], [False, True, False, False]]


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


def _scene() -> tuple[Model, Views]:
    """Return a scene whose picture is known by hand, and who looks at it."""
    # A wall 8 units below the eye that fills the picture, parted by the line y = 0.8 x, which
    # meets no pixel's middle; before its right half, 4 below the eye, a plate that looks the
    # other way: it hides and has no ID.
    wall = [[-5, -4, -8], [5, -4, -8], [5, 4, -8], [-5, 4, -8]]
    plate = [[0, -2, -4], [2, -2, -4], [2, 2, -4], [0, 2, -4]]
    faces = [[0, 1, 2], [0, 2, 3], [6, 5, 4], [7, 6, 4]]
    model = Model.from_arrays("self-test", wall + plate, faces)
    view = Views(
        camera_to_world([[0, 0, 0]], [[0, 0, -1]], up=(0, 1, 0)),
        *(np.array(value, dtype=float) for value in ([[0.5, 0.5]], [1], [10], [2], [9], [0], [-2])),
    )
    return model, view


def _pictures() -> list[tuple[str, np.ndarray, np.ndarray]]:
    """Return names, what was drawn and what must be."""
    model, view = _scene()
    row, column = np.indices((_SIZE, _SIZE))
    x, y = column - 3.5, 3.5 - row  # of the pixels' middles, on the wall
    expected_ids = np.where(x < 0, np.where(y > 0.8 * x, 2, 1), 0)
    drawn_ids = np.zeros_like(expected_ids)
    surface = Surface(Clusters.of(model), np.zeros(3), is_target=True)
    selection = Selection(surface, np.ones((1, len(surface.clusters)), bool), np.zeros(1, bool))
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
