"""Simulation of many episodes of an aircraft at once."""

from __future__ import annotations

import math
import os
from collections.abc import Callable, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace
from typing import Any, NamedTuple

import casadi as ca
import numpy as np

from hfa_aircraft.limits import Limits
from hfa_aircraft.march.ending import all_finite, is_within
from hfa_aircraft.march.march import saturated
from hfa_aircraft.model import Model
from hfa_flight.air.held_step import parts_of_a_sample
from hfa_flight.air.turbulence import AirFilter, Turbulence
from hfa_flight.judge.outcomes import refuse_edges
from hfa_flight.judge.weights import cost_rate, cost_weights
from hfa_flight.learn.start_boxes import surviving_boxes
from hfa_flight.plan.initial_box import start_box
from hfa_flight.policies.deployment.deployed import Deployed
from hfa_flight.policies.deployment.deployment import Deployment
from hfa_flight.simulate.envelope import departure, flight_envelope
from hfa_flight.simulate.sampled_flights import SampledFlight
from hfa_support.errors import (
    BadInputError,
    is_finite,
    pair_of,
    refuse_unknown,
    shown,
)
from hfa_support.native.bound import RowFunction
from hfa_support.native.row_code import RowCode, row_code
from trim.point.operating_point import OperatingPoint

#: From this number of episodes on, several threads are faster.
_MANY = 500
#: Cost of a sample whose cost is not a finite number.
_DEAREST = 1e6
#: Default duration of an episode, s.
SECONDS = 20.0


class Stepped(NamedTuple):
    """Results of one sample in N episodes.

    observations: (N, k), of all samples of the history, the oldest first.
    rewards: (N,), negative cost of the sample.
    lost: (N,), True if the aircraft is outside its limits, or if a command or the next state is not
        a number.
    over: (N,), True if the duration of the episode has elapsed.
    left: index of a lost episode -> text with the reason and the time.
    """

    observations: np.ndarray
    rewards: np.ndarray
    lost: np.ndarray
    over: np.ndarray
    left: dict[int, str]


