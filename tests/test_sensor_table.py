"""The words of a study for sensors: what each means, what goes with what, and the way back."""

import dataclasses
import math
import tomllib

import cv2
import numpy as np
import pytest
from support.two_cubes import SMALL, write_two_cubes

from glvis.errors import StudyError
from glvis.problem.calibrated_lens import FisheyeLens, OpenCVLens
from glvis.problem.catalogue import entries
from glvis.problem.lens import Pinhole, SphericalLens
from glvis.problem.sensor import Focus, Noise, Partner, Sensor
from glvis.study.catalogue_sensors import catalogue, find_sensor
from glvis.study.lengths import with_plain_lengths
from glvis.study.loading import load_study
from glvis.study.overrides import toml_text
from glvis.study.sensor_table import SensorTable, sensor_table

REST = "resolution = [640, 480]\nmax_distance = 9\n"


def sensor_of(text: str, unit: str = "mm") -> Sensor:
    """Return the sensor that the keys of a table mean."""
    data = with_plain_lengths({"unit": unit, "sensor": {"cam": tomllib.loads(text)}})
    return SensorTable.model_validate(data["sensor"]["cam"]).to_sensor("cam", unit)


def again(sensor: Sensor) -> Sensor:
    """Return a sensor written as TOML and read again."""
    text = "".join(f"{key} = {toml_text(value)}\n" for key, value in sensor_table(sensor).items())
    return SensorTable.model_validate(tomllib.loads(text)).to_sensor(sensor.name)


# --- what the keys mean


def test_centred_focal_lengths_are_a_pinhole():
    lens = sensor_of(f"focal_px = [320, 480]\n{REST}").lens
    assert lens == Pinhole.from_tangents(1.0, 0.5)
    assert lens == sensor_of(f"focal_px = [320, 480]\ncentre_px = [319.5, 239.5]\n{REST}").lens


def test_a_pinhole_off_its_centre_is_opencvs_without_distortion():
    lens = sensor_of(f"focal_px = [320, 320]\ncentre_px = [300, 239.5]\n{REST}").lens
    assert lens == OpenCVLens((640, 480), (320, 320), (300, 239.5), ())
    # the axis falls onto the centre, a pixel centre has a whole number
    assert lens.project(0, 0, 1)[0] * 640 - 0.5 == pytest.approx(300)


def test_distortion_is_in_opencvs_order():
    lens = sensor_of(
        f"lens = 'opencv'\nfocal_px = [5, 5]\ndistortion = [1, 2, 3, 4, 5]\n{REST}"
    ).lens
    assert lens.coefficients == (1, 2, 3, 4, 5, 0, 0, 0)
    assert lens.centre_px == (319.5, 239.5)
    assert lens.size == (640, 480)


def test_a_fisheye_without_distortion_is_equidistant():
    lens = sensor_of(f"lens = 'fisheye'\nfocal_px = [100, 100]\nmax_angle_deg = 95\n{REST}").lens
    assert isinstance(lens, FisheyeLens)
    assert lens.max_angle == math.radians(95)
    u, _ = lens.project(math.sin(1.0), 0, math.cos(1.0))
    assert u * 640 - 0.5 - 319.5 == pytest.approx(100 * 1.0)


def test_a_cone_may_bound_a_pinhole():
    for keys in ("focal_px = [320, 240]", "hfov_deg = 90\nvfov_deg = 90"):
        lens = sensor_of(f"{keys}\nmax_angle_deg = 40\n{REST}").lens
        assert lens.contains(math.tan(math.radians(39.9)), 0, 1)
        assert not lens.contains(math.tan(math.radians(40.1)), 0, 1)


