"""Fixed-step Runge-Kutta 4 on a compiled rate, in chunks, with the whole history in one array."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import lru_cache
from typing import Any

import casadi as ca
import numpy as np

from hfa_model.native.bound import BoundFunction
from hfa_model.native.machine_code import machine_code
from hfa_model.support.errors import BadInputError, NoSolutionError

#: Runs at least this long are worth compiling to machine code.
COMPILE_FROM_STEPS = 50_000


@dataclass(frozen=True)
class Trajectory:
    """times: (N + 1,), s. states: (N + 1, n), y at each step, the first row being the start."""

    times: np.ndarray
    states: np.ndarray


def integrate(
    rate: ca.Function,
    initial: np.ndarray,
    constants: Callable[[int], np.ndarray],
    *,
    step: float,
    steps_per_tick: int,
    ticks: int,
    compile_code: bool | None = None,
    progress: Callable[[int, int], None] | None = None,
    stop: Callable[[np.ndarray, np.ndarray, np.ndarray], bool] | None = None,
) -> Trajectory:
    """y' = f(t, y, p) by the classical Runge-Kutta method of order 4.

    rate: (t, y (n,), p (k,)) -> y' (n,). initial: y(0). constants: tick number -> p, held during the tick.
    step: s. ticks: number of ticks of `steps_per_tick` steps. compile_code: run as machine code; by default for
    `COMPILE_FROM_STEPS` steps and more. stop: asked after every tick with its times (steps_per_tick,), states
    (steps_per_tick, n) and p; the run ends with the first tick for which it says yes. Raises NoSolutionError, naming
    the time, when a state is no longer finite, and BadInputError when a number is not positive.
    Source: Hairer, Norsett, Wanner, Solving Ordinary Differential Equations I, Table II.1.2.
    """
    for name, value in (("step", step), ("steps_per_tick", steps_per_tick), ("ticks", ticks)):
        if not value > 0:
            raise BadInputError(f"{name} is {value}; it must be positive")
    total = steps_per_tick * ticks
    use_machine_code = total >= COMPILE_FROM_STEPS if compile_code is None else compile_code
    chunk = BoundFunction(_chunk(rate, steps_per_tick, use_machine_code))
    start, p, h = chunk.inputs
    h[:] = step
    n = len(initial)
    states = np.empty((total + 1, n))
    states[0] = initial
    for tick in range(ticks):
        begin = tick * steps_per_tick
        start[0], start[1:], p[:] = begin * step, states[begin], constants(tick)
        chunk()
        rows = chunk.results[0].reshape(steps_per_tick, n + 1)[:, 1:]
        states[begin + 1 : begin + 1 + steps_per_tick] = rows
        if stop is not None and stop(step * np.arange(begin + 1, begin + 1 + steps_per_tick), rows, p):
            total = begin + steps_per_tick
            if progress is not None:
                progress(ticks, ticks)
            break
        if not np.isfinite(rows[-1]).all():
            first = int(np.argmin(np.isfinite(rows).all(axis=1)))
            raise NoSolutionError(
                f"the flight left every bound at t = {(begin + first + 1) * step:.6g} s; the loop is unstable "
                "or the step too long"
            )
        if progress is not None:
            progress(tick + 1, ticks)
    return Trajectory(step * np.arange(total + 1), states[: total + 1])


@lru_cache(maxsize=64)
def _chunk(rate: ca.Function, steps: int, use_machine_code: bool) -> ca.Function:
    """([t; y], p, h) -> [t; y] after each of `steps` steps, one column a step."""
    step = runge_kutta_step(rate)
    many = step.mapaccum("many_steps", steps)
    n, k = rate.numel_in(1), rate.numel_in(2)
    start, p, h = ca.MX.sym("start", n + 1), ca.MX.sym("p", k), ca.MX.sym("h")
    columns = many(start, ca.repmat(p, 1, steps), ca.repmat(h, 1, steps))
    function = ca.Function("flight", [start, p, h], [columns])
    return machine_code(function) if use_machine_code else function


def runge_kutta_step(rate: ca.Function) -> ca.Function:
    """([t; y], p, h) -> [t; y] one step of h later."""
    kind: Any = ca.SX if rate.is_a("SXFunction") else ca.MX
    n, k = rate.numel_in(1), rate.numel_in(2)
    start, p, h = kind.sym("start", n + 1), kind.sym("p", k), kind.sym("h")
    t, y = start[0], start[1:]
    k1 = rate(t, y, p)
    k2 = rate(t + h / 2, y + h / 2 * k1, p)
    k3 = rate(t + h / 2, y + h / 2 * k2, p)
    k4 = rate(t + h, y + h * k3, p)
    after = ca.vertcat(t + h, y + h / 6 * (k1 + 2 * k2 + 2 * k3 + k4))
    return ca.Function("step", [start, p, h], [after])
