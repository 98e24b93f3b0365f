"""Where the slopes to both sides are not the Jacobian: at the switch of a |x|, min, max, sign or
comparison."""

from __future__ import annotations

from functools import lru_cache

import casadi as ca
import numpy as np

from hfa_aircraft.model import Layout, Model, components

_ONE = {ca.OP_FABS, ca.OP_SIGN}
_TWO = {ca.OP_FMIN, ca.OP_FMAX, ca.OP_LT, ca.OP_LE, ca.OP_EQ, ca.OP_NE}
_WHOLE = {ca.OP_FLOOR, ca.OP_CEIL}
#: Step of the slopes, in nominal values, and how far they may differ from the Jacobian, in scaled
#: units.
_STEP, _APART = 1e-6, 1e-4
#: Points of a sweep at which slopes are compared.
_MOST = 100


@lru_cache(maxsize=16)
def switches(layout: Layout) -> ca.Function | None:
    """(x, u, p) -> s and ∂s/∂(x, u): what each |.|, sign, min, max, comparison and rounding in the
    equations switches over at s = 0, in the order of the instructions. None without any."""
    vectors = layout.symbols("x", "u", "p")
    function = ca.Function(
        "f", vectors, [layout.expressions(list(map(components, vectors)), ())[0]]
    )
    every = {function.instruction_id(k) for k in range(function.n_instructions())}
    if not every & {*_ONE, *_TWO, *_WHOLE}:
        return None
    found, work = [], [ca.SX(0)] * function.sz_w()
    for k in range(function.n_instructions()):
        op, of, to = (
            function.instruction_id(k),
            function.instruction_input(k),
            function.instruction_output(k),
        )
        if op == ca.OP_INPUT:
            work[to[0]] = vectors[of[0]][of[1]]
        elif op == ca.OP_CONST:
            work[to[0]] = ca.SX(function.instruction_constant(k))
        elif op != ca.OP_OUTPUT:
            values = [work[each] for each in of]
            if op in _ONE:
                found.append(values[0])
            elif op in _TWO:
                found.append(values[0] - values[1])
            elif op in _WHOLE:
                found.append(ca.sin(ca.pi * values[0]))
            work[to[0]] = (
                ca.SX.unary(op, *values) if len(values) == 1 else ca.SX.binary(op, *values)
            )
    s = ca.vertcat(*(each for each in found if not each.is_constant()))
    if not s.numel():
        return None
    return ca.Function(
        "switches", vectors, [ca.densify(s), ca.densify(ca.jacobian(s, ca.vertcat(*vectors[:2])))]
    )


def kinks_in(
    own: Model, x: np.ndarray, u: np.ndarray, p: np.ndarray, exact: np.ndarray
) -> dict[int, tuple[str, ...]]:
    """Point -> its kinks, of the first `_MOST` of N points where a step of a state or an input can
    reach a switch; a point without a trim, nan, has none.

    x: (N, n), u: (N, m), p: the parameters (N, k), exact: A beside B (N, n, n + m).
    """
    function = switches(own.layout)
    if function is None:
        return {}
    steps = _STEP * np.array(
        [each.nominal for each in (*own.states.values(), *own.inputs.values())]
    )
    s, slopes = (np.array(each) for each in function.map(len(x))(x.T, u.T, p.T))
    reach = np.abs(slopes.T.reshape(len(x), -1, len(s))) * steps[:, None]
    near = np.flatnonzero((np.abs(s.T) <= 2 * reach.sum(axis=1)).any(axis=1))[:_MOST].tolist()
    found = {i: _kinks(own, np.concatenate([x[i], u[i]]), p[i], exact[i], steps) for i in near}
    return {i: each for i, each in found.items() if each}


def _kinks(
    own: Model, z: np.ndarray, p: np.ndarray, exact: np.ndarray, steps: np.ndarray
) -> tuple[str, ...]:
    """The entries of A and B at (x, u) = z whose slope to one side is not that of the Jacobian,
    with both slopes.

    Slopes s(h) = (f(z ± h) - f(z)) / ±h by Richardson's 2 s(h/2) - s(h), h = 1e-6 of the nominal
    value; they differ from J by more than 1e-4 (1 + |J|), in scaled units."""
    names, n, function = [*own.states, *own.inputs], len(own.states), own.functions(())

    def f(share: float) -> np.ndarray:
        """The rates a share of each step away, a column a variable."""
        moved = [z + share * step for step in np.diag(steps)]
        return np.column_stack([np.array(function(at[:n], at[n:], p)[0]).ravel() for at in moved])

    below, above = (
        (4 * f(side / 2) - 3 * f(0.0) - f(side)) / (side * steps) for side in (-1.0, 1.0)
    )
    scale = steps / _STEP / np.array([[own.rate_scale(name)] for name in own.states])
    off = np.maximum(np.abs(below - exact), np.abs(above - exact)) * scale > _APART * (
        1 + np.abs(exact) * scale
    )
    return tuple(
        f"kink: {'A' if j < n else 'B'}({names[i]}, {names[j]}) is {exact[i, j] + 0.0:.5g}, but the slopes below and "
        f"above are {below[i, j]:.5g} and {above[i, j]:.5g}"
        for j, i in np.argwhere(off.T).tolist()
    )
