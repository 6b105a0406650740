"""Calibrations of OpenCV, ROS and kalibr as they write them, and what is none in one line."""

import math
import os

import cv2
import numpy as np
import pytest
from support.damage import damaged_bytes, damaged_text
from support.two_cubes import SMALL, write_two_cubes

from glvis.cli.app import main
from glvis.problem.calibrated_lens import FisheyeLens, OpenCVLens
from glvis.problem.lens import Pinhole
from glvis.study.calibration_files import read_calibration
from glvis.study.sensor_table import SensorTable

MATRIX = np.array([[1402.125, 0, 961.25], [0, 1400.75, 541.5], [0, 0, 1]])
BENT = (-0.31, 0.11, 0.0004, -0.0002, 0.015)
LENS = OpenCVLens((1920, 1080), (1402.125, 1400.75), (961.25, 541.5), BENT)


def write_opencv(path, **values):
    """Write a file as OpenCV's FileStorage does."""
    storage = cv2.FileStorage(str(path), cv2.FILE_STORAGE_WRITE)
    for key, value in values.items():
        storage.write(key, value)
    storage.release()
    return path


SIZE = {"image_width": 1920, "image_height": 1080}
SAMPLE = SIZE | {
    "calibration_time": "Mon 01 Jan 2024 10:00:00",
    "board_width": 9,
    "camera_matrix": MATRIX,
    "distortion_coefficients": np.array(BENT)[:, None],
    "avg_reprojection_error": 0.21,
    "image_points": np.arange(40.0).reshape(2, 10, 2),  # with two channels
}


@pytest.mark.parametrize("suffix", ["yml", "yaml", "xml", "json"])
def test_what_opencv_writes_is_read_to_the_last_digit(tmp_path, suffix):
    path = write_opencv(tmp_path / f"cam.{suffix}", **SAMPLE)
    assert read_calibration(path) == ((1920, 1080), LENS)


def test_the_head_of_opencv_before_its_fifth_version_is_read(tmp_path):
    path = write_opencv(tmp_path / "cam.yml", **SAMPLE)
    _, _, rest = path.read_text().partition("\n")
    path.write_text(f"%YAML:1.0\n{rest}")
    assert read_calibration(path) == ((1920, 1080), LENS)


@pytest.mark.parametrize(
    ("matrix", "bent"),
    [("cameraMatrix", "distCoeffs"), ("K", "D"), ("M1", "D1"), ("camera_matrix", "dist_coeffs")],
)
def test_keys_have_the_names_that_people_give_them(tmp_path, matrix, bent):
    path = write_opencv(tmp_path / "cam.yml", **SIZE, **{matrix: MATRIX, bent: np.array([BENT])})
    assert read_calibration(path)[1] == LENS


def test_a_file_of_a_pair_has_two_cameras_and_the_study_knows_the_size(tmp_path):
    second = MATRIX * [[1, 1, 1], [1, 2, 1], [1, 1, 1]]
    bent = np.array([BENT])
    path = write_opencv(tmp_path / "pair.yml", M1=MATRIX, D1=bent, M2=second, D2=bent * 0)
    assert read_calibration(path, (1920, 1080))[1] == LENS
    lens = read_calibration(tmp_path / "pair.yml#2", (1920, 1080))[1]
    assert lens.focal_px == (1402.125, 2801.5)
    assert lens.coefficients == (0.0,) * 8
    with pytest.raises(ValueError, match="has no image_width and image_height; give resolution"):
        read_calibration(path)


def test_opencv_pads_a_rational_lens_with_zeros(tmp_path):
    eight = np.array([3.1, 2.3, 1e-4, 2e-4, 0.13, 3.4, 3.3, 0.66])
    path = write_opencv(
        tmp_path / "cam.yml", **SIZE, camera_matrix=MATRIX,
        distortion_coefficients=np.append(eight, np.zeros(6)),
    )  # fmt: skip
    assert read_calibration(path)[1].coefficients == tuple(eight)


def test_a_fisheye_is_one_where_the_file_or_the_study_says_so(tmp_path):
    four = np.array([0.02, -0.004, 0.0006, 0.0001])
    lens = FisheyeLens((1920, 1080), LENS.focal_px, LENS.centre_px, tuple(four))
    values = SIZE | {"camera_matrix": MATRIX, "distortion_coefficients": four}
    told = write_opencv(tmp_path / "told.yml", **values, fisheye_model=1)
    untold = write_opencv(tmp_path / "untold.yml", **values)
    assert read_calibration(told)[1] == lens
    assert read_calibration(untold, kind="fisheye")[1] == lens
    assert isinstance(read_calibration(untold)[1], OpenCVLens)
    with pytest.raises(ValueError, match="is of lens = 'fisheye', not 'opencv'"):
        read_calibration(told, kind="opencv")


