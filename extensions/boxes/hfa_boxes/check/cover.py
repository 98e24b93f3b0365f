"""Branch and bound: functions are positive on the part of a cube where a set is.

The cube |y_i| <= 1 is halved again and again, always across the widest edge, until on each box
every function is bounded from below by a positive number or the box is outside the set. Centres and
half widths are dyadic, so that they are doubles without rounding. The order is fixed: who repeats
it needs no tree."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from hfa_boxes.enclosure.taylor import Models, lowest
from hfa_proof.checker.reading import Rejected
from hfa_support.errors import NoSolutionError
from hfa_support.progress import Progress

#: A box with narrower edges than 2^-this is not halved: what holds there by less is not proved.
_DEEPEST = 40

#: Slack for the rounding of a sum of squares of doubles.
_OUTSIDE = 1.0 + 1e-12
#: How often the search is reported.
_TOLD = 4


class Boxes(NamedTuple):
    """Centres (N, n), and how often each edge was halved (N, n)."""

    centres: np.ndarray
    depths: np.ndarray

    @property
    def half_widths(self) -> np.ndarray:
        """(N, n)."""
        return np.ldexp(1.0, -self.depths)

    def part(self, which: np.ndarray | slice) -> Boxes:
        """Some of them."""
        return Boxes(self.centres[which], self.depths[which])

    def halves(self) -> Boxes:
        """Both halves of each, across the first of the widest edges."""
        rows = np.arange(len(self.centres))
        across = np.argmin(self.depths, axis=1)
        depths = self.depths.copy()
        depths[rows, across] += 1
        step = np.ldexp(1.0, -depths[rows, across])
        lower = self.centres.copy()
        lower[rows, across] -= step
        upper = self.centres.copy()
        upper[rows, across] += step
        return Boxes(np.concatenate([lower, upper]), np.concatenate([depths, depths]))


def cube(n: int) -> Boxes:
    """|y_i| <= 1."""
    return Boxes(np.zeros((1, n)), np.zeros((1, n), dtype=int))


class OpenBoxError(NoSolutionError):
    """A box that is not decided.

    place: its centre (n,)
    """

    def __init__(self, text: str, place: np.ndarray) -> None:
        super().__init__(text)
        self.place = place


class RefutedError(OpenBoxError):
    """At a place in the set a function is not positive, as computed in doubles."""


@dataclass(frozen=True, eq=False)
class Inequality:
    """What is to be proved.

    n: of y
    over: Taylor models of the functions over boxes
    at_once: how many boxes it takes at a time
    hole: no box within |y_i| <= 2^-hole needs the first function; None without
    is_outside: boxes -> which do not meet the set
    within: place (n,) -> whether it is in the set
    """

    n: int
    over: Callable[[np.ndarray, np.ndarray], Models]
    at_once: int
    hole: int | None
    is_outside: Callable[[Boxes], np.ndarray]
    within: Callable[[np.ndarray], bool]


def outside_ball(boxes: Boxes) -> np.ndarray:
    """Which boxes do not meet the unit ball."""
    nearest = np.maximum(np.abs(boxes.centres) - boxes.half_widths, 0.0)
    return np.asarray(np.sum(nearest * nearest, axis=1) > _OUTSIDE)


def in_ball(place: np.ndarray) -> bool:
    """Whether a place is in the unit ball."""
    return bool(place @ place <= 1.0)


def cover(inequality: Inequality, most: int, progress: Progress | None = None) -> int:
    """The number of boxes that prove it.

    most: boxes after which it is given up

    RefutedError names a place where a function is not positive; OpenBoxError one that is not
    decided. Progress counts by volume."""
    n = inequality.n
    waiting = cube(n)
    done = 0.0
    count = 0
    turn = 0
    while len(waiting.centres):
        batch = waiting.part(slice(-inequality.at_once, None))
        waiting = waiting.part(slice(None, -inequality.at_once))
        outside = inequality.is_outside(batch)
        done += _volume(batch.part(outside))
        batch = batch.part(~outside)
        if not len(batch.centres):
            continue
        count += len(batch.centres)
        open_boxes = _open(inequality, batch)
        done += _volume(batch.part(~open_boxes))
        wide = batch.part(open_boxes)
        if len(wide.centres) and count > most:
            raise OpenBoxError(f"more than {most} boxes", wide.centres[-1])
        if np.any(wide.depths.sum(axis=1) >= _DEEPEST * n):
            raise OpenBoxError("a box as small as any", wide.centres[-1])
        waiting = _joined(waiting, wide.halves())
        turn += 1
        if progress is not None and turn % _TOLD == 0:
            progress(done, 1.0, f"{count} boxes")
    return count


def _open(inequality: Inequality, batch: Boxes) -> np.ndarray:
    """Which boxes are not proved; RefutedError at a place where the first function is negative."""
    models = inequality.over(batch.centres, batch.half_widths)
    proved = lowest(models, inequality.n) > 0.0
    if inequality.hole is not None:
        edge = np.max(np.abs(batch.centres) + batch.half_widths, axis=1)
        proved[0] |= edge <= 2.0**-inequality.hole
    at_centre = np.min(models.value + models.radius, axis=0)
    refuted = np.flatnonzero(at_centre < 0.0)
    for index in refuted[np.argsort(at_centre[refuted])]:
        place = batch.centres[index]
        if inequality.within(place):
            raise RefutedError("not positive at a place of the set", place)
    return np.asarray(~proved.all(axis=0))


def _volume(boxes: Boxes) -> float:
    """Share of the cube."""
    return float(np.sum(np.ldexp(1.0, -boxes.depths.sum(axis=1))))


def _joined(first: Boxes, last: Boxes) -> Boxes:
    return Boxes(
        np.concatenate([first.centres, last.centres]), np.concatenate([first.depths, last.depths])
    )


def rejected(error: OpenBoxError) -> Rejected:
    """What a checker says of it."""
    return Rejected(f"the inequality is not proved: {error}")
