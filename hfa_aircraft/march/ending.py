"""Ends of flights: convergence, departure from the limits, divergence.

All constants that decide at one state how a flight ends are in this module.
"""

from __future__ import annotations

import sys
from enum import StrEnum
from functools import reduce
from typing import Any

import casadi as ca
import numpy as np

#: Nominal values by which a state deviates from the trim when a flight diverges.
FAR = 1e4
#: A bound on the cost-to-go V* in a box is exceeded by this factor when a flight diverges.
FAR_OF_VALUE = 1e12
#: A flight about an expansion leaves its neighborhood if z'Pz exceeds this multiple of its initial
#: value.
FAR_OF_EXPANSION = 100.0
#: A flight converges if its cost-to-go at the end is at most this fraction of its initial
#: cost-to-go. For critics that are not quadratic, the cost beyond is that of their linear part, and
#: costs are printed with three digits; for flights about an expansion, V is the cost beyond.
OF_VALUE = 1e-6
OF_EXPANSION = 1e-2
#: A loop in discrete time also converges to this multiple of the cost-to-go of the exact loop.
OF_EXACT = 2.0


class Outcome(StrEnum):
    """Outcome of a flight."""

    CONVERGED = "converges"
    LEFT = "leaves the envelope"
    UNDECIDED = "does not converge"


def is_within(states: Any, least: Any, most: Any) -> Any:
    """Return whether all states are finite numbers within limits.

    The result is a mask (N,) for arrays, and an expression for CasADi columns.

    states, least, most: (N, n), or columns (n,)
    """
    if isinstance(states, np.ndarray):
        return (np.isfinite(states) & (states >= least) & (states <= most)).all(axis=-1)
    limits = zip(*map(ca.vertsplit, (least, states, most)), strict=True)
    inside: list[Any] = [ca.logic_and(low <= x, x <= high) for low, x, high in limits]
    return ca.logic_and(all_finite(states), reduce(ca.logic_and, inside))


def all_finite(column: Any) -> Any:
    """Return the expression that all entries of a CasADi column are finite numbers."""
    finite: list[Any] = [ca.fabs(x) <= sys.float_info.max for x in ca.vertsplit(column)]
    return reduce(ca.logic_and, finite)


def has_decayed(value: Any, reference: Any, fraction: float) -> Any:
    """Return whether flights have converged, measured by a cost-to-go such as z'Pz.

    The cost-to-go at the end is at most a fraction of a reference, which must be finite. The result
    is a mask (N,) for arrays.

    value: cost-to-go at the end of each flight
    reference: cost-to-go at its start, or its cost
    """
    return np.isfinite(reference) & (value <= fraction * reference)
