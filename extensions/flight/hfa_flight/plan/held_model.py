"""Model of the aircraft over holds of its inputs, in nominal units, as machine code."""

from __future__ import annotations

from functools import cached_property
from itertools import groupby
from typing import Any, NamedTuple

import casadi as ca
import numpy as np

from hfa_aircraft.batch_simulation import rk4
from hfa_flight.plan.scaled import ScaledProblem
from hfa_flight.plan.smooth import smooth_rates
from hfa_support.native.bound import BoundFunction
from hfa_support.native.row_code import machine_code

#: Largest error of the fastest mode over a hold, x^5 / 120 for each Runge-Kutta step of x time
#: constants. The gradient of a plan at the trim is then exact to 1e-5.
_ERROR = 2.5e-6


class _Symbols(NamedTuple):
    """Symbols of states (n,), inputs (m,) and a duration, s."""

    z: ca.MX
    v: ca.MX
    seconds: ca.MX


class _EqualHolds(NamedTuple):
    """Successive holds `first` to `end` - 1 with the same number of Runge-Kutta steps."""

    steps: int
    first: int
    end: int

    @property
    def number(self) -> int:
        """Number of the holds."""
        return self.end - self.first

    def of(self, columns: Any) -> Any:
        """Return the columns of these holds."""
        return columns[:, self.first : self.end]


