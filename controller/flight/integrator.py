"""One loop over the ticks of a flight, and two methods for a tick: Runge-Kutta 4 and backward differentiation."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, Protocol

import casadi as ca
import numpy as np

from hfa_support.errors import NoSolutionError
from hfa_support.native.bound import BoundFunction
from hfa_support.native.machine_code import machine_code
from hfa_support.progress import Progress

#: Runs at least this long are worth compiling to machine code.
COMPILE_FROM_STEPS = 50_000
#: Relative and absolute tolerance of each step of CVODES.
RELATIVE, ABSOLUTE = 1e-7, 1e-10

#: Tick -> constants that are held during the tick.
Constants = Callable[[int], np.ndarray]
#: Asked after each tick with its rows [t, y] and its constants: whether the run ends there.
Stop = Callable[[np.ndarray, np.ndarray], bool]


class Method(Protocol):
    """y' = f(t, y, p) over ticks. step: s. rows_per_tick: that are made of a tick. stretch: ticks in one go at most."""

    step: float
    steps_per_tick: int
    rows_per_tick: int
    stretch: int

    def rows(self, tick: int, count: int, now: np.ndarray, p: np.ndarray) -> np.ndarray | None:
        """Rows [t, y] of `count` ticks from y = `now`; None where the method cannot go on."""


def integrate(
    method: Method,
    initial: np.ndarray,
    constants: Constants,
    ticks: int,
    *,
    stop: Stop | None = None,
    progress: Progress | None = None,
) -> np.ndarray:
    """Rows [t, y], (N, 1 + n), the start first; of a method that makes one row a tick only the start and the last one.

    initial: y(0). The run ends with the first tick for which `stop` says yes. NoSolutionError, naming the time, when a
    number is no longer finite and no `stop` asks about it.
    """
    each, whole = method.rows_per_tick, method.rows_per_tick == method.steps_per_tick
    path = np.empty((1 + (ticks * each if whole else 1), 1 + len(initial)))
    path[0, 0], path[0, 1:] = 0.0, initial
    tick, end, stretch, over = 0, 0, method.stretch, False
    while tick < ticks and not over:
        p, ahead = constants(tick), 1
        if stretch > 1:
            p = p.copy()
            while ahead < min(stretch, ticks - tick) and np.array_equal(constants(tick + ahead), p):
                ahead += 1
        rows = method.rows(tick, ahead, path[end, 1:], p)
        if rows is None and ahead > 1:  # tick by tick to the one where it ends
            stretch = 1
            continue
        if rows is None or (stop is None and not np.isfinite(rows[-1]).all()):
            begin = tick * method.steps_per_tick
            first = 0 if rows is None else int(np.argmin(np.isfinite(rows).all(axis=1))) + 1
            raise NoSolutionError(
                f"the flight left every bound at t = {(begin + first) * method.step:.6g} s; the loop is unstable or the"
                " step too long"
            )
        if stop is not None and stop(rows, p):
            over = True
            rows = rows[: each * next(n for n in range(1, ahead + 1) if n == ahead or stop(rows[: n * each], p))]
        end, begin = (end + len(rows), end + 1) if whole else (1, 1)
        path[begin : end + 1] = rows
        tick += ahead
        if progress is not None:
            progress(ticks if over else tick, ticks)
    return path[: end + 1]


