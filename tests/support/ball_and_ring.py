"""Small studies on disk: shapes written as OFF files, and a study file beside them."""

from __future__ import annotations

from pathlib import Path

from support.shapes import blob, cube, icosphere, torus, write_off

# One free sensor that circles a dented ball at its own height, one that only turns.
SMALL = """
title = "Small"
up = [0, 0, 1]

[scene]
models = ["ball.off", "ring.off"]
max_edge = "off"
obstacles = ["post.off"]

[sensor.eye]
hfov_deg = 50
vfov_deg = 40
resolution = [64, 48]
min_distance = 0.5
max_distance = 9
max_incidence_deg = 75

[visibility]
resolution = "sensor"

[variables]
turn = { min = 0, max = 360, start = 10, periodic = true }
height = { min = -2, max = 2, start = 1 }
azimuth = { min = 40, max = 140, start = 60 }
elevation = { min = -40, max = 40, start = 20 }

[[mount]]
name = "A"
sensor = "eye"
ring = { axis = "z", radius = 4, angle_deg = "turn", height = "height" }
aim = [0, 0, 0]

[[mount]]
name = "B"
sensor = "eye"
position = [0, -4, 0]
direction = { azimuth_deg = "azimuth", elevation_deg = "elevation" }

[objective]
kind = "of3"
by_area = false

[search]
method = "swarm"

[swarm]
particles = 6
iterations = 4
seed = 3
initial = "uniform"
"""


def write_ball_and_ring(folder: Path, rng, text: str = SMALL) -> Path:
    """Write the small study and its meshes into a folder; return the study's path."""
    write_off(folder / "ball.off", blob(rng, subdivisions=2))
    write_off(folder / "ring.off", torus(nu=16, nv=8))
    write_off(folder / "post.off", cube(0.4, center=(0, -2, 0.5)))
    write_off(folder / "tiny.off", icosphere(1))
    path = folder / "small.toml"
    path.write_text(text)
    return path
