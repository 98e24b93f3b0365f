"""Best flight found from an initial condition to a trim, and its report."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

import numpy as np

from hfa_aircraft.signals import StatesAndInputs
from hfa_flight.envelope import limits_text
from hfa_flight.problem import FlightProblem, OfProblem
from hfa_optimal.bracket import Bracket, bracket_sentence, deviations_in_words
from hfa_optimal.flights import SimulatedFlight
from hfa_optimal.search import MESHES_AGREE, Found
from hfa_optimal.smooth import has_kinks
from hfa_support.reporting.named import with_names
from hfa_support.reporting.parts import Picture
from hfa_support.reporting.report import Report, Reported
from hfa_support.reporting.results import UNSTORED, Matrix, Result, Vector, stored, stored_parts
from hfa_support.reporting.text import Table, shown_unit

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from hfa_prove.statements.cost import CostStatement


@dataclass(frozen=True, eq=False)
class PolicyFlight(Result):
    """Flight of a policy, compared with the best flight found from the same initial condition.

    policy: name of the policy.
    converges: whether the flight converges to the trim.
    cost: cost of the flight, or None if the flight does not converge.
    over_best: cost of the flight divided by the cost of the best flight found, or None if the
        flight does not converge or no best flight was found.
    departure: first departure from the envelope (state, time, value, limit), or None if the flight
        stays within.
    saturated: names of saturated inputs.
    """

    policy: str
    converges: bool
    cost: float | None
    over_best: float | None
    departure: Any
    saturated: Sequence[str]

    @property
    def lost(self) -> bool:
        """True if the flight left the envelope or does not converge to the trim."""
        return self.departure is not None or not self.converges

    @staticmethod
    def of(flown: SimulatedFlight, best: float | None) -> PolicyFlight:
        """Return the record of a policy's simulated flight and its cost relative to the best
        flight.

        best: cost of the best flight from the same initial condition, or None if none was found
        """
        cost = flown.cost if flown.converges else None
        ratio = None if cost is None or best is None else cost / best
        return PolicyFlight(
            flown.name, flown.converges, cost, ratio, flown.departure, list(flown.saturated)
        )


@dataclass(frozen=True, eq=False, repr=False)
class BestFlight(OfProblem, StatesAndInputs, Result, Reported):
    """Best flight found from an initial condition to a trim within limits.

    The cost of the simulated flight is an upper bound of the least cost. A cheaper flight may
    exist.

    problem: aircraft, trim, weights and limits.
    found: the flight, and the optimizer's proposal that the flight follows, if it was confirmed.
    others: flights of policies from the same initial condition.
    bracket: bounds of the least cost, or None without a certificate.

    >>> import hfa
    >>> force = hfa.Signal("N", min=-1.0, max=1.0)
    >>> def moved(x, u, p, w):
    ...     return {"speed": u.force}, {}
    >>> slider = hfa.Model("slider", {"speed": hfa.Signal("m/s")}, {"force": force}, moved)
    >>> best = hfa.optimize(slider, hfa.trim(slider), {"speed": 3.0})
    >>> round(best.cost, 2), best.saturated  # (3³ - 1)/3 + 2 while the force is 1, then 1
    (11.67, ['force'])
    """

    schema = "hfa.best-flight/1"
    made_by = "hfa optimize"

    problem: FlightProblem = field(metadata=stored_parts(Q="Q", R="R"))
    found: Found = field(metadata=UNSTORED)
    others: tuple[SimulatedFlight, ...] = field(default=(), repr=False, metadata=UNSTORED)
    bracket: Bracket | None = field(default=None, metadata=UNSTORED)

    @property
    @stored()
    def lower_bound(self) -> float | None:
        """Proved lower bound of the least cost, or None without a certificate."""
        return None if self.bracket is None else self.bracket.lower_bound

    @property
    @stored()
    def start(self) -> Mapping[str, float]:
        """Initial deviations from the trim by name of the state, without deviations of 0."""
        pairs = zip(self.problem.states, self._z0.tolist(), strict=True)
        return {name: value for name, value in pairs if value}

    @property
    @stored()
    def cost(self) -> float:
        """Cost of the simulated flight, ∫ z'Qz + v'Rv dt, plus the linear cost after its end.

        z and v are the deviations of the states and inputs from the trim.
        """
        return self.found.flown.cost

    @property
    @stored()
    def source(self) -> str:
        """Name of the flight whose cost is reported: the best flight found, or a policy."""
        return self.found.flown.name

    @property
    @stored()
    def reason(self) -> str | None:
        """Reason why the simulation confirms no proposal of the optimizer, or None if it does.

        With a reason, the flight is only the cheapest of the simulated flights.
        """
        return self.found.reason or None

    @property
    @stored()
    def proposed_cost(self) -> float | None:
        """Cost reported by the optimizer for its proposal, or None if no proposal was confirmed."""
        return None if self.found.proposal is None else self.found.proposal.cost

    @property
    @stored()
    def spread(self) -> float | None:
        """Largest relative difference of the flight's cost between meshes or between initial
        guesses, or None if no proposal was confirmed.
        """
        return None if self.found.proposal is None else self.found.spread

    @property
    def _z0(self) -> np.ndarray:
        """Initial deviations of the linear states from the trim, (k,)."""
        if self.found.proposal is not None:
            return self.found.proposal.start
        places = self.problem.places
        return (self.found.flown.states[0] - np.array(self.point.states))[places]

    @property
    @stored()
    def linear_cost(self) -> float:
        """Least cost z'Pz of the linear model without limits, for the initial deviations z.

        The least cost of the aircraft may differ.
        """
        return float(self._z0 @ self.problem.P @ self._z0)

    @property
    @stored()
    def seconds(self) -> float:
        """Horizon of the optimizer, s. After the horizon, the linear policy controls the
        aircraft.
        """
        return self.found.seconds

    @property
    @stored()
    def saturated(self) -> Sequence[str]:
        """Names of the inputs that reach a limit during the flight."""
        return list(self.found.flown.saturated)

    @property
    def time(self) -> Vector:
        """Times of the flight, s, (N,)."""
        return self.found.flown.times

    @property
    def states(self) -> Matrix:
        """Absolute states, (N, n), with the columns `state_names`."""
        return with_names(self.found.flown.states, (), self.state_names)

    @property
    def inputs(self) -> Matrix:
        """Absolute inputs, (N, m), with the columns `input_names`."""
        return with_names(self.found.flown.inputs, (), self.input_names)

    @property
    @stored()
    def envelope(self) -> Mapping[str, Vector]:
        """Lowest and highest permitted value of each state."""
        return envelope_pairs(self.problem)

    @property
    @stored()
    def policies(self) -> Sequence[PolicyFlight]:
        """Flights of other policies from the initial condition of the best flight.

        The first policy is the saturated linear policy.
        """
        return [PolicyFlight.of(flown, self.cost) for flown in self.compared]

    @property
    @stored()
    def over_bound(self) -> float | None:
        """Cost divided by its proved lower bound, or None without a positive bound.

        This is an upper bound of the cost divided by the least cost.
        """
        if self.lower_bound is None or self.lower_bound <= 0.0:
            return None
        return self.cost / self.lower_bound

    @property
    def compared(self) -> tuple[SimulatedFlight, ...]:
        """Simulated flights of the policies in `policies`, in the same order."""
        return (self.found.linear, *self.others)

    def report(self) -> Report:
        """Return the report: costs and outcomes of all flights, bounds and limits."""
        name = "best flight found" if self.reason is None else "cheapest simulated flight"
        rows = [(name, f"{self.cost:.6g}", "1", "converges")]
        lines = [_saturated(name, self.saturated)]
        for flown, policy in zip(self.compared, self.policies, strict=True):
            cost = "-" if policy.cost is None else f"{policy.cost:.6g}"
            ratio = "-" if policy.over_best is None else f"{policy.over_best:.4g}"
            rows.append((policy.policy, cost, ratio, flown.ending))
            if flown.lost:
                lines.append(f"{policy.policy}: {flown.outcome()}")
            lines.append(_saturated(policy.policy, policy.saturated))
        table = Table(("flight", "cost", "over the best", "outcome"), rows)
        parts = (
            self._checked(),
            table,
            tuple(lines),
            limits_table(self.problem),
            f"{self._bracket()} The linear model without limits gives {self.linear_cost:.6g}, "
            "which is not a cost of the aircraft.",
            Picture("flight", "The best flight found and the policies", self.figure),
        )
        return Report(self.title(), parts, data=self.as_data(), records=self._records())

    def title(self) -> str:
        """Return the first lines of the report: aircraft, cost, policies and initial condition."""
        place = self.point.at_scheduled
        whose = f"{self.model.title} {place}".strip()
        first = f"Best flight, {whose}: found, cost {self.cost:.6g}"
        if self.reason is not None:
            first = f"Best flight, {whose}: upper bound of the cost {self.cost:.6g}"
        if self.bracket is not None and self.over_bound is not None:
            first += f", {bracket_sentence([(self.bracket, self.cost)])}"
        elif self.reason is None and self.found.spread_of_guesses > MESHES_AGREE:
            first += f", guesses differ by {100 * self.found.spread_of_guesses:.2g} %"
        lines = [first]
        if self.reason is not None:
            lines += [f"source: {self.source}, simulated; no proposal is confirmed:", self.reason]
        for flown, policy in zip(self.compared, self.policies, strict=True):
            says = [] if policy.over_best is None else [f"{policy.over_best:.4g} x the best found"]
            says += [flown.ending] if flown.lost else []
            lines.append(f"{policy.policy}: {', '.join(says)}")
        return "\n".join([*lines, f"from {deviations_in_words(self.model, self.start)}"])

    def _bracket(self) -> str:
        """Return sentences on the least cost.

        With a certificate, they state the interval that contains the least cost. Without a
        certificate, they state that no cheaper flight was found.
        """
        if self.bracket is None:
            return (
                "No cheaper flight from this initial condition was found. This does not prove that "
                "none exists."
            )
        bound = f"{self.bracket.lower_bound:.6g}"
        level = ", the level of the certificate, which W exceeds here" * self.bracket.beyond
        return (
            f"The least cost is in [{bound}, {self.cost:.6g}]: every flight within the limits from "
            f"this initial condition to the trim is proved to cost at least {bound}{level}."
        )

    def _checked(self) -> str:
        found = self.found
        if self.reason is not None:
            return f"Simulated cost: {self.cost:.6g}. No proposal of the optimizer is confirmed."
        meshes = " and ".join(map(str, list(found.meshes)[-2:]))
        lines = [
            f"Simulated cost: {self.cost:.6g}. Cost proposed by the optimizer: "
            f"{self.proposed_cost:.6g}.",
            f"Meshes of {meshes} intervals over {self.seconds:.3g} s agree within "
            f"{100 * found.spread_of_meshes:.2g} %. Costs from {len(found.guesses)} guesses are"
            " up to "
            f"{100 * found.spread_of_guesses:.2g} % above the best.",
        ]
        if has_kinks(self.problem):
            lines.append(
                "The optimizer used equations with smoothed tables and kinks. The simulation"
                " used the "
                "exact equations."
            )
        return " ".join(lines)

    def _records(self) -> Table:
        rows = np.column_stack([self.time, self.states, self.inputs]).tolist()
        return Table(("time", *self.state_names, *self.input_names), [tuple(row) for row in rows])

    def plot(self) -> np.ndarray:
        """Draw the best flight and the flights of policies in a pyplot figure, and return its
        Axes.
        """
        from matplotlib import pyplot

        return np.array(self._drawn(pyplot.figure(layout="constrained")).axes)

    def figure(self) -> Figure:
        """Return a new figure with the best flight and the flights of policies."""
        from hfa_support.reporting.figure import new_figure

        return self._drawn(new_figure(10.0, 8.0))

    def _drawn(self, figure: Figure) -> Figure:
        from hfa_optimal.picture import drawn

        flights = [(self.found.flown, f"best flight found: {self.cost:.5g}")]
        for flown in self.compared:
            cost = f"{flown.cost:.5g}" if flown.converges else "does not converge"
            flights.append((flown, f"{flown.name}: {cost}"))
        return drawn(figure, self.problem, flights, self.seconds, self.title())


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
    return Bracket(start, lower, cost, None, lower >= bound.level)


def _saturated(flight: str, names: Sequence[str]) -> str:
    return f"{flight}: {', '.join(names) or 'no input'} saturated"


def envelope_pairs(problem: FlightProblem) -> dict[str, np.ndarray]:
    """Return the lowest and highest permitted value of each state, by name."""
    pairs = np.column_stack([problem.envelope.lowest, problem.envelope.highest])
    return dict(zip(problem.envelope.names, pairs, strict=True))


def limits_table(problem: FlightProblem) -> Table:
    """Return a table of the limits of all states and of the moving inputs."""
    model = problem.model
    pairs: dict[str, Any] = envelope_pairs(problem)
    signals = model.inputs
    pairs |= {name: (signals[name].min, signals[name].max) for name in problem.inputs}
    rows = []
    assumed = dict(zip(problem.envelope.names, problem.envelope.assumed.tolist(), strict=True))
    for name, (lowest, highest) in pairs.items():
        unit = model.unit(name)
        is_assumed = assumed.get(name, model.signals[name].assumed)
        text = limits_text(float(lowest), float(highest), unit, is_assumed)
        rows.append((name, text, shown_unit(unit)))
    return Table(("limits of flights", "from, to", "unit"), rows)
