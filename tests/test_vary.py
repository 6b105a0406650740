"""A study becomes a list of runs, each an ordinary study; what cannot be run is named first."""

import dataclasses
import itertools
import tomllib
from pathlib import Path

import pytest
from support.two_cubes import SMALL, write_two_cubes

from glvis.errors import StudyError
from glvis.results.vary import key_label, plan_runs
from glvis.study.loading import load_study

SCENES = Path(__file__).resolve().parents[1] / "scenes"
VARY = """
[vary]
mounts = [1, 2]
swarm.particles = [4, 6, 8]
"""


@pytest.fixture
def planned(tmp_path):
    """Plan the runs of the small study with some text at its end."""

    def plan(text="", *options, repeats=1, overrides=()):
        path = write_two_cubes(tmp_path, SMALL + text)
        return plan_runs(load_study(path, overrides), overrides, options, repeats)

    return plan


def studies(plan, path):
    return [load_study(path, run.settings) for run in plan.runs]


def test_several_keys_are_a_grid_and_each_run_is_an_ordinary_study(planned, tmp_path):
    plan = planned(VARY)
    assert [point.values for point in plan.points] == [
        {"mounts": n, "swarm.particles": p} for n, p in itertools.product([1, 2], [4, 6, 8])
    ]
    assert [run.name for run in plan.runs] == [f"run-0{k}" for k in range(1, 7)]
    for point, study in zip(plan.points, studies(plan, tmp_path / "study.toml"), strict=True):
        assert study.swarm.particles == point.values["swarm.particles"]
        assert study.sensor_names == (
            ("A", "B") if point.values["mounts"] == 1 else ("A", "B", "C")
        )
        assert study.title == f"Two cubes ({point.label})"
        assert (point.sensors, point.variables) == (study.sensors, 1)
        assert point.run_maps == study.swarm.particles * 3 * len(study.sensors) * 2
        assert "vary" not in tomllib.loads(study.text)


@pytest.mark.parametrize(
    ("text", "options"),
    [
        ("", ["mount.*.sensor=eye,kinect-v2"]),
        ("", ["mount.*.sensor=['eye', 'kinect-v2']"]),
        ("[vary]\n'mount.*.sensor' = ['eye', 'kinect-v2']\n", []),
    ],
)
def test_a_star_varies_every_mount(planned, tmp_path, text, options):
    plan = planned(text, *options)
    assert [point.label for point in plan.points] == [
        "mount.*.sensor = 'eye'", "mount.*.sensor = 'kinect-v2'",
    ]  # fmt: skip
    eyes, kinects = studies(plan, tmp_path / "study.toml")
    assert eyes.rig.sensor_kinds == ("eye",) * 3
    assert kinects.rig.sensor_kinds == ("kinect-v2",) * 3


def test_repeats_have_the_seeds_that_follow_and_more_of_them_come_last(planned, tmp_path):
    few, many = planned(VARY, repeats=2), planned(VARY, repeats=3)
    assert many.runs[: len(few.runs)] == few.runs
    assert [run.seed for run in many.runs] == [1] * 6 + [2] * 6 + [3] * 6
    kept = studies(many, tmp_path / "study.toml")
    assert [study.swarm.seed for study in kept] == [run.seed for run in many.runs]
    assert {run.seed for run in planned(repeats=2, overrides=["swarm.seed=7"]).runs} == {7, 8}


def test_repeats_alone_leave_the_study_as_it_is_but_for_the_seed(planned, tmp_path):
    plan = planned(repeats=2)
    assert not plan.vary and [run.point.values for run in plan.runs] == [{}, {}]
    second = studies(plan, tmp_path / "study.toml")[1]
    assert second.text == load_study(tmp_path / "study.toml", ["swarm.seed=2"]).text


