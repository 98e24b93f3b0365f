"""Compilation and simulation of a closed loop."""

from __future__ import annotations

import math
import sys
from collections.abc import Callable
from dataclasses import replace
from functools import cached_property, lru_cache
from itertools import pairwise
from typing import NamedTuple

import casadi as ca
import numpy as np

from hfa_flight.air.held_step import slices_of
from hfa_flight.air.scenario import Scenario
from hfa_flight.policies.policy import SAME_TIME, Policy
from hfa_flight.simulate.closed_loop import FlightLoop, HeldParts
from hfa_flight.simulate.history import Deviations
from hfa_support.errors import NoSolutionError
from hfa_support.native.bound import BoundFunction, RowFunction
from hfa_support.native.row_code import machine_code
from hfa_support.progress import Progress

#: Largest error of a step, relative to the size of each state. Costs are printed with six digits.
TOLERANCE = 1e-7
#: Size of a state near 0, relative to the largest deviation so far in nominal values.
_LEAST_SIZE = 1e-3
#: Errors below this are rounding, in nominal values: 1e4 units in the last place.
_ROUNDING = 1e-12
#: A step is followed by one of .9 times the length that the error allows, at least a fifth and at
#: most ten times as long. The error is of order 5.
_SAFETY, _LEAST_FACTOR, _LARGEST_FACTOR, _ORDER = 0.9, 0.2, 10.0, 5.0
#: The error of a fifth of a step over a jump is about a fifth, and over a nonsmooth point a 25th.
_FALL_AT_A_JUMP = 0.1
#: Number of steps since the last `RungeKutta.clear` after which `advance` pauses first, then after
#: twice, four times, ... as many, so that a flight that has left its envelope soon ends.
_FIRST_PAUSE = 100
#: Largest number of steps after `RungeKutta.clear` before a pause: a flight makes fewer in 1 s.
_PAUSE_LATER = 1600
#: Largest number of these steps, about 2 s of computation.
_MOST_STEPS = 100_000

#: Coefficients of Dormand and Prince (1980): slopes within each stage, of the state after the step,
#: of its error, and of the polynomial of Shampine (1986) in a step. Those of SciPy's RK45, whose
#: import takes longer than a flight.
_STAGES = (
    (1 / 5,),
    (3 / 40, 9 / 40),
    (44 / 45, -56 / 15, 32 / 9),
    (19372 / 6561, -25360 / 2187, 64448 / 6561, -212 / 729),
    (9017 / 3168, -355 / 33, 46732 / 5247, 49 / 176, -5103 / 18656),
)
_STAGE_TIMES = (1 / 5, 3 / 10, 4 / 5, 8 / 9, 1.0)
_WEIGHTS_AFTER = (35 / 384, 0.0, 500 / 1113, 125 / 192, -2187 / 6784, 11 / 84)
_WEIGHTS_OF_ERROR = (-71 / 57600, 0.0, 71 / 16695, -71 / 1920, 17253 / 339200, -22 / 525, 1 / 40)
_POLYNOMIAL = (
    (1.0, -8048581381 / 2820520608, 8663915743 / 2820520608, -12715105075 / 11282082432),
    (0.0, 0.0, 0.0, 0.0),
    (0.0, 131558114200 / 32700410799, -68118460800 / 10900136933, 87487479700 / 32700410799),
    (0.0, -1754552775 / 470086768, 14199869525 / 1410260304, -10690763975 / 1880347072),
    (0.0, 127303824393 / 49829197408, -318862633887 / 49829197408, 701980252875 / 199316789632),
    (0.0, -282668133 / 205662961, 2019193451 / 616988883, -1453857185 / 822651844),
    (0.0, 40617522 / 29380423, -110615467 / 29380423, 69997945 / 29380423),
)