def test_a_spherical_lens_measures_range_unless_told_otherwise():
    keys = f"lens = 'spherical'\nazimuth_deg = 360\nelevation_deg = [-15, 15]\n{REST}"
    lidar = sensor_of(keys)
    assert lidar.lens == SphericalLens(2 * math.pi, (math.radians(-15), math.radians(15)))
    assert lidar.distance == "range"
    assert sensor_of(f"{keys}distance = 'depth'\n").distance == "depth"
    assert sensor_of(f"hfov_deg = 60\nvfov_deg = 40\n{REST}").distance == "depth"


def test_a_partner_has_the_lens_of_its_sensor_or_its_own():
    base = f"hfov_deg = 69\nvfov_deg = 42\n{REST}"
    pair = sensor_of(f"{base}partner = {{ offset = [55, 0, 0] }}")
    assert pair.partner == Partner((55, 0, 0), pair.lens)
    scanner = sensor_of(
        base + "partner = { offset = [9, 0, 1], turn_deg = [-5, 2], hfov_deg = 40, vfov_deg = 30, "
        "role = 'projector' }"
    )
    turn = (math.radians(-5), math.radians(2))
    assert scanner.partner == Partner((9, 0, 1), Pinhole.from_degrees(40, 30), turn, "projector")


def test_a_partners_focal_length_means_its_own_pixels_or_else_the_sensors():
    base = f"hfov_deg = 69\nvfov_deg = 42\n{REST}"
    own = "partner = { offset = [1, 0, 0], focal_px = [640, 480]"
    assert sensor_of(f"{base}{own} }}").partner.lens == Pinhole.from_tangents(0.5, 0.5)
    lens = sensor_of(f"{base}{own}, resolution = [1280, 960] }}").partner.lens
    assert lens == Pinhole.from_tangents(1.0, 1.0)


def test_noise_focus_group_and_cost_are_kept():
    found = sensor_of(
        f"hfov_deg = 69\nvfov_deg = 42\n{REST}"
        "noise = { polynomial = [1.5, -0.0005, 3e-7], by_incidence = true }\n"
        "focus = { focal_length = 8, f_number = 4, distance = '0.6 m', pixel_pitch = 0.00345 }\n"
        "emits = 'structured'\ncost = 270\n"
    )
    assert found.noise == Noise(polynomial=(1.5, -0.0005, 3e-7), by_incidence=True)
    assert found.focus == Focus(8, 4, 600, 0.00345)
    assert (found.emits, found.cost) == ("structured", 270)


# --- what goes with what

