"""The catalogue of sensors: each number has a source, and what makers state follows from it."""

import json
import math
import re
import tomllib

import numpy as np
import pytest
import trimesh

import glvis
from glvis.cli.app import main
from glvis.evaluation.checks import no_pinholes
from glvis.problem.calibrated_lens import OpenCVLens
from glvis.problem.catalogue import complaint, entries, find_entry, scaled
from glvis.problem.lens import Pinhole, SphericalLens
from glvis.problem.sensor import Partner, Sensor
from glvis.problem.units import MM_PER_UNIT
from glvis.study.catalogue_sensors import catalogue, find_sensor
from glvis.study.lens_table import lens_of
from glvis.study.loading import load_study
from glvis.study.sensor_table import SensorTable
from glvis.study.starter import write_starter
from glvis.study.starter_study import Choices

ALL = list(entries().values())
WORDS = {  # of a study's [sensor.NAME]
    "lens", "hfov_deg", "vfov_deg", "focal_px", "centre_px", "distortion", "max_angle_deg",
    "azimuth_deg", "elevation_deg", "resolution", "min_distance", "max_distance",
    "max_incidence_deg", "distance", "partner", "noise", "focus", "emits", "cost",
}  # fmt: skip
OF_ALL = {"lens", "azimuth_deg", "emits"}  # what they are, no measured numbers
whole = pytest.mark.parametrize("entry", ALL, ids=lambda entry: entry.name)


def completed(entry) -> Sensor:
    """Return the sensor of an entry, with a range and pixels of ours where it has none."""
    table = {"max_distance": 9e3, "resolution": [360, 90]} | entry.table
    return SensorTable.model_validate(table).to_sensor(entry.name)


def numbers(table: dict, above: str = "") -> list[str]:
    """Return the keys of a table, those of inner ones with a dot."""
    found = []
    for key, value in table.items():
        found += numbers(value, f"{above}{key}.") if isinstance(value, dict) else [above + key]
    return found


def test_it_has_more_than_thirty_sensors_of_which_most_need_nothing_more():
    assert len(ALL) >= 60
    assert sum(not entry.missing for entry in ALL) >= 40
    assert len({(entry.maker, str(entry.table)) for entry in ALL}) == len(ALL)


@whole
def test_every_number_has_a_source_and_every_entry_a_date(entry):
    assert set(entry.table) <= WORDS
    keys = numbers(entry.table)
    assert [key for key in keys if key not in OF_ALL and not entry.source_of(key)] == []
    known = {*keys, *(key.partition(".")[0] for key in keys)}
    assert set(entry.sources) <= known  # no source of a number that is not there
    assert re.fullmatch(r"20\d\d-[01]\d-[0-3]\d", entry.date)
    assert entry.grade in ("A", "B")
    assert entry.kind and entry.maker
    assert all(len(text) > 8 and "{" not in text for text in entry.sources.values())


@whole
def test_every_entry_is_a_sensor_that_sees_along_its_axis(entry):
    sensor = completed(entry)
    u, v = sensor.lens.project(0.0, 0.0, 1.0)
    assert 0 < u < 1 and 0 < v < 1
    direction = sensor.lens.directions(u, v)
    np.testing.assert_allclose(direction, [0, 0, 1], atol=1e-6)
    assert not (sensor.noise and sensor.noise.subpixel) or sensor.partner
    if sensor.partner:  # both see the middle of the range, or what lies nearer to the end
        depth = sensor.max_distance
        there = np.linalg.inv(sensor.partner.partner_to_sensor) @ [0, 0, -depth, 1]
        assert sensor.partner.lens.contains(there[0], there[1], -there[2])


@whole
def test_a_pinhole_has_square_pixels_or_angles_that_agree(entry):
    assert no_pinholes([completed(entry)]) == []
    if "focal_px" in entry.table:
        fx, fy = completed(entry).focal_pixels()
        assert (fx, fy) == pytest.approx(entry.table["focal_px"]) and fx == pytest.approx(fy)


