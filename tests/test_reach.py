"""What can be reached at best: closed forms, and that nobody else's numbers depend on it."""

import json
import math
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from support import shapes
from support.ball_and_ring import SMALL, write_ball_and_ring

from glvis.cli.app import main
from glvis.cli.explain_words import explain_lines
from glvis.evaluation.evaluator import Evaluator
from glvis.reports.report import page_data
from glvis.results.explain import REASONS, unseen_reasons
from glvis.results.reading import read_result
from glvis.results.within_reach import reach_rows
from glvis.search.placement import evaluate_poses, place_sensors
from glvis.search.reach import Sampler, _Samples
from glvis.study.loading import load_study

MANY = 10**9  # maps


def eye(field_deg, pixels, far):
    """Return the table of a sensor with a square field of view."""
    return f"""
[sensor.eye]
hfov_deg = {field_deg}
vfov_deg = {field_deg}
resolution = [{pixels}, {pixels}]
max_distance = {far}
"""


RING = """
[scene]
models = ["ball.off"]
max_edge = "off"
[[mount]]
name = "A"
sensor = "eye"
ring = { axis = "z", radius = 2, angle_deg = { min = 0, max = 360, periodic = true }, height = 1 }
aim = [0, 0, 0]
[objective]
kind = "of1"
""" + eye(90, 256, 10)

BOX = """
[scene]
models = ["box.off"]
max_edge = "off"
obstacles = ["wall.off"]
[[mount]]
name = "A"
sensor = "eye"
position = [{ min = -6, max = 6 }, { min = -6, max = 6 }, { min = 0.5, max = 8 }]
aim = [0, 0, 0.5]
[[mount]]
name = "B"
sensor = "eye"
position = [{ min = -6, max = 6 }, { min = 2, max = 6 }, 0.5]
aim = [0, 0, 0.5]
[swarm]
particles = 100
iterations = 2
""" + eye(120, 128, 50)


@pytest.fixture
def study(tmp_path, rng):
    return load_study(write_ball_and_ring(tmp_path, rng))


@pytest.fixture
def box(tmp_path) -> Path:
    """A box on the floor, far behind it a wall that only hides."""
    shapes.write_off(tmp_path / "box.off", shapes.cube(1.0, center=(0, 0, 0.5)))
    shapes.write_off(tmp_path / "wall.off", shapes.cube(1.0, center=(0, 20, 0.5)))
    (tmp_path / "box.toml").write_text(BOX)
    return tmp_path / "box.toml"


def reach_of(study, most_maps=MANY):
    maps = evaluate_poses(study).maps
    with Evaluator(study) as evaluator:
        return Sampler().reach(evaluator, maps, most_maps)


@pytest.mark.parametrize(("subdivisions", "allowed"), [(3, 0.03), (5, 0.01)])
def test_a_ring_reaches_the_band_of_a_ball_that_its_tangents_enclose(
    tmp_path, subdivisions, allowed
):
    shapes.write_off(tmp_path / "ball.off", shapes.icosphere(subdivisions))
    (tmp_path / "ring.toml").write_text(RING)
    study = load_study(tmp_path / "ring.toml")
    reach = reach_of(study)
    # From a distance d above latitude ``at``, latitudes up to acos(r / d) off it are seen.
    at, half = math.atan2(1, 2), math.acos(1 / math.hypot(2, 1))
    band = (math.sin(min(at + half, math.pi / 2)) - math.sin(at - half)) / 2
    row = reach_rows(study.models, evaluate_poses(study).maps, reach)[0]
    assert row.area_percentage / 100 == pytest.approx(band, abs=allowed)
    seen = study.models[0].centroids[:, 2][reach.sensors[0] > 0]
    assert seen.min() == pytest.approx(math.sin(at - half), abs=3 * allowed)


def test_the_bottom_of_a_box_on_the_floor_is_out_of_reach(box):
    study = load_study(box)
    reach = reach_of(study)
    # A circles: all but the bottom (the faces 8, 9). B stays at y >= 2 and below the top: the
    # side +y (6, 7) always, and one of the sides -x, +x (0 to 3) where it stands beside them.
    expected = np.array([2, 2, 2, 2, 1, 1, 2, 2, 0, 0, 1, 1])
    assert np.array_equal(reach.sensors[0], expected)
    row = reach_rows(study.models, evaluate_poses(study).maps, reach)[0]
    assert row.percentage == pytest.approx(100 * 10 / 12)
    assert row.area_percentage == pytest.approx(100 * 5 / 6)
    assert row.shares_by == pytest.approx((10 / 12, 6 / 12))