WRONG = {
    "distortion = [0.1, 0, 0, 0]\nhfov_deg = 6\nvfov_deg = 4": (
        "distortion: goes with lens = 'opencv' or 'fisheye', here it is 'pinhole'"
    ),
    "lens = 'opencv'\nhfov_deg = 60\nfocal_px = [9, 9]": (
        "hfov_deg: goes with lens = 'pinhole', here it is 'opencv'"
    ),
    "azimuth_deg = 90": "azimuth_deg: goes with lens = 'spherical', here it is 'pinhole'",
    "lens = 'spherical'\nmax_angle_deg = 60": (
        "max_angle_deg: goes with lens = 'pinhole' or 'opencv' or 'fisheye', here it is 'spherical'"
    ),
    "hfov_deg = 60\nvfov_deg = 40\nfocal_px = [9, 9]": (
        "hfov_deg and vfov_deg, or focal_px, not both"
    ),
    "": "'hfov_deg' and 'vfov_deg' are missing; or focal_px, or another lens",
    "hfov_deg = 60": "'vfov_deg' is missing",
    "hfov_deg = 60\nvfov_deg = 40\ncentre_px = [9, 9]": (
        "centre_px: goes with focal_px, not with hfov_deg and vfov_deg"
    ),
    "lens = 'fisheye'": "'focal_px' is missing, lens = 'fisheye' needs it",
    "lens = 'spherical'\nazimuth_deg = 90": (
        "'elevation_deg' is missing, lens = 'spherical' needs it"
    ),
    "lens = 'spherical'\nazimuth_deg = 90\nelevation_deg = [5, 5]": (
        "elevation_deg = [5, 5] must rise and lie in [-90, 90]"
    ),
    "lens = 'opencv'\nfocal_px = [9, 9]\ndistortion = [1, 2, 3]": (
        "distortion has 3 numbers; it takes k1, k2, p1, p2, then none, k3, or k3, k4, k5, k6 (thin "
        "prisms and tilt are not known)"
    ),
    "lens = 'fisheye'\nfocal_px = [9, 9]\ndistortion = [1, 2, 3, 4, 5]": (
        "distortion has 5 numbers; a fisheye takes k1, k2, k3, k4"
    ),
    "lens = 'opencv'\nfocal_px = [9, 9]\ndistortion = [-0.3, 0, 0, 0]\ncentre_px = [9000, 9000]": (
        "the middle of the image has no ray: focal_px, centre_px, distortion and max_angle_deg are "
        "not those of one lens"
    ),
    "hfov_deg = 60\nvfov_deg = 40\nnoise = { subpixel = 0.1 }": (
        "noise: subpixel needs a partner, whose offset is its baseline"
    ),
    "hfov_deg = 60\nvfov_deg = 40\nnoise = {}": "noise: needs either 'subpixel' or 'polynomial'",
    "hfov_deg = 60\nvfov_deg = 40\npartner = { offset = [1, 0, 0], hfov_deg = 5 }": (
        "partner: 'vfov_deg' is missing"
    ),
    "hfov_deg = 60\nvfov_deg = 40\npartner = { offset = [1, 0, 0], resolution = [9, 9] }": (
        "partner: resolution: goes with the keys of a lens of the partner's own"
    ),
    "hfov_deg = 60\nvfov_deg = 40\n"
    "focus = { focal_length = 8, f_number = 4, distance = 8, pixel_pitch = 1 }": (
        "focus: distance = 8 in focus must be more than the focal length, 8"
    ),
    "from = 'kinect-v3'": "from = 'kinect-v3' is unknown; 'glvis sensors' lists the catalogue",
    "from = 'kinectv2'": (
        "from = 'kinectv2' is unknown; did you mean 'kinect-v2'?; 'glvis sensors' lists the "
        "catalogue"
    ),
    "from = 'd415'": (
        "from = 'd415' is ambiguous: 'd415-buonamici' is the paper's (66.4 x 39.5 deg, 160 to 350 "
        "mm), 'realsense-d415' the maker's sheet"
    ),
}  # fmt: skip
ONE_KEY = {
    "lens = 'wide'": "lens = 'wide' must be 'pinhole', 'opencv', 'fisheye' or 'spherical'",
    "focal_px = [1, 2, 3]": "focal_px = [1, 2, 3] must be [x, y]",
    "focal_px = [0, 9]": "focal_px[0] = 0 must lie in [0.001, 1e+09]",
    "focal_px = ['8 mm', '8 mm']": "focal_px[0] = '8 mm' must be a number",
    "centre_px = [1e9, 0]": "centre_px[0] = 1000000000.0 must be at most 1e+06 in size",
    "distortion = [1e9]": "distortion[0] = 1000000000.0 must be at most 1e+06 in size",
    f"distortion = {[0.0] * 15}": "must have at most 14 numbers",
    "max_angle_deg = 181": "max_angle_deg = 181 must lie in (0, 180]",
    "azimuth_deg = 361": "azimuth_deg = 361 must lie in (0, 360]",
    "elevation_deg = [-91, 0]": "elevation_deg[0] = -91 must lie in [-90, 90]",
    "distance = 'far'": "distance = 'far' must be 'depth' or 'range'",
    "partner = { offset = [1, 0] }": "partner.offset = [1, 0] must have three entries",
    "partner = {}": "'partner.offset' is missing",
    "partner = { offset = [1, 0, 0], role = 'x' }": "partner.role = 'x' must be 'imager' or 'proj",
    "partner = { offset = [1, 0, 0], rol = 'x' }": "unknown key 'rol'; did you mean 'role'?",
    "noise = { subpixel = 0 }": "noise.subpixel = 0 must be greater than 0",
    "focus = { focal_length = 8 }": "'focus.f_number' is missing",
    "cost = -1": "cost = -1 must lie in [0, 1e+12]",
    "emits = 5": "emits = 5 must be a text",
    "from_ = 'd415'": "unknown key 'from_'; did you mean 'from'?",
    "calibration = ''": "calibration = '' must not be empty",
}