@pytest.mark.parametrize(
    ("text", "options"),
    [
        ("[vary]\nobjective.kind = ['of1', 'of2']", []),
        ("[vary]\n'objective.kind' = ['of1', 'of2']", []),
        ("[vary.objective]\nkind = ['of1', 'of2']", []),
        ("", ["objective.kind=of1,of2"]),
        ("", ["objective.kind='of1', 'of2'"]),
        ("[vary]\nobjective.kind = ['of3']", ["objective.kind=of1,of2"]),
    ],
)
def test_a_key_may_be_written_in_several_ways(planned, text, options):
    assert dict(planned(text, *options).vary) == {"objective.kind": ["of1", "of2"]}


def test_any_value_may_change(planned, tmp_path):
    plan = planned(
        "[vary]\nscene.models = [['cube.off'], ['cube.off', 'small.off']]\n"
        "mount.A.position.1 = [3, {min = 1, max = 4}]\n'sensor.eye.resolution' = [[32, 32]]\n"
    )
    found = studies(plan, tmp_path / "study.toml")
    assert [len(study.models) for study in found] == [1, 1, 2, 2]
    assert [len(study.variables) for study in found] == [1, 2, 1, 2]
    assert {study.sensors[0].resolution for study in found} == {(32, 32)}


def test_option_with_one_list_in_brackets_means_its_entries(planned):
    assert planned("", "mounts=[1, 2]").vary == {"mounts": [1, 2]}
    assert planned("", "swarm.inertia=[0.1,1],[0.2,1]").vary == {
        "swarm.inertia": [[0.1, 1], [0.2, 1]]
    }


def test_first_mounts_of_the_kitchen_are_the_kitchen_with_fewer(tmp_path):
    four, two = (load_study(SCENES / f"kitchen-{n}.toml") for n in (4, 2))
    cut = load_study(SCENES / "kitchen-4.toml", ["mounts=2", f'title="{two.title}"'])
    assert (cut.sensor_names, cut.variables) == (two.sensor_names, two.variables)
    assert tomllib.loads(cut.text) == tomllib.loads(two.text)
    assert "# Sec. 3.2: as many faces" in cut.text and len(four.sensors) == 4


def test_variables_of_the_mounts_that_went_go_with_them_and_others_stay():
    cut = load_study(SCENES / "arm.toml", ["mounts=1"])
    assert cut.sensor_names == ("A1", "C1")
    assert {v.name for v in cut.variables} == {
        "z1", "alpha1", "panA1", "A1.direction.elevation_deg", "A1.roll_deg",
    }  # fmt: skip
    assert load_study(SCENES / "arm.toml", ["mounts=4"]).variables == (
        load_study(SCENES / "arm.toml").variables
    )


@pytest.mark.parametrize(
    ("variables", "kept"),
    [('a = "b"\nb = {min=1, max=2}', {"b"}), ("a = 2\nb = {min=1, max=2}", set())],
)
def test_variable_stays_where_another_one_needs_it(tmp_path, variables, kept):
    text = SMALL.replace("{ min = 2, max = 6, start = 3 }", '"a"')
    text = text.replace("roll_deg = 30", 'roll_deg = "b"') + f"[variables]\n{variables}\n"
    cut = load_study(write_two_cubes(tmp_path, text), ["mounts=1"])
    assert {v.name for v in cut.variables} == kept


def test_overrides_hold_for_every_run_and_varied_keys_go_before_them(planned, tmp_path):
    plan = planned(VARY, overrides=["mount.A.roll_deg=5", "swarm.particles=99"])
    assert [point.run_maps for point in plan.points] == [48, 72, 96, 72, 108, 144]


