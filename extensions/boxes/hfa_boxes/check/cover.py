"""Branch and bound: proof that functions are positive on a set within a cube.

The cube |y_i| <= 1 is halved again and again, across the edge that `Question.edges` chooses, until
on each box every function is bounded from below by a positive number or the box is outside the set.
Centers and half widths are dyadic, so that they are doubles without rounding. The order is fixed,
so that the proof is repeated without a stored tree."""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple, Protocol

import numpy as np

from hfa_proof.checker.reading import Rejected
from hfa_support.progress import Progress

#: Mean number of halvings of the edges of a box, at which it is not halved again.
_DEEPEST = 40
#: Largest number of halvings of an edge, so that centers are doubles.
_FINEST = 53
#: Number of batches between two reports of progress.
_TOLD = 4


class Boxes(NamedTuple):
    """Boxes by their centers (N, n) and the number of times each edge was halved (N, n)."""

    centres: np.ndarray
    depths: np.ndarray

    @property
    def half_widths(self) -> np.ndarray:
        """Half-widths of the boxes, (N, n)."""
        return np.ldexp(1.0, -self.depths)

    @property
    def reach(self) -> np.ndarray:
        """Largest |y_i| on each box, (N,)."""
        return np.asarray(np.max(np.abs(self.centres) + self.half_widths, axis=1))

    def part(self, which: np.ndarray | slice) -> Boxes:
        """Return the selected boxes."""
        return Boxes(self.centres[which], self.depths[which])

    def halves(self, across: np.ndarray) -> Boxes:
        """Return the lower halves of all boxes, then the upper ones; across: (N,), the edges that
        are halved."""
        rows = np.arange(len(self.centres))
        depths = self.depths.copy()
        depths[rows, across] += 1
        step = np.ldexp(1.0, -depths[rows, across])
        lower = self.centres.copy()
        lower[rows, across] -= step
        upper = self.centres.copy()
        upper[rows, across] += step
        return Boxes(np.concatenate([lower, upper]), np.concatenate([depths, depths]))


def cube(n: int) -> Boxes:
    """Return the cube |y_i| <= 1 as one box."""
    return Boxes(np.zeros((1, n)), np.zeros((1, n), dtype=int))


class OpenBoxError(Rejected):
    """Error of a box that is not decided.

    place: its center (n,)
    """

    def __init__(self, text: str, place: np.ndarray) -> None:
        super().__init__(text)
        self.place = place


class RefutedError(OpenBoxError):
    """Error of a function that is not positive at a point of the set, computed in doubles."""


class SmallestBoxError(OpenBoxError):
    """Error of an undecided box that is too small to be halved."""


class Question(Protocol):
    """A property to decide on every box of the cube |y_i| <= 1."""

    @property
    def n(self) -> int:
        """Dimension of the boxes."""

    @property
    def at_once(self) -> int:
        """Number of boxes that are evaluated in one batch."""

    def is_outside(self, boxes: Boxes) -> np.ndarray:
        """Return the mask of the boxes that do not meet the set."""

    def edges(self, boxes: Boxes) -> np.ndarray:
        """Return for each undecided box the edge to halve, and -1 for decided boxes, (N,).

        Raises RefutedError at a point where the property does not hold.
        """


def refute(
    centres: np.ndarray, values: np.ndarray, within: Callable[[np.ndarray], np.ndarray]
) -> None:
    """Raise RefutedError at the point of the set with the lowest negative value.

    centres: (N, n), the points
    values: (N,)
    within: points (N, n) -> mask of those in the set
    """
    negative = np.flatnonzero(values < 0.0)
    refuted = negative[within(centres[negative])]
    if len(refuted):
        place = centres[refuted[np.argmin(values[refuted])]]
        raise RefutedError("the inequality does not hold at a point of the set", place)


def cover(question: Question, most: int, progress: Progress | None = None) -> int:
    """Prove a property on the set and return the number of boxes.

    most: number of boxes after which the proof ends

    Raises RefutedError at a point where the property fails, and OpenBoxError at a point where it is
    not decided. The reported progress is the decided share of the volume."""
    n = question.n
    waiting = cube(n)
    done = 0.0
    count = 0
    turn = 0
    while len(waiting.centres):
        batch = waiting.part(slice(-question.at_once, None))
        waiting = waiting.part(slice(None, -question.at_once))
        outside = question.is_outside(batch)
        done += _volume(batch.part(outside))
        batch = batch.part(~outside)
        if not len(batch.centres):
            continue
        count += len(batch.centres)
        edges = question.edges(batch)
        open_boxes = edges >= 0
        done += _volume(batch.part(~open_boxes))
        wide = batch.part(open_boxes)
        if len(wide.centres) and count > most:
            raise OpenBoxError(
                f"the inequality is still undecided after {most} boxes", wide.centres[-1]
            )
        is_smallest = wide.depths.sum(axis=1) >= _DEEPEST * n
        is_smallest |= wide.depths.max(axis=1) >= _FINEST
        smallest = np.flatnonzero(is_smallest)
        if len(smallest):
            raise SmallestBoxError(
                "the inequality is undecided on a box of the smallest size",
                wide.centres[smallest[0]],
            )
        waiting = _joined(waiting, wide.halves(edges[open_boxes]))
        turn += 1
        if progress is not None and turn % _TOLD == 0:
            progress(done, 1.0, f"{count} boxes")
    return count


def _volume(boxes: Boxes) -> float:
    """Return the share of the cube's volume that the boxes fill."""
    return float(np.sum(np.ldexp(1.0, -boxes.depths.sum(axis=1))))


def _joined(first: Boxes, last: Boxes) -> Boxes:
    return Boxes(
        np.concatenate([first.centres, last.centres]), np.concatenate([first.depths, last.depths])
    )
