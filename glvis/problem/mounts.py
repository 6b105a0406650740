"""Where sensors are mounted and what of it may move: positions of a search become poses.

A mount has ten numbers (place, orientation, roll). Each is fixed, free or a linear expression
of named variables, so all of them together are one matrix times the position plus a constant.
Degrees and the study's unit in, ``camera_to_world`` out.
"""

from __future__ import annotations

import math
import re
from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from numpy.typing import ArrayLike, NDArray

from glvis.problem.camera import direction_from_angles, look_along, mirrored_pose
from glvis.problem.expressions import Linear, plain_name, resolved, substituted
from glvis.problem.layout import (
    ANGLE,
    CENTRE,
    HEIGHT,
    ORIENTATION,
    RADIUS,
    RING_AXES,
    ROLL,
    ROWS,
    Aim,
    Angles,
    Free,
    Mount,
    Parameter,
    Ring,
    Vector,
)

Array = NDArray[np.float64]


# Beyond these numbers squares leave the range of floats, and nothing is meant.
_FARTHEST, _SHORTEST = 1e12, 1e-100
# Moves of less, in radians and in shares of the farthest coordinate, are near what rounding does.
_LEAST = 1e-9

_NAME = re.compile(r"\w[\w.+ -]*")


@dataclass(frozen=True)
class Variable:
    """One column of a position: a number that the search may choose.

    Attributes
    ----------
    name : str
        Given, or the place of the number: "A1.roll_deg".
    min, max, start : float
        In the units of the study file: its length unit, degrees.
    periodic : bool
        Whether ``max`` is the same as ``min``, so that the search wraps.
    """

    name: str
    min: float
    max: float
    start: float
    periodic: bool = False