class Episodes:
    """N episodes of a deployment on its aircraft, each about one of several trims.

    The reward of a sample is -dt (x'Q x + u'R u). x are the deviations of states and outputs from
    the trim at the sample, and u the inputs commanded at the sample minus the trim, also if they
    act later because of a delay. Q and R are those of `cost_weights`. If an episode leaves the
    limits, the cost of that sample is also counted for each remaining sample.

    states: (N, n), X of each episode.
    inputs: (N, m), the input just before the sample.
    parameters: (N, p), parameters of the aircraft of each episode.
    frames: (N, k), observations of all samples of the history, the oldest first.
    outcomes: (N, 3), of the last sample: reward, 1.0 if the aircraft left its limits, and 1.0 if
        the duration of the episode has elapsed.

    Each sample overwrites these arrays in place.
    """

    def __init__(
        self,
        deployed: Deployed,
        points: Sequence[OperatingPoint],
        count: int,
        seconds: float = SECONDS,
        turbulence: Turbulence | None = None,
        vary: Mapping[str, tuple[float, float]] | None = None,
    ) -> None:
        """Prepare `count` episodes of at most `seconds` about the trims `points`.

        turbulence: drawn again for each episode
        vary: parameter -> (lowest, highest), between which it is drawn for each episode. The trims
            remain those of the unchanged aircraft

        Raises BadInputError in these cases:
        - `points` is empty.
        - An action has no box.
        - `seconds` is shorter than a sample or not finite.
        - A trim is at the limit of a state.
        - An observation or a map is not finite at a trim.
        - The aircraft does not support the turbulence.
        - A varied parameter is unknown, or its range is outside its limits.
        """
        self.varied = _ranges(deployed.model, vary or {})
        deployed = replace(deployed, varies=bool(self.varied))
        if not points:
            raise BadInputError("no trim is given; give at least one operating point")
        if not (is_finite(seconds) and seconds >= deployed.deployment.dt):
            raise BadInputError(
                f"the duration of an episode is {shown(seconds)} s; give at least the sample time, "
                f"{deployed.deployment.dt:g} s"
            )
        self.deployed = deployed
        self.points = tuple(points)
        self.low, self.high = _box_of(deployed)
        refuse_edges(points)
        middle_of_box = 0.5 * self.low + 0.5 * self.high
        deployed.refuse_undefined_at(points, middle_of_box)
        self.samples = round(seconds / deployed.deployment.dt)
        self._air = None
        if turbulence is not None:
            self._air = EpisodeAir(turbulence, points, count, deployed.deployment.dt)
        self._boxes = np.array([start_box(deployed.model, point) for point in points])
        self._flight = SampledFlight(
            deployed,
            deployed.deployment.dt,
            deployed.deployment.delay,
            parts_of_a_sample(self.points, deployed.deployment.dt, [*self._boxes]),
            commands_of=_moved_by_actions(deployed, self.low, self.high),
            winds=() if self._air is None else self._air.names,
        )
        nothing = np.clip(np.zeros(len(self.low)), self.low, self.high)
        self._boxes = surviving_boxes(self._flight, self.points, self._boxes, nothing)
        self._envelopes = [flight_envelope(deployed.model, point) for point in points]
        self._trims = np.array([deployed.trim_vector(point) for point in points])
        self._linear = deployed.model.state_places(deployed.model.linear)
        self.owners = np.zeros(count, dtype=int)
        self._allocate(count)
        self._observe = row_code(self._observation())
        self._observed = np.zeros((count, deployed.observe.numel_out(0)))
        self._has_past = deployed.past > 0
        self.frames = self._observed
        if self._has_past:
            self.frames = np.zeros((count, deployed.deployment.width))
        self.outcomes = np.zeros((count, 3))
        self._fly = self._compiled()

    def _allocate(self, count: int) -> None:
        """Allocate a row of states and of held values for each episode, and name their parts."""
        # A row of the states contains state, memory, extremes, and the number of remaining samples.
        # A row of the held values contains actions, trim, push, and the limits of the state. The
        # trim ends with the parameters, the memory with the inputs, and the push with the winds.
        flight = self._flight
        model = self.deployed.model
        n, m = len(model.states), len(model.inputs)
        X, memory, *_ = flight.slices
        actions, trim, push = flight.held_slices
        self._state = np.zeros((count, sum(flight.sizes) + 1))
        self._held = np.zeros((count, push.stop + 2 * n))
        self.states = self._state[:, X]
        self.inputs = self._state[:, memory.stop - m : memory.stop]
        self._remaining = self._state[:, -1]
        self._actions = self._held[:, actions]
        self.parameters = self._held[:, trim][:, n + m :]
        self._winds = self._held[:, push.stop - len(flight.winds) : push.stop]
        names = list(model.parameters)
        self._places_of_varied = [n + m + names.index(name) for name in self.varied]

    @property
    def deployment(self) -> Deployment:
        """The deployment with the weights of the reward as its cost."""
        Q, R = cost_weights(self.deployed)
        return self.deployed.deployment.changed(cost={"Q": dict(Q), "R": dict(R)})

    def start_box(self, number: int) -> dict[str, float]:
        """Return linear state -> half-width of the initial conditions about a trim.

        number: index of the trim
        """
        return dict(zip(self.deployed.model.linear, self._boxes[number].tolist(), strict=True))

    @property
    def done(self) -> np.ndarray:
        """Number of elapsed samples of each episode, (N,)."""
        return self.samples - self._remaining.astype(int)

    def begin(self, numbers: np.ndarray, random: np.random.Generator) -> np.ndarray:
        """Restart episodes from random initial conditions about random trims.

        Returns the observations, (len(numbers), k).

        numbers: indices of the episodes
        """
        owners = random.integers(len(self.points), size=len(numbers))
        share = random.uniform(-1.0, 1.0, (len(numbers), len(self._linear)))
        trims = self._trims[owners]
        starts = trims[:, : len(self.deployed.model.states)].copy()
        starts[:, self._linear] += share * self._boxes[owners]
        return self.begin_at(numbers, owners, starts, random)

    def begin_at(
        self,
        numbers: np.ndarray,
        owners: np.ndarray,
        starts: np.ndarray,
        random: np.random.Generator | None = None,
    ) -> np.ndarray:
        """Restart episodes from given initial states.

        Earlier observations equal the first. Returns the observations, (N, k).

        numbers: (N,), indices of the episodes
        owners: (N,), index of each episode's trim
        starts: (N, n), initial states
        random: draws the turbulence and the varied parameters, or None to continue the turbulence
            with the parameters of the model
        """
        count = len(numbers)
        trims = self._trims[owners]
        if self._air is not None and random is not None and count == len(self.owners):
            self._air.seed(int(random.integers(2**63)))
        if random is not None and self.varied:
            lowest, highest = np.array(list(self.varied.values())).T
            trims[:, self._places_of_varied] = random.uniform(lowest, highest, (count, len(lowest)))
        if self._air is not None:
            self._air.begin(numbers, owners)
        actions, _, push = self._flight.held_sizes
        begun = self._flight.start(starts, trims)
        self._state[numbers] = np.column_stack([begun, np.full(count, self.samples)])
        within = [self._envelopes[owner] for owner in owners]
        least = np.array([envelope.least for envelope in within])
        most = np.array([envelope.most for envelope in within])
        nothing = np.zeros((count, actions)), np.zeros((count, push))
        self._held[numbers] = np.hstack([nothing[0], trims, nothing[1], least, most])
        self.owners[numbers] = owners
        first = np.asarray(self._observe(begun, trims)[0])
        self.frames[numbers] = np.tile(first, (1, self.deployed.deployment.history))
        return self.frames[numbers]

    def step(self, actions: np.ndarray) -> Stepped:
        """Advance all episodes by one sample and return the results.

        actions: (N, m), clipped to the box

        Raises BadInputError if the actions have another shape or contain NaN.
        """
        self.advance(actions)
        rewards, lost, over = self.outcomes.T.copy()
        left = {each: self.left(each) for each in np.flatnonzero(lost).tolist()}
        return Stepped(self.frames.copy(), rewards, lost > 0.0, over > 0.0, left)

    def advance(self, actions: np.ndarray) -> None:
        """Advance all episodes by one sample.

        actions: (N, m), clipped to the box

        Raises BadInputError if the actions have another shape or contain NaN.
        """
        wanted = self._actions.shape
        if actions.shape != wanted or _has_nan(actions):
            raise BadInputError(
                f"the actions are {shown(actions.tolist())}; give {wanted[0]} x {wanted[1]} "
                "numbers without NaN (episodes x actions)"
            )
        self._actions[:] = actions
        if self._air is not None:
            self._winds[:] = self._air.step()
        self._fly()
        if self._has_past:
            newest = self._observed.shape[1]
            self.frames[:, :-newest] = self.frames[:, newest:]
            self.frames[:, -newest:] = self._observed

    def left(self, number: int) -> str:
        """Return the reason and the time at which an episode was terminated, as text.

        The reason is the violated limit or the value that is not a number.

        number: index of the episode
        """
        time = float(self.done[number] * self.deployed.deployment.dt)
        envelope = self._envelopes[self.owners[number]]
        lowest, highest = self._flight.extremes(self._flight_of(number))
        beyond = np.where(lowest < envelope.least, lowest, highest)
        if not envelope.within(beyond).all():
            return _departure_at(envelope, beyond, time)
        after = self._next_states(number)
        if np.isfinite(after).all():
            return f"the command is not a number at {time:.4g} s"
        return _departure_at(envelope, after, time)

    def _next_states(self, number: int) -> np.ndarray:
        """Return the states after a further sample of an episode, (n,), which may be no numbers.

        An episode keeps its states if the next are no numbers, so these are computed again.
        """
        held = self._held[number, : sum(self._flight.held_sizes)]
        after = np.array(self._flight.tick()(self._flight_of(number), held)).ravel()
        return after[: self.states.shape[1]]

    def _flight_of(self, number: int) -> np.ndarray:
        """Return the row of an episode without the number of remaining samples."""
        return self._state[number, :-1]

    def _compiled(self) -> Callable[[], Any]:
        """Return a function that advances all episodes by one sample, in place."""
        count = len(self.owners)
        code = row_code(self._sample(), one_row=count == 1)
        tables = (self._state, self._held, self.outcomes, self._observed)
        parts = 1 if count < _MANY else os.cpu_count() or 1
        split = zip(*(np.array_split(table, parts) for table in tables), strict=True)
        bound = [
            _bound(code, (state, held), (state, outcomes, observed))
            for state, held, outcomes, observed in split
        ]
        if parts == 1:
            return bound[0]
        threads = ThreadPoolExecutor(parts)
        return lambda: list(threads.map(lambda fly: fly(), bound))

    def _sample(self) -> ca.Function:
        """Return the CasADi Function that advances one episode by a sample."""
        flight = self._flight
        flown, of_flight = sum(flight.sizes), sum(flight.held_sizes)
        n, m = len(flight.deployed.model.states), len(flight.deployed.model.inputs)
        state = ca.MX.sym("state", flown + 1)
        held = ca.MX.sym("held", of_flight + 2 * n)
        now, left = ca.vertsplit(state, [0, flown, flown + 1])
        flying, limits = ca.vertsplit(held, [0, of_flight, of_flight + 2 * n])
        actions, trim, _ = (flying[part] for part in flight.held_slices)
        memory = flight.slices[1]
        inputs = slice(memory.stop - m, memory.stop)
        X, before = now[:n], now[inputs]
        assert flight.commands_of is not None  # set by the constructor
        U = flight.commands_of(actions, X, before, trim)
        cost = flight.dt * cost_rate(self.deployed)(X, U, trim)
        after = flight.tick()(now, flying)
        kept, left, outcome = _outcome(flown, n)(now, after, cost, left, limits)
        o = self.deployed.observe(kept[:n], kept[inputs], trim)
        return ca.Function("episode", [state, held], [ca.vertcat(kept, left), outcome, o])

    def _observation(self) -> ca.Function:
        """Return the CasADi Function (state of a flight, trim) -> observations."""
        n, m = len(self.deployed.model.states), len(self.deployed.model.inputs)
        state = ca.MX.sym("state", sum(self._flight.sizes))
        trim = ca.MX.sym("trim", self._flight.held_sizes[1])
        end = self._flight.slices[1].stop
        seen = self.deployed.observe(state[:n], state[end - m : end], trim)
        return ca.Function("observation", [state, trim], [seen])