def test_a_fisheye_without_distortion_stays_one(tmp_path):
    values = SIZE | {"camera_matrix": MATRIX, "distortion_coefficients": np.zeros(4)}
    path = write_opencv(tmp_path / "cam.yml", **values)
    assert isinstance(read_calibration(path, kind="fisheye")[1], FisheyeLens)


def test_a_centred_lens_without_distortion_is_the_ideal_pinhole(tmp_path):
    matrix = np.array([[960, 0, 959.5], [0, 540, 539.5], [0, 0, 1]])
    path = write_opencv(tmp_path / "cam.yml", **SIZE, camera_matrix=matrix, D=np.zeros(5))
    assert read_calibration(path)[1] == Pinhole.from_tangents(1.0, 1.0)


def in_opencvs_pixels(lens, size, points):
    """Return where points (N, 3) in OpenCV's frame fall, pixels (N, 2)."""
    u, v = lens.project(points[:, 0], -points[:, 1], points[:, 2])
    return np.stack([u * size[0] - 0.5, v * size[1] - 0.5], axis=1)


def test_a_file_from_opencvs_own_calibration_projects_as_opencv_does(tmp_path):
    """From pictures of a board, made by OpenCV, by its calibration and file, to our lens."""
    rng = np.random.default_rng(3)
    board = np.zeros((54, 1, 3), np.float32)
    board[:, 0, :2] = np.stack(np.meshgrid(np.arange(9), np.arange(6)), -1).reshape(-1, 2) * 25
    true = np.array([[800, 0, 630], [0, 805, 365], [0, 0, 1.0]])
    bent = np.array([-0.2, 0.05, 1e-3, 0])
    move = np.array([-100, -60, 350.0])
    turns = rng.uniform(-0.4, 0.4, (12, 3))
    images = [cv2.projectPoints(board, turn, move, true, bent)[0] for turn in turns]
    _, matrix, found, *_ = cv2.calibrateCamera(
        [board] * 12, [i.reshape(-1, 1, 2).astype(np.float32) for i in images], (1280, 720),
        None, None,
    )  # fmt: skip
    path = write_opencv(
        tmp_path / "cam.yml", image_width=1280, image_height=720, camera_matrix=matrix,
        distortion_coefficients=found,
    )  # fmt: skip
    size, lens = read_calibration(path)
    seen = rng.uniform([-0.5, -0.3, 1], [0.5, 0.3, 1.2], (100, 3))
    zero = np.zeros(3)
    theirs = cv2.projectPoints(seen[:, None], zero, zero, matrix, found)[0].reshape(-1, 2)
    assert np.abs(in_opencvs_pixels(lens, size, seen) - theirs).max() < 1e-3
    theirs = cv2.projectPoints(seen[:, None], zero, zero, true, bent)[0].reshape(-1, 2)
    assert np.abs(in_opencvs_pixels(lens, size, seen) - theirs).max() < 1  # it found the true one


ROS = """\
image_width: 640
image_height: 480
camera_name: narrow_stereo
camera_matrix:
  rows: 3
  cols: 3
  data: [541.25, 0.     , 322.5,
           0.   , 540.5 , 243.75,
           0.     ,   0.     ,   1.     ]
distortion_model: plumb_bob
distortion_coefficients:
  rows: 1
  cols: 5
  data: [-0.3068, 0.0825, 1e-05, -0.00016, 0.0]
rectification_matrix:
  rows: 3
  cols: 3
  data: [1, 0, 0, 0, 1, 0, 0, 0, 1]
projection_matrix:
  rows: 3
  cols: 4
  data: [480, 0, 322, 0, 0, 500, 245, 0, 0, 0, 1, 0]
"""
ROS_MESSAGE = """\
header:
  stamp: {sec: 1700000000, nanosec: 25}
  frame_id: camera_optical
height: 480
width: 640
distortion_model: equidistant
d: [0.0034, 7.1e-05, -0.0005, 0.0001]
k: [541.25, 0.0, 322.5, 0.0, 540.5, 243.75, 0.0, 0.0, 1.0]
r: [1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0]
p: [480.0, 0.0, 322.0, 0.0, 0.0, 500.0, 245.0, 0.0, 0.0, 0.0, 1.0, 0.0]
binning_x: 0
---
"""
KALIBR = """\
cam0:
  cam_overlaps: [1]
  camera_model: pinhole
  distortion_coeffs: [-0.28340811, 0.07395907, 0.00019359, 1.76187114e-05]
  distortion_model: radtan
  intrinsics: [458.654, 457.296, 367.215, 248.375]
  resolution: [752, 480]
  rostopic: /cam0/image_raw
cam1:
  T_cn_cnm1:
  - [0.99999, 0.002, 0.0003, -0.11]
  - [-0.002, 0.99999, 0.014, 0.0004]
  - [0.0003, -0.014, 0.9999, 0.0001]
  - [0.0, 0.0, 0.0, 1.0]
  cam_overlaps: [0]
  camera_model: pinhole
  distortion_coeffs: [-0.0034, 7.0e-04, -0.0005, 0.0001]
  distortion_model: equidistant
  intrinsics: [457.587, 456.134, 379.999, 255.238]
  resolution: [752, 480]
  rostopic: /cam1/image_raw
cam2:
  camera_model: pinhole
  distortion_coeffs: []
  distortion_model: none
  intrinsics: [376.0, 240.0, 375.5, 239.5]
  resolution: [752, 480]
"""


