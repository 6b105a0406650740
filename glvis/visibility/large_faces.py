"""Faces that are large in an image: which of a batch are looked at in several points, and where.

They are listed for the shaders like clusters are, see ``batch``.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from glvis.visibility.batch import GROUP, MOST_GROUPS, Batch, ViewList, filled
from glvis.visibility.filters import may_pass
from glvis.visibility.points import beside, spans

Floats = NDArray[np.float64]
Bools = NDArray[np.bool_]
Words = NDArray[np.uint32]
Indices = NDArray[np.integer]


@dataclass(frozen=True, eq=False)
class PartsOfFaces:
    """Faces of the targets that are looked at in several points, view by view.

    Attributes
    ----------
    parts : int
        Points are the centres of mass of a face's parts x parts congruent parts.
    entries : (K,) uint32
        Places + 1 in the order of the clusters; a view's are filled up by zeros.
    lists : list of ViewList
        Uniforms and lists, of each viewpoint.
    """

    parts: int
    entries: Words
    lists: list[ViewList]


@dataclass(frozen=True, eq=False)
class LargeFaces:
    """Faces of the targets that are large in the image and of which the centre is not free.

    Attributes
    ----------
    view, place : (K,) int
        Which view of a batch, and place in the order of the clusters; view by view.
    shares : (K,) float64
        Of a window's width or height, that they span.
    """

    view: Indices
    place: Indices
    shares: Floats

    @classmethod
    def of(cls, batch: Batch, marked: Words) -> LargeFaces:
        """Return those of a batch among records (K,) that ask has marked."""
        question, eye = batch.question, batch.viewpoints[0]
        clusters, half = question.target.clusters, eye.tan_half[:, None]
        model = clusters.model
        assert question.large is not None
        view, place = np.divmod(marked.astype(np.intp), len(clusters.order))
        in_world = model.vertices.take(model.faces.take(clusters.order[place], axis=0), axis=0)
        shares = np.zeros(len(view))
        per_view = len(eye.poses) // batch.n
        depth_range = np.array(eye.depth_range)[:, None]
        for window in range(per_view):
            row = view * per_view + window
            corners = np.matmul(in_world - eye.poses[row, None, :3, 3], eye.poses[row, :3, :3])
            corners = np.moveaxis(corners, 0, 2)
            corners[:, 2] *= -1
            kept = np.flatnonzero(may_pass(corners, half, depth_range))
            some = spans(corners[..., kept], half, eye.near[row[kept]])
            shares[kept] = np.maximum(shares[kept], some)
        is_large = shares >= question.large.least
        return cls(view[is_large], place[is_large], shares[is_large])

    def unseen(self, batch: Batch, parts: int, visible: Bools) -> PartsOfFaces:
        """Return those of which no point is visible (n, F) yet, to be looked at in parts."""
        large = batch.question.large
        clusters = batch.question.target.clusters
        assert large is not None
        face = clusters.order[self.place]
        unseen = ~visible[self.view, face]
        touches = np.zeros(len(face), dtype=bool)
        if parts != large.few:
            touches = beside(clusters, visible, self.view, face)
        some = np.flatnonzero(unseen & large.are_looked_at(parts, self.shares, touches))
        most = int(np.bincount(self.view[some], minlength=1).max()) * parts**2
        groups = max(1, -(-most // (GROUP * MOST_GROUPS)))
        multiple = groups * GROUP // parts**2
        entries, begin, n_listed = filled(self.view[some], self.place[some], batch.n, multiple)
        lists = []
        first_row = sum(len(one.rows) for one in batch.lists)
        for eye in batch.viewpoints:
            rows = eye.asking.rows.copy()
            per_view = len(rows) // batch.n
            rows["first_listed"] = np.repeat(len(batch.listed) + begin, per_view)
            rows["n_listed"] = np.repeat(n_listed, per_view)
            rows["groups_a_column"] = groups
            first_extra = len(clusters.order) * batch.n + parts**2 * begin
            rows["first_extra"] = np.repeat(first_extra, per_view)
            lists.append(ViewList(rows, first_row))
            first_row += len(rows)
        return PartsOfFaces(parts, entries, lists)
