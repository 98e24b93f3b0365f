"""A loop of any policy, its inputs saturated: its equilibrium enclosed, V' about it enclosed."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import casadi as ca
import numpy as np
from flint import arb, arb_mat

from hfa_boxes.check.cover import Inequality, in_ball, outside_ball
from hfa_boxes.check.plant import ROUNDING, Equilibrium, Plant, zero_near
from hfa_boxes.enclosure.program import Program
from hfa_boxes.enclosure.slopes import Intervals, jacobian
from hfa_boxes.enclosure.taylor import TaylorProgram
from hfa_proof.arithmetic.balls import exact, is_positive_definite, matrix
from hfa_proof.checker.reading import Rejected

#: The hole about the equilibrium is |y_i| <= 2^-k for the first k that closes.
_SMALLEST_HOLE = 30


@dataclass(frozen=True, eq=False)
class Loop(Plant):
    """x' = f(x, u), u = min(max(u0 + policy(x - x0), low), high).

    policy: deviations (n,) -> deviations of the inputs (m,); a second argument is the trim: all
        states, the inputs and the parameters
    """

    policy: ca.Function

    def rates(self, x: ca.SX) -> tuple[ca.SX, ca.SX]:
        """Rates of the moving states at x (n,), and the limited outputs."""
        return self.rates_at(x, self.commands(x))

    def commands(self, x: ca.SX) -> ca.SX:
        """The inputs at x, saturated."""
        u0 = ca.DM(list(self.inputs.values()))
        if not self.inputs:
            return ca.SX(0, 1)
        commands = ca.vertsplit(u0 + self.deviations(x - ca.DM(list(self.trim.values()))))
        saturated = []
        for name, command in zip(self.inputs, commands, strict=True):
            low, high = self.limits.get(name, (-np.inf, np.inf))
            above = ca.fmax(command, low) if np.isfinite(low) else command
            saturated.append(ca.fmin(above, high) if np.isfinite(high) else above)
        return ca.vertcat(*saturated)

    def deviations(self, z: ca.SX) -> ca.SX:
        """Return the deviation of the inputs from the trim that the policy commands at the
        deviation z."""
        if self.policy.n_in() == 1:
            return self.policy(z)
        at_trim = {**self.trim, **self.held}
        states = [at_trim[name] for name in self.model.states]
        return self.policy(z, ca.DM([*states, *self.inputs.values(), *self.parameters.values()]))

    @cached_property
    def closed(self) -> Program:
        """x -> the rates."""
        x = ca.SX.sym("x", len(self.states))
        return Program(ca.Function("rates", [x], [self.rates(x)[0]]), self.model.name)


def equilibrium_near(loop: Loop, x: np.ndarray) -> Equilibrium:
    """The equilibrium of the loop near x (n,); Rejected unless one is proved to be there."""
    n = len(loop.states)
    return zero_near(loop.closed, x, loop.nominal[:n], range(n))


@dataclass(frozen=True, eq=False)
class Decrease:
    """-V' of a loop about its equilibrium in coordinates y, z = T y, V = z'P z.

    loop: with its policy
    equilibrium: enclosed, z = 0
    P: (n, n), symmetric
    T: (n, n)
    """

    loop: Loop
    equilibrium: Equilibrium
    P: np.ndarray
    T: np.ndarray

    @cached_property
    def _symbols(self) -> tuple[ca.SX, ca.SX, ca.SX]:
        """y, the error of the equilibrium, z."""
        n = len(self.P)
        y = ca.SX.sym("y", n)
        return y, ca.SX.sym("e", n), ca.DM(self.T) @ y

    @cached_property
    def _rates(self) -> tuple[ca.SX, ca.SX]:
        _, error, z = self._symbols
        return self.loop.rates(ca.DM(self.equilibrium.x) + z + error)

    @cached_property
    def inequality(self) -> Inequality:
        """-V' > 0 but in the hole, and outputs within their limits, in the unit ball."""
        y, error, z = self._symbols
        rates, outputs = self._rates
        functions = [-2 * ca.dot(ca.DM(self.P) @ z, rates)]
        for name, output in zip(self.loop.limited_outputs, ca.vertsplit(outputs), strict=True):
            low, high = self.loop.limits[name]
            functions += [output - low] if np.isfinite(low) else []
            functions += [high - output] if np.isfinite(high) else []
        program = Program(_function(y, error, functions), self.loop.model.name)
        taylor = TaylorProgram(program, self.equilibrium.radius)
        return Inequality(
            len(self.P), taylor.over, taylor.at_once, self.hole(), outside_ball, in_ball
        )

    def hole(self) -> int:
        """k: V' < 0 for 0 < |y_i| <= 2^-k; Rejected where that is not proved for any.

        The rates are J y, J in the enclosure, so that V' = y'(S + S') y with S = T'P J."""
        y, error, _ = self._symbols
        program = Program(_function(y, error, [self._rates[0]]), self.loop.model.name)
        left = (matrix(self.T).transpose() * matrix(self.P)).tolist()
        n = len(self.P)
        for k in range(1, _SMALLEST_HOLE + 1):
            radius = np.concatenate([np.full(n, 2.0**-k), self.equilibrium.radius])
            slopes = jacobian(program, Intervals(np.zeros(2 * n), radius)).slopes
            if np.all(np.isfinite(slopes.middle)) and np.all(np.isfinite(slopes.radius)):
                J = _balls(Intervals(slopes.middle[:, :n], slopes.radius[:, :n]))
                S = arb_mat(left) * J
                if is_positive_definite(-(S + S.transpose())):
                    return k
        raise Rejected(
            "V' < 0 is not proved about the equilibrium: V is not a Lyapunov function of the "
            "linearization, or a kink is at the equilibrium"
        )

    def reach(self) -> np.ndarray:
        """(n,), the largest |z_i| in the unit ball, rounded upward."""
        return np.asarray(np.sqrt(np.sum(self.T**2, axis=1)) * (1.0 + ROUNDING))

    def check_level(self, rho: float) -> None:
        """Rejected unless {V <= rho} lies in the unit ball: T'P T - rho is positive definite, so
        that V > rho |y|²."""
        T = matrix(self.T)
        n = len(self.P)
        square = T.transpose() * matrix(self.P) * T
        level = arb_mat(
            n, n, [exact(rho) if i == j else arb(0) for i in range(n) for j in range(n)]
        )
        if not is_positive_definite(square - level):
            raise Rejected("the set is not proved to lie in the unit ball of the coordinates")


def _function(y: ca.SX, error: ca.SX, outputs: Sequence[ca.SX]) -> ca.Function:
    return ca.Function("f", [ca.vertcat(y, error)], [ca.vertcat(*outputs)])


def _balls(values: Intervals) -> arb_mat:
    """A matrix of intervals as balls."""
    rows, columns = values.middle.shape
    pairs = zip(values.middle.ravel().tolist(), values.radius.ravel().tolist(), strict=True)
    return arb_mat(rows, columns, [arb(middle, radius) for middle, radius in pairs])
