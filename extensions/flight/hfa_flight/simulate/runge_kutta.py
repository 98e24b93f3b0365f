"""Integration of a flight by the classical Runge-Kutta method."""

from __future__ import annotations

from copy import copy
from typing import Self

import casadi as ca
import numpy as np

from hfa_aircraft.march.steppers import rk4
from hfa_support.native.bound import BoundFunction
from hfa_support.native.machine_code import machine_code


class RungeKutta:
    """Stepper of one flight by the classical Runge-Kutta method, many steps at once.

    rate: (t, x, held) -> x'
    observed: (t, x, held) -> observed values, (k,)
    is_long: whether compilation to machine code saves time
    """

    def __init__(
        self,
        rate: ca.Function,
        observed: ca.Function,
        step: float,
        steps: int,
        *,
        is_long: bool,
    ) -> None:
        self.step = step
        self.steps = steps
        self.sizes = rate.numel_in(1), observed.numel_out(0)
        self._observed = observed
        self._calls = 1
        one = _step(rate, observed)
        begin, held, h = (ca.MX.sym("x", one.numel_in(place)) for place in range(3))
        every = (ca.repmat(each, 1, steps) for each in (held, h))
        after, before = one.mapaccum("steps", steps)(begin, *every)
        tick = ca.Function("tick", [begin, held, h], [after, before])
        self._one = BoundFunction(one)
        self._tick = BoundFunction(machine_code(tick) if is_long else tick)

    def refined(self, parts: int) -> Self:
        """Return the stepper with several steps in place of each, by the same function."""
        finer = copy(self)
        finer.step, finer.steps, finer._calls = self.step / parts, self.steps * parts, parts
        return finer

    def __call__(
        self, time: float, state: np.ndarray, held: np.ndarray
    ) -> tuple[np.ndarray, np.ndarray]:
        """Return the states after each step, (1, steps, n), and the values observed before it,
        (1, steps, k).
        """
        # The function makes some of the steps, and is called again at the state after the last.
        time_and_state, held_now, h = self._tick.inputs
        time_and_state[0], time_and_state[1:] = time, state[0]
        held_now[:], h[:] = held, self.step
        after, before = (np.empty((self._calls, part.size)) for part in self._tick.results)
        for call in range(self._calls):
            self._tick()
            after[call], before[call] = self._tick.results
            time_and_state[:] = after[call, -len(time_and_state) :]
        of_steps = (1, self.steps, -1)
        return after.reshape(of_steps)[:, :, 1:], before.reshape(of_steps)

    def observed(self, time: float, state: np.ndarray, held: np.ndarray) -> np.ndarray:
        """Return the values observed at a time, (1, k)."""
        return np.array(self._observed(time, state[0], held[0])).reshape(1, -1)

    def over(self, time: float, state: np.ndarray, held: np.ndarray, seconds: float) -> np.ndarray:
        """Return the state (1, n) after a part of a step, at which held inputs change.

        seconds: duration of the part, s
        """
        after, _ = self._one.at([time, *state[0]], held, seconds)
        return np.array(after[1:])[None]


def _step(rate: ca.Function, observed: ca.Function) -> ca.Function:
    """Return the function ([t; x], held, h) -> ([t; x] h seconds later, values observed before)."""
    begin = ca.SX.sym("begin", 1 + rate.numel_in(1))
    held = ca.SX.sym("held", rate.numel_in(2))
    h = ca.SX.sym("h")
    time, state = begin[0], begin[1:]
    later = rk4(lambda x, c: rate(time + c * h, x, held), state, h)
    end = ca.densify(ca.vertcat(time + h, later))
    seen = ca.densify(observed(time, state, held))
    return ca.Function("step", [begin, held, h], [end, seen], {"cse": True})
