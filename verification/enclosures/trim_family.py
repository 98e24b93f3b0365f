"""The flights that a statement is about: they differ in their dihedral alone."""

from __future__ import annotations

import math
from dataclasses import dataclass

from hfa_model.aircraft import Aircraft
from hfa_model.vectors import STATES
from hfa_support.errors import BadInputError
from trim.point.condition import BALANCED, LEVEL_FLIGHT, TrimCondition

#: At such a flight θ' = q and η' = η' are 0 already; what the unknowns of the trim move is left.
EQUATIONS = tuple(STATES.index(name) for name in ("speed", "alpha", "pitch_rate", "dihedral_rate"))


@dataclass(frozen=True)
class Family:
    """Steady flights that differ in their dihedral alone.

    aircraft: its parameters as doubles. flights: what is imposed and left free. spread: a half width for each
    parameter, (18,). decimals: every parameter and setting is a ball that also holds the decimal it was read from;
    else it is the double exactly.
    """

    aircraft: Aircraft
    flights: TrimCondition = LEVEL_FLIGHT
    spread: tuple[float, ...] | None = None
    decimals: bool = True

    def condition(self, degrees: float) -> TrimCondition:
        """The trim at a dihedral, degrees."""
        return self.flights.at(math.radians(degrees))

    def check(self, low: float, high: float) -> None:
        """BadInputError unless the trims of the interval, degrees, are of the kind that is proved."""
        first, last = (self.condition(end) for end in (low, high))
        for condition in (first, last):
            condition.check_pitch()
        still = all(first.imposed.get(name) == 0.0 for name in ("pitch_rate", "dihedral_rate"))
        still = still and dict(first.rates) == dict.fromkeys(BALANCED, 0.0)
        if not (still and len(first.free) == len(EQUATIONS) and "dihedral" in first.imposed):
            raise BadInputError(
                f"a proof takes trims at a given dihedral, all rates 0, with {len(EQUATIONS)} unknowns; "
                f"here free are {', '.join(first.free)}: change --hold and --free"
            )
        for name in self.flights.tables:
            raise BadInputError(f"{name} changes with the dihedral in this condition; --hold it at one value")
