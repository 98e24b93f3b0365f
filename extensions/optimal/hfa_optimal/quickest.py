"""Search for the quickest flight to a trim, proposed by collocation and then simulated."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING

import numpy as np

from hfa_aircraft.signals import StatesAndInputs
from hfa_flight.problem import FlightProblem, OfProblem
from hfa_optimal.best_flight import envelope_pairs, limits_table
from hfa_optimal.bracket import deviations_in_words
from hfa_optimal.collocation import DEGREE, Proposal, adapted_mesh, collocation_points
from hfa_optimal.flights import Flights, SimulatedFlight
from hfa_optimal.quickest_program import TimeProgram
from hfa_optimal.search import BestFlights, difference_of_meshes
from hfa_support.errors import NoSolutionError
from hfa_support.reporting.named import with_names
from hfa_support.reporting.parts import Picture
from hfa_support.reporting.report import Report, Reported
from hfa_support.reporting.results import UNSTORED, Matrix, Result, Vector, stored
from hfa_support.reporting.text import Table, short_number, shown_unit
from trim.point.operating_point import OperatingPoint

if TYPE_CHECKING:
    from matplotlib.figure import Figure

#: Numbers of intervals of the meshes. The times on two successive meshes must agree to
#: _MESHES_AGREE.
_MESHES = (40, 80, 160)
_MESHES_AGREE = 0.005
#: Fractions of the distance from the trim to each limit that a proposal leaves to the policy. A
#: larger one is tried if the flight leaves the limits or does not arrive, the last one only on the
#: finest mesh.
_RESERVES = (0.002, 0.008)
_LARGEST_RESERVE = 0.032
#: A flight has arrived if each state deviates from the trim by less than this fraction of its
#: largest deviation.
ARRIVED = 0.02
#: Least size of a signal in the adaptation of meshes, relative to its nominal value.
_SMALLEST = 1e-3
#: Least number of simulation steps in a flight, so that inputs switch between their limits at the
#: proposed times.
_STEPS = 2000
#: Durations of the guesses, relative to the horizon of the linear loop.
_GUESSES = (0.3, 0.1)
_NONE_WITHIN = (
    "IPOPT finds no flight within the limits from any initial guess; such a flight may exist"
)
#: Duration of the linear policy after the arrival, relative to the duration of the flight.
_HELD = 0.5


@dataclass(frozen=True, eq=False, repr=False)
class QuickestFlight(OfProblem, StatesAndInputs, Result, Reported):
    """Quickest flight found from an initial condition to a trim within limits.

    A quicker flight may exist. The proposal ends at the trim. At the time of this end, the
    simulated flight is in the arrival box around the trim.

    problem: aircraft, trim and limits.
    proposal: the optimizer's flight.
    flown: the simulated flight, which follows the proposal and then the linear policy.
    meshes: number of intervals -> proposed time, s.
    reserve: fraction of the distance to each limit that the proposal leaves to the policy.
    """

    schema = "hfa.quickest-flight/1"
    made_by = "hfa optimize"

    problem: FlightProblem = field(metadata=UNSTORED)
    proposal: Proposal = field(metadata=UNSTORED)
    flown: SimulatedFlight = field(metadata=UNSTORED)
    meshes: dict[int, float] = field(metadata=UNSTORED)
    reserve: float

    @property
    @stored()
    def start(self) -> Mapping[str, float]:
        """Initial deviations from the trim by name of the state, without deviations of 0."""
        pairs = zip(self.problem.states, self.proposal.start.tolist(), strict=True)
        return {name: value for name, value in pairs if value}

    @property
    @stored()
    def seconds(self) -> float:
        """Duration of the proposal, s. The simulation continues after it."""
        return self.proposal.cost

    @property
    @stored()
    def spread(self) -> float:
        """Relative difference of the proposed times on the last two meshes."""
        return difference_of_meshes(self.meshes)

    @property
    @stored()
    def box(self) -> Mapping[str, float]:
        """Half-width of the arrival box in each state. A flight in the box counts as arrived."""
        return dict(zip(self.problem.states, arrival_box(self.proposal).tolist(), strict=True))

    @property
    @stored()
    def arrival(self) -> Mapping[str, float]:
        """Deviation of each state from the trim at the time of arrival."""
        at_end = deviations_at(self.problem, self.flown, self.seconds)
        return dict(zip(self.problem.states, at_end.tolist(), strict=True))

    @property
    @stored()
    def saturated(self) -> Sequence[str]:
        """Names of the inputs that reach a limit of the optimizer in the proposal.

        The limits of the optimizer are the aircraft's limits, narrowed by the fraction `reserve`.
        """
        lowest, highest = self.problem.input_limits
        used = 1.0 - 1.01 * self.reserve
        at_limit = (self.proposal.v <= used * lowest) | (self.proposal.v >= used * highest)
        names = np.array(self.problem.inputs)[at_limit.any(axis=0)]
        return [str(name) for name in names]

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
    @stored()
    def envelope(self) -> Mapping[str, Vector]:
        """Lowest and highest permitted value of each state."""
        return envelope_pairs(self.problem)

    def report(self) -> Report:
        """Return the report: duration, deviations, saturated inputs, and limits."""
        rows = []
        most = largest_deviations(self.proposal)
        for name, farthest in zip(self.problem.states, most.tolist(), strict=True):
            unit = self.model.unit(name)
            values = (self.start.get(name, 0.0), farthest, self.arrival[name], self.box[name])
            numbers = [short_number(value, unit) for value in values]
            rows.append((name, shown_unit(unit), *numbers))
        header = ("deviation", "unit", "begin", "largest", "arrival", "box")
        parts = (
            self._checked(),
            Table(header, rows),
            f"Saturated: {', '.join(self.saturated) or 'no input'}.",
            limits_table(self.problem),
            "No quicker flight was found. This does not prove that none exists.",
            Picture("flight", "The quickest flight found", self.figure),
        )
        return Report(self.title(), parts, data=self.as_data(), records=self._records())

    def title(self) -> str:
        """Return the first lines of the report: aircraft, trim, duration and initial condition."""
        whose = f"{self.model.title} {self.point.at_scheduled}".strip()
        begin = deviations_in_words(self.model, self.start)
        found = f"Quickest flight, to {whose}: found, {self.seconds:.4g} s"
        return f"{found}\nfrom {begin} relative to this trim"

    def _checked(self) -> str:
        meshes = " and ".join(map(str, list(self.meshes)[-2:]))
        return (
            f"In the simulation, at {self.seconds:.4g} s each state is within "
            f"{100 * ARRIVED:g} % of its largest deviation. Meshes of {meshes} intervals agree"
            " within "
            f"{100 * self.spread:.2g} %. The proposal leaves {100 * self.reserve:.2g} % of the "
            "distance to each limit to the policy that follows it."
        )

    def _records(self) -> Table:
        rows = np.column_stack([self.time, self.states, self.inputs]).tolist()
        return Table(("time", *self.state_names, *self.input_names), [tuple(row) for row in rows])

    def figure(self) -> Figure:
        """Return a figure of states and inputs versus time."""
        from hfa_optimal.picture import drawn
        from hfa_support.reporting.figure import new_figure

        flights = [(self.flown, "flight")]
        seconds = float(self.time[-1])
        return drawn(new_figure(10.0, 8.0), self.problem, flights, seconds, self.title())


def largest_deviations(proposal: Proposal) -> np.ndarray:
    """Return the largest absolute deviation of each linear state during a proposal, (k,)."""
    states = proposal.nodes[..., : len(proposal.start)]
    return np.asarray(np.abs(states).max(axis=(0, 1)))


def arrival_box(proposal: Proposal) -> np.ndarray:
    """Return the half-widths of the box within which a flight counts as arrived, (k,)."""
    return ARRIVED * largest_deviations(proposal)


def deviations_at(problem: FlightProblem, flown: SimulatedFlight, seconds: float) -> np.ndarray:
    """Return the deviations z of a flight at a time, (k,).

    seconds: time, s
    """
    z = flown.states[:, problem.places] - np.array(problem.point.states)[problem.places]
    return np.array([np.interp(seconds, flown.times, column) for column in z.T])


def not_arrived(problem: FlightProblem, flown: SimulatedFlight, proposal: Proposal) -> str:
    """Return the reason why a simulated flight refutes a proposal, or "" if the flight confirms it.

    A confirming flight stays in the envelope. It is in the arrival box at the proposed time and at
    the end of the simulation.
    """
    if flown.departure is not None:
        return f"the flight that follows the proposal {flown.departure.text()}"
    box = arrival_box(proposal)
    for seconds in (proposal.cost, float(flown.times[-1])):
        parts = np.abs(deviations_at(problem, flown, seconds)) / box
        worst = int(np.argmax(parts))
        if not parts[worst] <= 1.0:
            name = problem.states[worst]
            off = 100 * ARRIVED * parts[worst]
            return (
                f"at {seconds:.4g} s, {name} in the flight that follows the proposal deviates from "
                f"the trim by {off:.3g} % of its largest deviation; at most {100 * ARRIVED:g} % are"
                " allowed"
            )
    return ""


def quickest_to(
    problem: FlightProblem, begin: Mapping[str, float] | OperatingPoint
) -> QuickestFlight:
    """Return the quickest flight that was found to the trim of a problem.

    begin: another trim, or state of the linear model -> deviation from the trim

    Raises NoSolutionError, with the reason, if no flight was found.
    """
    search = BestFlights(problem)
    z = problem.deviations(begin)
    v = np.zeros(len(problem.inputs))
    if isinstance(begin, OperatingPoint):
        v = (np.array(begin.inputs) - np.array(problem.point.inputs))[problem.moved]
    return quickest(search.flights, z, v, search.horizon(z))


def quickest(flights: Flights, z: np.ndarray, v: np.ndarray, horizon: float) -> QuickestFlight:
    """Return the quickest flight found from an initial condition.

    The mesh is refined until the times of two meshes agree and the simulation confirms the
    proposal.

    z: initial deviations of the states, (k,)
    v: initial deviations of the inputs in the guesses, (m,)
    horizon: horizon of the linear loop, s

    Raises NoSolutionError, with the reason, if no flight was found.
    """
    problem = flights.problem
    best = _from_guesses(TimeProgram(problem, _MESHES[0]), z, v, horizon)
    meshes = {_MESHES[0]: best.cost}
    flights = replace(flights, longest_step=best.cost / _STEPS)
    for count in _MESHES[1:]:
        program = TimeProgram(problem, count)
        best = program.solve(_on_finer(flights, best, count), _RESERVES[0])
        if not best.feasible:
            raise NoSolutionError(f"no flight found: {_NONE_WITHIN}")
        meshes[count] = best.cost
        before, last = list(meshes.values())[-2:]
        change = abs(last / before - 1.0)
        reason = f"two meshes differ by {100 * change:.2g} %"
        if change > _MESHES_AGREE:
            continue
        proposal = best
        reserves = _RESERVES if count < _MESHES[-1] else (*_RESERVES, _LARGEST_RESERVE)
        for reserve in reserves:
            if reserve > _RESERVES[0]:
                proposal = program.solve(_on_finer(flights, proposal, count), reserve)
            if not proposal.feasible:
                reason = _NONE_WITHIN
                break
            flown = flights.follow(proposal, (1.0 + _HELD) * proposal.cost)
            reason = not_arrived(problem, flown, proposal)
            if not reason:
                return QuickestFlight(problem, proposal, flown, meshes, reserve)
    raise NoSolutionError(f"no flight found: {reason}")


def _from_guesses(program: TimeProgram, z: np.ndarray, v: np.ndarray, horizon: float) -> Proposal:
    """Return the quickest feasible proposal found from several guesses.

    In each guess, states and inputs go linearly to the trim. The duration of a guess is a fraction
    of the horizon.

    z: initial deviations of the states, (k,)
    v: initial deviations of the inputs in the guesses, (m,)
    horizon: horizon of the linear loop, s

    Raises NoSolutionError if no proposal is feasible.
    """
    count = program.intervals
    inside = ((np.arange(count)[:, None] + collocation_points()[1:]) / count).ravel()
    states = program.problem.padded((1.0 - inside)[:, None] * z).reshape(count, DEGREE, -1)
    inputs = (1.0 - np.linspace(0.0, 1.0, count + 1))[:, None] * v
    best: Proposal | None = None
    for part in _GUESSES:
        lengths = np.full(count, part * horizon / count)
        guess = Proposal(lengths, z, states, inputs, part * horizon, 0.0, True)
        proposal = program.solve(guess, _RESERVES[0])
        if proposal.feasible and (best is None or proposal.cost < best.cost):
            best = proposal
    if best is None:
        raise NoSolutionError(f"no flight found: {_NONE_WITHIN}")
    return best


def _on_finer(flights: Flights, proposal: Proposal, count: int) -> Proposal:
    """Return a proposal interpolated on a mesh of `count` intervals that is adapted to the
    proposal.
    """
    of_states, of_inputs = flights.problem.sizes
    largest_z = largest_deviations(proposal)
    largest_z = np.maximum(largest_z, _SMALLEST * of_states[: len(largest_z)])
    largest_v = np.maximum(np.abs(proposal.v).max(axis=0), _SMALLEST * of_inputs)
    lengths = adapted_mesh(proposal, count, flights.step, (1.0 / largest_z, 1.0 / largest_v))
    ends = np.append(0.0, np.cumsum(lengths))
    inside = (ends[:-1, None] + lengths[:, None] * collocation_points()[1:]).ravel()
    z = proposal.at(inside)[0].reshape(count, DEGREE, -1)
    return proposal._replace(lengths=lengths, z=z, v=proposal.at(ends)[1])
