"""Search for the best flight: proposals from several guesses and meshes, and their simulation."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import NamedTuple

import numpy as np

from hfa_flight.plan.collocation import (
    DEGREE,
    Equations,
    Proposal,
    Transcription,
    adapted_mesh,
    mesh,
)
from hfa_flight.plan.flights import Flights, SimulatedFlight
from hfa_flight.plan.problem import MARGIN, FlightProblem
from hfa_support.errors import NoSolutionError
from hfa_support.matrices import spectral_radius

#: Number of intervals of the coarsest mesh, and largest number of refinements.
INTERVALS = 25
_DIVISIONS = 4
#: Factors on the margin to the state limits if a flight left them: on every mesh, and finally on
#: the last mesh that agreed.
_TIGHTER = 3.0
_TIGHTEST = 9.0
#: Number of corrections of a proposal whose flight leaves a limit between its points. Each narrows
#: the limits of the intervals concerned by this multiple of the excess, and a reserve.
_CORRECTIONS = 4
_CORRECTED = 1.1
_RESERVE = 5e-4
#: Largest relative difference of the costs on two meshes, and largest relative excess of the cost
#: of a flight over that of its proposal.
MESHES_AGREE = 0.005
FLIGHT_AGREES = 0.01
#: Relative excess of a flight's cost over that of the proposal with the usual margin, above which a
#: finer mesh is tried.
_WORTH = 0.002
#: An input alternates if it changes this often between half of one limit and half of the other. A
#: mesh of _ALTERNATING_MESH intervals is then not refined, because the input would only alternate
#: faster.
_ALTERNATES = 6
_ALTERNATING_MESH = 200
#: Largest linear cost after the horizon, relative to the cost.
TAIL = 0.001
#: Largest linear cost after the horizon if a state outside the cost, such as altitude, moves the
#: equilibrium.
DRIFTING_TAIL = 0.005
#: Relative difference below which costs on the coarsest mesh belong to the same optimum.
_SAME_OPTIMUM = 0.002
#: Relative difference below which costs on the same mesh belong to the same optimum.
_EQUAL = 1e-6
#: Number of different optima that are refined.
_FOLLOWED = 2
#: Name of the guess that is the optimum for a larger R, and factor on R.
_COSTLY = "costly inputs"
_COSTLY_PRICE = 10.0
#: Largest initial inputs of a guess, in nominal values.
_LARGEST_INPUT = 10.0
#: Linear cost after the first horizon, relative to the initial one.
_FIRST_TAIL = 3e-4
#: Step with which this time is searched, in time constants of the slowest mode, largest number of
#: steps, and factor of the first horizon on the time found.
_TAIL_STEP = 0.25
_TAIL_STEPS = 40
_LONGER_THAN_TAIL = 1.2
#: Factor by which a horizon is extended, and largest number of extensions.
_LONGER = 1.6
_EXTENSIONS = 5
NONE_WITHIN = (
    "IPOPT finds no flight within the limits from any initial guess, possibly because of "
    "tables or kinks; such a flight may exist"
)
#: Name of a flight that follows a proposal that it does not confirm.
REFUSED = "flight that follows a refused proposal"
#: Duration of the linear policy after the horizon, relative to the horizon.
AFTER = 0.25


#: Times (N,) -> z (N, k) and v (N, m) at these times.
Guess = Callable[[np.ndarray], tuple[np.ndarray, np.ndarray]]


class Found(NamedTuple):
    """Best flight that was found and simulated.

    flown: simulated flight, which follows the proposal or the cheaper linear optimum
    proposal: proposal that a flight confirms, or None for an upper bound of the least cost alone
    seconds: horizon of the proposal, s
    meshes: number of intervals -> proposed cost, empty without a proposal
    guesses: name of an initial guess -> cost on the finest mesh used for this guess, empty without
        a proposal
    linear: flight of the linear optimum from the same initial condition
    reason: reason why no proposal was confirmed, or "" with a proposal
    """

    flown: SimulatedFlight
    proposal: Proposal | None
    seconds: float
    meshes: dict[int, float]
    guesses: dict[str, float]
    linear: SimulatedFlight
    reason: str = ""

    @property
    def spread(self) -> float:
        """Largest relative difference of the cost between the last two meshes or between initial
        guesses.
        """
        return max(self.spread_of_meshes, self.spread_of_guesses)

    @property
    def spread_of_meshes(self) -> float:
        """Relative difference of the proposed costs on the last two meshes."""
        return difference_of_meshes(self.meshes)

    @property
    def spread_of_guesses(self) -> float:
        """Relative difference of the largest and the smallest cost found from different initial
        guesses.
        """
        guessed = list(self.guesses.values())
        return max(guessed) / min(guessed) - 1.0


class _Confirmed(NamedTuple):
    """Flight that confirms a proposal, and number of intervals -> proposed cost."""

    flown: SimulatedFlight
    proposal: Proposal
    meshes: dict[int, float]


class _Unconfirmed(Exception):
    """Reason why no proposal is confirmed, and the flights that follow those that were refused."""

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

    @cached_property
    def _equations(self) -> Equations:
        return Equations.of(self.problem, self.count)

    @cached_property
    def _loop(self) -> np.ndarray:
        """State matrix A - B K of the linear closed loop."""
        linear = self.problem.linear
        return np.asarray(linear.A - linear.B @ self.problem.K)

    def found(self, start: np.ndarray) -> Found:
        """Return the best flight found from an initial condition.

        If the simulation confirms no proposal, the result is the cheapest simulated flight within
        the limits: an upper bound of the least cost.

        start: initial deviations z, (k,)

        Raises NoSolutionError, with the reason, if no simulated flight stays within the limits and
        converges. Raises BadInputError if the initial condition is outside the limits.
        """
        self.problem.refuse_outside(start)
        _ = self._equations  # refuses a compiled function before the first flight
        try:
            return self._confirmed_best(start)
        except _Unconfirmed as error:
            horizon = self.horizon(start)
            linear = self.converging_linear(start, horizon)
            cheapest = _cheapest_inside([linear, *error.flights])
            if cheapest is None:
                raise NoSolutionError(f"no flight found: {error}") from None
            return Found(cheapest, None, horizon, {}, {}, linear, str(error))

    def converging_linear(self, start: np.ndarray, horizon: float) -> SimulatedFlight:
        """Return the flight of the linear optimum, simulated longer until it converges.

        start: initial deviations z, (k,)
        horizon: duration of the first simulation, s
        """
        for _ in range(_EXTENSIONS):
            linear = self.flights.linear(start, (1.0 + AFTER) * horizon)
            if linear.converges:
                break
            horizon *= _LONGER
        return linear

    def _confirmed_best(self, start: np.ndarray) -> Found:
        """Return the best flight whose proposal the simulation confirms."""
        horizon = self.horizon(start)
        for _ in range(_EXTENSIONS):
            horizon = self.flights.tick * math.ceil(horizon / self.flights.tick)
            linear = self.flights.linear(start, (1.0 + AFTER) * horizon)
            proposals = self._from_guesses(start, horizon, linear)
            best = proposals[_cheapest_first(proposals)[0]]
            unfinished = self._unfinished(best)
            if not unfinished:
                return self._refined(horizon, linear, proposals)
            horizon *= _LONGER
        raise _Unconfirmed(f"with a horizon of {horizon / _LONGER:.3g} s, {unfinished}")

    def _unfinished(self, proposal: Proposal) -> str:
        """Return why the horizon of a proposal is too short, or ""."""
        share = proposal.tail / proposal.cost
        if share > (DRIFTING_TAIL if self.problem.carried else TAIL):
            return f"{100 * share:.2g} % of the cost remains at the end"
        end = proposal.z[-1, -1, : len(proposal.start)]
        after = self.flights.linear(end, AFTER * float(proposal.lengths.sum()))
        if after.departure is not None:
            return "the linear policy leaves the limits after the horizon"
        return ""

    def horizon(self, start: np.ndarray) -> float:
        """Return 1.2 times the time after which the linear loop's remaining cost is negligible, s.

        The result is at most 12 time constants of the slowest mode.

        start: initial deviations z, (k,)
        """
        from scipy.linalg import expm

        P = self.problem.P
        slowest = -float(np.linalg.eigvals(self._loop).real.max())
        step = _TAIL_STEP / slowest
        transition = expm(self._loop * step)
        negligible = _FIRST_TAIL * float(start @ P @ start)
        count, z = 1, transition @ start
        while z @ P @ z > negligible and count < _TAIL_STEPS:
            count, z = count + 1, transition @ z
        return _LONGER_THAN_TAIL * count * step

    def _refined(
        self,
        seconds: float,
        linear: SimulatedFlight,
        proposals: Mapping[str, Proposal],
    ) -> Found:
        """Return the cheapest flight that the simulation confirms, on finer meshes."""
        finer = {}
        for name in _distinct(proposals):
            proposal = self._finer(2 * INTERVALS, proposals[name], MARGIN)
            if proposal.feasible:
                finer[name] = proposal
        failed = _Unconfirmed(NONE_WITHIN)
        costs = {name: each.cost for name, each in (dict(proposals) | finer).items()}
        for name in _cheapest_first(finer):
            meshes = {INTERVALS: proposals[name].cost, 2 * INTERVALS: finer[name].cost}
            try:
                flown, best, meshes = self._confirmed(seconds, meshes, finer[name])
            except _Unconfirmed as error:
                failed = _Unconfirmed(str(error), [*failed.flights, *error.flights])
                continue
            # Near the trim, the linear policy may be cheaper by the errors of the meshes.
            flown = _cheapest_inside([flown, linear]) or flown
            return Found(flown, best, seconds, meshes, costs | {name: best.cost}, linear)
        raise failed

    def _confirmed(self, seconds: float, meshes: dict[int, float], best: Proposal) -> _Confirmed:
        """Return the cheapest flight that confirms a proposal.

        A flight that is dearer than the optimizer's proposal by more than _WORTH, because of
        narrower limits, is compared with those on finer meshes.
        """
        agreed = None  # last proposal on whose cost two meshes agree, with the costs of its meshes
        confirmed: list[_Confirmed] = []
        simulated: list[SimulatedFlight] = []  # refused, unless one is confirmed
        intervals = len(best.lengths)
        for _ in range(_DIVISIONS):
            change = difference_of_meshes(meshes)
            alternating = self._alternating(best)
            reason = f"two meshes differ by {100 * change:.2g} %{alternating}"
            if change <= MESHES_AGREE:
                flown, followed = self._simulated(best, seconds, _TIGHTER)
                simulated.append(replace(flown, policy=REFUSED))
                reason = refutation(flown, followed)
                if not reason:
                    confirmed.append(_Confirmed(flown, followed, meshes))
                    if flown.cost <= (1.0 + _WORTH) * best.cost:
                        break
                agreed = best, meshes
            elif alternating and intervals >= _ALTERNATING_MESH:
                break
            intervals *= 2
            if 2 * intervals * self.flights.step > seconds:
                break
            finer = self._finer(intervals, best, MARGIN)
            if not finer.feasible:
                break
            best = finer
            meshes = {**meshes, intervals: best.cost}
        if confirmed:
            return min(confirmed, key=lambda each: each.flown.cost)
        if agreed is not None:
            proposal, meshes = agreed
            flown, followed = self._simulated(proposal, seconds, _TIGHTEST)
            simulated.append(replace(flown, policy=REFUSED))
            if not refutation(flown, followed):
                return _Confirmed(flown, followed, meshes)
        raise _Unconfirmed(reason, simulated)

    def _alternating(self, proposal: Proposal) -> str:
        """Return a note on each input that alternates between its limits in a proposal, or ""."""
        # An input alternates if it passes `_ALTERNATES` times or more from more than half of one
        # limit to more than half of the opposite limit.
        lowest, highest = self.problem.input_limits
        texts = []
        for column, name in enumerate(self.problem.inputs):
            v = proposal.v[:, column]
            side = np.where(v > 0.5 * highest[column], 1, np.where(v < 0.5 * lowest[column], -1, 0))
            turns = int((np.diff(side[side != 0]) != 0).sum())
            if turns >= _ALTERNATES:
                texts.append(
                    f"; {name} alternates between its limits {turns} times, and more often on a "
                    "finer mesh; give it a larger R"
                )
        return "".join(texts)

    def _simulated(
        self, best: Proposal, seconds: float, factor: float
    ) -> tuple[SimulatedFlight, Proposal]:
        """Return the simulated flight that follows a proposal, and the followed proposal."""
        duration = (1.0 + AFTER) * seconds
        flown = self.flights.follow(best, duration)
        if flown.departure is None:
            return flown, best
        corrected = self._corrected(best, flown, duration)
        tighter = self._finer(len(best.lengths), best, factor * MARGIN)
        tried = [corrected] if corrected else []
        if tighter.feasible:
            tried.append((self.flights.follow(tighter, duration), tighter))
        within = [each for each in tried if each[0].departure is None]
        return min(within or [(flown, best)], key=lambda each: each[0].cost)

    def _corrected(
        self, proposal: Proposal, flown: SimulatedFlight, seconds: float
    ) -> tuple[SimulatedFlight, Proposal] | None:
        """Return a flight within the limits that follows a proposal with limits narrowed where a
        flight exceeded them, or None.

        flown: flight of the proposal, which exceeds limits between its points
        """
        program = self._transcription(len(proposal.lengths))
        margins = np.full((len(proposal.lengths), 1), MARGIN)
        for _ in range(_CORRECTIONS):
            margins += self._exceeded(proposal, flown)
            z, v = sampled(proposal.at, proposal.lengths)
            proposal = program.solve(proposal.start, proposal.lengths, z, v, margins)
            if not proposal.feasible:
                return None
            flown = self.flights.follow(proposal, seconds)
            if flown.departure is None:
                return flown, proposal
        return None

    def _exceeded(self, proposal: Proposal, flown: SimulatedFlight) -> np.ndarray:
        """Return by how much a flight that follows a proposal exceeds limits in each interval or
        the next one, as a fraction of the distance from trim to limit, (N, 1).
        """
        problem = self.problem
        places = problem.followed_places
        z = flown.states[:, places] - problem.point.x[places]
        lowest, highest = problem.state_limits
        beyond = np.maximum(z / highest, z / lowest).max(axis=1) - 1.0
        interval = np.searchsorted(proposal.ends, flown.times, side="right") - 1
        count = len(proposal.lengths)
        excess = np.zeros(count + 1)
        flies = interval < count
        np.maximum.at(excess, interval[flies], beyond[flies])
        near = np.maximum(excess[:-1], excess[1:])
        return np.where(near > 0.0, _CORRECTED * near + _RESERVE, 0.0)[:, None]

    def _from_guesses(
        self, start: np.ndarray, seconds: float, linear: SimulatedFlight
    ) -> dict[str, Proposal]:
        """Return name of a guess -> feasible proposal on the coarsest mesh."""
        first = {
            "linear loop": self._linear_guess(start),
            "slow decay": self._decay(start, 3.0 / seconds),
        }
        if linear.converges:
            first["linear loop"] = self._guess_of_flight(linear)
        else:
            first["fast decay"] = self._decay(start, 10.0 / seconds)
        adapted: list[tuple[Proposal, Proposal]] = []
        proposals = self._solved(start, seconds, first, adapted)
        costs = [proposal.cost for proposal in proposals.values()]
        if len(costs) == len(first) and max(costs) <= (1.0 + _SAME_OPTIMUM) * min(costs):
            return proposals
        lowest, highest = self.problem.input_limits
        more = {
            "inputs at their highest": self._decay(start, 3.0 / seconds, highest),
            "inputs at their lowest": self._decay(start, 3.0 / seconds, lowest),
        }
        proposals |= self._solved(start, seconds, more, adapted)
        costly = {_COSTLY: first["linear loop"]}
        proposals |= self._solved(start, seconds, costly, [], _COSTLY_PRICE)
        if not proposals:
            raise _Unconfirmed(NONE_WITHIN)
        return proposals

    def _solved(
        self,
        start: np.ndarray,
        seconds: float,
        guesses: Mapping[str, Guess],
        adapted: list[tuple[Proposal, Proposal]],
        price: float = 1.0,
    ) -> dict[str, Proposal]:
        """Return name of a guess -> proposal on a mesh adapted to a first proposal."""
        lengths = self._mesh(seconds, INTERVALS)
        coarsest = self._transcription(INTERVALS)
        proposals = {}
        for name, guess in guesses.items():
            rough = coarsest.solve(start, lengths, *sampled(guess, lengths), price=price)
            if not rough.feasible:
                continue
            proposal = next((each for known, each in adapted if _equal(known, rough)), None)
            if proposal is None:
                proposal = self._finer(INTERVALS, rough, MARGIN)
                adapted.append((rough, proposal))
            if proposal.feasible:
                proposals[name] = proposal
        return proposals

    def _finer(self, intervals: int, guess: Proposal, margin: float) -> Proposal:
        """Return the proposal solved again on a mesh of `intervals` intervals."""
        # The mesh is adapted to the given proposal. If the new proposal is infeasible, it is
        # replaced by one on a geometric mesh, which may be infeasible too.
        adapted = adapted_mesh(guess, intervals, self.flights.step, self._weights)
        for lengths in (adapted, self._mesh(float(guess.lengths.sum()), intervals)):
            z, v = sampled(guess.at, lengths)
            proposal = self._transcription(intervals).solve(guess.start, lengths, z, v, margin)
            if proposal.feasible:
                break
        return proposal

    @cached_property
    def _weights(self) -> tuple[np.ndarray, np.ndarray]:
        """Weights for `adapted_mesh`: the square roots of the diagonals of P, (k,), and R, (m,)."""
        problem = self.problem
        return np.sqrt(np.abs(np.diag(problem.P))), np.sqrt(np.diag(problem.R))

    def _transcription(self, intervals: int) -> Transcription:
        if intervals not in self.transcriptions:
            self.transcriptions[intervals] = Transcription(self.problem, intervals, self._equations)
        return self.transcriptions[intervals]

    def _mesh(self, seconds: float, intervals: int) -> np.ndarray:
        fastest = spectral_radius(self._loop)
        return mesh(seconds, intervals, fastest, self.flights.step)

    def _linear_guess(self, start: np.ndarray) -> Guess:
        """Return as guess the linear loop without limits, with v clipped to its limits."""
        from scipy.linalg import expm

        def guess(times: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
            z = expm(self._loop * times[:, None, None]) @ start
            return z, np.clip(-z @ self.problem.K.T, *self.problem.input_limits)

        return guess

    def _decay(self, start: np.ndarray, rate: float, v: np.ndarray | None = None) -> Guess:
        """Return a guess in which z and v decay exponentially."""
        begin = np.zeros(len(self.problem.inputs)) if v is None else v
        most = _LARGEST_INPUT * self.problem.sizes[1]
        begin = np.clip(begin, -most, most)

        def guess(times: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
            decay = np.exp(-rate * times)[:, None]
            return decay * start, decay * begin

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
    finest = list(meshes.values())[-2:]
    return max(finest) / min(finest) - 1.0


def _cheapest_inside(flights: list[SimulatedFlight]) -> SimulatedFlight | None:
    """Return the cheapest of the flights that return inside the envelope, or None."""
    converging = [each for each in flights if each.converges]
    return min(converging, key=lambda each: each.cost, default=None)


def _cheapest_first(proposals: Mapping[str, Proposal]) -> list[str]:
    """Return the names of proposals in the order of increasing cost."""
    return sorted(proposals, key=lambda name: proposals[name].cost)


def _distinct(proposals: Mapping[str, Proposal]) -> list[str]:
    """Return the names of the cheapest proposals with different costs, at most `_FOLLOWED`."""
    chosen: list[str] = []
    for name in _cheapest_first(proposals):
        dearest = proposals[chosen[-1]].cost if chosen else 0.0
        if proposals[name].cost > (1.0 + _SAME_OPTIMUM) * dearest and len(chosen) < _FOLLOWED:
            chosen.append(name)
    return chosen


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


def _equal(one: Proposal, other: Proposal) -> bool:
    """Return whether the costs of two proposals on the same mesh agree to the accuracy of IPOPT."""
    return abs(one.cost - other.cost) <= _EQUAL * abs(one.cost)


def refutation(flown: SimulatedFlight, proposal: Proposal) -> str:
    """Return the reason why a simulated flight refutes a proposal, or "" if the flight confirms it.

    A confirming flight stays in the envelope and converges to the trim. Its cost exceeds the
    proposed cost by at most `FLIGHT_AGREES`. It may be cheaper, because its cost is what counts.
    """
    if flown.departure is not None:
        return f"the flight that follows the proposal {flown.departure.text()}"
    if not flown.converges:
        return "the flight that follows the proposal does not end at the trim"
    off = flown.cost / proposal.cost - 1.0
    if off > FLIGHT_AGREES:
        return (
            f"the flight that follows the proposal costs {flown.cost:.6g}, {100 * off:+.2g} % off "
            f"the proposed {proposal.cost:.6g}"
        )
    return ""