@dataclass(frozen=True, eq=False)
class Rig:
    """The family of layouts being searched: a position becomes the poses of all sensors.

    Attributes
    ----------
    variables : tuple of Variable
        One a column of a position, D of them: the named ones in the order of the file, then
        those of the mounts in the order of the file.
    sensor_names : tuple of str
        S names; a mirrored sensor follows its mount.
    sensor_kinds : tuple of str
        Which sensor each of them is.
    moved_by : tuple of frozenset of int
        Columns that move each sensor.
    up : (3,) float64
        World direction that an unrolled image shows upright.
    """

    variables: tuple[Variable, ...]
    sensor_names: tuple[str, ...]
    sensor_kinds: tuple[str, ...]
    moved_by: tuple[frozenset[int], ...]
    up: Array
    _matrix: Array  # (M, 10, D)
    _constant: Array  # (M, 10)
    _mounts: tuple[Mount, ...]

    def __repr__(self) -> str:
        return f"Rig({len(self.variables)} variables, sensors {', '.join(self.sensor_names)})"

    @property
    def bounds(self) -> Array:
        """Lower and upper bound of each variable, (D, 2)."""
        return np.array([(v.min, v.max) for v in self.variables]).reshape(-1, 2)

    @property
    def start(self) -> Array:
        """The user's start, (D,)."""
        return np.array([v.start for v in self.variables], dtype=float)

    @property
    def periodic(self) -> NDArray[np.bool_]:
        """Which variables wrap, (D,)."""
        return np.array([v.periodic for v in self.variables], dtype=bool)

    def poses(self, x: ArrayLike) -> Array:
        """Return the poses of all sensors.

        Parameters
        ----------
        x : (P, D) or (D,) float
            Positions of the search, in the units of the study file.

        Returns
        -------
        camera_to_world : (P, S, 4, 4) or (S, 4, 4) float64

        Raises
        ------
        ValueError
            If ``x`` has another number of columns or is not finite.
        """
        position = np.asarray(x, dtype=float)
        n = len(self.variables)
        if position.ndim not in (1, 2) or position.shape[-1] != n:
            raise ValueError(f"a position must have shape (P, {n}), got {position.shape}")
        if not np.isfinite(position).all():
            raise ValueError("a position must be finite")
        numbers = np.broadcast_to(self._constant, (*position.shape[:-1], *self._constant.shape))
        if n:
            # term by term: a matrix product's last bits depend on how many positions there are
            terms = sum(factor * position[..., column] for factor, column in self._terms)
            numbers = terms.reshape(numbers.shape) + self._constant
        place = self._places(numbers)
        direction = self._directions(numbers, place)
        roll = np.radians(numbers[..., ROLL])
        return self._with_mirrors(look_along(place, direction, roll, self.up))

    @cached_property
    def _terms(self) -> list[tuple[Array, NDArray[np.intp]]]:
        """Factors and columns of the first variable of each number, of the second, and so on."""
        flat = self._matrix.reshape(-1, len(self.variables))
        most = max(1, int(np.count_nonzero(flat, axis=1).max()))
        columns = np.argsort(flat == 0, axis=1, kind="stable")[:, :most]
        return list(zip(np.take_along_axis(flat, columns, axis=1).T, columns.T, strict=True))

    def _places(self, numbers: Array) -> Array:
        """Return the optical centres (..., M, 3); a plain position is a ring of radius 0."""
        angle = np.radians(numbers[..., ANGLE])
        radius, height = numbers[..., RADIUS], numbers[..., HEIGHT]
        about_axis = np.stack([radius * np.cos(angle), radius * np.sin(angle), height], axis=-1)
        axes = np.array(
            [RING_AXES[m.place.axis if isinstance(m.place, Ring) else "z"] for m in self._mounts]
        )
        return numbers[..., CENTRE] + (axes @ about_axis[..., None])[..., 0]

    def _directions(self, numbers: Array, place: Array) -> Array:
        """Return optical axes (..., M, 3) of any length > 0."""
        given = numbers[..., ORIENTATION]
        azimuth, elevation = np.radians(given[..., 0]), np.radians(given[..., 1])
        kinds = [type(mount.orientation) for mount in self._mounts]
        is_angles = np.array([kind is Angles for kind in kinds])[:, None]
        is_aim = np.array([kind is Aim for kind in kinds])[:, None]
        direction = np.where(is_angles, direction_from_angles(azimuth, elevation), given)
        direction = np.where(is_aim, given - place, direction)
        # A sensor that the search moves onto the point it aims at looks along x: no pose is
        # better there than any other, and a search must not end in an error.
        lost = (np.abs(direction) < _SHORTEST).all(axis=-1, keepdims=True)
        return np.where(lost, [1.0, 0.0, 0.0], direction)

    def _with_mirrors(self, poses: Array) -> Array:
        """Return poses (..., S, 4, 4) of the mounts (..., M, 4, 4), each twin after its own."""
        slots = []
        for index, mount in enumerate(self._mounts):
            slots.append(poses[..., index, :, :])
            if mount.mirror:
                twin = mirrored_pose(slots[-1], mount.mirror.point, mount.mirror.normal)
                if abs(np.dot(_unit(mount.mirror.normal), self.up)) > 0.5:
                    # The plane turns ``up`` upside down and with it the twin's image; half a
                    # turn back makes it the sensor of the opposite roll, which sees the same.
                    twin[..., :3, :2] *= -1
                slots.append(twin)
        return np.stack(slots, axis=-3)