@pytest.fixture
def read(tmp_path):
    """Return what reads a text as the file of some name."""

    def read_text(text, camera="", size=None, kind=None):
        (tmp_path / "cam.yaml").write_text(text)
        return read_calibration(tmp_path / f"cam.yaml{camera}", size, kind)

    return read_text


def test_what_ros_writes_is_read(read):
    lens = OpenCVLens(
        (640, 480), (541.25, 540.5), (322.5, 243.75), (-0.3068, 0.0825, 1e-05, -0.00016, 0.0)
    )
    assert read(ROS) == ((640, 480), lens)


def test_a_message_of_ros_is_read(read):
    lens = FisheyeLens(
        (640, 480), (541.25, 540.5), (322.5, 243.75), (0.0034, 7.1e-05, -0.0005, 0.0001)
    )
    assert read(ROS_MESSAGE.removesuffix("---\n"))[1] == lens
    assert read(ROS_MESSAGE)[1] == lens  # as ros2 topic echo ends it


def test_a_rational_model_of_ros_has_eight_numbers(read):
    eight = "[3.1, 2.3, 1e-4, 2e-4, 0.13, 3.4, 3.3, 0.66]"
    text = ROS.replace("plumb_bob", "rational_polynomial")
    text = text.replace("[-0.3068, 0.0825, 1e-05, -0.00016, 0.0]", eight)
    assert read(text)[1].coefficients == (3.1, 2.3, 1e-4, 2e-4, 0.13, 3.4, 3.3, 0.66)


def test_what_kalibr_writes_is_read_the_first_camera_unless_another_is_named(read):
    first = OpenCVLens(
        (752, 480), (458.654, 457.296), (367.215, 248.375),
        (-0.28340811, 0.07395907, 0.00019359, 1.76187114e-05),
    )  # fmt: skip
    second = FisheyeLens(
        (752, 480), (457.587, 456.134), (379.999, 255.238), (-0.0034, 7.0e-04, -0.0005, 0.0001)
    )
    assert read(KALIBR) == read(KALIBR, "#cam0") == ((752, 480), first)
    assert read(KALIBR, "#cam1")[1] == second
    assert read(KALIBR, "#cam2")[1] == Pinhole.from_tangents(1.0, 1.0)


def test_a_file_may_have_the_mark_of_a_camera_in_its_name(tmp_path):
    path = tmp_path / "rig#2.yaml"
    path.write_text(ROS)
    assert read_calibration(path)[0] == (640, 480)


def changed(text, old, new):
    assert old in text
    return text.replace(old, new, 1)


