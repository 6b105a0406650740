"""The visibility map: which sensor sees which face of a model."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray


@dataclass(frozen=True, eq=False)
class VisibilityMap:
    """Which sensor sees which face of one model: the paper's VM, Sec. 2.1.2.

    Attributes
    ----------
    model_name : str
        Stem of the model's file.
    sensor_names : tuple of str
        Names of the S sensors.
    visible : (S, F) bool
        In the face order of the file.
    """

    model_name: str
    sensor_names: tuple[str, ...]
    visible: NDArray[np.bool_]

    def __repr__(self) -> str:
        return (
            f"VisibilityMap('{self.model_name}', visible {self.visible.shape}, "
            f"{100 * self.coverage:.1f} % of the faces seen)"
        )

    @property
    def counts(self) -> NDArray[np.int64]:
        """Number of sensors that see each face, (F,)."""
        return self.visible.sum(axis=0)

    @property
    def n_unique(self) -> int:
        """Number of faces that at least one sensor sees."""
        return int(np.count_nonzero(self.visible.any(axis=0)))

    @property
    def n_total(self) -> int:
        """Faces seen, each counted once for every sensor that sees it: T_tot, Eq. (6)."""
        return int(np.count_nonzero(self.visible))

    @property
    def coverage(self) -> float:
        """Share of the faces that at least one sensor sees: OF1, Eq. (1)."""
        return self.n_unique / self.visible.shape[1]

    def share_seen_by(self, n: int) -> float:
        """Return the share of the faces that at least ``n`` sensors see."""
        return float(np.count_nonzero(self.counts >= n)) / self.visible.shape[1]
