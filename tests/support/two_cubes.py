"""A small study in files, for tests of what is done with one."""

from __future__ import annotations

from pathlib import Path

from support import shapes

# Two cubes, three sensors of two mounts, one variable; a few milliseconds an evaluation.
SMALL = """\
title = "Two cubes"
up = [0, 1, 0]

[scene]
models = ["cube.off", "small.off"]
max_edge = "off"

[sensor.eye]
hfov_deg = 60
vfov_deg = 42
resolution = [96, 64]
max_distance = 12

[[mount]]
name = "A"
sensor = "eye"
position = [{ min = 2, max = 6, start = 3 }, 3, 3]
aim = [0, 0, 0]
mirror = { plane = "yz", name = "B" }

[[mount]]
name = "C"
sensor = "eye"
position = [0, 0, 4]
direction = [0, 0, -1]
roll_deg = 30

[objective]
kind = "of3"
by_area = false

[search]
method = "swarm"

[swarm]
particles = 4
iterations = 2
"""


def write_two_cubes(folder: Path, text: str = SMALL) -> Path:
    """Write the study and its meshes into a folder; return the study's path."""
    shapes.write_off(folder / "cube.off", shapes.cube(1.0))
    shapes.write_off(folder / "small.off", shapes.cube(0.5, center=(0.1, 0, 0)))
    path = folder / "study.toml"
    path.write_text(text)
    return path
