"""Study files: what they mean, and one bad file a rule with its exact message."""

import dataclasses
import math
import tomllib
from pathlib import Path

import numpy as np
import pytest
from support.shapes import cube, icosphere

from glvis.errors import StudyError
from glvis.problem.mounts import Variable
from glvis.problem.objective import OVERLAP_WEIGHTS, TERM_WEIGHTS
from glvis.problem.search_options import SearchOptions
from glvis.problem.swarm_options import SwarmOptions
from glvis.problem.units import MM_PER_UNIT
from glvis.problem.visibility_options import VisibilityOptions
from glvis.study.loading import load_study
from glvis.study.schema import SwarmTable, VisibilityTable

# The format as its contract shows it, with meshes that are here.
STUDY = """\
title = "Arm scanner, eight D415 on two rings"
unit = "mm"
up = [0, 1, 0]

[scene]
models = ["ball.off", "box.off"]         # each on its own; the objective is aggregated
max_edge = "off"
obstacles = ["holder.off"]               # hide, are never counted
# scale = 1.0

[sensor.d415]
hfov_deg = 66.4
vfov_deg = 39.5
resolution = [1280, 720]
min_distance = 160
max_distance = 350
max_incidence_deg = 70

[visibility]
criterion = "pixels"                     # or "centroid"
min_pixels = 1
resolution = "auto"                      # or [w, h], or "sensor"
incidence = "ray"                        # or "axis"
occlusion = "physical"                   # or "paper"
# semantics = "paper"

[variables]
z1     = { min = 60, max = 240, start = 136 }
alpha1 = { min = 5, max = 85, start = 45 }
turn   = { min = 0, max = 360, periodic = true }
el     = "turn - 10"

[[mount]]
name = "A1"
sensor = "d415"
ring = { axis = "z", radius = 300, angle_deg = "-alpha1", height = "z1" }
direction = { azimuth_deg = { min = 90, max = 225, start = 135 }, elevation_deg = "el" }
roll_deg = { min = -90, max = 90, start = 0 }
mirror = { plane = "yz", name = "C1" }   # a second sensor, mirrored

[[mount]]
name = "K1"
sensor = "kinect-v2"
position = [{ min = 0, max = 3000, start = 1500 }, 1200, "z1 + 300"]
direction = { azimuth_deg = 10, elevation_deg = -20 }
roll_deg = 0

[objective]
kind = "of3"                             # of1, of2, of3
weights = "set1"
by_area = false
normalize = true
aggregate = "mean"                       # min, cvar

[swarm]
particles = 300
iterations = 200
stall_iterations = 30
tolerance = 1e-3
inertia = [0.2, 1.5]
min_neighbors_fraction = 0.4
initial_span = 20
objective_limit = 15.0                   # optional
max_seconds = 3600                       # optional
seed = 1
"""

FIXED = """\
[scene]
models = ["ball.off"]
max_edge = "off"
[[mount]]
name = "A"
sensor = "d415-buonamici"
position = [0, 0, 300]
aim = [0, 0, 0]
"""


def off(shape) -> str:
    vertices, faces = shape
    rows = [f"{x!r} {y!r} {z!r}" for x, y, z in vertices.tolist()]
    rows += [f"3 {a} {b} {c}" for a, b, c in faces.tolist()]
    return "\n".join([f"OFF {len(vertices)} {len(faces)} 0", *rows])


@pytest.fixture
def folder(tmp_path):
    """A folder with meshes to name in a study."""
    (tmp_path / "ball.off").write_text(off(icosphere(1, radius=100)))
    (tmp_path / "box.off").write_text(off(cube(100.0)))
    (tmp_path / "empty.stl").touch()
    (tmp_path / "sub").mkdir()
    (tmp_path / "sensors.off").write_text(off(cube()))
    (tmp_path / "sub/ball.off").write_text(off(cube()))
    (tmp_path / "holder.off").write_text(off(cube(20.0, center=(200, 0, 0))))
    return tmp_path


