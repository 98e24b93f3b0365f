"""A closed loop compiled and simulated: with all its rows, or with the numbers that sum it up."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import NamedTuple

import casadi as ca
import numpy as np

from controller.flight.closed_loop import ClosedLoop
from controller.flight.envelope import Envelope, limited_names
from controller.flight.integrator import (
    COMPILE_FROM_STEPS,
    BackwardDifferentiation,
    Constants,
    Method,
    RungeKutta,
    Stop,
    integrate,
)
from hfa_model.kinematics import angle_of_attack
from hfa_model.vectors import INPUTS, LINEAR_STATES, STATES, Quantity, State
from hfa_support.native.bound import RowsFunction
from hfa_support.progress import Progress
from hfa_support.reporting.fields import Shown
from trim.point.operating_point import OperatingPoint

_X, _Z, _U = len(STATES), len(LINEAR_STATES), len(INPUTS)
#: Steps whose outputs are computed in one go: one map of all steps takes a gigabyte.
_BLOCK = 10_000


@dataclass(frozen=True, repr=False)
class Flight(Shown):
    """What was flown, one row a step.

    times: (N,), s. states: (N, n) of the plant, deviations. errors: (N, 6), z = x - x_d, without noise.
    inputs: (N, 5), deviations. disturbances: (N, 6). memory: (N, k), the policy's own states. updrafts: (N,), ft/s.
    """

    times: np.ndarray
    states: np.ndarray
    errors: np.ndarray
    inputs: np.ndarray
    disturbances: np.ndarray
    memory: np.ndarray
    updrafts: np.ndarray


class CompiledLoop:
    """A loop as CasADi Functions of (t, y, p), compiled once, simulated many times."""

    def __init__(self, loop: ClosedLoop) -> None:
        self.loop = loop
        arguments = loop.symbols()
        now = loop.at(*arguments)
        self.rate = ca.Function("loop_rate", [*arguments], [ca.densify(now.rate)], {"cse": True})
        seen = [ca.densify(part) for part in (now.error, now.inputs, now.disturbance, now.updraft)]
        self._seen = RowsFunction(ca.Function("loop_seen", [*arguments], seen))
        self._updraft = RowsFunction(ca.Function("loop_updraft", [*arguments], [ca.densify(now.updraft)]))
        self._methods: dict[tuple[float, int, bool, bool], Method] = {}

    def fly(
        self,
        initial: np.ndarray,
        constants: Constants,
        *,
        step: float,
        steps_per_tick: int,
        ticks: int,
        memory: np.ndarray | None = None,
        stiff: bool = False,
        stop: Stop | None = None,
        progress: Progress | None = None,
    ) -> Flight:
        """From x(0) = `initial`, memory(0) = `memory`; constants: of the policy. stiff: by `BackwardDifferentiation`.

        ticks, stop, progress: as in `integrate`, with rows [t, y].
        """
        start, every = self.loop.start(initial, memory), self.loop.constants(constants)
        method = self._method(step, steps_per_tick, stiff, steps_per_tick * ticks >= COMPILE_FROM_STEPS)
        path = integrate(method, start, every, ticks, stop=stop, progress=progress)
        times, y = step * np.arange(len(path)), path[:, 1:]
        # Row i of a tick's constants belongs to the steps that begin in that tick; the last row to the last tick.
        last = (len(path) - 1) // steps_per_tick - 1
        rows = np.minimum(np.arange(len(path)) // steps_per_tick, last)
        table = np.array([every(tick).copy() for tick in range(last + 1)]).reshape(last + 1, -1)[rows]
        blocks = []
        for begin in range(0, len(path), _BLOCK):
            part = slice(begin, begin + _BLOCK)
            blocks.append(self._seen(len(times[part]), times[part, None], y[part], table[part]))
        errors, inputs, disturbances, updrafts = (np.vstack(parts) for parts in zip(*blocks, strict=True))
        states, own = self.loop.parts(y)
        return Flight(times, states, errors, inputs, disturbances, own, updrafts.ravel())

    def updrafts(self, times: np.ndarray, y: np.ndarray, p: np.ndarray) -> np.ndarray | None:
        """w at times (N,) and rows y (N, n) under the constants p of one tick, as in `Flight`; None in still air."""
        if self.loop.gust is None:
            return None
        return self._updraft(len(times), times[:, None], y, p)[0].ravel()

    def _method(self, step: float, steps_per_tick: int, stiff: bool, compile_code: bool) -> Method:
        key = step, steps_per_tick, stiff, compile_code
        if key not in self._methods:
            self._methods[key] = (
                BackwardDifferentiation(self.rate, step, steps_per_tick)
                if stiff
                else RungeKutta(self.rate, step, steps_per_tick, compile_code=compile_code)
            )
        return self._methods[key]


class Summary(NamedTuple):
    """What is kept of a flight of T seconds.

    left: index into `STATES` of the state that left the envelope first, -1 when none did; of alpha, through the air.
    flown: T, s, up to the first step outside. rms_error: sqrt(1/T ∫ z² dt), (6,), of the true error, without noise.
    peak_error: max |z|, (6,), over ground. peak_angle_of_attack: max |α_a - α0|, rad, through the air, from trim.
    effort: sqrt(1/T ∫ u² dt), (5,), of each input's deviation from trim. lowest_input, highest_input: min U and max U,
    (5,), absolute. final: x at the end, (7,), a deviation from trim. memory: the policy's own states at the end.
    """

    left: int
    flown: float
    rms_error: np.ndarray
    peak_error: np.ndarray
    peak_angle_of_attack: float
    effort: np.ndarray
    lowest_input: np.ndarray
    highest_input: np.ndarray
    final: np.ndarray
    memory: np.ndarray


class SummedLoop:
    """A seven-state loop about a trim whose flights keep no history: sums and peaks are made in the compiled loop.

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
        self._compiled, self._envelope, self._stops = CompiledLoop(loop), envelope, stops
        self._trim, self._trimmed_inputs = np.array(point.states), np.array(point.inputs)
        keep = _summed(loop, self._trim, envelope, step)
        rate = self._compiled.rate
        self._method = RungeKutta(rate, step, steps_per_tick, after_step=keep, compile_code=compile_code)

    def rate(self, y: np.ndarray, p: np.ndarray) -> np.ndarray:
        """y' at t = 0, (n,)."""
        return np.array(self._compiled.rate(0.0, y, p)).ravel()

    def fly(
        self,
        start: np.ndarray,
        constants: Constants,
        seconds: float,
        lost: Callable[[np.ndarray], bool] | None = None,
    ) -> Summary:
        """A flight of `seconds`, a whole number of ticks, from y(0) = `start` with p = constants(tick).

        lost: asked after each tick with x, (7,), of a loop that does not stop; the flight ends when it says yes.
        """
        n, method = len(start), self._method
        extremes = np.repeat([np.inf, -np.inf], _U)
        kept = np.concatenate([start, [0.0], start, np.zeros(2 * _Z + _U + 1), extremes])

        def stop(rows: np.ndarray, p: np.ndarray) -> bool:
            if self._stops:
                return bool(rows[-1, 1 + n] < rows[-1, 0])
            return lost is not None and lost(rows[-1, 1 : 1 + _X])

        ticks = round(seconds / (method.step * method.steps_per_tick))
        end = integrate(method, kept, constants, ticks, stop=stop)[-1]
        last = min(round(end[1 + n] / method.step) // method.steps_per_tick, ticks - 1)
        return self._summary(end, n, seconds, constants(last))

    def _summary(self, end: np.ndarray, n: int, seconds: float, p: np.ndarray) -> Summary:
        sizes = [1 + n, 1 + n, _Z, _Z, _U, 1, _U]
        now, kept, squares, peak, efforts, angle, lowest, highest = np.split(end, np.cumsum(sizes))
        loop = self._compiled.loop
        x, memory = loop.parts(kept[1:] if self._stops else now[1:])
        updrafts = self._compiled.updrafts(kept[:1], kept[None, 1:], p)
        departure = self._envelope.departure(kept[:1], loop.parts(kept[1:])[0][None] + self._trim, updrafts)
        if departure is None:
            left, flown = -1, seconds
        else:
            left, flown = limited_names(updrafts is not None).index(departure.state), departure.time
        lasted = flown or 1.0  # turbulence may be outside at the start: the sums are 0
        rms, effort = np.sqrt(squares / lasted), np.sqrt(efforts / lasted)
        inputs = lowest + self._trimmed_inputs, highest + self._trimmed_inputs
        return Summary(left, flown, rms, peak, float(angle[0]), effort, *inputs, x, memory)


def _summed(loop: ClosedLoop, trim: np.ndarray, envelope: Envelope, step: float) -> ca.Function:
    """([t; y], p, [t; y] one step later, kept) -> kept, kept = [t; y; ∫ z² dt; max |z|; ∫ u² dt; max |α_a - α0|; min u;
    max u], u and z as deviations.

    What is kept stays as it is from the first step outside the envelope on. The sums take z and u at the beginning of
    each step, where the Runge-Kutta step has them anyway.
    """
    t, y, p = loop.symbols()
    n = 1 + y.numel()
    moved, kept = ca.SX.sym("moved", n), ca.SX.sym("kept", n + 2 * _Z + _U + 1 + 2 * _U)
    ends = np.cumsum([0, _Z, _Z, _U, 1, _U, _U]).tolist()
    squares, peak, efforts, angle, lowest, highest = ca.vertsplit(kept[n:], ends)
    now = loop.at(t, y, p)

    def limited(t: ca.SX, y: ca.SX) -> State[Quantity]:
        X: State[Quantity] = State(*ca.vertsplit(y[:_X] + ca.DM(trim)))
        return X._replace(alpha=angle_of_attack(X, loop.updraft(t, y, p)))

    deviation = ca.fabs(limited(t, y).alpha - trim[STATES.index("alpha")])
    sums = (
        squares + step * now.error**2,
        ca.fmax(peak, ca.fabs(now.error)),
        efforts + step * now.inputs**2,
        ca.fmax(angle, deviation),
        ca.fmin(lowest, now.inputs),
        ca.fmax(highest, now.inputs),
    )
    X = ca.vertcat(*limited(kept[0], kept[1:n]))
    inside = ca.mmin(ca.logic_and(ca.DM(np.array(envelope.lowest)) <= X, ca.DM(np.array(envelope.highest)) >= X))
    later = ca.if_else(inside, ca.vertcat(moved, *sums), kept)
    return ca.Function("summed", [ca.vertcat(t, y), p, moved, kept], [later], {"cse": True})