def test_what_a_layout_sees_of_it_is_its_part_of_what_can_be_seen(box):
    study = load_study(box)
    placement = evaluate_poses(study, position=[4, 0, 0.5, 0, 4])  # sees +x and +y
    with Evaluator(study) as evaluator:
        reach = Sampler().reach(evaluator, placement.maps, MANY)
    row = reach_rows(study.models, placement.maps, reach)[0]
    assert row.seen_of_it == pytest.approx(100 * 4 / 10)
    assert row.area_seen_of_it == pytest.approx(100 * 2 / 5)


def test_sampling_goes_on_while_a_doubling_adds_and_ends_at_the_budget(study):
    maps_a_position = 4
    whole = reach_of(study)
    assert whole.positions in {128, 256, 512, 1024} and whole.growth < 0.005
    assert whole.maps_rendered == maps_a_position * whole.positions
    some = reach_of(study, maps_a_position * 70)
    assert some.positions == 70
    few = reach_of(study, maps_a_position * 10 + 3)
    assert few.positions == 10 and few.growth > 0
    for less, more in ((few, some), (some, whole)):
        for a, b in zip(less.sensors, more.sensors, strict=True):
            assert (a <= b).all()
    assert reach_of(study, maps_a_position - 1) is None


class After:
    """Somebody who interrupts when asked for the n-th time and later."""

    def __init__(self, asked):
        self.left = asked

    def __len__(self):
        self.left -= 1
        return int(self.left < 0)


def test_what_is_asked_to_end_keeps_what_it_has(study):
    maps = evaluate_poses(study).maps
    with Evaluator(study) as evaluator:
        assert Sampler().reach(evaluator, maps, MANY, After(6)).positions == 6
        assert Sampler().reach(evaluator, maps, MANY, ["Ctrl-C"]) is None


@pytest.mark.parametrize("workers", [2, 3])
def test_reach_is_the_same_for_any_number_of_workers(study, workers):
    alone = place_sensors(study, sampler=Sampler()).reach
    together = place_sensors(study, sampler=Sampler(), workers=workers).reach
    for one, other in zip(alone.sensors, together.sensors, strict=True):
        assert np.array_equal(one, other)
    for name in ("positions", "maps_rendered", "growth"):
        assert getattr(alone, name) == getattr(together, name)


def test_reach_costs_apart_and_is_the_same_after_a_break(study, tmp_path):
    class Broken(Exception):
        pass

    def broken(progress):
        raise Broken

    plain, unbroken = place_sensors(study), place_sensors(study, sampler=Sampler())
    assert plain.reach is None
    assert plain.maps_rendered == unbroken.maps_rendered
    assert 0 < unbroken.reach.maps_rendered <= plain.maps_rendered
    path = tmp_path / "checkpoint.npz"
    with pytest.raises(Broken):
        place_sensors(study, checkpoint=path, on_iteration=broken)
    again = place_sensors(study, checkpoint=path, resume=True, sampler=Sampler()).reach
    assert again.maps_rendered == unbroken.reach.maps_rendered
    for one, other in zip(again.sensors, unbroken.reach.sensors, strict=True):
        assert np.array_equal(one, other)


def test_other_seeds_of_a_search_are_held_against_the_same_positions(tmp_path, rng):
    path = write_ball_and_ring(tmp_path, rng, SMALL.replace("iterations = 4", "iterations = 0"))
    one, other = (place_sensors(load_study(path, [f"swarm.seed={n}"]), sampler=Sampler()).reach
                  for n in (1, 2))  # fmt: skip
    assert one.positions == other.positions == 6
    # no more than what the two layouts themselves see may differ
    for a, b in zip(one.sensors, other.sensors, strict=True):
        assert (np.abs(a - b) <= 2).all() and (a == b).mean() > 0.9


@pytest.fixture
def sampled(monkeypatch):
    """How many positions each sampling has tried."""
    tried, go_on = [], _Samples.go_on

    def counted(samples, *arguments):
        before = samples.tried
        go_on(samples, *arguments)
        tried.append(samples.tried - before)

    monkeypatch.setattr(_Samples, "go_on", counted)
    return tried


def assert_same_reach(one, other):
    for name in ("positions", "maps_rendered", "growth"):
        assert getattr(one, name) == getattr(other, name)
    for first, second in zip(one.sensors, other.sensors, strict=True):
        assert np.array_equal(first, second)