@pytest.mark.parametrize("keys", WRONG)
def test_keys_that_do_not_go_together_are_one_line(keys):
    with pytest.raises(ValueError) as caught:
        sensor_of(keys + "\n" + REST)
    assert str(caught.value) == WRONG[keys]


@pytest.mark.parametrize("keys", ONE_KEY)
def test_a_key_that_is_wrong_by_itself_is_one_line_with_its_place(tmp_path, keys):
    table = f"[sensor.cam]\n{keys}\n{REST}\n"
    path = write_two_cubes(tmp_path, SMALL.replace("[[mount]]", f"{table}[[mount]]", 1))
    with pytest.raises(StudyError) as caught:
        load_study(path)
    assert str(caught.value).startswith(f"{path}: [sensor.cam] ")
    assert ONE_KEY[keys] in str(caught.value)
    assert "\n" not in str(caught.value)


def test_a_sensor_needs_pixels_and_a_range():
    with pytest.raises(ValueError, match=r"^'resolution' is missing$"):
        sensor_of("hfov_deg = 60\nvfov_deg = 40\nmax_distance = 9")
    with pytest.raises(ValueError, match=r"^'max_distance' is missing$"):
        sensor_of("hfov_deg = 60\nvfov_deg = 40\nresolution = [9, 9]")


# --- the way back


def random_lens(rng: np.random.Generator, size: tuple[int, int]) -> dict:
    """Return the keys of a lens of some kind that sees the middle of its image."""
    focal = [float(f) for f in rng.uniform(0.5, 2, 2) * size[0]]
    centre = [float(c) for c in (np.array(size) - 1) / 2 + rng.uniform(-9, 9, 2)]
    few = [round(float(k), 4) for k in rng.uniform(-0.02, 0.02, 8)]
    angle = {"max_angle_deg": round(float(rng.uniform(40, 180)), 3)} if rng.random() < 0.3 else {}
    angles = [round(float(a), int(rng.integers(0, 9))) for a in rng.uniform(20, 100, 2)]
    return [
        {"hfov_deg": angles[0], "vfov_deg": angles[1]},
        {"focal_px": [round(f, int(rng.integers(0, 12))) for f in focal]},
        {"focal_px": focal, "centre_px": centre},
        {"lens": "opencv", "focal_px": focal, "distortion": few[: int(rng.choice([0, 4, 5, 8]))]},
        {"lens": "opencv", "focal_px": focal, "centre_px": centre, "distortion": few} | angle,
        {"lens": "fisheye", "focal_px": focal, "distortion": few[: int(rng.choice([0, 4]))]}
        | angle,
        {
            "lens": "spherical",
            "azimuth_deg": float(rng.integers(1, 361)),
            "elevation_deg": [-angles[0] * 0.9, 90.0],
        },
    ][rng.integers(7)]


