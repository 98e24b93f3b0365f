"""Boxes of a scheduling variable, such as the dihedral."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from contextlib import suppress
from dataclasses import dataclass
from functools import cached_property
from typing import TypeVar

from flint import arb

from verification.arithmetic.ball_function import Undecided
from verification.arithmetic.balls import exact, interval

Proved = TypeVar("Proved")

#: Coefficients of the polynomial: 1, τ, τ². The remainder is of third order.
ORDER = 3


@dataclass(frozen=True)
class PlaceBox:
    """The places η from `low` to `high`, both included; low < high, exact doubles. Of an angle they are degrees.

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
    def places(self) -> arb:
        """The ball of all places of the box."""
        return interval(self.low, self.high)

    def halves(self) -> tuple[PlaceBox, PlaceBox]:
        """The box in two, at the double nearest to its middle."""
        cut = float(self.middle)
        return PlaceBox(self.low, cut), PlaceBox(cut, self.high)


def bisected(
    boxes: list[PlaceBox], prove: Callable[[PlaceBox], Proved | None], narrowest: float, start: float = -math.inf
) -> Iterator[tuple[PlaceBox, Proved | None]]:
    """Each box with what `prove` returns, or its halves where that is None or it is `Undecided`.

    A box no wider than `narrowest` is not halved but comes with None. Boxes up to `start` are passed over,
    and bisected as if none of them had been proved as a whole: a continued proof has the same boxes there.
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