# Angles that makers or papers state, and by how much those of the focal length may differ: the
# sheets of RealSense say "at 2 m" and +-3 deg, the D415's calibrated 940 px contradict its sheet.
STATED = [
    ("realsense-d405", 87, 58, 3.0),
    ("realsense-d415", 65, 40, 3.6),
    ("realsense-d435", 87, 58, 3.0),
    ("realsense-d435-vga", 75, 62, 5.0),
    ("realsense-d455", 87, 58, 3.2),
    ("azure-kinect-nfov", 73.1, 65.7, 0.3),  # three units' calibrations
    ("azure-kinect-wfov", 120, 120, 0.2),
    ("azure-kinect-nfov-binned", 73.1, 65.7, 0.3),
    ("azure-kinect-wfov-binned", 120, 120, 0.2),
    ("kinect-v1", 57, 43, 2.1),
    ("zed-mini-hd1080", 69, 42, 0.3),
    ("zed-mini-hd720", 85, 54, 0.5),
    ("zivid-2-m70", 57.14, 37.16, 0.05),
    ("zivid-2-l100", 57.17, 37.18, 0.05),
    ("zivid-2plus-m60", 52.5, 44.9, 0.1),
    ("zivid-2plus-l110", 52.6, 44.9, 0.1),
    ("zivid-2plus-m130", 33.8, 28.5, 0.1),
    ("picamera-v2", 62.2, 48.8, 0.2),
    ("hik-2.8", 106.4, 57.9, 2.0),
    ("hik-3.6", 79.6, 43.5, 1.4),
]


@pytest.mark.parametrize(("name", "hfov", "vfov", "within"), STATED)
def test_angles_that_follow_are_those_that_are_stated(name, hfov, vfov, within):
    found = np.degrees(lens_of(find_entry(name).table).opening)
    np.testing.assert_allclose(found, [hfov, vfov], atol=within)


def test_d415_of_the_paper_is_the_one_of_table_3():
    d415 = find_sensor("d415-buonamici", "mm")
    assert math.degrees(d415.lens.hfov) == pytest.approx(69.4 - 3)
    assert math.degrees(d415.lens.vfov) == pytest.approx(42.5 - 3)
    assert d415.resolution == (1280, 720)
    assert (d415.min_distance, d415.max_distance) == (160, 350)
    assert math.degrees(d415.max_incidence) == pytest.approx(70)
    assert d415.is_ideal and not d415.noise


def test_kinect_v2_is_the_one_of_the_kitchen_study():
    kinect = find_sensor("kinect-v2", "mm")
    assert math.degrees(kinect.lens.hfov) == pytest.approx(70.6)
    assert math.degrees(kinect.lens.vfov) == pytest.approx(60)
    assert kinect.resolution == (512, 424)
    assert (kinect.min_distance, kinect.max_distance) == (500, 4500)
    assert math.degrees(kinect.max_incidence) == pytest.approx(80)
    assert kinect.is_ideal


# --- two viewpoints


def overlap(sensor: Sensor, z: float, yaw_deg: float) -> tuple[float, float]:
    """Return the width and height of what both see of a plane at distance z, through its middle.

    The plane is square to the axis of the housing, from which the camera is turned by ``yaw_deg``
    to its right; the distance is that from the camera.
    """
    steps = z * np.linspace(-0.8, 0.8, 8001)
    partner = sensor.partner
    turn = Partner((0.0, 0.0, 0.0), sensor.lens, (math.radians(yaw_deg), 0.0)).partner_to_sensor

    def seen(x, y):
        points = turn.T @ np.stack([x, y, np.full_like(x, -z), np.ones_like(x)])
        there = np.linalg.inv(partner.partner_to_sensor) @ points
        own = sensor.lens.contains(points[0], points[1], -points[2])
        return own & partner.lens.contains(there[0], there[1], -there[2])

    across = steps[seen(steps, np.zeros_like(steps))]
    up = steps[seen(np.full_like(steps, (across[0] + across[-1]) / 2), steps)]
    return float(np.ptp(across)), float(np.ptp(up))


