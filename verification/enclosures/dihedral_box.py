"""Boxes of dihedral, and series in it."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from contextlib import suppress
from dataclasses import dataclass
from functools import cached_property
from typing import TypeVar

from flint import arb, arb_series

from verification.arithmetic.ball_function import Undecided
from verification.arithmetic.balls import exact, interval

Proved = TypeVar("Proved")

#: Coefficients of the polynomial: 1, τ, τ². The remainder is of third order.
ORDER = 3


@dataclass(frozen=True)
class DihedralBox:
    """The dihedral angles from `low` to `high`, degrees, both included; low < high, exact doubles.

    s = (η - middle) / radius is the place of a Taylor model on the box.
    """

    low: float
    high: float

    @cached_property
    def middle(self) -> arb:
        """(low + high) / 2, exact."""
        return (exact(self.low) + exact(self.high)) / 2

    @cached_property
    def radius(self) -> arb:
        """(high - low) / 2, exact."""
        return (exact(self.high) - exact(self.low)) / 2

    @cached_property
    def degrees(self) -> arb:
        """The ball of all angles of the box, degrees."""
        return interval(self.low, self.high)

    def halves(self) -> tuple[DihedralBox, DihedralBox]:
        """The box in two, at the double nearest to its middle."""
        cut = float(self.middle)
        return DihedralBox(self.low, cut), DihedralBox(cut, self.high)


def bisected(
    boxes: list[DihedralBox], prove: Callable[[DihedralBox], Proved | None], narrowest: float, start: float = -math.inf
) -> Iterator[tuple[DihedralBox, Proved | None]]:
    """Each box with what `prove` returns, or its halves where that is None or it is `Undecided`.

    A box no wider than `narrowest`, degrees, is not halved but comes with None. Boxes up to `start` are passed over,
    and bisected as if none of them had been proved as a whole: what is continued there has the same boxes.
    """
    waiting = boxes[::-1]
    while waiting:
        box = waiting.pop()
        if box.high <= start:
            continue
        wide, proved = box.high - box.low > narrowest, None
        if not (wide and box.low < start):
            with suppress(Undecided):
                proved = prove(box)
        if proved is None and wide:
            waiting += box.halves()[::-1]
        else:
            yield box, proved


def radians(degrees: arb) -> arb:
    """The angle in radians, π enclosed."""
    return degrees * arb.pi() / 180


def dihedral_series(degrees: arb, length: int) -> arb_series:
    """η(τ) = degrees + τ, in radians, as a series in τ (degrees) of `length` coefficients."""
    return arb_series([radians(degrees), radians(exact(1.0))], prec=length)
