"""What a run will cost and how fine its pictures are, before it is run."""

import math
from dataclasses import replace

import numpy as np
import pytest
from support import shapes
from support.two_cubes import SMALL, write_two_cubes

from glvis.problem.lens import Pinhole
from glvis.problem.scene import Model
from glvis.problem.sensor import Sensor
from glvis.search.estimate import Cost, measured_cost, share_below_a_pixel, working_distance
from glvis.search.placement import place_sensors
from glvis.study.loading import load_study

EYE = Sensor("eye", Pinhole.from_degrees(90, 90), (100, 100), 0.0, 20.0)


@pytest.mark.parametrize(
    ("side", "share"),
    # at distance 10 the view is 20 wide: 100 pixels of 0.2; half a square of side s is a face
    [(0.28, 1.0), (0.29, 0.0)],
)
def test_face_below_a_pixel_by_formula(side, share):
    assert working_distance(EYE) == 10
    wall = Model.from_arrays("wall", *shapes.plate(4 * side, cells=(4, 4)))
    assert wall.areas[0] == pytest.approx(side**2 / 2)
    assert share_below_a_pixel(EYE, wall, (100, 100)) == share


def test_finer_pictures_have_fewer_faces_below_a_pixel():
    ball = Model.from_arrays("ball", *shapes.blob(np.random.default_rng(1)))
    shares = [share_below_a_pixel(EYE, ball, (n, n)) for n in (50, 100, 200, 400)]
    assert shares == sorted(shares, reverse=True)
    assert shares[0] > shares[-1]


def test_a_run_renders_no_more_maps_than_it_was_estimated(tmp_path):
    study = load_study(write_two_cubes(tmp_path))
    cost = measured_cost(study, max_seconds=0.05)
    assert cost.maps == 6
    assert cost.run_maps == 4 * 3 * 6  # particles, iterations and the first swarm
    assert place_sensors(study).maps_rendered <= cost.run_maps
    assert cost.samples >= 1
    assert cost.evaluation_seconds > 0


@pytest.mark.parametrize(
    ("table", "run_maps"),
    [
        ('method = "auto"', 4000 * 6),
        ('method = "greedy"\nmax_maps = 50', 50),
        ('method = "swarm"\nmax_maps = 50', 50),
        ('method = "swarm"\nmax_maps = 5000', 72),
    ],
)
def test_budget_of_the_search_counts(tmp_path, table, run_maps):
    text = SMALL.replace('method = "swarm"', table)
    study = load_study(write_two_cubes(tmp_path, text))
    assert measured_cost(study, max_seconds=0.0).run_maps == run_maps


def test_nothing_to_search_costs_nothing(tmp_path):
    text = SMALL.replace("{ min = 2, max = 6, start = 3 }", "3")
    cost = measured_cost(load_study(write_two_cubes(tmp_path, text)), max_seconds=0.0)
    assert (cost.run_maps, cost.run_seconds()) == (0, 0)


def test_time_is_shared_by_workers_and_ends_with_the_studys_own():
    cost = Cost(0.1, 5, 8, 800, math.inf, None)
    assert (cost.run_seconds(), cost.run_seconds(4)) == pytest.approx((10, 2.5))
    assert replace(cost, max_seconds=3).run_seconds() == 3


def test_predictions_are_one_processs_work_and_what_is_within_reach_comes_on_top():
    cost = Cost(0.1, 5, 8, 800, math.inf, None, search_seconds=0.01)
    assert (cost.run_seconds(), cost.run_seconds(4)) == pytest.approx((18, 10.5))
    assert (cost.reach_seconds(), cost.reach_seconds(4)) == pytest.approx((10, 2.5))
    assert replace(cost, max_seconds=3).reach_seconds() == 3


@pytest.mark.parametrize(("method", "predicts"), [("auto", True), ("swarm", False)])
def test_predictions_are_measured_in_a_small_search(tmp_path, method, predicts):
    text = SMALL.replace('method = "swarm"', f'method = "{method}"')
    cost = measured_cost(load_study(write_two_cubes(tmp_path, text)), max_seconds=0.2)
    assert (cost.search_seconds > 0) == predicts


def test_shortest_of_the_studys_times_counts(tmp_path):
    text = SMALL.replace('method = "swarm"', 'method = "swarm"\nmax_seconds = 5')
    path = write_two_cubes(tmp_path, text + "max_seconds = 9\n")
    assert measured_cost(load_study(path), max_seconds=0.0).max_seconds == 5
    shorter = ["swarm.max_seconds=3"]
    assert measured_cost(load_study(path, shorter), max_seconds=0.0).max_seconds == 3
    other = [*shorter, "search.method=greedy"]  # which the swarm's table is not about
    assert measured_cost(load_study(path, other), max_seconds=0.0).max_seconds == 5