def build_rig(
    variables: Mapping[str, Parameter], mounts: Sequence[Mount], up: ArrayLike = (0, 0, 1)
) -> Rig:
    """Return the rig of some mounts.

    Parameters
    ----------
    variables : dict of str to number, Free or Linear
        Named variables in the order of the file; a number or an expression is a name for it.
    mounts : sequence of Mount
        At least one.
    up : (3,) float
        World direction that an unrolled image shows upright.

    Raises
    ------
    ValueError
        If a name is taken twice, unknown or moves no sensor, if definitions are cyclic, if a mirror
        plane is askew to ``up``, or if a mount has no direction at its start.
    """
    if not mounts:
        raise ValueError("a study needs at least one [[mount]]")
    axis = _unit(up)
    names = _sensor_names(mounts, axis)
    free, definitions = _definitions(variables, mounts)
    columns = {name: column for column, name in enumerate(free)}
    matrix = np.zeros((len(mounts), ROWS, len(free)))
    constant = np.zeros((len(mounts), ROWS))
    for index, mount in enumerate(mounts):
        for row, place, parameter in mount.numbers():
            linear = _as_linear(place, parameter)
            try:
                linear = substituted(linear, definitions)
            except ValueError as error:
                raise ValueError(f"{place} = '{linear.text}': {error}") from None
            constant[index, row] = linear.constant
            for name, factor in linear.coefficients.items():
                matrix[index, row, columns[name]] = factor
    for name, column in columns.items():
        if not matrix[..., column].any():
            raise ValueError(f"the variable '{name}' moves no sensor")
    _check_reach(mounts, matrix, constant, free)
    found = tuple(
        _variable(name, spec, matrix[..., columns[name]], mounts) for name, spec in free.items()
    )
    kinds, moved = [], []
    for mount, rows in zip(mounts, matrix, strict=True):
        copies = 2 if mount.mirror else 1
        kinds += [mount.sensor] * copies
        moved += [frozenset(np.flatnonzero(rows.any(axis=0)).tolist())] * copies
    rig = Rig(found, names, tuple(kinds), tuple(moved), axis, matrix, constant, tuple(mounts))
    _check_numbers(rig)
    _check_moves(rig)
    return rig


def _definitions(
    variables: Mapping[str, Parameter], mounts: Sequence[Mount]
) -> tuple[dict[str, Free], dict[str, Linear]]:
    """Return what is free, in the order of columns, and every name in terms of it."""
    free: dict[str, Free] = {}
    named: dict[str, Linear] = {}
    for given, parameter in variables.items():
        name = plain_name(given)
        if name in free or name in named:
            raise ValueError(f"the variable '{name}' is there twice")
        if isinstance(parameter, Free):
            free[name] = parameter
        else:
            named[name] = _as_linear(name, parameter)
    for mount in mounts:
        free |= {place: p for _, place, p in mount.numbers() if isinstance(p, Free)}
    return free, resolved(free, named)


def _as_linear(name: str, parameter: Parameter) -> Linear:
    """Return a parameter as an expression; a free one is the variable of its own name."""
    if isinstance(parameter, Linear):
        return parameter
    if isinstance(parameter, Free):
        return Linear(0.0, {name: 1.0})
    return Linear(float(parameter))


def _variable(name: str, spec: Free, uses: Array, mounts: Sequence[Mount]) -> Variable:
    """Return a variable whose coefficients in the mounts' numbers are ``uses`` (M, 10)."""
    span = spec.max - spec.min
    turns, odd = True, ""
    for mount, factors in zip(mounts, uses, strict=True):
        for row, place, _ in mount.numbers():
            if not factors[row]:
                continue
            is_angle = row in (ANGLE, ROLL) or (
                isinstance(mount.orientation, Angles) and row >= ORIENTATION.start
            )
            # Half a turn of roll brings the image's rectangle back.
            period = 180.0 if row == ROLL and spec.periodic else 360.0
            share = abs(factors[row]) * span / period
            if not is_angle:
                turns, odd = False, odd or f"{place} is no angle"
            elif not math.isclose(share, round(share), abs_tol=1e-9) or round(share) == 0:
                turns = False
                odd = odd or f"{place} turns {abs(factors[row]) * span:g} degrees over its range"
    if spec.periodic and odd:
        raise ValueError(f"the variable '{name}' cannot be periodic: {odd}")
    start = spec.start if spec.start is not None else (spec.min + spec.max) / 2
    periodic = turns if spec.periodic is None else spec.periodic
    return Variable(name, float(spec.min), float(spec.max), float(start), periodic)


