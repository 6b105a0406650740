"""What rendered maps told of occlusion: from which places which faces were hidden.

Whether something hides a face depends on where the eye of a sensor is, not on where it looks. So
the faces in view of a new pose are taken for seen or hidden as those eyes found them that have
stood nearest, the nearest counting most. Where they disagree the face is rather taken for seen:
what is hoped for is soon rendered and known, what is not hoped for never.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

if TYPE_CHECKING:
    from scipy.spatial import KDTree

Floats = NDArray[np.float64]
Bools = NDArray[np.bool_]

# Eyes that vote, and the share of the votes with which a face is seen. The weight of a vote falls
# with the square of the distance, flat within a tenth of the farthest of these. Measured on a
# kitchen with 1,200 random views known: the best layout of three sensors (7.67) was guessed at
# 6.8 where votes fell by rank and the majority won, 7.2 with these weights, 7.3 where a third is
# enough; the ranks of 2,000 views agree with those by maps to 0.985, in place of 0.988.
_EYES = 16
_FLAT = 0.1
# Votes are small integers, quick to add: 2 for seen against 1 for hidden makes a third enough.
_SEEN, _HIDDEN = 2, -1
_WEIGHT = 1000  # of the nearest; 16 of them times 2 fit 16 bits
_ROOM = 256
_LATEST = 128  # eyes in a tree of their own, quickly made anew as eyes are learned


class Memory:
    """Remembers some faces.

    Parameters
    ----------
    faces : int
        n of them.
    """

    def __init__(self, faces: int) -> None:
        self._known = 0
        # rows of eyes, room for more at the end: places, and how they vote, 0 where they
        # looked away
        self._eyes = np.zeros((_ROOM, 3))
        self._votes = np.zeros((_ROOM, faces), dtype=np.int16)
        self._trees: list[tuple[int, KDTree]] = []  # most eyes, the latest; where each begins

    def learn(self, eyes: Floats, in_view: Bools, seen: Bools) -> None:
        """Remember what was found from some eyes.

        Parameters
        ----------
        eyes : (N, 3) float64
            Places.
        in_view : (N, n) bool
            Faces that would be seen if nothing hid them.
        seen : (N, n) bool
            Faces that are.
        """
        end = self._known + len(eyes)
        while end > len(self._eyes):
            self._eyes = np.concatenate([self._eyes, np.zeros_like(self._eyes)])
            self._votes = np.concatenate([self._votes, np.zeros_like(self._votes)])
        self._eyes[self._known : end] = eyes
        self._votes[self._known : end] = np.where(seen, _SEEN, _HIDDEN * in_view)
        self._known = end

    def free(self, eyes: Floats) -> Bools:
        """Return which faces nothing hides, probably, from eyes (P, 3): (P, n).

        A face that none of the nearest eyes looked at is taken for free.
        """
        if self._known == 0:
            return np.ones((len(eyes), self._votes.shape[1]), dtype=bool)
        distance, nearest = self._nearest(eyes)
        flat = np.maximum(_FLAT * distance.max(axis=1), np.finfo(np.float32).tiny)[:, None]
        weight = (_WEIGHT * (flat / np.maximum(distance, flat)) ** 2).astype(np.int16)
        return np.einsum("pk,pkn->pn", weight, self._votes[nearest]) >= 0

    def _nearest(self, eyes: Floats) -> tuple[Floats, NDArray[np.intp]]:
        """Return how far the nearest eyes are from eyes (P, 3), and which they are: (P, k)."""
        distances, places = [], []
        for first, tree in self._up_to_date():
            distance, place = tree.query(eyes, k=np.arange(1, min(_EYES, tree.n) + 1))
            distances.append(distance)
            places.append(place + first)
        distance, place = np.concatenate(distances, axis=1), np.concatenate(places, axis=1)
        order = np.argsort(distance, axis=1, kind="stable")[:, :_EYES]
        return np.take_along_axis(distance, order, 1), np.take_along_axis(place, order, 1)

    def _up_to_date(self) -> list[tuple[int, KDTree]]:
        """Return trees of all eyes, and where the eyes of each begin."""
        from scipy.spatial import KDTree  # slow to import, and only a search needs it

        if sum(tree.n for _, tree in self._trees) < self._known:
            begin = self._trees[0][1].n if self._trees else 0
            if self._known - begin > _LATEST:
                self._trees = [(0, KDTree(self._eyes[: self._known]))]
            else:
                latest = KDTree(self._eyes[begin : self._known])
                self._trees = [*self._trees[: begin > 0], (begin, latest)]
        return self._trees
