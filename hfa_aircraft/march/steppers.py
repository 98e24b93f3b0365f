"""Steppers: integration of a closed loop over one tick."""

from __future__ import annotations

import contextlib
import warnings
from collections.abc import Callable
from typing import Any, Protocol

import casadi as ca
import numpy as np

from hfa_support.native.bound import BoundFunction


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


class Unobserved:
    """Base class of steppers that observe nothing."""

    def observed(self, time: float, state: np.ndarray, held: np.ndarray) -> np.ndarray:
        """Return an array (N, 0)."""
        return np.empty((len(state), 0))


class Recurrence(Unobserved):
    """Stepper of one flight x⁺ = F(x) in discrete time. Nothing is held.

    after: x -> x⁺
    steps: number of steps in a tick
    """

    step = 1.0

    def __init__(self, after: ca.Function, steps: int) -> None:
        self.steps = steps
        self.sizes = after.numel_in(0), 0
        x = ca.MX.sym("x", after.numel_in(0))
        one = ca.Function("step", [x], [ca.densify(after(x))])
        self._tick = BoundFunction(one.mapaccum("steps", steps))

    def __call__(
        self, time: float, state: np.ndarray, held: np.ndarray
    ) -> tuple[np.ndarray, np.ndarray]:
        """Return the states after each step, (1, steps, n), and nothing observed, (1, steps, 0)."""
        (after,) = self._tick.at(state[0])
        return after.reshape(1, self.steps, -1), np.empty((1, self.steps, 0))


class Adaptive(Unobserved):
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

    def _rates(self, x: np.ndarray, _: float) -> np.ndarray:
        """Return x'. Raises FloatingPointError where the flight diverges."""
        self._rate.inputs[0][:] = x
        self._rate()
        rates, size = self._rate.results
        if not size[0] <= self._largest:
            raise FloatingPointError
        return rates


class RowSteps(Unobserved):
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
