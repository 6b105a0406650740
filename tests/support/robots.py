"""A robot arm of links made by formula, each a closed mesh, all in one frame; lengths in metres."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np

from support.shapes import Shape, moved, write_off


def rod(start, end, radius: float, sides: int = 16) -> Shape:
    """Return a closed rod of a regular polygon from one point to another, normals outward."""
    a, b = np.asarray(start, dtype=float), np.asarray(end, dtype=float)
    axis = (b - a) / np.linalg.norm(b - a)
    u = np.cross(axis, [1.0, 0, 0] if abs(axis[0]) < 0.9 else [0, 1.0, 0])
    u /= np.linalg.norm(u)
    v = np.cross(axis, u)
    angle = 2 * math.pi * np.arange(sides) / sides
    ring = radius * (np.cos(angle)[:, None] * u + np.sin(angle)[:, None] * v)
    vertices = np.concatenate([a + ring, b + ring, [a, b]])
    i = np.arange(sides)
    j = (i + 1) % sides
    faces = [
        np.stack([i, j, sides + j], axis=1),
        np.stack([i, sides + j, sides + i], axis=1),
        np.stack([j, i, np.full(sides, 2 * sides)], axis=1),
        np.stack([sides + i, sides + j, np.full(sides, 2 * sides + 1)], axis=1),
    ]
    return moved((vertices, np.concatenate(faces)))


LINKS = {
    "base": rod((0, 0, 0), (0, 0, 0.1), 0.09),
    "column": rod((0, 0, 0.11), (0, 0, 0.35), 0.06),
    "upper": rod((0, 0.08, 0.3), (0.35, 0.08, 0.62), 0.05),
    "fore": rod((0.36, 0.0, 0.6), (0.7, 0.0, 0.42), 0.04),
    "wrist": rod((0.7, 0.05, 0.4), (0.7, 0.05, 0.28), 0.035),
    "tool": rod((0.7, 0.05, 0.27), (0.7, 0.05, 0.2), 0.02),
}


def write_links(folder: Path) -> list[Path]:
    """Write the links as OFF files; return their paths."""
    return [write_off(folder / f"{name}.off", shape) for name, shape in LINKS.items()]
