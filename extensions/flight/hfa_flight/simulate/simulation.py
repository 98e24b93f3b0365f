"""Compilation and simulation of a closed loop."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import replace
from functools import cached_property, lru_cache
from itertools import pairwise
from typing import NamedTuple

import casadi as ca
import numpy as np

from hfa_flight.air.history import Deviations
from hfa_flight.air.names import ALPHA
from hfa_flight.air.scenario import Scenario
from hfa_flight.policies.policy import SAME_TIME, Policy
from hfa_flight.simulate.closed_loop import ClosedLoop, StateParts
from hfa_flight.simulate.runge_kutta import RungeKutta, step_function
from hfa_support.errors import NoSolutionError
from hfa_support.native.bound import BoundFunction, RowFunction
from hfa_support.native.row_code import machine_code
from hfa_support.progress import Progress

#: Number of ticks from which compilation to machine code saves time: measured are 10,000 for the
#: flexible aircraft and 30,000 for a JSBSim jet.
COMPILE_FROM_TICKS = 30_000
#: Number of rows between tests of whether a flight ends.
_ROWS = 1000
#: Steps longer than this part of the interval of the rows are shortened also at a jump.
_SHORTEST = 1 / 2


class CompiledLoop:
    """A closed loop, compiled once and simulated many times.

    flights: expected number of flights. With enough of them, machine code is compiled.
    """

    def __init__(self, loop: ClosedLoop, flights: int = 1) -> None:
        self.loop = loop
        t, y, held = self._arguments = loop.symbols()
        self._now = now = loop.at(t, y, held)
        observed = (now.error, now.inputs, now.winds, now.angle)
        is_long = flights * loop.scenario.ticks >= COMPILE_FROM_TICKS
        rate = self._function("loop_rate", now.rate)
        self.step = BoundFunction(_step(rate, tuple(self._nominal.tolist()), is_long))
        self.observed = _row_function(self._function("loop_observed", ca.vertcat(*observed)))
        ends = np.cumsum([0, *(column.numel() for column in observed)]).tolist()
        self._places = tuple(map(slice, ends[:-1], ends[1:]))
        # Steps are at most a tick where time acts, so that none passes over a short signal.
        self.is_driven = ca.depends_on(now.rate, t)

    def _function(self, name: str, expression: ca.SX) -> ca.Function:
        """Return the function (t, y, held) -> expression."""
        return _shared(ca.Function(name, [*self._arguments], [ca.densify(expression)]))

    @property
    def _nominal(self) -> np.ndarray:
        """Nominal value of each entry of y, 0 for the cost."""
        model = self.loop.plant.point.model
        sizes = self.loop.state_sizes
        parts = StateParts(
            plant=model.nominal(model.states),
            actuators=model.nominal(model.inputs)[: sizes.actuators],
            cost=np.zeros(sizes.cost),
        )
        return np.concatenate(parts)

    @cached_property
    def command(self) -> BoundFunction:
        """The function (t, y, held) -> command of the policy, (m,)."""
        return BoundFunction(self._function("command", self._now.command))

    @cached_property
    def measured(self) -> BoundFunction:
        """The function (t, y, held) -> states of the plant with sensor noise, (n,)."""
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
        stop: Callable[[Deviations], np.ndarray] | None = None,
        progress: Progress | None = None,
    ) -> Deviations:
        """Simulate a flight and return its time history.

        scenario: used in place of the loop's scenario. Only its numbers may differ
        parameters: parameters of the plant, for an uncertain plant
        policy: used in place of the loop's policy. Only its held inputs may differ
        ticks: number of ticks, or None for that of the scenario
        stop: function from the time history of some rows to a mask of these rows. The flight ends
            with the tick of the first row that is True
        progress: called during the flight

        Raises NoSolutionError with the time if a state is not finite and there is no `stop`.
        """
        loop = self.loop if scenario is None else replace(self.loop, scenario=scenario)
        if policy is not None:
            loop = replace(loop, policy=policy)

        def over_at(rows: _Rows) -> np.ndarray:
            """Return a mask of the rows but the last, True where the flight is over."""
            flown = self._flight(*(part[:-1] for part in rows))
            return _is_lost(flown) if stop is None else stop(flown)

        ticks = loop.scenario.ticks if ticks is None else ticks
        per_tick = loop.scenario.steps_per_tick
        window = max(1, _ROWS // per_tick)
        flying = _Flying(self, loop, ticks, window, parameters)
        parts: list[_Rows] = []
        for first in range(0, ticks, window):
            last = min(first + window, ticks)
            rows = flying.rows(first, last, over_at)
            over = over_at(rows)
            if over.any():
                last = first + math.ceil(over.argmax() / per_tick)
            ends = over.any() or last == ticks
            # The last row is the first of the next window, if there is one.
            kept = slice((last - first) * per_tick + (1 if ends else 0))
            parts.append(_Rows(*(part[kept] for part in rows)))
            if progress is not None:
                progress(ticks if ends else last, ticks)
            if ends:
                break
        flight = self._flight(*map(np.concatenate, zip(*parts, strict=True)))
        lost = _is_lost(flight)
        if stop is None and lost.any():
            raise NoSolutionError(
                f"the simulation diverges at t = {flight.times[lost.argmax()]:.6g} s; check that "
                "the policy stabilizes the aircraft"
            )
        return replace(flight, integration_error=flying.integration.error)

    def _flight(self, times: np.ndarray, rows: np.ndarray, columns: np.ndarray) -> Deviations:
        """Return the time history of some rows.

        rows, columns: states y and observed values at these times
        """
        parts = self.loop.parts(rows)
        errors, inputs, winds, angle = (columns[:, place] for place in self._places)
        limited = parts.plant
        if angle.size:  # the envelope limits it in place of alpha
            limited = parts.plant.copy()
            limited[:, list(self.loop.plant.point.model.states).index(ALPHA)] = angle[:, 0]
        air = dict(zip(self.loop.wind_names, winds.T, strict=True))
        cost = parts.cost[:, 0] if parts.cost.size else None
        return Deviations(times, parts.plant, errors, inputs, limited, air, cost)


@lru_cache(maxsize=32)
def _step(rate: ca.Function, nominal: tuple[float, ...], is_long: bool) -> ca.Function:
    """Return `step_function` of a rate, as machine code for long flights."""
    step = step_function(rate, np.array(nominal))
    return machine_code(step) if is_long else step


@lru_cache(maxsize=32)
def _row_function(observed: ca.Function) -> RowFunction:
    """Return a function as a function of rows."""
    return RowFunction(observed)


def _shared(function: ca.Function) -> ca.Function:
    """Return a function in which nothing is computed twice, the same object for equal functions.

    A function that calls Python, as that of an FMU does, has no text by which it could be equal.
    """
    called = (each.class_name() for each in function.find_functions())
    if "CallbackInternal" in called:
        return _without_repetitions(function)
    return _of_text(function.serialize())


@lru_cache(maxsize=64)
def _of_text(text: str) -> ca.Function:
    """Return the function that is serialized in a text, without repetitions."""
    return _without_repetitions(ca.Function.deserialize(text))


def _without_repetitions(function: ca.Function) -> ca.Function:
    """Return a function with the same results in which no subexpression is computed twice."""
    arguments = function.sx_in()
    return ca.Function(function.name(), arguments, function.call(arguments), {"cse": True})


class _Rows(NamedTuple):
    """Times (N,), states y (N, n) and observed values (N, k) of a flight."""

    times: np.ndarray
    states: np.ndarray
    observed: np.ndarray


class _Commands(NamedTuple):
    """Commands of a policy between two times, between which they are interpolated linearly.

    begin, end: s
    first, last: commands at these times, (m,)
    """

    begin: float
    end: float
    first: np.ndarray
    last: np.ndarray


class _Flying:
    """One flight of a closed loop under way: its state, and the inputs that are held.

    Held inputs are computed at the start of each tick if they change with it, and at each break.

    ticks: number of ticks
    window: number of ticks after which rows are returned
    """

    def __init__(
        self,
        compiled: CompiledLoop,
        loop: ClosedLoop,
        ticks: int,
        window: int,
        parameters: np.ndarray | None,
    ) -> None:
        scenario = loop.scenario
        self._compiled = compiled
        self._loop = loop
        self._y = loop.start()
        self._sampler = loop.policy.sampler()
        self._sampled = np.zeros(0)
        self._delay = scenario.delayed_ticks * scenario.tick
        self._commands: list[_Commands] = []
        self._held_from = 0.0
        self._first_command = np.zeros(0)  # of the policy at this time
        self._held = np.zeros(sum(loop.held_sizes))
        if parameters is not None:
            self._held[loop.held_slices.parameters] = parameters
        self._per_tick = scenario.steps_per_tick
        self._times = scenario.step * np.arange(ticks * self._per_tick + 1)
        changes_each_tick = self._sampler is not None or loop.changes_each_tick
        self._changes = self._changes_of_held(1 if changes_each_tick else window)
        longest = scenario.tick * (1 if compiled.is_driven else window)
        self.integration = RungeKutta(compiled.step, longest, _SHORTEST * scenario.step)

    def _changes_of_held(self, ticks: int) -> np.ndarray:
        """Return the times from which inputs are held, s: every so many ticks, and all breaks."""
        times = self._times
        breaks = self._loop.breaks
        if self._delay:
            breaks = np.concatenate([breaks, breaks + self._delay])
        breaks = breaks[breaks < times[-1]]
        row = times[np.rint(breaks / self._loop.scenario.step).astype(int)]
        breaks = np.where(np.abs(row - breaks) <= SAME_TIME, row, breaks)
        return np.unique(np.concatenate([times[:: ticks * self._per_tick], times[-1:], breaks]))

    def rows(self, first: int, last: int, over_at: Callable[[_Rows], np.ndarray]) -> _Rows:
        """Fly some ticks and return their rows. The last row is that at their end.

        A flight that requires many steps, as one that left its envelope may, ends where it is over.

        over_at: function from rows to a mask of these, True where the flight is over
        """
        times = self._times[first * self._per_tick : last * self._per_tick + 1]
        begin, end = np.searchsorted(self._changes, times[[0, -1]])
        changes = self._changes[begin : end + 1]
        held: list[np.ndarray] = []
        for change, later in pairwise(changes.tolist()):
            self._hold(change)
            held.append(self._held.copy())
            now = change
            while now < later:
                now, self._y = self.integration.advance(now, later, self._y, self._held)
                if now < later:
                    last_row = int(np.searchsorted(times, now, side="right")) - 1
                    last_of_tick = last_row - last_row % self._per_tick
                    rows = self._rows(times[: last_of_tick + 1], changes, held)
                    if over_at(rows).any():
                        return rows
            self._finish(later)
        rows = self._rows(times, changes, held)
        self.integration.clear()
        return rows

    def _rows(self, times: np.ndarray, changes: np.ndarray, held: list[np.ndarray]) -> _Rows:
        """Return the rows at times flown, with the inputs held from each change on."""
        states = self.integration.rows(times)
        held_at = np.array(held)[np.searchsorted(changes[:-1], times, side="right") - 1]
        (observed,) = self._compiled.observed(times[:, None], states, held_at)
        return _Rows(times, states, observed)

    def _hold(self, time: float) -> None:
        """Compute the inputs held from a time: gains, noise, samples of the policy, delay."""
        loop, held = self._loop, self._held
        ticks = time / loop.scenario.tick
        tick = math.floor(ticks + SAME_TIME)
        loop.hold(tick, held, time)
        if self._sampler is not None:
            if abs(ticks - tick) <= SAME_TIME:
                (measured,) = self._compiled.measured.at(time, self._y, held)
                self._sampled = self._sampler(tick, measured)
            held[loop.held_slices.policy] = self._sampled
        if self._delay:
            self._held_from = time
            (self._first_command,) = self._compiled.command.at(time, self._y, held)
            held[loop.held_slices.delay] = self._delayed(time)

    def _finish(self, time: float) -> None:
        """Store the commands of the policy since `_hold`, if they act later."""
        if self._delay:
            (last,) = self._compiled.command.at(time, self._y, self._held)
            self._commands.append(_Commands(self._held_from, time, self._first_command, last))

    def _delayed(self, time: float) -> np.ndarray:
        """Return the part `delay` of the held inputs (`HeldParts`) from a time on.

        Until the first command arrives, the commands are 0.
        """
        due = time - self._delay + SAME_TIME
        while self._commands and self._commands[0].end <= due:
            self._commands.pop(0)
        if due < 0.0:
            return np.concatenate([[0.0, 1.0], np.zeros(2 * self._first_command.size)])
        begin, end, first, last = self._commands[0]
        return np.concatenate([[begin + self._delay, end + self._delay], first, last])


def _is_lost(flight: Deviations) -> np.ndarray:
    """Return a mask (N,) of the rows at which a state of the plant is not finite."""
    return np.asarray(~np.isfinite(flight.states).all(axis=1))
