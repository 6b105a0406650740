"""What a sensor may be."""

import math

import pytest

from glvis.problem.lens import Pinhole
from glvis.problem.sensor import Sensor


def sensor(**changes):
    settings = {
        "name": "test",
        "lens": Pinhole.from_degrees(90, 60),
        "resolution": (640, 480),
        "min_distance": 100,
        "max_distance": 500,
        "max_incidence": math.radians(70),
    }
    return Sensor(**(settings | changes))


def test_min_distance_may_be_zero_and_incidence_goes_up_to_edge_on_by_default():
    plain = Sensor("p", Pinhole.from_degrees(90, 60), (1, 1), 0, 1)
    assert plain.max_incidence == math.pi / 2


def test_focal_length_in_pixels_makes_half_the_image_of_the_half_angle():
    assert sensor().focal_pixels() == pytest.approx((320, 240 * math.sqrt(3)))
    assert sensor().focal_pixels((64, 48)) == pytest.approx((32, 24 * math.sqrt(3)))


@pytest.mark.parametrize(
    ("near", "far"), [(-1, 5), (5, 5), (6, 5), (0, 0), (0, math.inf), (math.nan, 5), (0, math.nan)]
)
def test_distances_out_of_order_are_refused(near, far):
    with pytest.raises(ValueError) as error:
        sensor(min_distance=near, max_distance=far)
    assert str(error.value) == (
        f"min_distance = {near:g} and max_distance = {far:g} "
        "must satisfy 0 <= min_distance < max_distance"
    )


@pytest.mark.parametrize("degrees", [0, -5, 91, math.nan])
def test_incidence_limit_outside_0_to_90_is_refused(degrees):
    with pytest.raises(ValueError) as error:
        sensor(max_incidence=math.radians(degrees))
    assert str(error.value) == f"max_incidence_deg = {degrees:g} must lie in (0, 90]"


@pytest.mark.parametrize("resolution", [(0, 480), (640, -1)])
def test_resolution_without_pixels_is_refused(resolution):
    with pytest.raises(ValueError) as error:
        sensor(resolution=resolution)
    assert str(error.value) == f"resolution = {list(resolution)} must be at least [1, 1]"
