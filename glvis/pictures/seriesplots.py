"""Many runs in one picture: how repeats spread, and what a varied number does."""

from __future__ import annotations

import statistics
from collections.abc import Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from glvis.common.palette import OKABE_ITO, hex_color, sensor_colors
from glvis.pictures.plots import dress, new_figure, parted_thousands

SIZE = (1600, 1000)
_BLUE, _PALE, _ORANGE = OKABE_ITO[0], "#9FB8CC", OKABE_ITO[5]
_LOG_FROM = 30.0  # largest by smallest number from which an axis is logarithmic
_LEAST_GAP = 0.12  # between neighbours, as a share of the axis, for each to have its label
_MOST_LETTERS = 40  # below an axis of half a picture, before they are set askew


class TracedRun(NamedTuple):
    """One run: its name, seed, the best value so far against the maps rendered, its end."""

    name: str
    seed: int
    maps: Sequence[float]
    best: Sequence[float]
    value: float
    percentage: float


class Line(NamedTuple):
    """What changes along one varied key while the others stay.

    ``x`` has K places, ``values`` the numbers of all runs at each of them (none where a run is
    still to come).
    """

    label: str
    x: Sequence[float]
    values: list[list[float]]


class Panel(NamedTuple):
    """One quantity, and its lines."""

    quantity: str
    lines: Sequence[Line]


def write_repeats(
    path: Path,
    runs: Sequence[TracedRun],
    *,
    title: str,
    quantity: str,
    size: tuple[int, int] = SIZE,
) -> None:
    """Write how the runs of one study went, and where they ended, as PNG.

    Parameters
    ----------
    path : Path
        The file.
    runs : sequence of TracedRun
        At least one.
    title, quantity : str
        Over the plot; name of the value.
    size : tuple of int
        Pixels (width, height).
    """
    if not runs:
        raise ValueError("a series without runs cannot be plotted")
    figure = new_figure(size)
    grid = figure.add_gridspec(2, 5)
    axes = figure.add_subplot(grid[:, :3])
    leader = max(runs, key=lambda run: run.value)
    others = [run for run in runs if run is not leader]
    for k, run in enumerate(others):
        label = f"the other {len(others)}" if k == 0 else None
        axes.plot(run.maps, run.best, color=_PALE, lw=1.2, label=label)
    axes.plot(leader.maps, leader.best, color=_BLUE, lw=2.2, label=f"best: {leader.name}", zorder=3)
    axes.set_xlabel("maps rendered")
    axes.set_ylabel(f"best {quantity} so far")
    axes.set_title(title, loc="left", fontweight="bold", fontsize=11, parse_math=False)
    parted_thousands(axes)
    dress(axes)
    axes.margins(x=0.01)
    axes.legend(frameon=False, loc="lower right")
    seeds = [run.seed for run in runs]
    for row, (name, numbers) in enumerate(
        (
            (quantity, [run.value for run in runs]),
            ("faces seen [%]", [run.percentage for run in runs]),
        )
    ):
        _by_seed(figure.add_subplot(grid[row, 3:]), seeds, numbers, leader.seed, name)
    figure.savefig(path, format="png")


def write_vary(
    path: Path,
    panels: Sequence[Panel],
    *,
    title: str,
    x_label: str,
    ticks: Sequence[tuple[float, str]],
    are_numbers: bool = True,
    size: tuple[int, int] = SIZE,
) -> None:
    """Write what a varied number does as PNG: means, standard deviations, single runs.

    Parameters
    ----------
    path : Path
        The file.
    panels : sequence of Panel
        Side by side, with the same lines.
    title, x_label : str
        Over the plot and along x.
    ticks : sequence of (float, str)
        The places along x and what they are called.
    are_numbers : bool
        Whether there is something between two places, so that they may be joined.
    size : tuple of int
        Pixels (width, height).
    """
    figure = new_figure(size)
    figure.suptitle(title, x=0.01, ha="left", fontweight="bold", fontsize=11, parse_math=False)
    several = len(panels[0].lines) > 1
    is_loose = _gap(ticks) >= _LEAST_GAP
    colors = [hex_color(color) for color in sensor_colors(len(panels[0].lines))]
    for axes, panel in zip(figure.subplots(1, len(panels), squeeze=False)[0], panels, strict=True):
        for line, color in zip(panel.lines, colors, strict=True):
            _varied_line(axes, line, color, told=is_loose and not several, joined=are_numbers)
        axes.set_xlabel(x_label)
        axes.set_title(panel.quantity, loc="left", fontsize=10, parse_math=False)
        _scale(axes, ticks, marked=is_loose)
        axes.ticklabel_format(axis="y", useOffset=False)
        dress(axes)
        axes.margins(x=0.12, y=0.12)
    if several:
        handles, labels = axes.get_legend_handles_labels()
        columns = 1 if max(map(len, labels)) > _MOST_LETTERS else 2
        figure.legend(
            handles, labels, frameon=False, loc="outside upper right", fontsize=9, ncols=columns
        )
    most = max(len(found) for panel in panels for line in panel.lines for found in line.values)
    if most > 1:
        figure.supxlabel(
            f"dots: {most} runs with different seeds; line: their mean; bars: standard deviation",
            fontsize=9, color="0.35",
        )  # fmt: skip
    figure.savefig(path, format="png")


