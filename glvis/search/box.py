"""The box of all positions: bounds, variables that wrap, ways between positions, even spreads."""

from __future__ import annotations

import math
from functools import cached_property

import numpy as np
from numpy.typing import ArrayLike, NDArray

Floats = NDArray[np.float64]


class Box:
    """The positions a search may try; treat as frozen.

    Parameters
    ----------
    bounds : (D, 2) float
        Smallest and largest value of each variable, in the variable's unit; finite.
    periodic : (D,) bool, optional
        Variables whose two bounds are the same place (a full turn).

    Raises
    ------
    ValueError
        On a wrong shape, or bounds that are not finite or reversed.
    """

    def __init__(self, bounds: ArrayLike, periodic: ArrayLike | None = None) -> None:
        self.bounds: Floats = np.array(bounds, dtype=float)
        shape = self.bounds.shape
        if len(shape) != 2 or shape[1] != 2 or shape[0] == 0:
            raise ValueError(f"bounds must have shape (D, 2) with D > 0, got {shape}")
        low, high = self.bounds.T
        if not (np.isfinite(self.bounds).all() and (low <= high).all()):
            raise ValueError("bounds must be finite, the smaller first")
        none = np.zeros(shape[0], dtype=bool)
        self.periodic: NDArray[np.bool_] = none if periodic is None else np.array(periodic, bool)
        if self.periodic.shape != (shape[0],):
            raise ValueError(f"periodic must have shape ({shape[0]},), got {self.periodic.shape}")

    def __len__(self) -> int:
        """Return D."""
        return len(self.bounds)

    @cached_property
    def range(self) -> Floats:
        """Largest less smallest value (D,)."""
        return self.bounds[:, 1] - self.bounds[:, 0]

    @cached_property
    def wraps(self) -> NDArray[np.bool_]:
        """Which variables wrap (D,): the periodic ones whose bounds are not equal."""
        return self.periodic & (self.range > 0)

    @cached_property
    def _period(self) -> Floats:
        """Period of those that wrap, 1 elsewhere."""
        return np.where(self.wraps, self.range, 1.0)

    def inside(self, x: Floats) -> Floats:
        """Return x (..., D) in the box: wrapped where periodic, else put on the nearest bound."""
        low, high = self.bounds.T
        wrapped = np.where(self.wraps, low + np.mod(x - low, self._period), x)
        return np.clip(wrapped, low, high)

    def shortest(self, difference: Floats) -> Floats:
        """Return the difference (..., D) of two positions, the shorter way round a period."""
        turns = np.rint(difference / self._period)
        return np.where(self.wraps, difference - turns * self._period, difference)

    def checked(self, x: ArrayLike, most: int) -> Floats:
        """Return positions (K, D) or (D,) that a user gave as (K, D) inside the box, K <= most.

        Raises
        ------
        ValueError
            On a wrong shape, too many rows, or numbers that are not finite.
        """
        rows = np.atleast_2d(np.array(x, dtype=float))
        if rows.ndim != 2 or rows.shape[1] != len(self) or len(rows) > most:
            raise ValueError(
                f"start must have shape (K, {len(self)}) with K <= {most}, got {np.shape(x)}"
            )
        if not np.isfinite(rows).all():
            raise ValueError("start must be finite")
        return self.inside(rows)

    def uniform(self, n: int, rng: np.random.Generator, reach: float = 1.0) -> Floats:
        """Return n independent random positions (n, D).

        With ``reach`` above 1 they come from a range so many times as wide, and what falls
        outside is put on the bound, where the best places often are; periodic ones as ever.
        """
        u = rng.random((n, len(self)))
        u = np.where(self.wraps, u, (u - 0.5) * reach + 0.5)
        return self.inside(self.bounds[:, 0] + self.range * u)

    def sobol(self, n: int, rng: np.random.Generator) -> Floats:
        """Return n random positions (n, D) spread evenly: scrambled Sobol points."""
        from scipy.stats import qmc  # half a second to import, needed once a run at most

        unit = qmc.Sobol(len(self), scramble=True, rng=rng)
        # Sobol points are even in powers of two; the first n of one are nearly so.
        points = unit.random_base2(math.ceil(math.log2(max(n, 1))))[:n]
        return self.inside(self.bounds[:, 0] + self.range * points)
