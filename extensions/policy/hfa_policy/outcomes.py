"""Outcomes of flights from a box of initial conditions."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from hfa_aircraft.limits import Limits
from hfa_flight.envelope import Departure, departure, flight_envelope
from hfa_flight.history import Deviations
from hfa_flight.limit_cycle import LimitCycle, limit_cycle
from hfa_flight.policies.deployment.equilibrium import Equilibrium, EquilibriumSearch, whole_turns
from hfa_policy.flights import SampledFlight, Window, in_threads
from hfa_policy.reach import HORIZON, Reach
from hfa_support.errors import BadInputError
from hfa_support.native.bound import RowFunction
from hfa_support.progress import Progress
from hfa_support.reporting.results import Result, stored_as
from hfa_support.reporting.text import short_number, shown_unit
from trim.point.operating_point import OperatingPoint


def departure_text(left: Departure) -> str:
    """Return a departure as text, such as "altitude below 0 ft at 0.02 s"."""
    when = f"at {left.time:.4g} s"
    if not math.isfinite(left.value):
        return f"{left.state} is not a number {when}"
    suffix = "" if left.unit == "1" else f" {shown_unit(left.unit)}"
    side = "below" if left.value < left.limit else "above"
    limit = f"{short_number(left.limit, left.unit)}{suffix}" + " (assumed)" * left.assumed
    return f"{left.state} {side} {limit} {when}"


def departure_at(envelope: Limits, states: np.ndarray, time: float) -> str:
    """Return the departure of a flight as text: the violated limit of a state, and the time.

    states: (n,), states outside the envelope
    time: s
    """
    left = departure(envelope, np.array([time]), states[None], False)
    assert left is not None
    return departure_text(left)


def first_departure(
    flight: SampledFlight, rows: np.ndarray, envelope: Limits, seconds: float, pushed: float
) -> tuple[int, Departure | None]:
    """Return the index and the departure of the flight that leaves the envelope first.

    The result is (0, None) if all flights stay inside.

    rows: initial rows of the flights (`flights.py`)
    seconds: duration of the flights, s
    pushed: end of the disturbance pulse, s
    """
    X, *_, push, _ = flight.slices
    advance = RowFunction(flight.sample())
    moving = rows.copy()
    for number in range(round(seconds / flight.dt) + 1):
        left = ~envelope.within(moving[:, X]).all(axis=1)
        if left.any():
            first = int(np.argmax(left))
            times = np.array([number * flight.dt])
            return first, departure(envelope, times, moving[first, X][None], False)
        if number == round(pushed / flight.dt):
            moving[:, push] = 0.0
        moving = advance(moving)[0]
    return 0, None


def refuse_edges(points: Sequence[OperatingPoint]) -> None:
    """Raise BadInputError for a trim at the edge of the envelope.

    At such a trim, a state whose rate depends on other linear states is at its limit. Flights with
    small deviations from such a trim leave the envelope immediately.
    """
    for point in points:
        model = point.model
        envelope = flight_envelope(model, point)
        values = np.array(point.states)
        at_lowest = envelope.at_lowest(values)
        edges = np.flatnonzero(at_lowest | envelope.at_highest(values)).tolist()
        if not edges:
            continue
        A = model.at(point.states, point.inputs).A
        linear = [list(model.states).index(name) for name in model.linear]
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


#: Half-widths of the ball within which a flight has converged, in half-widths of the
#: initial-condition box.
BALL = 0.05
#: Duration of the disturbance pulse, s, and the distance by which it alone would move a state, in
#: half-widths of the box.
PUSHED = 1.0
PUSH = 0.5
#: Duration of the flight in which a limit cycle is measured, s.
_CYCLE_SECONDS = 20.0
_FLYING, _RETURNED, _LOST, _ENDED = range(4)
#: Outcomes of a flight, in words.
LEAVES = "leaves the envelope"
DOES_NOT_CONVERGE = "does not converge"
CONVERGES = "converges"
# A flight ends early when its outcome is known. This is a measured rule, not a proof. Of 26,000
# flights of 5 policies, with 0 to 5 samples of delay, each had the outcome of its full duration.
# With a limit cycle tolerance (`_SAME`) of 0.05, 24 of 19,200 did not, because of slow decay or
# growth.
#: A flight has settled if no state changes more in a window, relative to its nominal value.
_STILL = 1e-9
#: A flight is at another equilibrium if, in this number of consecutive windows, its range is at
#: most the second value times its distance. The distance must exceed the third value, in balls.
_STANDING = 10
_STANDS = 1e-3
_ELSEWHERE = 2.0
#: A flight is in a limit cycle if a state satisfies two conditions over three blocks of windows.
#: Its least half range in a block is at least the second value, in balls. It is equal in all blocks
#: to within the third value, and neither only rises nor only falls.
_BLOCK = 5
_CYCLES = 3.0
_SAME = 0.002
#: A flight about an unstable equilibrium has converged, and chatters in the ball, only if it grew
#: by less than this factor in its last `_GROWTH_WINDOWS` windows.
_GROWN = 1.02
_GROWTH_WINDOWS = 10
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
    equilibrium: the equilibrium, or None if it does not exist.
    stable: whether the loop is stable at the equilibrium.
    reach: modes within reach of the policy, or None without an equilibrium.
    seconds: duration of a flight, s.
    swing: half a period of the slowest lightly damped oscillation about the equilibrium, s. It is 0
        without such an oscillation, or if a linear state does not count.
    drift: (k, n), slopes of the equilibrium with respect to the states outside the linear model, or
        None without an equilibrium.
    lag: (k,), lag of the linear states behind the equilibrium, or None without an equilibrium.
    steady: trim at which the linear states have the same rates as at the equilibrium, or None for
        `point`.
    turns: (k,), full turn of each angle that the loop does not distinguish from none, otherwise 0.
        () means that there is none.
    """

    point: OperatingPoint
    box: np.ndarray
    equilibrium: Equilibrium | None
    stable: bool
    reach: Reach | None = None
    seconds: float = HORIZON
    swing: float = 0.0
    drift: np.ndarray | None = None
    lag: np.ndarray | None = None
    steady: OperatingPoint | None = None
    turns: np.ndarray = field(default_factory=lambda: np.zeros(0))

    @property
    def decisive(self) -> np.ndarray:
        """Mask (k,) of the linear states that decide whether a flight converges."""
        return np.ones(len(self.box), dtype=bool) if self.reach is None else self.reach.decisive

    @property
    def stays(self) -> bool:
        """True if the loop is stable and no mode out of reach diverges."""
        own = () if self.reach is None else self.reach.own
        return self.stable and all(mode.growth <= 0.0 for mode in own)


