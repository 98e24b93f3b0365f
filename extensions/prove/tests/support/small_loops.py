"""Small loops and a quadratic V, for tests of the searches."""

from __future__ import annotations

import numpy as np

from hfa_aircraft.model import Model, Signal
from hfa_prove.monomials import PolynomialFunction
from hfa_prove.search.loop_values import LoopValues
from hfa_prove.statements.loop import Gain, Loop
from hfa_prove.statements.plant import Limits

#: Matrix of V = z'P z, and V.
P = np.array([[2.0, 0.5], [0.5, 1.0]])
V = PolynomialFunction.quadratic(P)
#: Matrix of coordinates z = T y.
T = np.array([[1.5, 0.9], [0.0, 2.0]])
#: Jacobian of a linear loop.
J = np.array([[-1.0, 0.75], [0.0, -3.0]])


def cubic(limits: Limits) -> LoopValues:
    """Return x' = -x + x³, which converges for |x| < 1 alone."""
    model = Model(
        "cubic", {"x": Signal()}, {}, lambda x, u, p, w: ({"x": x.x**3 - x.x}, {}), trim={}
    )
    return LoopValues(Loop(model, {}, {"x": 0.0}, {}, {}, limits, Gain(np.zeros((0, 1)))))


def limited_loop() -> LoopValues:
    """Return a loop at x = (1, 2) with limits of one state and of the output y = a² + 3 b."""
    model = Model(
        "limited", {"a": Signal(nominal=2.0), "b": Signal(nominal=3.0), "c": Signal()}, {},
        lambda x, u, p, w: ({"a": -x.a, "b": x.a - 2.0 * x.b, "c": -x.c}, {"y": x.a**2 + 3.0 * x.b}),
        outputs={"y": Signal()}, linear=("a", "b"), trim={},
    )  # fmt: skip
    limits = {"b": (-1.0, 4.0), "y": (-np.inf, 11.0)}
    return LoopValues(
        Loop(model, {}, {"a": 1.0, "b": 2.0}, {}, {"c": 0.0}, limits, Gain(np.zeros((0, 2))))
    )
