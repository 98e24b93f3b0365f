"""Compilation and simulation of a closed loop, tick by tick."""

from __future__ import annotations

import math
from collections.abc import Callable
from copy import copy
from dataclasses import replace
from functools import cached_property
from typing import NamedTuple

import casadi as ca
import numpy as np

from hfa_aircraft.march.march import History, march
from hfa_aircraft.march.steppers import Stepper
from hfa_flight.air.history import Deviations
from hfa_flight.air.names import ALPHA
from hfa_flight.air.scenario import Scenario
from hfa_flight.policies.policy import SAME_TIME, Policy
from hfa_flight.simulate.closed_loop import ClosedLoop
from hfa_flight.simulate.runge_kutta import RungeKutta
from hfa_support.errors import NoSolutionError
from hfa_support.native.bound import BoundFunction
from hfa_support.progress import Progress

#: Number of steps from which compilation to machine code saves time.
COMPILE_FROM_STEPS = 50_000
#: Number of steps between tests of whether a flight ends.
_ROWS = 1000


class CompiledLoop:
    """A closed loop, compiled once and simulated many times.

    The integration is the classical Runge-Kutta method of order 4.

    flights: expected number of flights. With enough of them, machine code is compiled.
    """

    def __init__(self, loop: ClosedLoop, flights: int = 1) -> None:
        self.loop = loop
        arguments = loop.symbols()
        now = loop.at(*arguments)
        observed = (now.error, now.inputs, now.winds, now.angle)
        rate = ca.Function("loop_rate", [*arguments], [ca.densify(now.rate)], {"cse": True})
        seen = ca.Function(
            "loop_observed", [*arguments], [ca.densify(ca.vertcat(*observed))], {"cse": True}
        )
        self._ends = np.cumsum([column.numel() for column in observed[:-1]]).tolist()
        command = ca.Function("command", [*arguments], [ca.densify(now.command)])
        measured = ca.Function("measured", [*arguments], [ca.densify(now.measured)])
        self._command = BoundFunction(command)
        self._measured = BoundFunction(measured)
        self._alpha = -1
        if now.angle.numel():
            self._alpha = list(loop.plant.point.model.states).index(ALPHA)
        scenario = loop.scenario
        step, steps = scenario.step, scenario.steps_per_tick
        is_long = flights * scenario.ticks * steps >= COMPILE_FROM_STEPS
        self.stepper = RungeKutta(rate, seen, step, steps, is_long=is_long)

    @cached_property
    def growth(self) -> float:
        """Largest growth of a mode of the linear loop, 1/s, or 0 if no mode is known to grow."""
        return float(self.loop.growing_modes().real.max(initial=0.0))

    def refined(self, parts: int) -> CompiledLoop:
        """Return the loop with several recorded steps in place of each."""
        finer = copy(self)
        finer.stepper = self.stepper.refined(parts)
        return finer

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
        stop: function from the time history of some steps to a mask of these steps. The flight ends
            with the tick of the first step that is True
        progress: called during the flight

        Raises NoSolutionError with the time if a state is not finite and there is no `stop`.
        """
        loop = self.loop if scenario is None else replace(self.loop, scenario=scenario)
        if policy is not None:
            loop = replace(loop, policy=policy)
        flying = _Flying(loop, self.stepper, self._measured, self._command, parameters)

        def over(rows: History) -> np.ndarray:
            flown = self._flight(rows.times[:-1], rows.states[0, :-1], rows.seen[0])
            return (_is_lost(flown) if stop is None else stop(flown))[None]

        last_tick = loop.scenario.ticks if ticks is None else ticks
        window = max(1, _ROWS // self.stepper.steps)
        rows, ends = march(flying, last_tick, over=over, window=window, progress=progress)
        flown = slice(ends[0] + 1)
        flight = self._flight(rows.times[flown], rows.states[0, flown], rows.seen[0, flown])
        lost = _is_lost(flight)
        if stop is None and lost.any():
            raise NoSolutionError(
                f"the simulation diverges at t = {flight.times[lost.argmax()]:.6g} s; check that "
                "the policy stabilizes the aircraft, or shorten the step"
            )
        return flight

    def _flight(self, times: np.ndarray, rows: np.ndarray, columns: np.ndarray) -> Deviations:
        """Return the time history of some steps."""
        parts = self.loop.parts(rows)
        errors, inputs, winds, angle = np.split(columns, self._ends, axis=1)
        limited = parts.plant
        if self._alpha >= 0:
            limited = parts.plant.copy()
            limited[:, self._alpha] = angle[:, 0]
        air = dict(zip(self.loop.wind_names, winds.T, strict=True))
        cost = parts.cost[:, 0] if parts.cost.size else None
        return Deviations(times, parts.plant, errors, inputs, limited, air, cost)


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
    """One flight of a closed loop for `march`, and its stepper, which breaks ticks at steps.

    At each break, as at the start of a tick, the held inputs are computed anew.
    """

    def __init__(
        self,
        loop: ClosedLoop,
        runge_kutta: RungeKutta,
        measured: BoundFunction,
        command: BoundFunction,
        parameters: np.ndarray | None,
    ) -> None:
        self.stepper: Stepper = self
        self.step, self.steps, self.sizes = runge_kutta.step, runge_kutta.steps, runge_kutta.sizes
        self._runge_kutta = runge_kutta
        self._loop = loop
        self._sampler = loop.policy.sampler()
        self._sampled = np.zeros(0)
        self._measured = measured
        self._command = command
        self._delay = loop.scenario.delayed_ticks * loop.scenario.tick
        self._commands: list[_Commands] = []
        self._held = np.zeros((1, sum(loop.held_sizes)))
        if parameters is not None:
            self._held[0, loop.held_slices.parameters] = parameters
        self._tick = 0
        self._resumed = 0.0, np.zeros(0)
        self._breaks = self._breaks_by_tick()

    def start(self) -> np.ndarray:
        """Return y at time 0, (1, size)."""
        return self._loop.start()[None]

    def hold(self, tick: int, time: float, state: np.ndarray, flying: np.ndarray) -> np.ndarray:
        """Return the held inputs of a tick: gains and noise of the tick, sampled policy, delay."""
        self._tick = tick
        if self._sampler is not None:
            self._loop.hold(tick, self._held[0])
            (measured,) = self._measured.at(time, state[0], self._held[0])
            self._sampled = self._sampler(tick, measured)
            self._hold_commands(time, state)
        else:
            self._resume(time, state)
        return self._held

    def __call__(
        self, time: float, state: np.ndarray, held: np.ndarray
    ) -> tuple[np.ndarray, np.ndarray]:
        """Return the states after each step of a tick, and the values observed before it."""
        breaks = self._breaks.get(self._tick, [])
        advance = self._broken if breaks else self._runge_kutta
        after, before = advance(time, state, held)
        if self._delay:
            self._finish(time + self.steps * self.step, after[:, -1])
        return after, before

    def observed(self, time: float, state: np.ndarray, held: np.ndarray) -> np.ndarray:
        """Return the values observed at a time, (1, k)."""
        return self._runge_kutta.observed(time, state, held)

    def _broken(
        self, time: float, state: np.ndarray, held: np.ndarray
    ) -> tuple[np.ndarray, np.ndarray]:
        """Return the same as a call, for a tick in which held inputs change."""
        left = list(self._breaks[self._tick])
        after = np.empty((1, self.steps, self.sizes[0]))
        before = np.empty((1, self.steps, self.sizes[1]))
        for number in range(self.steps):
            now, end = (time + (number + more) * self.step for more in (0, 1))
            is_observed = False
            while now < end:
                if left and left[0] <= now + SAME_TIME:
                    left.pop(0)
                    self._finish(now, state)
                    self._resume(now, state)
                if not is_observed:
                    before[:, number] = self.observed(now, state, held)
                    is_observed = True
                later = left[0] if left and left[0] < end - SAME_TIME else end
                state = self._runge_kutta.over(now, state, held, later - now)
                now = later
            after[:, number] = state
        return after, before

    def _resume(self, time: float, state: np.ndarray) -> None:
        """Compute the held inputs from a time on."""
        self._loop.hold(self._tick, self._held[0], time)
        self._hold_commands(time, state)

    def _hold_commands(self, time: float, state: np.ndarray) -> None:
        """Write the commands of the policy and the delay into the held inputs of a time."""
        loop, held = self._loop, self._held[0]
        if self._sampler is not None:
            held[loop.held_slices.policy] = self._sampled
        if self._delay:
            (command,) = self._command.at(time, state[0], held)
            self._resumed = time, np.array(command)
            held[loop.held_slices.delay] = self._delayed(time)

    def _finish(self, time: float, state: np.ndarray) -> None:
        """Store the commands since the held inputs were computed, for a delay."""
        if self._delay:
            begin, first = self._resumed
            (command,) = self._command.at(time, state[0], self._held[0])
            self._commands.append(_Commands(begin, time, first, np.array(command)))

    def _delayed(self, time: float) -> np.ndarray:
        """Return the delay's held inputs from a time on. Before the first command, they are 0."""
        due = time - self._delay + SAME_TIME
        while self._commands and self._commands[0].end <= due:
            self._commands.pop(0)
        if due < 0.0:
            return np.concatenate([[0.0, 1.0], np.zeros(2 * self._resumed[1].size)])
        begin, end, first, last = self._commands[0]
        return np.concatenate([[begin + self._delay, end + self._delay], first, last])

    def _breaks_by_tick(self) -> dict[int, list[float]]:
        """Return number of a tick -> times in it at which held inputs change, s, increasing."""
        times = self._loop.breaks
        if self._delay:
            times = np.unique(np.concatenate([times, times + self._delay]))
        inside: dict[int, list[float]] = {}
        for time in times.tolist():
            tick = math.floor(time / self._loop.scenario.tick + SAME_TIME)
            if time - tick * self._loop.scenario.tick > SAME_TIME:
                inside.setdefault(tick, []).append(time)
        return inside


def _is_lost(flight: Deviations) -> np.ndarray:
    """Return a mask (N,) of the steps at which a state of the plant is not finite."""
    return np.asarray(~np.isfinite(flight.states).all(axis=1))
