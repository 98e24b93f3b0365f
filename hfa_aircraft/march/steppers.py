"""Steppers: integration of a closed loop over one tick."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, Protocol

import casadi as ca
import numpy as np

from hfa_support.native.bound import BoundFunction, RowFunction
from hfa_support.native.machine_code import machine_code
from hfa_support.native.row_code import row_code


def rk4(rate: Callable[[Any, float], Any], x: Any, h: Any) -> Any:
    """Return x after a step of h seconds by the classical Runge-Kutta method of order 4.

    rate: (x, c) -> x' at the fraction c of the step, 0, 0.5 or 1
    x: state before the step, as array or CasADi expression

    The order of operations is fixed, because stored flights are equal bit for bit. Source: Hairer,
    Norsett, Wanner, Solving Ordinary Differential Equations I, Table II.1.2.
    """
    k1 = rate(x, 0.0)
    k2 = rate(x + h / 2 * k1, 0.5)
    k3 = rate(x + h / 2 * k2, 0.5)
    k4 = rate(x + h * k3, 1.0)
    return x + h / 6 * (k1 + 2 * k2 + 2 * k3 + k4)


class Stepper(Protocol):
    """Advances flights by one tick of several integration steps.

    step: integration step, s
    steps: number of steps in a tick
    sizes: numbers (n, k) of states and of observed values
    """

    step: float
    steps: int
    sizes: tuple[int, int]

    def __call__(
        self, time: float, state: np.ndarray, held: np.ndarray
    ) -> tuple[np.ndarray, np.ndarray]:
        """Return the states after each step, (N, steps, n), and the values observed before it,
        (N, steps, k).

        The next call may overwrite both.

        time: start of the tick, s
        state: states at this time, (N, n)
        held: inputs held during the tick, (N, h)
        """

    def observed(self, time: float, state: np.ndarray, held: np.ndarray) -> np.ndarray:
        """Return the values observed at a time, (N, k)."""


class RungeKutta:
    """Stepper of one flight by the classical Runge-Kutta method, as one compiled function.

    rate: (t, x, held) -> x'
    observed: (t, x, held) -> observed values, (k,)
    parts: number of substeps in a step
    is_long: whether compilation to machine code saves time
    """

    def __init__(
        self,
        rate: ca.Function,
        observed: ca.Function,
        step: float,
        steps: int,
        *,
        parts: int = 1,
        is_long: bool = False,
    ) -> None:
        self.step = step
        self.steps = steps
        self.sizes = rate.numel_in(1), observed.numel_out(0)
        tick = _tick(rate, observed, step, steps, parts)
        self._observed = observed
        self._tick = BoundFunction(machine_code(tick) if is_long else tick)
        self._now, self._held = self._tick.inputs
        self._state = self._now[1:].reshape(1, -1)
        after, before = (result.reshape(1, steps, -1) for result in self._tick.results)
        self._results = after[:, :, 1:], before

    def __call__(
        self, time: float, state: np.ndarray, held: np.ndarray
    ) -> tuple[np.ndarray, np.ndarray]:
        """Return the states after each step, and the values observed before it."""
        self._now[0] = time
        self._state[:] = state
        self._held[:] = held
        self._tick()
        return self._results

    def observed(self, time: float, state: np.ndarray, held: np.ndarray) -> np.ndarray:
        """Return the values observed at a time, (1, k)."""
        return np.array(self._observed(time, state[0], held[0])).reshape(1, -1)


class Ticks:
    """Stepper of many flights by one compiled function, of which a tick is one step.

    after: (state, held) -> state at the end of the tick
    is_long: whether compilation to machine code saves time
    """

    steps = 1

    def __init__(self, after: ca.Function, step: float, *, is_long: bool = False) -> None:
        self.step = step
        self.sizes = after.numel_out(0), 0
        self._after = row_code(after) if is_long else RowFunction(after)

    def __call__(
        self, time: float, state: np.ndarray, held: np.ndarray
    ) -> tuple[np.ndarray, np.ndarray]:
        """Return the states at the end of the tick, (N, 1, n). Nothing else is observed."""
        (after,) = self._after(state, held)
        return after[:, None], self.observed(time, state, held)[:, None]

    def observed(self, time: float, state: np.ndarray, held: np.ndarray) -> np.ndarray:
        """Return an array (N, 0)."""
        return np.empty((len(state), 0))


def _tick(
    rate: ca.Function, observed: ca.Function, step: float, count: int, parts: int
) -> ca.Function:
    """Return the function from [t; x] and the held inputs to [t; x] after each step and the values
    observed before it.

    count: number of steps
    parts: number of substeps in a step
    """
    now = ca.SX.sym("now", 1 + rate.numel_in(1))
    held = ca.SX.sym("held", rate.numel_in(2))
    t = now[0]
    h = step / parts
    later = ca.vertcat(t + h, rk4(lambda x, c: rate(t + c * h, x, held), now[1:], h))
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
