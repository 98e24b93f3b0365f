"""Steppers: integration of a closed loop over one tick."""

from __future__ import annotations

import contextlib
import warnings
from collections.abc import Callable
from typing import Any, Protocol

import casadi as ca
import numpy as np

from hfa_support.native.bound import BoundFunction
from hfa_support.native.machine_code import machine_code


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


class OneFlight:
    """Stepper of one flight by one compiled function of all steps in a tick."""

    def __init__(
        self, one: ca.Function, observed: ca.Function, step: float, steps: int, *, is_long: bool
    ) -> None:
        """Compile the steps of a tick.

        one: ([t; x], held) -> [t; x] after a step, and the values observed before it
        """
        self.step = step
        self.steps = steps
        self.sizes = one.numel_in(0) - 1, observed.numel_out(0)
        self._observed = observed
        begin = ca.MX.sym("begin", one.numel_in(0))
        held = ca.MX.sym("held", one.numel_in(1))
        after, before = one.mapaccum("steps", steps)(begin, ca.repmat(held, 1, steps))
        tick = ca.Function("tick", [begin, held], [after, before])
        self._tick = BoundFunction(machine_code(tick) if is_long else tick)

    def __call__(
        self, time: float, state: np.ndarray, held: np.ndarray
    ) -> tuple[np.ndarray, np.ndarray]:
        """Return the states after each step, and the values observed before it."""
        begin, held_inputs = self._tick.inputs
        begin[0] = time
        begin[1:] = state[0]
        held_inputs[:] = held
        self._tick()
        after, before = self._tick.results
        times_and_states = after.reshape(1, self.steps, -1)
        return times_and_states[:, :, 1:], before.reshape(1, self.steps, -1)

    def observed(self, time: float, state: np.ndarray, held: np.ndarray) -> np.ndarray:
        """Return the values observed at a time, (1, k)."""
        return np.array(self._observed(time, state[0], held[0])).reshape(1, -1)


class Recurrence(OneFlight):
    """Stepper of one flight x⁺ = F(x) in discrete time. Nothing is observed, and nothing held.

    after: x -> x⁺
    steps: number of steps in a tick
    """

    def __init__(self, after: ca.Function, steps: int) -> None:
        n = after.numel_in(0)
        nothing = ca.DM(0, 1)
        number, state, held = ca.MX.sym("k"), ca.MX.sym("x", n), ca.MX.sym("held", 0)
        observed = ca.Function("observed", [number, state, held], [nothing])
        begin = ca.MX.sym("begin", 1 + n)  # number of the step, which is its time, and state
        end = ca.vertcat(begin[0] + 1.0, after(begin[1:]))
        one = ca.Function("step", [begin, held], [ca.densify(end), nothing])
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
        """Return the states at the end of the tick, (1, 1, n), and nothing observed, (1, 1, 0).

        The rate depends on the state alone: `time` and `held`, (1, 0), are not used.
        """
        from scipy.integrate import odeint

        end = np.full(state.shape[1], np.nan)
        with (
            contextlib.suppress(FloatingPointError),  # the flight diverges
            warnings.catch_warnings(action="ignore"),  # of LSODA when it fails
        ):
            (_, reached), report = odeint(
                self._rates,
                state[0],
                [0.0, self.step],
                full_output=True,
                rtol=1e-7,
                atol=1e-9 * np.abs(state).max(),
                mxstep=self._most_steps,
            )
            if report["message"] == "Integration successful.":
                end = reached
        return end[None, None], np.empty((1, 1, 0))

    def observed(self, time: float, state: np.ndarray, held: np.ndarray) -> np.ndarray:
        """Return an array (1, 0)."""
        return np.empty((1, 0))

    def _rates(self, x: np.ndarray, _: float) -> np.ndarray:
        """Return x'. Raises FloatingPointError where the flight diverges."""
        self._rate.inputs[0][:] = x
        self._rate()
        rates, size = self._rate.results
        if not size[0] <= self._largest:
            raise FloatingPointError
        return rates


class RowSteps:
    """Stepper of many flights x' = f(x, held) by Runge-Kutta steps, in NumPy.

    rate: (states (N, n), held inputs (N, h)) -> x', (N, n)
    states: number of states
    steps: number of steps in a tick
    """

    def __init__(
        self,
        rate: Callable[[np.ndarray, np.ndarray], np.ndarray],
        states: int,
        step: float,
        steps: int,
    ) -> None:
        self.step = step
        self.steps = steps
        self.sizes = states, 0
        self._rate = rate

    def __call__(
        self, time: float, state: np.ndarray, held: np.ndarray
    ) -> tuple[np.ndarray, np.ndarray]:
        """Return the states after each step, (N, steps, n). Nothing else is observed."""
        after = np.empty((len(state), self.steps, state.shape[1]))
        for number in range(self.steps):
            state = rk4(lambda x, _: self._rate(x, held), state, self.step)
            after[:, number] = state
        return after, np.empty((len(state), self.steps, 0))

    def observed(self, time: float, state: np.ndarray, held: np.ndarray) -> np.ndarray:
        """Return an array (N, 0)."""
        return np.empty((len(state), 0))
