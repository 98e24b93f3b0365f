"""Outcomes of flights from a box of initial conditions."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from hfa_aircraft.march.ending import Outcome
from hfa_aircraft.march.march import History
from hfa_flight.air.history import Deviations
from hfa_flight.judge.endings import BALL, STILL, Endings, settled
from hfa_flight.judge.reach import HORIZON, Reach
from hfa_flight.policies.deployment.equilibrium import Equilibrium, EquilibriumSearch, whole_turns
from hfa_flight.simulate.envelope import Departure, departure, flight_envelope
from hfa_flight.simulate.limit_cycle import LimitCycle, oscillation
from hfa_flight.simulate.sampled_flights import (
    CompiledSamples,
    SampledFlight,
    in_threads,
)
from hfa_support.errors import BadInputError
from hfa_support.progress import Progress
from hfa_support.reporting.results import Result
from trim.point.operating_point import OperatingPoint


def refuse_edges(points: Sequence[OperatingPoint]) -> None:
    """Raise BadInputError for a trim at the edge of the envelope.

    At such a trim, a state whose rate depends on other linear states is at its limit. Flights with
    small deviations from such a trim leave the envelope immediately.
    """
    for point in points:
        model = point.model
        envelope = flight_envelope(model, point)
        values = point.x
        at_lowest = envelope.at_lowest(values)
        edges = np.flatnonzero(at_lowest | envelope.at_highest(values)).tolist()
        if not edges:
            continue
        A = model.at(point.states, point.inputs).A
        linear = model.state_places(model.linear)
        for index in edges:
            others = [number for number in linear if number != index]
            if not A[index, others].any():
                continue
            name = envelope.names[index]
            which, side = ("lowest", "above") if at_lowest[index] else ("highest", "below")
            raise BadInputError(
                f"the trim is at the {which} limit of {name}, "
                f"{model.describe(name, float(values[index]))}, so every flight leaves the "
                f"envelope immediately; choose a trim with {name} {side} this limit"
            )


#: Duration of the disturbance pulse, s, and the distance by which it alone would move a state, in
#: half-widths of the box.
PUSHED = 1.0
PUSH = 0.5
#: Duration of the flight in which a limit cycle is measured, s.
_CYCLE_SECONDS = 20.0
#: A flight that moved by less in the last window, in half-widths of the box, may be at an
#: equilibrium.
_SETTLED = 1e-3
#: Largest number of other equilibria that are searched.
_OTHERS = 3


@dataclass(frozen=True, eq=False)
class Place:
    """A trim, its initial-condition box, and the equilibrium to which flights converge.

    point: the trim.
    box: (k,), half-widths of the initial conditions about the trim.
    turns: (k,), full turn of each angle that the loop does not distinguish from none, otherwise 0.
    equilibrium: the equilibrium, or None if it does not exist.
    stable: whether the loop is stable at the equilibrium.
    reach: modes within reach of the policy, or None without an equilibrium.
    seconds: duration of a flight, s.
    drift: (k, n), slopes of the equilibrium with respect to the states outside the linear model, or
        None without an equilibrium.
    lag: (k,), lag of the linear states behind the equilibrium, or None without an equilibrium.
    steady: trim at which the linear states have the same rates as at the equilibrium, or None for
        `point`.
    """

    point: OperatingPoint
    box: np.ndarray
    turns: np.ndarray
    equilibrium: Equilibrium | None
    stable: bool
    reach: Reach | None = None
    seconds: float = HORIZON
    drift: np.ndarray | None = None
    lag: np.ndarray | None = None
    steady: OperatingPoint | None = None

    @property
    def decisive(self) -> np.ndarray:
        """Mask (k,) of the linear states that decide whether a flight converges."""
        return np.ones(len(self.box), dtype=bool) if self.reach is None else self.reach.decisive

    def centre(self, linear: list[int]) -> np.ndarray:
        """Return the linear states at the equilibrium, with their lag, (k,), or nan without one.

        linear: indices of the linear states
        """
        if self.equilibrium is None or self.lag is None:
            return np.full(len(linear), np.nan)
        return self.equilibrium.states[linear] + self.lag


@dataclass(frozen=True)
class Outcomes(Result):
    """Outcomes of the flights about one trim.

    starts: number of flights.
    converged: number of flights that converged. Such a flight is within the ball about the
        equilibrium at the end. If the loop is unstable, the distance must also not grow before the
        end.
    left_envelope: number of flights that left the limits of the model's states.
    worst_initial: linear state -> initial value of the worst flight: that which leaves first, or
        else ends farthest from the equilibrium.
    limit_cycle: limit cycle of a flight that does not converge or is about an unstable equilibrium,
        or None.
    converged_elsewhere: number of flights that converge to another equilibrium.
    other_equilibrium: linear state -> value at the first other equilibrium, or empty without one.
    other_inputs: input -> value there, or empty.
    moving: number of flights that neither converge to an equilibrium nor leave the limits.
    seconds: duration of a flight, s.
    departure: departure of the flight that leaves the envelope first, or None if no flight leaves.
    """

    starts: int
    converged: int
    left_envelope: int
    worst_initial: dict[str, float]
    limit_cycle: LimitCycle | None
    converged_elsewhere: int
    other_equilibrium: dict[str, float]
    other_inputs: dict[str, float]
    moving: int
    seconds: float
    departure: Departure | None


def seeded_starts(place: Place, count: int, seed: int, pushed: bool) -> tuple[Any, Any]:
    """Return random initial conditions (count, n) and disturbance pulses (count, k) about a trim.

    A pulse is added to the rates of the linear states.

    pushed: False if the pulses are 0
    """
    model = place.point.model
    random = np.random.default_rng([seed, 1])
    share = random.uniform(-1.0, 1.0, (count, len(model.linear)))
    directions = random.uniform(-1.0, 1.0, share.shape)
    rows = model.state_places(model.linear)
    starts = np.tile(place.point.x, (count, 1))
    starts[:, rows] += share * place.box
    pushes = directions * place.box * PUSH / PUSHED if pushed else np.zeros_like(share)
    return starts, pushes


class PlacedFlights:
    """Simulation of flights at several places.

    A flight ends if it leaves the envelope, or if its duration has elapsed.

    flight: the aircraft over a sample.
    places: the places.
    owners: index of each flight's place, (N,).
    trims: (X0; U0; p) of each flight's trim, (N, t).
    pushes: disturbance pulses, (N, k).
    first: initial states of the flights, (N, s).
    states: states at the end of each flight, (N, s).
    endings: how each flight ended.
    swings: half the range of each linear state in the last window, (N, k), or 0 for a state that
        does not count.
    """

    def __init__(
        self,
        flight: SampledFlight,
        places: list[Place],
        owners: np.ndarray,
        starts: np.ndarray,
        pushes: np.ndarray,
        seconds: float,
    ) -> None:
        """Prepare flights from initial states X, (N, n).

        pushes: disturbance pulses, (N, k)
        seconds: duration of a flight, s
        """
        model = flight.deployed.model
        self.flight = flight
        self.places = places
        self.owners = owners
        self.linear = model.state_places(model.linear)
        trims = [flight.deployed.trim_vector(place.point) for place in places]
        self.trims = np.array(trims)[owners]
        self.first = flight.start(starts, self.trims)
        self.states = self.first.copy()
        self.seconds = seconds
        self.pushes = pushes
        k = len(model.linear)
        self.swings = np.zeros((len(owners), k))
        self._moved_from = np.array([place.point.states for place in places], dtype=float)[owners]
        self._centres = np.array([place.centre(self.linear) for place in places])[owners]
        still = np.zeros((k, len(model.states)))
        drifts = [still if place.drift is None else place.drift for place in places]
        self._drifts = np.array(drifts)[owners]
        self._turns = np.array([place.turns for place in places])[owners]
        self._balls = np.array([BALL * place.box for place in places])[owners]
        self._decisive = np.array([place.decisive for place in places])[owners]
        envelopes = [flight_envelope(model, place.point) for place in places]
        least = np.array([envelope.least for envelope in envelopes])[owners]
        most = np.array([envelope.most for envelope in envelopes])[owners]
        self.endings = Endings(
            (least, most),
            self.distance,
            flight.windows(seconds),
            stable=np.array([place.stable for place in places])[owners],
            extremes=flight.extremes,
        )

    def fly(self, progress: Progress | None) -> None:
        """Simulate all flights, each until it ends or its duration has elapsed."""
        samples = self.flight.compiled(len(self.owners), self.seconds)
        window = self.flight.samples_in_window
        windows = self.flight.windows(self.seconds)

        def work(numbers: np.ndarray) -> None:
            shown = progress if progress is not None and 0 in numbers else None

            def over(flown: History) -> np.ndarray:
                if shown is not None:
                    shown(flown.first // window + 1, windows)
                return self.endings.over(replace(flown, flights=numbers[flown.flights]))

            flown, _ = samples.fly(
                self.first[numbers],
                self.trims[numbers],
                windows * window,
                pushes=self.pushes[numbers],
                pulse=PUSHED,
                over=over,
                keep=False,
            )
            self.states[numbers] = flown.states[:, 0]

        in_threads(work, len(self.owners), (window + 1) * self.first.shape[1])
        if progress is not None:
            progress(windows, windows)
        self.endings.close()

    def distance(self, flown: History) -> np.ndarray:
        """Return the distance of each flight from its equilibrium in a window, in balls, (N,).

        The equilibrium moves with the states outside the linear model.
        """
        flying = flown.flights
        X = flown.states[:, :, : len(self._moved_from[0])]
        lowest = np.fmin.reduce(X[:, :, self.linear], axis=1)
        highest = np.fmax.reduce(X[:, :, self.linear], axis=1)
        moved = X[:, -1] - self._moved_from[flying]
        centre = self._centres[flying] + np.einsum("nij,nj->ni", self._drifts[flying], moved)
        centre += whole_turns((lowest + highest) / 2.0 - centre, self._turns[flying])
        farthest = np.maximum(highest - centre, centre - lowest) / self._balls[flying]
        decisive = self._decisive[flying]
        distance = np.nan_to_num(np.where(decisive, farthest, 0.0).max(axis=1), nan=np.inf)
        self.swings[flying] = np.where(decisive, (highest - lowest) / 2.0, 0.0)
        return np.asarray(distance)

    def outcomes(self, owner: int) -> Outcomes:
        """Return the outcomes of the flights about one trim.

        owner: index of the trim
        """
        place = self.places[owner]
        model = place.point.model
        mine = np.flatnonzero(self.owners == owner)
        ends = self.endings.outcomes[mine]
        lost = mine[ends == Outcome.LEFT]
        returned = mine[ends == Outcome.CONVERGED]
        neither = mine[(ends != Outcome.LEFT) & (ends != Outcome.CONVERGED)]
        left = None
        worst = int(mine[np.argmax(self.endings.nearest[mine])])
        if lost.size:
            worst = int(lost[np.argmin(self.endings.left_at[lost])])
            left = self._departure(worst, place)
        at_start = self.first[worst][self.linear]
        cycle = None
        settling = neither
        if neither.size:
            swings = (self.swings[neither] / place.box).max(axis=1)
            settling = neither[swings <= _SETTLED]
            if settling.size < neither.size:
                swinging = int(neither[int(np.argmax(swings))])
                cycle = self._cycle(swinging, place)
        elif returned.size and not place.stable:
            cycle = self._cycle(int(returned[0]), place)
        elsewhere, elsewhere_at, elsewhere_inputs = self._other_equilibria(settling, place)
        return Outcomes(
            starts=len(mine),
            converged=len(returned),
            left_envelope=len(lost),
            worst_initial=dict(zip(model.linear, at_start.tolist(), strict=True)),
            limit_cycle=cycle,
            converged_elsewhere=elsewhere,
            other_equilibrium=elsewhere_at,
            other_inputs=elsewhere_inputs,
            moving=len(neither) - elsewhere,
            seconds=self.seconds,
            departure=left,
        )

    def _departure(self, number: int, place: Place) -> Departure | None:
        """Return the departure of a flight that left the envelope, with its state and limit."""
        times = self.flight.dt * self.endings.left_at[[number]]
        states = self.endings.left_with[[number]]
        return departure(flight_envelope(place.point.model, place.point), times, states, False)

    def _cycle(self, number: int, place: Place) -> LimitCycle | None:
        """Return the limit cycle of a flight that continues from its end, or None.

        The result is also None if a state is not finite.
        """
        point, flight = place.point, self.flight
        X, memory, *_ = flight.slices
        samples = flight.compiled(1, _CYCLE_SECONDS)
        ticks = max(64, round(_CYCLE_SECONDS / flight.dt))
        flown, _ = samples.fly(self.states[[number]], self.trims[[number]], ticks)
        states = flown.states[0]
        if not np.isfinite(states[:, X]).all():
            return None
        inputs = states[:, memory][:, : len(point.model.inputs)] - point.u
        deviations = states[:, X] - point.x
        empty = np.zeros((len(states), 0))
        trace = Deviations(flown.times, deviations, empty, inputs, deviations, {})
        cycle, _ = oscillation(point.model, trace, 0.0)
        return cycle

    def _other_equilibria(
        self, steady: np.ndarray, place: Place
    ) -> tuple[int, dict[str, float], dict[str, float]]:
        """Return the number of flights at other equilibria, and states and inputs at the first."""
        search = EquilibriumSearch(self.flight.deployed, place.point, place.steady)
        X, memory, *_ = self.flight.slices
        m = len(place.point.model.inputs)
        ball = BALL * place.box[place.decisive]
        count = 0
        first: dict[str, float] = {}
        inputs: dict[str, float] = {}
        for _ in range(_OTHERS):
            if not steady.size:
                break
            state = self.states[steady[0]]
            other = search.from_point(state[X], state[memory][:m])
            here = self.states[steady][:, self.linear][:, place.decisive]
            at = np.zeros(len(steady), dtype=bool)
            if other is not None and not _is_same(other, place, self.linear):
                there = other.states[self.linear]
                at = np.all(np.abs(here - there[place.decisive]) <= ball, axis=1)
            if other is not None and at[0]:
                count += int(at.sum())
                if not first:
                    model = place.point.model
                    first = dict(zip(model.linear, there.tolist(), strict=True))
                    inputs = dict(zip(model.inputs, other.inputs.tolist(), strict=True))
            at[0] = True
            steady = steady[~at]
        return count, first, inputs


def _is_same(other: Equilibrium, place: Place, linear: list[int]) -> bool:
    """Return whether an equilibrium coincides with the equilibrium of a place."""
    if place.equilibrium is None:
        return False
    apart = (other.states - place.equilibrium.states)[linear]
    apart = np.abs(apart - whole_turns(apart, place.turns))
    return bool(np.all(apart[place.decisive] <= BALL * place.box[place.decisive]))


def fly_places(
    flight: SampledFlight,
    places: list[Place],
    samples: int,
    seed: int,
    progress: Progress | None,
) -> tuple[list[Outcomes], list[Outcomes]]:
    """Return the outcomes of flights about each trim, without and with a disturbance pulse.

    The results are two lists with the `Outcomes` at each trim.

    samples: number of initial conditions at each trim
    """
    drawn = [
        seeded_starts(place, samples, seed, pushed) for pushed in (False, True) for place in places
    ]
    starts, pushes = (np.vstack(each) for each in zip(*drawn, strict=True))
    owners = np.repeat(np.arange(2 * len(places)), samples)
    seconds = max(place.seconds for place in places)
    flown = PlacedFlights(flight, places + places, owners, starts, pushes, seconds)
    flown.fly(progress)
    outcomes = [flown.outcomes(owner) for owner in range(len(flown.places))]
    return outcomes[: len(places)], outcomes[len(places) :]


def ends_from_trim(
    flight: SampledFlight, points: list[OperatingPoint], samples: CompiledSamples, seconds: float
) -> tuple[np.ndarray, np.ndarray]:
    """Simulate flights that begin at their trims, for at most `seconds`.

    Returns the final X (N, n) and the last commanded inputs (N, m). All flights end early if all
    have settled.
    """
    model = points[0].model
    still = STILL * np.array([model.signals[name].nominal for name in model.states])
    trims = np.array([flight.deployed.trim_vector(point) for point in points])
    X, memory, *_ = flight.slices
    ticks = flight.samples_in_window * flight.windows(seconds)
    start = flight.start(trims[:, X], trims)
    flown, _ = samples.fly(start, trims, ticks, over=settled(still), keep=False)
    final = flown.states[:, 0]
    last_command = final[:, memory][:, : len(model.inputs)]
    return final[:, X], last_command
