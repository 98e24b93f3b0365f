"""Costs of a policy's flights relative to the best flights found, for `hfa assess --best`."""

from __future__ import annotations

import statistics
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import NamedTuple

from hfa_aircraft.model import Model
from hfa_support.reporting.results import Result, stored_as
from hfa_support.reporting.text import Table


class Ratios(NamedTuple):
    """Least, median and largest cost, relative to the best flights found."""

    least: float
    median: float
    worst: float


@dataclass(frozen=True, eq=False)
class Bracket(Result):
    """Lower bound and known costs of flights from one initial condition.

    start: state -> initial deviation from the trim.
    lower_bound: lower bound on the cost, proved by a certificate.
    best: cost of the best flight found, or None.
    policy: cost of the policy's flight, or None if it does not end at the trim.
    beyond: True if lower_bound is the level of the certified set, because the initial condition is
        not inside this set.
    """

    start: Mapping[str, float]
    lower_bound: float
    best: float | None
    policy: float | None
    beyond: bool = False


@dataclass(frozen=True, eq=False)
class BestCosts(Result):
    """Flights of a policy at one trim, compared with the best flights found.

    starts: number of initial conditions.
    found: number of initial conditions with a best flight.
    refused: number of initial conditions for which no flight was found, or for which the simulation
        did not confirm the flight.
    lost: number of the policy's flights that leave the envelope or do not end at the trim, from the
        initial conditions with a best flight.
    policy_over_best: cost of the policy's flights that end at the trim, relative to the best, or
        None if no flight ends at the trim.
    lqr_over_best: cost of the flights with the saturated linear optimum, relative to the best, or
        None if no flight ends at the trim.
    offset_rate: cost per second of the steady-state error, or None without an equilibrium.
    brackets: bounds on the cost from each initial condition with a lower bound, or empty without a
        certificate.
    """

    starts: int = field(metadata=stored_as("initial_conditions"))
    found: int
    refused: int
    lost: int = field(metadata=stored_as("not_converged"))
    policy_over_best: Ratios | None
    lqr_over_best: Ratios | None
    offset_rate: float | None
    brackets: Sequence[Bracket] = ()

    def sentence(self) -> str:
        """Return a phrase on the costs relative to the best flights.

        The costs are those of the policy and of the linear optimum.
        """
        if self.policy_over_best is None:
            return f"none of the {self.found} flights with a best flight ends at the trim"
        least, median, worst = self.policy_over_best
        text = f"flights cost {least:.3g} to {worst:.3g} x the best found (median {median:.3g})"
        if self.lqr_over_best is not None:
            text += f", LQR {self.lqr_over_best.worst:.3g}"
        if self.lost:
            text += f", {self.lost} of {self.found} do not converge"
        return text

    def bound_sentence(self) -> str:
        """Return a phrase on the policy's costs relative to the lower bounds.

        The phrase is "" without lower bounds.
        """
        if not self.brackets:
            return ""
        return bracket_sentence((each, each.policy) for each in self.brackets)


def bracket_sentence(costs: Iterable[tuple[Bracket, float | None]]) -> str:
    """Return a phrase on the ratios of flight costs to their positive lower bounds.

    costs: each lower bound with the cost of a flight from its initial condition, or None for a
        flight that does not end at the trim
    """
    inside: list[float] = []
    beyond: list[float] = []
    for bracket, cost in costs:
        if cost is None or bracket.lower_bound <= 0.0:
            continue
        ratios_there = beyond if bracket.beyond else inside
        ratios_there.append(cost / bracket.lower_bound)
    if not inside and not beyond:
        return "no flight with a positive lower bound ends at the trim"
    if not inside:
        return "beyond the level of the bound"
    words = f"between 1.00 and {max(inside):.2f} of the best possible"
    return f"{words}, {len(beyond)} beyond the level" if beyond else words


def bracket_table(model: Model, brackets: Sequence[Bracket]) -> Table:
    """Return a table of the lower bound and the known costs for each initial condition.

    The column of the policy is omitted if no cost of the policy is known.
    """
    is_flown = any(each.policy is not None for each in brackets)
    rows = []
    for each in brackets:
        bound = f"{each.lower_bound:.6g}" + (" (level)" if each.beyond else "")
        costs = (each.best, each.policy) if is_flown else (each.best,)
        words = [_number(cost) for cost in costs]
        rows.append((deviations_in_words(model, each.start), bound, *words))
    header = ("initial condition", "no flight costs less than", "best found")
    return Table((*header, "policy") if is_flown else header, rows)


def _number(value: float | None) -> str:
    return "-" if value is None else f"{value:.6g}"


def deviations_in_words(model: Model, start: Mapping[str, float]) -> str:
    """Return the deviations from the trim as printed in reports.

    start: state -> deviation
    """
    return ", ".join(_off(model, name, value) for name, value in start.items()) or "the trim"


def _off(model: Model, name: str, value: float) -> str:
    text = model.describe(name, value)
    return f"{name} {text}" if text.startswith("-") else f"{name} +{text}"


def ratios(values: Sequence[float]) -> Ratios | None:
    """Return the least, the median and the largest value, or None if `values` is empty."""
    if not values:
        return None
    return Ratios(min(values), statistics.median(values), max(values))
