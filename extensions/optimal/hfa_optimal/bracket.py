"""Lower bounds and known costs of flights."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from hfa_aircraft.model import Model
from hfa_support.reporting.results import Result
from hfa_support.reporting.text import Table

if TYPE_CHECKING:
    from hfa_prove.statements.cost import CostStatement


@dataclass(frozen=True, eq=False)
class Bracket(Result):
    """Lower bound and known costs of flights from one initial condition.

    start: state -> initial deviation from the trim.
    lower_bound: lower bound on the cost, proved by a certificate.
    best: cost of the best flight found, or None.
    beyond: True if lower_bound is the level of the certified set, because the initial condition is
        not inside this set.
    """

    start: Mapping[str, float]
    lower_bound: float
    best: float | None
    beyond: bool = False


def bracket_of(
    bound: CostStatement, z: np.ndarray, start: Mapping[str, float], cost: float | None
) -> Bracket:
    """Return the lower and upper bound of the least cost from an initial condition.

    bound: statement of a certificate, from which the lower bound is computed
    z: initial deviations from the trim, (k,)
    start: the same deviations by name of the state
    cost: cost of the best flight found, which is the upper bound, or None if none was found
    """
    lower = float(bound.bound(z[None])[0])
    return Bracket(start, lower, cost, lower >= bound.level)


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
    """Return a table of the lower bound and the lowest known cost for each initial condition."""
    rows = []
    for each in brackets:
        bound = f"{each.lower_bound:.6g}" + (" (level)" if each.beyond else "")
        best = "-" if each.best is None else f"{each.best:.6g}"
        rows.append((deviations_in_words(model, each.start), bound, best))
    return Table(("initial condition", "no flight costs less than", "best found"), rows)


def deviations_in_words(model: Model, start: Mapping[str, float]) -> str:
    """Return the deviations from the trim as printed in reports.

    start: state -> deviation
    """
    return ", ".join(_off(model, name, value) for name, value in start.items()) or "the trim"


def _off(model: Model, name: str, value: float) -> str:
    text = model.describe(name, value)
    return f"{name} {text}" if text.startswith("-") else f"{name} +{text}"
