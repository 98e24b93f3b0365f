"""An aircraft about a trim: its equations, limits, and its equilibrium enclosed."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import casadi as ca
import numpy as np

from hfa_aircraft.model import Model
from hfa_boxes.enclosure.program import Program
from hfa_boxes.enclosure.slopes import Intervals, jacobian
from hfa_proof.checker.reading import Rejected

#: Largest relative error of what a few sums and products of doubles make, over their sizes.
ROUNDING = 1e-12
#: Steps of Newton's method, and how often the radius of the equilibrium is doubled.
_STEPS = 20
_DOUBLINGS = 30


@dataclass(frozen=True, eq=False)
class Plant:
    """x' = f(x, u), u between the limits of the inputs.

    model: the equations; of its states, those of its linear model move
    parameters: every parameter of the model -> value
    trim: moving state -> value, x0
    inputs: input -> value, u0
    held: each other state -> the value that it keeps
    limits: signal -> lowest and highest value
    """

    model: Model
    parameters: Mapping[str, float]
    trim: Mapping[str, float]
    inputs: Mapping[str, float]
    held: Mapping[str, float]
    limits: Mapping[str, tuple[float, float]]

    @property
    def states(self) -> tuple[str, ...]:
        """The moving states, in order."""
        return tuple(self.model.linear)

    @property
    def limited_outputs(self) -> tuple[str, ...]:
        """Outputs that have limits."""
        return tuple(name for name in self.model.outputs if name in self.limits)

    @property
    def nominal(self) -> np.ndarray:
        """(n + m,), nominal values of the moving states and the inputs."""
        signals = self.model.signals
        return np.array([signals[name].nominal for name in (*self.states, *self.inputs)])

    def ends(self, names: Sequence[str]) -> np.ndarray:
        """(len(names), 2), lowest and highest value of signals, inf where there is no limit."""
        pairs = [self.limits.get(name, (-np.inf, np.inf)) for name in names]
        return np.array(pairs, dtype=float).reshape(-1, 2)

    def rates_at(self, x: ca.SX, u: ca.SX) -> tuple[ca.SX, ca.SX]:
        """Rates of the moving states at x (n,) with inputs u (m,), and the limited outputs."""
        values = dict(self.held) | dict(zip(self.states, ca.vertsplit(x), strict=True))
        vectors: list[Any] = [
            [values[name] for name in self.model.states],
            ca.vertsplit(u) if self.inputs else [],
            list(self.parameters.values()),
        ]
        f, y = self.model.layout.expressions(vectors, self.limited_outputs)
        rows = [list(self.model.states).index(name) for name in self.states]
        return ca.densify(f[rows]), ca.densify(y) if self.limited_outputs else ca.SX(0, 1)

    @cached_property
    def open(self) -> Program:
        """(x, u) -> the rates."""
        n = len(self.states)
        both = ca.SX.sym("x", n + len(self.inputs))
        rates, _ = self.rates_at(both[:n], both[n:])
        return Program(ca.Function("rates", [both], [rates]), self.model.name)


@dataclass(frozen=True, eq=False)
class Equilibrium:
    """One equilibrium lies within radius (n,) of x (n,)."""

    x: np.ndarray
    radius: np.ndarray


def zero_near(
    program: Program, x: np.ndarray, nominal: np.ndarray, solved: Sequence[int]
) -> Equilibrium:
    """The zero of a program to which Newton's method leads from x; Rejected unless one is proved to
    be there (Krawczyk 1969: C an inverse, |C F(x)| + |1 - C F'| r < r).

    x: (k,), the inputs of the program; nominal: (k,), their sizes
    solved: the inputs that are unknown, as many as the program has outputs; the others remain
    """
    point = np.array(x, dtype=float)
    columns = list(solved)
    none = np.zeros_like(point)
    for _ in range(_STEPS):
        at = jacobian(program, Intervals(point, none))
        slopes = at.slopes.middle[:, columns]
        if not np.all(np.isfinite(slopes)):
            break
        try:
            step = np.linalg.solve(slopes, at.values.middle)
        except np.linalg.LinAlgError:
            break
        point[columns] -= step
    at = jacobian(program, Intervals(point, none))
    try:
        C = np.linalg.inv(at.slopes.middle[:, columns])
    except np.linalg.LinAlgError as error:
        raise Rejected("no equilibrium is enclosed: the Jacobian is singular") from error
    radius = np.zeros_like(point)
    moved = _moved(C, at.values)
    radius[columns] = 2.0 * moved + 1e-14 * (np.abs(point) + nominal)[columns]
    for _ in range(_DOUBLINGS):
        J = jacobian(program, Intervals(point, radius)).slopes
        J = Intervals(J.middle[:, columns], J.radius[:, columns])
        spread = np.abs(np.eye(len(C)) - C @ J.middle) + np.abs(C) @ J.radius
        spread += ROUNDING * (np.abs(C) @ np.abs(J.middle))
        reach = (moved + spread @ radius[columns]) * (1.0 + ROUNDING)
        if np.all(reach < radius[columns]):
            return Equilibrium(point, radius)
        radius = 2.0 * radius
    raise Rejected("no equilibrium is enclosed near the trim")


def _moved(C: np.ndarray, residual: Intervals) -> np.ndarray:
    sizes = np.abs(residual.middle) + residual.radius
    exact_part = np.abs(C @ residual.middle) + np.abs(C) @ residual.radius
    return np.asarray(exact_part + ROUNDING * (np.abs(C) @ sizes))
