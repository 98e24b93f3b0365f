"""A compiled rate integrated, with the whole history in one array: fixed-step Runge-Kutta 4, in chunks; and backward
differentiation (CVODES) for loops with modes far faster than what is looked at, observers mostly."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import lru_cache
from typing import Any

import casadi as ca
import numpy as np

from hfa_support.errors import BadInputError, NoSolutionError
from hfa_support.native.bound import BoundFunction
from hfa_support.native.machine_code import machine_code
from hfa_support.progress import Progress

#: Runs at least this long are worth compiling to machine code.
COMPILE_FROM_STEPS = 50_000
#: Relative and absolute tolerance of each step.
RELATIVE, ABSOLUTE = 1e-7, 1e-10
#: Ticks in one go, while nothing is handed over anew in between.
_STRETCH = 200


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
    progress: Progress | None = None,
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


def integrate_stiff(
    rate: ca.Function,
    initial: np.ndarray,
    constants: Callable[[int], np.ndarray],
    *,
    step: float,
    steps_per_tick: int,
    ticks: int,
    progress: Progress | None = None,
    stop: Callable[[np.ndarray, np.ndarray, np.ndarray], bool] | None = None,
) -> Trajectory:
    """y' = f(t, y, p) at multiples of `step`, s; arguments as in `integrator.integrate`.

    Steps and orders are chosen by the method, which starts anew where p changes. NoSolutionError, naming the time, when
    it cannot go on. Source: Hindmarsh et al., SUNDIALS, ACM Trans. Math. Software 31 (2005), 363-396.
    """
    made: dict[int, ca.Function] = {}

    def stretch(tick: int, count: int, y: np.ndarray, p: np.ndarray) -> np.ndarray | None:
        if count not in made:
            made[count] = _integrator(rate, step, steps_per_tick * count)
        try:
            found = made[count](x0=y, p=np.append(p, tick * steps_per_tick * step))
        except RuntimeError:
            return None
        rows = np.array(found["xf"]).T
        return rows if np.isfinite(rows).all() else None

    parts, y, tick, count = [np.asarray(initial, dtype=float)[None]], np.asarray(initial, dtype=float), 0, _STRETCH
    while tick < ticks:
        p = constants(tick).copy()
        ahead = 1
        while ahead < min(count, ticks - tick) and np.array_equal(constants(tick + ahead), p):
            ahead += 1
        rows = stretch(tick, ahead, y, p)
        if rows is None:
            if ahead == 1:
                raise NoSolutionError(
                    f"the flight left every bound at t = {tick * steps_per_tick * step:.6g} s; the loop is unstable"
                )
            count = 1
            continue
        times = step * (tick * steps_per_tick + np.arange(1, len(rows) + 1))
        over = False
        if stop is not None and stop(times, rows, p):
            over, first = True, 1
            while not stop(times[: first * steps_per_tick], rows[: first * steps_per_tick], p):
                first += 1
            rows = rows[: first * steps_per_tick]
        parts.append(rows)
        y, tick = rows[-1], tick + ahead
        if progress is not None:
            progress(ticks if over else tick, ticks)
        if over:
            break
    states = np.vstack(parts)
    return Trajectory(step * np.arange(len(states)), states)


def _integrator(rate: ca.Function, step: float, steps: int) -> ca.Function:
    """(y, [p; t0]) -> y at t0 + step, .., t0 + steps step, one column each."""
    t, y = ca.SX.sym("t"), ca.SX.sym("y", rate.numel_in(1))
    p = ca.SX.sym("p", rate.numel_in(2) + 1)
    dae = {"t": t, "x": y, "p": p, "ode": rate(p[-1] + t, y, p[:-1])}
    quiet = {"disable_internal_warnings": True, "show_eval_warnings": False}
    options = {"reltol": RELATIVE, "abstol": ABSOLUTE, "max_num_steps": 10_000, **quiet}
    return ca.integrator("stiff", "cvodes", dae, 0.0, (step * np.arange(1, steps + 1)).tolist(), options)
