"""Where a derivative does not describe the equations: at a knot of a table, at the switch of |x|,
min, max, sign or a comparison. A and B take the mean of the slopes to both sides there."""

from __future__ import annotations

from functools import lru_cache
from typing import NamedTuple

import casadi as ca
import numpy as np

from hfa_aircraft.layout import Layout, components
from hfa_aircraft.model import Model
from hfa_support.native.bound import RowFunction

_ONE_ARGUMENT = {ca.OP_FABS, ca.OP_SIGN}
_TWO_ARGUMENTS = {ca.OP_FMIN, ca.OP_FMAX, ca.OP_LT, ca.OP_LE, ca.OP_EQ, ca.OP_NE}
_ROUNDING = {ca.OP_FLOOR, ca.OP_CEIL}
#: Step of the slopes, in nominal values.
_STEP = 1e-6
#: How far slopes may differ, of 1 + |derivative|, in scaled units.
_APART = 1e-4
#: As a share of that: a difference in a column where another entry is at a kink.
_FELT = 1e-2
#: Points at which slopes are compared, the first of those near a switch.
_MOST = 1_000
#: No points, no states and inputs.
_NOWHERE = (np.zeros(0, dtype=int), np.zeros(0, dtype=int))


class Smoothed(NamedTuple):
    """A and B of N points, with the means of both slopes at kinks.

    A: (N, n, n).
    B: (N, n, m).
    notes: point -> a sentence for each entry of A or B at a kink or a jump.
    """

    A: np.ndarray
    B: np.ndarray
    notes: dict[int, tuple[str, ...]]


def with_means_at_kinks(
    model: Model, x: np.ndarray, u: np.ndarray, p: np.ndarray, A: np.ndarray, B: np.ndarray
) -> Smoothed:
    """A and B with the means of both slopes at kinks.

    x: (N, n), states.
    u: (N, m), inputs.
    p: (N, k), parameters.
    A: (N, n, n), B: (N, n, m), the derivatives there.

    An entry is at a kink where the slopes to the sides, by differences, are smooth and differ from
    the derivative; it becomes their mean. Where the rate itself jumps the entry stays, with a note.
    Points without a trim, nan, have none.
    """
    near, columns = _near_switches(model, x, u, p)
    if not near.size:
        return Smoothed(A, B, {})
    jacobian = np.concatenate([A, B], axis=2)
    z = np.concatenate([x[near], u[near]], axis=1)
    notes = {}
    for point, slopes in zip(near.tolist(), _slopes(model, z, p[near], columns), strict=True):
        words = _correct(model, slopes, jacobian[point], columns)
        if words:
            notes[point] = words
    n = len(model.states)
    return Smoothed(jacobian[:, :, :n], jacobian[:, :, n:], notes)


