"""A furnished kitchen in a room of 3 x 3 x 3.5 m, of boxes and turned bodies.

Millimetres, Z up, one corner of the room at the origin, a cupboard run along the wall y = 0.
Furniture only: no floor, walls or ceiling. As in a scan, nothing is modelled where furniture
stands on the floor, leans on a wall or carries something round, so the meshes are open there.
"""

from __future__ import annotations

import itertools
import math
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from scenery.implicit import Array
from scenery.remesh import Remesher

Mesh = tuple[Array, NDArray[np.int64]]

ROOM = (3000.0, 3000.0, 3500.0)
EDGE = 108.0  # wanted edge length; the mean comes out shorter, boards are 60 thick


@dataclass
class Boxes:
    """A union of boxes, with boxes cut out of it, along the axes."""

    _steps: list[tuple[bool, tuple[float, ...]]] = field(default_factory=list)

    def add(self, x0: float, x1: float, y0: float, y1: float, z0: float, z1: float) -> None:
        """Join a box to what there is."""
        self._steps.append((True, (x0, x1, y0, y1, z0, z1)))

    def cut(self, x0: float, x1: float, y0: float, y1: float, z0: float, z1: float) -> None:
        """Take a box away from what there is."""
        self._steps.append((False, (x0, x1, y0, y1, z0, z1)))

    def mesh(self, walls: bool = False, edge: float = EDGE) -> Mesh:
        """Return the surface with even edges, without what lies on the floor.

        ``walls`` says that the boxes stand where they belong in the room: then what lies
        on its walls is left out too.
        """
        boxes = np.array([box for _, box in self._steps]).reshape(-1, 3, 2)
        axes = [_fine(np.unique(boxes[:, axis]), edge) for axis in range(3)]
        solid = np.zeros([len(a) + 1 for a in axes], dtype=bool)  # a layer of air all around
        for (keep, _), box in zip(self._steps, boxes, strict=True):
            ranges = [np.searchsorted(a, ends) for a, ends in zip(axes, box, strict=True)]
            solid[tuple(slice(lo + 1, hi + 1) for lo, hi in ranges)] = keep
        counts = [len(a) for a in axes]
        grid = np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1).reshape(-1, 3)
        index = np.arange(len(grid)).reshape(counts)
        faces = []
        for axis in range(3):
            below = np.moveaxis(solid, axis, 0)[:-1, 1:-1, 1:-1]
            above = np.moveaxis(solid, axis, 0)[1:, 1:-1, 1:-1]
            corner = np.moveaxis(index, axis, 0)
            quad = [corner[:, :-1, :-1], corner[:, 1:, :-1], corner[:, 1:, 1:], corner[:, :-1, 1:]]
            is_hidden = (axes[axis] <= 0) | (axes[axis] >= ROOM[axis])
            is_hidden &= walls or axis == 2
            for outward, side in ((True, below & ~above), (False, above & ~below)):
                side = side & ~is_hidden[:, None, None]
                a, b, c, d = (q[side] for q in quad)
                if outward == (axis == 1):  # moving the axis to the front mirrors y only
                    b, d = d, b
                faces += [np.stack([a, b, c], axis=1), np.stack([a, c, d], axis=1)]
        remesher = Remesher(grid, np.concatenate(faces), edge)
        remesher.run(10)
        return remesher.vertices, remesher.faces


def _fine(lines: Array, edge: float) -> Array:
    """Return grid lines no further apart than ``edge``."""
    parts = [
        lo + (hi - lo) * np.arange(n) / n
        for lo, hi in itertools.pairwise(lines)
        for n in [math.ceil((hi - lo) / edge)]
    ]
    return np.append(np.concatenate(parts), lines[-1])