def test_searches_of_one_study_sample_once_and_find_what_each_would_alone(study, sampled):
    sampler = Sampler()
    longer = ["swarm.iterations=40", "objective.kind=of1"]
    studies = [
        load_study(study.path, one) for one in (["swarm.iterations=19"], ["swarm.seed=8"], longer)
    ]
    found = [place_sensors(one, sampler=sampler).reach for one in studies]
    assert sum(sampled) == max(reach.positions for reach in found)
    sampled.clear()
    for one, reach in zip(studies, found, strict=True):
        assert_same_reach(place_sensors(one, sampler=Sampler()).reach, reach)
    assert sum(sampled) == sum(reach.positions for reach in found)
    assert len({reach.positions for reach in found}) > 1


@pytest.mark.parametrize(
    "change",
    ["sensor.eye.max_distance=5", "mount.B.roll_deg=20", "visibility.criterion=centroid"],
)
def test_what_another_study_sampled_is_of_no_use(study, sampled, change):
    sampler, other = Sampler(), load_study(study.path, [change])
    place_sensors(study, sampler=sampler)
    assert_same_reach(
        place_sensors(other, sampler=sampler).reach, place_sensors(other, sampler=Sampler()).reach
    )
    assert len(sampled) >= 3


def test_it_is_said_before_something_is_sampled_and_only_then(study):
    said = []
    sampler = Sampler(lambda: said.append(len(sampler._known)))
    for iterations in (19, 19, 0):
        place_sensors(load_study(study.path, [f"swarm.iterations={iterations}"]), sampler=sampler)
    assert said == [1]


def test_an_interrupted_sampling_is_gone_on_with(study):
    sampler, maps = Sampler(), evaluate_poses(study).maps
    with Evaluator(study) as evaluator:
        some = sampler.reach(evaluator, maps, MANY, After(6))
        assert some.positions == 6
        rest = sampler.reach(evaluator, maps, 4 * 100)
    # what was rendered in one go before the interruption is thrown away, and counts
    alone = reach_of(study, 4 * 100)
    assert_same_reach(replace(rest, maps_rendered=alone.maps_rendered), alone)


def test_no_more_is_kept_than_there_is_room_for(study, sampled, monkeypatch):
    sampler, other = Sampler(), load_study(study.path, ["mount.B.roll_deg=20"])
    for one in (study, other, study):
        place_sensors(one, sampler=sampler)
    assert len(sampler._known) == 2
    monkeypatch.setattr("glvis.search.reach._BYTES", 0)
    before = sum(sampled)
    place_sensors(other, sampler=sampler)
    assert len(sampler._known) == 1 and sum(sampled) == before
    place_sensors(study, sampler=sampler)
    assert len(sampler._known) == 1 and sum(sampled) > before


def test_a_series_samples_once_a_point(box, tmp_path, sampled):
    out = tmp_path / "out"
    many = ["--vary", "sensor.eye.max_distance=40,50", "--repeats", "2", "--no-pictures"]
    assert main(["optimize", str(box), "-o", str(out), "--workers", "1", *many]) == 0
    told = [json.loads(path.read_text())["reach"] for path in sorted(out.glob("run-*/result.json"))]
    assert [one["positions"] for one in told] == [128] * 4
    assert sum(sampled) == 2 * 128


def test_reach_is_told_in_the_result_on_the_page_on_the_terminal_and_by_explain(
    box, tmp_path, capsys
):
    out = tmp_path / "out"
    assert main(["optimize", str(box), "-o", str(out), "--workers", "1", "--no-pictures"]) == 0
    printed = capsys.readouterr().out
    assert "Within reach is what some allowed pose sees" in printed
    assert "reachable %" in printed and " 83.3 " in printed
    told = json.loads((out / "result.json").read_text())["reach"]
    assert told["models"][0]["percentage"] == pytest.approx(100 * 10 / 12)
    assert told["models"][0]["share_by"] == {"2": 0.5}
    again = read_result(out)
    assert np.array_equal(again.reach.sensors[0][8:10], [0, 0])
    assert again.reach.positions == told["positions"] == 128
    table = page_data(again).tables[1]
    assert table.title == "Within reach" and table.rows[0][1] == pytest.approx(100 * 10 / 12)
    reasons = unseen_reasons(again)[0]
    assert [REASONS[k] for k in reasons[8:10]] == ["out of reach"] * 2
    assert np.count_nonzero(reasons == REASONS.index("out of reach")) == 2
    words = "\n".join(explain_lines(again))
    assert "16.7 % out of reach" in words and "no allowed pose sees it, 128 positions" in words


def test_where_nobody_looked_nothing_is_told(study, capsys):
    placement = evaluate_poses(study)
    assert placement.reach is None
    assert [table.title for table in page_data(placement).tables] == [
        "Faces seen",
        "Sensors",
        "How good the views are",
    ]
    assert "out of reach" not in "\n".join(explain_lines(placement))
