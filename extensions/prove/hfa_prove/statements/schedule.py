"""Statement of a certificate about a gain schedule, and the numbers that its proof needs.

The checker interprets or refuses every entry. The digest covers all entries, and reports show them.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from itertools import pairwise
from typing import Any

import numpy as np

from hfa_prove.fields import Fields, Stated, entry, part, require
from hfa_prove.statements.flight import Flight

#: Largest number of pieces that a certificate may state.
_MOST_PIECES = 10_000_000


def _read_breakpoints(file: Fields, name: str, known: Any) -> np.ndarray:
    """Return increasing scheduling values, or one value of a constant gain."""
    values = file.array(name, None)
    require(len(values) > 0 and bool(np.all(np.diff(values) > 0.0)), name)
    return values


@dataclass(frozen=True, eq=False)
class Gains(Stated):
    """Gain schedule u = u0 - K(η) (x - x0), with K linear in η between breakpoints.

    breakpoints: scheduling values, (g,), increasing. With one value, K is constant.
    K: (g, m, n), in the order of the inputs and of the states of the linear model
    """

    breakpoints: np.ndarray = entry(_read_breakpoints, subject="gains")
    K: np.ndarray = entry(
        lambda file, name, known: file.array(
            name, len(known.breakpoints), len(known.model.inputs), len(known.model.linear)
        ),
        subject="gains",
    )

    def pieces(self, low: float, high: float) -> list[tuple[float, float]]:
        """Return the parts of [low, high] between breakpoints.

        Raises Malformed if the breakpoints do not cover the interval.
        """
        first, last = float(self.breakpoints[0]), float(self.breakpoints[-1])
        if first == last:
            return [(low, high)]
        require(first <= low and high <= last, "gains: breakpoints", [first, last])
        cuts = [low, *(cut for cut in self.breakpoints.tolist() if low < cut < high), high]
        return list(pairwise(cuts))


@dataclass(frozen=True, eq=False)
class ScheduleStatement(Stated):
    """Claim about the linear loop x' = (A - B K) x at the trims of an aircraft.

    For every scheduling value η of the flight, within all limits, there is one trim on the smooth
    branch of trims that begins at `flight.first`, and no other trim near it. With A and B there:

    - Re λ < -decay_rate for every eigenvalue λ of A - B K(η)
    - with `scheduled_rate`: x' = (A - B K(η(t))) x is uniformly exponentially stable for every
      absolutely continuous η(t) in the interval with |η'| <= scheduled_rate, and for every
      measurable η(t) if the rate is infinite

    flight: aircraft and its trims
    gains: the gain schedule
    decay_rate: 1/s, at least 0
    scheduled_rate: unit of the scheduling values per s, infinite for any motion, or None
    """

    flight: Flight = part(Flight)
    gains: Gains = entry(
        lambda file, name, known: Gains.read(file.fields(name), known.flight),
        store=lambda gains: gains.content(),
    )
    decay_rate: float = entry(lambda file, name, known: file.number(name, least=0.0))
    scheduled_rate: float | None = entry(
        lambda file, name, known: file.positive(name) if file.has(name) else None,
        store=lambda rate: "inf" if math.isinf(rate) else rate,
        default=None,
    )

    def check_consistent(self) -> None:
        """Raise Malformed if the breakpoints do not cover the interval."""
        self.gains.pieces(*self.flight.range)


def _read_witness_breakpoints(file: Fields, name: str, known: Any) -> np.ndarray:
    """Return the scheduling values of P, (l,), none if the statement has no scheduled rate."""
    if known.statement.scheduled_rate is None:
        return np.zeros(0)
    return _read_breakpoints(file, name, known)


def _read_matrices(file: Fields, name: str, known: Any) -> np.ndarray:
    """Return the symmetric matrices P, (l, n, n), none if the statement has no scheduled rate."""
    n = len(known.statement.flight.model.linear)
    if known.statement.scheduled_rate is None:
        return np.zeros((0, n, n))
    P = file.array(name, len(known.breakpoints), n, n)
    require(np.array_equal(P, P.transpose(0, 2, 1)), "witness: P: not symmetric")
    return P


@dataclass(frozen=True, eq=False)
class ScheduleWitness(Stated):
    """Numbers for the proof of a schedule, not part of the claim.

    pieces: number of pieces after which the checker stops
    breakpoints: scheduling values of P, (l,), increasing; one value of a constant P; empty without
        a rate
    P: (l, n, n), symmetric. V = x'P(η)x with P linear between breakpoints decreases on every
        motion.
    """

    pieces: int = entry(lambda file, name, known: file.count(name, _MOST_PIECES))
    breakpoints: np.ndarray = entry(_read_witness_breakpoints)
    P: np.ndarray = entry(_read_matrices)

    def content(self) -> dict[str, Any]:
        """Return the certificate's entry `witness`, without P if there is none."""
        return {name: value for name, value in super().content().items() if value != []}
