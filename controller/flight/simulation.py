"""A closed loop compiled and simulated: with all its rows, or with the numbers that sum it up."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import NamedTuple

import casadi as ca
import numpy as np

from controller.flight.closed_loop import ClosedLoop, Delayed
from controller.flight.envelope import ALPHA, Envelope, WindRows, flown_through_air, limited_names, through_air
from controller.flight.integrator import (
    COMPILE_FROM_STEPS,
    BackwardDifferentiation,
    Constants,
    Method,
    RungeKutta,
    Stop,
    integrate,
)
from controller.flight.plants import UPDRAFT, Sizes
from hfa_support.native.bound import RowsFunction
from hfa_support.progress import Progress
from hfa_support.reporting.fields import Shown
from trim.point.operating_point import OperatingPoint

#: Steps whose outputs are computed in one go: one map of all steps takes a gigabyte.
_BLOCK = 10_000


@dataclass(frozen=True, repr=False)
class Flight(Shown):
    """What was flown, one row a step.

    times: (N,), s. states: (N, n) of the plant, deviations. errors: (N, k), z = x - x_d, without noise.
    inputs: (N, m), deviations. disturbances: (N, k). memory: (N, l), the policy's own states. winds: disturbance of the
    model that is not 0 -> (N,).
    """

    times: np.ndarray
    states: np.ndarray
    errors: np.ndarray
    inputs: np.ndarray
    disturbances: np.ndarray
    memory: np.ndarray
    winds: WindRows

    @property
    def updrafts(self) -> np.ndarray:
        """The updraft of the air, (N,)."""
        return self.winds.get(UPDRAFT, np.zeros(len(self.times)))


class CompiledLoop:
    """A loop as CasADi Functions of (t, y, p), compiled once, simulated many times."""

    def __init__(self, loop: ClosedLoop) -> None:
        self.loop = loop
        arguments = loop.symbols()
        now = loop.at(*arguments)
        self.rate = ca.Function("loop_rate", [*arguments], [ca.densify(now.rate)], {"cse": True})
        seen = [ca.densify(part) for part in (now.error, now.inputs, now.disturbance, now.winds)]
        self._seen = RowsFunction(ca.Function("loop_seen", [*arguments], seen))
        self._winds = RowsFunction(ca.Function("loop_winds", [*arguments], [ca.densify(now.winds)]))
        self._command = ca.Function("command", [*arguments], [ca.densify(now.command)]) if loop.delay else None
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
        late = self.delayed(method)
        path = integrate(late or method, start, every, ticks, stop=stop, progress=progress)
        times, y = step * np.arange(len(path)), path[:, 1:]
        # Row i of a tick's constants belongs to the steps that begin in that tick; the last row to the last tick.
        last = (len(path) - 1) // steps_per_tick - 1
        rows = np.minimum(np.arange(len(path)) // steps_per_tick, last)
        by_tick = np.array([every(tick).copy() for tick in range(last + 1)]).reshape(last + 1, -1)
        if late is not None:
            by_tick[:, -late.handed[0].size :] = late.handed[: last + 1]
        table, blocks = by_tick[rows], []
        for begin in range(0, len(path), _BLOCK):
            part = slice(begin, begin + _BLOCK)
            blocks.append(self._seen(len(times[part]), times[part, None], y[part], table[part]))
        errors, inputs, disturbances, winds = (np.vstack(parts) for parts in zip(*blocks, strict=True))
        states, own = self.loop.parts(y)
        air = dict(zip(self.loop.wind_names, winds.T, strict=True))
        return Flight(times, states, errors, inputs, disturbances, own, air)

    def delayed(self, method: Method) -> Delayed | None:
        """The method for one flight of a loop with a delay; None for a loop without."""
        if self._command is None:
            return None
        return Delayed(method, self.loop.delay, self._command, self._command.numel_in(1))

    def winds(self, times: np.ndarray, y: np.ndarray, p: np.ndarray) -> WindRows | None:
        """Winds at times (N,) and rows y (N, n) under the constants p of one tick; None in still air."""
        if not self.loop.wind_names:
            return None
        found = self._winds(len(times), times[:, None], y, p)[0]
        return dict(zip(self.loop.wind_names, found.T, strict=True))

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
    """What is kept of a flight of T seconds, n states, k of the linear model, m inputs.

    left: index of the state that left the envelope first, -1 when none did; of alpha, through the air.
    flown: T, s, up to the first step outside. rms_error: sqrt(1/T ∫ z² dt), (k,), of the true error, without noise.
    peak_error: max |z|, (k,), over ground. peak_angle_of_attack: max |α_a - α0|, rad, through the air, from trim; 0 of
    a model without alpha. effort: sqrt(1/T ∫ u² dt), (m,), of each input's deviation from trim. lowest_input,
    highest_input: min U and max U, (m,), absolute. final: x at the end, (n,), a deviation from trim. memory: the
    policy's own states at the end.
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
    """A loop about a trim whose flights keep no history: sums and peaks are made in the compiled loop.

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

        lost: asked after each tick with x, (n,), of a loop that does not stop; the flight ends when it says yes.
        """
        n, method, sizes = len(start), self._method, self._compiled.loop.plant.sizes
        extremes = np.repeat([np.inf, -np.inf], sizes.inputs)
        kept = np.concatenate([start, [0.0], start, np.zeros(2 * sizes.seen + sizes.inputs + 1), extremes])

        def stop(rows: np.ndarray, p: np.ndarray) -> bool:
            if self._stops:
                return bool(rows[-1, 1 + n] < rows[-1, 0])
            return lost is not None and lost(rows[-1, 1 : 1 + sizes.states])

        ticks = round(seconds / (method.step * method.steps_per_tick))
        end = integrate(self._compiled.delayed(method) or method, kept, constants, ticks, stop=stop)[-1]
        last = min(round(end[1 + n] / method.step) // method.steps_per_tick, ticks - 1)
        return self._summary(end, n, seconds, constants(last), sizes)

    def _summary(self, end: np.ndarray, n: int, seconds: float, p: np.ndarray, sizes: Sizes) -> Summary:
        _, k, m = sizes
        now, kept, squares, peak, efforts, angle, lowest, highest = np.split(
            end, np.cumsum([1 + n, 1 + n, k, k, m, 1, m])
        )
        loop = self._compiled.loop
        x, memory = loop.parts(kept[1:] if self._stops else now[1:])
        winds = self._compiled.winds(kept[:1], kept[None, 1:], p)
        departure = self._envelope.departure(kept[:1], loop.parts(kept[1:])[0][None] + self._trim, winds)
        if departure is None:
            left, flown = -1, seconds
        else:
            left = limited_names(self._envelope.model, winds is not None).index(departure.state)
            flown = departure.time
        lasted = flown or 1.0  # turbulence may be outside at the start: the sums are 0
        rms, effort = np.sqrt(squares / lasted), np.sqrt(efforts / lasted)
        inputs = lowest + self._trimmed_inputs, highest + self._trimmed_inputs
        return Summary(left, flown, rms, peak, float(angle[0]), effort, *inputs, x, memory)


def _summed(loop: ClosedLoop, trim: np.ndarray, envelope: Envelope, step: float) -> ca.Function:
    """([t; y], p, [t; y] one step later, kept) -> kept, kept = [t; y; ∫ z² dt; max |z|; ∫ u² dt; max |α_a - α0|; min u;
    max u], u and z as deviations.

    From the first step outside the envelope on the kept values no longer change. The sums take z and u at the
    beginning of
    each step, where the Runge-Kutta step has them anyway.
    """
    t, y, p = loop.symbols()
    states, k, m = loop.plant.sizes
    model, n = envelope.model, 1 + y.numel()
    moved, kept = ca.SX.sym("moved", n), ca.SX.sym("kept", n + 2 * k + m + 1 + 2 * m)
    ends = np.cumsum([0, k, k, m, 1, m, m]).tolist()
    squares, peak, efforts, angle, lowest, highest = ca.vertsplit(kept[n:], ends)
    now = loop.at(t, y, p)
    alpha = list(model.states).index(ALPHA) if ALPHA in model.states else None

    def limited(t: ca.SX, y: ca.SX) -> list[ca.SX]:
        X = ca.vertsplit(y[:states] + ca.DM(trim))
        if alpha is not None and loop.wind_names and flown_through_air(model):
            X[alpha] = through_air(model, list(X), loop.winds(t, y, p))
        return list(X)

    deviation = ca.SX(0) if alpha is None else ca.fabs(limited(t, y)[alpha] - trim[alpha])
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
