"""Flights of a law that plans on the nonlinear model, compared with the best flights."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from controller.game.zero_sum import Game
from hfa_flight.initial_box import drawn_starts, start_box
from hfa_flight.policies.laws import LAWS, loaded
from hfa_flight.problem import flight_problem
from hfa_optimal.initial_conditions import StartsTable, starts_table
from hfa_optimal.search import BestFlights
from hfa_policy.flight_costs import Ratios
from hfa_support.progress import Progress
from hfa_support.reporting.report import Report
from hfa_support.reporting.text import Table
from trim.point.linearize import linearize
from trim.point.operating_point import OperatingPoint


@dataclass(frozen=True, eq=False)
class LawFlights:
    """Flights of a law from random initial conditions at several trims.

    law: name of the law
    points: the trims
    tables: flights from each trim, those of the law last
    share: share of the flights that must converge within the limits
    """

    law: str
    points: Sequence[OperatingPoint]
    tables: Sequence[StartsTable]
    share: float

    @property
    def lost(self) -> list[int]:
        """Number of flights at each trim that leave the limits or do not converge."""
        return [sum(each.policies[-1].lost for each in table.flights) for table in self.tables]

    @property
    def ok(self) -> bool:
        """True if enough flights converge within the limits at every trim."""
        most = [(1.0 - self.share) * table.starts + 1e-9 for table in self.tables]
        return all(lost <= allowed for lost, allowed in zip(self.lost, most, strict=True))

    def _ratios(self, table: StartsTable, policy: int) -> Ratios | None:
        flown = [each.policies[policy] for each in table.flights]
        return Ratios.of([each.over_best for each in flown if each.over_best and not each.lost])

    def report(self) -> Report:
        """Return the report: verdict, cost relative to the best flights, a row for each trim."""
        rows, data = [], []
        for point, table, lost in zip(self.points, self.tables, self.lost, strict=True):
            own, linear = (self._ratios(table, policy) for policy in (-1, 0))
            counts = (f"{lost} of {table.starts}", f"{table.found} of {table.starts}")
            numbers = [_text(own, "median"), _text(own, "worst"), _text(linear, "median")]
            rows.append((point.at_scheduled or "trim", *counts, *numbers))
            best = {
                "starts": table.starts,
                "found": table.found,
                "refused": table.refused,
                "not_converged": lost,
                "policy_over_best": own,
                "lqr_over_best": linear,
            }
            data.append({"operating_point": point, "best": best})
        header = ("trim", "lost", "best found", "median / best", "worst / best", "LQR / best")
        count = sum(table.starts for table in self.tables)
        returned = f"{count - sum(self.lost)} of {count} converge within the limits"
        ratios = [self._ratios(table, -1) for table in self.tables]
        medians = [each.median for each in ratios if each is not None]
        cost = f"; {max(medians):.3g}x the best flight" if medians else ""
        title = f"{'PASS' if self.ok else 'FAIL'}: {self.law}: {returned}{cost}"
        notes = (
            "Flights from random initial conditions, without delay, noise and gust. They do not "
            "prove that others converge."
        )
        contents: dict[str, Any] = {"law": self.law, "ok": self.ok, "points": data}
        return Report(f"{title}\n{notes}", [Table(header, rows)], data=contents)


def _text(ratios: Ratios | None, name: str) -> str:
    return "-" if ratios is None else f"{getattr(ratios, name):.4g}"


def law_flights(
    law: str,
    points: Sequence[OperatingPoint],
    game_at: Callable[[Any], Game],
    *,
    count: int,
    seed: int,
    box: dict[str, float],
    share: float,
    progress: Progress | None,
) -> LawFlights:
    """Return the flights of a law from random initial conditions at each trim.

    law: a name of LAWS
    game_at: linear model -> its game
    count: number of initial conditions at each trim
    box: linear state -> half-width of the box of initial conditions, in place of the usual one
    share: share of the flights that must converge within the limits
    """
    tables = []
    for point in points:
        game = game_at(linearize(point.model, point))
        problem = flight_problem(point.model, point, game.Q, game.R)
        widths = start_box(point.model, point)
        for name, width in box.items():
            widths[point.model.linear.index(name)] = width
        search = BestFlights(problem, count)
        policy = loaded(LAWS[law])(problem, game)
        loops = [search.flights.of_policy(policy)]
        starts = drawn_starts(problem, count, seed, np.asarray(widths))
        tables.append(starts_table(search, starts, loops, progress))
    return LawFlights(law, points, tables, share)