# text at the end of the study, options, repeats: the line after the study's path
WRONG = {
    "no list": ("[vary]\nmounts = 2", [], 1, "[vary] mounts = 2 must be a list of values, as"),
    "empty": ("[vary]\nmounts = []", [], 1, "[vary] mounts = [] must hold at least one value"),
    "twice": ("[vary]\nmounts = [1, 2, 1]", [], 1, "[vary] mounts = [1, 2, 1] holds 1 twice"),
    "too many mounts": (
        "[vary]\nmounts = [2, 3]", [], 1,
        "[vary] with mounts = 3: override 'mounts=3' must be a whole number from 1 to 2, the",
    ),
    "unknown table": (
        "[vary]\nswam.particles = [4]", [], 1,
        "[vary] with swam.particles = 4: override 'swam.particles=4' is unknown: there is no",
    ),
    "unknown key": (
        "", ["swarm.particle=4,5"], 1,
        "[vary] with swarm.particle = 4: [swarm] unknown key 'particle'; did you mean 'particles'",
    ),
    "value not allowed": (
        "[vary]\nmounts = [1]\nobjective.kind = ['of1', 'of4']", [], 1,
        "[vary] with mounts = 1, objective.kind = 'of4': [objective] kind = 'of4' must be 'of1',",
    ),
    "seed and repeats": (
        "[vary]\nswarm.seed = [1, 2]", [], 2,
        "[vary] swarm.seed: repeats have seeds of their own; take one of the two",
    ),
    "nothing to search": (
        "[vary]\nmount.A.position.0 = [3, 4]", [], 2,
        "there is nothing to search, so that all repeats would be the same; free a number by",
    ),
}  # fmt: skip


@pytest.mark.parametrize("kind", WRONG)
def test_wrong_table_is_named(planned, tmp_path, kind):
    text, options, repeats, fact = WRONG[kind]
    with pytest.raises(StudyError) as error:
        planned(text, *options, repeats=repeats)
    assert str(error.value).startswith(f"{tmp_path / 'study.toml'}: {fact}")


@pytest.mark.parametrize(
    ("option", "fact"),
    [
        ("mounts", "--vary 'mounts' must have the form KEY=VALUE,VALUE,..."),
        ("mounts=", "--vary 'mounts=' must have the form KEY=VALUE,VALUE,..."),
        ("mounts=2,2", "--vary mounts = [2, 2] holds 2 twice"),
        ("mounts=[]", "--vary mounts = [] must hold at least one value"),
    ],
)
def test_wrong_option_is_named(planned, option, fact):
    with pytest.raises(StudyError) as error:
        planned("", option)
    assert str(error.value) == fact


@pytest.mark.parametrize("count", ["0", "3", "-1", "two", "1.5", "true"])
def test_wrong_number_of_mounts_is_named(tmp_path, count):
    path = write_two_cubes(tmp_path)
    with pytest.raises(StudyError) as error:
        load_study(path, [f"mounts={count}"])
    fact = (
        "must be a whole number from 1 to 2, the study's mounts "
        "([[mount]] tables; a mirror goes with its mount)"
    )
    assert str(error.value) == f"{path}: override 'mounts={count}' {fact}"


def test_study_with_varied_keys_is_loaded_as_it_stands(tmp_path):
    path = write_two_cubes(tmp_path, SMALL + VARY)
    study = load_study(path)
    plain = load_study(write_two_cubes(tmp_path))
    assert study.vary == {"mounts": [1, 2], "swarm": {"particles": [4, 6, 8]}}
    assert tomllib.loads(study.text) == tomllib.loads(plain.text)
    assert dataclasses.replace(study.swarm) == plain.swarm
    assert load_study(path, ["vary.mounts=[1]"]).vary["mounts"] == [1]


def test_labels_carry_units_where_they_are_known():
    labels = {
        "mounts": "number of mounts",
        "sensor.d415.max_incidence_deg": "sensor.d415.max_incidence [deg]",
        "sensor.d415.max_distance": "sensor.d415.max_distance [mm]",
        "mount.A.position.2": "mount.A.position.2 [mm]",
        "swarm.particles": "swarm.particles",
    }
    assert {key: key_label(key, "mm") for key in labels} == labels


def test_the_varied_keys_that_the_arm_study_explains_can_be_run(tmp_path):
    text = (SCENES / "arm.toml").read_text()
    head, mark, tail = text.partition("# [vary]")
    path = tmp_path / "arm.toml"
    path.write_text(head + (mark + tail).replace("# ", ""))
    overrides = [f"scene.models=['{SCENES / 'arm1.stl'}']", "scene.obstacles=[]"]
    plan = plan_runs(load_study(path, overrides), overrides)
    assert [len(point.sensors) for point in plan.points] == [4, 4, 4, 6, 6, 6, 8, 8, 8]
