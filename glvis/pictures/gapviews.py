"""From where what nobody sees is shown: views chosen by how much of it they show.

Every candidate is drawn small and asked which of the unseen faces show in it. The same study
and maps give the same views, on any machine that draws alike.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from glvis.pictures.framing import View, direction_angles, towards_eye
from glvis.pictures.stage import Stage
from glvis.problem.regions import Region, largest_regions

Floats = NDArray[np.float64]
Bools = NDArray[np.bool_]

_SIZE = (240, 180)  # pixels that a candidate is judged by
_AZIMUTHS = tuple(range(35, 395, 45))
_ELEVATIONS = (24.0, -24.0, 60.0, -60.0)
_SQUARE = 0.15  # cosine to the line of sight, below which a face shows as a line
_LIFT = 2.0  # pixels that a point may lie behind what is drawn: surfaces are seen obliquely
_SHOWN = 0.5  # of what the best view shows of a gap, that a view must show for it to be shown
_BETTER = 1.15  # times as much another view must show than the one that all pictures share
_FROM_BELOW = 0.1  # what a view of a room from below counts, unless nothing else shows a gap
_ASIDE = 0.5  # what other faces count in a view that is there for a gap
_MOST_VIEWS = 4
_LARGE = 200_000  # faces of a model that is looked at from half as many sides


@dataclass(frozen=True, eq=False)
class GapViews:
    """Views of what no sensor sees.

    Attributes
    ----------
    views : list of View
        Two or four.
    gaps : list of Region
        The largest unseen regions, as people are told of them.
    places : list of (V, 3) float64
        Of each gap a point to write its number at in each view; NaN where it does not show.
    """

    views: list[View]
    gaps: list[Region]
    places: list[Floats]

    def hidden_gaps(self) -> list[int]:
        """Return the numbers, from 1, of the gaps that none of the views shows at all."""
        return [k for k, at in enumerate(self.places, start=1) if np.isnan(at).all()]


class _Candidates:
    """What shows of the unseen faces of the model on a stage, from any direction."""

    def __init__(self, stage: Stage) -> None:
        model = stage.seen.model
        self.stage, self.index = stage, np.flatnonzero(stage.seen.map.counts == 0)
        self.centroids, self.normals = model.centroids[self.index], model.normals[self.index]
        self.areas = model.areas[self.index]
        self.gaps = largest_regions(model, stage.seen.map.counts == 0)
        self._shown: dict[tuple[float, float], Floats] = {}

    def facing(self, view: View) -> Floats:
        """Return the area of each unseen face as the view would show it if nothing hid it, (U,)."""
        towards = towards_eye(self.stage.study.up, view.azimuth_deg, view.elevation_deg)
        cosine = self.normals @ towards
        return np.where(cosine > _SQUARE, self.areas * cosine, 0.0)

    def shown(self, view: View) -> Floats:
        """Return the area of each unseen face that the view shows, (U,)."""
        key = view.azimuth_deg, view.elevation_deg
        if key not in self._shown:
            stage = self.stage
            eye = stage.eye(view, _SIZE, with_rig=False)
            towards = towards_eye(stage.study.up, *key)
            points = self.centroids + _LIFT / eye.pixels_per_length(_SIZE) * towards
            hidden = stage.is_hidden(points, eye, _SIZE, cut_away=stage.is_room, obstacles=False)
            self._shown[key] = np.where(hidden, 0.0, self.facing(view))
        return self._shown[key]

    def amounts(self, views: Sequence[View], weights: Floats) -> Floats:
        """Return how much of weighted unseen faces (U,) each view shows, (N,)."""
        return np.array([float((self.shown(view) * weights).sum()) for view in views])

    def of_gap(self, k: int) -> Floats:
        """Return 1 for the faces of gap ``k``, else 0, (U,)."""
        weights = np.zeros(len(self.index))
        weights[np.searchsorted(self.index, self.gaps[k].faces)] = 1.0
        return weights

    def left(self, views: Sequence[View]) -> Floats:
        """Return 1 for the unseen faces that none of the views shows, else 0, (U,)."""
        shown = np.sum([self.shown(view) for view in views], axis=0)
        return np.where(shown == 0, 1.0, 0.0)


def gap_views(stage: Stage, first: View, *, is_fixed: bool = False) -> GapViews:
    """Return the views that show the unseen faces of the model on a stage.

    Parameters
    ----------
    stage : Stage
        With a model on it.
    first : View
        The view of the other pictures: taken where it is nearly as good as the best.
    is_fixed : bool
        Whether it is taken in any case.
    """
    known, second = _Candidates(stage), stage.other_side(first)
    if not len(known.index):
        return GapViews([first, second], [], [])
    candidates = [first, second, *_around(stage, known.gaps)]
    liking = np.ones(len(candidates))
    liking[0] = _BETTER
    if stage.is_room:  # nobody looks into a room through its floor
        liking[[view.elevation_deg < 0 for view in candidates]] = _FROM_BELOW

    def add(weights: Floats, liking: Floats | float = 1.0) -> None:
        amounts = liking * known.amounts(candidates, weights)
        views.append(candidates[int(np.argmax(amounts))] if amounts.any() else second)

    views: list[View] = []
    if is_fixed:
        views.append(first)
    else:
        add(np.ones(len(known.index)), liking)
    add(known.left(views), liking)
    gaps = [known.of_gap(k) for k in range(len(known.gaps))]
    enough = [_SHOWN * known.amounts(candidates, gap).max() for gap in gaps]
    for gap, wanted in zip(gaps, enough, strict=True):
        if len(views) < _MOST_VIEWS and known.amounts(views, gap).max() < wanted:
            shows_it = known.amounts(candidates, gap) >= wanted
            add(gap + _ASIDE * known.left(views), shows_it.astype(float))
    if len(views) == _MOST_VIEWS - 1:  # a sheet has room for four
        add(known.left(views), liking)
    # where there is room for no view that shows a gap well, the one that shows most of it will do
    least = [min(e / 2, known.amounts(views, g).max()) for e, g in zip(enough, gaps, strict=True)]
    places = [_places(known, views, *one) for one in zip(gaps, least, strict=True)]
    return GapViews(views, known.gaps, places)


def _around(stage: Stage, gaps: Sequence[Region]) -> list[View]:
    """Return views from all sides, and straight at the gaps."""
    angles = [direction_angles(stage.study.up, gap.facing) for gap in gaps if np.any(gap.facing)]
    straight = [(5.0 * round(a / 5) % 360, 5.0 * round(e / 5)) for a, e in angles]
    step = 2 if stage.seen.model.n_faces > _LARGE else 1
    around = [(float(a % 360), e) for e in _ELEVATIONS for a in _AZIMUTHS[::step]]
    return [View("perspective", a, e, is_parallel=False) for a, e in (*straight, *around)]


def _places(known: _Candidates, views: Sequence[View], gap: Floats, least: float) -> Floats:
    """Return the middle of what shows of a gap in each view, (V, 3); NaN where less than least."""
    places = np.full((len(views), 3), np.nan)
    for v, view in enumerate(views):
        shown = known.shown(view) * gap
        if shown.sum() < max(least, 1e-300):
            continue
        middle = (known.centroids * shown[:, None]).sum(axis=0) / shown.sum()
        apart = np.where(shown > 0, np.linalg.norm(known.centroids - middle, axis=1), np.inf)
        places[v] = known.centroids[int(np.argmin(apart))]
    return places