def random_table(rng: np.random.Generator) -> dict:
    """Return a table of a sensor of some kind."""
    size = (int(rng.integers(8, 4000)), int(rng.integers(8, 4000)))
    table = random_lens(rng, size) | {"resolution": list(size)}
    table |= {"min_distance": float(rng.random()), "max_distance": float(rng.uniform(2, 1e4))}
    table["max_incidence_deg"] = round(float(rng.uniform(1, 90)), 4)
    if rng.random() < 0.3:
        table["distance"] = str(rng.choice(["depth", "range"]))
    if rng.random() < 0.6:
        table["partner"] = {"offset": [float(x) for x in rng.normal(0, 50, 3)]}
        if rng.random() < 0.5:
            table["partner"]["turn_deg"] = [round(float(a), 3) for a in rng.uniform(-20, 20, 2)]
            table["partner"]["role"] = "projector"
        if rng.random() < 0.5:
            own = (int(rng.integers(8, 4000)), int(rng.integers(8, 4000)))
            lens = random_lens(rng, own)
            if "lens" not in lens and "centre_px" not in lens:  # a pinhole, which has no pixels
                own = size
            table["partner"] |= lens | {"resolution": list(own)}
        table["noise"] = {"subpixel": float(rng.random() + 0.01)}
    elif rng.random() < 0.5:
        table["noise"] = {"polynomial": [float(k) for k in rng.normal(size=3)]}
        table["noise"]["by_incidence"] = bool(rng.random() < 0.5)
    if rng.random() < 0.3:
        lengths = dict(zip(("focal_length", "f_number", "pixel_pitch"), rng.random(3), strict=True))
        table["focus"] = {k: float(v) for k, v in lengths.items()} | {"distance": 2.0}
    if rng.random() < 0.3:
        table |= {"emits": "dots", "cost": float(rng.integers(1000))}
    return table


@pytest.mark.parametrize("seed", range(300))
def test_a_sensor_that_is_written_and_read_again_is_equal(seed):
    table = random_table(np.random.default_rng(seed))
    sensor = SensorTable.model_validate(table).to_sensor("cam")
    assert again(sensor) == sensor


def test_a_partners_pinhole_of_other_pixels_comes_back_within_rounding():
    sensor = sensor_of(
        f"hfov_deg = 60\nvfov_deg = 40\n{REST}partner = "
        "{ offset = [1, 0, 0], focal_px = [901.7, 903.3], resolution = [1919, 1081] }"
    )
    opening = sensor.partner.lens.opening
    assert again(sensor).partner.lens.opening == pytest.approx(opening, rel=1e-15)


def test_angles_are_written_as_people_write_them():
    sensor = sensor_of(f"hfov_deg = 66.4\nvfov_deg = 39.5\nmax_incidence_deg = 70\n{REST}")
    assert sensor_table(sensor) == {
        "hfov_deg": 66.4, "vfov_deg": 39.5, "resolution": [640, 480], "min_distance": 0.0,
        "max_distance": 9.0, "max_incidence_deg": 70.0,
    }  # fmt: skip


def test_a_lens_in_pixels_of_another_size_is_written_in_those_of_the_sensor():
    lens = OpenCVLens((1280, 960), (800, 800), (640, 470), (-0.2, 0.01, 0, 0))
    found = again(Sensor("cam", lens, (640, 480), 0, 9)).lens
    assert found == lens.at_size((640, 480))
    rng = np.random.default_rng(0)
    x, y, depth = *rng.normal(size=(2, 50)), np.ones(50)
    np.testing.assert_allclose(found.project(x, y, depth), lens.project(x, y, depth), atol=1e-12)


# --- the catalogue


D435, AZURE = find_sensor("realsense-d435", "mm"), find_sensor("azure-kinect-nfov", "mm")


@pytest.mark.parametrize("unit", ["mm", "in"])
@pytest.mark.parametrize("name", catalogue("mm"))
def test_an_entry_of_the_catalogue_is_the_sensor_by_another_name(name, unit):
    found = sensor_of(f"from = '{name}'", unit)
    assert found == dataclasses.replace(catalogue(unit)[name], name="cam")
    assert again(found) == found


def test_keys_beside_an_entry_go_before_its_own():
    found = sensor_of("from = 'realsense-d435'\nmax_distance = '1 m'\nnoise = { polynomial = [1] }")
    assert found.max_distance == 1000
    assert found.noise == Noise(polynomial=(1.0,))
    assert (found.lens, found.partner) == (D435.lens, D435.partner)


