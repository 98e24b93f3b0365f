"""The rates and outputs of an FMU as a CasADi function, with dense derivatives.

A result of a failed call is NaN, because CasADi drops the errors of functions that are called in SX
expressions. What is NaN is no trim and no flight.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from typing import Any

import casadi as ca
import numpy as np

from hfa_fmu.library import FmuError, Instance

#: Step of the differences, relative to the nominal values. `trim.linear.nonsmooth` compares slopes
#: 3e-6 of the nominal values away on both sides.
STEP = 2e-6
#: Time at which the rates are compared with those at time 0.
_LATER = 7.381
#: Largest change of a rate that is a function of its arguments, relative to the nominal value of
#: its state.
_LARGEST_DIFFERENCE = 1e-7


class Evaluator:
    """Values f = (rates, outputs) of an FMU and their derivatives at v = (x, u, p), as arrays.

    count_of_x_and_u: number of entries of x and u
    gives_slopes: whether the FMU gives the derivatives with respect to x and u
    fault: why the last call failed, or ""
    """

    def __init__(
        self,
        instance: Instance,
        nominals: list[np.ndarray],
        count: int,
        events: tuple[str, ...],
        whole: Sequence[bool],
    ) -> None:
        """Make the evaluator.

        nominals: nominal values of x, u and p
        count: number of rates and outputs
        events: names of the event indicators
        whole: whether each of p is a whole number, which has no derivative
        """
        self.events = events
        self.nominals = np.concatenate(nominals)
        self.count_of_x_and_u = len(nominals[0]) + len(nominals[1])
        self.gives_slopes = False
        self.fault = ""
        # Bytes of v where the last call failed, and where the rates are known to be functions of v.
        self._fault_at = b""
        self._checked_at = b""
        self._nan = np.full(count, np.nan).tobytes()
        self._states, self.count = len(nominals[0]), count
        self._whole = self.count_of_x_and_u + np.flatnonzero(whole)  # places in v
        self.instance = instance

    def values(self, v: np.ndarray, time: float = 0.0) -> np.ndarray:
        """Return f, (m,). Raises FmuError if a call fails."""
        return np.frombuffer(self.instance.values(v.tobytes(), time)).copy()

    def event_among(self, points: Iterable[np.ndarray]) -> str:
        """Return name and value of an event indicator that changes its sign among points v, or "".

        Raises FmuError if a call fails.
        """
        first_signs: list[bool] = []
        for v in points if self.events else ():
            values = self.instance.indicators(v.tobytes())
            signs = [value > 0.0 for value in values]
            first_signs = first_signs or signs
            for name, value, sign, first in zip(
                self.events, values, signs, first_signs, strict=True
            ):
                if sign != first:
                    return f"{name} (now {value:.3g}) changes its sign"
        return ""

    def along(self, v: np.ndarray, direction: np.ndarray) -> np.ndarray:
        """Return the derivative of f along a direction, (m,).

        The FMU gives it, if it can and d does not change the parameters. Otherwise it is
        (f(v + h d) - f(v - h d)) / (2 h), with |h d_i| <= STEP nominal_i.

        Raises FmuError if a call fails, if the rates depend on time, or at an event.
        """
        self._refuse_time_and_memory(v)
        if self.gives_slopes and not direction[self.count_of_x_and_u :].any():
            self.refuse_events(v, direction)
            dynamics = direction[: self.count_of_x_and_u].tolist()
            return np.array(self.instance.along(v.tobytes(), dynamics))
        below, above = self.sided(v, direction, STEP)
        return 0.5 * (below + above)

    def sided(
        self, v: np.ndarray, direction: np.ndarray, step: float
    ) -> tuple[np.ndarray, np.ndarray]:
        """Return (f(v + h d) - f(v)) / h along a direction d for h < 0 and for h > 0, (m,) each.

        step: largest |h d_i|, relative to the nominal values

        Raises FmuError if a call fails, or at an event.
        """
        self.refuse_events(v, direction, step)
        middle = self.values(v)
        sides = [
            (self.values(v + h * direction) - middle) / h for h in self._steps(direction, step)
        ]
        # The direction d = 0 has no steps, and the derivative 0.
        return (sides[0], sides[1]) if sides else (0.0 * middle, 0.0 * middle)

    def refuse_events(self, v: np.ndarray, direction: np.ndarray, step: float = STEP) -> None:
        """Raise FmuError if an event indicator changes its sign within a step to either side."""
        event = self.event_among([v, *(v + h * direction for h in self._steps(direction, step))])
        if event:
            raise FmuError(f"an event of the FMU: {event} within the steps of the derivatives")

    def write_values(self, v: memoryview, result: memoryview) -> None:
        """Write f, or NaN and the reason in `fault`."""
        try:
            result[:] = self.instance.values(v)
        except FmuError as error:
            self._fail(error, v)
            result[:] = self._nan
        else:
            # The derivative at v may have failed although f exists: its fault is kept.
            if self.fault and self._fault_at != v:
                self.fault = ""

    def write_along(
        self, v: memoryview, _values: memoryview, direction: memoryview, result: memoryview
    ) -> None:
        """Write the derivative of f at v along a direction, or NaN and the reason in `fault`.

        _values: f(v), which CasADi also passes
        direction: change of v, of the same length

        CasADi asks for the derivatives by all arguments. Those by whole numbers do not exist: they
        are NaN without a reason.
        """
        changes = np.frombuffer(direction)
        if changes[self._whole].any():
            result[:] = self._nan
            return
        try:
            result[:] = self.along(np.frombuffer(v), changes).tobytes()
        except FmuError as error:
            self._fail(error, v)
            result[:] = self._nan

    def _steps(self, direction: np.ndarray, step: float) -> tuple[float, ...]:
        """Return the two factors h with the largest |h d_i| = step nominal_i, or () for d = 0."""
        length = np.abs(direction / self.nominals).max()
        return (-step / length, step / length) if length else ()

    def _fail(self, error: FmuError, v: memoryview) -> None:
        """Store why a call at v failed, if v is finite: searches also evaluate at NaN."""
        if np.isfinite(np.frombuffer(v)).all():
            self.fault, self._fault_at = str(error), v.tobytes()

    def _refuse_time_and_memory(self, v: np.ndarray) -> None:
        """Raise FmuError if the rates depend on time, or on states that were set before."""
        if self._checked_at == v.tobytes():
            return
        now = self.values(v)
        if self._differ(self.values(v, _LATER), now):
            raise FmuError("its rates depend on time")
        if self.events:
            self.instance.renew()
            if self._differ(self.values(v), now):
                raise FmuError(
                    "its rates depend on earlier states: an event has a memory, such as a "
                    "hysteresis"
                )
        self._checked_at = v.tobytes()

    def _differ(self, values: np.ndarray, others: np.ndarray) -> bool:
        """Return whether the rates in two values of f differ by more than `_LARGEST_DIFFERENCE`."""
        n = self._states  # number of rates, with which f begins
        tolerance = _LARGEST_DIFFERENCE * np.maximum(np.abs(others[:n]), self.nominals[:n])
        return bool((np.abs(values - others)[:n] > tolerance).any())


class _Callback(ca.Callback):
    """CasADi function of a column v, and of further arguments for a derivative.

    CasADi calls the methods `get_...`, `has_...` and `eval_buffer`.
    """

    def __init__(
        self,
        name: str,
        compute: Callable[..., None],
        rows: list[int],
        forward: _Callback | None = None,
    ) -> None:
        """Make a function.

        compute: writes the result, (arguments, result) as memory
        rows: numbers of entries of the arguments and of the result
        forward: function of the derivative along a direction, or None for none
        """
        ca.Callback.__init__(self)
        self._compute, self._rows, self._forward = compute, rows, forward
        self.construct(name, {})

    def get_n_in(self) -> int:
        return len(self._rows) - 1

    def get_sparsity_in(self, index: int) -> Any:
        return ca.Sparsity.dense(self._rows[index], 1)

    def get_sparsity_out(self, _: int) -> Any:
        return ca.Sparsity.dense(self._rows[-1], 1)

    def has_eval_buffer(self) -> bool:
        return True

    def eval_buffer(self, arguments: Any, results: Any) -> int:
        self._compute(*arguments, *results)
        return 0

    def has_forward(self, count: int) -> bool:
        return self._forward is not None and count == 1

    def get_forward(self, *_: Any) -> Any:
        return self._forward


#: Callbacks of the process: CasADi refers to a callback without keeping it alive.
_ALIVE_CALLBACKS: list[_Callback] = []


def casadi_function(evaluator: Evaluator) -> ca.Function:
    """Return the function v -> f."""
    n, count = len(evaluator.nominals), evaluator.count
    # Lengths of the arguments v, f(v) and direction, and of the result.
    along = _Callback("along", evaluator.write_along, [n, count, n, count])
    function = _Callback("fmu", evaluator.write_values, [n, count], along)
    _ALIVE_CALLBACKS.append(function)
    return function
