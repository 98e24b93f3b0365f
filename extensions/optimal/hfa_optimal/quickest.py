"""Search for the quickest flight to a trim, proposed by collocation and then simulated."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np

from hfa_flight.problem import FlightProblem
from hfa_optimal.collocation import (
    Equations,
    Proposal,
    Transcription,
    adapted_mesh,
    collocation_points,
)
from hfa_optimal.flights import Flights, SimulatedFlight
from hfa_optimal.found_flight import FoundFlight, limits_table
from hfa_optimal.search import (
    MESHES_AGREE,
    NONE_WITHIN,
    REFUSED,
    BestFlights,
    difference_of_meshes,
    sampled,
)
from hfa_support.errors import NoSolutionError
from hfa_support.reporting.parts import Picture
from hfa_support.reporting.report import Report
from hfa_support.reporting.results import given
from hfa_support.reporting.text import Table, short_number, shown_unit
from trim.point.operating_point import OperatingPoint

#: Numbers of intervals of the meshes. The times on two successive meshes must agree to
#: `MESHES_AGREE`.
_MESHES = (40, 80, 160)
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
#: Duration of the linear policy after the arrival, relative to the duration of the flight.
_HELD = 0.5


@dataclass(frozen=True, eq=False, repr=False)
class QuickestFlight(FoundFlight):
    """Quickest flight found from an initial condition to a trim within limits.

    A quicker flight may exist. The proposal ends at the trim. At the time of this end, the
    simulated flight is in the arrival box around the trim. If no proposal is confirmed, the flight
    is the simulated flight that arrives first: an upper bound of the least time.

    problem: aircraft, trim and limits.
    proposal: the optimizer's flight, or None if none is confirmed.
    flown: the simulated flight, which follows the proposal and then the linear policy.
    meshes: number of intervals -> proposed time, s, empty without a proposal.
    reserve: fraction of the distance to each limit that the proposal leaves to the policy, or None
        without a proposal.
    why_refused: reason why the simulation confirms no proposal, or "".
    """

    schema = "hfa.quickest-flight/1"

    problem: FlightProblem
    flown: SimulatedFlight
    proposal: Proposal | None = None
    meshes: Mapping[int, float] = field(default_factory=dict)
    reserve: float | None = None
    why_refused: str = ""

    @property
    def seconds(self) -> float:
        """Duration until the arrival, s. The simulation continues after it."""
        if self.proposal is not None:
            return self.proposal.cost
        return arrival_time(self.problem, self.flown)

    @property
    def spread(self) -> float | None:
        """Relative difference of the proposed times on the last two meshes, or None."""
        return None if self.proposal is None else difference_of_meshes(self.meshes)

    @property
    def largest(self) -> np.ndarray:
        """Largest absolute deviation of each linear state, (k,)."""
        if self.proposal is not None:
            return largest_deviations(self.proposal)
        return np.asarray(np.abs(_deviations(self.problem, self.flown)).max(axis=0))

    @property
    def box(self) -> Mapping[str, float]:
        """Half-width of the arrival box in each state. A flight in the box counts as arrived."""
        return dict(zip(self.problem.states, (ARRIVED * self.largest).tolist(), strict=True))

    @property
    def arrival(self) -> Mapping[str, float]:
        """Deviation of each state from the trim at the time of arrival."""
        at_end = deviations_at(self.problem, self.flown, self.seconds)
        return dict(zip(self.problem.states, at_end.tolist(), strict=True))

    @property
    def saturated(self) -> Sequence[str]:
        """Names of the inputs that reach a limit in the proposal, or in the flight without one.

        The limits of a proposal are the aircraft's limits, narrowed by the fraction `reserve`.
        """
        if self.proposal is None or self.reserve is None:
            return list(self.flown.saturated)
        lowest, highest = self.problem.input_limits
        used = 1.0 - 1.01 * self.reserve
        at_limit = (self.proposal.v <= used * lowest) | (self.proposal.v >= used * highest)
        names = np.array(self.problem.inputs)[at_limit.any(axis=0)]
        return [str(name) for name in names]

    @property
    def drawn_seconds(self) -> float:
        """End of the time axis of the figure, s."""
        return float(self.time[-1])

    def contents(self) -> dict[str, Any]:
        """Return the entries of the file, name -> value."""
        return {
            **super().contents(),
            "seconds": self.seconds,
            "spread": self.spread,
            "box": self.box,
            "arrival": self.arrival,
            **given(reserve=self.reserve),
        }

    def report(self) -> Report:
        """Return the report: duration, deviations, saturated inputs, and limits."""
        rows = []
        for name, farthest in zip(self.problem.states, self.largest.tolist(), strict=True):
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
        return Report(self.title(), parts, data=self.as_data(), records=self.records())

    def title(self) -> str:
        """Return the first lines of the report: duration, trim and initial condition."""
        most = "" if self.reason is None else "at most "
        first = f"Quickest flight: {most}{self.seconds:.4g} s"
        return "\n".join([first, self.destination(), *self.source_lines()])

    def _checked(self) -> str:
        text = (
            f"In the simulation, at {self.seconds:.4g} s each state is within "
            f"{100 * ARRIVED:g} % of its largest deviation."
        )
        if self.spread is None or self.reserve is None:
            return text
        meshes = " and ".join(map(str, list(self.meshes)[-2:]))
        return (
            f"{text} Meshes of {meshes} intervals agree within {100 * self.spread:.2g} %. The "
            f"proposal leaves {100 * self.reserve:.2g} % of the distance to each limit to the "
            "policy that follows it."
        )


def largest_deviations(proposal: Proposal) -> np.ndarray:
    """Return the largest absolute deviation of each linear state during a proposal, (k,)."""
    states = proposal.nodes[..., : len(proposal.start)]
    return np.asarray(np.abs(states).max(axis=(0, 1)))


def _deviations(problem: FlightProblem, flown: SimulatedFlight) -> np.ndarray:
    """Return the deviations of the linear states from the trim during a flight, (N, k)."""
    return np.asarray(flown.states - np.array(problem.point.states))[:, problem.places]


def deviations_at(problem: FlightProblem, flown: SimulatedFlight, seconds: float) -> np.ndarray:
    """Return the deviations z of a flight at a time, (k,).

    seconds: time, s
    """
    z = _deviations(problem, flown)
    return np.array([np.interp(seconds, flown.times, column) for column in z.T])


def arrival_time(problem: FlightProblem, flown: SimulatedFlight) -> float:
    """Return the time from which a flight stays in its arrival box, s, or inf if it ends outside.

    The half-widths of the box are `ARRIVED` times the flight's own largest deviations.
    """
    z = np.abs(_deviations(problem, flown))
    outside = (z > ARRIVED * z.max(axis=0)).any(axis=1)
    if outside[-1]:
        return np.inf
    return float(flown.times[np.flatnonzero(outside)[-1] + 1])


def not_arrived(problem: FlightProblem, flown: SimulatedFlight, proposal: Proposal) -> str:
    """Return the reason why a simulated flight refutes a proposal, or "" if the flight confirms it.

    A confirming flight stays in the envelope. It is in the arrival box at the proposed time and at
    the end of the simulation.
    """
    if flown.departure is not None:
        return f"the flight that follows the proposal {flown.departure.text()}"
    box = ARRIVED * largest_deviations(proposal)
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

    If the simulation confirms no proposal, the result is the simulated flight within the limits
    that arrives first: an upper bound of the least time.

    begin: another trim, or state of the linear model -> deviation from the trim

    Raises NoSolutionError, with the reason, if no simulated flight arrives within the limits.
    """
    search = BestFlights(problem)
    z = problem.deviations(begin)
    v = np.zeros(len(problem.inputs))
    if isinstance(begin, OperatingPoint):
        v = (np.array(begin.inputs) - np.array(problem.point.inputs))[problem.moved]
    horizon = search.horizon(z)
    simulated: list[SimulatedFlight] = []
    try:
        return _confirmed_quickest(search.flights, z, v, horizon, simulated)
    except NoSolutionError as error:
        candidates = [search.converging_linear(z, horizon), *simulated]
        within = [flown for flown in candidates if flown.departure is None]
        times = [arrival_time(problem, flown) for flown in within]
        if not np.isfinite(times).any():
            raise
        reason = str(error).removeprefix("no flight found: ")
        return QuickestFlight(problem, within[int(np.argmin(times))], why_refused=reason)