def _ranges(
    model: Model, vary: Mapping[str, tuple[float, float]]
) -> dict[str, tuple[float, float]]:
    """Return parameter -> (lowest, highest) of its draws."""
    ranges = {}
    for name, ends in vary.items():
        refuse_unknown("vary names the unknown parameter", name, tuple(model.parameters))
        lowest, highest = pair_of(f"vary[{name!r}]", ends)
        if not -math.inf < lowest <= highest < math.inf:
            raise BadInputError(
                f"vary[{name!r}] is {shown(ends)}; give (lowest, highest), two finite numbers in "
                "ascending order"
            )
        for value in (lowest, highest):
            model.with_parameters(**{name: value})
        ranges[name] = (lowest, highest)
    return ranges


def _departure_at(envelope: Limits, states: np.ndarray, time: float) -> str:
    """Return which limit is violated by states (n,) outside the envelope, and when."""
    left = departure(envelope, np.array([time]), states[None], moving_air=False)
    assert left is not None  # the states are outside
    return left.cause()


def _has_nan(actions: np.ndarray) -> bool:
    """Return whether actions (N, m) contain NaN."""
    if len(actions) == 1:
        return any(map(math.isnan, actions[0].tolist()))
    # The sum of squares is nan if any action is nan.
    return math.isnan(np.vdot(actions, actions))