class RungeKutta:
    """The classical method of order 4 with a fixed step, s, as one compiled function of a tick.

    rate: (t, y (n,), p (k,)) -> y' (n,). after_step: ([t; y], p, [t; y] one step later, kept) -> kept, numbers that
    stand behind y and take the place of the history: one row a tick is made. compile_code: run as machine code.
    Source: Hairer, Norsett, Wanner, Solving Ordinary Differential Equations I, Table II.1.2.
    """

    stretch = 1

    def __init__(
        self,
        rate: ca.Function,
        step: float,
        steps_per_tick: int,
        *,
        after_step: ca.Function | None = None,
        compile_code: bool = False,
    ) -> None:
        self.step, self.steps_per_tick = step, steps_per_tick
        one = _runge_kutta_step(rate, step, after_step)
        if after_step is None:
            self.rows_per_tick, many = steps_per_tick, one.mapaccum("ticks", steps_per_tick)
        else:
            self.rows_per_tick, many = 1, one.fold(steps_per_tick)
        self._tick = BoundFunction(machine_code(many) if compile_code else many)
        whole, n = self._tick.inputs[0], one.numel_in(0) - rate.numel_in(2)
        self._time, self._now, self._p = whole[:1], whole[1:n], whole[n:]
        self._rows = self._tick.results[0].reshape(-1, len(whole))[:, :n]

    def rows(self, tick: int, count: int, now: np.ndarray, p: np.ndarray) -> np.ndarray:
        """Rows of one tick, in an array that the next call overwrites."""
        self._time[0], self._now[:], self._p[:] = tick * self.steps_per_tick * self.step, now, p
        self._tick()
        return self._rows


def _runge_kutta_step(rate: ca.Function, h: float, after_step: ca.Function | None) -> ca.Function:
    """[t; y; kept; p] -> the same one step later."""
    kind: Any = ca.SX if rate.is_a("SXFunction") else ca.MX
    t, y, p = kind.sym("t"), kind.sym("y", rate.numel_in(1)), kind.sym("p", rate.numel_in(2))
    k1 = rate(t, y, p)
    k2 = rate(t + h / 2, y + h / 2 * k1, p)
    k3 = rate(t + h / 2, y + h / 2 * k2, p)
    k4 = rate(t + h, y + h * k3, p)
    before, after = ca.vertcat(t, y), ca.vertcat(t + h, y + h / 6 * (k1 + 2 * k2 + 2 * k3 + k4))
    kept = kind.sym("kept", 0 if after_step is None else after_step.numel_in(3))
    later = kept if after_step is None else after_step(before, p, after, kept)
    return ca.Function("step", [ca.vertcat(before, kept, p)], [ca.densify(ca.vertcat(after, later, p))], {"cse": True})


class BackwardDifferentiation:
    """CVODES, whose steps and orders are its own: for modes far faster than the observed ones, mostly observers.

    Arguments as of `RungeKutta`; the rows are at multiples of `step`.
    Source: Hindmarsh et al., SUNDIALS, ACM Trans. Math. Software 31 (2005), 363-396.
    """

    stretch = 200

    def __init__(self, rate: ca.Function, step: float, steps_per_tick: int) -> None:
        self.step, self.steps_per_tick, self.rows_per_tick = step, steps_per_tick, steps_per_tick
        self._rate = rate
        self._made: dict[int, ca.Function] = {}

    def rows(self, tick: int, count: int, now: np.ndarray, p: np.ndarray) -> np.ndarray | None:
        """Rows of `count` ticks with the same constants."""
        begin = tick * self.steps_per_tick * self.step
        times = self.step * np.arange(1, count * self.steps_per_tick + 1)
        if count not in self._made:
            self._made[count] = self._integrator(times)
        try:
            found = self._made[count](x0=now, p=np.append(p, begin))
        except RuntimeError:
            return None
        rows = np.column_stack([begin + times, np.array(found["xf"]).T])
        return rows if np.isfinite(rows).all() else None

    def _integrator(self, times: np.ndarray) -> ca.Function:
        """(y, [p; t0]) -> y at t0 + each of `times`, one column each."""
        t, y = ca.SX.sym("t"), ca.SX.sym("y", self._rate.numel_in(1))
        p = ca.SX.sym("p", self._rate.numel_in(2) + 1)
        dae = {"t": t, "x": y, "p": p, "ode": self._rate(p[-1] + t, y, p[:-1])}
        quiet = {"disable_internal_warnings": True, "show_eval_warnings": False}
        # From rest it would step over a gust that begins later.
        longest = {"max_step_size": 10.0 * self.step}
        options = {"reltol": RELATIVE, "abstol": ABSOLUTE, "max_num_steps": 10_000, **longest, **quiet}
        return ca.integrator("stiff", "cvodes", dae, 0.0, times.tolist(), options)
