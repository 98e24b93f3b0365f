"""Where the slopes to both sides are not the Jacobian: at the switch of a |x|, min, max, sign or comparison."""

from __future__ import annotations

from functools import lru_cache

import casadi as ca
import numpy as np

from hfa_support.model import Layout, Model, components

_ONE = {ca.OP_FABS, ca.OP_SIGN}
_TWO = {ca.OP_FMIN, ca.OP_FMAX, ca.OP_LT, ca.OP_LE, ca.OP_EQ, ca.OP_NE}
_WHOLE = {ca.OP_FLOOR, ca.OP_CEIL}
#: Step of the slopes, in nominal values, and how far they may differ from the Jacobian, in scaled units.
_STEP, _APART = 1e-6, 1e-4
#: Points of a sweep at which slopes are compared.
_MOST = 100


@lru_cache(maxsize=16)
def switches(layout: Layout) -> ca.Function | None:
    """(x, u, p) -> s and ∂s/∂(x, u): what each |.|, sign, min, max, comparison and rounding in the equations switches
    over at s = 0, in the order of the instructions. None without any."""
    vectors = layout.symbols("x", "u", "p")
    function = ca.Function("f", vectors, [layout.expressions(list(map(components, vectors)), ())[0]])
    every = {function.instruction_id(k) for k in range(function.n_instructions())}
    if not every & {*_ONE, *_TWO, *_WHOLE}:
        return None
    found, work = [], [ca.SX(0)] * function.sz_w()
    for k in range(function.n_instructions()):
        op, of, to = function.instruction_id(k), function.instruction_input(k), function.instruction_output(k)
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
            work[to[0]] = ca.SX.unary(op, *values) if len(values) == 1 else ca.SX.binary(op, *values)
    s = ca.vertcat(*(each for each in found if not each.is_constant()))
    if not s.numel():
        return None
    return ca.Function("switches", vectors, [ca.densify(s), ca.densify(ca.jacobian(s, ca.vertcat(*vectors[:2])))])


def kinks_of(own: Model, x: np.ndarray, u: np.ndarray, exact: np.ndarray) -> tuple[str, ...]:
    """The entries of A and B, exact (n, n + m), whose slope to one side is not that of the Jacobian, with both slopes;
    none unless x and u lie within a step of a switch.

    Slopes s(h) = (f(z ± h) - f(z)) / ±h by Richardson's 2 s(h/2) - s(h), h = 1e-6 of the nominal value; they differ
    from J by more than 1e-4 (1 + |J|), in scaled units.
    """
    if not near_a_switch(own, x[None], u[None])[0]:
        return ()
    names, n = [*own.states, *own.inputs], len(own.states)
    z, steps = np.concatenate([x, u]), _steps(own)
    function = own.functions(())

    def f(share: float) -> np.ndarray:
        """The rates a share of each step away, a column a variable."""
        moved = [z + share * step for step in np.diag(steps)]
        return np.column_stack([np.array(function(at[:n], at[n:], own.p)[0]).ravel() for at in moved])

    below, above = ((4 * f(side / 2) - 3 * f(0.0) - f(side)) / (side * steps) for side in (-1.0, 1.0))
    scale = steps / _STEP / np.array([[own.rate_scale(name)] for name in own.states])
    off = np.maximum(np.abs(below - exact), np.abs(above - exact)) * scale > _APART * (1 + np.abs(exact) * scale)
    return tuple(
        f"kink: {'A' if j < n else 'B'}({names[i]}, {names[j]}) is {exact[i, j] + 0.0:.5g}, but the slopes below and "
        f"above are {below[i, j]:.5g} and {above[i, j]:.5g}"
        for j, i in np.argwhere(off.T).tolist()
    )


def near_a_switch(own: Model, x: np.ndarray, u: np.ndarray, p: np.ndarray | None = None) -> np.ndarray:
    """(N,) whether a step of any state or input (N, n), (N, m) can reach a switch; p: (N, k), the model's unless
    given."""
    function = switches(own.layout)
    if function is None:
        return np.zeros(len(x), dtype=bool)
    constants = np.broadcast_to(own.p, (len(x), len(own.p))) if p is None else p
    s, slopes = (np.array(each) for each in function.map(len(x))(x.T, u.T, constants.T))
    reach = np.abs(slopes.T.reshape(len(x), -1, len(s))) * _steps(own)[:, None]
    return np.asarray((np.abs(s.T) <= 2 * reach.sum(axis=1)).any(axis=1))


def _steps(own: Model) -> np.ndarray:
    return _STEP * np.array([each.nominal for each in (*own.states.values(), *own.inputs.values())])


def kinks_in(own: Model, x: np.ndarray, u: np.ndarray, p: np.ndarray, exact: np.ndarray) -> dict[int, tuple[str, ...]]:
    """Point -> its kinks, of the first `_MOST` points that lie at a switch; a point without a trim, nan, has none.

    p: the parameters (N, k).
    """
    near = np.flatnonzero(near_a_switch(own, x, u, p))[:_MOST]
    found = {}
    for i in near.tolist():
        at = own.with_parameters(**dict(zip(own.parameters, p[i].tolist(), strict=True)))
        found[i] = kinks_of(at, x[i], u[i], exact[i])
    return {i: each for i, each in found.items() if each}