def _near_switches(
    model: Model, x: np.ndarray, u: np.ndarray, p: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Numbers of the first `_MOST` points from which a step can reach a switch, and of the states
    and inputs that reach one there.

    Where equations call functions, whose inside is not seen: all points, all states and inputs.
    """
    steps = _steps(model)
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
    if not moving.any(axis=1).all():  # a switch that moves in second order only
        return points, np.arange(len(steps))
    return points, np.flatnonzero(moving.any(axis=0))


@lru_cache(maxsize=16)
def _steps(model: Model) -> tuple[float, ...]:
    """The step of each state and input."""
    signals = (*model.states.values(), *model.inputs.values())
    return tuple(_STEP * signal.nominal for signal in signals)


@lru_cache(maxsize=16)
def _rates(layout: Layout) -> ca.Function:
    """(x, u, p) -> the rates."""
    vectors = layout.symbols("x", "u", "p")
    rates, _ = layout.expressions([components(vector) for vector in vectors], ())
    return ca.Function("rates", vectors, [rates])


@lru_cache(maxsize=16)
def _calls_functions(layout: Layout) -> bool:
    """Whether the equations call functions: tables of `casadi.interpolant`, functions that are not
    inlined."""
    rates = _rates(layout)
    return ca.OP_CALL in {rates.instruction_id(k) for k in range(rates.n_instructions())}


@lru_cache(maxsize=16)
def _switches(layout: Layout, steps: tuple[float, ...]) -> RowFunction | None:
    """(x, u, p) -> |s| - 2 Σ m, and m = |∂s/∂(x, u)| steps row by row, of the s over which each
    |.|, sign, min, max, comparison and rounding in the equations switches at 0. None without any,
    and where the equations call functions."""
    if _calls_functions(layout):
        return None
    rates = _rates(layout)
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


def _slopes(model: Model, z: np.ndarray, p: np.ndarray, columns: np.ndarray) -> np.ndarray:
    """Slopes of the rates between seven places along some states and inputs, (N, 6, n, columns).

    z: (N, n + m), the states and inputs.
    columns: numbers of those that are moved.
    The places lie -3, ..., 3 steps away.
    """
    n = len(model.states)
    count, size = z.shape
    steps = np.array(_steps(model))
    offsets = np.arange(-3, 4)[:, None, None] * np.diag(steps)[columns]
    places = (z[:, None, None, :] + offsets).reshape(-1, size)
    parameters = np.repeat(p, 7 * len(columns), axis=0)
    rates = np.array(_rates(model.layout)(places[:, :n].T, places[:, n:].T, parameters.T))
    by_place = rates.reshape(n, count, 7, len(columns)).transpose(1, 2, 0, 3)
    return np.diff(by_place, axis=1) / steps[columns]


def _correct(
    model: Model, slopes: np.ndarray, jacobian: np.ndarray, columns: np.ndarray
) -> tuple[str, ...]:
    """Put the means of both slopes into the entries of (n, n + m) `jacobian` at a kink; a sentence
    for each, and for each that the rate jumps over.

    slopes: (6, n, columns), of `_slopes`. They are extrapolated from where they are clear of a kink
    within a step, so that the mean is right for a trim that hits a knot up to rounding.
    """
    n = len(model.states)
    names = (*model.states, *model.inputs)
    derivative = jacobian[:, columns]
    below = 2.5 * slopes[1] - 1.5 * slopes[0]
    above = 2.5 * slopes[4] - 1.5 * slopes[5]
    nominal = np.array(_steps(model))[columns] / _STEP
    scale = nominal / np.array([[model.rate_scale(name)] for name in model.states])
    allowed = _APART * (1 + np.abs(derivative) * scale) / scale
    smooth_below = np.abs(slopes[1] - slopes[0]) <= allowed
    smooth_above = np.abs(slopes[5] - slopes[4]) <= allowed
    differs = np.maximum(np.abs(below - derivative), np.abs(above - derivative)) > allowed
    # Across a kink the two middle slopes lie between those to the sides, or are mixed of them.
    across = np.abs(slopes[2] + slopes[3] - below - above)
    jumps = smooth_below & smooth_above & (across > 2 * np.abs(above - below) + allowed)
    kinks = smooth_below & smooth_above & differs & ~jumps
    # What one rate feels of a kink the others do too, even where it is small to them.
    felt = np.abs(above - below) > _FELT * allowed
    kinks |= kinks.any(axis=0) & smooth_below & smooth_above & felt & ~jumps
    notes = []
    for j, i in np.argwhere((kinks | jumps).T).tolist():
        column = int(columns[j])
        entry = f"{'A' if column < n else 'B'}({names[i]}, {names[column]})"
        if jumps[i, j]:
            notes.append(
                f"jump: the rate of {names[i]} jumps as {names[column]} passes its value; {entry} "
                f"is {jacobian[i, column] + 0.0:.5g}, without the jump"
            )
        else:
            jacobian[i, column] = (below[i, j] + above[i, j]) / 2
            notes.append(
                f"kink: {entry} is {jacobian[i, column] + 0.0:.5g}, the mean of the slopes below "
                f"and above, {below[i, j]:.5g} and {above[i, j]:.5g}"
            )
    return tuple(notes)
