"""What ``tolerance`` finds, in sentences and tables."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np

from glvis.cli.terminal import table
from glvis.problem.pieces import noun_of_shares
from glvis.results.mounting import DECIMALS, setting_of_pose
from glvis.results.tolerance import AXES, Floats, Worth, without_each, worth
from glvis.search.placement import Placement

_MOST_ROWS = 5


def spread_lines(
    placement: Placement, found: Sequence[Worth], position: float, angle_deg: float
) -> Iterator[str]:
    """Yield mean, 5th percentile and worst of randomly disturbed layouts."""
    unit, kind = placement.study.unit, placement.study.objective.label
    yield (
        f"{len(found)} layouts, every sensor up to {position:.4g} {unit} off along each axis and "
        f"{angle_deg:g} deg in tilt, pan and roll, spread evenly"
    )
    planned = worth(placement)
    coverage = 100 * np.array([one.coverage for one in found])
    value = np.array([one.value for one in found])
    rows = [("as planned", f"{100 * planned.coverage:.2f}", f"{planned.value:.4f}")]
    for name, of in (
        ("mean", np.mean),
        ("5th percentile", lambda v: np.percentile(v, 5)),
        ("worst", np.min),
    ):
        rows.append((name, f"{of(coverage):.2f}", f"{of(value):.4f}"))
    yield from table(("", f"{_noun(placement)} seen %", kind), rows)


def sensitivity_lines(
    placement: Placement, losses: Floats, position: float, angle_deg: float
) -> Iterator[str]:
    """Yield the most sensitive sensors and axes; losses (S, 6) as ``single_errors`` gives."""
    unit = placement.study.unit
    yield "Most sensitive: coverage lost when one sensor alone is off along one axis"
    order = np.argsort(-losses, axis=None, kind="stable")[:_MOST_ROWS]
    rows = []
    for s, axis in zip(*np.unravel_index(order, losses.shape), strict=True):
        error = f"{position:.4g} {unit}" if axis < 3 else f"{angle_deg:g} deg"
        lost = f"{100 * losses[s, axis]:.2f}"
        rows.append((placement.study.sensor_names[s], AXES[axis], error, lost))
    yield from table(("sensor", "axis", "error", "lost %"), rows)


def loss_lines(placement: Placement) -> Iterator[str]:
    """Yield what is left with each sensor lost in turn."""
    kind, noun = placement.study.objective.label, _noun(placement)
    planned = worth(placement)
    yield "With one sensor lost"
    rows = [("none", f"{100 * planned.coverage:.2f}", "", f"{planned.value:.4f}")]
    for name, left in zip(placement.study.sensor_names, without_each(placement), strict=True):
        change = f"{100 * (left.coverage - planned.coverage):+.2f}"
        rows.append((name, f"{100 * left.coverage:.2f}", change, f"{left.value:.4f}"))
    yield from table(("lost", f"{noun} seen %", "change", kind), rows)


def rounding_lines(planned: Placement, rounded: Placement) -> Iterator[str]:
    """Yield the poses one can drill and what they cost."""
    unit, up = planned.study.unit, planned.study.up
    places = DECIMALS.get(unit, 2) + 1
    kind = planned.study.objective.label
    before, after = worth(planned), worth(rounded)
    noun = _noun(planned)
    yield f"Rounded poses [{unit}, deg]; pan, tilt and roll as in mounting.txt"
    rows = []
    for name, pose in zip(planned.study.sensor_names, rounded.camera_to_world, strict=True):
        setting = setting_of_pose(pose, up)
        angles = (setting.pan_deg, setting.tilt_deg, setting.roll_deg)
        numbers = [_short(v, places) for v in pose[:3, 3]] + [_short(v, 3) for v in angles]
        rows.append((name, *numbers))
    yield from table(("sensor", "x", "y", "z", "pan", "tilt", "roll"), rows)
    yield (
        f"They see {100 * after.coverage:.2f} % of the {noun} instead of "
        f"{100 * before.coverage:.2f} %; {kind} = {after.value:.4f} instead of {before.value:.4f}"
    )


def _noun(placement: Placement) -> str:
    """Return of what shares are told."""
    return noun_of_shares(placement.study.models, placement.study.objective.by_area)


def _short(value: float, places: int) -> str:
    """Return a number without zeros at its end."""
    text = f"{value:.{places}f}".rstrip("0").rstrip(".")
    return "0" if text == "-0" else text
