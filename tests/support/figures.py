"""What maps are worth against the judge: how many faces are wrongly seen, missed, excused."""

from __future__ import annotations

from dataclasses import dataclass, fields
from functools import cached_property

import numpy as np

from support.judge import Judge, Verdict
from support.lens_oracle import LensJudge

POINTS = 8  # a side: a face is judged by 64 points, its centre is one of them
_CLOSER = (16, 64)  # points a side of a face that is called visible while none of the 64 shows


@dataclass
class Figures:
    """What is counted over the maps of one criterion; sums add up."""

    seen: int = 0  # faces that the maps call visible
    wrong: float = 0.0  # of them those of which no point is
    half: int = 0  # faces at least half visible (and large enough, where pixels decide)
    missed: int = 0  # of them those that the maps leave out
    any: int = 0  # faces of which one of 64 points shows
    missed_any: int = 0
    both: int = 0  # centres free in truth and in the map
    either: int = 0
    excused: int = 0  # faces left out of all this because rounding decides on them
    judged: int = 0  # faces that the maps call visible or the truth may

    def __iadd__(self, other: Figures) -> Figures:
        for one in fields(self):
            setattr(self, one.name, getattr(self, one.name) + getattr(other, one.name))
        return self

    @property
    def wrong_percent(self) -> float:
        """Of the faces called visible."""
        return 100 * self.wrong / max(self.seen, 1)

    @property
    def missed_percent(self) -> float:
        """Of the faces at least half visible."""
        return 100 * self.missed / max(self.half, 1)

    @property
    def missed_any_percent(self) -> float:
        """Of the faces of which one of 64 points shows."""
        return 100 * self.missed_any / max(self.any, 1)

    @property
    def iou(self) -> float:
        """Intersection over union of centres."""
        return self.both / self.either if self.either else 1.0

    @property
    def excused_percent(self) -> float:
        """Of the faces judged."""
        return 100 * self.excused / max(self.judged, 1)


class Truth:
    """What is true at one pose, worked out once for all maps that are held against it."""

    def __init__(self, judge: Judge | LensJudge) -> None:
        self._judge = judge
        self._shows: dict[int, bool] = {}  # of faces looked at closely

    def of_centroids(self, visible: np.ndarray) -> Figures:
        """Return the figures of a map (F,) made by centres."""
        truth = self._centroids
        sure = ~truth.doubtful
        return Figures(
            seen=int(np.count_nonzero(visible)),
            both=int(np.count_nonzero(visible & truth.free & sure)),
            either=int(np.count_nonzero((visible | truth.free) & sure)),
            excused=int(np.count_nonzero(truth.doubtful)),
            judged=int(np.count_nonzero(visible | truth.possibly)),
        )

    def of_pixels(
        self, visible: np.ndarray, pixels: tuple[int, int] | None = None, *, at_most: int = 120
    ) -> Figures:
        """Return the figures of a map (F,) made by pixels, or by points of faces in their stead.

        Parameters
        ----------
        visible : (F,) bool
            The map.
        pixels : (int, int), optional
            Those of the image that alone decided: a face that shows in one is seen, and only one
            that covers two of their centres can be missed. None: points of faces decided.
        at_most : int
            Suspects of a pose that are looked at closely; of more a share at random.
        """
        surely, possibly = self._shares
        suspects = np.flatnonzero(visible & (possibly == 0))
        is_large = np.ones(len(visible), dtype=bool)
        if pixels is not None:
            in_pixels = self._judge.pixels(pixels)
            is_large = in_pixels[0] >= 2
            suspects = suspects[in_pixels[1][suspects] == 0]
        half, shows = is_large & (surely >= 0.5), is_large & (surely > 0)
        excused = visible & (possibly > 0) & (surely == 0)
        excused |= ~visible & is_large & (possibly >= 0.5) & (surely < 0.5)
        return Figures(
            seen=int(np.count_nonzero(visible)),
            wrong=self._wrong_of(suspects, at_most),
            half=int(np.count_nonzero(half)),
            missed=int(np.count_nonzero(half & ~visible)),
            any=int(np.count_nonzero(shows)),
            missed_any=int(np.count_nonzero(shows & ~visible)),
            excused=int(np.count_nonzero(excused)),
            judged=int(np.count_nonzero(visible | (is_large & (possibly > 0)))),
        )

    def _wrong_of(self, suspects: np.ndarray, at_most: int) -> float:
        """Return of how many suspects (f,) no point shows, by 4,096 points of each."""
        if not len(suspects):
            return 0.0
        # a random choice that is the same for other maps of this pose
        rank = np.random.default_rng(0).permutation(self._judge.n)[suspects]
        chosen = suspects[np.argsort(rank)[:at_most]]
        new = np.array([face for face in chosen if int(face) not in self._shows], dtype=np.int64)
        for n in _CLOSER:
            _, possibly = self._judge.shares(n, new)
            self._shows.update(zip(new.tolist(), (possibly > 0).tolist(), strict=True))
            new = new[possibly == 0]
        wrong = sum(not self._shows[int(face)] for face in chosen)
        return wrong * len(suspects) / len(chosen)

    @cached_property
    def _shares(self) -> tuple[np.ndarray, np.ndarray]:
        return self._judge.shares(POINTS)

    @cached_property
    def _centroids(self) -> Verdict:
        return self._judge.centroids()
