"""Best flights from many initial conditions, compared with flights of policies."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from hfa_aircraft.model import Model
from hfa_flight.needs import is_enough, need_text
from hfa_flight.plan.best_flight import BestFlight, limits_of_flights, line_with_ratios
from hfa_flight.plan.problem import FlightProblem, OfProblem, drawn_starts, flight_problem
from hfa_flight.plan.search import BestFlights
from hfa_flight.simulate.envelope import RULE, FlightRow
from hfa_flight.simulate.simulation import CompiledLoop
from hfa_support.arguments import ArrayLike
from hfa_support.errors import NoSolutionError
from hfa_support.progress import Progress, interruption
from hfa_support.reporting.report import Report, Reported
from hfa_support.reporting.results import Entries, Result
from hfa_support.reporting.rows import Group, Row
from hfa_support.reporting.text import Table
from trim.point.operating_point import OperatingPoint


@dataclass(frozen=True, eq=False)
class StartFlights(Result):
    """Flights from one initial condition.

    start: state -> initial deviation from the trim.
    cost: cost of the best flight, or None if no flight was found.
    reason: reason why no candidate of the optimizer was confirmed, or None if one was. A cost with
        a reason is that of the cheapest simulated flight.
    spread: relative difference of the costs on the two meshes, or None with a reason.
    linear_cost: cost z'Pz of the linear model without limits.
    policies: flights of the policies, the saturated linear optimum first.
    """

    start: Mapping[str, float]
    cost: float | None
    reason: str | None
    spread: float | None
    linear_cost: float
    policies: Sequence[FlightRow]


@dataclass(frozen=True, eq=False)
class PolicySummary(Result):
    """Summary of a policy's flights from all initial conditions from which a best flight was found.

    policy: name of the policy.
    not_converged: number of flights that left the envelope or are not at the trim.
    left: number of flights that left the envelope.
    median: median of the cost relative to the best flights found, over the flights that converge,
        or None if none converges.
    high: 90 % quantile of this relative cost, or None if no flight converges.
    worst: largest value of this relative cost, or None if no flight converges.
    """

    policy: str
    not_converged: int
    left: int
    median: float | None
    high: float | None
    worst: float | None

    def row(self) -> Row:
        """Return the row of a report: the median, with the other figures in its note."""
        counts = f"{self.not_converged} do not converge"
        if self.left:
            counts += f" ({self.left} leave the envelope)"
        if self.median is None:
            return Row(self.policy, "-", note=counts)
        note = f"90 %: {self.high:.4g}, worst: {self.worst:.4g}; {counts}"
        return Row(self.policy, self.median, note=note)


@dataclass(frozen=True, eq=False, repr=False)
class StartsTable(OfProblem, Result, Reported):
    """Best flights from many initial conditions.

    problem: aircraft, trim, weights and limits.
    flights: flights from each initial condition.
    asked: number of requested initial conditions. `flights` contains fewer after an interruption.
    judged: names of the policies whose flights decide the verdict, besides the best flights.
    share: share of the initial conditions that must succeed, or None for no verdict.
    """

    schema = "hfa.best-flights/1"

    problem: FlightProblem
    flights: tuple[StartFlights, ...]
    asked: int
    judged: Sequence[str] = ()
    share: float | None = None

    @property
    def starts(self) -> int:
        """Number of initial conditions whose flights are finished."""
        return len(self.flights)

    @property
    def found(self) -> int:
        """Number of initial conditions from which a best flight was found."""
        return sum(best.cost is not None for best in self.flights)

    def failures(self) -> list[str]:
        """Return a sentence on the best flights, and on each judged policy, if too few succeed."""
        if self.share is None:
            return []
        successes = {"a best flight is found": self.found}
        rows = [row for start in self.flights for row in start.policies]
        for name in self.judged:
            converging = sum(row.converges for row in rows if row.policy == name)
            successes[f"the {name} converges within the limits"] = converging
        return [
            f"{what} from {count} of {self.starts} initial conditions{need_text(self.share)}"
            for what, count in successes.items()
            if not is_enough(count, self.starts, self.share)
        ]

    @property
    def ok(self) -> bool:
        """True if best flights are found from enough initial conditions and no policy fails."""
        return not self.failures()

    @property
    def upper_bounds(self) -> int:
        """Number of best flights that are only the cheapest simulated flight."""
        return sum(best.cost is not None and best.reason is not None for best in self.flights)

    @property
    def refused(self) -> int:
        """Number of initial conditions from which no flight was found and confirmed."""
        return self.starts - self.found

    @property
    def policies(self) -> Sequence[PolicySummary]:
        """Summary of the flights of each policy, from initial conditions with a best flight
        only.
        """
        rows = [best.policies for best in self.flights if best.cost is not None]
        return [_summary(column) for column in zip(*rows, strict=True)]

    def _entries(self) -> dict[str, Any]:
        """Return the entries of the file, name -> value."""
        return {
            "Q": self.problem.Q,
            "R": self.problem.R,
            "flights": self.flights,
            "operating_point": self.point,
            "starts": self.starts,
            "found": self.found,
            "refused": self.refused,
            "policies": self.policies,
        }

    def report(self) -> Report:
        """Return the report: flights found, cost ratios of policies, refused flights, limits."""
        reasons = [best.reason for best in self.flights if best.reason is not None]
        refused = (
            f"no candidate confirmed from {reasons.count(reason)} initial conditions: {reason}"
            for reason in dict.fromkeys(reasons)
        )
        parts = (
            Group("median cost over the best", tuple(summary.row() for summary in self.policies)),
            tuple(refused),
            self.weights_text(),
            RULE,
            limits_of_flights(self.problem),
        )
        title = "\n".join(self._title_lines())
        return Report(title, parts, data=Entries(self), records=self._records())

    def _title_lines(self) -> list[str]:
        """Return the first lines: flights found, median cost ratios, and what limits the result."""
        begin = f"Best flights: {self.found} of {self.starts} found"
        if self.starts < self.asked:
            begin += f" (interrupted; {self.asked} requested)"
        outcomes = []
        for summary in self.policies:
            count = summary.not_converged
            end = f"{count} not converged" if count else ""
            outcomes.append((summary.policy, summary.median, end))
        if not self.found:
            begin += "; no cost ratio without a flight"
        lines = [f"FAIL: {text}" for text in self.failures()]
        lines.append(line_with_ratios(begin, outcomes))
        whose = f"{self.problem.model.title} {self.point.at_scheduled}".strip()
        lines.append(f"to {whose}, from {self.starts} initial conditions")
        if self.upper_bounds:
            lines.append(f"{self.upper_bounds} only as the cheapest simulated flight")
        return lines

    def _records(self) -> Table:
        """Return the table of initial deviations and costs, one row for each initial condition."""
        states = self.problem.states
        policies = [summary.policy for summary in self.policies]
        rows = []
        for best in self.flights:
            costs = [row.cost if row.converges else None for row in best.policies]
            all_costs = (best.cost, best.linear_cost, *costs)
            rows.append((*(best.start[name] for name in states), *all_costs))
        return Table((*states, "best", "linear_model", *policies), rows)


def _summary(flights: Sequence[FlightRow]) -> PolicySummary:
    """Return the summary of the flights of one policy."""
    ratios = [flight.over_best for flight in flights if flight.over_best is not None]
    not_converged = sum(not flight.converges for flight in flights)
    left = sum(flight.departure is not None for flight in flights)
    median = high = worst = None
    if ratios:
        median, high, worst = np.quantile(ratios, [0.5, 0.9, 1.0]).tolist()
    return PolicySummary(flights[0].policy, not_converged, left, median, high, worst)


def _flights_from(
    search: BestFlights, start: np.ndarray, loops: Sequence[CompiledLoop]
) -> StartFlights:
    """Return the best flight, and the flights of the linear optimum and of the policies."""
    problem = search.problem
    found = search.found(start, loops)
    cost = None if found.flown is None else found.flown.cost
    return StartFlights(
        start=dict(zip(problem.states, start.tolist(), strict=True)),
        cost=cost,
        reason=found.reason or None,
        spread=None if found.candidate is None else found.spread,
        linear_cost=float(start @ problem.P @ start),
        policies=[flight.row(cost) for flight in found.compared],
    )


def optimize(
    model: Model,
    point: OperatingPoint,
    initial: Mapping[str, float] | OperatingPoint,
    Q: ArrayLike | Mapping[str, float] | None = None,
    R: ArrayLike | Mapping[str, float] | None = None,
    *,
    inputs: Sequence[str] | None = None,
    limits: Mapping[str, Any] | None = None,
    policies: Mapping[str, Any] | None = None,
) -> BestFlight:
    """Return the cheapest flight found from an initial condition to a trim.

    The cost is ∫ z'Qz + v'Rv dt, where z and v are the deviations from the trim. Collocation
    proposes a flight, which is a local optimum, and a simulation follows it. The result is the
    cheapest of this flight, that of the linear optimum and those of the policies. If the simulation
    confirms no proposed flight, `BestFlight.reason` is the reason.

    model: the aircraft
    point: trim at which the flight ends
    initial: state of the linear model -> deviation from the trim, in the units of the model, or
        another trim
    Q, R: weights, as `hfa.game` accepts them and with its defaults. R is the weight of the
        moving inputs.
    inputs: inputs that move, by default all. The others are constant.
    limits: state -> (lowest, highest), absolute, replacing the limits of the flight envelope
    policies: name -> policy, in any form that `hfa.fly` accepts, flown from the same initial
        condition for comparison (`BestFlight.policies`). Gains and critics are saturated

    Raises BadInputError for unknown names and an initial condition outside the limits. Raises
    NoSolutionError if no simulated flight within the limits converges.

    >>> import hfa
    >>> cart = hfa.Model(
    ...     "cart",
    ...     {"position": hfa.Signal("m"), "velocity": hfa.Signal("m/s")},
    ...     {"force": hfa.Signal("N", min=-1.0, max=1.0)},
    ...     lambda x, u, p, w: ({"position": x.velocity, "velocity": u.force}, {}),
    ...     trim={"position": 0.0},
    ... )
    >>> point = hfa.trim(cart)
    >>> round(hfa.optimize(cart, point, {"position": 0.1}).cost, 4)  # sqrt(3) position²
    0.0173
    """
    problem = flight_problem(model, point, Q, R, inputs, limits)
    start = problem.deviations(initial)
    search = BestFlights(problem)
    loops = [search.flights.of(name, policy) for name, policy in (policies or {}).items()]
    found = search.found(start, loops)
    if found.flown is None:
        raise NoSolutionError(f"no flight found: {found.reason}")
    return BestFlight(problem, found, found.flown)


def optimize_starts(
    problem: FlightProblem,
    starts: int,
    policies: Mapping[str, Any],
    *,
    seed: int,
    progress: Progress | None,
) -> StartsTable:
    """Return the best flights from random initial conditions in the default box, and those of
    policies. After Ctrl-C, the table contains only the finished initial conditions.

    starts: number of initial conditions
    policies: as for `optimize`
    seed: seed of the initial conditions
    """
    search = BestFlights(problem, starts)
    loops = [search.flights.of(name, policy) for name, policy in policies.items()]
    done: list[StartFlights] = []
    with interruption() as asked:
        for start in drawn_starts(problem, starts, seed):
            done.append(_flights_from(search, start, loops))
            if progress is not None:
                progress(len(done), starts)
            if asked.is_set():
                break
    return StartsTable(problem, tuple(done), starts)
