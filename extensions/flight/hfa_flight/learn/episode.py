"""Simulation of an episode of an aircraft, sample by sample."""

from __future__ import annotations

import itertools
import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from typing import Any, Self

import casadi as ca
import numpy as np

from hfa_aircraft.batch_simulation import all_finite, is_within, saturated
from hfa_aircraft.limits import Limits
from hfa_aircraft.model import Model
from hfa_flight.air.held_step import parts_of_a_sample
from hfa_flight.air.sensors import Sensor
from hfa_flight.air.turbulence import Turbulence
from hfa_flight.judge.flight_costs import cost_rate
from hfa_flight.judge.outcomes import refuse_edges
from hfa_flight.plan.problem import start_box
from hfa_flight.policies.deployment.deployed import Deployed
from hfa_flight.simulate.envelope import departure, flight_envelope
from hfa_flight.simulate.sampled_flights import CompiledSamples, SampledFlight, Ticks
from hfa_support.errors import (
    BadInputError,
    NoSolutionError,
    is_finite,
    pair_of,
    refuse_unknown,
    shown,
)
from hfa_support.matrices import spectral_radius
from hfa_support.native.bound import RowFunction
from hfa_support.native.row_code import RowCode, row_code
from trim.linear.delays import step_count
from trim.linear.linearize import linearize
from trim.point.operating_point import OperatingPoint

#: Sample times, s, the longest first. One is chosen by its product with the fastest pole.
_SAMPLE_TIMES = (0.02, 0.01, 0.005, 0.002, 0.001)
_LARGEST_POLE_TIMES_DT = 1.0
#: Time that flights without action must survive, s.
_SURVIVAL_TIME = 1.0
#: Shares of a box that are tried, the largest first.
_SHARES = np.array([1.0, 0.9, 0.8, 0.7, 0.6, 0.5, 0.4, 0.3, 0.2, 0.1])
#: Factor on the found box, because only some of its states are tried.
_FACTOR_FOR_UNTRIED = 0.95
#: Numbers of drawn states, and of states up to which all corners of a box are tried.
_DRAWN_STATES = 200
_MOST_STATES_WITH_CORNERS = 6


def usual_sample_time(model: Model, points: Sequence[OperatingPoint]) -> float:
    """Return the sample time of a default environment, s.

    It is the longest of 20, 10, 5, 2 and 1 ms whose product with the fastest pole is at most 1, of
    the aircraft and of its LQR loop with the default weights at all trims. A slower policy than the
    LQR does not need a shorter one.
    """
    from controller.game.linear_game import game, weights_of_flights
    from controller.riccati.gare import solve

    fastest = 0.0
    for point in points:
        linear = linearize(model, point)
        fastest = max(fastest, spectral_radius(linear.A))
        try:
            K = solve(game(linear, **weights_of_flights(linear), delta=np.inf)).K
        except NoSolutionError:
            continue
        fastest = max(fastest, spectral_radius(linear.A - linear.B @ K))
    resolving = (dt for dt in _SAMPLE_TIMES if dt * fastest <= _LARGEST_POLE_TIMES_DT)
    return next(resolving, _SAMPLE_TIMES[-1])