def _confirmed_quickest(
    flights: Flights,
    z: np.ndarray,
    v: np.ndarray,
    horizon: float,
    simulated: list[SimulatedFlight],
) -> QuickestFlight:
    """Return the quickest flight whose proposal the simulation confirms."""
    problem = flights.problem
    equations = Equations.of(problem)
    best = _from_guesses(Transcription(problem, _MESHES[0], equations, True), z, v, horizon)
    meshes = {_MESHES[0]: best.cost}
    flights = replace(flights, longest_step=best.cost / _STEPS)
    for count in _MESHES[1:]:
        program = Transcription(problem, count, equations, True)
        best = _on_finer(flights, program, best, _RESERVES[0])
        if not best.feasible:
            raise NoSolutionError(f"no flight found: {NONE_WITHIN}")
        meshes[count] = best.cost
        change = difference_of_meshes(meshes)
        reason = f"two meshes differ by {100 * change:.2g} %"
        if change > MESHES_AGREE:
            continue
        proposal = best
        reserves = _RESERVES if count < _MESHES[-1] else (*_RESERVES, _LARGEST_RESERVE)
        for reserve in reserves:
            if reserve > _RESERVES[0]:
                proposal = _on_finer(flights, program, proposal, reserve)
            if not proposal.feasible:
                reason = NONE_WITHIN
                break
            flown = flights.follow(proposal, (1.0 + _HELD) * proposal.cost)
            reason = not_arrived(problem, flown, proposal)
            if not reason:
                return QuickestFlight(problem, flown, proposal, meshes, reserve)
            simulated.append(flown._replace(name=REFUSED))
    raise NoSolutionError(f"no flight found: {reason}")


