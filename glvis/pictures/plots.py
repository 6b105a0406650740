"""The search as a plot: best and mean value over the evaluations.

The only module that talks to matplotlib, which is slow to load and therefore loaded late.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from glvis.common.palette import OKABE_ITO
from glvis.search.trace import TraceRow

_DPI = 200


def write_convergence(
    path: Path,
    trace: Sequence[TraceRow],
    *,
    title: str,
    quantity: str,
    start_value: float | None = None,
    upper_bound: float = math.inf,
    size: tuple[int, int] = (1600, 1000),
) -> None:
    """Write the plot of a search as PNG.

    Parameters
    ----------
    path : Path
        The file.
    trace : sequence
        At least one step.
    title, quantity : str
        Over the plot and along the value axis.
    start_value : float, optional
        Value of the user's start.
    upper_bound : float
        No value can be larger; drawn where finite.
    size : tuple of int
        Pixels (width, height).
    """
    if not trace:
        raise ValueError("a search without steps cannot be plotted")
    evaluations = np.array([row.evaluations for row in trace], dtype=float)
    best = np.array([row.best for row in trace], dtype=float)
    mean = np.array([row.mean for row in trace], dtype=float)
    figure = new_figure(size)
    axes = figure.add_subplot()
    blue, orange = OKABE_ITO[0], OKABE_ITO[5]
    marker = "o" if len(trace) < 25 else None
    axes.plot(evaluations, best, color=blue, lw=2.2, marker=marker, ms=4, label="best so far")
    axes.plot(
        evaluations,
        mean,
        color=orange,
        lw=1.4,
        ls="--",
        marker=marker,
        ms=3,
        label="mean of each iteration",
    )
    if start_value is not None and math.isfinite(start_value):
        axes.axhline(start_value, color="0.35", lw=1.2, ls=":", label=f"start: {start_value:.4g}")
    if math.isfinite(upper_bound):
        axes.axhline(
            upper_bound, color="0.35", lw=1.2, ls="-.", label=f"upper bound: {upper_bound:.4g}"
        )
    axes.annotate(
        f"{best[-1]:.4g}",
        (evaluations[-1], best[-1]),
        xytext=(-4, 6),
        textcoords="offset points",
        ha="right",
        color=blue,
        fontweight="bold",
    )
    axes.set_xlabel("evaluations of the objective")
    axes.set_ylabel(quantity)
    axes.set_title(title, loc="left", fontweight="bold", fontsize=11, parse_math=False)
    parted_thousands(axes)
    dress(axes)
    axes.margins(x=0.01)
    axes.legend(frameon=False, loc="lower right")
    figure.savefig(path, format="png")


def new_figure(size: tuple[int, int]) -> Any:
    """Return an empty figure of so many pixels (width, height), its text as large as they allow."""
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    dpi = _DPI * min(size[0] / 1600, size[1] / 1000)
    figure = Figure(figsize=(size[0] / dpi, size[1] / dpi), dpi=dpi, layout="constrained")
    FigureCanvasAgg(figure)
    return figure


def dress(axes: Any) -> None:
    """Give axes a pale grid behind the data and no box around it."""
    axes.grid(True, color="0.9", lw=0.8)
    axes.set_axisbelow(True)
    for side in ("top", "right"):
        axes.spines[side].set_visible(False)


def parted_thousands(axes: Any) -> None:
    """Write large numbers along x as 12,000."""
    axes.xaxis.set_major_formatter(lambda value, _: f"{value:,.0f}")
