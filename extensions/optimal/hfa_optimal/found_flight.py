"""Base class of the flights that a search finds from one initial condition to a trim."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from hfa_aircraft.model import Model
from hfa_aircraft.signals import StatesAndInputs
from hfa_flight.envelope import limits_text
from hfa_flight.problem import FlightProblem, OfProblem
from hfa_optimal.collocation import Proposal
from hfa_optimal.flights import SimulatedFlight
from hfa_optimal.picture import drawn
from hfa_support.reporting.named import with_names
from hfa_support.reporting.report import Reported
from hfa_support.reporting.results import Matrix, Result, Vector
from hfa_support.reporting.text import Table, shown_unit

if TYPE_CHECKING:
    from matplotlib.figure import Figure

#: Largest number of columns of a first line.
_FIRST_LINE = 80


class FoundFlight(OfProblem, StatesAndInputs, Result, Reported):
    """Simulated flight from an initial condition to a trim, with the proposal that it confirms."""

    if TYPE_CHECKING:

        @property
        def flown(self) -> SimulatedFlight:
            """The simulated flight."""

        @property
        def proposal(self) -> Proposal | None:
            """Proposal of the optimizer that the flight confirms, or None."""

        @property
        def why_refused(self) -> str:
            """Reason why the simulation confirms no proposal, or "" with a proposal."""

        @property
        def drawn_seconds(self) -> float:
            """End of the time axis of the figure, s."""

        def title(self) -> str:
            """First lines of the report."""

    @property
    def start(self) -> Mapping[str, float]:
        """Initial deviations from the trim by name of the state, without deviations of 0."""
        pairs = zip(self.problem.states, self.initial_deviations.tolist(), strict=True)
        return {name: value for name, value in pairs if value}

    @property
    def initial_deviations(self) -> np.ndarray:
        """Initial deviations of the linear states from the trim, (k,)."""
        if self.proposal is not None:
            return self.proposal.start
        return (self.flown.states[0] - np.array(self.point.states))[self.problem.places]

    @property
    def source(self) -> str:
        """Name of the flight that is reported: the best flight found, or a policy."""
        return self.flown.name

    @property
    def reason(self) -> str | None:
        """Reason why the simulation confirms no proposal of the optimizer, or None if it does.

        With a reason, the flight is only the best of the simulated flights: an upper bound.
        """
        return self.why_refused or None

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

    @property
    def envelope(self) -> Mapping[str, Vector]:
        """Lowest and highest permitted value of each state."""
        return envelope_pairs(self.problem)

    def contents(self) -> dict[str, Any]:
        """Return the entries of the file that each flight found has, name -> value."""
        return {
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
        }

    def destination(self) -> str:
        """Return "to AIRCRAFT at TRIM, from the initial condition", for the report."""
        whose = f"{self.model.title} {self.point.at_scheduled}".strip()
        return f"to {whose}, from {_deviations_in_words(self.model, self.start)}"

    def source_lines(self) -> list[str]:
        """Return the source and the reason of an upper bound, or []."""
        if self.reason is None:
            return []
        return [f"source: {self.source}, simulated; no proposal is confirmed:", self.reason]

    def labeled(self) -> list[tuple[SimulatedFlight, str]]:
        """Return the flights of the figure with their labels, the found flight first."""
        return [(self.flown, "flight")]

    def records(self) -> Table:
        """Return the table of times, states and inputs, for CSV files."""
        rows = np.column_stack([self.time, self.states, self.inputs]).tolist()
        return Table(("time", *self.state_names, *self.input_names), [tuple(row) for row in rows])

    def figure(self) -> Figure:
        """Return a new figure of states and inputs versus time."""
        from hfa_support.reporting.figure import new_figure

        flights = self.labeled()
        return drawn(new_figure(10.0, 8.0), self.problem, flights, self.drawn_seconds, self.title())

    def plot(self) -> np.ndarray:
        """Draw the picture of `figure` in a pyplot figure, and return its Axes."""
        from matplotlib import pyplot

        figure = pyplot.figure(layout="constrained")
        flights = self.labeled()
        return np.array(drawn(figure, self.problem, flights, self.drawn_seconds, self.title()).axes)


def line_with_ratios(begin: str, outcomes: Sequence[tuple[str, float | None, str]]) -> str:
    """Return a first line with the cost ratios of policies, in at most `_FIRST_LINE` columns.

    The policies given last come first. Those that do not fit are left out.

    begin: begin of the line
    outcomes: (name of the policy, ratio or None, how it is lost or "")
    """
    line = begin
    for name, ratio, loss in reversed(outcomes):
        kind = name.partition(" of ")[0].removesuffix(", saturated")
        separator = "; " if line == begin else ", "
        says = loss if ratio is None else f"{ratio:.4g}x{loss and f' ({loss})'}"
        longer = f"{line}{separator}{kind} {says}"
        line = longer if says and len(longer) <= _FIRST_LINE else line
    return line


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


def _deviations_in_words(model: Model, start: Mapping[str, float]) -> str:
    """Return the deviations from the trim, state -> deviation, as printed in reports."""
    return ", ".join(_off(model, name, value) for name, value in start.items()) or "the trim"


def _off(model: Model, name: str, value: float) -> str:
    text = model.describe(name, value)
    return f"{name} {text}" if text.startswith("-") else f"{name} +{text}"