# Ends of the field meshes, width and height in mm: zivid/zivid-ros@844ac2a1, *_fov.stl; and how far
# the camera is turned in the housing, degrees: zivid/zivid-isaac-sim, zivid_camera_model.py.
MESHES = [
    ("zivid-2-m70", 3.0, 300, 264, 192), ("zivid-2-m70", 3.0, 1300, 1332, 832),
    ("zivid-2-l100", 3.0, 1600, 1614, 1023), ("zivid-2plus-m60", 2.5, 1100, 1096, 877),
    ("zivid-2plus-mr60", 2.5, 1100, 1096, 877), ("zivid-2plus-l110", 2.5, 1700, 1693, 1353),
    ("zivid-2plus-lr110", 2.5, 1700, 1693, 1353), ("zivid-2plus-m130", 0.0, 2000, 1219, 1020),
    ("zivid-2plus-mr130", 0.0, 2000, 1219, 1020),
    ("phoxi-l", 9.45, 1239, 1082, 772),  # Photoneo's page of L, at its best distance
]  # fmt: skip


@pytest.mark.parametrize(("name", "yaw_deg", "z", "width", "height"), MESHES)
def test_camera_and_projector_see_the_makers_field_together(name, yaw_deg, z, width, height):
    found = overlap(find_sensor(name, "mm"), z, yaw_deg)
    assert found[0] == pytest.approx(width, rel=0.02)
    # where the projector's height is the smaller one, Zivid's meshes seem to take both midway;
    # Photoneo states a smaller height than the two pyramids have
    assert found[1] == pytest.approx(height, rel=0.07 if name == "phoxi-l" else 0.045)


@pytest.mark.parametrize(
    ("name", "best"), [("phoxi-s", 416), ("phoxi-m", 841), ("phoxi-l", 1652), ("phoxi-xl", 3228)]
)
def test_axes_of_a_phoxi_meet_where_its_angles_say(name, best):
    partner = find_sensor(name, "mm").partner
    pose = partner.partner_to_sensor
    ahead = -pose[:3, 2]
    reach = -pose[0, 3] / ahead[0]  # along the projector's axis to the camera's
    half = math.radians(-find_entry(name).table["partner"]["turn_deg"][0] / 2)
    meeting = pose[:3, 3] + reach * ahead
    assert meeting[:2] == pytest.approx([0, 0], abs=0.05)
    assert -meeting[2] * math.cos(half) == pytest.approx(best, rel=2e-3)


def test_partners_of_stereo_look_along_the_same_way_beside_the_first():
    for entry in ALL:
        if entry.kind.endswith("stereo") and "partner" in entry.table:
            partner = completed(entry).partner
            assert partner.lens == completed(entry).lens and partner.role == "imager"
            assert partner.offset[1:] == (0, 0) and 10 < abs(partner.offset[0]) < 150


# Factory calibrations of three Azure Kinects, fx by 1024 pixels and k1..k6 of the rational model:
# issues 1488 and 1617 of the Azure-Kinect-Sensor-SDK, panispani/3DReconstruct
# pointCloudGen/calib.md, and issue 1518; and their pixels from the axis at 60 degrees.
AZURE = {
    "A": (0.492038131, (4.724737, 3.209223, 0.170596, 5.055860, 4.775780, 0.886494), 511.1),
    "B": (0.492116839, (3.130577, 2.324939, 0.130416, 3.458652, 3.350115, 0.662942), 511.7),
    "C": (0.492700636, (0.921849, 0.500401, 0.028360, 1.258424, 0.751812, 0.144190), 511.6),
}