MODEL = "distortion_model: plumb_bob"
WRONG = {
    "unknown model": (changed(ROS, "plumb_bob", "thin_prism"), "",
        "distortion_model = 'thin_prism' is unknown; known are plumb_bob, rational_poly"),
    "model misspelt": (changed(ROS, "plumb_bob", "plum_bob"), "",
        "distortion_model = 'plum_bob' is unknown; did you mean 'plumb_bob'?"),
    "model of a list": (changed(ROS, "plumb_bob", "[1, 2]"), "", "distortion_model = ['1', '2'] i"),
    "no matrix": (changed(ROS, "camera_matrix", "camera_matricks"), "",
        "has no camera matrix; it may be called camera_matrix, cameraMatrix, K or M1, or be"),
    "no distortion": (changed(ROS, "distortion_coefficients", "bent"), "",
        "has no distortion; it may be called distortion_coefficients, distCoeffs or D, and be []"),
    "no data": (changed(ROS, "  data: [541.25", "  dato: [541.25"), "",
        "camera_matrix: 'data' is missing"),
    "eight numbers": (changed(ROS, "541.25, 0.     ,", "541.25,"), "",
        "camera_matrix has 8 numbers, it must have 9"),
    "three coefficients": (changed(ROS, ", -0.00016, 0.0]", "]"), "",
        "distortion_coefficients has 3 numbers, it must have 4 or 5"),
    "five of a fisheye": (changed(ROS, "plumb_bob", "equidistant"), "",
        "distortion_coefficients has 5 numbers, it must have 4"),
    "NaN": (changed(ROS, "541.25", ".nan"), "", "camera_matrix has '.nan', it must be numbers"),
    "nan": (changed(ROS, "541.25", "nan"), "", "camera_matrix has 'nan', it must be numbers"),
    "infinite": (changed(ROS, "541.25", "1e999"), "", "camera_matrix has '1e999', it must be"),
    "a word": (changed(ROS, "541.25", "wide"), "", "camera_matrix has 'wide', it must be numbers"),
    "a table": (changed(ROS, "541.25", "{a: 1}"), "", "camera_matrix has { a = '1' }, it must"),
    "behind": (changed(ROS, "541.25", "-541.25"), "",
        "has focal lengths [-541.25, 540.5] that must be above 0 pixels"),
    "skew": (changed(ROS, "541.25, 0. ", "541.25, 5. "), "",
        "camera_matrix = [541.25, 5.0, 322.5, 0.0, 540.5, 243.75, 0.0, 0.0, 1.0] must be [fx, 0, "),
    "negative size": (changed(ROS, "width: 640", "width: -640"), "",
        "image_width = -640 must be whole pixels from 1 to 16384"),
    "no whole size": (changed(ROS, "width: 640", "width: 640.5"), "", "image_width = 640.5 must b"),
    "endless size": (changed(ROS, "width: 640", f"width: {'9' * 5000}"), "",
        "image_width has '99999"),
    "bent beyond use": (changed(ROS, "-0.3068", "-3000"), "",
        "the middle of the image has no ray: focal_px, centre_px, distortion and max_angle_deg a"),
    "no such camera": (KALIBR, "#cam7",
        "has no camera 'cam7'; it has cam0, cam1, cam2, of which 'FILE#cam0' is one"),
    "omnidirectional": (changed(KALIBR, "camera_model: pinhole", "camera_model: omni"), "",
        "cam0: camera_model = 'omni' must be 'pinhole', glvis has no other"),
    "field of view model": (changed(KALIBR, "radtan", "fov"), "",
        "cam0: distortion_model = 'fov' is unknown; known are plumb_bob,"),
    "no intrinsics": (changed(KALIBR, "intrinsics", "intrinsic"), "",
        "cam0: 'intrinsics' is missing"),
    "three intrinsics": (changed(KALIBR, "[458.654, ", "["), "",
        "cam0: intrinsics has 3 numbers, it must have 4"),
    "three of resolution": (changed(KALIBR, "[752, 480]", "[752, 480, 3]"), "",
        "cam0: resolution has 3 numbers, it must have 2"),
    "no model": (changed(KALIBR, "distortion_model: radtan", ""), "",
        "cam0: 'distortion_model' is missing"),
    "empty": ("", "", "is no calibration: it has no keys"),
    "a list": ("[1, 2]", "", "is no calibration: it has no keys"),
    "a text": ("once upon a time", "", "is no calibration: it has no keys"),
    "no YAML": ("a: [1, 2", "", "is no YAML or XML in line 1: expected ',' or ']'"),
    "controls": ("a: \x01\x02", "", "is no YAML or XML: unacceptable character #x0001"),
    "no XML": ("<opencv_storage><a>", "", "is no YAML or XML"),
    "deep": ("a: " + "[" * 20_000, "", "is no calibration: nested too deeply"),
    "deep XML": ("<a>" * 200 + "</a>" * 200, "", "is no calibration: nested too deeply"),
    "deeper XML": ("<a>" * 20_000, "", "is no YAML or XML"),
    "many values": ("a: [" + "1," * 60_000 + "]", "",
        "is no calibration: it has more than 50,000 values"),
    "laughter": ("a: &a [1]\nb: &b [*a, *a]\n", "", "has an alias, *a; write out what it means"),
    "laughter in XML": ('<!DOCTYPE a [<!ENTITY b "b"><!ENTITY c "&b;&b;">]><a>&c;</a>', "",
        "is no calibration: it has no keys"),
    "an object": ("!!python/object/apply:os.system ['true']", "", "is no calibration: it has no"),
    "a key of a list": ("? [1]\n: 2\n", "", "is no YAML or XML in line 1: found unhashable key"),
}  # fmt: skip