def surviving_boxes(
    flight: SampledFlight,
    points: Sequence[OperatingPoint],
    boxes: np.ndarray,
    action: np.ndarray,
) -> np.ndarray:
    """Return half-widths (N, k) from which flights with a constant action stay for a second.

    Each half-width is reduced to the largest of the `_SHARES` from which flights with this
    deviation alone stay within the limits, and then the whole box to the largest share from whose
    corners, and from `_DRAWN_STATES` drawn states, they stay.

    boxes: half-widths about each trim, (N, k)
    action: (m,)
    """
    # Tried states in half-widths: one deviation alone, all 2^k corners for small k, and drawn ones.
    k = boxes.shape[1]
    sides = np.vstack([np.eye(k), -np.eye(k)])
    corners = (
        np.array([*itertools.product((-1.0, 1.0), repeat=k)])
        if k <= _MOST_STATES_WITH_CORNERS
        else sides
    )
    drawn = np.random.default_rng(0).uniform(-1.0, 1.0, (_DRAWN_STATES, k))

    dt = max(flight.dt, _SAMPLE_TIMES[0])  # a constant action needs no shorter samples
    flight = replace(flight, dt=dt, steps_per_sample=parts_of_a_sample(points, dt, [*boxes]))
    # A network whose output is the constant action, whatever the states are.
    constant = CompiledSamples(
        flight,
        entering=lambda states, _: [states],
        network=lambda rows: np.tile(action, (len(rows), 1)),
        stepper=Ticks(flight.tick(), dt, is_long=True),
    )

    reduced = []
    for point, box in zip(points, boxes, strict=True):
        of_sides = _surviving_shares(constant, point, box, sides)
        # A half-width is that of the worse of its two sides.
        alone = np.minimum(of_sides[:k], of_sides[k:]) * box
        joint = _surviving_shares(constant, point, alone, np.vstack([corners, drawn]))
        reduced.append(_FACTOR_FOR_UNTRIED * joint.min() * alone)
    return np.array(reduced)


def _surviving_shares(
    loop: CompiledSamples, point: OperatingPoint, box: np.ndarray, directions: np.ndarray
) -> np.ndarray:
    """Return the largest of the `_SHARES` of a box up to which flights stay, by direction, (D,)."""
    model, flight = point.model, loop.flight
    rows = model.state_places(model.linear)
    count = len(directions) * len(_SHARES)
    # A flight from each direction with each share: (D, shares, k), then one in each row.
    starts = np.tile(point.x, (count, 1))
    deviations = directions[:, None, :] * _SHARES[:, None] * box
    starts[:, rows] += deviations.reshape(count, len(box))
    trims = np.tile(flight.deployed.trim_vector(point), (count, 1))
    ticks = step_count(_SURVIVAL_TIME, flight.dt)
    flown, _ = loop.fly(flight.start(starts, trims), trims, ticks)
    envelope = flight_envelope(model, point)
    # `least` and `most` are the limits with their tolerance.
    stays = flight.stays(flown.states, envelope.least, envelope.most).all(axis=1)
    stays = stays.reshape(len(directions), len(_SHARES))
    # True where the flights of this share, and of all smaller ones, stay. `_SHARES` descend: the
    # accumulation begins in the last column, which has the smallest share.
    up_to_share = np.logical_and.accumulate(stays[:, ::-1], axis=1)[:, ::-1]
    # The largest share is the first that stays; if none does, the smallest share.
    return np.where(up_to_share.any(axis=1), _SHARES[up_to_share.argmax(axis=1)], _SHARES[-1])


#: Cost of a sample whose cost is not a finite number.
_COST_WITHOUT_NUMBER = 1e6
#: Rows of an episode that the compiled sample reads and overwrites in place (`_allocate`).
_BOUND_ROWS = ("_state", "_held", "_observed", "_outcome")
#: Default duration of an episode, s.
SECONDS = 20.0