def turned(profile: list[tuple[float, float]], edge: float = 0.85 * EDGE) -> Mesh:
    """Return a body turned about the z axis.

    ``profile`` lists (radius, z) along the outside, upwards; an end off the axis stays open.
    """
    rings = [profile[0]]
    for (r0, z0), (r1, z1) in itertools.pairwise(profile):
        n = max(1, round(math.sqrt((r1 - r0) * (r1 - r0) + (z1 - z0) * (z1 - z0)) / edge))
        rings += [(r0 + (r1 - r0) * i / n, z0 + (z1 - z0) * i / n) for i in range(1, n + 1)]
    vertices: list[tuple[float, float, float]] = []
    faces: list[tuple[int, int, int]] = []
    previous: list[int] = []
    for r, z in rings:
        n = max(5, round(2 * math.pi * r / edge)) if r > 0 else 1
        ring = list(range(len(vertices), len(vertices) + n))
        vertices += [(*(r * c for c in _circle(i, n)), z) for i in range(n)]
        if previous:
            faces += _zip(previous, ring)
        previous = ring
    return np.array(vertices), np.array(faces)


def _circle(i: int, n: int) -> tuple[float, float]:
    """Return cosine and sine of i/n of a turn, without the last bits of a machine's own."""
    return round(math.cos(2 * math.pi * i / n), 12), round(math.sin(2 * math.pi * i / n), 12)


def _zip(low: list[int], high: list[int]) -> list[tuple[int, int, int]]:
    """Return the band of triangles between two rings, whatever their numbers of vertices."""
    i, j, n, m = 0, 0, len(low), len(high)
    faces = []
    while (i < n and n > 1) or (j < m and m > 1):
        # Step on the ring whose next vertex comes first around the turn.
        low_first = n > 1 and (m == 1 or (2 * i + 1) * m <= (2 * j + 1) * n)
        if low_first:
            faces.append((low[i % n], low[(i + 1) % n], high[j % m]))
            i += 1
        else:
            faces.append((high[j % m], low[i % n], high[(j + 1) % m]))
            j += 1
    return faces


def placed(mesh: Mesh, x: float, y: float, z: float = 0.0, degrees: float = 0.0) -> Mesh:
    """Return a mesh turned about the vertical and moved."""
    vertices, faces = mesh
    c, s = (round(f(math.radians(degrees)), 12) for f in (math.cos, math.sin))
    px, py, pz = vertices.T
    return np.stack([c * px - s * py + x, s * px + c * py + y, pz + z], axis=1), faces


def _run() -> Boxes:
    """Return fridge, base cupboards, cooker, worktop with sink, hood and wall cupboards."""
    b = Boxes()
    b.add(0, 600, 0, 560, 0, 1720)  # fridge with two doors and a handle
    b.add(0, 600, 560, 620, 100, 640)
    b.add(0, 600, 560, 620, 710, 1720)
    b.add(480, 540, 620, 680, 800, 1200)
    for x0, x1 in ((600, 1100), (1700, 2560)):
        b.add(x0, x1, 0, 500, 0, 100)  # plinth, cupboard, worktop, wall cupboard
        b.add(x0, x1, 0, 560, 100, 860)
        b.add(x0, x1, 0, 620, 860, 920)
        b.add(x0, x1, 0, 340, 1420, 2000)
    for x0 in (820, 1980, 2300):  # gaps between the doors
        b.cut(x0, x0 + 60, 500, 560, 100, 860)
    b.cut(820, 880, 280, 340, 1420, 2000)
    b.cut(1980, 2040, 280, 340, 1420, 2000)
    b.cut(2100, 2500, 120, 340, 1480, 1680)  # open shelves
    b.cut(2100, 2500, 120, 340, 1740, 1940)
    b.add(1100, 1700, 0, 560, 0, 920)  # cooker: oven window, drawer, handle, rear panel
    b.cut(1190, 1610, 500, 560, 330, 620)
    b.cut(1100, 1700, 500, 560, 180, 240)
    b.add(1190, 1610, 560, 620, 700, 760)
    b.add(1100, 1700, 0, 60, 920, 1010)
    b.add(1100, 1700, 0, 480, 1580, 1660)  # hood and chimney
    b.add(1270, 1530, 0, 240, 1660, 2200)
    b.cut(1830, 2240, 160, 440, 760, 920)  # sink and tap
    b.add(2010, 2070, 40, 100, 920, 1200)
    b.add(2010, 2070, 100, 300, 1140, 1200)
    b.add(630, 1040, 80, 400, 920, 1190)  # microwave
    b.cut(690, 900, 340, 400, 980, 1130)
    return b


