"""Lenses that will disappoint are told in a sentence, once a sensor, and others are not."""

import pytest
from support.two_cubes import SMALL, write_two_cubes

from glvis.evaluation.checks import study_warnings
from glvis.evaluation.lens_checks import lens_warnings
from glvis.study.loading import load_study

CCTV = "lens = 'opencv'\nfocal_px = [533.6, 533.6]\ndistortion = [-0.02, -0.0025, 0, 0]\n"
ROUND = "lens = 'fisheye'\nfocal_px = [300, 300]\n"


@pytest.fixture
def warnings(tmp_path):
    """Return what gives the sentences about a sensor of some keys."""

    def of(keys: str, resolution: str = "[1920, 1080]") -> list[str]:
        head, _, rest = SMALL.partition("[sensor.eye]")
        mounts = rest[rest.index("[[mount]]") :]
        table = f"[sensor.eye]\n{keys}\nresolution = {resolution}\nmax_distance = 12\n"
        study = load_study(write_two_cubes(tmp_path, f"{head}{table}\n{mounts}"))
        return list(lens_warnings(study))

    return of


def test_a_lens_that_folds_inside_its_image_is_told_with_the_share_of_its_pixels(warnings):
    (line,) = warnings(CCTV)  # once, though three sensors have it
    assert line.startswith(
        "eye: the lens ends inside its own image, 69.1 deg from its axis, where its distortion "
        "stops growing: "
    )
    share = float(line.split("growing: ")[1].split(" %")[0])
    assert 0 < share < 2  # the very corners: 1.95 of 2.06 focal lengths
    (line,) = warnings(
        "lens = 'fisheye'\nfocal_px = [138.1, 138.1]\ndistortion = [0.155, -0.155, 0.108, -0.045]",
        "[464, 400]",
    )
    # a circle of 1.27 focal lengths in 464 x 400, which it leaves above and at the sides
    share = float(line.split("growing: ")[1].split(" %")[0])
    assert 100 - share == pytest.approx(100 * 3.1416 * (1.27 * 138.1) ** 2 / (464 * 400), abs=1)


def test_what_is_meant_or_whole_is_not_told(warnings):
    assert warnings(f"{CCTV}max_angle_deg = 60") == []
    assert (
        warnings("lens = 'opencv'\nfocal_px = [1400, 1400]\ndistortion = [-0.3, 0.1, 0, 0]") == []
    )
    assert warnings("hfov_deg = 60\nvfov_deg = 40") == []


def test_a_partners_lens_is_told_as_well(warnings):
    own = "partner = { offset = [1, 0, 0], lens = 'opencv', focal_px = [533.6, 533.6], "
    (line,) = warnings(f"hfov_deg = 60\nvfov_deg = 40\n{own}distortion = [-0.02, -0.0025, 0, 0] }}")
    assert line.startswith("eye, partner: the lens ends inside its own image")


def test_a_field_beyond_180_degrees_wants_a_range(warnings):
    (line,) = warnings(f"{ROUND}max_angle_deg = 100")
    assert line.startswith("eye: sees more than 180 degrees, and what lies beside or behind it")
    assert line.endswith("set distance = 'range'")
    assert warnings(f"{ROUND}max_angle_deg = 100\ndistance = 'range'") == []
    assert warnings(f"{ROUND}max_angle_deg = 80") == []


def test_a_lidar_that_measures_depth_is_told(warnings):
    lidar = "lens = 'spherical'\nazimuth_deg = {}\nelevation_deg = [-15, 15]\ndistance = 'depth'"
    assert len(warnings(lidar.format(360), "[900, 16]")) == 1
    assert warnings(lidar.format(120), "[900, 16]") == []


def test_the_check_of_a_study_tells_it(tmp_path):
    plain = "hfov_deg = 60\nvfov_deg = 42\nresolution = [96, 64]"
    assert plain in SMALL
    text = SMALL.replace(plain, f"{CCTV}resolution = [1920, 1080]")
    found = study_warnings(load_study(write_two_cubes(tmp_path, text)))
    assert sum("ends inside its own image" in line for line in found) == 1
