"""A small scene for pictures: a torus, a pad beneath it, three cameras around."""

import numpy as np

from glvis.problem.study import Study
from glvis.study.loading import load_study
from support.shapes import cube, moved, torus, write_off

STUDY = """
title = "Torus, three cameras"
[scene]
models = ["ring.off"]
max_edge = "off"
obstacles = ["pad.off"]
[sensor.cam]
hfov_deg = 50
vfov_deg = 38
resolution = [320, 240]
min_distance = 100
max_distance = 420
max_incidence_deg = 75
[[mount]]
name = "A"
sensor = "cam"
position = [260, -180, 160]
direction = [-260, 180, -150]
[[mount]]
name = "B"
sensor = "cam"
position = [-300, -60, 120]
direction = [300, 60, -110]
[[mount]]
name = "C"
sensor = "cam"
position = [40, 290, 200]
direction = [-40, -290, -190]
roll_deg = 20
"""


def ring_study(folder, text=STUDY) -> Study:
    """Write the scene's files into a folder and return the study."""
    write_off(folder / "ring.off", torus(80.0, 28.0, 48, 24))
    pad = cube(1.0)
    write_off(folder / "pad.off", moved((pad[0] * [140, 140, 20], pad[1]), (0, 0, -50)))
    (folder / "ring.toml").write_text(text)
    return load_study(folder / "ring.toml")


def start_poses(study: Study) -> np.ndarray:
    """Return the poses (S, 4, 4) of a study without variables."""
    return study.rig.poses(np.zeros((1, 0)))[0]