def _outcome(size: int, n: int) -> ca.Function:
    """Return the function (before, after, cost, left, limits) -> (kept state, left, outcome)."""
    # - before, after: state before and after the sample
    # - cost: cost of the sample, replaced by `_DEAREST` if not finite
    # - left: number of remaining samples, before including and after excluding this one
    # - limits: lowest X and highest X, for the extremes at the end of a state
    # - accepted state: `after` if all its entries are finite, else `before`
    # - outcome: reward, whether the aircraft left the limits, whether no samples remain
    # An entry of `after` that is not finite counts as leaving the limits. The reward is -cost. If
    # the aircraft leaves the limits, the cost of the sample is also counted for each later sample.
    before, after = ca.SX.sym("before", size), ca.SX.sym("after", size)
    cost, left = ca.SX.sym("cost"), ca.SX.sym("left")
    limits = ca.SX.sym("limits", 2 * n)
    numbers = all_finite(after)
    kept = ca.if_else(numbers, after, before)
    lowest, highest = kept[size - 2 * n : size - n], kept[size - n :]
    inside = (is_within(each, limits[:n], limits[n:]) for each in (lowest, highest))
    lost = ca.logic_not(ca.logic_and(numbers, ca.logic_and(*inside)))
    later = ca.fmax(left - 1.0, 0.0)
    paid = ca.if_else(all_finite(cost), cost, _DEAREST)
    reward = -paid * ca.if_else(lost, 1.0 + later, 1.0)
    outcome = ca.vertcat(reward, lost, later <= 0.0)
    return ca.Function("outcome", [before, after, cost, left, limits], [kept, later, outcome])


