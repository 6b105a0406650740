#!/usr/bin/env python3
"""Make the meshes in ``scenes/`` from formulas, or check that they are what the formulas make.

Needs NumPy and nothing else; reads nothing, downloads nothing. Takes about a minute. The files
come out the same, bit for bit, on every machine (see ``tools/scenery/__init__.py``).

    tools/make_scenes.py                  # writes scenes/*.stl
    tools/make_scenes.py --check          # writes nothing, exit code 1 if a file differs
    tools/make_scenes.py arm1 kitchen     # only these
"""

from __future__ import annotations

import argparse
import sys
from pathlib import Path

import numpy as np
from scenery.arms import ARMS, make_arm, make_holder
from scenery.implicit import length
from scenery.kitchen import make_kitchen
from scenery.remesh import Edges, double_area_normals

SCENES = Path(__file__).resolve().parents[1] / "scenes"

MAKERS = {shape.name: (lambda shape=shape: make_arm(shape)) for shape in ARMS} | {
    "holder": make_holder,
    "kitchen": make_kitchen,
}


def stl_bytes(name: str, vertices: np.ndarray, faces: np.ndarray) -> bytes:
    """Return a binary STL of vertices (V, 3) and faces (F, 3) with normals from the winding."""
    corners = vertices.astype("<f4").astype(float)
    normals = double_area_normals(corners, faces)
    normals = normals / length(normals)[:, None]
    table = np.zeros(len(faces), dtype=[("normal", "<f4", 3), ("at", "<f4", (3, 3)), ("_", "<u2")])
    table["normal"] = normals + 0.0  # no negative zeros
    table["at"] = corners[faces] + 0.0
    header = f"{name}, millimetres, made by tools/make_scenes of glvis".encode().ljust(80)
    return header + np.array(len(faces), dtype="<u4").tobytes() + table.tobytes()


def figures(name: str, vertices: np.ndarray, faces: np.ndarray) -> str:
    """Return one line: faces, mean edge and its spread, area, open edges, bounds."""
    edges = Edges.of(faces)
    long = length(vertices[edges.ends[:, 0]] - vertices[edges.ends[:, 1]])
    area = length(double_area_normals(vertices, faces)).sum() / 2
    lower, upper = (np.round(f(axis=0)).astype(int).tolist() for f in (vertices.min, vertices.max))
    return (
        f"{name:8} {len(faces):5} faces, mean edge {long.mean():6.2f} mm, "
        f"std/mean {long.std() / long.mean():.2f}, {long.min():.1f}..{long.max():.1f} mm, "
        f"{area:.0f} mm2, {edges.is_open.sum()} open edges, {lower} to {upper}"
    )


def main() -> int:
    """Write or check the meshes that the command line names."""
    parser = argparse.ArgumentParser(description=__doc__.split("\n", maxsplit=1)[0])
    parser.add_argument("names", nargs="*", metavar="NAME", help=f"of {', '.join(MAKERS)}")
    parser.add_argument("--check", action="store_true", help="compare with scenes/, write nothing")
    arguments = parser.parse_args()
    unknown = [name for name in arguments.names if name not in MAKERS]
    if unknown:
        parser.error(f"no scene named {', '.join(unknown)}; there are {', '.join(MAKERS)}")
    different = []
    for name in arguments.names or MAKERS:
        mesh = MAKERS[name]()
        made, path = stl_bytes(name, *mesh), SCENES / f"{name}.stl"
        print(figures(name, *mesh), flush=True)
        if not arguments.check:
            path.write_bytes(made)
        elif not path.is_file() or path.read_bytes() != made:
            different.append(path.name)
    if different:
        print(f"not what the formulas make: {', '.join(different)}", file=sys.stderr)
    return 1 if different else 0


if __name__ == "__main__":
    sys.exit(main())