def _sensor_names(mounts: Sequence[Mount], up: Array) -> tuple[str, ...]:
    """Return the names of all sensors, checked, with the mirror planes beside them."""
    names: list[str] = []
    for mount in mounts:
        names.append(mount.name)
        if mount.mirror:
            names.append(mount.mirror.name)
            normal = _unit(mount.mirror.normal)
            along = abs(float(normal @ up))
            if along > 1e-6 and float(np.linalg.norm(np.cross(normal, up))) > 1e-6:
                tilt = math.degrees(math.acos(min(1.0, along)))
                raise ValueError(
                    f"{mount.name}.mirror: up must lie in the mirror plane or be normal to it, "
                    f"it is {tilt:.3g} degrees off its normal"
                )
    for name in names:
        if not _NAME.fullmatch(name) or name.endswith((" ", ".")):
            raise ValueError(
                f"'{name}' cannot name a sensor: use letters, digits, '_', '-', '+', '.' and spaces"
            )
    # Names become file names, and some file systems do not tell a from A.
    counts = Counter(name.casefold() for name in names)
    for name in names:
        if counts[name.casefold()] > 1:
            raise ValueError(f"two sensors are called '{name}'")
    return tuple(names)


def _check_reach(
    mounts: Sequence[Mount], matrix: Array, constant: Array, free: Mapping[str, Free]
) -> None:
    """Refuse numbers that no scene needs and that squares could not hold."""
    largest = np.array([max(abs(spec.min), abs(spec.max)) for spec in free.values()])
    with np.errstate(over="ignore", invalid="ignore"):
        reach = np.abs(constant) + (np.abs(matrix) * largest).sum(axis=-1)
    for mount, row_reach in zip(mounts, reach, strict=True):
        for row, place, _ in mount.numbers():
            if not row_reach[row] <= _FARTHEST:
                size = row_reach[row]
                raise ValueError(f"{place} can be as large as {size:g}, more than {_FARTHEST:g}")


def _check_numbers(rig: Rig) -> None:
    """Refuse negative radii, and mounts without a direction at the start."""
    low, high = rig.bounds.T
    lowest = rig._constant + np.minimum(rig._matrix * low, rig._matrix * high).sum(axis=-1)
    numbers = (rig._matrix @ rig.start) + rig._constant
    places = rig._places(numbers)
    for index, mount in enumerate(rig._mounts):
        if lowest[index, RADIUS] < 0:
            radius = lowest[index, RADIUS]
            raise ValueError(f"{mount.name}.ring.radius can be {radius:g}; it must not be negative")
        given = numbers[index, ORIENTATION]
        if isinstance(mount.orientation, Aim) and np.array_equal(given, places[index]):
            raise ValueError(f"{mount.name}.aim is the sensor's own place at the start")
        if isinstance(mount.orientation, Vector) and (np.abs(given) < _SHORTEST).all():
            raise ValueError(f"{mount.name}.direction is zero at the start")


def _check_moves(rig: Rig) -> None:
    """Refuse variables that move no sensor: a search would wait for ever for something new."""
    low, high = rig.bounds.T
    others = np.random.default_rng(0).random((8, 1, len(low)))  # where the other variables stand
    farthest = np.abs(rig.poses(low + (high - low) * others[:, 0])[..., :3, 3]).max()
    for column, variable in enumerate(rig.variables):
        share = np.repeat(others, 4, axis=1)
        share[..., column] = (0.0, 0.3, 0.6, 0.9)
        rows = np.flatnonzero(rig._matrix[..., column].any(axis=1))  # other mounts stand still
        part = replace(
            rig,
            _matrix=rig._matrix[rows],
            _constant=rig._constant[rows],
            _mounts=tuple(rig._mounts[row] for row in rows),
        )
        poses = part.poses((low + (high - low) * share).reshape(-1, len(low)))
        moved = np.ptp(poses.reshape(8, 4, -1, 4, 4), axis=1)
        if moved[..., :3].max() < _LEAST and moved[..., 3].max() <= _LEAST * farthest:
            raise ValueError(
                f"the variable '{variable.name}' moves no sensor over its range; give a number "
                "instead, or a wider range"
            )


def _unit(vector: ArrayLike) -> Array:
    v = np.asarray(vector, dtype=float)
    size = float(np.abs(v).max()) if v.shape == (3,) else 0.0
    if not _SHORTEST < size < math.inf:
        raise ValueError(f"a direction needs three numbers, not all zero, got {v.tolist()}")
    v = v / size
    return v / float(np.linalg.norm(v))
