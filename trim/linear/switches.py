"""Switches of the equations: points where |x|, min, max, sign, a comparison or a rounding switches.

The knots of tables are also switches.
"""

from __future__ import annotations

from functools import lru_cache

import casadi as ca
import numpy as np

from hfa_aircraft.layout import Layout, components
from hfa_aircraft.model import Model
from hfa_support.native.bound import RowFunction

_ONE_ARGUMENT = {ca.OP_FABS, ca.OP_SIGN}
_TWO_ARGUMENTS = {ca.OP_FMIN, ca.OP_FMAX, ca.OP_LT, ca.OP_LE, ca.OP_EQ, ca.OP_NE}
_ROUNDING = {ca.OP_FLOOR, ca.OP_CEIL}
#: Step for the slopes, as a fraction of the nominal value.
STEP = 1e-6
#: Largest number of points near a switch at which slopes are compared.
_MOST = 1_000
#: Empty result: no points, no states and inputs.
_NOWHERE = (np.zeros(0, dtype=int), np.zeros(0, dtype=int))


def near_switches(
    model: Model, x: np.ndarray, u: np.ndarray, p: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Return the indices of the points near a switch, and of the states and inputs that affect a
    switch.

    A point is near a switch if finite-difference steps of the states and inputs may reach the
    switch. At most `_MOST` points are returned. There are two special cases:

    - If a switch depends on states and inputs in second order only, all states and inputs are
      returned.
    - If the equations call functions, the first `_MOST` finite points and all states and inputs are
      returned. The operations in these functions are not visible.

    x: (N, n), states
    u: (N, m), inputs
    p: (N, k), parameters
    """
    steps = steps_of(model)
    switches = _switches(model.layout, steps)
    if switches is None:
        if not _calls_functions(model.layout):
            return _NOWHERE
        return np.flatnonzero(np.isfinite(x).all(axis=1))[:_MOST], np.arange(len(steps))
    distances, moves = switches(x, u, p)
    near = distances <= 0.0
    if not near.any():
        return _NOWHERE
    points = np.flatnonzero(near.any(axis=1))[:_MOST]
    moving = moves.reshape(*distances.shape, -1)[near]
    if not moving.any(axis=1).all():  # a switch that depends on z in second order only
        return points, np.arange(len(steps))
    return points, np.flatnonzero(moving.any(axis=0))


@lru_cache(maxsize=16)
def steps_of(model: Model) -> tuple[float, ...]:
    """Return the finite-difference step of each state and input."""
    signals = (*model.states.values(), *model.inputs.values())
    return tuple(STEP * signal.nominal for signal in signals)


@lru_cache(maxsize=16)
def rates_of(layout: Layout) -> ca.Function:
    """Return the CasADi Function (x, u, p) -> rates of the states."""
    vectors = layout.symbols("x", "u", "p")
    rates, _ = layout.expressions([components(vector) for vector in vectors], ())
    return ca.Function("rates", vectors, [rates])


@lru_cache(maxsize=16)
def _calls_functions(layout: Layout) -> bool:
    """Return whether the equations call functions whose operations are not visible."""
    # Such functions are `casadi.interpolant` and functions that are not inlined.
    rates = rates_of(layout)
    return ca.OP_CALL in {rates.instruction_id(k) for k in range(rates.n_instructions())}


@lru_cache(maxsize=16)
def _switches(layout: Layout, steps: tuple[float, ...]) -> RowFunction | None:
    """Return a function that shows how near points (x, u, p) are to each switch, or None."""
    # A switch is a zero of an expression s, at which an operation |.|, sign, min, max, comparison
    # or rounding in the equations switches. The arguments and results of the function have one row
    # for each point. For each switch, the function returns |s| - 2 Σ m and the changes m = |∂s/∂(x,
    # u)| steps. Near the switch, |s| - 2 Σ m is not positive. The result is None if the equations
    # have no such operation, or if they call functions.
    if _calls_functions(layout):
        return None
    rates = rates_of(layout)
    instructions = range(rates.n_instructions())
    operations = {rates.instruction_id(k) for k in instructions}
    if not operations & {*_ONE_ARGUMENT, *_TWO_ARGUMENTS, *_ROUNDING}:
        return None
    vectors = layout.symbols("x", "u", "p")
    switching = []
    work = [ca.SX(0) for _ in range(rates.sz_w())]
    for k in instructions:
        operation = rates.instruction_id(k)
        sources = rates.instruction_input(k)
        target = rates.instruction_output(k)[0]
        if operation == ca.OP_INPUT:
            work[target] = vectors[sources[0]][sources[1]]
        elif operation == ca.OP_CONST:
            work[target] = ca.SX(rates.instruction_constant(k))
        elif operation != ca.OP_OUTPUT:
            values = [work[source] for source in sources]
            if operation in _ONE_ARGUMENT:
                switching.append(values[0])
            elif operation in _TWO_ARGUMENTS:
                switching.append(values[0] - values[1])
            elif operation in _ROUNDING:
                switching.append(ca.sin(ca.pi * values[0]))
            make = ca.SX.unary if len(values) == 1 else ca.SX.binary
            work[target] = make(operation, *values)
    s = ca.vertcat(*(value for value in switching if not value.is_constant()))
    if not s.numel():
        return None
    moved = ca.vertcat(*vectors[:2])
    moves = ca.fabs(ca.densify(ca.jacobian(s, moved))) @ ca.diag(ca.DM(steps))
    distances = ca.fabs(s) - 2 * ca.sum2(moves)
    parts = [ca.densify(distances), ca.vec(ca.densify(moves).T)]
    return RowFunction(ca.Function("switches", vectors, parts))