@pytest.mark.parametrize("kind", WRONG)
def test_what_is_wrong_is_one_line_with_the_file(tmp_path, read, kind):
    text, camera, fact = WRONG[kind]
    with pytest.raises(ValueError) as caught:
        read(text, camera)
    assert str(caught.value).startswith(f"{tmp_path / 'cam.yaml'}: {fact}")
    assert "\n" not in str(caught.value)


def test_files_that_are_none_are_one_line(tmp_path):
    binary = tmp_path / "binary.yml"
    binary.write_bytes(b"\xff\xfe\x00" * 100)
    huge = tmp_path / "huge.yml"
    huge.write_text("# " + "x" * 1_100_000)
    os.mkfifo(tmp_path / "pipe.yml")
    for name, fact in {
        "gone.yml": "does not exist",
        "binary.yml": "is no text in UTF-8 (byte 0)",
        "huge.yml": "is larger than 1 MB, the most that is read",
        "pipe.yml": "is no plain file but a pipe, a socket or a device",
        ".": "cannot be read: Is a directory",
    }.items():
        with pytest.raises(ValueError) as caught:
            read_calibration(tmp_path / name)
        assert str(caught.value) == f"{tmp_path / name}: {fact}"
    with pytest.raises(ValueError, match="File name too long"):
        read_calibration(tmp_path / ("x" * 300 + "#cam0"))


def test_a_lens_of_another_kind_beside_a_file_is_refused(read):
    with pytest.raises(ValueError, match="read with lens = 'opencv' or 'fisheye', not 'spherical'"):
        read(ROS, kind="spherical")
    with pytest.raises(ValueError, match="is of lens = 'opencv', not 'fisheye'"):
        read(ROS, kind="fisheye")


@pytest.mark.parametrize(
    ("keys", "fact"),
    [
        ("", "CAM: distortion_model = 'x' is unknown; known are plumb_bob, rational_polynomial"),
        ("focal_px = [5, 5]", "focal_px: goes without calibration, whose file has the lens"),
    ],
)
def test_a_study_says_which_sensor_and_which_file(tmp_path, capsys, keys, fact):
    cam = tmp_path / "cam.yaml"
    cam.write_text(changed(ROS, "plumb_bob", "x"))
    sensor = f"[sensor.new]\ncalibration = 'cam.yaml'\nmax_distance = 9\n{keys}\n\n[[mount]]"
    path = write_two_cubes(tmp_path, SMALL.replace("[[mount]]", sensor, 1))
    assert main(["check", str(path)]) == 2
    (line,) = capsys.readouterr().err.splitlines()
    place = "" if keys else "calibration: "
    assert line.startswith(f"error: {path}: [sensor.new] {place}{fact.replace('CAM', str(cam))}")


def test_a_study_reads_a_calibration_with_fewer_pixels_and_within_a_cone(tmp_path):
    (tmp_path / "cam.yaml").write_text(ROS)
    table = SensorTable.model_validate(
        {"calibration": "cam.yaml", "resolution": [320, 240], "max_angle_deg": 30.0,
         "max_distance": 9.0}
    )  # fmt: skip
    sensor = table.to_sensor("cam", "mm", tmp_path)
    whole = read_calibration(tmp_path / "cam.yaml")[1]
    assert sensor.resolution == sensor.lens.size == (320, 240)
    assert sensor.lens.focal == pytest.approx(whole.focal)
    assert sensor.lens.max_angle == math.radians(30)


@pytest.mark.parametrize("seed", range(150))
def test_damaged_files_are_read_or_are_one_line(tmp_path, seed):
    rng = np.random.default_rng(seed)
    whole = tmp_path / f"cam.{['yml', 'xml', 'json'][seed % 3]}"
    if seed % 2:
        write_opencv(whole, **SAMPLE)
    else:
        whole.write_text(ROS if seed % 4 else KALIBR)
    damage = damaged_text if rng.random() < 0.5 else damaged_bytes
    whole.write_bytes(damage(whole.read_bytes(), rng))
    try:
        size, lens = read_calibration(whole)
    except ValueError as error:
        assert str(error).startswith(f"{whole}: ")
        assert "\n" not in str(error)
        assert len(str(error)) < 500
    else:
        assert lens.windows.tan_half.all()
        assert min(size) >= 1
