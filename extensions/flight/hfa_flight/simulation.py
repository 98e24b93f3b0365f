"""Compilation and simulation of a closed loop, tick by tick."""

from __future__ import annotations

import math
from collections.abc import Callable
from copy import copy
from dataclasses import replace

import casadi as ca
import numpy as np

from hfa_aircraft.march.march import History, march
from hfa_aircraft.march.steppers import RungeKutta, Stepper
from hfa_flight.actuators import LONGEST_STEP
from hfa_flight.air.names import ALPHA
from hfa_flight.closed_loop import ClosedLoop
from hfa_flight.history import Deviations
from hfa_flight.policies.policy import Policy
from hfa_flight.scenario import Scenario
from hfa_support.errors import BadInputError, NoSolutionError
from hfa_support.native.bound import BoundFunction
from hfa_support.progress import Progress

#: Number of steps from which compilation to machine code saves time.
COMPILE_FROM_STEPS = 50_000
#: Number of steps between tests of whether a flight ends.
_ROWS = 1000
#: Largest number of substeps that the fastest mode of a policy may require.
_MOST_PARTS = 10_000


class CompiledLoop:
    """A closed loop, compiled once and simulated many times.

    The integration is the classical Runge-Kutta method of order 4, with substeps according to the
    policy's fastest mode.

    flights: expected number of flights. With enough of them, machine code is compiled.

    Raises BadInputError if the fastest mode requires too many substeps.
    """

    def __init__(self, loop: ClosedLoop, flights: int = 1) -> None:
        self.loop = loop
        arguments = loop.symbols()
        now = loop.at(*arguments)
        observed = (now.error, now.inputs, now.winds, now.angle)
        self.rate = ca.Function("loop_rate", [*arguments], [ca.densify(now.rate)], {"cse": True})
        self.observed = ca.Function(
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
        self._flights = flights
        self.stepper = self._runge_kutta(1)

    def refined(self, parts: int) -> CompiledLoop:
        """Return the loop with several Runge-Kutta steps in place of each."""
        finer = copy(self)
        finer.stepper = self._runge_kutta(parts)
        return finer

    def _runge_kutta(self, parts: int) -> Stepper:
        """Return the stepper of the Runge-Kutta method, as machine code if that saves time."""
        scenario = self.loop.scenario
        parts *= _parts_of_a_step(self.loop)
        steps = scenario.steps_per_tick
        is_long = self._flights * scenario.ticks * steps * parts >= COMPILE_FROM_STEPS
        return RungeKutta(
            self.rate, self.observed, scenario.step, steps, parts=parts, is_long=is_long
        )

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
        return Deviations(times, parts.plant, errors, inputs, parts.memory, limited, air)


class _Flying:
    """One flight of a closed loop, for `march`."""

    def __init__(
        self,
        loop: ClosedLoop,
        stepper: Stepper,
        measured: BoundFunction,
        command: BoundFunction,
        parameters: np.ndarray | None,
    ) -> None:
        self.stepper = stepper
        self._loop = loop
        self._sampler = loop.policy.sampler()
        self._measured = measured
        self._command = command
        self._late = loop.scenario.delayed_ticks
        self._commands: list[np.ndarray] = []
        self._held = np.zeros((1, sum(loop.held_sizes)))
        if parameters is not None:
            self._held[0, loop.held_slices.parameters] = parameters

    def start(self) -> np.ndarray:
        """Return y at time 0, (1, size)."""
        return self._loop.start()[None]

    def hold(self, tick: int, time: float, state: np.ndarray, flying: np.ndarray) -> np.ndarray:
        """Return the held inputs of a tick: gains and noise of the tick, sampled policy, delay."""
        loop = self._loop
        held = self._held[0]
        loop.hold(tick, held)
        if self._sampler is not None:
            (measured,) = self._measured.at(time, state[0], held)
            held[loop.held_slices.policy] = self._sampler(tick, measured)
        if self._late:
            (command,) = self._command.at(time, state[0], held)
            self._commands.append(command)
            held[loop.held_slices.delay] = self._delayed(tick, time)
        return self._held

    def _delayed(self, tick: int, time: float) -> np.ndarray:
        """Return the delay's held inputs of a tick, [time; u_0; u_1], (1 + 2 m,)."""
        # u_0 and u_1 are the delayed commands at this tick and at the next one. The loop
        # interpolates between both. Until the delay has passed, they are 0, the trim.
        due = tick - self._late
        if due < 0:
            return np.concatenate([[time], np.zeros(2 * self._commands[0].size)])
        return np.concatenate([[time], self._commands[due], self._commands[due + 1]])


def _is_lost(flight: Deviations) -> np.ndarray:
    """Return a mask (N,) of the steps at which a state of the plant is not finite."""
    return np.asarray(~np.isfinite(flight.states).all(axis=1))


def _parts_of_a_step(loop: ClosedLoop) -> int:
    """Return the Runge-Kutta substeps per step that the policy's fastest mode requires."""
    step = loop.scenario.step
    parts = max(1, math.ceil(loop.policy.fastest * step / LONGEST_STEP - 1e-9))
    if parts > _MOST_PARTS:
        raise BadInputError(
            f"the policy has a mode of {loop.policy.fastest:.4g} 1/s, but a step of {step:g} s"
            f" permits at most {LONGEST_STEP * _MOST_PARTS / step:.3g} 1/s; shorten the step"
        )
    return parts
