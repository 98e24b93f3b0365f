"""Best flight found from an initial condition to a trim, and its report."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from hfa_aircraft.signals import StatesAndInputs
from hfa_flight.plan.collocation import CandidateFlight
from hfa_flight.plan.flights import FOLLOWING, SimulatedFlight
from hfa_flight.plan.problem import FlightProblem, OfProblem
from hfa_flight.plan.search import Found
from hfa_flight.plan.smooth import is_nonsmooth
from hfa_flight.simulate.envelope import RULE, FlightRow, limits_text
from hfa_flight.simulate.flight_figure import Curve, flight_figure, histories_of
from hfa_flight.simulate.history import series
from hfa_support.reporting.figure import new_figure, pyplot_figure
from hfa_support.reporting.parts import Picture
from hfa_support.reporting.report import Report, Reported
from hfa_support.reporting.results import Entries, Matrix, Result, Vector
from hfa_support.reporting.rows import Group, Row, with_names
from hfa_support.reporting.text import Table

if TYPE_CHECKING:
    from matplotlib.figure import Figure


def line_with_ratios(begin: str, outcomes: Sequence[tuple[str, float | None, str]]) -> str:
    """Return a first line with the cost ratios of policies, the last one first.

    begin: begin of the line
    outcomes: (name of the policy, ratio or None, how it does not converge, or "")

    >>> line_with_ratios("Best flight", [("gain of K.csv", 1.2, "leaves"), ("exact", 1.03, "")])
    'Best flight; exact 1.03x, gain 1.2x (leaves)'
    """
    texts = []
    for name, ratio, loss in reversed(outcomes):
        if result := _ratio_text(ratio, loss):  # empty without a best flight to compare with
            # Of a name only its begin, as "gain" of "gain of K.csv".
            short_name = name.partition(" of ")[0].removesuffix(", saturated")
            texts.append(f"{short_name} {result}")
    return f"{begin}; {', '.join(texts)}" if texts else begin


def _ratio_text(ratio: float | None, loss: str) -> str:
    """Return a ratio and how flights do not converge as text, such as "1.2x (leaves)"."""
    if ratio is None:
        return loss
    return f"{ratio:.4g}x ({loss})" if loss else f"{ratio:.4g}x"


def limits_of_flights(problem: FlightProblem) -> Group:
    """Return the limits of all states and of the moving inputs as rows."""
    model, envelope = problem.model, problem.envelope
    signals = [model.inputs[name] for name in problem.inputs]
    lows = [*envelope.lowest.tolist(), *(signal.min for signal in signals)]
    highs = [*envelope.highest.tolist(), *(signal.max for signal in signals)]
    assumed = [*envelope.assumed.tolist(), *(signal.assumed for signal in signals)]
    names = (*envelope.names, *problem.inputs)
    rows = []
    for name, low, high, is_assumed in zip(names, lows, highs, assumed, strict=True):
        unit = model.unit(name)
        text = limits_text(low, high, unit)
        rows.append(Row(name, text, unit, note="assumed" if is_assumed else ""))
    return Group("limits of flights", tuple(rows))


#: Largest initial deviation that is rounding, in nominal values.
_ROUNDING = 1e-12


@dataclass(frozen=True, eq=False, repr=False)
class BestFlight(OfProblem, StatesAndInputs, Result, Reported):
    """Best flight found from an initial condition to a trim within limits.

    The cost of the simulated flight is an upper bound of the least cost. A cheaper flight may
    exist.

    problem: aircraft, trim, weights and limits.
    found: the flights simulated, and the optimizer's candidate, if one was confirmed.
    flown: the cheapest of the flights.

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

    problem: FlightProblem
    found: Found
    flown: SimulatedFlight

    @property
    def cost(self) -> float:
        """Cost of the simulated flight, ∫ z'Qz + v'Rv dt, plus the linear cost after its end.

        z and v are the deviations of the states and inputs from the trim.
        """
        return self.flown.cost

    @property
    def candidate(self) -> CandidateFlight | None:
        """Candidate of the optimizer that a flight confirms, or None."""
        return self.found.candidate

    @property
    def reason(self) -> str | None:
        """Reason why the simulation confirms no candidate of the optimizer, or None if it does.

        With a reason, the flight is only the cheapest of the simulated flights: an upper bound.
        """
        return self.found.reason or None

    @property
    def source(self) -> str:
        """Name of the flight that is reported: the best flight found, or a policy."""
        return self.flown.policy

    @property
    def initial_deviations(self) -> np.ndarray:
        """Initial deviations of the linear states from the trim, (k,)."""
        if self.candidate is not None:
            return self.candidate.start
        return (self.flown.states[0] - self.point.x)[self.problem.places]

    @property
    def start(self) -> Mapping[str, float]:
        """Initial deviations from the trim by name of the state, without deviations of 0."""
        pairs = zip(self.problem.states, self.initial_deviations.tolist(), strict=True)
        return {name: value for name, value in pairs if value}

    @property
    def saturated(self) -> Sequence[str]:
        """Names of the inputs that reach a limit during the flight."""
        return list(self.flown.saturated)

    @property
    def time(self) -> Vector:
        """Times of the flight, s, (N,)."""
        return self.flown.times

    @property
    def states(self) -> Matrix:
        """Absolute states, (N, n), with the columns `state_names`."""
        return with_names(self.flown.states, (), self.state_names)

    @property
    def inputs(self) -> Matrix:
        """Absolute inputs, (N, m), with the columns `input_names`."""
        return with_names(self.flown.inputs, (), self.input_names)

    def __getitem__(self, name: str) -> np.ndarray:
        """Return the absolute values, (N,), of a state, an input or an output during the flight."""
        return series(self.model, self.flown.states, self.flown.inputs, name, self.model.p)

    @property
    def envelope(self) -> Mapping[str, Vector]:
        """Lowest and highest permitted value of each state."""
        limits = self.problem.envelope
        pairs = np.column_stack([limits.lowest, limits.highest])
        return dict(zip(limits.names, pairs, strict=True))

    @property
    def proposed_cost(self) -> float | None:
        """Cost of the confirmed candidate by the optimizer, or None if none was confirmed."""
        return None if self.found.candidate is None else self.found.candidate.cost

    @property
    def spread(self) -> float | None:
        """Relative difference of the proposed costs on the two meshes, or None if no candidate was
        confirmed.
        """
        return None if self.found.candidate is None else self.found.spread

    @property
    def linear_cost(self) -> float:
        """Least cost z'Pz of the linear model without limits, for the initial deviations z.

        The least cost of the aircraft may differ.
        """
        return float(self.initial_deviations @ self.problem.P @ self.initial_deviations)

    @property
    def seconds(self) -> float:
        """Horizon of the optimizer, s. After the horizon, the linear policy controls the
        aircraft.
        """
        return self.found.seconds

    @property
    def policies(self) -> Sequence[FlightRow]:
        """Flights of other policies from the initial condition of the best flight.

        The first policy is the saturated linear policy.
        """
        return [flown.row(self.cost) for flown in self.compared]

    @property
    def compared(self) -> tuple[SimulatedFlight, ...]:
        """Simulated flights of the policies in `policies`, in the same order."""
        return self.found.compared

    def _entries(self) -> dict[str, Any]:
        """Return the entries of the file, name -> value."""
        return {
            "Q": self.problem.Q,
            "R": self.problem.R,
            "states": self.state_names,
            "state_units": self.state_units,
            "inputs": self.input_names,
            "input_units": self.input_units,
            "operating_point": self.point,
            "start": self.start,
            "source": self.source,
            "reason": self.reason,
            "saturated": self.saturated,
            "envelope": self.envelope,
            "cost": self.cost,
            "proposed_cost": self.proposed_cost,
            "spread": self.spread,
            "linear_cost": self.linear_cost,
            "seconds": self.seconds,
            "policies": self.policies,
        }

    def report(self) -> Report:
        """Return the report: costs and outcomes of all flights, and limits."""
        parts = (
            self._checked(),
            self._costs(),
            self.weights_text(),
            RULE,
            limits_of_flights(self.problem),
            Picture("flight", "The best flight found and the policies", self.figure),
        )
        return Report(self.title(), parts, data=Entries(self), records=self.records())

    def title(self) -> str:
        """Return the first lines of the report: cost, ratios of the policies, initial condition."""
        most = "" if self.reason is None else "at most "
        outcomes = [(row.policy, row.over_best, row.loss) for row in self.policies]
        begin = f"Best flight: cost {most}{self.cost:.6g}"
        whose = f"{self.model.title} {self.point.at_scheduled}".strip()
        lines = [
            line_with_ratios(begin, outcomes),
            f"to {whose}, from {self._start_text()}",
        ]
        if self.reason is not None:
            source = f"source: {self.source}, simulated; no candidate is confirmed:"
            lines += [source, self.reason]
        elif self.source != FOLLOWING:
            lines.append(f"source: {self.source}; the optimizer proposes {self.proposed_cost:.6g}")
        return "\n".join(lines)

    def _start_text(self) -> str:
        """Return the initial deviations as text, such as "speed +5 ft/s, alpha +2.865 deg"."""
        moved = {
            name: value
            for name, value in self.start.items()
            if abs(value) > _ROUNDING * self.model.states[name].nominal
        }
        texts = {name: self.model.describe(name, value) for name, value in moved.items()}
        signs = {name: "" if text.startswith("-") else "+" for name, text in texts.items()}
        return ", ".join(f"{name} {signs[name]}{text}" for name, text in texts.items())

    def _checked(self) -> Group:
        """Return the cost of the best flight beside what it was checked with."""
        found = self.found
        linear = Row(
            "linear cost",
            self.linear_cost,
            note="of the linear model without limits, not of the aircraft",
            digits=6,
        )
        none_cheaper = "No cheaper flight was found, which does not prove that none exists."
        if self.reason is not None:
            simulated = Row("simulated cost", self.cost, note="no candidate confirmed", digits=6)
            return Group("best flight", (simulated, linear), (none_cheaper,))
        meshes = " and ".join(map(str, [*found.meshes][-2:]))
        rows = (
            Row("simulated cost", self.cost, digits=6),
            Row("proposed cost", self.proposed_cost, note="of the optimizer", digits=6),
            Row(
                "difference of meshes",
                100.0 * found.spread,
                "%",
                note=f"{meshes} intervals over {self.seconds:.3g} s",
                digits=2,
            ),
            linear,
        )
        smoothed = "The optimizer smoothed tables and nonsmooth points, the simulation did not."
        return Group("best flight", rows, (none_cheaper, *[smoothed] * is_nonsmooth(self.problem)))

    def _costs(self) -> Group:
        """Return the cost of each flight, with its ratio to the best, its end and its inputs."""
        name = "best flight found" if self.reason is None else "cheapest simulated flight"
        rows = [Row(name, self.cost, note=f"converges{_saturated(self.saturated)}", digits=6)]
        for row in self.policies:
            ratio = "" if row.over_best is None else f"{row.over_best:.4g}x; "
            note = f"{ratio}{row.outcome()}{_saturated(row.saturated)}"
            cost = row.cost if row.converges else "-"
            rows.append(Row(row.policy, cost, note=note, digits=6))
        return Group("costs of flights", tuple(rows))

    def records(self) -> Table:
        """Return the table of times, states and inputs, for CSV files."""
        rows = np.column_stack([self.time, self.states, self.inputs]).tolist()
        return Table(("time", *self.state_names, *self.input_names), [tuple(row) for row in rows])

    def figure(self) -> Figure:
        """Return a new figure of states and inputs versus time."""
        return self._drawn_in(new_figure(10.0, 8.0))

    def plot(self) -> np.ndarray:
        """Draw the picture of `figure` in a pyplot figure, and return its Axes."""
        return np.array(self._drawn_in(pyplot_figure(10.0, 8.0)).axes)

    def _drawn_in(self, figure: Figure) -> Figure:
        """Draw the best flight and the compared ones, up to the horizon, in a figure."""
        curves = []
        for number, flown in enumerate((self.flown, *self.compared)):
            end = f"{flown.cost:.5g}" if flown.converges else flown.loss
            label = f"{flown.policy if number else 'best flight found'}: {end}"
            shown = flown.times <= self.seconds
            values = histories_of(self.model, flown.states[shown], flown.inputs[shown])
            style = f"C{number}{'--' if number else '-'}"
            is_whole = number == 0 or flown.converges
            curves.append(Curve(label, style, flown.times[shown], values, is_whole))
        return flight_figure(figure, self.problem.envelope, curves, self.title())


def _saturated(names: Sequence[str]) -> str:
    """Return which inputs are saturated as text, such as "; throttle saturated", or ""."""
    return f"; {', '.join(names)} saturated" if names else ""
