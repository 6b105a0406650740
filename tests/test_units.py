"""Units: formats that say theirs are believed; sizes that make no sense raise a question."""

import zipfile

import numpy as np
import pytest
from support.shapes import corners, cube, icosphere, write_3mf, write_off
from test_scene import glb

from glvis.problem.scene import load_model
from glvis.problem.units import guess_words, mm_per_own_unit, own_up, unit_guess
from glvis.study.loading import load_study

STUDY = """\
unit = "UNIT"
[scene]
models = ["MODEL"]
max_edge = "off"
[sensor.eye]
hfov_deg = 60
vfov_deg = 40
resolution = [640, 480]
max_distance = 400
[[mount]]
name = "A"
sensor = "eye"
position = [30, 0, 0]
direction = [-1, 0, 0]
"""


@pytest.fixture
def loaded(tmp_path):
    """Load a study of a cube of side 2 in a format and a unit."""

    def load(name, unit, of_file="millimeter", scene=""):
        if name.endswith(".glb"):
            (tmp_path / name).write_bytes(glb([{"mesh": 0}], [corners(cube(2.0))]))
        elif name.endswith(".3mf"):
            write_3mf(tmp_path / name, cube(2.0), of_file)
        else:
            write_off(tmp_path / name, cube(2.0))
        text = STUDY.replace("UNIT", unit).replace("MODEL", name)
        (tmp_path / "s.toml").write_text(
            text.replace('max_edge = "off"', f'max_edge = "off"\n{scene}')
        )
        return load_study(tmp_path / "s.toml")

    return load


def side(study) -> float:
    return float(np.ptp(study.models[0].bounds[:, 0]))


@pytest.mark.parametrize(
    ("name", "of_file", "unit", "expected"),
    [
        ("a.glb", None, "m", 2), ("a.glb", None, "mm", 2000), ("a.glb", None, "in", 2000 / 25.4),
        ("a.3mf", "millimeter", "mm", 2), ("a.3mf", "inch", "mm", 50.8), ("a.3mf", "inch", "in", 2),
        ("a.3mf", "micron", "mm", 0.002), ("a.3mf", "meter", "cm", 200),
        ("a.3mf", "foot", "m", 0.6096),
        ("a.3mf", "centimeter", "mm", 20), ("a.3mf", None, "m", 0.002),
        ("a.off", None, "mm", 2), ("a.off", None, "m", 2),
    ],
)  # fmt: skip
def test_a_format_that_says_its_unit_is_believed(loaded, name, of_file, unit, expected):
    assert side(loaded(name, unit, of_file)) == pytest.approx(expected, rel=1e-12)


@pytest.mark.parametrize("name", ["a.glb", "a.3mf"])
def test_scale_goes_before_the_unit_of_a_file(loaded, name):
    assert side(loaded(name, "cm", "inch", scene="scale = 3")) == pytest.approx(6)


def test_gltf_is_y_up_unless_the_study_says_otherwise(loaded, tmp_path):
    assert loaded("a.glb", "m").up.tolist() == [0, 1, 0]
    assert loaded("a.3mf", "mm").up.tolist() == [0, 0, 1]
    text = (tmp_path / "s.toml").read_text().replace("a.3mf", "a.glb")
    (tmp_path / "s.toml").write_text("up = [0, 0, 1]\n" + text)
    assert load_study(tmp_path / "s.toml").up.tolist() == [0, 0, 1]
    assert own_up([tmp_path / "a.glb", tmp_path / "b.stl"]) == "z"


@pytest.mark.parametrize("content", [b"", b"PK", b"PK\x03\x04 broken"])
def test_unit_of_a_broken_3mf_is_left_to_its_reader(tmp_path, content):
    (tmp_path / "a.3mf").write_bytes(content)
    assert mm_per_own_unit(tmp_path / "a.3mf") == 1


@pytest.mark.parametrize(
    ("size", "unit", "guess"),
    [
        (5.76, "mm", ["in", "m"]),  # a CAD part of 146 mm in inches, or a truck in metres
        (2.1, "mm", ["m", "in"]),
        (0.55, "mm", ["m"]),  # a robot's link
        (0.066, "mm", ["m"]),  # a connector
        (300.0, "m", ["in", "mm"]),  # an arm
        (120.0, "mm", []), (12.0, "m", []), (5.0, "in", []), (11.0, "mm", []), (95.0, "m", []),
        (1e-5, "mm", []),  # nothing would be plausible
    ],
)  # fmt: skip
def test_units_that_a_size_makes_more_likely(size, unit, guess):
    assert unit_guess(size, unit) == guess


def test_the_guess_is_a_question_with_sizes():
    assert guess_words(5.76, ["in", "m"]) == "are these inches (146 mm) or metres (5.76 m)?"
    assert guess_words(0.9997, ["m"]) == "are these metres (1 m)?"
    assert guess_words(0.55, ["m"]) == "are these metres (550 mm)?"


@pytest.mark.parametrize("at", [0.0, 0.02, 0.5, 0.9])
def test_a_3mf_of_which_the_packed_bytes_are_damaged_is_refused_in_one_line(tmp_path, at):
    """Inflating fails in a way of its own, zlib.error, wherever the file is opened first."""
    path = tmp_path / "part.3mf"
    write_3mf(path, icosphere(3), "inch")
    rng = np.random.default_rng(1)
    with zipfile.ZipFile(path) as archive:
        texts = {name: archive.read(name) for name in archive.namelist()}
    with zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED) as archive:
        for name, text in texts.items():
            archive.writestr(name, text)
    with zipfile.ZipFile(path) as archive:
        model = max(archive.infolist(), key=lambda member: member.compress_size)
    data = bytearray(path.read_bytes())
    begin = model.header_offset + 30 + len(model.filename)
    first = begin + int(at * model.compress_size)
    data[first : first + 40] = rng.bytes(40)
    path.write_bytes(data)
    assert mm_per_own_unit(path) in (1.0, 25.4)
    with pytest.raises(ValueError, match="cannot be read as 3MF: "):
        load_model(path)
