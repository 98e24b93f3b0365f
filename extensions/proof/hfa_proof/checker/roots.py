"""Enclosure of the root of a system of equations, in ball arithmetic."""

from __future__ import annotations

import numpy as np
from flint import arb, arb_mat

from hfa_proof.checker.reading import Rejected
from verification.enclosure.balls import matrix, norm


def root_offsets(residual: arb_mat, J: arb_mat, radii: list[arb]) -> arb_mat:
    """Return an enclosure of w - x̂, a column (n, 1), for the only root w of F near x̂.

    residual: F at x̂, a column (n, 1)
    J: Jacobian F' for |w_i - x̂_i| <= r_i, (n, n)
    radii: radii r_i

    Raises Rejected if Krawczyk's test does not prove a root. Raises ZeroDivisionError if the
    midpoint of J is singular.
    """
    n = len(radii)
    C = J.mid().inv().mid()
    step = C * residual
    slope = matrix(np.eye(n)) - C * J
    distance = norm(step[i, 0] / radii[i] for i in range(n))
    scaled = (slope[i, j] * radii[j] / radii[i] for i in range(n) for j in range(n))
    contraction = norm(scaled)
    if not distance + contraction < 1:
        raise Rejected("a root of the equations is not proved to exist")
    rows = [[arb(0, 1) * contraction * radius - step[i, 0]] for i, radius in enumerate(radii)]
    return arb_mat(rows)