@lru_cache(maxsize=32)
def step_function(
    rate: ca.Function, nominal: tuple[float, ...], is_long: bool = False
) -> ca.Function:
    """Return the function of one step of the integration of y' = rate(t, y, held).

      (t, y, held, h, largest before) -> (y at t + h, largest, error ratio, error, slopes)

    largest: largest deviation in the flight so far, in nominal values
    error ratio: root mean square of error / allowed error, which is `TOLERANCE` of a state's size
    error: norm of the error in nominal values
    slopes: y + h slopes [θ θ² θ³ θ⁴]' is the state at t + θ h

    nominal: nominal value of each entry of y, or 0 for a cost, whose error is relative to itself
    is_long: whether machine code saves time
    """
    t, h, before = (ca.SX.sym(name) for name in ("t", "h", "before"))
    y, held = ca.SX.sym("y", rate.numel_in(1)), ca.SX.sym("held", rate.numel_in(2))
    k = rate(t, y, held)  # gets a column for each stage: its slope
    for time, stage in zip(_STAGE_TIMES, _STAGES, strict=True):
        at_stage = y + h * ca.mtimes(k, ca.DM(stage))
        k = ca.horzcat(k, rate(t + time * h, at_stage, held))
    after = y + h * ca.mtimes(k, ca.DM(_WEIGHTS_AFTER))
    k = ca.horzcat(k, rate(t + h, after, held))

    error = ca.fabs(h * ca.mtimes(k, ca.DM(_WEIGHTS_OF_ERROR)))
    size = ca.fmax(ca.fabs(y), ca.fabs(after))
    units = ca.DM(nominal)
    deviating = np.flatnonzero(nominal).tolist()
    largest = ca.fmax(before, ca.mmax(size[deviating] / units[deviating]))
    allowed = TOLERANCE * (size + _LEAST_SIZE * units * largest) + _ROUNDING * units
    # The root mean square over the states; a state that stays 0, as a cost, is not 0 / 0.
    ratio = ca.norm_2(error / (allowed + sys.float_info.min)) / math.sqrt(y.numel())
    in_units = ca.norm_2(error[deviating] / units[deviating])
    results = (after, largest, ratio, in_units, ca.mtimes(k, ca.DM(_POLYNOMIAL)))
    dense = [ca.densify(result) for result in results]
    step = ca.Function("step", [t, y, held, h, before], dense)
    return machine_code(step) if is_long else step


def _step_factor(ratio: float) -> float:
    """Return the length of the next step relative to one with a ratio of error to allowed error."""
    if ratio == 0.0:
        return _LARGEST_FACTOR
    wanted = _SAFETY * ratio ** (-1 / _ORDER)
    # For an error that is not a number, `max` returns its first argument.
    return min(_LARGEST_FACTOR, max(_LEAST_FACTOR, wanted))


