"""A closed loop compiled and simulated: one loop over its ticks."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, replace

import casadi as ca
import numpy as np

from controller.flight.actuators import LONGEST_STEP
from controller.flight.closed_loop import ClosedLoop
from controller.flight.envelope import ALPHA
from controller.flight.gusts import UPDRAFT
from controller.flight.scenario import Scenario
from hfa_support.errors import BadInputError, NoSolutionError
from hfa_support.native.bound import BoundFunction
from hfa_support.native.machine_code import machine_code
from hfa_support.progress import Progress
from hfa_support.reporting.fields import Shown

#: Runs at least this long are worth compiling to machine code.
COMPILE_FROM_STEPS = 50_000
#: Steps after which it is asked whether a flight ends, and the most parts into which the modes of a
#: law divide one.
_ROWS, _MOST_PARTS = 1000, 10_000


@dataclass(frozen=True, repr=False)
class Flight(Shown):
    """What was flown, one row a step.

    times: (N,), s. states: (N, n) of the plant, deviations. errors: (N, k), z = x - x_d, without
    noise. inputs: (N, m), deviations. memory: (N, l), the policy's own states. limited: (N, n), the
    states with alpha through the air in place of alpha. winds: disturbance of the model that is not
    0 -> (N,)."""

    times: np.ndarray
    states: np.ndarray
    errors: np.ndarray
    inputs: np.ndarray
    memory: np.ndarray
    limited: np.ndarray
    winds: dict[str, np.ndarray]

    @property
    def updrafts(self) -> np.ndarray:
        """The updraft of the air, (N,)."""
        return self.winds.get(UPDRAFT, np.zeros(len(self.times)))


class CompiledLoop:
    """A loop compiled once and simulated many times by the classical Runge-Kutta method of order 4.

    The fastest mode of the law divides each step into as many parts as it needs; BadInputError when
    these are too many. flights: how many are to come, which decides whether machine code pays.
    Source: Hairer, Norsett, Wanner, Solving Ordinary Differential Equations I, Table II.1.2."""

    def __init__(self, loop: ClosedLoop, flights: int = 1) -> None:
        self.loop, scenario = loop, loop.scenario
        parts = max(1, math.ceil(loop.law.fastest * scenario.step / LONGEST_STEP - 1e-9))
        if parts > _MOST_PARTS:
            most = LONGEST_STEP * _MOST_PARTS / scenario.step
            raise BadInputError(
                f"the law has a mode of {loop.law.fastest:.4g} 1/s; at a step of {scenario.step:g} s it must be below"
                f" {most:.3g} 1/s: make the step shorter"
            )
        arguments = loop.symbols()
        now = loop.at(*arguments)
        self.rate = ca.Function("loop_rate", [*arguments], [ca.densify(now.rate)], {"cse": True})
        seen = ca.densify(ca.vertcat(now.error, now.inputs, now.winds, now.angle))
        self._ends = np.cumsum(
            [each.numel() for each in (now.error, now.inputs, now.winds)]
        ).tolist()
        self._observed = ca.Function("loop_seen", [*arguments], [seen], {"cse": True})
        self._command = (
            ca.Function("command", [*arguments], [ca.densify(now.command)])
            if scenario.delay
            else None
        )
        self._alpha = list(loop.plant.point.model.states).index(ALPHA) if now.angle.numel() else -1
        tick = _tick(self.rate, self._observed, scenario.step, scenario.steps_per_tick, parts)
        whole = flights * scenario.ticks * scenario.steps_per_tick * parts
        self._tick = BoundFunction(machine_code(tick) if whole >= COMPILE_FROM_STEPS else tick)

    def fly(
        self,
        scenario: Scenario | None = None,
        *,
        of_plant: np.ndarray | None = None,
        ticks: int | None = None,
        stop: Callable[[Flight], np.ndarray] | None = None,
        progress: Progress | None = None,
    ) -> Flight:
        """The flight of its scenario, or of one that differs from it in numbers alone; of_plant:
        the plant's constants.

        ticks: those of the scenario unless given. stop: rows -> which of them end the flight, with
        the tick of the first one. NoSolutionError, naming the time, when a number is no longer
        finite and no `stop` asks about it."""
        loop = self.loop if scenario is None else replace(self.loop, scenario=scenario)
        step, each = loop.scenario.step, loop.scenario.steps_per_tick
        last = loop.scenario.ticks if ticks is None else ticks
        constants = loop.constants(np.zeros(0) if of_plant is None else of_plant)
        now, held = self._tick.inputs
        after, seen = (result.reshape(each, -1) for result in self._tick.results)
        # Only what is written takes memory.
        rows, observed = (
            np.empty((last * each + 1, now.size - 1)),
            np.empty((last * each + 1, seen.shape[1])),
        )
        rows[0], p, sent, done, end = loop.start(), constants(0), list[np.ndarray](), 0, last * each
        while done < end:
            begin = done
            for tick in range(done // each, min(done // each + max(1, _ROWS // each), last)):
                p = constants(tick)
                now[0], now[1:] = done * step, rows[done]
                if self._command is not None:
                    self._hand_over(tick, now, p, sent)
                held[:] = p
                self._tick()
                rows[done + 1 : done + each + 1], observed[done : done + each] = after[:, 1:], seen
                done += each
            if stop is None:
                over = ~np.isfinite(self.loop.parts(rows[begin : done + 1])[0]).all(axis=1)
            else:
                over = stop(self._flight(rows, observed, begin, done))
            if over.any():
                first = begin + int(np.argmax(over))
                if stop is None:
                    raise NoSolutionError(
                        f"the flight left every bound at t = {first * step:.6g} s; the loop is unstable or the step"
                        " too long"
                    )
                end = math.ceil(first / each) * each
            if progress is not None:
                progress(last if done >= end else done // each, last)
        if end == done:  # what is observed at the end is still to be asked
            observed[end] = np.array(self._observed(end * step, rows[end], p)).ravel()
        return self._flight(rows, observed, 0, end + 1)

    def _hand_over(self, tick: int, now: np.ndarray, p: np.ndarray, sent: list[np.ndarray]) -> None:
        """Write the commands of so many ticks ago into p, between which the loop interpolates: 0,
        the trim, before the delay has passed."""
        sent.append(np.array(self._command(now[0], now[1:], p)).ravel())  # type: ignore[misc]
        due, calm = tick - self.loop.scenario.delayed_ticks, np.zeros(sent[0].size)
        early, late = (sent[due], sent[due + 1]) if due >= 0 else (calm, calm)
        p[p.size - 1 - 2 * calm.size :] = [now[0], *early, *late]

    def _flight(self, rows: np.ndarray, observed: np.ndarray, begin: int, end: int) -> Flight:
        """Steps begin ... end - 1 of all y (N, n), and what was observed there."""
        states, memory = self.loop.parts(rows[begin:end])
        errors, inputs, winds, angle = np.split(observed[begin:end], self._ends, axis=1)
        limited = states
        if self._alpha >= 0:
            limited = states.copy()
            limited[:, self._alpha] = angle[:, 0]
        times = self.loop.scenario.step * np.arange(begin, end)
        air = dict(zip(self.loop.wind_names, winds.T, strict=True))
        return Flight(times, states, errors, inputs, memory, limited, air)


def _tick(
    rate: ca.Function, observed: ca.Function, step: float, count: int, parts: int
) -> ca.Function:
    """([t; y], p) -> [t; y] after each of the steps of a tick, and what is observed at the
    beginning of each."""
    now, p, h = (
        ca.SX.sym("now", 1 + rate.numel_in(1)),
        ca.SX.sym("p", rate.numel_in(2)),
        step / parts,
    )
    t, y = now[0], now[1:]
    k1 = rate(t, y, p)
    k2 = rate(t + h / 2, y + h / 2 * k1, p)
    k3 = rate(t + h / 2, y + h / 2 * k2, p)
    k4 = rate(t + h, y + h * k3, p)
    later = ca.vertcat(t + h, y + h / 6 * (k1 + 2 * k2 + 2 * k3 + k4))
    seen = ca.densify(observed(t, y, p))
    x, held = ca.MX.sym("x", now.numel()), ca.MX.sym("p", p.numel())
    if parts == 1:
        one = ca.Function("step", [now, p], [ca.densify(later), seen], {"cse": True})
    else:
        whole = ca.vertcat(now, p)
        part = ca.Function("part", [whole], [ca.densify(ca.vertcat(later, p))], {"cse": True}).fold(
            parts
        )
        moved = part(ca.vertcat(x, held))[: now.numel()]
        one = ca.Function("step", [x, held], [moved, observed(x[0], x[1:], held)])
    many = one.mapaccum("steps", count)
    return ca.Function("tick", [x, held], list(many(x, ca.repmat(held, 1, count))))
