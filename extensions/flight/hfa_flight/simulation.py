"""Compilation and simulation of a closed loop, tick by tick."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import replace
from typing import Protocol

import casadi as ca
import numpy as np

from hfa_flight.actuators import LONGEST_STEP
from hfa_flight.air.names import ALPHA
from hfa_flight.closed_loop import ClosedLoop
from hfa_flight.history import Deviations
from hfa_flight.policies.policy import Policy
from hfa_flight.scenario import Scenario
from hfa_support.errors import BadInputError, NoSolutionError
from hfa_support.native.bound import BoundFunction
from hfa_support.native.machine_code import machine_code
from hfa_support.progress import Progress

#: Number of steps from which compilation to machine code saves time.
COMPILE_FROM_STEPS = 50_000
#: Number of steps between tests of whether a flight ends.
_ROWS = 1000
#: Largest number of substeps that the fastest mode of a policy may require.
_MOST_PARTS = 10_000


class Tick(Protocol):
    """Callable that advances a loop by one tick of several integration steps, in place.

    inputs: [t; y] at the start of the tick, and the held inputs.
    results: [t; y] after each step, and the observed values before each step.
    """

    inputs: tuple[np.ndarray, ...]
    results: tuple[np.ndarray, ...]

    def __call__(self) -> None:
        """Compute the results from the inputs, in place."""


class CompiledLoop:
    """A closed loop, compiled once and simulated many times.

    By default, the integration is the classical Runge-Kutta method of order 4, with substeps
    according to the policy's fastest mode. Source: Hairer, Norsett, Wanner, Solving Ordinary
    Differential Equations I, Table II.1.2.

    flights: expected number of flights. With enough of them, machine code is compiled.
    tick: function from this loop to the `Tick` that advances it, in place of Runge-Kutta.

    Raises BadInputError if the fastest mode requires too many substeps.
    """

    def __init__(
        self,
        loop: ClosedLoop,
        flights: int = 1,
        tick: Callable[[CompiledLoop], Tick] | None = None,
    ) -> None:
        self.loop = loop
        arguments = loop.symbols()
        now = loop.at(*arguments)
        observed = (now.error, now.inputs, now.winds, now.angle)
        self.rate = ca.Function("loop_rate", [*arguments], [ca.densify(now.rate)], {"cse": True})
        self._observed = ca.Function(
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
        self._tick = self._runge_kutta(flights) if tick is None else tick(self)

    def _runge_kutta(self, flights: int) -> Tick:
        """Return the tick of the Runge-Kutta method, as machine code if that saves time."""
        scenario = self.loop.scenario
        parts = _parts_of_a_step(self.loop)
        tick = _tick(self.rate, self._observed, scenario.step, scenario.steps_per_tick, parts)
        steps = flights * scenario.ticks * scenario.steps_per_tick * parts
        return BoundFunction(machine_code(tick) if steps >= COMPILE_FROM_STEPS else tick)

    def observed_at(self, time: float, y: np.ndarray, held: np.ndarray) -> np.ndarray:
        """Return the observed values of the loop at a time, as one array.

        The values are, in this order, the error, the inputs, the disturbances of the scenario and
        the angle of attack relative to the air.

        time: s
        y: state of the loop
        held: held inputs
        """
        return np.array(self._observed(time, y, held)).ravel()

    def inputs_in(self, observed: np.ndarray) -> np.ndarray:
        """Return the deviations of the plant inputs, (m,), from a result of `observed_at`."""
        return observed[self._ends[0] : self._ends[1]]

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
        steps = loop.scenario.steps_per_tick
        last_tick = loop.scenario.ticks if ticks is None else ticks
        now, held = self._tick.inputs
        after, observed = (result.reshape(steps, -1) for result in self._tick.results)
        held[:] = 0.0
        sampler = loop.policy.sampler()
        if parameters is not None:
            held[loop.held_slices.parameters] = parameters
        # Memory is allocated only for the rows that are written.
        rows = np.empty((last_tick * steps + 1, now.size - 1))
        columns = np.empty((last_tick * steps + 1, observed.shape[1]))
        rows[0] = loop.start()
        commands: list[np.ndarray] = []
        done = 0
        end = last_tick * steps
        while done < end:
            begin = done
            first_tick = done // steps
            for tick in range(first_tick, min(first_tick + max(1, _ROWS // steps), last_tick)):
                now[0] = done * loop.scenario.step
                now[1:] = rows[done]
                loop.hold(tick, held)
                if sampler is not None:
                    (measured,) = self._measured.at(now[0], now[1:], held)
                    held[loop.held_slices.policy] = sampler(tick, measured)
                if loop.scenario.delayed_ticks:
                    (command,) = self._command.at(now[0], now[1:], held)
                    commands.append(command)
                    held[loop.held_slices.delay] = self._delayed(tick, now[0], commands)
                self._tick()
                rows[done + 1 : done + steps + 1] = after[:, 1:]
                columns[done : done + steps] = observed
                done += steps
            over = self._over(rows, columns, begin, done, stop)
            if over.any():
                end = math.ceil((begin + int(np.argmax(over))) / steps) * steps
            if progress is not None:
                progress(last_tick if done >= end else done // steps, last_tick)
        if end == done:  # the observed values at the end are still missing
            time = end * loop.scenario.step
            columns[end] = self.observed_at(time, rows[end], held)
        return self._flight(rows, columns, 0, end + 1)

    def _over(
        self,
        rows: np.ndarray,
        columns: np.ndarray,
        begin: int,
        done: int,
        stop: Callable[[Deviations], np.ndarray] | None,
    ) -> np.ndarray:
        """Return a mask of the steps `begin` to `done`, True where the flight ends.

        Without `stop`, the mask is False, and NoSolutionError with the time is raised if a state is
        not finite.

        rows: y of all steps
        columns: observed values of all steps
        stop: as in `fly`
        """
        if stop is not None:
            return stop(self._flight(rows, columns, begin, done))
        lost = ~np.isfinite(self.loop.parts(rows[begin : done + 1]).plant).all(axis=1)
        if lost.any():
            time = (begin + int(np.argmax(lost))) * self.loop.scenario.step
            raise NoSolutionError(
                f"the simulation diverges at t = {time:.6g} s; check that the policy stabilizes "
                "the aircraft, or shorten the step"
            )
        return lost

    def _delayed(self, tick: int, time: float, commands: list[np.ndarray]) -> np.ndarray:
        """Return the delay's held inputs of a tick, [time; u_0; u_1], (1 + 2 m,).

        u_0 and u_1 are the delayed commands at this tick and at the next one. The loop interpolates
        between both. Until the delay has passed, they are 0, the trim.

        time: start of the tick, s
        commands: commands u, (m,), at the ticks so far
        """
        due = tick - self.loop.scenario.delayed_ticks
        if due < 0:
            return np.concatenate([[time], np.zeros(2 * commands[0].size)])
        return np.concatenate([[time], commands[due], commands[due + 1]])

    def _flight(self, rows: np.ndarray, columns: np.ndarray, begin: int, end: int) -> Deviations:
        """Return the time history of the steps `begin` to `end` - 1.

        rows: y of all steps
        columns: observed values of all steps
        """
        parts = self.loop.parts(rows[begin:end])
        errors, inputs, winds, angle = np.split(columns[begin:end], self._ends, axis=1)
        limited = parts.plant
        if self._alpha >= 0:
            limited = parts.plant.copy()
            limited[:, self._alpha] = angle[:, 0]
        times = self.loop.scenario.step * np.arange(begin, end)
        air = dict(zip(self.loop.wind_names, winds.T, strict=True))
        return Deviations(times, parts.plant, errors, inputs, parts.memory, limited, air)


def _parts_of_a_step(loop: ClosedLoop) -> int:
    """Return the number of Runge-Kutta substeps per step that the policy's fastest mode requires.

    Raises BadInputError if this number exceeds `_MOST_PARTS`.
    """
    step = loop.scenario.step
    parts = max(1, math.ceil(loop.policy.fastest * step / LONGEST_STEP - 1e-9))
    if parts > _MOST_PARTS:
        raise BadInputError(
            f"the policy has a mode of {loop.policy.fastest:.4g} 1/s, but a step of {step:g} s"
            f" permits at most {LONGEST_STEP * _MOST_PARTS / step:.3g} 1/s; shorten the step"
        )
    return parts


def _tick(
    rate: ca.Function, observed: ca.Function, step: float, count: int, parts: int
) -> ca.Function:
    """Return the CasADi Function that advances a loop by one tick with the Runge-Kutta method.

    The Function maps [t; y] and the held inputs to [t; y] after each step and the observed values
    before each step.

    step: s
    count: number of steps in a tick
    parts: number of substeps in a step
    """
    now = ca.SX.sym("now", 1 + rate.numel_in(1))
    held = ca.SX.sym("held", rate.numel_in(2))
    later = _runge_kutta(rate, now, held, step / parts)
    x = ca.MX.sym("x", now.numel())
    p = ca.MX.sym("p", held.numel())
    if parts == 1:
        columns = ca.densify(observed(now[0], now[1:], held))
        one = ca.Function("step", [now, held], [ca.densify(later), columns], {"cse": True})
    else:
        both = ca.vertcat(now, held)
        part = ca.Function("part", [both], [ca.densify(ca.vertcat(later, held))], {"cse": True})
        moved = part.fold(parts)(ca.vertcat(x, p))[: now.numel()]
        one = ca.Function("step", [x, p], [moved, observed(x[0], x[1:], p)])
    many = one.mapaccum("steps", count)
    return ca.Function("tick", [x, p], list(many(x, ca.repmat(p, 1, count))))


def _runge_kutta(rate: ca.Function, now: ca.SX, held: ca.SX, h: float) -> ca.SX:
    """Return [t; y] after one step of h seconds with the Runge-Kutta method of order 4.

    rate: y' as a function of t, y and the held inputs
    now: [t; y] before the step
    """
    t = now[0]
    y = now[1:]
    k1 = rate(t, y, held)
    k2 = rate(t + h / 2, y + h / 2 * k1, held)
    k3 = rate(t + h / 2, y + h / 2 * k2, held)
    k4 = rate(t + h, y + h * k3, held)
    return ca.vertcat(t + h, y + h / 6 * (k1 + 2 * k2 + 2 * k3 + k4))