def _from_guesses(program: Transcription, z: np.ndarray, v: np.ndarray, horizon: float) -> Proposal:
    """Return the quickest feasible proposal found from several guesses."""
    count = program.intervals
    inside = ((np.arange(count)[:, None] + collocation_points()[1:]) / count).ravel()
    states = (1.0 - inside)[:, None] * z
    inputs = (1.0 - np.linspace(0.0, 1.0, count + 1))[:, None] * v
    proposals = [
        program.solve(z, np.full(count, part * horizon / count), states, inputs, _RESERVES[0])
        for part in _GUESSES
    ]
    feasible = [proposal for proposal in proposals if proposal.feasible]
    if not feasible:
        raise NoSolutionError(f"no flight found: {NONE_WITHIN}")
    return min(feasible, key=lambda proposal: proposal.cost)


def _on_finer(
    flights: Flights, program: Transcription, guess: Proposal, reserve: float
) -> Proposal:
    """Return a proposal solved again, on a mesh that is adapted to it."""
    of_states, of_inputs = flights.problem.sizes
    largest_z = largest_deviations(guess)
    largest_z = np.maximum(largest_z, _SMALLEST * of_states[: len(largest_z)])
    largest_v = np.maximum(np.abs(guess.v).max(axis=0), _SMALLEST * of_inputs)
    weights = (1.0 / largest_z, 1.0 / largest_v)
    lengths = adapted_mesh(guess, program.intervals, flights.step, weights)
    return program.solve(guess.start, lengths, *sampled(guess.at, lengths), reserve)
