"""Integration of a flight by the classical Runge-Kutta method."""

from __future__ import annotations

from typing import Any

import casadi as ca
import numpy as np

from hfa_aircraft.march.steppers import rk4
from hfa_support.native.bound import BoundFunction
from hfa_support.native.machine_code import machine_code


class RungeKutta:
    """Stepper of one flight by the classical Runge-Kutta method, all steps of a tick at once.

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
        self._rate = rate
        self._observed = observed
        self._parts = parts
        one = _step(rate, observed, step, parts)
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


def _step(rate: ca.Function, observed: ca.Function, step: float, parts: int) -> ca.Function:
    """Return the function ([t; x], held) -> ([t; x] after a step, values observed before it)."""
    begin = ca.SX.sym("begin", 1 + rate.numel_in(1))
    held = ca.SX.sym("held", rate.numel_in(2))
    time, state = begin[0], begin[1:]
    part = step / parts
    later = rk4(lambda x, c: rate(time + c * part, x, held), state, part)
    end = ca.densify(ca.vertcat(time + part, later))
    if parts == 1:
        seen = ca.densify(observed(time, state, held))
        return ca.Function("step", [begin, held], [end, seen], {"cse": True})
    # `fold` repeats a function of a single column, which therefore carries the held inputs.
    carried = ca.vertcat(begin, held)
    one_part = ca.Function("part", [carried], [ca.vertcat(end, held)], {"cse": True})
    first = ca.MX.sym("first", begin.numel())
    inputs = ca.MX.sym("held", held.numel())
    last = one_part.fold(parts)(ca.vertcat(first, inputs))[: begin.numel()]
    return ca.Function("step", [first, inputs], [last, observed(first[0], first[1:], inputs)])
