"""Search for the best flight: a candidate on two meshes, with four margins, and its simulation."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import NamedTuple

import numpy as np

from hfa_flight.plan.collocation import DEGREE, CandidateFlight, Transcription, adapted_mesh, mesh
from hfa_flight.plan.flights import AFTER, Flights, SimulatedFlight
from hfa_flight.plan.problem import MARGIN, FlightProblem
from hfa_flight.plan.smooth import smooth_rates
from hfa_flight.simulate.simulation import CompiledLoop
from hfa_support.matrices import spectral_radius
from hfa_support.reporting.text import percent

#: Numbers of intervals of the meshes. The last is used only if the costs on the first two differ.
_COARSE_MESH = 50
_FINER_MESHES = (100, 200)
#: Factors on the margin to the state limits. The next is used if the flight left a limit.
_MARGINS = (1.0, 3.0, 9.0, 27.0)
#: Largest relative difference of the costs on two meshes, and largest relative excess of the cost
#: of a flight over that of its candidate.
MESHES_AGREE = 0.005
FLIGHT_AGREES = 0.01
#: Largest linear cost after the horizon, relative to the cost.
TAIL = 0.001
#: Largest linear cost after the horizon if a state outside the cost, such as altitude, moves the
#: equilibrium.
DRIFTING_TAIL = 0.005
#: Factor by which a horizon is extended, and largest number of extensions.
_LONGER_HORIZON = 1.6
_EXTENSIONS = 5
NONE_WITHIN = "IPOPT finds no flight within the limits; such a flight may exist"
#: Name of a flight that follows a candidate that it does not confirm.
REFUSED = "flight that follows a refused candidate"
#: Times (N,) -> z (N, k) and v (N, m) at these times.
Guess = Callable[[np.ndarray], tuple[np.ndarray, np.ndarray]]


class Found(NamedTuple):
    """Best flight that was found and simulated.

    flown: cheapest simulated flight that stays within the limits and returns, or None without one
    candidate: candidate that a flight confirms, or None for an upper bound of the least cost alone
    seconds: horizon of the candidate, s
    meshes: number of intervals -> proposed cost, empty without a candidate
    compared: flights of the linear optimum and of the policies from the same initial condition
    reason: reason why no candidate was confirmed, or "" with a candidate
    """

    flown: SimulatedFlight | None
    candidate: CandidateFlight | None
    seconds: float
    meshes: dict[int, float]
    compared: tuple[SimulatedFlight, ...]
    reason: str = ""

    @property
    def spread(self) -> float:
        """Relative difference of the proposed costs on the last two meshes."""
        return difference_of_meshes(self.meshes)


class _Unconfirmed(Exception):
    """Reason why no candidate is confirmed, and the flights that follow those that were refused."""

    def __init__(self, reason: str, flights: Sequence[SimulatedFlight] = ()) -> None:
        super().__init__(reason)
        self.flights = flights


@dataclass(frozen=True, eq=False)
class BestFlights:
    """Search for the best flights of a problem.

    problem: aircraft, trim, weights and limits
    count: approximate number of initial conditions. Machine code is used if the number is large.
    transcriptions: number of intervals -> nonlinear program, built at its first use
    """

    problem: FlightProblem
    count: int = 1
    transcriptions: dict[int, Transcription] = field(default_factory=dict)

    @cached_property
    def flights(self) -> Flights:
        """Simulator of the flights."""
        return Flights(self.problem, self.count)

    def found(self, start: np.ndarray, policies: Sequence[CompiledLoop] = ()) -> Found:
        """Return the cheapest of all flights simulated from an initial condition.

        These are the flights that follow candidates, that of the linear optimum and those of the
        policies. If the simulation confirms no candidate, the cost is only an upper bound of the
        least one.

        start: initial deviations z, (k,)

        Raises BadInputError if the initial condition is outside the limits.
        """
        self.problem.refuse_outside(start)
        smooth_rates(self.problem)  # refuses a compiled function before the first flight
        try:
            found, flights = self._confirmed_best(start)
        except _Unconfirmed as error:
            horizon = self.flights.horizon(start)
            linear = self.converging(self.flights.linear_loop, start, horizon)
            found = Found(None, None, horizon, {}, (linear,), str(error))
            flights = [*error.flights]
        flown = (self.converging(policy, start, found.seconds) for policy in policies)
        compared = (*found.compared, *flown)
        return found._replace(flown=_cheapest_inside([*flights, *compared]), compared=compared)

    def converging(
        self, policy: CompiledLoop, start: np.ndarray, horizon: float
    ) -> SimulatedFlight:
        """Return the flight of a policy. One that stays inside and has not returned is simulated
        again, up to the longest horizon.

        start: initial deviations z, (k,)
        horizon: the first horizon, s
        """
        seconds = (1.0 + AFTER) * horizon
        flown = self.flights.fly(policy, start, seconds)
        if flown.converges or flown.departure is not None:
            return flown
        return self.flights.fly(policy, start, _LONGER_HORIZON ** (_EXTENSIONS - 1) * seconds)

    def _confirmed_best(self, start: np.ndarray) -> tuple[Found, list[SimulatedFlight]]:
        """Return the candidate that the simulation confirms, and the flight that follows it."""
        horizon = self.flights.horizon(start)
        for _ in range(_EXTENSIONS):
            horizon = self.flights.tick * math.ceil(horizon / self.flights.tick)
            linear = self.flights.linear(start, (1.0 + AFTER) * horizon)
            coarse = self._coarse(start, horizon, linear)
            unfinished = self._unfinished(coarse)
            if not unfinished:
                return self._confirmed(horizon, linear, coarse)
            horizon *= _LONGER_HORIZON
        raise _Unconfirmed(f"with a horizon of {horizon / _LONGER_HORIZON:.3g} s, {unfinished}")

    def _unfinished(self, candidate: CandidateFlight) -> str:
        """Return why the horizon of a candidate is too short, or ""."""
        cost_fraction = candidate.tail / candidate.cost
        if cost_fraction > (DRIFTING_TAIL if self.problem.carried else TAIL):
            return f"{100 * cost_fraction:.2g} % of the cost remains at the end"
        end = candidate.z[-1, -1, : len(candidate.start)]
        after = self.flights.linear(end, AFTER * float(candidate.lengths.sum()))
        if after.departure is not None:
            return "the linear policy leaves the limits after the horizon"
        return ""

    def _coarse(
        self, start: np.ndarray, seconds: float, linear: SimulatedFlight
    ) -> CandidateFlight:
        """Return the candidate on the coarse mesh, from the flight of the linear optimum."""
        guess = self._guess_of_flight(linear) if linear.converges else self._linear_guess(start)
        lengths = self._mesh(seconds, _COARSE_MESH)
        rough = self._transcription(_COARSE_MESH).solve(start, lengths, *sampled(guess, lengths))
        # The second solution has a mesh that is adapted to the first.
        candidate = self._adapted(_COARSE_MESH, rough, MARGIN) if rough.feasible else rough
        if not candidate.feasible:
            raise _Unconfirmed(NONE_WITHIN)
        return candidate

    def _confirmed(
        self, seconds: float, linear: SimulatedFlight, coarse: CandidateFlight
    ) -> tuple[Found, list[SimulatedFlight]]:
        """Return a candidate on whose cost two meshes agree, and the flight that confirms it."""
        # The candidate's margin to the limits of the states grows until the flight that follows
        # the candidate stays within the limits.
        candidate, meshes = self._agreed(coarse)
        simulated: list[SimulatedFlight] = []
        for factor in _MARGINS:
            if factor > 1.0:
                candidate = self._adapted(len(candidate.lengths), candidate, factor * MARGIN)
                if not candidate.feasible:
                    break
            flown = self.flights.follow(candidate, (1.0 + AFTER) * seconds)
            reason = refutation(flown, candidate)
            if not reason:
                return Found(None, candidate, seconds, meshes, (linear,)), [flown]
            simulated.append(replace(flown, policy=REFUSED))
            if flown.departure is None:
                break  # narrower limits would not help a flight that is inside them
        raise _Unconfirmed(reason, simulated)

    def _agreed(self, coarse: CandidateFlight) -> tuple[CandidateFlight, dict[int, float]]:
        """Return the candidate on the second of two meshes that agree, and the costs on all."""
        candidate, meshes = coarse, {_COARSE_MESH: coarse.cost}
        for intervals in _FINER_MESHES:
            candidate = self._adapted(intervals, candidate, MARGIN)
            if not candidate.feasible:
                raise _Unconfirmed(NONE_WITHIN)
            meshes[intervals] = candidate.cost
            if difference_of_meshes(meshes) <= MESHES_AGREE:
                return candidate, meshes
        change = percent(100.0 * difference_of_meshes(meshes))
        raise _Unconfirmed(f"two meshes differ by {change}")

    def _adapted(self, intervals: int, guess: CandidateFlight, margin: float) -> CandidateFlight:
        """Return a candidate solved again, on a mesh adapted to it or else on a geometric one."""
        adapted = adapted_mesh(guess, intervals, self.flights.step, self._weights)
        for lengths in (adapted, self._mesh(float(guess.lengths.sum()), intervals)):
            z, v = sampled(guess.at, lengths)
            candidate = self._transcription(intervals).solve(guess.start, lengths, z, v, margin)
            if candidate.feasible:
                break
        return candidate

    @cached_property
    def _weights(self) -> tuple[np.ndarray, np.ndarray]:
        """Weights in `adapted_mesh`, by cost: roots of the diagonals of P (states), R (inputs)."""
        problem = self.problem
        return np.sqrt(np.abs(np.diag(problem.P))), np.sqrt(np.diag(problem.R))

    def _transcription(self, intervals: int) -> Transcription:
        """Return the nonlinear program of a mesh with this number of intervals, built once."""
        if intervals not in self.transcriptions:
            self.transcriptions[intervals] = Transcription(self.problem, intervals)
        return self.transcriptions[intervals]

    def _mesh(self, seconds: float, intervals: int) -> np.ndarray:
        """Return the lengths of intervals that grow geometrically, s, (N,)."""
        fastest = spectral_radius(self.flights.loop)
        return mesh(seconds, intervals, fastest, self.flights.step)

    def _linear_guess(self, start: np.ndarray) -> Guess:
        """Return as guess the linear loop without limits, with v clipped to its limits."""
        from scipy.linalg import expm

        def guess(times: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
            z = expm(self.flights.loop * times[:, None, None]) @ start
            return z, np.clip(-z @ self.problem.K.T, *self.problem.input_limits)

        return guess

    def _guess_of_flight(self, flown: SimulatedFlight) -> Guess:
        """Return the states and inputs of a simulated flight as a guess."""
        problem = self.problem
        places = problem.followed_places
        z = flown.states[:, places] - problem.point.x[places]
        v = flown.inputs[:, problem.moved] - problem.point.u[problem.moved]

        def guess(times: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
            rows = np.minimum(np.searchsorted(flown.times, times), len(flown.times) - 1)
            return z[rows], v[rows]

        return guess


def difference_of_meshes(meshes: Mapping[int, float]) -> float:
    """Return the relative difference of the costs on the last two meshes.

    meshes: number of intervals -> cost
    """
    last_two = list(meshes.values())[-2:]
    return max(last_two) / min(last_two) - 1.0


def _cheapest_inside(flights: list[SimulatedFlight]) -> SimulatedFlight | None:
    """Return the cheapest of the flights that return inside the envelope, or None."""
    converging = [flight for flight in flights if flight.converges]
    return min(converging, key=lambda flight: flight.cost, default=None)


def sampled(guess: Guess, lengths: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return a guess's z at the collocation points and its v at the ends of the intervals.

    guess: function from times, s, to (z, v)
    lengths: lengths of the intervals, s, (N,)
    """
    from casadi import collocation_points

    ends = np.append(0.0, np.cumsum(lengths))
    tau = np.array(collocation_points(DEGREE, "radau"))
    inside = (ends[:-1, None] + lengths[:, None] * tau).ravel()
    return guess(inside)[0], guess(ends)[1]


def refutation(flown: SimulatedFlight, candidate: CandidateFlight) -> str:
    """Return the reason why a simulated flight refutes a candidate, or "" if it confirms it.

    A confirming flight stays in the envelope and converges to the trim. Its cost exceeds the
    proposed cost by at most `FLIGHT_AGREES`. It may be cheaper, because its cost is what counts.
    """
    if flown.departure is not None:
        return f"the flight that follows the candidate {flown.departure.text()}"
    if not flown.converges:
        return "the flight that follows the candidate does not end at the trim"
    off = flown.cost / candidate.cost - 1.0
    if off > FLIGHT_AGREES:
        return (
            f"the flight that follows the candidate costs {flown.cost:.6g}, {100 * off:+.2g} % off "
            f"the proposed {candidate.cost:.6g}"
        )
    return ""
