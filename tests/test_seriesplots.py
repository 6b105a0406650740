"""The plots of a series hold what they should: every run, means, deviations, whatever is varied."""

import numpy as np
import pytest
from PIL import Image

from glvis.pictures.seriesplots import Line, Panel, TracedRun, write_repeats, write_vary

BLUE, ORANGE, PALE, AMBER = (0, 114, 178), (213, 94, 0), (159, 184, 204), (230, 159, 0)
SIZE = (800, 500)


def pixels(path, color, within=16) -> np.ndarray:
    """Return where a picture has a colour, rows and columns."""
    picture = np.array(Image.open(path).convert("RGB")).astype(int)
    assert picture.shape == (SIZE[1], SIZE[0], 3)
    return np.argwhere(np.abs(picture - color).max(axis=2) < within)


def plot_of(path, lines, **options):
    x = lines[0].x
    options = {"x_label": "n", "ticks": [(place, f"{place:g}") for place in x]} | options
    write_vary(path, [Panel("v [%]", lines), Panel("w", lines)], title="t", size=SIZE, **options)
    return path


def traced(seed, value, n=20):
    best = value * (1 - np.exp(-np.arange(n)))
    return TracedRun(f"run-{seed:02d}", seed, range(0, 10 * n, 10), best, value, 5 * value)


def test_repeats_show_the_best_run_the_others_and_their_mean(tmp_path):
    path = tmp_path / "r.png"
    runs = [traced(seed, 10 + seed % 3) for seed in range(1, 11)]
    write_repeats(path, runs, title="t", quantity="OF3", size=SIZE)
    for color in (BLUE, ORANGE, PALE):
        assert len(pixels(path, color)) > 100


@pytest.mark.parametrize("n", [0, 1, 20])
def test_one_run_of_any_length_can_be_shown(tmp_path, n):
    path = tmp_path / "r.png"
    write_repeats(path, [traced(1, 3.0, n)], title="t", quantity="OF1", size=SIZE)
    assert len(pixels(path, PALE)) < 20 and len(pixels(path, ORANGE)) > 20


def test_series_without_runs_has_no_plot(tmp_path):
    with pytest.raises(ValueError, match="a series without runs cannot be plotted"):
        write_repeats(tmp_path / "r.png", [], title="", quantity="")


def test_values_of_any_order_make_one_line_from_left_to_right(tmp_path):
    values = {2: [4.0], 3: [5.0], 4: [9.0], 7: [9.5]}
    first, second = (
        plot_of(tmp_path / f"{k}.png", [Line("", x, [values[n] for n in x])]).read_bytes()
        for k, x in enumerate(([2, 3, 4, 7], [7, 3, 2, 4]))
    )
    assert len(first) > 1000 and first == second


def test_places_without_runs_are_left_out(tmp_path):
    whole = plot_of(tmp_path / "a.png", [Line("", [1, 2, 3], [[1.0], [2.0], [3.0]])])
    part = plot_of(tmp_path / "b.png", [Line("", [1, 2, 3], [[1.0], [2.0], []])])
    none = plot_of(tmp_path / "c.png", [Line("", [1, 2, 3], [[], [], []])])
    counts = [len(pixels(path, BLUE)) for path in (whole, part, none)]
    assert counts[0] > 0 and counts[1] > 0 and counts[2] == 0


def test_repeats_of_varied_values_have_bars_and_dots(tmp_path):
    one = plot_of(tmp_path / "a.png", [Line("", [1, 2], [[1.0], [1.0]])])
    many = plot_of(tmp_path / "b.png", [Line("", [1, 2], [[0.5, 1.5], [0.9, 1.1]])])
    rows = [np.unique(pixels(path, BLUE, 120)[:, 0]).size for path in (one, many)]
    assert rows[1] > rows[0] + 100  # the line is level, the bars are not


def test_each_line_of_a_grid_has_its_color_and_name(tmp_path):
    lines = [Line(f"a = {k}", [1, 2], [[1.0 * k], [2.0 * k]]) for k in (1, 2)]
    path = plot_of(tmp_path / "a.png", lines)
    for color in (BLUE, AMBER):
        found = pixels(path, color)
        assert len(found) > 50
        assert found[:, 0].min() < 0.1 * SIZE[1]  # in the legend over the panels


def test_words_are_not_joined_and_far_numbers_are_spread_evenly(tmp_path):
    x = [0, 1, 2]
    lines = [Line("", x, [[1.0], [2.0], [1.5]])]
    ticks = [(0, "of1"), (1, "a word that is long enough to be set askew"), (2, "of3")]
    words = plot_of(tmp_path / "a.png", lines, ticks=ticks, are_numbers=False)
    joined = plot_of(tmp_path / "b.png", lines)
    assert 20 < len(pixels(words, BLUE)) < len(pixels(joined, BLUE)) / 2
    far = plot_of(tmp_path / "c.png", [Line("", [1, 10, 100], [[1.0], [2.0], [1.5]])])
    near = np.unique(pixels(joined, BLUE)[:, 1])
    assert np.abs(np.percentile(near, [0, 100]) - np.percentile(
        np.unique(pixels(far, BLUE)[:, 1]), [0, 100])).max() < 25  # fmt: skip


def test_a_single_value_can_vary(tmp_path):
    assert len(pixels(plot_of(tmp_path / "a.png", [Line("", [3], [[1.0, 1.1]])]), BLUE)) > 20
