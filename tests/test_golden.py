"""Golden pictures: what only the eye can judge, frozen once it has been judged.

A torus over a grey pad, seen by three cameras A, B and C. To be seen in each:

- scene: the torus alone in the colours of the cameras, what none sees red and striped; beside it
  three camera bodies in blue, orange and green, each with its name, an axis that ends at what it
  aims at and the beginning of a frustum; a legend with shares, axes with letters, a scale bar.
- sides: top, front and right with the cameras, and the torus alone from behind.
- overlap: the same from no camera (striped) over one (yellow) to three (teal).
- unseen: the torus in light grey from where most of the red and striped shows, the pad as faint as
  glass, a number with a dot at each large gap and its share in the note.
- incidence: two views of the torus alone, bright where it is seen squarely, and a colour bar.
- pixel-size: two views of the torus alone, bright where a pixel is small, a colour bar in mm.
- interference: the torus in grey where no camera's light reaches it, blue where one does, orange
  and darker where two and three do, and the cameras with their frusta.
- through: what camera A sees in blue, what it refuses in light grey, the pad in dark grey.
- depth: the same from light (near) to dark (far), with a colour bar in mm.
- contact: the views of all three cameras, each in a frame of its colour.

Of other lenses and of pairs, in the same three poses:

- pair: at A a second, smaller body in a darker blue at the end of a line, both fields as far as the
  ring or nearly, the second's in broken lines, and a strong blue border of what both see; at B the
  two thin rings of a lidar about an orange body, at C the round rim of a fisheye.
- fisheye: the ring small in the middle of a white circle in dark grey corners, and a legend that
  says that the lens ends there.
- lidar: a band all the width of the sheet with the ring in the middle, cut off below, light (near)
  to dark (far); under it a colour bar and, beside that, three greys.

Drivers differ in pixels, so pictures are compared on Mesa's llvmpipe only, and loosely: fonts and
rounding may differ. Renew them by ``pytest tests/test_golden.py --update-golden``.
"""

import math
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from PIL import Image
from support import torus_scene

from glvis.evaluation.evaluator import Evaluator
from glvis.evaluation.interference import find_interference
from glvis.pictures.coloring import coloring
from glvis.pictures.qualitycolors import interference_coloring, quality_coloring
from glvis.pictures.scenesheets import close_sheet, perspective_sheet, sides_sheet, unseen_sheet
from glvis.pictures.sensorsheets import contact_sheet, depth_sheet, sensor_sheet
from glvis.pictures.stage import Stage
from glvis.problem.calibrated_lens import FisheyeLens
from glvis.problem.lens import SphericalLens
from glvis.problem.sensor import Partner
from glvis.visibility.context import gl_info

GOLDEN = Path(__file__).parent / "golden"
SIZE = (480, 300)
VISIBLE = 48  # difference of a channel, of 255, that the eye takes note of
ALLOWED = 0.006  # share of the pixels that may differ so much: a shifted letter, no more


def painted_by(sheet, color):
    def make(stage):
        colors = color(stage)
        stage.paint(colors.colors)
        return sheet(stage, colors, SIZE)

    return make


def painted(sheet, kind):
    return painted_by(sheet, lambda stage: coloring(kind, stage.seen))


def lit(stage):
    sensors = tuple(replace(sensor, emits="infrared") for sensor in stage.study.sensors)
    found = find_interference(replace(stage.study, sensors=sensors), stage.poses)
    return interference_coloring(stage.seen, found, 0)


PICTURES = {
    "scene": painted(perspective_sheet, "sensor"),
    "sides": painted(sides_sheet, "sensor"),
    "overlap": painted(perspective_sheet, "overlap"),
    "unseen": painted(unseen_sheet, "unseen"),
    "incidence": painted(close_sheet, "incidence"),
    "pixel-size": painted_by(close_sheet, lambda stage: quality_coloring("pixel-size", stage.seen)),
    "interference": painted_by(perspective_sheet, lit),
    "through": lambda stage: sensor_sheet(stage, 0, SIZE),
    "depth": lambda stage: depth_sheet(stage, 0, SIZE),
    "contact": lambda stage: contact_sheet(stage, SIZE),
}


PICTURES_OF_LENSES = {
    "pair": painted(perspective_sheet, "sensor"),
    "fisheye": lambda stage: sensor_sheet(stage, 2, SIZE),
    "lidar": lambda stage: depth_sheet(stage, 1, SIZE),
}


@pytest.fixture(scope="module")
def study_and_map(tmp_path_factory):
    study = torus_scene.ring_study(tmp_path_factory.mktemp("golden"))
    with Evaluator(study) as evaluator:
        (seen,) = evaluator.visibility(np.zeros(0))
    return study, seen


@pytest.fixture(scope="module")
def stage(study_and_map):
    study, seen = study_and_map
    with Stage(study, torus_scene.start_poses(study)) as stage:
        stage.show(0, seen)
        yield stage


@pytest.fixture(scope="module")
def stage_of_lenses(study_and_map):
    """A pair, a lidar and a fisheye where the cameras stood, with the cameras' map."""
    study, seen = study_and_map
    cam = study.sensors[0]
    end = math.radians(95)
    sensors = (
        replace(cam, partner=Partner((90, 0, 0), cam.lens, role="projector")),
        replace(
            cam,
            lens=SphericalLens(2 * math.pi, (-0.26, 0.26)),
            resolution=(1800, 16),
            distance="range",
        ),
        replace(
            cam,
            lens=FisheyeLens((400, 400), (110, 110), (199.5, 199.5), (), end),
            resolution=(400, 400),
        ),
    )
    with Stage(replace(study, sensors=sensors), torus_scene.start_poses(study)) as stage:
        stage.show(0, seen)
        yield stage


@pytest.mark.parametrize("name", PICTURES)
def test_picture_is_as_it_was_judged(name, stage, request, tmp_path):
    assert_as_judged(PICTURES[name](stage).pixels(), name, request, tmp_path)


@pytest.mark.parametrize("name", PICTURES_OF_LENSES)
def test_picture_of_a_lens_is_as_it_was_judged(name, stage_of_lenses, request, tmp_path):
    made = PICTURES_OF_LENSES[name](stage_of_lenses).pixels()
    assert_as_judged(made, name, request, tmp_path)


def assert_as_judged(picture, name, request, tmp_path):
    path = GOLDEN / f"{name}.png"
    if request.config.getoption("--update-golden"):
        GOLDEN.mkdir(exist_ok=True)
        Image.fromarray(picture).save(path, optimize=True)
        pytest.skip(f"{path} was written anew: look at it before it is committed")
    if "llvmpipe" not in gl_info().renderer:
        pytest.skip(
            f"golden pictures are compared on llvmpipe only, this is {gl_info().renderer}; "
            "LIBGL_ALWAYS_SOFTWARE=1 chooses it where Mesa is the driver"
        )
    golden = np.array(Image.open(path).convert("RGB"))
    assert picture.shape == golden.shape
    difference = np.abs(picture.astype(int) - golden).max(axis=2)
    differs = np.mean(difference > VISIBLE)
    if differs > ALLOWED:
        magnified = np.clip(255 - 4 * difference, 0, 255).astype(np.uint8)
        columns = [picture, golden, np.repeat(magnified[..., None], 3, axis=2)]
        side_by_side = tmp_path / f"{name}-new-golden-difference.png"
        Image.fromarray(np.hstack(columns)).save(side_by_side)
        pytest.fail(
            f"{100 * differs:.2f} % of the pixels differ from {path}; new, golden and "
            f"difference: {side_by_side}; if it is right, --update-golden"
        )