@pytest.mark.parametrize("name", [name for name, entry in entries().items() if entry.missing])
def test_an_entry_that_lacks_a_number_takes_it_from_the_table(name):
    (key,) = entries()[name].missing
    found = sensor_of(f"from = '{name}'\nmax_distance = 9\nresolution = [36, 9]\nmin_distance = 0")
    assert (found.max_distance, found.resolution) == (9, (36, 9))
    with pytest.raises(ValueError) as caught:
        sensor_of(f"from = '{name}'\nmin_distance = 1")
    assert str(caught.value) == (
        f"from = '{name}' has no {key} in the catalogue; give yours beside it"
    )


def test_a_range_beside_a_camera_keeps_its_pixels():
    found = sensor_of("from = 'imx264-8mm'\nmax_distance = 2", "m")
    assert (found.resolution, found.max_distance) == ((2448, 2048), 2)
    assert found.focal_pixels() == pytest.approx((2318.8, 2318.8))


def test_resolution_alone_leaves_the_field_of_view():
    found = sensor_of("from = 'realsense-d435'\nresolution = [640, 360]")
    assert found.resolution == (640, 360)
    assert found.lens.opening == pytest.approx(D435.lens.opening, rel=1e-12)
    assert found.partner.lens == found.lens
    bent = sensor_of("from = 'azure-kinect-nfov'\nresolution = [320, 288]").lens
    assert bent == AZURE.lens.at_size((320, 288))
    # two pixels are one, as in the entry of the camera's own binned mode
    binned = find_sensor("azure-kinect-nfov-binned", "mm").lens
    assert bent.project(0.3, 0.2, 1) == pytest.approx(binned.project(0.3, 0.2, 1), abs=1e-12)


@pytest.mark.parametrize("name", ["zivid-2-m70", "phoxi-m"])
def test_a_partner_keeps_its_own_lens(name):
    projector = find_sensor(name, "mm").partner
    for keys in ("resolution = [972, 600]", "hfov_deg = 30", "lens = 'fisheye'\nfocal_px = [9, 9]"):
        assert sensor_of(f"from = '{name}'\n{keys}").partner == projector


def test_a_partner_without_a_lens_of_its_own_has_the_one_of_its_sensor():
    found = sensor_of("from = 'realsense-d435'\nhfov_deg = 60\nvfov_deg = 40")
    assert found.partner.lens == found.lens == Pinhole.from_degrees(60, 40)
    assert found.partner.offset == D435.partner.offset


def test_one_key_of_a_lens_changes_that_lens_where_it_has_it():
    lens = sensor_of("from = 'realsense-d435'\nhfov_deg = 80").lens
    assert lens.hfov == math.radians(80)
    assert lens.vfov == pytest.approx(D435.lens.vfov)
    moved = sensor_of("from = 'azure-kinect-nfov'\ncentre_px = [300, 350]").lens
    assert moved == dataclasses.replace(AZURE.lens, centre_px=(300, 350))
    round_ = sensor_of("from = 'azure-kinect-nfov'\nmax_angle_deg = 30").lens
    assert round_ == dataclasses.replace(AZURE.lens, max_angle=math.radians(30))
    # a key that the entry leaves to its default is one of its lens as well
    moved = sensor_of("from = 'hik-2.8'\nmax_distance = 9\ncentre_px = [950, 540]").lens
    assert moved == FisheyeLens((1920, 1080), (1034, 1034), (950, 540), ())


