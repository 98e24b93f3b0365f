"""A loop that accumulates statistics and watches the envelope: many flights in one compiled function, no history."""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

import casadi as ca
import numpy as np

from controller.flight.closed_loop import ClosedLoop, CompiledLoop, Constants
from controller.flight.envelope import Envelope, limited_names
from controller.flight.integrator import runge_kutta_step
from hfa_model.kinematics import angle_of_attack
from hfa_model.vectors import INPUTS, LINEAR_STATES, STATES, Quantity, State
from hfa_support.native.bound import BoundFunction
from hfa_support.native.machine_code import machine_code
from trim.point.operating_point import OperatingPoint

_X, _Z, _U = len(STATES), len(LINEAR_STATES), len(INPUTS)
#: Numbers that sum up a flight: ∫ z² dt, max |z|, ∫ u² dt, max |α_a - α0|.
_SUMS = 2 * _Z + _U + 1


class Summary(NamedTuple):
    """What is kept of a flight of T seconds.

    left: index into `STATES` of the state that left the envelope first, -1 when none did; of alpha, through the air.
    flown: T, s, up to the first step outside. rms_error: sqrt(1/T ∫ z² dt), (6,), of the true error, without noise.
    peak_error: max |z|, (6,), over ground. peak_angle_of_attack: max |α_a - α0|, rad, through the air, from trim.
    effort: sqrt(1/T ∫ u² dt), (5,), of each input's deviation from trim. final: x at the end, (7,), a deviation from
    trim. memory: the policy's own states at the end.
    """

    left: int
    flown: float
    rms_error: np.ndarray
    peak_error: np.ndarray
    peak_angle_of_attack: float
    effort: np.ndarray
    final: np.ndarray
    memory: np.ndarray


class WatchedLoop:
    """A seven-state loop about a trim, flown tick by tick.

    stops: whether a flight ends at the first step outside the envelope; else it goes on, and only its sums end there.
    """

    def __init__(
        self,
        loop: ClosedLoop,
        point: OperatingPoint,
        envelope: Envelope,
        *,
        step: float,
        steps_per_tick: int,
        stops: bool,
        compile_code: bool,
    ) -> None:
        self._loop, self._envelope, self._stops = loop, envelope, stops
        self._trim, self._tick_length = np.array(point.states), step * steps_per_tick
        tick = _watched_step(loop, self._trim, envelope, step).fold(steps_per_tick)
        self._tick = BoundFunction(machine_code(tick) if compile_code else tick)
        self._updrafts = CompiledLoop(loop).updrafts

    def fly(
        self,
        start: np.ndarray,
        constants: Constants,
        seconds: float,
        stop: Callable[[np.ndarray], bool] | None = None,
    ) -> Summary:
        """A flight of `seconds`, a whole number of ticks, from y(0) = `start` with p = constants(tick).

        stop: asked after each tick with x, (7,); the flight ends when it says yes.
        """
        now, after = self._tick.inputs[0], self._tick.results[0]
        n = 1 + len(start)
        now[:] = 0.0
        now[1:n] = now[n + 1 : 2 * n] = start
        x, p = now[1 : 1 + _X], now[2 * n + _SUMS :]
        for tick in range(round(seconds / self._tick_length)):
            p[:] = constants(tick)
            self._tick()
            now[:] = after
            if (self._stops and now[n] < now[0]) or (stop is not None and stop(x)):
                break
        return self._summary(now.copy(), n, seconds)

    def _summary(self, now: np.ndarray, n: int, seconds: float) -> Summary:
        last, kept, squares, peak, efforts, angle, p = np.split(now, np.cumsum([n, n, _Z, _Z, _U, 1]))
        x, memory = self._loop.parts(kept[1:] if self._stops else last[1:])
        updrafts = self._updrafts(kept[:1], kept[None, 1:], p)
        departure = self._envelope.departure(kept[:1], self._loop.parts(kept[1:])[0][None] + self._trim, updrafts)
        if departure is None:
            left, flown = -1, seconds
        else:  # the clock of the loop is a sum of steps
            left, flown = limited_names(updrafts is not None).index(departure.state), departure.time
        lasted = flown or 1.0  # turbulence may be outside at the start: the sums are 0
        rms, effort = np.sqrt(squares / lasted), np.sqrt(efforts / lasted)
        return Summary(left, flown, rms, peak, float(angle[0]), effort, x, memory)


def _watched_step(loop: ClosedLoop, trim: np.ndarray, envelope: Envelope, step: float) -> ca.Function:
    """[t; y; what is kept; p] one Runge-Kutta step later, kept = [t; y; ∫ z² dt; max |z|; ∫ u² dt; max |α_a - α0|].

    What is kept stays as it is from the first step outside the envelope on. The sums take z and u at the beginning of
    each step, where the Runge-Kutta step has them anyway.
    """
    t, y, p = loop.symbols()
    kept = ca.SX.sym("kept", 1 + y.numel() + _SUMS)
    squares, peak, efforts, angle = ca.vertsplit(kept[1 + y.numel() :], [0, _Z, 2 * _Z, _SUMS - 1, _SUMS])
    now = loop.at(t, y, p)
    rate = ca.Function("rate", [t, y, p], [ca.densify(now.rate)])
    moved = runge_kutta_step(rate)(ca.vertcat(t, y), p, step)

    def limited(t: ca.SX, y: ca.SX) -> State[Quantity]:
        X: State[Quantity] = State(*ca.vertsplit(y[:_X] + ca.DM(trim)))
        updraft = loop.updraft(t, y, p)
        if not isinstance(updraft, ca.SX):
            return X._replace(alpha=angle_of_attack(X, updraft))
        first, *rest = (angle_of_attack(X, each) for each in ca.vertsplit(updraft))
        larger = [ca.if_else(ca.fabs(each) > ca.fabs(first), each, first) for each in rest]
        return X._replace(alpha=(*larger, first)[0])

    deviation = ca.fabs(limited(t, y).alpha - trim[STATES.index("alpha")])
    sums = (
        squares + step * now.error**2,
        ca.fmax(peak, ca.fabs(now.error)),
        efforts + step * now.inputs**2,
        ca.fmax(angle, deviation),
    )
    X = ca.vertcat(*limited(kept[0], kept[1 : 1 + y.numel()]))
    inside = ca.mmin(ca.logic_and(ca.DM(np.array(envelope.lowest)) <= X, ca.DM(np.array(envelope.highest)) >= X))
    whole = ca.vertcat(t, y, kept, p)
    result = ca.vertcat(moved, ca.if_else(inside, ca.vertcat(moved, *sums), kept), p)
    return ca.Function("watched_step", [whole], [result], {"cse": True})
