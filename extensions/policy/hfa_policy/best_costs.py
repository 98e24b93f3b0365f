"""The cost of a policy's flights relative to the best flights found, of `hfa assess --best`."""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

from hfa_support.reporting.results import Result


class Ratios(NamedTuple):
    """Costs over those of the best flights found."""

    least: float
    median: float
    worst: float


@dataclass(frozen=True, eq=False)
class BestCosts(Result):
    """Flights of a policy at one trim, compared with the best flights found.

    starts: number of initial conditions.
    found: number of initial conditions with a best flight.
    refused: number of those for which none was found, or the simulator refuted it.
    lost: flights of the policy from these initial conditions that left the envelope or do not end
        at the trim.
    policy_over_best: cost of the policy's flights that end at the trim, relative to the best; None
        where none does.
    lqr_over_best: cost of the linear optimum, saturated, relative to the best; None where none ends
        at the trim.
    offset_rate: cost per second of the equilibrium off the trim; None without an equilibrium.
    """

    starts: int
    found: int
    refused: int
    lost: int
    policy_over_best: Ratios | None
    lqr_over_best: Ratios | None
    offset_rate: float | None

    def sentence(self) -> str:
        """In words."""
        if self.policy_over_best is None:
            return f"no flight of {self.found} ends at the trim where a best flight was found"
        least, median, worst = self.policy_over_best
        text = f"flights cost {least:.3g} to {worst:.3g} x the best found (median {median:.3g})"
        if self.lqr_over_best is not None:
            text += f", LQR {self.lqr_over_best.worst:.3g}"
        if self.lost:
            text += f", {self.lost} of {self.found} lost"
        return text