def test_three_azure_kinects_are_one_lens_though_their_coefficients_differ_fivefold():
    def radius(lens, size):
        """Return the pixels from the axis at 60 degrees."""
        along = lens.project(np.tan(np.radians(60)), 0.0, 1.0)[0]
        return (along - lens.project(0.0, 0.0, 1.0)[0]) * size

    found = []
    for f, (k1, k2, k3, k4, k5, k6), expected in AZURE.values():
        coefficients = (k1, k2, 0.0, 0.0, k3, k4, k5, k6)
        focal = (1024 * f, 1024 * f)
        lens = OpenCVLens((1024, 1024), focal, (511.5, 511.5), coefficients, math.radians(61))
        found.append(radius(lens, 1024))
        assert found[-1] == pytest.approx(expected, abs=0.1)
    assert np.ptp(found) <= 0.6
    own = find_entry("azure-kinect-wfov").table
    ours = OpenCVLens((1024, 1024), (503.95,) * 2, (511.5, 511.5), tuple(own["distortion"]))
    assert own["focal_px"] == [503.95, 503.95]
    assert radius(ours, 1024) == pytest.approx(AZURE["B"][2], abs=0.06)


def test_modes_of_an_azure_kinect_are_one_lens():
    rng = np.random.default_rng(0)
    x, y = rng.uniform(-0.6, 0.6, (2, 100))  # within the narrow field
    whole = np.array(lens_of(find_entry("azure-kinect-wfov").table).project(x, y, 1.0)) * 1024
    part = np.array(lens_of(find_entry("azure-kinect-nfov").table).project(x, y, 1.0)).T * [
        640,
        576,
    ]
    np.testing.assert_allclose(whole.T - [192, 180], part, atol=1e-9)
    for mode in ("wfov", "nfov"):
        one = lens_of(find_entry(f"azure-kinect-{mode}").table).project(x, y, 1.0)
        binned = lens_of(find_entry(f"azure-kinect-{mode}-binned").table).project(x, y, 1.0)
        np.testing.assert_allclose(binned, one, atol=1e-12)


def test_a_round_field_has_blind_corners():
    assert lens_of(find_entry("azure-kinect-wfov").table).has_blind_corners
    assert not lens_of(find_entry("azure-kinect-nfov").table).has_blind_corners


def test_a_partner_in_pixels_says_of_which_image():
    """Else another resolution beside ``from`` would change its lens."""
    for entry in ALL:
        partner = entry.table.get("partner", {})
        assert "focal_px" not in partner or "resolution" in partner


def test_lidars_measure_ranges_and_the_others_depths():
    for entry in ALL:
        is_turning = isinstance(lens_of(entry.table), SphericalLens)
        assert is_turning == (entry.kind == "lidar")
        assert completed(entry).distance == ("range" if is_turning else "depth")


def test_only_projectors_of_patterns_disturb_each_other():
    for entry in ALL:
        assert entry.table.get("emits", "") == (
            "structured" if entry.kind == "structured light" else ""
        )


# --- units and names


@pytest.mark.parametrize("unit", MM_PER_UNIT)
def test_all_lengths_come_in_the_unit_of_the_study(unit):
    mm, scale = catalogue("mm"), MM_PER_UNIT[unit]
    for name, sensor in catalogue(unit).items():
        own = mm[name]
        assert sensor.name == name
        assert sensor.lens == own.lens and sensor.resolution == own.resolution
        assert sensor.min_distance * scale == pytest.approx(own.min_distance)
        assert sensor.max_distance * scale == pytest.approx(own.max_distance)
        if own.partner:
            assert np.multiply(sensor.partner.offset, scale) == pytest.approx(own.partner.offset)
        if own.noise and own.noise.polynomial:
            z = own.max_distance

            def sigma(noise, z):
                return sum(value * z**k for k, value in enumerate(noise.polynomial))

            assert sigma(sensor.noise, z / scale) * scale == pytest.approx(sigma(own.noise, z))