@pytest.fixture
def load(folder):
    """Write a study and load it."""

    def write_and_load(text, *overrides):
        path = folder / "arm.toml"
        path.write_text(text, encoding="utf-8")
        return load_study(path, overrides)

    return write_and_load


def test_the_contract_is_read_as_it_means(load, folder):
    study = load(STUDY)
    assert study.path == folder / "arm.toml"
    assert study.title == "Arm scanner, eight D415 on two rings"
    assert study.unit == "mm"
    np.testing.assert_array_equal(study.up, [0, 1, 0])
    assert [m.name for m in study.models] == ["ball", "box"]
    assert [m.name for m in study.obstacles] == ["holder"]
    assert study.sensor_names == ("A1", "C1", "K1")
    d415, twin, kinect = study.sensors
    assert d415 is twin
    assert math.degrees(d415.lens.hfov) == pytest.approx(66.4)
    assert math.degrees(d415.lens.vfov) == pytest.approx(39.5)
    assert (d415.name, d415.resolution) == ("d415", (1280, 720))
    assert (d415.min_distance, d415.max_distance) == (160, 350)
    assert math.degrees(d415.max_incidence) == pytest.approx(70)
    assert (kinect.name, kinect.max_distance) == ("kinect-v2", 4500)  # from the catalogue
    assert study.variables == (
        Variable("z1", 60, 240, 136),
        Variable("alpha1", 5, 85, 45),
        Variable("turn", 0, 360, 180, periodic=True),
        Variable("A1.direction.azimuth_deg", 90, 225, 135),
        Variable("A1.roll_deg", -90, 90, 0),
        Variable("K1.position.x", 0, 3000, 1500),
    )
    assert study.visibility == VisibilityOptions()
    assert (study.objective.w_tot, study.objective.w_of1, study.objective.w_of2) == (1, 2, 1)
    assert study.objective.overlap == OVERLAP_WEIGHTS["set1"]
    assert study.swarm == SwarmOptions(objective_limit=15.0, max_seconds=3600)
    places = study.rig.poses(study.rig.start)[:, :3, 3]
    leg = 300 * math.sqrt(0.5)
    np.testing.assert_allclose(places, [[leg, -leg, 136], [-leg, -leg, 136], [1500, 1200, 436]])


def test_a_study_may_leave_out_almost_everything(load):
    study = load(FIXED)
    assert study.variables == () and study.obstacles == ()
    assert (study.title, study.unit, study.up.tolist()) == ("arm", "mm", [0, 0, 1])
    assert study.swarm == SwarmOptions() and study.visibility == VisibilityOptions()
    assert study.rig.poses(study.rig.start).shape == (1, 4, 4)


def test_without_a_word_auto_searches_what_sees_most_of_the_area(load):
    study = load(FIXED)
    objective = study.objective
    assert (objective.kind, objective.by_area, objective.aggregate) == ("of1", True, "mean")
    assert study.search == SearchOptions("auto")
    assert study.assumed == ("objective.kind", "objective.by_area", "search.method")
    # the study as run says it, so that no later default changes what a result means
    tables = tomllib.loads(study.text)
    assert tables["objective"] == {"kind": "of1", "by_area": True}
    assert tables["search"] == {"method": "auto"}


def test_only_what_the_file_leaves_open_is_assumed(load):
    study = load(FIXED + '[objective]\nkind = "of3"\n', "search.method=swarm")
    assert study.assumed == ("objective.by_area",)
    assert (study.objective.kind, study.search.method) == ("of3", "swarm")


@pytest.mark.parametrize(
    ("unit", "reach"), [("mm", 350), ("cm", 35), ("m", 0.35), ("inch", 13.7795), ("ft", 1.148294)]
)
def test_catalogue_sensors_come_in_the_unit_of_the_study(load, unit, reach):
    (sensor,) = load(f'unit = "{unit}"\n' + FIXED).sensors
    assert sensor.max_distance == pytest.approx(reach, rel=1e-5)
    assert sensor.min_distance == pytest.approx(reach * 160 / 350, rel=1e-5)


