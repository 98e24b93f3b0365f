"""Steppers: integration of a closed loop over one tick."""

from __future__ import annotations

import contextlib
import warnings
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


class _OneFlight:
    """Stepper of one flight by one compiled function of all steps in a tick."""

    def __init__(
        self, one: ca.Function, observed: ca.Function, step: float, steps: int, *, is_long: bool
    ) -> None:
        self.step = step
        self.steps = steps
        self.sizes = one.numel_in(0) - 1, observed.numel_out(0)
        now = ca.MX.sym("x", one.numel_in(0))
        p = ca.MX.sym("p", one.numel_in(1))
        many = one.mapaccum("steps", steps)
        tick = ca.Function("tick", [now, p], list(many(now, ca.repmat(p, 1, steps))))
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


class RungeKutta(_OneFlight):
    """Stepper of one flight by the classical Runge-Kutta method.

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
        one = _step(rate, observed, step, parts)
        super().__init__(one, observed, step, steps, is_long=is_long)
        self._rate = rate
        self._parts = parts

    def over(self, time: float, state: np.ndarray, held: np.ndarray, seconds: float) -> np.ndarray:
        """Return the state (1, n) after a part of a step, at which held inputs change.

        seconds: duration of the part, s
        """
        h = seconds / self._parts
        x = ca.DM(state[0])
        for part in range(self._parts):

            def rate(y: Any, c: float, t: float = time + part * h) -> Any:
                return self._rate(t + c * h, y, held[0])

            x = rk4(rate, x, h)
        return np.array(x).reshape(1, -1)


class Recurrence(_OneFlight):
    """Stepper of one flight x⁺ = F(x) in discrete time. Nothing is observed, and nothing held.

    after: x -> x⁺
    """

    def __init__(self, after: ca.Function, steps: int) -> None:
        now = ca.MX.sym("now", 1 + after.numel_in(0))
        t, x, held = ca.MX.sym("t"), ca.MX.sym("x", after.numel_in(0)), ca.MX.sym("held", 0)
        later = ca.vertcat(now[0] + 1.0, after(now[1:]))
        one = ca.Function("step", [now, held], [ca.densify(later), ca.DM(0, 1)])
        observed = ca.Function("observed", [t, x, held], [ca.DM(0, 1)])
        super().__init__(one, observed, 1.0, steps, is_long=False)


class Adaptive:
    """Stepper of one flight x' = f(x) by LSODA with error control, in one step a tick.

    The states are not numbers where the flight diverges or the integration fails.

    rate: x -> (x', size of x)
    largest: size above which a flight diverges
    most_steps: largest number of LSODA's own steps in a tick
    """

    steps = 1

    def __init__(self, rate: ca.Function, step: float, *, largest: float, most_steps: int) -> None:
        self.step = step
        self.sizes = rate.numel_in(0), 0
        self._rate = BoundFunction(rate)
        self._largest = largest
        self._most_steps = most_steps

    def __call__(
        self, time: float, state: np.ndarray, held: np.ndarray
    ) -> tuple[np.ndarray, np.ndarray]:
        """Return the states at the end of the tick, (1, 1, n). Nothing else is observed."""
        from scipy.integrate import odeint

        tolerances = {"rtol": 1e-7, "atol": 1e-9 * np.abs(state).max(), "mxstep": self._most_steps}
        after = np.full((1, 1, state.shape[1]), np.nan)
        with (
            contextlib.suppress(FloatingPointError),
            warnings.catch_warnings(action="ignore"),  # of LSODA when it fails
        ):
            ends, outcome = odeint(
                self._slopes, state[0], [0.0, self.step], full_output=True, **tolerances
            )
            if outcome["message"] == "Integration successful.":
                after[0, 0] = ends[-1]
        return after, self.observed(time, state, held)[:, None]

    def observed(self, time: float, state: np.ndarray, held: np.ndarray) -> np.ndarray:
        """Return an array (1, 0)."""
        return np.empty((1, 0))

    def _slopes(self, x: np.ndarray, _: float) -> np.ndarray:
        """Return x'. Raises FloatingPointError where the flight diverges."""
        self._rate.inputs[0][:] = x
        self._rate()
        slopes, size = self._rate.results
        if not size[0] <= self._largest:
            raise FloatingPointError
        return slopes


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


def _step(rate: ca.Function, observed: ca.Function, step: float, parts: int) -> ca.Function:
    """Return the function ([t; x], held) -> ([t; x] after a step, values observed before it)."""
    now = ca.SX.sym("now", 1 + rate.numel_in(1))
    held = ca.SX.sym("held", rate.numel_in(2))
    t = now[0]
    h = step / parts
    later = ca.vertcat(t + h, rk4(lambda x, c: rate(t + c * h, x, held), now[1:], h))
    if parts == 1:
        columns = ca.densify(observed(now[0], now[1:], held))
        return ca.Function("step", [now, held], [ca.densify(later), columns], {"cse": True})
    both = ca.vertcat(now, held)
    part = ca.Function("part", [both], [ca.densify(ca.vertcat(later, held))], {"cse": True})
    x = ca.MX.sym("x", now.numel())
    p = ca.MX.sym("p", held.numel())
    moved = part.fold(parts)(ca.vertcat(x, p))[: now.numel()]
    return ca.Function("step", [x, p], [moved, observed(x[0], x[1:], p)])
