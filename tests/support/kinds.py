"""Meshes of every awkward kind, made by formula: what CAD exports, scans and assets are like.

Each function returns vertices (V, 3) float64 and faces (F, 3) int32 of a body about one to three
units across, a few hundred to ten thousand faces; ``KINDS`` names them all. None is what a text
book calls a mesh: shells are open, walls are thin, faces lie on faces, windings contradict.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from support import shapes
from support.shapes import Shape, flipped, merged, moved

# --- building blocks


def turned(axis, degrees: float) -> np.ndarray:
    """Return the rotation (3, 3) about an axis, right-handed."""
    x, y, z = np.asarray(axis, dtype=float) / np.linalg.norm(axis)
    k = np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]])
    a = np.radians(degrees)
    return np.eye(3) + np.sin(a) * k + (1 - np.cos(a)) * k @ k


def sides(size, center=(0, 0, 0), cells: int = 1, open_sides: str = "") -> Shape:
    """Return a box (x, y, z wide) wound outwards, ``cells`` by ``cells`` pairs of faces a side.

    ``open_sides`` names those left out, such as "+z-x". Sides share no vertices.
    """
    width, depth, height = np.broadcast_to(np.asarray(size, dtype=float), 3)
    grid = (cells, cells)
    quarter = {  # side: width and height of a plate whose normal is +z, and what turns it there
        "+z": (width, depth, np.eye(3), (0, 0, height / 2)),
        "-z": (width, depth, turned((1, 0, 0), 180), (0, 0, -height / 2)),
        "+x": (height, depth, turned((0, 1, 0), 90), (width / 2, 0, 0)),
        "-x": (height, depth, turned((0, 1, 0), -90), (-width / 2, 0, 0)),
        "+y": (width, height, turned((1, 0, 0), -90), (0, depth / 2, 0)),
        "-y": (width, height, turned((1, 0, 0), 90), (0, -depth / 2, 0)),
    }
    plates = [
        moved(shapes.plate(w, h, cells=grid), place, turn)
        for name, (w, h, turn, place) in quarter.items()
        if name not in open_sides
    ]
    return moved(merged(*plates), center)


def rod(start, end, radius: float, n: int = 6, capped: bool = True) -> Shape:
    """Return a thin prism of n sides between two points, wound outwards."""
    start, end = np.asarray(start, dtype=float), np.asarray(end, dtype=float)
    along = (end - start) / np.linalg.norm(end - start)
    aside = np.cross(along, np.eye(3)[np.argmin(np.abs(along))])
    aside /= np.linalg.norm(aside)
    other = np.cross(along, aside)
    angle = 2 * np.pi * np.arange(n) / n
    ring = radius * (np.cos(angle)[:, None] * aside + np.sin(angle)[:, None] * other)
    k, following = np.arange(n), (np.arange(n) + 1) % n
    faces = [np.stack([k, following, following + n], 1), np.stack([k, following + n, k + n], 1)]
    vertices = [start + ring, end + ring]
    if capped:
        vertices += [start[None], end[None]]
        faces += [
            np.stack([following, k, np.full(n, 2 * n)], 1),
            np.stack([k + n, following + n, np.full(n, 2 * n + 1)], 1),
        ]
    return np.concatenate(vertices), np.concatenate(faces).astype(np.int32)


def two_sided(shape: Shape) -> Shape:
    """Return a shape with every face once more from the other side, face beside face."""
    n = len(shape[1])
    return shapes.permuted(merged(shape, flipped(shape)), np.arange(2 * n).reshape(2, n).T.ravel())


def height_field(z: np.ndarray, width: float = 2.0) -> Shape:
    """Return a square sheet, normals up, whose vertices have heights z (n, n)."""
    n = len(z)
    vertices, faces = shapes.plate(width, cells=(n - 1, n - 1))
    vertices[:, 2] = z.ravel()
    return vertices, faces


# --- thin walls, open shells


def sheet_box(wall: float) -> Shape:
    """Return an open box of sheet metal: outer and inner skin ``wall`` apart, joined at the rim."""
    inner = 1 - 2 * wall
    skin = sides((1, 1, 0.6), cells=8, open_sides="+z")
    lining = flipped(sides((inner, inner, 0.6 - wall), (0, 0, wall / 2), cells=8, open_sides="+z"))
    o, i = 0.5, inner / 2
    corner = np.array([[-1, -1], [1, -1], [1, 1], [-1, 1]])
    rim = np.concatenate([np.c_[corner * o, np.full(4, 0.3)], np.c_[corner * i, np.full(4, 0.3)]])
    k, following = np.arange(4), (np.arange(4) + 1) % 4
    faces = np.concatenate(
        [np.stack([k, following, following + 4], 1), np.stack([k, following + 4, k + 4], 1)]
    )
    return merged(skin, lining, (rim, faces.astype(np.int32)))


def open_shell() -> Shape:
    """Return an open box of a single sheet, wound outwards, with a slot cut into one side."""
    vertices, faces = sides((1.2, 1, 0.7), cells=10, open_sides="+z")
    middle = vertices[faces].mean(axis=1)
    slot = (middle[:, 0] > 0.59) & (np.abs(middle[:, 1]) < 0.12) & (np.abs(middle[:, 2]) < 0.2)
    return vertices, faces[~slot]


def open_tubes() -> Shape:
    """Return tubes open at both ends, one within the other and one beside them."""
    inner = moved(shapes.tube(0.35, 2.4, 32, 13), (0.02, 0, 0.1))
    beside = moved(shapes.tube(0.2, 1.5, 24, 9), (0.9, 0, 0), turned((1, 1, 0), 50))
    return merged(shapes.tube(0.5, 2.0, 40, 17), inner, beside)


def chair() -> Shape:
    """Return a chair of boxes, every face modelled twice, from both sides."""
    legs = [
        sides((0.06, 0.06, 0.8), (x, y, -0.4), cells=4) for x in (-0.4, 0.4) for y in (-0.4, 0.4)
    ]
    slats = [sides((0.05, 0.02, 0.8), (x, 0.4, 0.45), cells=4) for x in np.linspace(-0.35, 0.35, 6)]
    seat = sides((0.9, 0.9, 0.04), (0, 0, 0.02), cells=10)
    rail = sides((0.9, 0.04, 0.1), (0, 0.4, 0.9), cells=6)
    return two_sided(merged(seat, rail, *legs, *slats))


def back_to_back(gap: float) -> Shape:
    """Return tilted pairs of sheets that look away from each other, ``gap`` apart."""
    pairs = []
    for k in range(6):
        front = shapes.plate(1, 0.8, cells=(9, 7))
        back = moved(flipped(shapes.plate(1, 0.8, cells=(8, 8))), (0, 0, -gap))
        pairs.append(
            moved(
                merged(front, back), (0.25 * k - 0.6, 0.1 * k, 0.2 * k), turned((1, k, 2), 40 * k)
            )
        )
    return merged(*pairs)


def laminate(gap: float) -> Shape:
    """Return sheets that all look the same way, stacked ``gap`` apart, each a bit smaller."""
    return merged(
        *(
            moved(shapes.plate(1.5 - 0.2 * k, 1.2 - 0.15 * k, cells=(12, 9)), (0, 0, gap * k))
            for k in range(5)
        )
    )


def closed_gaps(gap: float) -> Shape:
    """Return sheets and their backs ``gap`` apart, far from the box's middle, beside a tower.

    Where the gap is less than float32 can hold up there, all of them coincide.
    """
    sheets = [shapes.plate(1.4 - 0.2 * k, 1.1 - 0.1 * k, cells=(8 - k, 9)) for k in range(4)]
    sheets = [
        moved(flipped(one) if k == 2 else one, (0, 0, gap * k)) for k, one in enumerate(sheets)
    ]
    tower = sides((0.1, 0.1, 1.5), (0.9, 0, -0.4), cells=6)
    return moved(merged(*sheets, tower), (0, 0, 0.3))


def blinds() -> Shape:
    """Return slats a thousandth thick before a wall of small faces, seen through their gaps."""
    slats = [
        moved(sides((1.6, 0.05, 1e-3), cells=4), (0, 0.03 * k - 0.6, 0.4), turned((1, 0, 0), 55))
        for k in range(40)
    ]
    return merged(shapes.plate(1.8, 1.5, cells=(24, 20)), *slats)


def perforated() -> Shape:
    """Return a bowl of a single sheet with many small holes."""
    x, y = np.meshgrid(np.linspace(-1, 1, 61), np.linspace(-1, 1, 61))
    vertices, faces = height_field(0.4 * (x**2 + y**2))
    cell = np.arange(len(faces)) // 2
    column, row = cell % 60, cell // 60
    return vertices, faces[~((column % 3 == 1) & (row % 3 == 1))]


# --- faces on faces, windings


def coincident() -> Shape:
    """Return a dented body whose every third face is there again, wound the same way."""
    vertices, faces = shapes.blob(np.random.default_rng(5))
    return vertices, np.concatenate([faces, faces[::3], faces[::9]])


def overlapping() -> Shape:
    """Return coplanar sheets that overlap in part, cut into faces of different sizes."""
    return merged(
        shapes.plate(1.6, 1.2, cells=(16, 12)),
        shapes.plate(1.0, 0.9, (0.3, 0.2, 0), cells=(7, 5)),
        moved(shapes.plate(1, 1, (-0.4, 0.1, 0), cells=(11, 11)), (0, 0, 0), turned((0, 0, 1), 30)),
        sides((0.5, 0.5, 0.5), (0, 0, 0.25), cells=6),
    )


def inside_out() -> Shape:
    """Return a dented body wound inwards."""
    return flipped(shapes.blob(np.random.default_rng(6), 4))


def contradictory() -> Shape:
    """Return a torus of which every third face, at random, is wound the other way."""
    vertices, faces = shapes.torus(nu=48, nv=24)
    turn = np.random.default_rng(7).random(len(faces)) < 1 / 3
    faces[turn] = faces[turn, ::-1]
    return vertices, faces


def patchwork() -> Shape:
    """Return a closed box of which single sides are wound inwards, with a ball in it."""
    vertices, faces = sides((1.2, 1, 0.8), cells=10)
    side = np.arange(len(faces)) // 200
    faces[side % 2 == 1] = faces[side % 2 == 1, ::-1]
    return merged((vertices, faces), shapes.icosphere(3, 0.3))


def moebius() -> Shape:
    """Return a Moebius strip: one side, one border, and nowhere a consistent winding."""
    u, v = np.meshgrid(np.linspace(0, 2 * np.pi, 121), np.linspace(-0.35, 0.35, 9), indexing="ij")
    ring = 1 + v * np.cos(u / 2)
    vertices = np.stack([ring * np.cos(u), ring * np.sin(u), v * np.sin(u / 2)], axis=-1)
    return vertices.reshape(-1, 3), shapes._grid_faces(121, 9, False, False).astype(np.int32)


def degenerate() -> Shape:
    """Return a torus with faces of no area among the others: lines and points."""
    vertices, faces = shapes.torus()
    lines, points = faces[::5].copy(), faces[::7].copy()
    lines[:, 2], points[:, 1:] = lines[:, 0], points[:, :1]
    order = np.random.default_rng(8).permutation(len(faces) + len(lines) + len(points))
    return vertices, np.concatenate([faces, lines, points])[order]


# --- solids in and through each other


def nested() -> Shape:
    """Return closed bodies within closed bodies, all wound outwards."""
    return merged(
        shapes.icosphere(3, 1.0),
        shapes.icosphere(3, 0.8),
        sides((0.8, 0.8, 0.8), cells=8),
        shapes.icosphere(2, 0.3),
        sides((0.2, 0.2, 0.2), (0.05, 0, 0), cells=3),
    )


def pole() -> Shape:
    """Return a thin lamp pole of nested tubes, caps and a lamp that closely holds another."""
    parts = [rod((0, 0, -1.5), (0, 0, 1), r, n) for r, n in ((0.03, 24), (0.0295, 24), (0.02, 12))]
    parts += [moved(shapes.tube(0.031, 0.1, 24, 5), (0, 0, z)) for z in np.linspace(-1.4, 0.9, 12)]
    parts += [
        moved(shapes.icosphere(3, 0.2), (0, 0, 1.1)),
        moved(shapes.icosphere(3, 0.199), (0, 0, 1.1)),
        sides((0.3, 0.3, 0.02), (0, 0, -1.5), cells=5),
    ]
    return merged(*parts)


def interpenetrating() -> Shape:
    """Return solids pushed through each other."""
    rng = np.random.default_rng(9)
    boxes = [
        moved(
            sides(rng.uniform(0.2, 0.9, 3), cells=6),
            rng.uniform(-0.6, 0.6, 3),
            turned(rng.normal(size=3), rng.uniform(0, 180)),
        )
        for _ in range(6)
    ]
    return merged(shapes.torus(), *boxes, shapes.blob(rng))


# --- fine things


def pins() -> Shape:
    """Return a connector board: a plate with 20 by 20 pins, a fiftieth of the pitch apart."""
    at = np.linspace(-0.9, 0.9, 20)
    board = sides((2, 2, 0.05), (0, 0, -0.025), cells=12)
    return merged(board, *(sides((0.03, 0.03, 0.25), (x, y, 0.125)) for x in at for y in at))


def pyramids() -> Shape:
    """Return a plate with 40 by 40 small pyramids, some with gaps between."""
    at = np.linspace(-0.975, 0.975, 40)
    half, height = 0.024, 0.012
    corner = np.array([[-1, -1], [1, -1], [1, 1], [-1, 1]]) * half
    vertices = np.concatenate([np.c_[corner, np.zeros(4)], [[0, 0, height]]])
    faces = np.array([[k, (k + 1) % 4, 4] for k in range(4)], dtype=np.int32)
    many = [moved((vertices, faces), (x, y, 0)) for x in at for y in at]
    return merged(shapes.plate(2.0), *many, moved(flipped(shapes.plate(2.0)), (0, 0, -0.02)))


def gear() -> Shape:
    """Return a gear of many thin teeth with a hub and blades a thousandth thick."""
    teeth = 90
    angle = np.linspace(0, 2 * np.pi, 4 * teeth, endpoint=False)
    radius = np.tile([1.0, 1.0, 0.9, 0.9], teeth)
    rim = np.stack([radius * np.cos(angle), radius * np.sin(angle)], axis=1)
    n = len(rim)
    vertices = np.concatenate(
        [np.c_[rim, np.full(n, z)] for z in (-0.05, 0.05)] + [[[0, 0, -0.05], [0, 0, 0.05]]]
    )
    k, following = np.arange(n), (np.arange(n) + 1) % n
    faces = np.concatenate(
        [
            np.stack([k, following, following + n], 1),
            np.stack([k, following + n, k + n], 1),
            np.stack([following, k, np.full(n, 2 * n)], 1),
            np.stack([k + n, following + n, np.full(n, 2 * n + 1)], 1),
        ]
    )
    blades = [
        moved(
            moved(sides((0.5, 1e-3, 0.3), (0.5, 0, 0.2), cells=4)),
            (0, 0, 0),
            turned((0, 0, 1), 360 / 24 * k),
        )
        for k in range(24)
    ]
    return merged((vertices, faces.astype(np.int32)), rod((0, 0, 0), (0, 0, 0.4), 0.2, 40), *blades)


def lattice() -> Shape:
    """Return a lattice of thin rods that cross within each other."""
    at, rods = np.linspace(-0.6, 0.6, 5), []
    for a in at:
        for b in at:
            rods += [
                rod((a, b, -0.7), (a, b, 0.7), 0.008),
                rod((a, -0.7, b), (a, 0.7, b), 0.008),
                rod((-0.7, a, b), (0.7, a, b), 0.008),
            ]
    return merged(*rods)


def slivers() -> Shape:
    """Return faces ten thousand times as long as wide: a rod of 300 sides, strips, a thin ring."""
    thin = rod((-2, 0, 0), (2, 0, 0), 0.02, 300)
    strips = shapes.plate(2.0, 0.04, (0, 0.3, 0.1), 20, cells=(1, 200))
    u = np.linspace(0, 2 * np.pi, 241)[:-1]
    ring = np.concatenate(
        [np.stack([r * np.cos(u), r * np.sin(u), 0 * u], axis=1) for r in (0.5, 0.5 + 1e-4)]
    )
    k, following = np.arange(240), (np.arange(240) + 1) % 240
    faces = np.concatenate(
        [np.stack([k, k + 240, following + 240], 1), np.stack([k, following + 240, following], 1)]
    )
    return merged(thin, strips, moved((ring, faces.astype(np.int32)), (0, -0.3, 0.4)))


def fan() -> Shape:
    """Return a cone and a disc of 1,200 triangles around one vertex each."""
    n = 1200
    u = 2 * np.pi * np.arange(n) / n
    ring = np.stack([np.cos(u), np.sin(u), 0.05 * np.cos(40 * u)], axis=1)
    k, following = np.arange(n), (np.arange(n) + 1) % n
    vertices = np.concatenate([ring, [[0, 0, 0.8], [0, 0, -0.1]]])
    faces = np.concatenate(
        [np.stack([k, following, np.full(n, n)], 1), np.stack([following, k, np.full(n, n + 1)], 1)]
    )
    return vertices, faces.astype(np.int32)


def large_and_fine() -> Shape:
    """Return plates of two faces each with combs, beads and thin strips beside and before them."""
    beads = [shapes.icosphere(1, 0.02, (x, 0.2, 0.03)) for x in np.linspace(-0.9, 0.9, 20)]
    comb = [sides((0.01, 0.2, 0.01), (x, -0.4, 0.02)) for x in np.linspace(-0.9, 0.9, 60)]
    strips = [sides((1.8, 2e-3, 2e-3), (0, y, 0.3)) for y in np.linspace(-0.6, 0.6, 30)]
    return merged(
        shapes.plate(2.0, 1.6),
        moved(shapes.plate(2.0, 1.0), (0, 0.8, 0.5), turned((1, 0, 0), 90)),
        moved(shapes.plate(1.6, 1.0), (-1, 0, 0.5), turned((0, 1, 0), 90)),
        *beads,
        *comb,
        *strips,
    )


# --- large scenes, far scenes, broken numbers


def room() -> Shape:
    """Return a room seen from within, of twelve faces, with furniture of large ones."""
    table = [sides((1.0, 0.6, 0.03), (0.2, 0.1, -0.3), 4)]
    table += [
        sides((0.05, 0.05, 0.4), (0.2 + x, 0.1 + y, -0.52))
        for x in (-0.4, 0.4)
        for y in (-0.2, 0.2)
    ]
    shelves = [sides((0.3, 1.2, 0.01), (-1.1, 0, z), 3) for z in np.linspace(-0.6, 0.6, 7)]
    shelves.append(sides((0.01, 1.2, 1.4), (-1.25, 0, 0)))
    doors = [sides((0.4, 0.004, 0.9), (0.5 + 0.42 * k, 0.92, 0), cells=2) for k in range(2)]
    chairs = [
        two_sided(moved(sides((0.3, 0.3, 0.4), (0, 0, 0), 2, "+z"), (x, -0.6, -0.5)))
        for x in (-0.4, 0.0, 0.4, 0.8)
    ]
    lamps = [shapes.icosphere(2, 0.08, (x, 0.1, 0.5)) for x in (-0.2, 0.6)]
    return merged(flipped(sides((2.6, 2.0, 1.5))), *table, *shelves, *doors, *chairs, *lamps)


def terrain() -> Shape:
    """Return an open sheet of hills and ditches."""
    rng = np.random.default_rng(10)
    x, y = np.meshgrid(np.linspace(-1, 1, 71), np.linspace(-1, 1, 71))
    z = np.zeros_like(x)
    for frequency in (2, 4, 8, 16, 30):
        a, b, phase = rng.normal(size=3) * (frequency, frequency, 3)
        z += 0.4 / frequency * np.sin(a * x + b * y + phase)
    return height_field(z)


def far_away(shape: Shape, times: float) -> Shape:
    """Return a shape as far from the origin as ``times`` its size."""
    return moved(shape, times * np.array([1.0, -0.6, 0.4]))


def last_bits(single: bool) -> Shape:
    """Return a body whose faces share no vertex: copies differ in the last bits of a number."""
    shape = merged(shapes.blob(np.random.default_rng(11)), sides((0.5, 0.5, 2.4), cells=5))
    corners = shapes.corners(shape)
    kind = np.float32 if single else np.float64
    away = np.random.default_rng(12).choice([-np.inf, np.inf], size=corners.shape)
    corners = np.nextafter(corners.astype(kind), away.astype(kind)).astype(float)
    return corners.reshape(-1, 3), np.arange(corners.size // 3).reshape(-1, 3).astype(np.int32)


def soup() -> Shape:
    """Return separate triangles in no order, small and large."""
    rng = np.random.default_rng(13)
    return merged(shapes.soup(rng, 900, 0.1), shapes.soup(rng, 40, 0.6))


KINDS: dict[str, Callable[[], Shape]] = {
    "sheet box, wall 2e-2": lambda: sheet_box(2e-2),
    "sheet box, wall 1e-3": lambda: sheet_box(1e-3),
    "sheet box, wall 1e-4": lambda: sheet_box(1e-4),
    "open shell": open_shell,
    "open tubes": open_tubes,
    "chair, all faces twice": chair,
    "back to back, gap 1e-3": lambda: back_to_back(1e-3),
    "back to back, gap 1e-5": lambda: back_to_back(1e-5),
    "back to back, no gap": lambda: back_to_back(0.0),
    "laminate, gap 1e-4": lambda: laminate(1e-4),
    "laminate, gap 1e-5": lambda: moved(laminate(1e-5), (0, 0, 0), turned((2, 1, 3), 70)),
    "gaps of 1e-12": lambda: closed_gaps(1e-12),
    "blinds": blinds,
    "perforated sheet": perforated,
    "coincident": coincident,
    "overlapping": overlapping,
    "inside out": inside_out,
    "contradictory winding": contradictory,
    "patchwork of windings": patchwork,
    "Moebius strip": moebius,
    "faces of no area": degenerate,
    "nested": nested,
    "pole": pole,
    "interpenetrating": interpenetrating,
    "pins": pins,
    "pyramids": pyramids,
    "gear": gear,
    "slivers": slivers,
    "lattice": lattice,
    "fan": fan,
    "large and fine": large_and_fine,
    "room": room,
    "terrain": terrain,
    "far away, 1e3": lambda: far_away(merged(shapes.torus(), sheet_box(1e-2)), 1e3),
    "far away, 1e5": lambda: far_away(merged(shapes.torus(), sheet_box(1e-2)), 1e5),
    "last bits, double": lambda: last_bits(False),
    "last bits, single": lambda: last_bits(True),
    "soup": soup,
}

# Wound so that little is seen from without: poses from within of each sort that show enough.
FROM_WITHIN = {"inside out": 4, "patchwork of windings": 6, "room": 12}
# With gaps that float32 numbers close.
CLOSED_GAPS = ("gaps of 1e-12",)