def test_a_sensor_of_the_file_goes_before_the_catalogue(load):
    table = "[sensor.d415-buonamici]\nhfov_deg = 90\nvfov_deg = 60\nresolution = [64, 48]\n"
    table += "max_distance = 9\n"
    (sensor,) = load(FIXED + table).sensors
    assert (sensor.min_distance, sensor.max_distance, sensor.resolution) == (0, 9, (64, 48))
    assert sensor.max_incidence == pytest.approx(math.pi / 2)


def test_scale_is_for_models_and_obstacles(load):
    study = load(STUDY.replace("# scale = 1.0", "scale = 10"))
    np.testing.assert_allclose(study.models[1].bounds, [[-500] * 3, [500] * 3])
    np.testing.assert_allclose(study.obstacles[0].bounds[:, 0], [1900, 2100])


def test_an_assembly_is_one_model_of_all_files_in_their_order(load, folder):
    ball, box = load(STUDY).models
    study = load(STUDY.replace("# scale = 1.0", 'assembly = "robot"\nflip = ["box"]'))
    (whole,) = study.models
    assert (whole.name, whole.n_faces) == ("robot", ball.n_faces + box.n_faces)
    expected = np.concatenate([ball.vertices[ball.faces], box.vertices[box.faces[:, [0, 2, 1]]]])
    assert np.array_equal(whole.vertices[whole.faces], expected)
    assert whole.parts == tuple((folder / f"{name}.off").resolve() for name in ("ball", "box"))


def test_flip_turns_the_normals_of_models_and_keeps_the_order_of_faces(load):
    normals = [model.normals for model in load(STUDY).models]
    for flip, signs in (("true", (-1, -1)), ("false", (1, 1)), ("['box']", (1, -1))):
        turned = load(STUDY.replace("# scale = 1.0", f"flip = {flip}"))
        for model, before, sign in zip(turned.models, normals, signs, strict=True):
            np.testing.assert_allclose(model.normals, sign * before, atol=1e-12)
    assert np.array_equal(turned.obstacles[0].faces, load(STUDY).obstacles[0].faces)


def test_globs_are_sorted_and_may_stand_beside_names(load, folder):
    for name in ("arm10", "arm2", "arm1"):
        (folder / f"{name}.off").write_text(off(cube()))
    study = load(FIXED.replace('"ball.off"', '"ball.off", "arm*.off"'))
    assert [m.name for m in study.models] == ["ball", "arm1", "arm10", "arm2"]
    assert study.models[1].path == folder / "arm1.off"


def test_a_file_whose_name_looks_like_a_glob_is_found(load, folder):
    (folder / "part[1].off").write_text(off(cube()))
    assert load(FIXED.replace("ball", "part[1]")).models[0].name == "part[1]"


def test_meshes_are_looked_for_beside_the_study_and_not_where_one_stands(
    folder, monkeypatch, tmp_path_factory
):
    (folder / "arm.toml").write_text(FIXED)
    monkeypatch.chdir(folder.parent)
    assert load_study(f"{folder.name}/arm.toml").models[0].path == folder / "ball.off"


def test_a_direction_may_be_a_vector_and_a_mirror_any_plane(load):
    mounts = FIXED.replace("aim = [0, 0, 0]", "direction = [-0.82, 0.55, -0.14]")
    study = load(mounts + 'mirror = { point = [1, 0, 0], normal = [2, 0, 0], name = "B" }\n')
    one, twin = study.rig.poses([])
    np.testing.assert_allclose(twin[:3, 3], [2, 0, 300])
    np.testing.assert_allclose(twin[:3, 2], one[:3, 2] * [-1, 1, 1], atol=1e-12)


def test_weights_come_by_name_or_one_by_one(load):
    objective = load(FIXED + '[objective]\nweights = "set2"\nw_of1 = 7\n').objective
    assert (objective.w_tot, objective.w_of1, objective.w_of2) == (1, 7, TERM_WEIGHTS["set2"][2])
    assert objective.overlap == OVERLAP_WEIGHTS["set2"]
    objective = load(
        FIXED + '[objective]\nkind = "of2"\noverlap = [1, 5]\naggregate = "cvar"\n'
        "cvar_fraction = 0.3\nby_area = true\nnormalize = false\n"
    ).objective
    assert (objective.kind, objective.overlap) == ("of2", (1, 5))
    assert (objective.aggregate, objective.cvar_fraction) == ("cvar", 0.3)
    assert objective.by_area and not objective.normalize


