"""A whole mesh of every format, small, to be damaged."""

from __future__ import annotations

from pathlib import Path

import trimesh

from support import shapes

# by the suffix of what is written; a second one of a format stands as text
MESHES = (".stl", "-text.stl", ".obj", ".off", ".ply", "-text.ply", ".glb", ".3mf")


def write_mesh(path: Path) -> None:
    """Write a cube into a file; its suffix, and "-text" before it, say how."""
    vertices, faces = shapes.cube(1.0)
    mesh = trimesh.Trimesh(vertices, faces, process=False)
    is_text = path.stem.endswith("-text")
    if path.suffix == ".stl":
        mesh.export(path, file_type="stl_ascii" if is_text else "stl")
    elif path.suffix == ".ply":
        mesh.export(path, file_type="ply", encoding="ascii" if is_text else "binary")
    else:
        mesh.export(path)