class RungeKutta:
    """Integration of one flight by steps whose estimated errors are at most `TOLERANCE`.

    A step over a jump of the rates is made although its error is larger. `_steps` are the steps
    since `clear`, of which `_count` are filled. `_next` is the wanted length of the next step.

    step: `step_function` of the loop
    longest: longest step, s
    shortest: step below which a jump is assumed if the error hardly decreases with the step, s
    error: sum of the errors of the steps over jumps, relative to the largest deviation at each, in
        nominal values
    """

    def __init__(self, step: BoundFunction, longest: float, shortest: float) -> None:
        self.error = 0.0
        self._largest = 0.0
        # Error of the short step that was tried last since the last step made; inf without one.
        self._error_of_short_step = math.inf
        self._function = step
        self._longest, self._shortest = longest, shortest
        self._next = longest
        n = step.inputs[1].size
        # The steps since `clear`. Stored as objects, each would take a tenth more of the time of a
        # flight in turbulence.
        step_type = [
            ("begin", float),
            ("seconds", float),
            ("y", float, n),
            ("slopes", float, 4 * n),
        ]
        self._steps = np.empty(_FIRST_PAUSE, dtype=step_type)
        self._count = 0
        self._pause = _FIRST_PAUSE

    def advance(
        self, begin: float, end: float, y: np.ndarray, held: np.ndarray
    ) -> tuple[float, np.ndarray]:
        """Return `end` and the state at it, (n,), from y at `begin`, with constant held inputs.

        After many steps, an earlier time and its state are returned, from which to advance again.

        Raises NoSolutionError if too many steps are necessary.
        """
        t, now, held_now, h, before = self._function.inputs
        after, largest, error_ratio, error, slopes = self._function.results
        now[:], held_now[:] = y, held
        time = begin
        while time < end:
            if self._count >= self._pause:
                self._pause *= 2
                break
            # Equal steps of at most the wanted length, of which the last ends exactly at `end`.
            steps_left = max(1, math.ceil((end - time) / self._next))
            seconds = (end - time) / steps_left
            t[0], h[0], before[0] = time, seconds, self._largest
            self._function.evaluate()
            ratio = float(error_ratio[0])
            # The step is made, or tried again with a shorter length.
            if ratio <= 1.0:
                self._next = min(self._longest, _step_factor(ratio) * seconds)
            elif shorter := self._shorter_step(seconds, ratio, float(error[0])):
                self._next = shorter
                continue
            else:  # the step is made over a jump
                self._next = min(self._longest, self._shortest)
                if math.isfinite(ratio):
                    self.error += float(error[0]) / float(largest[0])
                else:
                    steps_left, seconds = 1, end - time  # the flight diverges
            self._error_of_short_step = math.inf
            if self._count == _MOST_STEPS:
                raise NoSolutionError(
                    f"the simulation requires steps of {seconds:.2g} s at {time:.4g} s: the loop "
                    "has a fast mode, such as an actuator with a short lag; slow it down"
                )
            if self._count == len(self._steps):
                self._steps = np.concatenate([self._steps, np.empty_like(self._steps)])
            self._steps[self._count] = time, seconds, now, slopes
            self._count += 1
            now[:] = after
            self._largest = float(largest[0])
            time = end if steps_left == 1 else time + seconds
        return time, now.copy()

    def _shorter_step(self, seconds: float, ratio: float, error: float) -> float | None:
        """Return the length, s, of the next trial of a step, or None if it passes over a jump.

        The error of a short step over a jump hardly falls with the length (`_FALL_AT_A_JUMP`).
        """
        if seconds > self._shortest:
            return _step_factor(ratio) * seconds
        if error < _FALL_AT_A_JUMP * self._error_of_short_step:
            self._error_of_short_step = error
            return _LEAST_FACTOR * seconds
        return None

    def clear(self) -> None:
        """Forget the steps made so far. The next pause is after at most `_PAUSE_LATER` steps."""
        self._count = 0
        self._pause = min(self._pause, _PAUSE_LATER)

    def rows(self, times: np.ndarray) -> np.ndarray:
        """Return the states at increasing times of the steps since `clear`, (N, n)."""
        begins = self._steps["begin"][: self._count]
        steps = self._steps[np.searchsorted(begins, times, side="right") - 1]
        late = times - steps["begin"]
        theta = (late / steps["seconds"])[:, None]
        # The polynomial of `step_function`, of which `slopes` holds the coefficients of θ first.
        first, second, third, fourth = np.split(steps["slopes"], 4, axis=1)
        with np.errstate(all="ignore"):  # a flight may diverge
            slope = ((fourth * theta + third) * theta + second) * theta + first
            return np.asarray(steps["y"] + late[:, None] * slope)


#: Number of ticks from which compilation to machine code saves time: measured are 10,000 for the
#: flexible aircraft and 30,000 for a JSBSim jet.
COMPILE_FROM_TICKS = 30_000
#: Number of rows between tests of whether a flight ends.
_ROWS_OF_WINDOW = 1000
#: Steps longer than this part of the interval of the rows are shortened also at a jump.
_SHORTEST_STEP = 1 / 2