@pytest.mark.parametrize(
    ("table", "expected"),
    [
        ('semantics = "paper"', VisibilityOptions.paper()),
        ('semantics = "paper"\nresolution = [64, 48]', VisibilityOptions.paper((64, 48))),
        ('resolution = "sensor"', VisibilityOptions(resolution="sensor")),
        (
            'criterion = "centroid"\nincidence = "axis"\nocclusion = "paper"\nmin_pixels = 3',
            VisibilityOptions("centroid", 3, "auto", "axis", "paper"),
        ),
    ],
)
def test_visibility_options_are_those_of_the_table(load, table, expected):
    assert load(FIXED + f"[visibility]\n{table}\n").visibility == expected


def test_tables_have_the_fields_of_their_options():
    for table, options in ((SwarmTable, SwarmOptions), (VisibilityTable, VisibilityOptions)):
        assert list(table.model_fields) == [field.name for field in dataclasses.fields(options)]


def bad_studies():
    """Yield the cases of bad_studies.txt: old text, new text, message."""
    cases = Path(__file__).with_name("bad_studies.txt").read_text().split("\n\n")[1:]
    for case in cases:
        old, new, message = (line[2:] for line in case.strip().split("\n"))
        yield pytest.param(old, new.replace("\\n", "\n"), message, id=new or f"no {old}")


@pytest.mark.parametrize(("old", "new", "message"), list(bad_studies()))
def test_a_bad_study_ends_in_one_exact_line(load, folder, old, new, message):
    assert old in STUDY
    with pytest.raises(StudyError) as caught:
        load(STUDY.replace(old, new, 1))
    expected = f"{folder / 'arm.toml'}: {message.replace('FOLDER', str(folder))}"
    assert str(caught.value) == expected


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("", "[scene] is missing"),
        ("scene = 3", "scene = 3 must be a table"),
        ('[scene]\nmodels = ["ball.off"]', "[[mount]] is missing"),
        ('mount = []\n[scene]\nmodels = ["ball.off"]', "mount = [] must hold at least one mount"),
        (
            'mount = [3]\n[scene]\nmodels = ["ball.off"]',
            "[[mount]] number 1 must be a table, got 3",
        ),
        (FIXED + "[[mount]]\n", "[[mount]] number 2 'name' is missing"),
        (FIXED + "roll_deg = 1e", "is no TOML: "),
        (FIXED + "x = " + "[" * 5000, "is no TOML: nested too deeply"),
        (FIXED + "roll_deg = 1979-05-27", "[[mount]] 'A' roll_deg = 1979-05-27 must be a number, "),
        (FIXED + "roll_deg = 1" + "0" * 400, "must be a number"),
        (FIXED + "[swarm]\ninertia = [1, 2, 3]", "[swarm] inertia = [1, 2, 3] must be [low, high]"),
        (
            FIXED + "[swarm]\nparticles = 1" + "0" * 30,
            "must be at most 10000",
        ),
        (FIXED + "[swarm]\nseed = 1" + "0" * 400, "0000... must be at most 9223372036854775807"),
        (FIXED + "[sensor.x]\n", "[sensor.x] 'resolution' is missing"),
        (
            FIXED.replace("d415-buonamici", "d415-buonamicci"),
            "sensor = 'd415-buonamicci' is unknown; did you mean 'd415-buonamici'?; 'gl",
        ),
        (
            FIXED.replace("d415-buonamici", "d514"),
            "[[mount]] 'A' sensor = 'd514' is unknown; 'glvis sensors' lists the catalogue",
        ),
    ],
)
def test_studies_torn_apart_end_in_one_line(load, text, message):
    with pytest.raises(StudyError) as caught:
        load(text)
    assert message in str(caught.value)
    assert "\n" not in str(caught.value)