@dataclass(frozen=True)
class Outcome(Result):
    """Outcomes of the flights about one trim.

    starts: number of flights.
    returned: number of flights that converged. Such a flight is within the ball about the
        equilibrium at the end, or earlier for half a period of the slowest oscillation and two
        windows. If a mode diverges, only the end counts. If the loop is unstable, the distance must
        also not grow before the end.
    lost: number of flights that left the limits of the model's states.
    worst_start: linear state -> initial value of the worst flight.
    worst_outcome: outcome of the worst flight: "leaves the envelope", "does not converge" or
        "converges".
    slowest: longest time of convergence, s, or 0 if no flight converges.
    cycle: limit cycle of a flight that does not converge, or about an unstable equilibrium, or
        None.
    elsewhere: number of flights that converge to another equilibrium.
    elsewhere_at: linear state -> value at the first other equilibrium, or empty if there is none.
    moving: number of flights that neither converge to an equilibrium nor leave the limits.
    seconds: duration of a flight, s.
    departure: departure of the flight that leaves the envelope first, or None if no flight leaves.
    """

    starts: int = field(metadata=stored_as("flights"))
    returned: int = field(metadata=stored_as("converged"))
    lost: int = field(metadata=stored_as("left_envelope"))
    worst_start: dict[str, float] = field(metadata=stored_as("worst_initial"))
    worst_outcome: str
    slowest: float = field(metadata=stored_as("slowest_convergence"))
    cycle: LimitCycle | None = field(metadata=stored_as("limit_cycle"))
    elsewhere: int = field(metadata=stored_as("converged_elsewhere"))
    elsewhere_at: dict[str, float] = field(metadata=stored_as("other_equilibrium"))
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
    rows = [list(model.states).index(name) for name in model.linear]
    starts = np.tile(np.array(place.point.states, dtype=float), (count, 1))
    starts[:, rows] += share * place.box
    pushes = directions * place.box * PUSH / PUSHED if pushed else np.zeros_like(share)
    return starts, pushes


