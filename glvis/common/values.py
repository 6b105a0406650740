"""Kinds of single values in a study file, each within its limits; no tables, no files."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Annotated, Any

from pydantic import AfterValidator

from glvis.common.complaints import shortened
from glvis.common.files import in_one_line, is_one_line

LARGEST_IMAGE = 16384  # pixels a side; what any OpenGL 3.3 driver of today renders
# Beyond these nothing is meant, and squares, products or sums leave the range of floats.
FARTHEST, _HEAVIEST = 1e12, 1e9  # lengths, in any unit; weights
_SMALLEST = 1e-12  # length, or angle in degrees
MOST_MOUNTS = 500  # and as many kinds of sensors, and variables
_LONGEST_NAME, _LONGEST_PATH, _LONGEST_TITLE = 100, 4096, 500  # letters
# Beyond these nothing is meant, or memory (the square of the particles), floats or 64 bits run out.
MOST: dict[str, float] = {
    "particles": 10**4,
    "iterations": 10**9,
    "stall_iterations": 10**9,
    "seed": 2**63 - 1,
    "max_maps": 10**12,
    "max_seconds": 1e9,
    "tolerance": 1e9,
    "inertia": 1000.0,
    "min_neighbors_fraction": 1.0,
    "initial_span": FARTHEST,
    "objective_limit": 1e15,
    "cognitive": 1000.0,
    "social": 1000.0,
}


def by_type(tags: Mapping[type, str]) -> Callable[[Any], str | None]:
    """Return what tells kinds of values apart by their type in TOML; whole numbers are floats."""

    def tag(value: Any) -> str | None:
        is_whole = isinstance(value, int) and not isinstance(value, bool)
        return tags.get(float if is_whole else type(value))

    return tag


def within(allowed: str, test: Any) -> AfterValidator:
    """Return a check that says what is allowed where ``test`` of the value is false."""

    def check(value: Any) -> Any:
        if not test(value):
            raise ValueError(f"must {allowed}")
        return value

    return AfterValidator(check)


def at_most(most: float) -> AfterValidator:
    """Return a check that a number, or both of a pair, are not larger; None may be."""

    def is_small(value: Any) -> bool:
        return (max(value) if isinstance(value, tuple) else value or 0) <= most

    return within(
        f"be at most {most:g}" if isinstance(most, float) else f"be at most {most}", is_small
    )


def between(low: float, high: float) -> AfterValidator:
    """Return a check that a number lies between two others, or is one of them."""
    return within(f"lie in [{low:g}, {high:g}]", lambda v: low <= v <= high)


def few(what: str) -> AfterValidator:
    """Return a check that there are not more mounts, sensors or variables than anybody means."""
    return within(f"hold at most {MOST_MOUNTS} {what}", lambda v: len(v) <= MOST_MOUNTS)


Place = Annotated[float, within(f"be at most {FARTHEST:g} in size", lambda v: abs(v) <= FARTHEST)]
Point = Annotated[list[Place], within("have three entries", lambda v: len(v) == 3)]
Axis = Annotated[Point, within("not be zero", lambda v: any(abs(n) > _SMALLEST for n in v))]
Pixels = Annotated[int, within(f"lie in [1, {LARGEST_IMAGE}]", lambda v: 1 <= v <= LARGEST_IMAGE)]
Size = Annotated[list[Pixels], within("be [width, height]", lambda v: len(v) == 2)]
Positive = Annotated[
    float,
    within("be greater than 0", lambda v: v > 0),
    within(f"lie in [{_SMALLEST:g}, {FARTHEST:g}]", lambda v: _SMALLEST <= v <= FARTHEST),
]
_AT_LEAST = within(f"be at least {_SMALLEST:g}", lambda v: v >= _SMALLEST)
Opening = Annotated[float, within("lie in (0, 180)", lambda v: 0 < v < 180), _AT_LEAST]
# A lens in pixels: beyond these no image of LARGEST_IMAGE has a field of view, or sees its axis.
_LONGEST_FOCUS, _FARTHEST_CENTRE, _MOST_BENT = 1e9, 1e6, 1e6
Focal = Annotated[
    float, within(f"lie in [0.001, {_LONGEST_FOCUS:g}]", lambda v: 1e-3 <= v <= _LONGEST_FOCUS)
]
Centre = Annotated[
    float,
    within(f"be at most {_FARTHEST_CENTRE:g} in size", lambda v: abs(v) <= _FARTHEST_CENTRE),
]
Coefficient = Annotated[
    float, within(f"be at most {_MOST_BENT:g} in size", lambda v: abs(v) <= _MOST_BENT)
]
Incidence = Annotated[float, within("lie in (0, 90]", lambda v: 0 < v <= 90), _AT_LEAST]
Weight = Annotated[
    float, within(f"be at most {_HEAVIEST:g} in size", lambda v: abs(v) <= _HEAVIEST)
]
_SHORT = within(f"have at most {_LONGEST_NAME} letters", lambda v: len(v) <= _LONGEST_NAME)
Name = Annotated[str, _SHORT]
Kind = Annotated[str, _SHORT, within("be one line", is_one_line)]
Title = Annotated[str, AfterValidator(lambda v: shortened(in_one_line(v), _LONGEST_TITLE))]
FilePath = Annotated[
    str,
    within("not be empty", bool),
    within("be the name of a file", lambda v: len(v) <= _LONGEST_PATH and "\0" not in v),
]
Names = Annotated[
    list[FilePath],
    within(f"have at most {MOST_MOUNTS} entries", lambda v: len(v) <= MOST_MOUNTS),
]