def test_a_study_that_is_no_text_file_says_so(folder):
    with pytest.raises(StudyError, match=r"none\.toml: does not exist$"):
        load_study(folder / "none.toml")
    with pytest.raises(StudyError, match=r"cannot be read: Is a directory$"):
        load_study(folder)
    (folder / "latin.toml").write_bytes(b'title = "\xfcbung"')
    with pytest.raises(
        StudyError, match=r"latin\.toml: is no text in UTF-8 \(byte 9\); save it as UTF-8$"
    ):
        load_study(folder / "latin.toml")


def test_a_broken_mesh_is_named_with_what_is_wrong(load, folder):
    (folder / "cut.stl").write_bytes(b"\0" * 80 + (12).to_bytes(4, "little") + b"\0" * 50)
    with pytest.raises(StudyError) as caught:
        load(FIXED.replace("ball.off", "cut.stl"))
    cut = folder / "cut.stl"
    assert str(caught.value) == (
        f"{folder / 'arm.toml'}: [scene] {cut} is cut short: it promises 12 faces and holds 1"
    )


def test_semantics_of_the_paper_go_before_single_choices(load):
    study = load(STUDY, "visibility.semantics=paper", "visibility.min_pixels=4")
    assert study.visibility == dataclasses.replace(VisibilityOptions.paper(), min_pixels=4)


@pytest.mark.parametrize(
    ("override", "line"),
    [
        ("swarm.particles=100", "particles = 100"),
        ("swarm.seed = 7", "seed = 7"),
        ("sensor.d415.max_distance=400", "max_distance = 400"),
        ("objective.weights=set2", 'weights = "set2"'),
        ('objective.weights="set2"', 'weights = "set2"'),
        ("title=hello world", 'title = "hello world"'),
        ("mount.A1.roll_deg=3", "roll_deg = 3"),
        ("mount.A1.roll_deg.start=3", "roll_deg = { min = -90, max = 90, start = 3 }"),
        ("mount.1.roll_deg=3", "roll_deg = 3"),
        ("mount.K1.position.0=3", 'position = [3, 1200, "z1 + 300"]'),
        ("variables.z1=100", "z1     = 100"),
        ("variables.z1={min=1, max=300}", "z1     = { min = 1, max = 300 }"),
        ("variables.turn.max=720", "turn   = { min = 0, max = 720, periodic = true }"),
        ("swarm.max_seconds=1e3", "max_seconds = 1000.0"),
    ],
)
def test_overrides_go_before_the_file_and_into_the_text_as_run(load, override, line):
    before, after = (load(STUDY, *overrides).text.splitlines() for overrides in ((), (override,)))
    assert len(before) == len(after)
    (changed,) = [(old, new) for old, new in zip(before, after, strict=True) if old != new]
    assert changed[1].partition("#")[0].strip() == line
    assert changed[1].partition("#")[2] == changed[0].partition("#")[2]


def test_a_star_stands_for_every_mount(load):
    study = load(STUDY, "mount.*.sensor=kinect-v2", "mount.*.roll_deg=5", "mount.K1.roll_deg=7")
    assert study.rig.sensor_kinds == ("kinect-v2",) * 3
    tables = tomllib.loads(study.text)["mount"]
    assert [(mount["sensor"], mount["roll_deg"]) for mount in tables] == [
        ("kinect-v2", 5), ("kinect-v2", 7),
    ]  # fmt: skip