def test_another_lens_beside_an_entry_is_a_lens_as_a_whole():
    plain = sensor_of("from = 'azure-kinect-nfov'\nhfov_deg = 60\nvfov_deg = 40").lens
    assert plain == Pinhole.from_degrees(60, 40)
    with pytest.raises(ValueError, match="'vfov_deg' is missing"):
        sensor_of("from = 'azure-kinect-nfov'\nhfov_deg = 60")
    fisheye = sensor_of("from = 'realsense-d435'\nlens = 'fisheye'\nfocal_px = [400, 400]").lens
    assert fisheye == FisheyeLens((1280, 720), (400, 400), (639.5, 359.5), ())
    turning = sensor_of(
        "from = 'velodyne-vlp-16'\nlens = 'fisheye'\nfocal_px = [400, 400]\nresolution = [9, 9]"
    )
    assert turning.distance == "depth"  # by the new lens


# --- studies


def study_with(folder, table: str, name: str = "eye") -> str:
    """Write the small study with another table of its sensor; return its path."""
    head, _, rest = SMALL.partition("[sensor.eye]")
    mounts = rest[rest.index("[[mount]]") :]
    return write_two_cubes(folder, f"{head}[sensor.{name}]\n{table}\n\n{mounts}")


def test_a_result_holds_the_numbers_of_a_catalogue_entry(tmp_path):
    path = study_with(tmp_path, "from = 'kinect-v2'\nmax_distance = 3000 # not farther")
    study = load_study(path, ["sensor.eye.cost=9"])
    kept = tomllib.loads(study.text)["sensor"]["eye"]
    assert "from" not in kept
    assert kept["resolution"] == [512, 424]
    assert (kept["max_distance"], kept["cost"]) == (3000, 9)
    copy = tmp_path / "copy.toml"
    copy.write_text(study.text)
    again_loaded = load_study(copy)
    assert again_loaded.sensors == study.sensors
    assert again_loaded.text == study.text


def test_a_result_holds_the_numbers_of_a_calibration(tmp_path):
    file = tmp_path / "left.yml"
    storage = cv2.FileStorage(str(file), cv2.FILE_STORAGE_WRITE)
    storage.write("image_width", 96)
    storage.write("image_height", 64)
    storage.write("camera_matrix", np.array([[80.5, 0, 47], [0, 80.25, 31], [0, 0, 1]]))
    storage.write("distortion_coefficients", np.array([-0.1, 0.01, 0.001, -0.002, 0.0]))
    storage.release()
    path = study_with(tmp_path, "calibration = 'left.yml'\nmax_distance = 12")
    study = load_study(path, ["sensor.eye.min_distance=1"])
    file.unlink()
    copy = tmp_path / "copy.toml"
    copy.write_text(study.text)
    assert load_study(copy).sensors == study.sensors
    lens = OpenCVLens((96, 64), (80.5, 80.25), (47, 31), (-0.1, 0.01, 0.001, -0.002, 0.0))
    assert study.sensors[0].lens == lens
    assert study.sensors[0].min_distance == 1
    with pytest.raises(StudyError) as caught:
        load_study(path)
    assert str(caught.value) == f"{path}: [sensor.eye] calibration: {file}: does not exist"


def test_settings_reach_every_key_of_a_sensor(tmp_path):
    path = study_with(tmp_path, "from = 'kinect-v2'")
    study = load_study(
        path,
        ["sensor.eye.partner.offset=[75, 0, 0]", "sensor.eye.noise.subpixel=0.1",
         "sensor.eye.from=realsense-d415", "sensor.eye.distance=range"],
    )  # fmt: skip
    sensor = study.sensors[0]
    assert sensor.partner.offset == (75, 0, 0)
    assert sensor.noise == Noise(0.1)
    assert (sensor.resolution, sensor.distance) == ((1280, 720), "range")
    copy = tmp_path / "copy.toml"
    copy.write_text(study.text)
    assert load_study(copy).sensors == study.sensors


