"""A loop of any policy, its inputs saturated: its equilibrium enclosed, V' about it enclosed."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import casadi as ca
import numpy as np
from flint import arb, arb_mat

from hfa_aircraft.model import Model
from hfa_boxes.check.cover import Inequality, in_ball, outside_ball
from hfa_boxes.enclosure.program import Program
from hfa_boxes.enclosure.slopes import Intervals, jacobian
from hfa_boxes.enclosure.taylor import TaylorProgram
from hfa_proof.arithmetic.balls import exact, is_positive_definite, matrix
from hfa_proof.checker.reading import Rejected

#: Largest relative error of what a few sums and products of doubles make, over their sizes.
_ROUNDING = 1e-12
#: Steps of Newton's method, and how often the radius of the equilibrium is doubled.
_STEPS = 20
_DOUBLINGS = 30
#: The hole about the equilibrium is |y_i| <= 2^-k for the first k that closes.
_SMALLEST_HOLE = 30


@dataclass(frozen=True, eq=False)
class Loop:
    """x' = f(x, u), u = min(max(u0 + policy(x - x0), low), high).

    model: the equations; of its states, those of its linear model move
    parameters: every parameter of the model -> value
    trim: moving state -> value, x0
    inputs: input -> value, u0
    held: each other state -> the value that it keeps
    limits: signal -> lowest and highest value
    policy: deviations (n,) -> deviations of the inputs (m,); a second argument is the trim: all
        states, the inputs and the parameters
    """

    model: Model
    parameters: Mapping[str, float]
    trim: Mapping[str, float]
    inputs: Mapping[str, float]
    held: Mapping[str, float]
    limits: Mapping[str, tuple[float, float]]
    policy: ca.Function

    @property
    def states(self) -> tuple[str, ...]:
        """The moving states, in order."""
        return tuple(self.model.linear)

    @property
    def limited_outputs(self) -> tuple[str, ...]:
        """Outputs that have limits."""
        return tuple(name for name in self.model.outputs if name in self.limits)

    def rates(self, x: ca.SX) -> tuple[ca.SX, ca.SX]:
        """Rates of the moving states at x (n,), and the limited outputs."""
        u = self.commands(x)
        values = dict(self.held) | dict(zip(self.states, ca.vertsplit(x), strict=True))
        vectors: list[Any] = [
            [values[name] for name in self.model.states],
            ca.vertsplit(u) if self.inputs else [],
            list(self.parameters.values()),
        ]
        f, y = self.model.layout.expressions(vectors, self.limited_outputs)
        rows = [list(self.model.states).index(name) for name in self.states]
        return ca.densify(f[rows]), ca.densify(y) if self.limited_outputs else ca.SX(0, 1)

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
        """What the policy commands at the deviation z, beyond the inputs at the trim."""
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


@dataclass(frozen=True, eq=False)
class Equilibrium:
    """One equilibrium of the loop lies within radius (n,) of x (n,)."""

    x: np.ndarray
    radius: np.ndarray


def equilibrium_near(loop: Loop, x: np.ndarray) -> Equilibrium:
    """The equilibrium to which Newton's method leads from x; Rejected unless one is proved to be
    there (Krawczyk 1969: C an inverse, |C F(x)| + |1 - C F'| r < r)."""
    point = np.array(x, dtype=float)
    zero = np.zeros_like(point)
    for _ in range(_STEPS):
        at = jacobian(loop.closed, Intervals(point, zero))
        if not np.all(np.isfinite(at.slopes.middle)):
            break
        try:
            point = point - np.linalg.solve(at.slopes.middle, at.values.middle)
        except np.linalg.LinAlgError:
            break
    at = jacobian(loop.closed, Intervals(point, zero))
    try:
        C = np.linalg.inv(at.slopes.middle)
    except np.linalg.LinAlgError as error:
        raise Rejected(
            "no equilibrium of the loop is enclosed: its Jacobian is singular"
        ) from error
    sizes = np.array([loop.model.signals[name].nominal for name in loop.states])
    radius = 2.0 * _moved(C, at.values) + 1e-14 * (np.abs(point) + sizes)
    for _ in range(_DOUBLINGS):
        J = jacobian(loop.closed, Intervals(point, radius)).slopes
        spread = np.abs(np.eye(len(C)) - C @ J.middle) + np.abs(C) @ J.radius
        spread += _ROUNDING * (np.abs(C) @ np.abs(J.middle))
        reach = (_moved(C, at.values) + spread @ radius) * (1.0 + _ROUNDING)
        if np.all(reach < radius):
            return Equilibrium(point, radius)
        radius = 2.0 * radius
    raise Rejected("no equilibrium of the loop is enclosed near its trim")


def _moved(C: np.ndarray, residual: Intervals) -> np.ndarray:
    sizes = np.abs(residual.middle) + residual.radius
    exact_part = np.abs(C @ residual.middle) + np.abs(C) @ residual.radius
    return np.asarray(exact_part + _ROUNDING * (np.abs(C) @ sizes))


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
            "V' < 0 is not proved about the equilibrium: V is no Lyapunov function of the "
            "linearization, or a kink is at the equilibrium"
        )

    def reach(self) -> np.ndarray:
        """(n,), the largest |z_i| in the unit ball, rounded upward."""
        return np.asarray(np.sqrt(np.sum(self.T**2, axis=1)) * (1.0 + _ROUNDING))

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