class SimulatedRows:
    """Simulation of flights at several places.

    A flight ends if it converges, leaves the envelope, is in a limit cycle, or remains at another
    equilibrium, or if its duration has elapsed.

    rows: initial rows of the flights (`flights.py`).
    owners: index of each flight's place, (N,).
    """

    def __init__(
        self, flight: SampledFlight, places: list[Place], rows: np.ndarray, owners: np.ndarray
    ) -> None:
        model = flight.deployed.model
        self.flight = flight
        self.rows = rows
        self.first = rows.copy()
        self.status = np.full(len(rows), _FLYING)
        self.times = np.zeros(len(rows))
        self.linear = [list(model.states).index(name) for name in model.linear]
        self.owners = owners
        envelopes = [flight_envelope(model, place.point) for place in places]
        self.least = np.array([envelope.least for envelope in envelopes])[owners]
        self.most = np.array([envelope.most for envelope in envelopes])[owners]
        nowhere = np.full(len(model.linear), np.nan)
        centres = [
            nowhere if place.equilibrium is None else place.equilibrium.states[self.linear]
            for place in places
        ]
        lags = [np.zeros(len(nowhere)) if place.lag is None else place.lag for place in places]
        self.centres = (np.array(centres) + np.array(lags))[owners]
        self.trims = np.array([place.point.states for place in places], dtype=float)[owners]
        still = np.zeros((len(model.linear), len(model.states)))
        drifts = [still if place.drift is None else place.drift for place in places]
        self.drifts = np.array(drifts)[owners]
        none = np.zeros(len(nowhere))
        self.turns = np.array([p.turns if p.turns.size else none for p in places])[owners]
        self.balls = np.array([BALL * place.box for place in places])[owners]
        self.stable = np.array([place.stable for place in places])[owners]
        self.stays = np.array([place.stays for place in places])[owners]
        self.decisive = np.array([place.decisive for place in places])[owners]
        window = flight.samples_in_window * flight.dt
        enough = [2 + math.ceil(place.swing / window - 1e-9) for place in places]
        self.enough = np.array(enough)[owners]
        self.in_ball = np.zeros(len(rows), dtype=int)
        self.nearest = np.full(len(rows), np.inf)
        self.earlier = np.full(len(rows), np.inf)
        self.standing = np.zeros(len(rows), dtype=int)
        self.seconds = HORIZON
        shape = (3, len(rows), len(model.linear))
        self.swings_of_blocks = np.full(shape, np.inf)

    def fly(self, seconds: float, window: Window, progress: Progress | None = None) -> None:
        """Simulate all flights, each until it ends or `seconds` have elapsed.

        seconds: s
        window: function that advances the rows of flights by a window
        """
        self.seconds = seconds
        count = len(self.rows)
        windows = max(1, round(seconds / (self.flight.samples_in_window * self.flight.dt)))

        def work(numbers: np.ndarray) -> None:
            flying = numbers
            for number in range(windows):
                flying = flying[self.status[flying] == _FLYING]
                if not flying.size:
                    break
                if number == windows - _GROWTH_WINDOWS:
                    self.earlier[flying] = self.nearest[flying]
                self._window(window, flying, number)
                if progress is not None and numbers[0] == 0:
                    progress(number + 1, windows)

        in_threads(work, count)
        if progress is not None:
            progress(windows, windows)
        self.status[self.status == _ENDED] = _FLYING
        left = self.status == _FLYING
        grows = self.nearest > _GROWN * self.earlier
        back = left & (self.nearest <= 1.0) & (self.stable | ~grows)
        self.status[back] = _RETURNED

    def _window(self, window: Window, flying: np.ndarray, number: int) -> None:
        """Simulate unfinished flights for one window, and mark the flights that end.

        flying: indices of the unfinished flights
        number: number of earlier windows
        """
        rows = self._advanced(window, flying, number)
        lost = ~self.flight.are_inside(rows, self.least[flying], self.most[flying])
        distance, swings = self._in_balls(rows, flying)
        back = self._back(flying, distance)
        ended = self._cycling(flying, swings, number) | self._standing(flying, distance, swings)
        self.nearest[flying] = distance
        self.status[flying[ended]] = _ENDED
        self.status[flying[back]] = _RETURNED
        self.status[flying[lost]] = _LOST

    def _advanced(self, window: Window, flying: np.ndarray, number: int) -> np.ndarray:
        """Advance flights by one window and return their rows (`flights.py`) at its end.

        The lowest and highest values in these rows are those within the window. The disturbance
        pulse ends at its time.

        flying: indices of the flights
        number: number of earlier windows
        """
        *_, push, _ = self.flight.slices
        rows = self.rows[flying]
        seconds = self.flight.samples_in_window * self.flight.dt
        self.flight.forget_extremes(rows)
        if number == round(PUSHED / seconds):
            rows[:, push] = 0.0
        rows = window(rows)
        self.rows[flying] = rows
        self.times[flying] = number * seconds + seconds
        return rows

    def _in_balls(self, rows: np.ndarray, flying: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return how far each flight was from its equilibrium in a window, and how much it moved.

        The distance (N,) is the largest in the window. The motion (N, k) is half the range of each
        linear state, or 0 for a state that does not count. Both are in half-widths of the ball in
        which a flight counts as converged.

        rows: rows of the flights after the window
        flying: indices of the flights
        """
        _, _, low_X, high_X, *_ = self.flight.slices
        lowest = rows[:, low_X][:, self.linear]
        highest = rows[:, high_X][:, self.linear]
        moved = rows[:, self.flight.slices[0]] - self.trims[flying]
        centre = self.centres[flying] + np.einsum("nij,nj->ni", self.drifts[flying], moved)
        centre += whole_turns((lowest + highest) / 2.0 - centre, self.turns[flying])
        farthest = np.maximum(highest - centre, centre - lowest) / self.balls[flying]
        decisive = self.decisive[flying]
        distance = np.nan_to_num(np.where(decisive, farthest, 0.0).max(axis=1), nan=np.inf)
        return distance, np.where(decisive, (highest - lowest) / 2.0 / self.balls[flying], 0.0)

    def _back(self, flying: np.ndarray, distance: np.ndarray) -> np.ndarray:
        """Return a mask of the flights that have converged.

        Such a flight has been in the ball about the equilibrium for `enough` windows, and is not
        farther from the equilibrium than in the window before. If a mode diverges, no flight has
        converged yet.

        flying: indices of the flights
        distance: largest distance from the equilibrium in the window, in half-widths of the ball,
            (N,)
        """
        self.in_ball[flying] = np.where(distance <= 1.0, self.in_ball[flying] + 1, 0)
        stays = self.in_ball[flying] >= self.enough[flying]
        return np.asarray(self.stays[flying] & stays & (distance <= self.nearest[flying]))

    def _standing(self, flying: np.ndarray, distance: np.ndarray, swings: np.ndarray) -> np.ndarray:
        """Return a mask of the flights that have settled at another equilibrium.

        Such a flight fulfills two conditions in each of the last `_STANDING` windows:

        - The distance is finite and more than `_ELSEWHERE`.
        - No swing exceeds `_STANDS` times the distance.

        The number of such windows in sequence is updated for each flight.

        flying: indices of the flights
        distance: (N,), result of `_in_balls`
        swings: (N, k), result of `_in_balls`
        """
        is_away = np.isfinite(distance) & (distance > _ELSEWHERE)
        stands = is_away & (swings.max(axis=1) <= _STANDS * distance)
        self.standing[flying] = np.where(stands, self.standing[flying] + 1, 0)
        return np.asarray(self.standing[flying] >= _STANDING)

    def _cycling(self, flying: np.ndarray, swings: np.ndarray, number: int) -> np.ndarray:
        """Return a mask of the flights in a limit cycle.

        The mask is False unless this window is the last of a block of `_BLOCK` windows. In such a
        window, the smallest half range of each state in each of the last three blocks is
        considered. A flight is in a limit cycle if these three values of a state fulfill all
        conditions:

        - Each value is at least `_CYCLES`.
        - The range of the values is at most `_SAME` times the smallest.
        - The values neither increase nor decrease in order.

        flying: indices of the flights
        swings: half ranges in this window, (N, k), as returned by `_in_balls`
        number: number of earlier windows
        """
        blocks = self.swings_of_blocks[:, flying]
        blocks[0] = np.minimum(blocks[0], swings)
        cycling = np.zeros(len(flying), dtype=bool)
        if (number + 1) % _BLOCK == 0:
            least = blocks.min(axis=0)
            most = blocks.max(axis=0)
            is_large = least >= _CYCLES
            is_same = most - least <= _SAME * least
            rises = (blocks[0] > blocks[1]) & (blocks[1] > blocks[2])
            falls = (blocks[0] < blocks[1]) & (blocks[1] < blocks[2])
            cycling = np.any(is_large & is_same & ~rises & ~falls, axis=1)
            blocks[1:] = blocks[:-1].copy()
            blocks[0] = np.inf
        self.swings_of_blocks[:, flying] = blocks
        return cycling

    def swings(self) -> np.ndarray:
        """Half the range of each linear state in the last window, (N, k).

        The value is 0 for a state that does not count.
        """
        _, _, low_X, high_X, *_ = self.flight.slices
        moved = (self.rows[:, high_X] - self.rows[:, low_X])[:, self.linear]
        return np.asarray(np.where(self.decisive, moved / 2.0, 0.0))

    def outcome(self, owner: int, place: Place) -> Outcome:
        """Return the outcomes of the flights about one trim.

        owner: index of the trim
        """
        model = place.point.model
        mine = np.flatnonzero(self.owners == owner)
        status = self.status[mine]
        lost = mine[status == _LOST]
        neither = mine[status == _FLYING]
        returned = mine[status == _RETURNED]
        worst, ends = self._worst(neither, returned)
        left = None
        if lost.size:
            worst, left = self._earliest_departure(lost, place)
            ends = LEAVES
        X = self.flight.slices[0]
        at_start = self.first[worst, X][self.linear]
        cycle = None
        settled = neither
        if neither.size:
            swings = (self.swings()[neither] / place.box).max(axis=1)
            settled = neither[swings <= _SETTLED]
            if settled.size < neither.size:
                swinging = int(neither[int(np.argmax(swings))])
                cycle = measured_cycle(self.flight, self.rows[swinging], place)
        elif returned.size and not place.stable:
            cycle = measured_cycle(self.flight, self.rows[returned[0]], place)
        elsewhere, elsewhere_at = self._other_equilibria(settled, place)
        return Outcome(
            starts=len(mine),
            returned=len(returned),
            lost=len(lost),
            worst_start=dict(zip(model.linear, at_start.tolist(), strict=True)),
            worst_outcome=ends,
            slowest=float(self.times[returned].max(initial=0.0)),
            cycle=cycle,
            elsewhere=elsewhere,
            elsewhere_at=elsewhere_at,
            moving=len(neither) - elsewhere,
            seconds=self.seconds,
            departure=left,
        )

    def _earliest_departure(self, lost: np.ndarray, place: Place) -> tuple[int, Departure | None]:
        """Return the index of the flight that leaves the envelope first, and its departure or None.

        lost: indices of the flights that leave the envelope
        """
        soonest = lost[self.times[lost] == self.times[lost].min()]
        envelope = flight_envelope(place.point.model, place.point)
        seconds = float(self.times[soonest[0]])
        first, left = first_departure(self.flight, self.first[soonest], envelope, seconds, PUSHED)
        return int(soonest[first]), left

    def _other_equilibria(self, settled: np.ndarray, place: Place) -> tuple[int, dict[str, float]]:
        """Return the number of flights at other equilibria, and one such equilibrium.

        The equilibrium is the first that is found, as linear state -> value, or {} if none is
        found. At most `_OTHERS` equilibria are searched.

        settled: indices of the flights that are almost steady
        """
        search = EquilibriumSearch(self.flight.deployed, place.point, place.steady)
        X, memory, *_ = self.flight.slices
        m = len(place.point.model.inputs)
        ball = BALL * place.box[place.decisive]
        count = 0
        first: dict[str, float] = {}
        for _ in range(_OTHERS):
            if not settled.size:
                break
            row = self.rows[settled[0]]
            other = search.from_point(row[X], row[memory][:m])
            here = self.rows[settled][:, X][:, self.linear][:, place.decisive]
            at = np.zeros(len(settled), dtype=bool)
            if other is not None and not _is_same(other, place, self.linear):
                there = other.states[self.linear]
                at = np.all(np.abs(here - there[place.decisive]) <= ball, axis=1)
            if at[0]:
                count += int(at.sum())
                first = first or dict(zip(place.point.model.linear, there.tolist(), strict=True))
            at[0] = True
            settled = settled[~at]
        return count, first

    def _worst(self, neither: np.ndarray, returned: np.ndarray) -> tuple[int, str]:
        """Return the index of the worst flight that stays inside the envelope, and its outcome.

        - `neither` is not empty: the flight of `neither` farthest from the equilibrium.
        - Only `returned` is not empty: the slowest flight of `returned`.
        - Both are empty: (0, "").

        neither: indices of the flights that neither converge nor leave the envelope
        returned: indices of the flights that converge
        """
        if neither.size:
            return int(neither[np.argmax(self.nearest[neither])]), DOES_NOT_CONVERGE
        if returned.size:
            return int(returned[np.argmax(self.times[returned])]), CONVERGES
        return 0, ""


def _is_same(other: Equilibrium, place: Place, linear: list[int]) -> bool:
    """Return whether an equilibrium coincides with the equilibrium of a place.

    The difference must be at most that of a flight that has converged.

    linear: indices of the linear states
    """
    if place.equilibrium is None:
        return False
    apart = (other.states - place.equilibrium.states)[linear]
    if place.turns.size:
        apart -= whole_turns(apart, place.turns)
    apart = np.abs(apart)
    return bool(np.all(apart[place.decisive] <= BALL * place.box[place.decisive]))


def measured_cycle(
    flight: SampledFlight, row: np.ndarray, place: Place, seconds: float = _CYCLE_SECONDS
) -> LimitCycle | None:
    """Return the limit cycle of a flight, or None if it has none or a state is not finite.

    row: initial row of the flight (`flights.py`)
    place: trim of the flight
    seconds: duration of the flight, at least 64 samples
    """
    model = place.point.model
    X, memory, *_ = flight.slices
    m = len(model.inputs)
    steps = max(64, round(seconds / flight.dt))
    path = flight.sample().mapaccum(steps)
    row = row.copy()
    states = np.array(path(row)).T
    states = np.vstack([row, states])
    if not np.isfinite(states[:, X]).all():
        return None
    inputs = states[:, memory][:, :m] - np.array(place.point.inputs)
    deviations = states[:, X] - np.array(place.point.states)
    times = flight.dt * np.arange(len(states))
    empty = np.zeros((len(times), 0))
    trace = Deviations(times, deviations, empty, inputs, empty, deviations, {})
    return limit_cycle(model, trace, 0.0)


def fly_places(
    flight: SampledFlight,
    places: list[Place],
    samples: int,
    seed: int = 0,
    progress: Progress | None = None,
) -> tuple[list[Outcome], list[Outcome]]:
    """Return the outcomes of flights about each trim, without and with a disturbance pulse.

    The results are two lists with an `Outcome` for each trim.

    samples: number of initial conditions at each trim
    """
    rows = []
    for pushed in (False, True):
        for place in places:
            starts, pushes = seeded_starts(place, samples, seed, pushed)
            trim = flight.deployed.trim_vector(place.point)
            rows.append(flight.rows(starts, np.tile(trim, (samples, 1)), pushes))
    flown_places = places + places
    owners = np.repeat(np.arange(len(flown_places)), samples)
    flown = SimulatedRows(flight, flown_places, np.vstack(rows), owners)
    seconds = max(place.seconds for place in places)
    flown.fly(seconds, flight.window(len(owners), seconds), progress)
    outcomes = [flown.outcome(owner, place) for owner, place in enumerate(flown_places)]
    return outcomes[: len(places)], outcomes[len(places) :]


def ends_from_trim(
    flight: SampledFlight, points: list[OperatingPoint], window: Window, seconds: float
) -> tuple[np.ndarray, np.ndarray]:
    """Simulate flights that begin at their trims, for at most `seconds`.

    Returns the final X (N, n) and the final acting inputs (N, m). All flights end early if no state
    of any flight changes by more than `_STILL` of its nominal value from the start to the end of a
    window.
    """
    model = points[0].model
    still = _STILL * np.array([model.signals[name].nominal for name in model.states])
    trims = np.array([flight.deployed.trim_vector(point) for point in points])
    n = len(model.states)
    m = len(model.inputs)
    pushes = np.zeros((len(points), len(model.linear)))
    rows = flight.rows(trims[:, :n], trims, pushes)
    X, memory, *_ = flight.slices
    for _ in range(max(1, round(seconds / (flight.samples_in_window * flight.dt)))):
        before = rows
        rows = window(before)
        if (np.abs(rows[:, X] - before[:, X]) <= still).all():
            break
    return rows[:, X], rows[:, memory][:, :m]
