"""Objectives OF1, OF2 and OF3 (Sec. 2.2.1) on visibility maps; larger is better.

The paper minimises 1/OF (Table 5), which breaks where negative overlap weights bring OF to
zero; the search maximises OF, the same order while OF > 0.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

# Table 1: weights of faces seen by exactly 1, 2, ... sensors; the last one holds from there on.
OVERLAP_WEIGHTS = {
    "set1": (1.0, 10.0, 10.0, -2.0, -4.0, -8.0),
    "set2": (10.0, 10.0, 10.0, -5.0, -10.0, -10.0),
}
# Table 2: (w_tot, w_of1, w_of2) of OF3.
TERM_WEIGHTS = {"set1": (1.0, 2.0, 1.0), "set2": (1.0, 2.0, 3.0)}

KINDS = ("of1", "of2", "of3")
AGGREGATES = ("mean", "min", "cvar")


@dataclass(frozen=True)
class Objective:
    """What the search maximises; by default the share of the area that is seen.

    Attributes
    ----------
    kind : str
        "of1", "of2" or "of3".
    w_tot, w_of1, w_of2 : float
        Weights of the terms of OF3, Eq. (5).
    overlap : tuple of float
        Weight of faces seen by exactly 1, 2, ... sensors in OF2, Eq. (4); the last one also
        holds for every larger number.
    by_area : bool
        Faces weigh by their area instead of one each, as they do in the paper.
    normalize : bool
        Divide each term of OF2 and OF3 by the number (or area) of all faces, so that models of
        different size weigh alike. OF1 is a fraction by its definition, Eq. (1).
    aggregate : str
        Over models: "mean" (Sec. 2.2.1), "min", or "cvar", the mean over the worst
        ``cvar_fraction`` of the models.
    cvar_fraction : float
        Share of the models that "cvar" looks at, in (0, 1].
    """

    kind: str = "of1"
    w_tot: float = 1.0
    w_of1: float = 2.0
    w_of2: float = 1.0
    overlap: tuple[float, ...] = OVERLAP_WEIGHTS["set1"]
    by_area: bool = True
    normalize: bool = True
    aggregate: str = "mean"
    cvar_fraction: float = 0.5

    def __post_init__(self) -> None:
        if self.kind not in KINDS:
            raise ValueError(f"kind = '{self.kind}' must be one of {', '.join(KINDS)}")
        if self.aggregate not in AGGREGATES:
            raise ValueError(
                f"aggregate = '{self.aggregate}' must be one of {', '.join(AGGREGATES)}"
            )
        if not self.overlap:
            raise ValueError("overlap needs at least one weight")
        if not 0 < self.cvar_fraction <= 1:
            raise ValueError(f"cvar_fraction = {self.cvar_fraction:g} must lie in (0, 1]")

    @property
    def label(self) -> str:
        """What its value is called: "OF3" as in the paper, "OF1 by area"."""
        return self.kind.upper() + (" by area" if self.by_area else "")

    @property
    def is_share(self) -> bool:
        """Whether a model's value is divided by the number (or area) of all its faces."""
        return self.normalize or self.kind == "of1"

    def terms(self, counts: ArrayLike, area: ArrayLike) -> dict[str, float]:
        """Return the terms of one model.

        Parameters
        ----------
        counts : (F,) int
            Number of sensors that see each face.
        area : (F,) float
            Area of each face, scene unit squared; used where ``by_area``.

        Returns
        -------
        dict
            ``t_tot`` (Eq. 6), ``of1`` (Eq. 1; by area Eq. 3 over the total area), ``of2``
            (Eq. 4), ``of3`` (Eq. 5) and ``value``, the one that ``kind`` names. ``t_tot``,
            ``of2`` and ``of3`` are divided by the number (or area) of all faces where
            ``normalize``.
        """
        seen_by = np.asarray(counts)
        weights = np.asarray(area, dtype=float) if self.by_area else None
        # share[i] = number (or area) of faces seen by exactly i sensors
        share = np.bincount(seen_by, weights=weights).tolist()
        total = float(sum(share))
        if total == 0:
            raise ValueError("the model has no face (or no area) to see")
        scale = total if self.normalize else 1.0
        exactly = share[1:]
        t_tot = sum(k * faces for k, faces in enumerate(exactly, start=1)) / scale  # Eq. (6)
        unique = float(sum(exactly))
        of1 = unique / total  # Eq. (1), Eq. (3)
        table = self._overlap_weights(len(exactly)).tolist()
        of2 = sum(w * faces for w, faces in zip(table, exactly, strict=True)) / scale  # Eq. (4)
        # Eq. (5) adds OF1 to counts: there it is card{k >= 1}, normalised like the rest.
        of3 = self.w_tot * t_tot + self.w_of1 * unique / scale + self.w_of2 * of2
        terms = {"t_tot": t_tot, "of1": of1, "of2": of2, "of3": of3}
        return terms | {"value": terms[self.kind]}

    def values(self, counts: ArrayLike, area: ArrayLike) -> NDArray[np.float64]:
        """Return ``value`` of `terms` for many layouts (P,), from counts (P, F): a sum over faces.

        The same to rounding, and quicker where P is large.
        """
        seen_by = np.asarray(counts)
        most = int(seen_by.max(initial=0))
        worth = self._worth(most)
        if self.by_area:
            weights = np.asarray(area, dtype=float)
            total = float(weights.sum())
            values = (worth[seen_by] * weights).sum(axis=1)
        else:
            total = float(seen_by.shape[1])
            exactly = [(seen_by == k).sum(axis=1) for k in range(1, most + 1)]
            values = np.zeros(len(seen_by))
            for k, faces in enumerate(exactly, start=1):
                values += worth[k] * faces
        return values / total if self.is_share else values

    def value_by_model(
        self, counts: Sequence[ArrayLike], areas: Sequence[ArrayLike]
    ) -> NDArray[np.float64]:
        """Return ``value`` of `terms` on each model (M,), from its counts (F,) and areas (F,)."""
        pairs = zip(counts, areas, strict=True)
        return np.array([self.terms(seen_by, area)["value"] for seen_by, area in pairs])

    def aggregated(self, values: ArrayLike) -> NDArray[np.float64]:
        """Return one value (...,) from the values of the models (..., M)."""
        v = np.asarray(values, dtype=float)
        if self.aggregate == "min":
            return v.min(axis=-1)
        if self.aggregate == "cvar":
            worst = max(1, math.ceil(self.cvar_fraction * v.shape[-1]))
            return np.sort(v, axis=-1)[..., :worst].mean(axis=-1)
        return v.mean(axis=-1)

    @property
    def upper_bound(self) -> float:
        """Return the largest value that any number of sensors could reach on one model.

        Finite only where ``normalize`` or ``kind`` is "of1"; more sensors than the overlap
        table has entries are not considered.
        """
        return max(0.0, float(self._worth(len(self.overlap)).max())) if self.is_share else math.inf

    def _worth(self, most: int) -> NDArray[np.float64]:
        """Return what one face is worth, seen by 0, 1, ... ``most`` sensors, (most + 1,)."""
        k = np.arange(most + 1)
        is_seen = (k > 0).astype(float)
        of2 = np.concatenate([[0.0], self._overlap_weights(most)])  # Eq. (4)
        of3 = self.w_tot * k + self.w_of1 * is_seen + self.w_of2 * of2  # Eq. (5)
        return {"of1": is_seen, "of2": of2, "of3": of3}[self.kind]

    def _overlap_weights(self, n: int) -> NDArray[np.float64]:
        """Return w_1 ... w_n, the table continued by its last entry."""
        table = np.asarray(self.overlap)
        return table[np.minimum(np.arange(n), len(table) - 1)]
