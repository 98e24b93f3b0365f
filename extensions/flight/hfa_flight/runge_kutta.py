"""Integration of a flight by the classical Runge-Kutta method."""

from __future__ import annotations

from typing import Any

import casadi as ca
import numpy as np

from hfa_aircraft.march.steppers import OneFlight, rk4


class RungeKutta(OneFlight):
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