class Episode:
    """Episodes of a deployment on its aircraft, one after the other, each about one of some trims.

    The reward of a sample is -dt (x'Q x + u'R u). x are the deviations of states and outputs from
    the trim at the sample, and u the inputs commanded at the sample minus the trim, also if they
    act later because of a delay. Q and R are those of `cost_weights`. If an episode leaves the
    limits, the cost of that sample, with all states at their farther limits, is also counted for
    each remaining sample, so that no flight inside the limits costs more.

    trim_index: index of the trim of the episode.

    A pickled copy is in the same state; its code is compiled again.
    """

    def __init__(
        self,
        deployed: Deployed,
        points: Sequence[OperatingPoint],
        seconds: float = SECONDS,
        turbulence: Turbulence | None = None,
        vary: Mapping[str, tuple[float, float]] | None = None,
        sensors: Mapping[str, Sensor] | None = None,
    ) -> None:
        """Prepare episodes of at most `seconds` about the trims `points`.

        turbulence: drawn again for each episode
        vary: parameter -> (lowest, highest), between which it is drawn for each episode. The trims
            remain those of the unchanged aircraft
        sensors: what is measured -> `Sensor`, whose errors are drawn for each episode

        Raises BadInputError in these cases:
        - `points` is empty.
        - An action has no box.
        - `seconds` is shorter than a sample or not finite.
        - A trim is at the limit of a state.
        - An observation or a map is not finite at a trim.
        - The aircraft does not support the turbulence.
        - A varied parameter is unknown, or its range is outside its limits.
        """
        own = points, seconds, turbulence, vary, sensors
        self._arguments = deployed.deployment, deployed.model, *own

        # Checks of the arguments.
        self.varied = _checked_ranges(deployed.model, vary or {})
        deployed = replace(deployed, varies=bool(self.varied))
        if not points:
            raise BadInputError("no trim is given; give at least one operating point")
        dt = deployed.deployment.dt
        if not (is_finite(seconds) and seconds >= dt):
            raise BadInputError(
                f"the duration of an episode is {shown(seconds)} s; give at least the sample time, "
                f"{dt:g} s"
            )
        self.deployed = deployed
        self.points = tuple(points)
        self.low, self.high = _box_of(deployed)
        refuse_edges(points)
        middle_of_box = 0.5 * self.low + 0.5 * self.high
        deployed.refuse_undefined_at(points, middle_of_box)
        self.samples = round(seconds / dt)
        self._turbulence = turbulence

        sensors = deployed.sensors_in_air(sensors or {})
        # The flights about the trims, the boxes in which they begin, and what it costs to leave.
        boxes = np.array([start_box(deployed.model, point) for point in points])
        # The commands follow from the actions of the learner in place of those of the policy.
        self._flight = SampledFlight(
            deployed,
            dt,
            deployed.deployment.delay,
            parts_of_a_sample(self.points, dt, [*boxes]),
            commands_of=_commands_of_actions(deployed.sensing(sensors), self.low, self.high),
            # Of the air, only the names of its winds are needed: one sample is drawn for them.
            winds=()
            if turbulence is None
            else turbulence.air(self.points[0], dt, count=1, seed=0).names,
            sensors=sensors,
        )
        no_action = np.clip(0.0, self.low, self.high)  # the action of the box nearest to 0
        self._boxes = surviving_boxes(self._flight, self.points, boxes, no_action)
        self._envelopes = [flight_envelope(deployed.model, point) for point in points]
        self._trims = np.array([deployed.trim_vector(point) for point in points])
        self._penalties = [
            self._penalty_of(point, envelope)
            for point, envelope in zip(points, self._envelopes, strict=True)
        ]
        self._linear = deployed.model.state_places(deployed.model.linear)

        # What changes from episode to episode, and the code of a sample.
        self.trim_index = 0
        self._winds_of_samples = np.zeros((self.samples, 0))
        self._views = np.zeros((self.samples + 1, self._flight.held_sizes.view))
        self._observing = row_code(self._flight.observing(), one_row=True)
        self._code = row_code(self._sample(), one_row=True)
        self._allocate()

    def _penalty_of(self, point: OperatingPoint, envelope: Limits) -> float:
        """Return the cost of a sample with each state at its farther limit, and no action."""
        ends = np.array([envelope.lowest, envelope.highest]) - point.x
        below, above = np.where(np.isfinite(ends), ends, 0.0)  # a missing limit costs nothing
        X = point.x + np.where(-below > above, below, above)  # the limit farther from the trim
        trim = self.deployed.trim_vector(point)
        rate = float(cost_rate(self.deployed)(X, point.u, trim))
        return self._flight.dt * rate if math.isfinite(rate) else _COST_WITHOUT_NUMBER

    def _allocate(self) -> None:
        """Allocate the rows of an episode, name their parts, and bind the compiled code to them."""
        # The row of the states contains state, memory, extremes, and the number of remaining
        # samples. The row of the held values contains those of the flight, the limits of the state,
        # and the penalty of leaving them.
        flight = self._flight
        n = len(self.deployed.model.states)
        self._state = np.zeros((1, sum(flight.sizes) + 1))
        self._held = np.zeros((1, sum(flight.held_sizes) + 2 * n + 1))
        self._observed = np.zeros((1, self.deployed.observe.numel_out(0)))
        self._outcome = np.zeros((1, 3))  # reward, left, over
        self._name_parts()
        self._fly = _bound(self._code, (self._state, self._held), (self._state, self._outcome))
        of_flight = self._state[:, :-1], self._held[:, : sum(flight.held_sizes)]
        self._observe = _bound(self._observing, of_flight, (self._observed,))

    def _name_parts(self) -> None:
        """Name the parts of the rows that are read and set between samples, as views."""
        # The memory ends with the inputs, the trim with the parameters, and the push with the
        # winds.
        flight = self._flight
        model = self.deployed.model
        n, m = len(model.states), len(model.inputs)
        X, memory, *_ = flight.slices
        actions, trim, push, view = flight.held_slices
        self._X = self._state[0, X]
        self._U = self._state[0, memory.stop - m : memory.stop]
        self._action = self._held[0, actions]
        self._parameters = self._held[0, trim][n + m :]
        self._winds = self._held[0, push.stop - len(flight.winds) : push.stop]
        self._view = self._held[0, view]
        names = list(model.parameters)
        self._places_of_varied = [n + m + names.index(name) for name in self.varied]

    def _present(self) -> dict[str, Any]:
        """Return the values that change from sample to sample, by name."""
        rows = {name: getattr(self, name).copy() for name in _BOUND_ROWS}
        others = ("trim_index", "_winds_of_samples", "_views")
        return rows | {name: getattr(self, name) for name in others}

    def _continue(self, present: Mapping[str, Any]) -> None:
        """Set the values that change from sample to sample, those of `_present`."""
        for name, value in present.items():
            if name in _BOUND_ROWS:  # stays the array to which the compiled code is bound
                getattr(self, name)[:] = value
            else:
                setattr(self, name, value)

    def __getstate__(self) -> tuple[Any, ...]:
        """Return the arguments of the constructor and the present values, without compiled code."""
        return self._arguments, self._present()

    def __setstate__(self, kept: tuple[Any, ...]) -> None:
        """Prepare the same episodes, with the present values of another."""
        (deployment, model, *others), present = kept
        self.__init__(Deployed(deployment, model), *others)  # type: ignore[misc]
        self._continue(present)

    def __deepcopy__(self, _: Any) -> Self:
        """Return a copy in the same state, which shares what does not change."""
        copy = object.__new__(type(self))
        copy.__dict__.update(self.__dict__)
        copy._allocate()
        copy._continue(self._present())
        return copy

    @property
    def states(self) -> np.ndarray:
        """States X of the aircraft, (n,)."""
        return self._X.copy()

    @property
    def inputs(self) -> np.ndarray:
        """Inputs just before the sample, (m,)."""
        return self._U.copy()

    @property
    def observation(self) -> np.ndarray:
        """Observations of the sample, (k,)."""
        return self._observed[0].copy()

    @property
    def parameters(self) -> dict[str, float]:
        """Values of the varied parameters, by name."""
        values = dict(zip(self.deployed.model.parameters, self._parameters.tolist(), strict=True))
        return {name: values[name] for name in self.varied}

    @property
    def start_box(self) -> dict[str, float]:
        """Half-widths of the initial conditions about the trim, by name of a linear state."""
        box = self._boxes[self.trim_index].tolist()
        return dict(zip(self.deployed.model.linear, box, strict=True))

    @property
    def envelope(self) -> Limits:
        """Limits of the states about the trim."""
        return self._envelopes[self.trim_index]

    def begin(self, random: np.random.Generator) -> None:
        """Begin an episode at a random initial condition about a random trim."""
        trim_index = int(random.integers(len(self.points)))
        in_half_widths = random.uniform(-1.0, 1.0, len(self._linear))
        start = self.points[trim_index].x
        start[self._linear] += in_half_widths * self._boxes[trim_index]
        self.begin_at(trim_index, start, random)

    def begin_at(self, trim_index: int, start: np.ndarray, random: np.random.Generator) -> None:
        """Begin an episode at an initial state.

        trim_index: index of the trim
        start: initial state, (n,)
        random: draws the turbulence, the varied parameters and the errors of sensors
        """
        dt = self.deployed.deployment.dt
        trim = self._trims[trim_index].copy()
        if self._turbulence is not None:
            seed = int(random.integers(2**63))
            values = self._turbulence.air(self.points[trim_index], dt, self.samples, seed).values
            # During a sample, a disturbance is constant: the mean of its values at both ends.
            self._winds_of_samples = 0.5 * (values[:-1] + values[1:])
        if self.varied:
            lowest, highest = np.array(list(self.varied.values())).T
            trim[self._places_of_varied] = random.uniform(lowest, highest)
        if self._flight.sensors:
            (errors,) = self._flight.drawn_errors(int(random.integers(2**63)), 1)
            winds = np.zeros((self.samples + 1, 0)) if self._turbulence is None else values
            self._views = np.hstack([winds, errors(self.samples + 1)])
        self.trim_index = trim_index
        state = self._flight.start(start[None], trim[None])
        self._state[:] = np.append(state, self.samples)  # all samples remain
        actions, _, push, _ = self._flight.held_sizes
        limits = (self.envelope.least, self.envelope.most, [self._penalties[trim_index]])
        # actions, push and view are set at each sample
        held = np.zeros(actions), trim, np.zeros(push), self._views[0], *limits
        self._held[:] = np.concatenate(held)
        self._observe()

    def advance(self, action: np.ndarray) -> tuple[float, bool, bool]:
        """Advance by one sample; return the reward, and whether the aircraft left or time is over.

        The aircraft also counts as outside its limits if the next state is not a number.

        action: (m,), clipped to the box

        Raises BadInputError if the action has another shape or contains NaN.
        """
        wanted = self._action.shape
        if action.shape != wanted or any(map(math.isnan, action.tolist())):
            raise BadInputError(
                f"the action is {shown(action.tolist())}; give {wanted[0]} numbers without NaN"
            )
        self._action[:] = action
        if self._turbulence is not None:
            self._winds[:] = self._winds_of_samples[self._done]
        self._fly()
        self._view[:] = self._views[self._done]
        self._observe()
        reward, left, over = self._outcome[0].tolist()
        return reward, left > 0.0, over > 0.0

    @property
    def _done(self) -> int:
        """Number of elapsed samples."""
        return self.samples - int(self._state[0, -1])

    def left(self) -> str:
        """Return the reason and the time at which the episode was terminated, as text.

        The reason is the violated limit or the value that is not a number.
        """
        time = self._done * self.deployed.deployment.dt
        # Extremes in the sample: of a state the lower one if it is beyond a limit, else the upper.
        lowest, highest = self._flight.extremes(self._state[0, :-1])
        beyond = np.where(lowest < self.envelope.least, lowest, highest)
        if not self.envelope.within(beyond).all():
            return _departure_at(self.envelope, beyond, time)
        # Inside its limits an episode is terminated only if a value is not a number.
        after = self._next_states()
        if np.isfinite(after).all():
            return f"the command is not a number at {time:.4g} s"
        return _departure_at(self.envelope, after, time)

    def _next_states(self) -> np.ndarray:
        """Return the states after a further sample, (n,), which may be no numbers."""
        # An episode keeps its states if the next are no numbers, so these are computed again.
        held = self._held[0, : sum(self._flight.held_sizes)]
        after = np.array(self._flight.tick()(self._state[0, :-1], held)).ravel()
        return after[: len(self._X)]

    def _sample(self) -> ca.Function:
        """Return the function (state, held) -> (state, outcome) of one sample.

        The arguments are the rows of `_allocate`.
        """
        flight = self._flight
        n, m = len(flight.deployed.model.states), len(flight.deployed.model.inputs)

        # Parts of the rows: those of the flight, and those of the episode behind them.
        size, held_size = sum(flight.sizes), sum(flight.held_sizes)
        state = ca.MX.sym("state", size + 1)
        held = ca.MX.sym("held", held_size + 2 * n + 1)
        now, remaining = ca.vertsplit(state, [0, size, size + 1])
        ends = np.cumsum([0, held_size, 2 * n, 1]).tolist()
        held_in_flight, limits, penalty = ca.vertsplit(held, ends)
        actions, trim, _, view = (held_in_flight[part] for part in flight.held_slices)
        memory = flight.slices.memory
        inputs = slice(memory.stop - m, memory.stop)  # the memory ends with the latest inputs

        # Commands and cost at the sample, and the state and outcome after it.
        X, inputs_before = now[:n], now[inputs]
        assert flight.commands_of is not None  # set by the constructor
        seen = flight.seen(X, inputs_before, trim, view)
        U = flight.commands_of(actions, seen, inputs_before, trim)
        cost = flight.dt * cost_rate(self.deployed)(X, U, trim)
        after = flight.tick()(now, held_in_flight)
        kept, later, outcome = _outcome(size, n)(now, after, cost, remaining, limits, penalty)
        return ca.Function("episode", [state, held], [ca.vertcat(kept, later), outcome])


