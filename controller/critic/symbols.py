"""CasADi symbols for the states of a critic."""

from __future__ import annotations

from collections.abc import Iterable

import casadi as ca


def symbols_for(functions: Iterable[ca.Function], n: int) -> ca.SX:
    """Return new CasADi symbols z (n,), as arguments of all given functions.

    The symbols are of type SX if all functions are SX functions, and otherwise of type MX.
    Evaluation of a wide network with SX symbols would take a minute and a gigabyte.
    """
    if all(function.is_a("SXFunction") for function in functions):
        return ca.SX.sym("z", n)
    return ca.MX.sym("z", n)  # type: ignore[return-value]  # has the same operators