def _island() -> Boxes:
    """Return the island, its open shelves towards the table (+y)."""
    b = Boxes()
    b.add(80, 760, 80, 520, 0, 100)
    b.add(20, 820, 80, 580, 100, 850)
    b.add(-40, 880, 20, 640, 850, 910)
    b.cut(80, 520, 360, 580, 160, 450)
    b.cut(80, 520, 360, 580, 510, 790)
    b.cut(640, 700, 520, 580, 100, 850)
    b.cut(390, 450, 80, 140, 100, 850)
    return b


def _dresser() -> Boxes:
    """Return the tall shelves in the corner of the walls x = 0 and y = 3000."""
    b = Boxes()
    b.add(0, 320, 2480, 3000, 0, 1780)
    for z0 in (740, 1080, 1420):
        b.cut(100, 320, 2540, 2940, z0, z0 + 280)
    b.cut(260, 320, 2710, 2770, 60, 680)
    return b


def _table() -> Boxes:
    b = Boxes()
    b.add(0, 900, 0, 700, 680, 740)
    b.add(60, 840, 60, 640, 610, 680)
    b.cut(130, 770, 130, 570, 610, 680)
    for x0 in (60, 770):
        for y0 in (60, 570):
            b.add(x0, x0 + 70, y0, y0 + 70, 0, 680)
    return b


def _chair() -> Mesh:
    """Return a chair about the origin that faces +y, its back leaning backwards."""
    b = Boxes()
    b.add(-210, 210, -210, 210, 400, 460)
    for x0 in (-210, 150):
        b.add(x0, x0 + 60, 150, 210, 0, 400)
        b.add(x0, x0 + 60, -210, -150, 0, 900)
    b.add(-150, 150, -210, -150, 760, 900)
    b.add(-150, 150, -210, -150, 560, 640)
    vertices, faces = b.mesh()
    lean = np.maximum(vertices[:, 2] - 460.0, 0.0) * 0.15
    return vertices - lean[:, None] * np.array([0.0, 1.0, 0.0]), faces


def make_kitchen() -> Mesh:
    """Return the kitchen, about 6,500 even faces in several open components."""
    chair = _chair()
    parts = [
        _run().mesh(walls=True),
        placed(_island().mesh(), 420, 1270),
        _dresser().mesh(walls=True),
        placed(_table().mesh(), 1900, 1620),
        placed(chair, 2340, 1580, degrees=-5),
        placed(chair, 1720, 1990, degrees=-84),
        placed(chair, 2380, 2530, degrees=197),
        placed(turned([(110, 0), (110, 130), (0, 160)]), 1260, 220, 920),  # pots
        placed(turned([(130, 0), (130, 90), (0, 110)]), 1540, 380, 920),
        placed(turned([(85, 0), (105, 90), (70, 200), (0, 240)]), 2450, 320, 920),  # kettle
        placed(turned([(80, 0), (160, 60), (190, 130), (90, 60), (0, 40)]), 2350, 1980, 740),
        placed(turned([(60, 0), (85, 120), (50, 260), (70, 330), (0, 250)]), 2060, 2150, 740),
        placed(turned([(60, 0), (130, 110), (80, 50), (0, 30)]), 700, 1600, 910),
        placed(turned([(0, 0), (230, -60), (200, 0), (60, 150), (0, 170)]), 2330, 1970, 1700),
        placed(turned([(120, 0), (150, 480), (80, 540), (0, 560)]), 2760, 300),  # bin
        placed(
            turned([(180, 0), (150, 40), (45, 80), (45, 560), (190, 600), (190, 660), (0, 670)]),
            800,
            2250,
        ),
    ]
    vertices = np.concatenate([v for v, _ in parts])
    starts = np.cumsum([0, *(len(v) for v, _ in parts[:-1])])
    faces = np.concatenate([f + start for (_, f), start in zip(parts, starts, strict=True)])
    return vertices, faces
