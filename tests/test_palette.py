"""Colours keep apart, also for colour-blind readers, and keep their meaning."""

import numpy as np
import pytest

from glvis.common.palette import (
    OBSTACLE_COLOR,
    OVERLAP_COLORS,
    SEEN_COLOR,
    UNSEEN_COLOR,
    hex_color,
    overlap_colors,
    rgb,
    sensor_colors,
)

# Machado, Oliveira and Fernandes 2009, Table 1, severity 1; on linear RGB.
NORMAL = np.eye(3)
PROTAN = np.array(
    [[0.152286, 1.052583, -0.204868], [0.114503, 0.786281, 0.099216],
     [-0.003882, -0.048116, 1.051998]])  # fmt: skip
DEUTAN = np.array(
    [[0.367322, 0.860646, -0.227968], [0.280085, 0.672501, 0.047413],
     [-0.011820, 0.042940, 0.968881]])  # fmt: skip


def oklab(colors, vision=NORMAL):
    """Ottosson 2020: sRGB bytes (..., 3) to Oklab, as seen with ``vision``."""
    c = np.asarray(colors) / 255
    linear = np.where(c <= 0.04045, c / 12.92, ((c + 0.055) / 1.055) ** 2.4)
    linear = np.clip(linear @ vision.T, 0, 1)
    lms = linear @ np.array(
        [[0.4122214708, 0.5363325363, 0.0514459929], [0.2119034982, 0.6806995451, 0.1073969566],
         [0.0883024619, 0.2817188376, 0.6299787005]]).T  # fmt: skip
    return np.cbrt(lms) @ np.array(
        [[0.2104542553, 0.7936177850, -0.0040720468], [1.9779984951, -2.4285922050, 0.4505937099],
         [0.0259040371, 0.7827717662, -0.8086757660]]).T  # fmt: skip


def nearest(colors, vision):
    lab = oklab(colors, vision)
    apart = np.linalg.norm(lab[:, None] - lab[None], axis=-1)
    return apart[~np.eye(len(lab), dtype=bool)].min()


@pytest.mark.parametrize(("n", "least"), [(7, 0.11), (12, 0.1), (16, 0.06)])
def test_sensors_unseen_faces_and_obstacles_stay_apart(n, least):
    reserved = np.stack([UNSEEN_COLOR, OBSTACLE_COLOR])
    assert nearest(np.vstack([sensor_colors(n), reserved]), NORMAL) > least


@pytest.mark.parametrize("vision", [DEUTAN, PROTAN])
def test_eight_sensors_and_unseen_faces_stay_apart_for_color_blind_readers(vision):
    # Unseen faces carry stripes besides.
    assert nearest(np.vstack([sensor_colors(8), UNSEEN_COLOR[None]]), vision) > 0.045


def test_a_sensor_keeps_its_color_when_others_join():
    assert np.array_equal(sensor_colors(40)[:5], sensor_colors(5))
    assert sensor_colors(0).shape == (0, 3)


def test_forty_sensors_have_forty_colors_and_none_is_that_of_unseen_faces():
    colors = {tuple(c) for c in [*sensor_colors(40).tolist(), UNSEEN_COLOR.tolist()]}
    assert len(colors) == 41


@pytest.mark.parametrize("n", [0, 1, 3, 6, 8, 20])
def test_overlap_starts_with_unseen_and_then_only_darkens(n):
    colors = overlap_colors(n)
    assert colors.shape == (n + 1, 3)
    assert np.array_equal(colors[0], UNSEEN_COLOR)
    assert np.all(np.diff(oklab(colors[1:])[:, 0]) < 0)


def test_a_count_has_the_same_color_whether_three_or_six_sensors_look():
    assert np.array_equal(overlap_colors(3), OVERLAP_COLORS[:4])


def test_seen_faces_are_paler_than_obstacles():
    assert oklab(SEEN_COLOR)[0] > oklab(OBSTACLE_COLOR)[0] + 0.1


def test_hex_text_goes_there_and_back():
    assert hex_color(rgb("#0A72b2")) == "#0A72B2"
