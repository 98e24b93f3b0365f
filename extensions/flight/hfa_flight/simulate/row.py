"""Row of a flight with a cost: how it ends, what it costs, and what it reaches."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

from hfa_aircraft.batch_simulation import RESOLVED, Outcome
from hfa_flight.simulate.envelope import Departure
from hfa_support.reporting.results import Result


@dataclass(frozen=True, eq=False, kw_only=True)
class FlightRow(Result):
    """Flight of a policy from an initial condition to a trim, without its time history.

    policy: name of the policy.
    cost: cost of the flight and of the linear policy after it, or inf if the flight leaves the
        envelope or has not returned to the trim.
    departure: first departure from the envelope (state, time, value, limit), or None if the flight
        stays within.
    saturated: names of the inputs that reach a limit.
    seconds: duration of the simulation, s.
    integration_error: sum of the errors of the steps that could not be made short enough, relative
        to the largest deviation in nominal values.
    best: cost of the best flight from the same initial condition, or None if none was found.
    """

    policy: str
    cost: float
    departure: Departure | None
    saturated: tuple[str, ...]
    seconds: float
    integration_error: float = 0.0
    best: float | None = None

    @property
    def converges(self) -> bool:
        """True if the flight stays within the envelope and returns to the trim."""
        return math.isfinite(self.cost)

    @property
    def over_best(self) -> float | None:
        """Cost relative to that of the best flight, or None without one of them."""
        return self.cost / self.best if self.converges and self.best is not None else None

    @property
    def resolved(self) -> bool:
        """True if the error of the integration does not change three digits of the cost."""
        return self.integration_error <= RESOLVED

    @property
    def loss(self) -> str:
        """How the flight is lost, or "" if it converges."""
        if self.departure is not None:
            return "leaves the envelope"
        return "" if self.converges else f"not at the trim after {self.seconds:.3g} s"

    def outcome(self) -> str:
        """Return the outcome in words, with the state and limit of a departure."""
        departure = "" if self.departure is None else self.departure.text()
        return departure or self.loss or Outcome.CONVERGED

    def _entries(self) -> dict[str, Any]:
        """Return the entries of the file, name -> value."""
        return {
            "policy": self.policy,
            "converges": self.converges,
            "cost": self.cost if self.converges else None,
            "over_best": self.over_best,
            "departure": self.departure,
            "saturated": self.saturated,
            "seconds": self.seconds,
            "resolved": self.resolved,
        }
