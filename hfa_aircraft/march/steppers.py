"""Steppers: integration of a closed loop over one tick."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, Protocol

import numpy as np


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
    """

    step: float
    steps: int

    def __call__(self, state: np.ndarray, held: np.ndarray) -> np.ndarray:
        """Return the states after each step, (N, steps, n), which the next call may overwrite.

        state: states at the start of the tick, (N, n)
        held: inputs held during the tick, (N, h)
        """


class RowSteps:
    """Stepper of many flights x' = f(x) without inputs by Runge-Kutta steps, in NumPy.

    rate: states (N, n) -> x', (N, n)
    step: s
    steps: number of steps in a tick
    """

    def __init__(self, rate: Callable[[np.ndarray], np.ndarray], step: float, steps: int) -> None:
        self.step = step
        self.steps = steps
        self._rate = rate

    def __call__(self, state: np.ndarray, held: np.ndarray) -> np.ndarray:
        """Return the states after each step, (N, steps, n)."""
        after = np.empty((len(state), self.steps, state.shape[1]))
        for number in range(self.steps):
            state = rk4(lambda x, _: self._rate(x), state, self.step)
            after[:, number] = state
        return after