def test_the_focus_is_scaled_but_for_its_f_number():
    focus = {"focal_length": 8, "f_number": 4, "distance": 600, "pixel_pitch": 0.00345}
    table = scaled({"focus": focus, "max_distance": 5}, 0.1)
    assert table["focus"] == pytest.approx(
        {"focal_length": 0.8, "f_number": 4, "distance": 60, "pixel_pitch": 0.000345}
    )
    assert table["max_distance"] == pytest.approx(0.5)
    table |= {"hfov_deg": 60, "vfov_deg": 46.8, "resolution": [64, 48], "cost": 5}
    made = SensorTable.model_validate(table).to_sensor("one")
    assert made.focus.f_number == 4 and made.cost == 5


def test_a_plain_d415_is_refused_by_one_line_that_names_both():
    with pytest.raises(ValueError) as error:
        find_sensor("d415", "mm")
    assert str(error.value) == (
        "sensor 'd415' is ambiguous: 'd415-buonamici' is the paper's (66.4 x 39.5 deg, 160 to "
        "350 mm), 'realsense-d415' the maker's sheet"
    )


@pytest.mark.parametrize(
    ("name", "message"),
    [
        ("d435", "is unknown; did you mean 'realsense-d435' or 'realsense-d435-848' or "),
        ("kinectv2", "is unknown; did you mean 'kinect-v2'?; 'glvis sensors' lists the catalogue"),
        ("azure-kinect", "is unknown; did you mean 'azure-kinect-nfov' or 'azure-kinect-nfov-b"),
        ("realsense-d345", "is unknown; 'glvis sensors' lists"),  # another product, no slip
        ("", "is unknown; 'glvis sensors' lists"),
        ("oak-d", "has no max_distance in the catalogue; give yours in a table [sensor.NAME] with"),
        ("livox-mid-360", "has no resolution in the catalogue; give yours in"),
    ],
)
def test_a_name_that_is_none_ends_in_one_line(name, message):
    with pytest.raises(ValueError) as error:
        find_sensor(name, "mm")
    assert str(error.value).startswith(f"sensor '{name}' {message}")
    assert "\n" not in str(error.value)


def test_names_of_the_study_are_offered_as_well():
    assert complaint("eyes", ["eye"]).startswith("is unknown; did you mean 'eye'?")


def test_what_lacks_a_number_is_not_among_those_that_need_none():
    assert set(catalogue("m")) == {entry.name for entry in ALL if not entry.missing}
    catalogue("m").clear()  # nobody's but the caller's
    assert catalogue("m")


# --- the command, and studies


def lines_of(capsys, *arguments) -> list[str]:
    assert main(["sensors", *arguments]) == 0
    return capsys.readouterr().out.splitlines()


@pytest.mark.parametrize("unit", ["mm", "cm", "m", "in", "ft"])
def test_the_list_fits_eighty_columns_and_names_all(capsys, unit):
    lines = lines_of(capsys, "--unit", unit)
    assert max(map(len, lines)) <= 80
    names = [line.split()[0] for line in lines if line.startswith("  ")]
    assert sorted(names[1:]) == sorted(entries())  # after the head
    assert not any(line != line.rstrip() for line in lines)


def test_the_list_says_field_pixels_range_and_baseline(capsys):
    (found,) = [line for line in lines_of(capsys) if line.split()[:1] == ["realsense-d435"]]
    assert found.split("  ", 2)[2].split() == [
        "89.6",
        "x",
        "58.3",
        "1280",
        "x",
        "720",
        "280",
        "to",
        "3000",
        "50",
    ]
    (found,) = [line for line in lines_of(capsys, "--unit", "m") if "zivid-2-m70" in line]
    assert found.endswith("0.3 to 1.3      0.1116")


@whole
def test_one_sensor_is_told_with_all_its_numbers_and_sources(capsys, entry):
    lines = lines_of(capsys, entry.name)
    told = " ".join(" ".join(lines).split())
    assert lines[0].startswith(f"{entry.name}: {entry.kind}, {entry.maker}")
    assert entry.date in told
    keys = {line.split()[0] for line in lines if line.startswith("  ")}
    assert set(numbers(entry.table)) <= keys
    spaceless = told.replace(" ", "")
    for text in (*entry.sources.values(), *entry.notes, entry.lack):
        assert text.replace(" ", "") in spaceless
    assert max(map(len, lines[2:-1])) <= 110


