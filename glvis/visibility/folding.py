"""Maps of pieces, folded back to the file's own faces by the area of their pieces."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import ArrayLike, NDArray

from glvis.problem.scene import Model
from glvis.visibility.visibility_map import VisibilityMap

Floats = NDArray[np.float64]
Bools = NDArray[np.bool_]
Integers = NDArray[np.int64]

# of a face's area; sums of the same areas in another order differ by rounding
_HALF = 0.5 - 1e-12


def seen_share(visible: ArrayLike, model: Model) -> Floats:
    """Return the share of the area of the file's faces that lies in some pieces.

    Parameters
    ----------
    visible : (..., F) bool
        Pieces, such as the rows of a map.
    model : Model
        Cut or not.

    Returns
    -------
    (..., F_file) float64
        Of faces without area, the share of their pieces.
    """
    chosen = np.asarray(visible, dtype=bool)
    if model.pieces is None:
        return chosen.astype(float)
    file_face = model.pieces.file_face
    begin = np.searchsorted(file_face, np.arange(model.file.n_faces))
    whole = np.add.reduceat(model.areas, begin)
    weight = np.where(whole[file_face] > 0, model.areas, 1.0)
    whole = np.add.reduceat(weight, begin)
    return np.add.reduceat(np.where(chosen, weight, 0.0), begin, axis=-1) / whole


def fold(visible: ArrayLike, model: Model) -> tuple[Floats, Bools]:
    """Return a map of pieces (..., F) as one of the file's faces.

    Returns
    -------
    seen_share : (..., F_file) float64
        Share of each face's area that is seen.
    visible : (..., F_file) bool
        Whether that is at least one half.
    """
    share = seen_share(visible, model)
    return share, share >= _HALF


def folded(found: VisibilityMap, model: Model) -> VisibilityMap:
    """Return a map of pieces as one of the file's faces; of a model that was not cut, the same."""
    if model.pieces is None:
        return found
    return replace(found, visible=fold(found.visible, model)[1])


def fold_counts(counts: ArrayLike, model: Model) -> Integers:
    """Return how many sensors see the file's faces, (F_file,), where only pieces' (F,) are known.

    As many as see one half of the area together: two see it all twice, or each another part of it
    once.
    """
    seen_by = np.asarray(counts).astype(np.int64)
    if model.pieces is None:
        return seen_by
    total = np.zeros(model.file.n_faces, dtype=np.int64)
    for n in range(1, int(seen_by.max(initial=0)) + 1):
        total += fold(seen_by >= n, model)[1]
    return total