@pytest.mark.parametrize(
    ("length", "unit", "plain"),
    [("200 mm", "mm", 200), ("20cm", "mm", 200), ("0.2 m", "mm", 200), ("1e1 in", "mm", 254),
     ("200 mm", "m", 0.2), ("1 ft", "in", 12), ("+25.4 mm", "inch", 1)],
)  # fmt: skip
def test_lengths_may_carry_a_unit_of_their_own(load, length, unit, plain):
    text = STUDY.replace('unit = "mm"', f'unit = "{unit}"')
    text = text.replace("max_distance = 350", f'max_distance = "{length}"')
    text = text.replace("min_distance = 160", "min_distance = 0")
    text = text.replace("radius = 300", f'radius = "{length}"')
    text = text.replace("min = 60, max = 240, start = 136", f'min = -1, max = "{length}"')
    study = load(text)
    assert study.sensors[0].max_distance == pytest.approx(plain)
    assert study.variables[0].max == pytest.approx(plain)
    place = study.rig.poses(study.rig.start)[0, :3, 3]
    assert np.hypot(place[0], place[1]) == pytest.approx(plain)
    assert f'max_distance = "{length}"' in study.text  # as the user wrote it
    changed = load(STUDY, f"sensor.d415.max_distance={length}", "sensor.d415.min_distance=0")
    assert changed.sensors[0].max_distance == pytest.approx(
        plain * MM_PER_UNIT[unit] / MM_PER_UNIT["mm"]
    )


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ("max_distance = 350", 'max_distance = "350 furlongs"', "must be a number"),
        ("max_distance = 350", 'max_distance = "1e999 mm"', "must be a number"),
        ("hfov_deg = 66.4", 'hfov_deg = "66 mm"', "must be a number"),
        ("azimuth_deg = { min = 90, max", 'azimuth_deg = { min = "90 mm", max', "must be a number"),
    ],
)
def test_only_lengths_carry_a_unit(load, old, new, message):
    assert old in STUDY
    with pytest.raises(StudyError, match=message):
        load(STUDY.replace(old, new))


def test_overrides_reach_the_types(load):
    study = load(
        STUDY,
        "swarm.particles=100",
        "sensor.d415.max_distance=400",
        "visibility.criterion=centroid",
        "objective.weights=set2",
        "variables.z1=100",
        "mount.K1.position.0=7",
    )
    assert study.swarm.particles == 100
    assert study.sensors[0].max_distance == 400
    assert study.visibility.criterion == "centroid"
    assert study.objective.overlap == OVERLAP_WEIGHTS["set2"]
    assert "z1" not in [v.name for v in study.variables]
    np.testing.assert_allclose(study.rig.poses(study.rig.start)[2, :3, 3], [7, 1200, 400])


def test_an_override_opens_a_table_that_the_file_leaves_out(load):
    study = load(FIXED, "swarm.particles=12", "sensor.d415-buonamici.max_distance=400", "title=t")
    assert study.swarm.particles == 12
    (sensor,) = study.sensors
    assert (sensor.min_distance, sensor.max_distance) == (160, 400)
    tables = tomllib.loads(study.text)
    assert tables["title"] == "t" and tables["swarm"] == {"particles": 12}
    assert tables["sensor"]["d415-buonamici"]["hfov_deg"] == 66.4


@pytest.mark.parametrize(
    ("override", "message"),
    [
        ("swarm.particles", "override 'swarm.particles' must have the form KEY=VALUE"),
        ("=3", "override '=3' has no key that TOML could read: ''"),
        ("a b=3", "override 'a b=3' has no key that TOML could read: 'a b'"),
        (
            "swarms.x=3",
            "override 'swarms.x=3' is unknown: there is no 'swarms' in a study; did you mean",
        ),
        ("swarm.particels=1", "[swarm] unknown key 'particels'; did you mean 'particles'?"),
        ("swarm.particles=ten", "[swarm] particles = 'ten' must be a whole number"),
        ("swarm.particles=", "[swarm] particles = '' must be a whole number"),
        ("swarm=3", "swarm = 3 must be a table"),
        (
            "sensor.d514.max_distance=4",
            "override 'sensor.d514.max_distance=4' leads nowhere: sensor 'd514' is unknown; 'gl",
        ),
        (
            "sensor.kinect-v2.max=1",
            "[sensor.kinect-v2] unknown key 'max'; known are lens, hfov_deg, ",
        ),
        ("mount.*=3", "override 'mount.*=3' has a '*' that stands for no mounts; it is for mou"),
        ("swarm.*=3", "override 'swarm.*=3' has a '*' that stands for no mounts; it is for mou"),
        (
            "mount.Q.roll_deg=3",
            "override 'mount.Q.roll_deg=3' is unknown: there is no 'Q' in mount; there are A1, K1",
        ),
        (
            "mount.K1.position.5=3",
            "override 'mount.K1.position.5=3' is unknown: there is no '5' in mount.K1.position; th",
        ),
        (
            "mount.A1.position.x=3",
            "override 'mount.A1.position.x=3' is unknown: there is no 'position' in mount.A1",
        ),
        ("mount.A1.position=[1, 2, 3]", "[[mount]] 'A1' needs either 'ring' or 'position'"),
        (
            "variables.z2=100",
            "override 'variables.z2=100' is unknown: there is no 'z2' in variables",
        ),
        ("title.x=3", "override 'title.x=3' leads nowhere: 'title' is no table"),
        (
            "mount.A1.roll_deg.start=300",
            "[[mount]] 'A1' roll_deg: start = 300 must lie in [-90, 90]",
        ),
    ],
)
def test_overrides_that_lead_nowhere_are_refused(load, folder, override, message):
    with pytest.raises(StudyError) as caught:
        load(STUDY, override)
    assert str(caught.value).startswith(f"{folder / 'arm.toml'}: {message}")