def test_an_unknown_sensor_or_unit_is_one_line(capsys):
    assert main(["sensors", "d415"]) == 2
    said = capsys.readouterr()
    assert said.out == "" and said.err.count("\n") == 1
    assert "'d415-buonamici'" in said.err and "'realsense-d415'" in said.err
    assert main(["sensors", "--unit", "yd"]) == 2
    assert capsys.readouterr().err == "error: --unit yd: must be one of mm, cm, m, in, inch, ft\n"


def test_programs_get_the_catalogue_as_json(capsys):
    assert main(["sensors", "--json", "--unit", "m"]) == 0
    found = {one["name"]: one for one in json.loads(capsys.readouterr().out)}
    assert set(found) == set(entries())
    assert found["realsense-d435"]["sensor"]["partner"] == {"offset": [0.05, 0, 0]}
    assert found["oak-d"]["missing"] == ["max_distance"]
    assert found["realsense-d435"]["sources"]["focal_px"].startswith("calibrations printed by")


@pytest.mark.parametrize("name", ["realsense-d435", "zivid-2-m70", "azure-kinect-nfov"])
def test_a_first_study_names_a_sensor_of_the_catalogue(tmp_path, name):
    from support import shapes

    part = shapes.write_off(tmp_path / "part.off", shapes.cube(200.0))
    path = write_starter(tmp_path / "s", [part], choices=Choices(sensor=name, sensors=3))
    data = tomllib.loads(path.read_text())
    assert "sensor" not in data
    assert [mount["sensor"] for mount in data["mount"]] == [name] * 3
    assert f"glvis sensors {name}" in path.read_text()
    study = load_study(path)
    assert study.sensors[0] == find_sensor(name, "mm")


def test_a_first_study_of_a_camera_without_a_range_is_refused(tmp_path, capsys):
    assert main(["init", str(tmp_path / "s"), "--model", "x.stl", "--sensor", "imx264-8mm"]) == 2
    assert "has no max_distance in the catalogue; give yours in a" in capsys.readouterr().err
    assert not (tmp_path / "s").exists()


def test_angles_of_no_one_pinhole_are_told():
    def sensor(hfov, vfov, size):
        return Sensor("eye", Pinhole.from_degrees(hfov, vfov), size, 0, 1)

    hikvision = sensor(106.4, 57.9, (1920, 1080))
    (told,) = no_pinholes([hikvision, hikvision])
    assert told == (
        "eye: 106.4 x 57.9 deg are no one pinhole of 1920 x 1080 pixels: their focal lengths are "
        "718 and 976 pixels, 106.4 deg go with 73.88; give focal_px and the lens, or a calibration"
    )
    assert no_pinholes([sensor(66.4, 39.5, (1280, 720)), sensor(70.6, 60, (512, 424))]) == []
    fy = 320 / 1.029  # just within 3 %
    assert no_pinholes([sensor(90, 2 * math.degrees(math.atan(240 / fy)), (640, 480))]) == []
    fy = 320 / 1.031
    assert no_pinholes([sensor(90, 2 * math.degrees(math.atan(240 / fy)), (640, 480))])
    assert no_pinholes([find_sensor("azure-kinect-wfov", "mm")]) == []  # a lens is its own


@pytest.mark.parametrize("name", catalogue("mm"))
def test_every_entry_sees_a_ball_before_it(name):
    device = catalogue("mm")[name]
    distance = device.min_distance + 0.25 * (device.max_distance - device.min_distance)
    ball = trimesh.creation.icosphere(subdivisions=3, radius=0.02 * distance)
    pose = glvis.look_at([0, -distance, 0], [0, 0, 0])
    if device.partner:  # midway between the two, where both look
        pose[:3, 3] -= pose[:3, :3] @ (np.array(device.partner.offset) / 2)
    visible = glvis.visible_faces(ball, pose, device)
    assert 0.1 < np.mean(visible) <= 0.5
