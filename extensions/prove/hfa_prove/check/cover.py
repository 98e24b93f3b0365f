"""Branch and bound: proof that functions are positive on a set within a cube.

The cube |y_i| <= 1 is subdivided. A box is decided if it is outside the set, or if every function
has a positive lower bound on it. An undecided box is halved across the edge that `Question.edges`
returns. Centers and half-widths are dyadic numbers, which doubles represent exactly. The order is
fixed. The proof can therefore be repeated without a stored tree.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple, Protocol

import numpy as np

from hfa_prove.fields import Rejected
from hfa_support.progress import Progress

#: Mean number of halvings of the edges of a box from which on it is not halved again.
_DEEPEST = 40
#: Largest number of halvings of an edge, so that centers are doubles.
_FINEST = 53
#: Number of batches between two reports of progress.
_TOLD = 4


class Boxes(NamedTuple):
    """Boxes with half-widths 2^-depths.

    centres: centers, (N, n)
    depths: number of halvings of each edge, (N, n)
    """

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
        """Return the boxes with the given indices.

        which: indices, mask or slice
        """
        return Boxes(self.centres[which], self.depths[which])

    def halves(self, across: np.ndarray) -> Boxes:
        """Return the lower halves of all boxes, followed by their upper halves.

        across: (N,), index of the edge that is halved
        """
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
    """Raised if a box is not decided.

    place: center of the box, (n,)
    """

    def __init__(self, text: str, place: np.ndarray) -> None:
        super().__init__(text)
        self.place = place


class RefutedError(OpenBoxError):
    """Raised if the property is false at a point of the set, in double precision."""


class SmallestBoxError(OpenBoxError):
    """Raised if an undecided box is too small to be halved."""


class Question(Protocol):
    """Property that is decided box by box on the cube |y_i| <= 1."""

    @property
    def n(self) -> int:
        """Dimension of the boxes."""

    @property
    def at_once(self) -> int:
        """Largest number of boxes that are evaluated in one batch."""

    def is_outside(self, boxes: Boxes) -> np.ndarray:
        """Return the mask (N,) of the boxes that are proved to contain no point of the set."""

    def edges(self, boxes: Boxes) -> np.ndarray:
        """Return for each box the index of the edge to halve, or -1 if the box is decided, (N,).

        Raises RefutedError at a point where the property does not hold.
        """


def refute(
    centres: np.ndarray, values: np.ndarray, within: Callable[[np.ndarray], np.ndarray]
) -> None:
    """Raise RefutedError if a value is negative at a point of the set.

    The error stores the point of the set with the lowest value.

    centres: points, (N, n)
    values: value at each point, (N,)
    within: points (N, n) -> mask (N,) of the points in the set
    """
    negative = np.flatnonzero(values < 0.0)
    refuted = negative[within(centres[negative])]
    if len(refuted):
        place = centres[refuted[np.argmin(values[refuted])]]
        raise RefutedError("the inequality does not hold at a point of the set", place)


def cover(question: Question, most: int, progress: Progress | None = None) -> int:
    """Prove a property on a set and return the number of boxes that were evaluated.

    Boxes outside the set are not counted.

    most: number of boxes after which the proof stops

    Raises RefutedError at a point where the property fails.
    Raises SmallestBoxError if an undecided box is too small to be halved.
    Raises OpenBoxError if a box is undecided after `most` boxes.
    """
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
    """Return the sum of the volumes of boxes, relative to the volume of the cube."""
    return float(np.sum(np.ldexp(1.0, -boxes.depths.sum(axis=1))))


def _joined(first: Boxes, last: Boxes) -> Boxes:
    return Boxes(
        np.concatenate([first.centres, last.centres]), np.concatenate([first.depths, last.depths])
    )
