"""The cost of a policy's flights relative to the best flights found, for `hfa assess --best`."""

from __future__ import annotations

import statistics
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import NamedTuple

from hfa_support.reporting.results import Result


class Ratios(NamedTuple):
    """Costs over those of the best flights found."""

    least: float
    median: float
    worst: float


@dataclass(frozen=True, eq=False)
class Bracket(Result):
    """Bounds of the least cost from one initial condition.

    start: state -> its deviation from the trim.
    lower_bound: no flight costs less, as a certificate proves.
    best: cost of the best flight found, or None where none was.
    policy: cost of the flight of the policy, or None where it does not end at the trim.
    """

    start: Mapping[str, float]
    lower_bound: float
    best: float | None
    policy: float | None


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
    offset_rate: cost per second of the equilibrium off the trim, or None without an equilibrium.
    brackets: one a start, or none without a certificate of a lower bound.
    """

    json_keys = (
        "initial_conditions=starts found refused not_converged=lost policy_over_best lqr_over_best "
        "offset_rate brackets"
    )

    starts: int
    found: int
    refused: int
    lost: int
    policy_over_best: Ratios | None
    lqr_over_best: Ratios | None
    offset_rate: float | None
    brackets: Sequence[Bracket] = ()

    @property
    def policy_over_bound(self) -> Ratios | None:
        """Cost of the flights of the policy that end at the trim, over the positive lower bounds,
        or None without any."""
        pairs = [
            (each.policy, each.lower_bound)
            for each in self.brackets
            if each.policy is not None and each.lower_bound > 0.0
        ]
        return ratios([cost / bound for cost, bound in pairs])

    def sentence(self) -> str:
        """Return the comparison in words."""
        if self.policy_over_best is None:
            return f"no flight of {self.found} ends at the trim where a best flight was found"
        least, median, worst = self.policy_over_best
        text = f"flights cost {least:.3g} to {worst:.3g} x the best found (median {median:.3g})"
        if self.lqr_over_best is not None:
            text += f", LQR {self.lqr_over_best.worst:.3g}"
        if self.lost:
            text += f", {self.lost} of {self.found} lost"
        return text

    def bound_sentence(self) -> str:
        """Return the distance of the policy's flights from the least possible cost, or "" without a
        bound."""
        if not self.brackets:
            return ""
        over = self.policy_over_bound
        if over is None:
            return "no flight that ends at the trim has a positive lower bound"
        return (
            f"flights cost at most {over.worst:.4g} x the least possible (median "
            f"{over.median:.4g}), by the proved bound"
        )


def ratios(values: Sequence[float]) -> Ratios | None:
    """The least, the median and the largest, or None without values."""
    if not values:
        return None
    return Ratios(min(values), statistics.median(values), max(values))
