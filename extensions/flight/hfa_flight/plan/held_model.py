"""Model of the aircraft over holds of its inputs, in nominal units, as machine code."""

from __future__ import annotations

from functools import cached_property
from itertools import groupby
from typing import Any

import casadi as ca
import numpy as np

from hfa_aircraft.march.steppers import rk4
from hfa_flight.plan.scaled import ScaledProblem
from hfa_flight.plan.smooth import smooth_rates
from hfa_support.native.bound import BoundFunction
from hfa_support.native.machine_code import machine_code

#: Largest error of the fastest mode over a hold, x^5 / 120 for each Runge-Kutta step of x time
#: constants. The gradient of a plan at the trim is then exact to 1e-5.
_ERROR = 2.5e-6
#: Winds of a model in still air.
STILL = np.zeros(0)


class HeldModel:
    """Smooth equations z' = f(z, v, w) over successive holds of v, in nominal units.

    scaled: the problem in nominal units
    holds: durations of the holds, s, (N,), or the largest ones, if calls give others
    winds: names of the disturbances w of the model in moving air, constant, in its units
    """

    def __init__(
        self, scaled: ScaledProblem, holds: np.ndarray, winds: tuple[str, ...] = ()
    ) -> None:
        self.scaled = scaled
        self.holds = holds
        self.winds = winds
        self._rates = smooth_rates(scaled.problem, winds)

    def __reduce__(self) -> tuple[type[HeldModel], tuple[Any, ...]]:
        """Return the constructor and its arguments, for copies and pickle."""
        return HeldModel, (self.scaled, self.holds, self.winds)

    @cached_property
    def _parts(self) -> list[int]:
        """Number of Runge-Kutta steps in each hold."""
        constants = self.holds * self.scaled.fastest
        parts = np.ceil((constants**5 / (120.0 * _ERROR)) ** 0.25)
        return np.maximum(1, parts).astype(int).tolist()

    @cached_property
    def slopes(self) -> ca.Function:
        """Function ((z, v), w) -> rates, and their derivatives by (z, v)."""
        _, n, m = self.scaled.sizes
        both, w = ca.SX.sym("both", n + m), ca.SX.sym("w", len(self.winds))
        rates = self._rates(ca.vertcat(both, w))
        slopes = ca.densify(ca.jacobian(rates, both))
        return ca.Function("slopes", [both, w], [rates, slopes], {"cse": True})

    @cached_property
    def _step(self) -> ca.Function:
        """Function (z, v, w, h) -> z after one Runge-Kutta step of h seconds."""
        z, v, w, h = self._symbols()
        after = rk4(lambda x, _: self._rates(ca.vertcat(x, v, w)), z, h)
        return ca.Function("step", [z, v, w, h], [after])

    @cached_property
    def _step_slopes(self) -> ca.Function:
        """Function ([z, S], v, w, h) -> [z, S] after one Runge-Kutta step, with the derivatives S
        (n, n + m) of z by the states and inputs at the start of the hold.
        """
        _, v, w, h = self._symbols()
        _, n, m = self.scaled.sizes
        columns = ca.MX.sym("columns", n, 1 + n + m)

        def moved(columns: Any, _: float) -> Any:
            rate, jacobian = self.slopes(ca.vertcat(columns[:, 0], v), w)
            of_inputs = ca.horzcat(ca.DM.zeros(n, n), jacobian[:, n:])
            return ca.horzcat(rate, jacobian[:, :n] @ columns[:, 1:] + of_inputs)

        after = ca.densify(rk4(moved, columns, h))
        return ca.Function("step_slopes", [columns, v, w, h], [after])

    def _held(self, step: ca.Function, parts: int) -> ca.Function:
        """Return the function (z or [z, S], v, w, seconds) -> z or [z, S] after a hold.

        parts: number of Runge-Kutta steps
        """
        begin = ca.MX.sym("begin", *step.size_in(0))
        _, v, w, seconds = self._symbols()
        repeated = (ca.repmat(each, 1, parts) for each in (v, w, seconds / parts))
        after = step.fold(parts)(begin, *repeated)
        return ca.Function(f"{step.name()}_{parts}", [begin, v, w, seconds], [after])

    def _symbols(self) -> tuple[Any, Any, Any, Any]:
        _, n, m = self.scaled.sizes
        names = {"z": n, "v": m, "w": len(self.winds), "seconds": 1}
        z, v, w, seconds = (ca.MX.sym(name, size) for name, size in names.items())
        return z, v, w, seconds

    @cached_property
    def _flown(self) -> BoundFunction:
        """Machine code of (z, v (m, N), w) -> states after each hold, (n, N)."""
        z, _, w, _ = self._symbols()
        inputs = ca.MX.sym("inputs", self.scaled.sizes[2], len(self._parts))
        nodes = [z]
        for parts, first, last in self._groups():
            held = self._held(self._step, parts).mapaccum(last - first)
            seconds = ca.DM(self.holds[first:last]).T
            over = ca.repmat(w, 1, last - first)
            nodes.append(held(nodes[-1][:, -1], inputs[:, first:last], over, seconds))
        after = ca.horzcat(*nodes[1:])
        return BoundFunction(machine_code(ca.Function("flown", [z, inputs, w], [after])))

    @cached_property
    def _slopes(self) -> BoundFunction:
        """Machine code of (z (n, N), v (m, N), w, seconds) -> [z, S] after each hold,
        (n, N (1 + n + m)).
        """
        _, n, m = self.scaled.sizes
        _, _, w, _ = self._symbols()
        before = ca.MX.sym("before", n, len(self._parts))
        inputs = ca.MX.sym("inputs", m, len(self._parts))
        seconds = ca.MX.sym("seconds", 1, len(self._parts))
        slopes = []
        for parts, first, last in self._groups():
            held = self._held_slopes(parts).map(last - first)
            over = ca.repmat(w, 1, last - first)
            given = before[:, first:last], inputs[:, first:last], over, seconds[first:last]
            slopes.append(held(*given))
        function = ca.Function("slopes", [before, inputs, w, seconds], [ca.horzcat(*slopes)])
        return BoundFunction(machine_code(function))

    def _held_slopes(self, parts: int) -> ca.Function:
        """Return the function (z, v, w, seconds) -> [z, S] (n, 1 + n + m) after a hold."""
        z, v, w, seconds = self._symbols()
        _, n, m = self.scaled.sizes
        begin = ca.horzcat(z, ca.DM.eye(n), ca.DM.zeros(n, m))
        after = self._held(self._step_slopes, parts)(begin, v, w, seconds)
        return ca.Function(f"slopes_{parts}", [z, v, w, seconds], [ca.densify(after)])

    def _groups(self) -> list[tuple[int, int, int]]:
        """Return the number of steps, the first hold and the end of each run of equal numbers."""
        groups, first = [], 0
        for parts, same in groupby(self._parts):
            last = first + len(list(same))
            groups.append((parts, first, last))
            first = last
        return groups

    @cached_property
    def sample(self) -> ca.Function:
        """Function (z, v, w, seconds) -> z after a hold that is not longer than the first one."""
        return self._held(self._step, self._parts[0])

    @cached_property
    def _one(self) -> BoundFunction:
        return BoundFunction(self.sample)

    def after(self, z: np.ndarray, v: np.ndarray, w: np.ndarray, seconds: float) -> np.ndarray:
        """Return the states after a hold that is not longer than the first one, (n,)."""
        (moved,) = self._one.at(z, v, w, seconds)
        return moved

    def flown(self, z: np.ndarray, v: np.ndarray, w: np.ndarray) -> np.ndarray:
        """Return the states at the ends of the holds, (N + 1, n), the initial states first.

        z: initial states, (n,)
        v: inputs during the holds, (N, m)
        """
        (after,) = self._flown.at(z, v.ravel(), w)
        return np.vstack([z[None], after.reshape(len(v), -1)])

    def moved_along(
        self, z: np.ndarray, v: np.ndarray, w: np.ndarray, seconds: np.ndarray | None = None
    ) -> tuple[np.ndarray, np.ndarray]:
        """Return the states after each hold, (N, n), and their derivatives by those before it and
        by the inputs, (N, n, n + m).

        z: states before each hold, (N, n)
        v: inputs during the holds, (N, m)
        seconds: durations of the holds, s, (N,), by default the largest
        """
        lengths = self.holds if seconds is None else seconds
        (columns,) = self._slopes.at(z.ravel(), v.ravel(), w, lengths)
        both = columns.reshape(len(v), -1, z.shape[1]).transpose(0, 2, 1)
        return both[:, :, 0], both[:, :, 1:]