def test_the_text_as_run_is_the_same_study_wherever_it_lies(load, folder, tmp_path_factory):
    first = load(STUDY.replace('"box.off"', '"b?x.off"'), "swarm.seed=9", "variables.z1.start=99")
    moved = tmp_path_factory.mktemp("result") / "study.toml"
    moved.write_text(first.text, encoding="utf-8")
    again = load_study(moved)
    assert again.text == first.text
    assert [m.path for m in again.models] == [folder / "ball.off", folder / "box.off"]
    assert again.swarm == first.swarm and again.variables == first.variables
    np.testing.assert_array_equal(
        again.rig.poses(again.rig.start), first.rig.poses(first.rig.start)
    )


def test_the_text_as_run_keeps_comments(load):
    text = load(STUDY, "swarm.particles=100").text
    for line in STUDY.splitlines():
        if "#" in line:
            assert line.split("#", 1)[1] in text


def test_a_study_whose_tables_are_torn_apart_keeps_its_values(load):
    torn = """[scene]
models = ["ball.off"]
[swarm]
seed = 3
[[mount]]
name = "A"
sensor = "b"
position = [0, 0, 300]
aim = [0, 0, 0]
[sensor.b]
hfov_deg = 60
vfov_deg = 40
resolution = [64, 48]
max_distance = 900
[visibility]
min_pixels = 2
"""
    study = load(
        torn, "sensor.b.max_distance=800", "sensor.d415-buonamici.max_distance=5000", "swarm.seed=4"
    )
    tables = tomllib.loads(study.text)
    assert tables["sensor"]["b"]["max_distance"] == 800
    assert tables["sensor"]["d415-buonamici"]["max_distance"] == 5000
    assert (tables["swarm"]["seed"], tables["visibility"]["min_pixels"]) == (4, 2)


def test_a_study_that_cannot_be_edited_in_place_is_written_anew(load):
    table = "hfov_deg = 60, vfov_deg = 40, resolution = [64, 48], max_distance = 900"
    inline = f"sensor = {{ b = {{ {table} }} }}  # in one line\n" + FIXED
    study = load(inline, "sensor.d415-buonamici.max_distance=400")
    assert study.sensors[0].max_distance == 400
    tables = tomllib.loads(study.text)
    assert tables["sensor"]["b"]["max_distance"] == 900
    assert tables["sensor"]["d415-buonamici"]["max_distance"] == 400


def test_the_arm_study_reads_the_real_arms(load, shared_data):
    study = load(
        FIXED.replace("ball.off", f"{shared_data}/arms/arm*.stl"),
        f'scene.obstacles=["{shared_data}/arms/holder.stl"]',
    )
    assert [m.name for m in study.models] == [f"arm{i}" for i in range(1, 7)]
    assert sum(m.n_faces for m in study.models) > 48_000
