"""Lowest and highest deviations in a proved set, computed from V, rho and the unit ball."""

from __future__ import annotations

import numpy as np
from flint import arb, ctx

from hfa_region.check.statement import RegionStatement
from verification.enclosure.balls import exact, matrix, norm

#: Bits of a midpoint.
_PRECISION = 192


@ctx.workprec(_PRECISION)
def extents_of(statement: RegionStatement, T: np.ndarray) -> dict[str, tuple[float, float]]:
    """Return state -> lowest and highest deviation in a proved set, rounded outward.

    - V = z'P z: the extents of the ellipsoid, ±sqrt(rho P⁻¹_ii)
    - V of higher degree: the stated extents, limited to the unit ball

    T: matrix of the coordinates z = T y, (n, n). The set is in the unit ball of y.
    """
    states = statement.loop.states
    n = len(states)
    inverse = None
    if all(sum(exponents) == 2 for _, exponents in statement.terms):
        P = np.zeros((n, n))
        for coefficient, exponents in statement.terms:
            i, j = np.repeat(np.arange(n), exponents)
            P[i, j] += coefficient / 2.0
            P[j, i] += coefficient / 2.0
        inverse = matrix(P).inv()
    found = {}
    for index, name in enumerate(states):
        if inverse is not None:
            reach = _above((exact(statement.rho) * inverse[index, index]).sqrt())
            found[name] = (-reach, reach)
            continue
        reach = _above(norm(matrix(T).table()[index]))
        low, high = statement.extents[name]
        found[name] = (max(low, -reach), min(high, reach))
    return found


def _above(ball: arb) -> float:
    """Return a double above every number of the ball."""
    return float(np.nextafter(float(ball.upper()), np.inf))
