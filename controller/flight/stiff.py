"""Backward differentiation (CVODES) for loops with modes far faster than what is looked at: observers, mostly."""

from __future__ import annotations

from collections.abc import Callable

import casadi as ca
import numpy as np

from controller.flight.integrator import Trajectory
from hfa_model.jobs.interrupts import held_back
from hfa_model.support.errors import NoSolutionError

#: Relative and absolute tolerance of each step.
RELATIVE, ABSOLUTE = 1e-7, 1e-10
#: Ticks in one go, while nothing is handed over anew in between.
_STRETCH = 200


def integrate_stiff(
    rate: ca.Function,
    initial: np.ndarray,
    constants: Callable[[int], np.ndarray],
    *,
    step: float,
    steps_per_tick: int,
    ticks: int,
    progress: Callable[[int, int], None] | None = None,
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
            with held_back():  # CVODES takes an exception of a signal for a failure of f, says so, and tries again
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