class CompiledLoop:
    """A closed loop, compiled once and simulated many times.

    A row of a flight has its time t, the state y of the loop, the held inputs and the observed
    values, of which `places` holds the slices.

    flights: expected number of flights. With enough of them, machine code is compiled.
    """

    def __init__(self, loop: FlightLoop, flights: int = 1) -> None:
        self.loop = loop
        t, y, held = self._arguments = loop.symbols()
        self._now = now = loop.at(t, y, held)
        observed = (now.error, now.inputs, now.limited, ca.vertcat(*now.winds.values()))
        is_long = flights * loop.scenario.ticks >= COMPILE_FROM_TICKS
        model = loop.plant.point.model
        nominal = model.nominal(model.states).tolist() + [0.0] * (loop.cost is not None)
        rate = self._function("loop_rate", now.rate)
        step = step_function(rate, tuple(nominal), is_long)
        self.step = BoundFunction(step)
        self.observed = _row_function(self._function("loop_observed", ca.vertcat(*observed)))
        self.places = _Observed(*slices_of([part.numel() for part in observed]))
        # Steps are at most a tick where time acts, so that none passes over a short signal.
        self.is_driven = ca.depends_on(now.rate, t)

    def _function(self, name: str, expression: ca.SX) -> ca.Function:
        """Return the function (t, y, held) -> expression, the same object for equal functions.

        `step_function` and `_row_function` then compile it once.
        """
        dense = [ca.densify(expression)]
        function = ca.Function(name, [*self._arguments], dense, {"cse": True})
        called = (call.class_name() for call in function.find_functions())
        # A function that calls Python, as that of an FMU does, has no text.
        return function if "CallbackInternal" in called else _of_text(function.serialize())

    @cached_property
    def command(self) -> BoundFunction:
        """The function (t, y, held) -> command of the policy, (m,)."""
        return BoundFunction(self._function("command", self._now.command))

    @cached_property
    def measured(self) -> BoundFunction:
        """The function (t, y, held) -> what the policy measures, with errors."""
        return BoundFunction(self._function("measured", self._now.measured))

    @cached_property
    def growth(self) -> float:
        """Largest growth of a mode of the linear loop, 1/s, or 0 if no mode is known to grow."""
        return float(self.loop.growing_modes().real.max(initial=0.0))

    def fly(
        self,
        scenario: Scenario | None = None,
        *,
        parameters: np.ndarray | None = None,
        policy: Policy | None = None,
        ticks: int | None = None,
        stop: Callable[[np.ndarray], np.ndarray] | None = None,
        progress: Progress | None = None,
    ) -> Deviations:
        """Simulate a flight and return its time history.

        scenario: used in place of the loop's scenario. Only its numbers may differ
        parameters: parameters of the plant, for an uncertain plant
        policy: used in place of the loop's policy. Only its held inputs may differ
        ticks: number of ticks, or None for that of the scenario
        stop: function from absolute values of the variables with limits (N, n) to a mask (N,). The
            flight ends with the first row that is True
        progress: called during the flight

        Raises NoSolutionError with the time if a state is not finite and there is no `stop`.
        """
        loop = self.loop if scenario is None else replace(self.loop, scenario=scenario)
        if policy is not None:
            loop = replace(loop, policy=policy)
        ticks = loop.scenario.ticks if ticks is None else ticks
        per_tick = loop.scenario.steps_per_tick
        window = max(1, _ROWS_OF_WINDOW // per_tick)
        flying = _Flying(self, loop, ticks, window, parameters, stop)
        parts: list[_Rows] = []
        for first in range(0, ticks, window):
            last = min(first + window, ticks)
            rows, stops = flying.rows(first, last)
            is_last = bool(stops.any()) or last == ticks
            # Up to the first row at which the flight stops. The last row of a window is the first
            # of the next one, if there is one.
            count = int(stops.argmax()) if stops.any() else (last - first) * per_tick
            parts.append(_Rows(*(part[: count + is_last] for part in rows)))
            if progress is not None:
                progress(ticks if is_last else last, ticks)
            if is_last:
                break
        flight = self._flight(*map(np.concatenate, zip(*parts, strict=True)))
        diverged = ~np.isfinite(flight.states).all(axis=1)
        if stop is None and diverged.any():
            raise NoSolutionError(
                f"the simulation diverges at t = {flight.times[diverged.argmax()]:.6g} s; check "
                "that the policy stabilizes the aircraft"
            )
        return replace(flight, integration_error=flying.integration.error)

    def _flight(self, times: np.ndarray, y: np.ndarray, observed: np.ndarray) -> Deviations:
        """Return the time history of the rows of a flight, whose arrays are those of `_Rows`."""
        states, cost = np.split(y, [len(self.loop.plant.point.x)], axis=1)
        errors, inputs, limited, winds = (observed[:, place] for place in self.places)
        air = dict(zip(self._now.winds, winds.T, strict=True))
        flown_cost = cost[:, 0] if cost.size else None
        return Deviations(times, states, errors, inputs, limited, air, flown_cost)


#: Functions of rows; equal functions are the same object (`_of_text`).
_row_function = lru_cache(maxsize=32)(RowFunction)


#: The function that is serialized in a text, the same object for equal texts.
_of_text = lru_cache(maxsize=64)(ca.Function.deserialize)


class _Observed(NamedTuple):
    """Parts of the observed values of a row: signals of `LoopSignals`."""

    error: slice
    inputs: slice
    limited: slice
    winds: slice


class _Rows(NamedTuple):
    """Times (N,), states y of the loop (N, n) and observed values (N, k) of a flight."""

    times: np.ndarray
    y: np.ndarray
    observed: np.ndarray


class _Commands(NamedTuple):
    """Commands of a policy between two times, `first` at `begin` and `last` at `end`."""

    begin: float
    end: float
    first: np.ndarray
    last: np.ndarray


class _Flying:
    """One flight of a closed loop under way: its state, and the inputs that are held.

    `_y` is the state of the loop and `_held` the vector of held inputs, with views of its parts in
    `_parts`. `_changes` are the times at which held inputs change. With a delay, `_commands` are
    the commands of the policy that have not arrived yet.

    ticks: number of ticks of the flight
    window: number of ticks between two tests of whether the flight is over
    parameters, stop: as in `CompiledLoop.fly`
    """

    def __init__(
        self,
        compiled: CompiledLoop,
        loop: FlightLoop,
        ticks: int,
        window: int,
        parameters: np.ndarray | None,
        stop: Callable[[np.ndarray], np.ndarray] | None,
    ) -> None:
        scenario = loop.scenario
        self._compiled = compiled
        self._loop = loop
        self._y = loop.start()
        self._sampler = loop.policy.sampler(scenario.initial)
        self._sampled = np.zeros(0)
        self._delay = scenario.delayed_ticks * scenario.tick
        self._commands: list[_Commands] = []
        self._first_command = np.zeros(0)  # of the policy, since the held inputs changed last
        self._held = np.zeros(sum(loop.held_sizes))
        self._parts = HeldParts(*(self._held[part] for part in slices_of(loop.held_sizes)))
        if parameters is not None:
            self._parts.parameters[:] = parameters
        self._stop = stop
        self._per_tick = scenario.steps_per_tick
        self._times = scenario.step * np.arange(ticks * self._per_tick + 1)
        self._changes = self._changes_of_held(window)
        longest = scenario.tick * (1 if compiled.is_driven else window)
        self.integration = RungeKutta(compiled.step, longest, _SHORTEST_STEP * scenario.step)

    def _changes_of_held(self, window: int) -> np.ndarray:
        """Return the times from which inputs are held, s: of each tick or window, and all breaks.

        window: number of ticks in a window, at whose begin inputs are held that change at breaks
            alone
        """
        policy, sizes = self._loop.policy, self._loop.held_sizes
        # A policy with several rows of held inputs has one for each tick, or one from each of its
        # `breaks` on.
        policy_changes = len(policy.held) > 1 and not hasattr(policy, "breaks")
        changes_each_tick = (
            self._sampler is not None or policy_changes or sizes.noise or sizes.gust or sizes.delay
        )
        times = self._times
        breaks = self._loop.breaks
        if self._delay:
            breaks = np.concatenate([breaks, breaks + self._delay])
        breaks = breaks[breaks < times[-1]]
        row = times[np.rint(breaks / self._loop.scenario.step).astype(int)]
        # A break that is a row but for rounding is at that row.
        breaks = np.where(np.abs(row - breaks) <= SAME_TIME, row, breaks)
        regular = times[:: self._per_tick * (1 if changes_each_tick else window)]
        return np.unique(np.concatenate([regular, times[-1:], breaks]))

    def rows(self, first: int, last: int) -> tuple[_Rows, np.ndarray]:
        """Fly from one tick to another. Return the rows up to the last tick, and a mask of all but
        the last row: where the flight is over.

        The rows end earlier if the flight is over earlier.
        """
        times = self._times[first * self._per_tick : last * self._per_tick + 1]
        begin, end = np.searchsorted(self._changes, times[[0, -1]])
        changes = self._changes[begin : end + 1]
        held: list[np.ndarray] = []
        # From each change to the later one, the held inputs are constant.
        for change, later in pairwise(changes.tolist()):
            self._hold(change)
            held.append(self._held.copy())
            now = change
            while now < later:
                now, self._y = self.integration.advance(now, later, self._y, self._held)
                # `advance` pauses after many steps: the flight may be over.
                if now < later:
                    last_row = int(np.searchsorted(times, now, side="right")) - 1
                    last_of_tick = last_row - last_row % self._per_tick
                    rows, over = self._rows(times[: last_of_tick + 1], changes, held)
                    if over.any():
                        return rows, over
            # With a delay, the command acts later, interpolated between its two ends.
            if self._delay:
                (last_command,) = self._compiled.command.at(later, self._y, self._held)
                self._commands.append(_Commands(change, later, self._first_command, last_command))
        rows, over = self._rows(times, changes, held)
        self.integration.clear()
        return rows, over

    def _rows(
        self, times: np.ndarray, changes: np.ndarray, held: list[np.ndarray]
    ) -> tuple[_Rows, np.ndarray]:
        """Return the rows at times flown, and a mask of all but the last: where the flight is over.

        held: the inputs held from each of the times `changes`
        """
        y = self.integration.rows(times)
        held_at = np.array(held)[np.searchsorted(changes[:-1], times, side="right") - 1]
        (observed,) = self._compiled.observed(times[:, None], y, held_at)
        if self._stop is None:
            over = ~np.isfinite(y[:-1, : len(self._loop.plant.point.x)]).all(axis=1)
        else:
            over = self._stop(observed[:-1, self._compiled.places.limited])
        return _Rows(times, y, observed), over

    def _hold(self, time: float) -> None:
        """Compute the inputs held from a time: gains, noise, samples of the policy, delay."""
        loop, held, parts = self._loop, self._held, self._parts
        ticks = time / loop.scenario.tick
        tick = math.floor(ticks + SAME_TIME)
        loop.hold(tick, parts, time)
        if self._sampler is not None:
            if abs(ticks - tick) <= SAME_TIME:  # not at a break within a tick
                (measured,) = self._compiled.measured.at(time, self._y, held)
                self._sampled = self._sampler(tick, measured)
            parts.policy[:] = self._sampled
        if self._delay:
            (self._first_command,) = self._compiled.command.at(time, self._y, held)
            parts.delay[:] = self._delayed(time)

    def _delayed(self, time: float) -> np.ndarray:
        """Return the part `delay` of the held inputs (`HeldParts`) from a time on."""
        due = time - self._delay + SAME_TIME
        while self._commands and self._commands[0].end <= due:
            self._commands.pop(0)
        # Before the first command arrives, the inputs are at trim, between any two times.
        if due < 0.0:
            return np.concatenate([[0.0, 1.0], np.zeros(2 * self._first_command.size)])
        begin, end, first, last = self._commands[0]
        return np.concatenate([[begin + self._delay, end + self._delay], first, last])
