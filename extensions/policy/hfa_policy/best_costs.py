"""What flights of a policy cost beside the best flights found, as `hfa assess --best` says it."""

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
    """Flights of a policy at one trim beside the best that were found.

    starts: how many starts were flown.
    found: from how many a best flight was found.
    refused: from how many none was found, or the simulator refuted it.
    lost: flights of the policy, of those starts, that left the envelope or do not end at the trim.
    policy_over_best: cost of the flights of the policy that end at the trim, over the best; None
        where none does.
    lqr_over_best: the linear optimum's, clipped at the limits of the inputs; None where none does.
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
