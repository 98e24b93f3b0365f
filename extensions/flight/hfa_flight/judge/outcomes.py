"""Outcomes of flights from a box of initial conditions."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any, NamedTuple

import numpy as np

from hfa_aircraft.batch_simulation import FlightOutcome, History, is_within
from hfa_flight.judge.flight_costs import CostRatio, SampleCost, cost_ratio
from hfa_flight.policies.deployment.deployed import Deployed
from hfa_flight.policies.deployment.sampled_loop import Equilibrium
from hfa_flight.simulate.envelope import Departure, departure, flight_envelope
from hfa_flight.simulate.sampled_flights import SampledFlight, in_threads
from hfa_support.errors import BadInputError
from hfa_support.progress import Progress
from hfa_support.reporting.results import Result
from trim.linear.delays import Chain
from trim.point.operating_point import OperatingPoint

#: Half-widths of the ball within which a flight has converged, in half-widths of the
#: initial-condition box.
BALL = 0.05
#: Flights about an unstable equilibrium leave in the end: the largest distances in the last
#: `_LAST_WINDOWS` windows are more than `_GROWTH_FACTOR` times those in as many before, in most
#: flights. A single one may be so by chance, as a limit cycle of a quantizer wanders. Smaller
#: distances, in half-widths of the ball, are rounding.
_LAST_WINDOWS = 10
_GROWTH_FACTOR = 1.02
_ROUNDING = 1e-3


def refuse_edges(points: Sequence[OperatingPoint]) -> None:
    """Raise BadInputError for a trim at the edge of the envelope.

    At such a trim, a state whose rate depends on other linear states is at its limit. Flights with
    small deviations from such a trim leave the envelope immediately.
    """
    for point in points:
        model = point.model
        envelope = flight_envelope(model, point)
        values = point.x
        at_lowest, at_highest = envelope.at_limits(values)
        edges = np.flatnonzero(at_lowest | at_highest).tolist()
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
_PULSE_DURATION = 1.0
_PULSE_SIZE = 0.5
#: Least and largest duration of a flight, s.
_SHORTEST_FLIGHT = 60.0
_LONGEST_FLIGHT = 300.0
#: Number of time constants of the slowest mode after which a flight has converged.
_TIME_CONSTANTS = 4.0


@dataclass(frozen=True, eq=False)
class TrimCase:
    """A trim, its initial-condition box, and the equilibrium to which flights converge.

    point: the trim.
    box: (k,), half-widths of the initial conditions about the trim.
    equilibrium: the equilibrium, or None if it does not exist.
    loop: sampled loop at the equilibrium with the deployed delay, in nominal values, or None
        without an equilibrium.
    """

    point: OperatingPoint
    box: np.ndarray
    equilibrium: Equilibrium | None = None
    loop: Chain | None = None

    @property
    def sizes(self) -> np.ndarray:
        """Half-widths of the box, or nominal values where it has none, at a limit, (k,)."""
        model = self.point.model
        return np.where(self.box > 0.0, self.box, model.nominal(model.linear))

    @property
    def radius(self) -> float:
        """Spectral radius of the sampled loop, or nan without an equilibrium."""
        return math.nan if self.loop is None else self.loop.radius

    @property
    def seconds(self) -> float:
        """Duration of flights about the equilibrium, s.

        The duration is four time constants of the slowest mode of the sampled loop, within
        [`_SHORTEST_FLIGHT`, `_LONGEST_FLIGHT`], and the shortest for a loop that is not stable.
        """
        if self.loop is None or not 0.0 < self.radius < 1.0:
            return _SHORTEST_FLIGHT
        settled = -_TIME_CONSTANTS * self.loop.dt / math.log(self.radius)
        return min(max(_SHORTEST_FLIGHT, settled), _LONGEST_FLIGHT)


@dataclass(frozen=True)
class Outcomes(Result):
    """Outcomes of the flights about one trim.

    starts: number of flights.
    converged: number of flights that converged. Such a flight is within the ball about the end at
        the end, and its distance, or that of most flights, does not grow before; with errors of
        sensors, one that stays within the limits.
    end: linear state -> value to which flights converge: that of the equilibrium, or without one,
        as of a policy with steps, the median of the last window.
    left_envelope: number of flights that left the limits of the model's states.
    worst_initial: linear state -> initial value of the worst flight: that which leaves first, or
        else ends farthest from the equilibrium.
    seconds: duration of a flight, s.
    departure: departure of the flight that leaves the envelope first, or None if no flight leaves.
    """

    starts: int
    converged: int
    end: dict[str, float]
    left_envelope: int
    worst_initial: dict[str, float]
    seconds: float
    departure: Departure | None


def seeded_starts(case: TrimCase, count: int, seed: int, with_pulse: bool) -> tuple[Any, Any]:
    """Return random initial conditions (count, n) and disturbance pulses (count, k) about a trim.

    A pulse is added to the rates of the linear states.

    with_pulse: False if the pulses are 0
    """
    model = case.point.model
    # A stream of its own: `drawn_starts` with the same seed returns other initial conditions.
    random = np.random.default_rng([seed, 1])
    # Drawn before the pulses, so that flights with pulses begin at the same states.
    in_half_widths = random.uniform(-1.0, 1.0, (count, len(model.linear)))
    rows = model.state_places(model.linear)
    starts = np.tile(case.point.x, (count, 1))
    starts[:, rows] += in_half_widths * case.box
    pulses = np.zeros_like(in_half_widths)
    if with_pulse:
        directions = random.uniform(-1.0, 1.0, pulses.shape)
        pulses = directions * case.box * _PULSE_SIZE / _PULSE_DURATION
    return starts, pulses


class CaseFlights:
    """Simulation of N flights about several trims, and how they end, decided window by window.

    A flight ends with the window in which it leaves the limits, or a state is not a number. A
    flight of the full duration converges if it ends in the ball, and its distance does not grow, as
    those of most flights about the trim then do; with errors of sensors, which do not end, if it
    stays within the limits.

    flight: the aircraft over a sample.
    cases: the trims with their boxes and equilibria.
    prices: cost of the samples of each trim's flights, or None.
    owners: index of each flight's case, (N,).
    trims: (X0; U0; p) of each flight's trim, (N, t).
    pulses: disturbance pulses, (N, k).
    first: initial states of the flights, (N, s).
    seconds: duration of a flight, s.
    ends: `FlightOutcome` of each flight, (N,).
    costs: cost of each flight, (N,), inf if it leaves; 0 without a price.
    nearest: distance of each flight in its last window, (N,).
    left_at: number of the step at which each flight left the limits, (N,).
    left_with: states at this step, (N, n).
    """

    def __init__(
        self,
        flight: SampledFlight,
        cases: list[TrimCase],
        owners: np.ndarray,
        starts: np.ndarray,
        pulses: np.ndarray,
        prices: Sequence[SampleCost | None],
        seed: int = 0,
    ) -> None:
        """Prepare flights from initial states X, (N, n).

        pulses: disturbance pulses, (N, k)
        seed: seed of the errors of sensors
        """
        model = flight.deployed.model
        self.flight = flight
        self.cases = cases
        self.owners = owners
        self.linear = model.state_places(model.linear)
        trims = [flight.deployed.trim_vector(case.point) for case in cases]
        self.trims = np.array(trims)[owners]
        self.first = flight.start(starts, self.trims)
        self.seconds = max(case.seconds for case in cases)
        self.pulses = pulses
        # Of each case, and with `[owners]` of each flight: ball and limits.
        self._balls = np.array([BALL * case.sizes for case in cases])[owners]
        envelopes = [flight_envelope(model, case.point) for case in cases]
        self._least = np.array([envelope.least for envelope in envelopes])[owners]
        self._most = np.array([envelope.most for envelope in envelopes])[owners]
        self._windows = flight.windows(self.seconds)
        count = len(owners)
        self._errors = flight.drawn_errors(seed, count)
        self.ends = np.full(count, FlightOutcome.UNDECIDED, dtype=object)
        self.prices = [*prices]
        self.costs = np.zeros(count)
        self.nearest = np.full(count, np.inf)
        self.middles = np.full((len(cases), len(self.linear)), np.nan)
        # Lowest and highest linear states of each flight in its last windows, in those before, and
        # in the last one, (3, 2, N, k).
        self._ranges = np.full((3, 2, count, len(self.linear)), np.nan)
        self.left_at = np.zeros(count, dtype=int)
        self.left_with = np.full((count, len(model.states)), np.nan)

    def fly(self, progress: Progress | None) -> None:
        """Simulate all flights, each until it ends or its duration has elapsed."""
        count, state_size = self.first.shape
        loop = self.flight.compiled(count, self.seconds)
        window = self.flight.samples_in_window
        windows = self._windows

        def fly_some(numbers: np.ndarray) -> None:
            """Simulate the flights with these numbers; those of flight 0 show the progress."""
            shown = progress if progress is not None and 0 in numbers else None

            def over(flown: History) -> np.ndarray:
                """Return the mask of `_over`, and show the progress."""
                if shown is not None:
                    shown(flown.first // window + 1, windows)
                return self._over(replace(flown, flights=numbers[flown.flights]))

            loop.fly(
                self.first[numbers],
                self.trims[numbers],
                windows * window,
                pushes=self.pulses[numbers],
                pulse=_PULSE_DURATION,
                errors=[self._errors[number] for number in numbers] if self._errors else (),
                over=over,
                keep=False,
            )

        in_threads(fly_some, count, stored=(window + 1) * state_size)
        if progress is not None:
            progress(windows, windows)
        # Flights of the full duration that end in the ball have converged.
        is_left = self.ends == FlightOutcome.LEFT
        self.costs[is_left] = np.inf
        for owner, case in enumerate(self.cases):
            if case.equilibrium is not None:
                self.middles[owner] = case.equilibrium.states[self.linear]
            elif (staying := (self.owners == owner) & ~is_left).any():
                self.middles[owner] = np.median(self._ranges[2][:, staying].mean(axis=0), axis=0)
        late, before, self.nearest = map(self._distance, self._ranges)
        if self.flight.sensors:
            self.ends[~is_left] = FlightOutcome.CONVERGED
            return
        in_ball = ~is_left & (self.nearest <= 1.0)
        grows = (late > _GROWTH_FACTOR * before) & (late > _ROUNDING)
        for owner in range(len(self.cases)):
            own = in_ball & (self.owners == owner)
            if 2 * np.count_nonzero(grows & own) > np.count_nonzero(own):
                in_ball &= ~(grows & own)
        self.ends[in_ball] = FlightOutcome.CONVERGED

    def _over(self, flown: History) -> np.ndarray:
        """Return a mask (F, T + 1), True at the end of a window in which a flight ends.

        flown: F flights in a window of T samples
        """
        flying = flown.flights
        window = flown.first // (flown.states.shape[1] - 1)
        remaining, block = self._windows - window, min(_LAST_WINDOWS, max(1, self._windows // 3))
        # fmin and fmax leave out values that are not numbers, unless all are.
        linear = flown.states[:, :, self.linear]
        ends = np.fmin.reduce(linear, axis=1), np.fmax.reduce(linear, axis=1)
        self._ranges[2][:, flying] = ends
        if remaining <= 2 * block:
            kept = self._ranges[0 if remaining <= block else 1]
            kept[0, flying] = np.fmin(kept[0, flying], ends[0])
            kept[1, flying] = np.fmax(kept[1, flying], ends[1])
        for owner, price in enumerate(self.prices):
            if price is not None and (own := self.owners[flying] == owner).any():
                self.costs[flying[own]] += price.of(flown.states[own])
        has_left = self._mark_departures(flown)
        self.ends[flying[has_left]] = FlightOutcome.LEFT
        mask = np.zeros(flown.states.shape[:2], dtype=bool)
        mask[:, -1] = has_left
        return mask

    def _mark_departures(self, flown: History) -> np.ndarray:
        """Return a mask of the flights that left their limits, and store when and with what."""
        # A flight leaves with the first step whose extremes are not all within its limits, or
        # whose last states are not all finite.
        # Only the first states have limits; the inputs and memories after them have none.
        states = flown.states[:, :, : self._least.shape[1]]
        lows, highs = self.flight.extremes(flown.states)
        least, most = self._least[flown.flights, None], self._most[flown.flights, None]
        within = is_within(lows, least, most) & is_within(highs, least, most)
        inside = within & np.isfinite(states).all(axis=2)
        has_left: np.ndarray = ~inside.all(axis=1)
        for row in np.flatnonzero(has_left):
            step = int(inside[row].argmin())
            flight = flown.flights[row]
            self.left_at[flight] = flown.first + step
            # Of each state, the extreme that is beyond its limit, or the highest value. A lowest
            # value of -inf is beyond a missing limit too.
            low, high = lows[row, step], highs[row, step]
            extreme = np.where((low < least[row, 0]) | np.isneginf(low), low, high)
            # A flight that leaves within the limits has a state that is not a number.
            self.left_with[flight] = states[row, step] if within[row, step] else extreme
        return has_left

    def _distance(self, ends: np.ndarray) -> np.ndarray:
        """Return the largest distance of each flight from its end, (N,), inf if it is not known.

        The distance is that of the farthest linear state, in half-widths of the ball.

        ends: lowest and highest states, (2, N, k)
        """
        centre = self.middles[self.owners]
        farthest = np.maximum(ends[1] - centre, centre - ends[0]) / self._balls
        return np.nan_to_num(farthest.max(axis=1), nan=np.inf)

    def outcomes(self, owner: int) -> Outcomes:
        """Return the outcomes of the flights about one trim.

        owner: index of the trim
        """
        case = self.cases[owner]
        flights = np.flatnonzero(self.owners == owner)
        ends = self.ends[flights]
        departed = flights[ends == FlightOutcome.LEFT]
        # The worst flight is the first to leave, or without one the farthest in its last window.
        first_departure = None
        worst = int(flights[np.argmax(self.nearest[flights])])
        if departed.size:
            worst = int(departed[np.argmin(self.left_at[departed])])
            first_departure = self._departure(worst, case)
        at_start = self.first[worst][self.linear]
        return Outcomes(
            starts=len(flights),
            converged=int((ends == FlightOutcome.CONVERGED).sum()),
            end=dict(zip(case.point.model.linear, self.middles[owner].tolist(), strict=True)),
            left_envelope=len(departed),
            worst_initial=dict(zip(case.point.model.linear, at_start.tolist(), strict=True)),
            seconds=self.seconds,
            departure=first_departure,
        )

    def _departure(self, number: int, case: TrimCase) -> Departure | None:
        """Return the departure of a flight that left the envelope, with its state and limit."""
        times = self.flight.dt * self.left_at[[number]]
        states = self.left_with[[number]]
        envelope = flight_envelope(case.point.model, case.point)
        return departure(envelope, times, states)


class CaseOutcomes(NamedTuple):
    """Flights about one trim: outcomes without and with a disturbance pulse, and cost.

    box: fraction of the initial-condition box of the flights, below 1 if the exact gain leaves the
        envelope from the whole one
    costs: cost of those without a pulse beside the exact gain's, or None without an exact gain
    """

    plain: Outcomes
    disturbed: Outcomes
    box: float = 1.0
    costs: CostRatio | None = None


class ExactFlights(NamedTuple):
    """Flights of the exact gain about one trim; by default none.

    price: cost of the samples of flights of the policy, or None
    costs: cost of each flight from its own initial conditions, (N,), inf if it leaves
    box: fraction of the box from which none leaves, or 1.0
    """

    price: SampleCost | None = None
    costs: np.ndarray = np.empty(0)
    box: float = 1.0


#: Fractions of the box of initial conditions, of which the largest is found that holds.
_FRACTIONS = np.arange(1, 101) / 100.0


def exact_flights(
    flight: SampledFlight, case: TrimCase, samples: int, seed: int, shrinks: bool
) -> ExactFlights:
    """Return the flights of the exact gain, from the largest box from which none leaves.

    shrinks: whether the box may be smaller than that of the case

    Raises NoSolutionError or BadInputError without an exact gain.
    """
    price = SampleCost(flight.deployed, case.point, flight)
    exact = Deployed(price.exact(), flight.deployed.model)
    layout = SampledFlight(exact, flight.dt, 0.0, flight.steps_per_sample)
    own = SampleCost(flight.deployed, case.point, layout)

    def flown(fraction: float) -> np.ndarray:
        """Return the costs of the flights from a fraction of the box."""
        shrunk = replace(case, box=fraction * case.box)
        starts, pulses = seeded_starts(shrunk, samples, seed, with_pulse=False)
        owners = np.zeros(samples, dtype=int)
        flights = CaseFlights(layout, [shrunk], owners, starts, pulses, [own])
        flights.fly(None)
        return flights.costs

    costs, box = flown(1.0), 1.0
    if shrinks and np.isinf(costs).any():
        # Bisection on the number of fractions from which no flight leaves.
        least, most = 0, len(_FRACTIONS) - 1
        while least < most:
            middle = (least + most + 1) // 2
            holds = np.isfinite(flown(_FRACTIONS[middle - 1])).all()
            least, most = (middle, most) if holds else (least, middle - 1)
        if least:
            box = float(_FRACTIONS[least - 1])
            costs = flown(box)
    return ExactFlights(price, costs, box)


def fly_cases(
    flight: SampledFlight,
    cases: list[TrimCase],
    exact: Sequence[ExactFlights],
    samples: int,
    seed: int,
    progress: Progress | None,
) -> list[CaseOutcomes]:
    """Return the outcomes of flights about each trim, without and with a disturbance pulse.

    exact: flights of the exact gain about each trim
    samples: number of initial conditions at each trim
    """
    cases = [replace(case, box=of.box * case.box) for case, of in zip(cases, exact, strict=True)]
    drawn = [
        seeded_starts(case, samples, seed, with_pulse)
        for with_pulse in (False, True)
        for case in cases
    ]
    starts, pulses = map(np.vstack, zip(*drawn, strict=True))
    owners = np.repeat(np.arange(2 * len(cases)), samples)
    # All trims without a pulse, then all with one.
    prices = [*(of.price for of in exact), *[None] * len(cases)]
    flown = CaseFlights(flight, cases + cases, owners, starts, pulses, prices, seed)
    flown.fly(progress)
    found = []
    for owner, of in enumerate(exact):
        plain, disturbed = flown.outcomes(owner), flown.outcomes(owner + len(cases))
        costs = None
        if of.price is not None:
            costs = cost_ratio(flown.costs[owners == owner], of.costs, flown.seconds)
        found.append(CaseOutcomes(plain, disturbed, of.box, costs))
    return found