@pytest.mark.parametrize("is_named_by_mounts", [False, True])
def test_a_setting_in_a_table_of_an_entry_keeps_the_rest_of_it(tmp_path, is_named_by_mounts):
    path = study_with(tmp_path, "from = 'realsense-d435'")
    name = "eye"
    if is_named_by_mounts:
        path, name = study_of(tmp_path, "realsense-d435"), "realsense-d435"
    sensor = load_study(path, [f"sensor.{name}.partner.role=projector"]).sensors[0]
    assert sensor.partner == dataclasses.replace(D435.partner, role="projector")
    sensor = load_study(path, [f"sensor.{name}.noise.subpixel=0.1"]).sensors[0]
    assert sensor == dataclasses.replace(D435, name=name, noise=Noise(0.1))
    sensor = load_study(path, [f"sensor.{name}.partner.offset.0=60"]).sensors[0]
    assert sensor.partner.offset == (60, 0, 0)
    assert find_sensor("realsense-d435", "mm") == D435  # nothing was written into the catalogue
    sensor = load_study(path, [f"sensor.{name}.resolution.0=640"]).sensors[0]
    assert sensor.resolution == (640, 720)


def study_of(folder, name: str) -> str:
    """Write the small study with its mounts naming a sensor that has no table; return its path."""
    head, _, rest = SMALL.partition("[sensor.eye]")
    mounts = rest[rest.index("[[mount]]") :].replace('sensor = "eye"', f'sensor = "{name}"')
    return write_two_cubes(folder, head + mounts)


def test_settings_reach_a_sensor_of_the_catalogue_without_a_table(tmp_path):
    path = study_of(tmp_path, "realsense-d435")
    study = load_study(path, ["sensor.realsense-d435.max_distance=2000"])
    assert study.sensors[0] == dataclasses.replace(D435, max_distance=2000)
    copy = tmp_path / "copy.toml"
    copy.write_text(study.text)
    assert "from" not in tomllib.loads(study.text)["sensor"]["realsense-d435"]
    assert load_study(copy).sensors == study.sensors


def test_a_setting_gives_what_the_catalogue_lacks(tmp_path):
    path = study_of(tmp_path, "imx264-8mm")
    with pytest.raises(StudyError, match="'imx264-8mm' has no max_distance in the catalogue; give"):
        load_study(path)
    sensor = load_study(path, ["sensor.imx264-8mm.max_distance=2000"]).sensors[0]
    assert (sensor.max_distance, sensor.resolution) == (2000, (2448, 2048))
    with pytest.raises(StudyError) as caught:
        load_study(path, ["sensor.imx264-8mm.min_distance=1"])
    assert str(caught.value) == (
        f"{path}: [sensor.imx264-8mm] from = 'imx264-8mm' has no max_distance in the catalogue; "
        "give yours beside it"
    )


def test_lengths_in_a_sensor_may_have_their_own_unit_and_pixels_may_not():
    sensor = sensor_of(
        "hfov_deg = 60\nvfov_deg = 40\nresolution = [9, 9]\nmax_distance = '2 m'\n"
        "partner = { offset = ['5 cm', 0, 0] }",
        unit="m",
    )
    assert sensor.max_distance == 2
    assert sensor.partner.offset == (0.05, 0, 0)


@pytest.mark.parametrize(
    ("keys", "what"),
    [
        ("lens = 'fisheye'\nfocal_px = [60, 60]", "lens = 'fisheye'"),
        ("hfov_deg = 60\nvfov_deg = 40\ndistance = 'range'", "distance = 'range'"),
        ("hfov_deg = 60\nvfov_deg = 40\npartner = { offset = [1, 0, 0] }", "a partner"),
    ],
)
def test_the_papers_semantics_know_one_ideal_pinhole(tmp_path, keys, what):
    table = f"{keys}\nresolution = [96, 64]\nmax_distance = 12\n\n[visibility]\nsemantics = 'paper'"
    with pytest.raises(StudyError) as caught:
        load_study(study_with(tmp_path, table))
    assert str(caught.value).endswith(
        f"[visibility] semantics = 'paper': 'eye' has {what}, and the paper knows one ideal "
        "pinhole, depth along its axis and no second viewpoint; leave semantics out"
    )