def _checked_ranges(
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
        # refuses a value beyond the limits of the parameter
        for value in (lowest, highest):
            model.with_parameters(**{name: value})
        ranges[name] = (lowest, highest)
    return ranges


def _departure_at(envelope: Limits, states: np.ndarray, time: float) -> str:
    """Return which limit is violated by states (n,) outside the envelope, and when."""
    left = departure(envelope, np.array([time]), states[None])
    assert left is not None  # the states are outside
    return left.cause()


def _outcome(size: int, n: int) -> ca.Function:
    """Return (before, after, cost, remaining, limits, penalty) -> (kept state, later, outcome)."""
    # The states `before` and `after` the sample, (size,), end with the lowest and the highest X of
    # the sample. The kept state is `after` if all its entries are finite, else `before`; `later`
    # is the number of samples that then remain. The outcome is the reward, whether the aircraft
    # left the limits (2 n,), and whether no samples remain. The reward is -cost; outside the limits
    # both cost and penalty count for each later sample, too.
    before, after = ca.SX.sym("before", size), ca.SX.sym("after", size)
    cost, remaining, penalty = map(ca.SX.sym, ("cost", "remaining", "penalty"))
    limits = ca.SX.sym("limits", 2 * n)
    is_number = all_finite(after)
    kept = ca.if_else(is_number, after, before)
    lowest, highest = kept[size - 2 * n : size - n], kept[size - n :]
    inside = (is_within(extreme, limits[:n], limits[n:]) for extreme in (lowest, highest))
    left = ca.logic_not(ca.logic_and(is_number, ca.logic_and(*inside)))
    later = ca.fmax(remaining - 1.0, 0.0)
    finite_cost = ca.if_else(all_finite(cost), cost, _COST_WITHOUT_NUMBER)
    reward = -finite_cost - ca.if_else(left, later * (finite_cost + penalty), 0.0)
    outcome = ca.vertcat(reward, left, later <= 0.0)
    arguments = [before, after, cost, remaining, limits, penalty]
    return ca.Function("outcome", arguments, [kept, later, outcome])


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


def _commands_of_actions(deployed: Deployed, low: np.ndarray, high: np.ndarray) -> ca.Function:
    """Return the function (action, X, U before, trim) -> U of actions limited to the box."""
    arguments = deployed.symbols()
    action = ca.SX.sym("a", len(low))
    within = saturated(action, ca.DM(low), ca.DM(high))
    commanded = deployed.inputs(within, *arguments)
    return ca.Function("moves", [action, *arguments], [ca.densify(commanded)])


def _bound(
    code: RowCode | RowFunction, tables: Sequence[np.ndarray], results: Sequence[np.ndarray]
) -> Callable[[], Any]:
    """Return a function without arguments that evaluates all rows of the tables into `results`."""
    if isinstance(code, RowCode):
        return code.bound(tables, results)

    def evaluate() -> None:
        for result, values in zip(results, code(*tables), strict=True):
            result[:] = values

    return evaluate