class HeldModel:
    """Smooth equations z' = f(z, v) over successive holds of v, in nominal units.

    scaled: the problem in nominal units
    holds: durations of the holds, s, (N,), or the largest ones, if calls give others
    """

    def __init__(self, scaled: ScaledProblem, holds: np.ndarray) -> None:
        self.scaled = scaled
        self.holds = holds
        self._rates = smooth_rates(scaled.problem)

    def __reduce__(self) -> tuple[type[HeldModel], tuple[Any, ...]]:
        """Return the constructor and its arguments, for copies and pickle."""
        return HeldModel, (self.scaled, self.holds)

    @cached_property
    def _steps_of_holds(self) -> list[int]:
        """Number of Runge-Kutta steps in each hold."""
        constants = self.holds * self.scaled.fastest
        steps = np.ceil((constants**5 / (120.0 * _ERROR)) ** 0.25)
        return np.maximum(1, steps).astype(int).tolist()

    @cached_property
    def slopes(self) -> ca.Function:
        """Function (z, v) -> rates, and their derivatives by (z, v)."""
        _, n, m = self.scaled.sizes
        both = ca.SX.sym("both", n + m)
        rates = self._rates(both)
        slopes = ca.densify(ca.jacobian(rates, both))
        return ca.Function("slopes", [both], [rates, slopes], {"cse": True})

    @cached_property
    def _step(self) -> ca.Function:
        """Function (z, v, h) -> z after one Runge-Kutta step of h seconds."""
        z, v, h = self._symbols()
        after = rk4(lambda x, _: self._rates(ca.vertcat(x, v)), z, h)
        return ca.Function("step", [z, v, h], [after])

    @cached_property
    def _step_slopes(self) -> ca.Function:
        """Function ([z, S], v, h) -> [z, S] after one Runge-Kutta step, with the derivatives S
        (n, n + m) of z by the states and inputs at the start of the hold.
        """
        _, v, h = self._symbols()
        _, n, m = self.scaled.sizes
        columns = ca.MX.sym("columns", n, 1 + n + m)

        def rates(columns: Any, _: float) -> Any:
            """Return the rates of z and S: f, and ∂f/∂z S + [0 ∂f/∂v]."""
            rate, jacobian = self.slopes(ca.vertcat(columns[:, 0], v))
            of_inputs = ca.horzcat(ca.DM.zeros(n, n), jacobian[:, n:])
            return ca.horzcat(rate, jacobian[:, :n] @ columns[:, 1:] + of_inputs)

        after = ca.densify(rk4(rates, columns, h))
        return ca.Function("step_slopes", [columns, v, h], [after])

    def _held(self, step: ca.Function, count: int) -> ca.Function:
        """Return the function (z or [z, S], v, seconds) -> z or [z, S] after a hold.

        step: a Runge-Kutta step
        count: number of the steps
        """
        begin = ca.MX.sym("begin", *step.size_in(0))
        _, v, seconds = self._symbols()
        repeated = (ca.repmat(each, 1, count) for each in (v, seconds / count))
        after = step.fold(count)(begin, *repeated)
        return ca.Function(f"{step.name()}_{count}", [begin, v, seconds], [after])

    def _symbols(self) -> _Symbols:
        """Return new symbols of states, inputs and a duration."""
        _, n, m = self.scaled.sizes
        sizes = (n, m, 1)
        return _Symbols(*(ca.MX.sym(*each) for each in zip(_Symbols._fields, sizes, strict=True)))

    @cached_property
    def _flown(self) -> BoundFunction:
        """Machine code of (z, v (m, N)) -> states after each hold, (n, N)."""
        start = self._symbols()
        inputs = ca.MX.sym("inputs", start.v.numel(), len(self.holds))
        seconds = ca.DM(self.holds).T
        last, nodes = start.z, []
        for holds in self._runs():
            flown = self._held(self._step, holds.steps).mapaccum(holds.number)
            nodes.append(flown(last, holds.of(inputs), holds.of(seconds)))
            last = nodes[-1][:, -1]
        function = ca.Function("flown", [start.z, inputs], [ca.horzcat(*nodes)])
        return BoundFunction(machine_code(function))

    @cached_property
    def _slopes(self) -> BoundFunction:
        """Machine code of (z (n, N), v (m, N), seconds) -> [z, S] after each hold,
        (n, N (1 + n + m)).
        """
        _, n, m = self.scaled.sizes
        count = len(self.holds)
        before = ca.MX.sym("before", n, count)
        inputs = ca.MX.sym("inputs", m, count)
        seconds = ca.MX.sym("seconds", 1, count)
        slopes = []
        for holds in self._runs():
            held = self._held_slopes(holds.steps).map(holds.number)
            slopes.append(held(holds.of(before), holds.of(inputs), holds.of(seconds)))
        function = ca.Function("slopes", [before, inputs, seconds], [ca.horzcat(*slopes)])
        return BoundFunction(machine_code(function))

    def _held_slopes(self, count: int) -> ca.Function:
        """Return the function (z, v, seconds) -> [z, S] (n, 1 + n + m) after `count` steps."""
        z, v, seconds = self._symbols()
        _, n, m = self.scaled.sizes
        begin = ca.horzcat(z, ca.DM.eye(n), ca.DM.zeros(n, m))
        after = self._held(self._step_slopes, count)(begin, v, seconds)
        return ca.Function(f"slopes_{count}", [z, v, seconds], [ca.densify(after)])

    def _runs(self) -> list[_EqualHolds]:
        """Return the runs of holds with equal numbers of steps, in order."""
        runs, first = [], 0
        for steps, same in groupby(self._steps_of_holds):
            end = first + len(list(same))
            runs.append(_EqualHolds(steps, first, end))
            first = end
        return runs

    @cached_property
    def sample(self) -> ca.Function:
        """Function (z, v, seconds) -> z after a hold that is not longer than the first one."""
        return self._held(self._step, self._steps_of_holds[0])

    @cached_property
    def _one(self) -> BoundFunction:
        """Machine code of `sample`."""
        return BoundFunction(machine_code(self.sample))

    def after(self, z: np.ndarray, v: np.ndarray, seconds: float) -> np.ndarray:
        """Return the states after a hold that is not longer than the first one, (n,)."""
        (moved,) = self._one.at(z, v, seconds)
        return moved

    def flown(self, z: np.ndarray, v: np.ndarray) -> np.ndarray:
        """Return the states at the ends of the holds, (N + 1, n), the initial states first.

        z: initial states, (n,)
        v: inputs during the holds, (N, m)
        """
        (after,) = self._flown.at(z, v.ravel())
        return np.vstack([z[None], after.reshape(len(v), -1)])

    def moved_along(
        self, z: np.ndarray, v: np.ndarray, seconds: np.ndarray | None = None
    ) -> tuple[np.ndarray, np.ndarray]:
        """Return the states after each hold, (N, n), and their derivatives by those before it and
        by the inputs, (N, n, n + m).

        z: states before each hold, (N, n)
        v: inputs during the holds, (N, m)
        seconds: durations of the holds, s, (N,), by default the largest
        """
        lengths = self.holds if seconds is None else seconds
        (columns,) = self._slopes.at(z.ravel(), v.ravel(), lengths)
        both = columns.reshape(len(v), -1, z.shape[1]).transpose(0, 2, 1)
        return both[:, :, 0], both[:, :, 1:]