def _by_seed(
    axes: Any, seeds: Sequence[int], numbers: Sequence[float], best: int, name: str
) -> None:
    """Draw the ends of all runs, their mean and the standard deviation around it."""
    colors = [_BLUE if seed == best else _PALE for seed in seeds]
    axes.scatter(seeds, numbers, c=colors, s=34, zorder=3)
    mean = statistics.fmean(numbers)
    text = f"mean {mean:.4g}"
    if len(numbers) > 1:
        std = statistics.stdev(numbers)
        axes.axhspan(mean - std, mean + std, color=_ORANGE, alpha=0.13, lw=0)
        text += f", std {std:.2g}"
    axes.axhline(mean, color=_ORANGE, lw=1.4, ls="--")
    axes.set_title(f"{name}: {text}", loc="left", fontsize=10, parse_math=False)
    axes.set_xlabel("seed")
    axes.xaxis.get_major_locator().set_params(integer=True)
    axes.ticklabel_format(axis="y", useOffset=False)
    axes.margins(x=0.08, y=0.2)
    dress(axes)


def _varied_line(axes: Any, line: Line, color: str, *, told: bool, joined: bool) -> None:
    """Draw one line: every run as a dot, means with bars, in numbers where there is room."""
    found = sorted((x, values) for x, values in zip(line.x, line.values, strict=True) if values)
    if not found:
        return
    x = np.array([place for place, _ in found])
    mean = np.array([statistics.fmean(values) for _, values in found])
    std = np.array([statistics.stdev(v) if len(v) > 1 else 0.0 for _, v in found])
    bars = std if std.any() else None
    axes.errorbar(
        x, mean, yerr=bars, color=color, lw=1.8, ls="-" if joined else "", ms=10 if std.any() else
        5, marker="_" if std.any() else "o", capsize=4, elinewidth=1.2, label=line.label,
    )  # fmt: skip
    for place, values in found if std.any() else ():
        axes.scatter([place] * len(values), values, color=color, s=26, alpha=0.45, lw=0, zorder=3)
    if told:
        falls = np.append(np.diff(mean) < 0, False) & joined  # then the line is below
        for place, value, is_above in zip(x, mean, falls, strict=True):
            axes.annotate(
                f"{value:.4g}", (place, value), xytext=(8, 6 if is_above else -12),
                textcoords="offset points",
                color=color, fontweight="bold", fontsize=9,
            )  # fmt: skip


def _gap(ticks: Sequence[tuple[float, str]]) -> float:
    """Return the smallest distance of neighbours along an axis, as a share of the axis."""
    places = np.sort([place for place, _ in ticks])
    if _is_logarithmic(ticks):
        places = np.log(places)
    return float(np.diff(places).min() / np.ptp(places)) if len(places) > 1 else 1.0


def _is_logarithmic(ticks: Sequence[tuple[float, str]]) -> bool:
    places = [place for place, _ in ticks]
    return min(places) > 0 and max(places) >= _LOG_FROM * min(places)


def _scale(axes: Any, ticks: Sequence[tuple[float, str]], *, marked: bool) -> None:
    """Mark the varied values along x; those that span far get a logarithmic scale."""
    if _is_logarithmic(ticks):
        axes.set_xscale("log")
    if not marked:
        return
    axes.minorticks_off()
    is_long = sum(len(name) for _, name in ticks) > _MOST_LETTERS
    axes.set_xticks(
        [place for place, _ in ticks],
        [name for _, name in ticks],
        rotation=30 if is_long else 0,
        ha="right" if is_long else "center",
    )