class EpisodeAir:
    """Turbulence of N episodes, each about one of several trims.

    The turbulence is exact at the samples. During a sample, each disturbance is constant and equals
    the mean of its values at both ends.
    """

    def __init__(
        self, turbulence: Turbulence, points: Sequence[OperatingPoint], count: int, dt: float
    ) -> None:
        """Prepare the turbulence.

        Raises BadInputError if the aircraft or the trim does not support the turbulence.

        count: number of episodes
        dt: sample time, s
        """
        airs = [turbulence.air(point, dt, 1, 0) for point in points]
        filters = [AirFilter.of(air) for air in airs]
        self.names = airs[0].names
        steps = [each.step for each in filters]
        self._transitions = np.array([transition for transition, _ in steps])
        self._noise_gains = np.array([noise_gain for _, noise_gain in steps])
        self._winds_of_states = np.array(
            [air.factors.T @ each.C for air, each in zip(airs, filters, strict=True)]
        )
        self._states = np.zeros((count, self._transitions.shape[1]))
        self._owners = np.zeros(count, dtype=int)
        self._random = np.random.default_rng()

    def seed(self, seed: int) -> None:
        """Set the seed of all later draws."""
        self._random = np.random.default_rng(seed)

    def begin(self, numbers: np.ndarray, owners: np.ndarray) -> None:
        """Begin episodes in calm air.

        numbers: indices of the episodes
        owners: index of each episode's trim
        """
        self._owners[numbers] = owners
        self._states[numbers] = 0.0

    def step(self) -> np.ndarray:
        """Advance the turbulence of all episodes by one sample.

        Returns the disturbances during that sample, (N, k).
        """
        owners = self._owners
        draw = self._random.standard_normal(self._states.shape)
        before = self._states
        moved = _rowwise(self._transitions[owners], before)
        self._states = moved + _rowwise(self._noise_gains[owners], draw)
        return _rowwise(self._winds_of_states[owners], 0.5 * (before + self._states))


def _rowwise(matrices: np.ndarray, rows: np.ndarray) -> np.ndarray:
    """Return the products matrices[i] @ rows[i] for matrices (N, m, n) and rows (N, n)."""
    return np.einsum("nij,nj->ni", matrices, rows)


def _box_of(deployed: Deployed) -> tuple[np.ndarray, np.ndarray]:
    """Return the lowest and highest action, (m,) each."""
    low, high = deployed.deployment.box
    for name, lowest, highest in zip(deployed.commanded, low, high, strict=True):
        if not (np.isfinite(lowest) and np.isfinite(highest)):
            raise BadInputError(
                f"{deployed.deployment.origin}: action.{name} has no box, which a learning "
                "environment requires; give box = [lowest, highest]"
            )
    return low, high


def _moved_by_actions(deployed: Deployed, low: np.ndarray, high: np.ndarray) -> ca.Function:
    """Return the function (action, X, U before, trim) -> U of actions limited to the box."""
    arguments = deployed.symbols()
    action = ca.SX.sym("a", len(low))
    within = saturated(action, ca.DM(low), ca.DM(high))
    commanded = deployed.inputs(within, *arguments)
    return ca.Function("moves", [action, *arguments], [ca.densify(commanded)])


def _bound(
    code: RowCode | RowFunction, tables: Sequence[np.ndarray], results: Sequence[np.ndarray]
) -> Callable[[], Any]:
    """Return a function without arguments that evaluates all rows of the tables into `results`.

    A result may be one of the tables.
    """
    if isinstance(code, RowCode):
        return code.bound(tables, results)

    def evaluate() -> None:
        for result, values in zip(results, code(*tables), strict=True):
            result[:] = values

    return evaluate
