"""Kinks of the equations: points at which the slopes on both sides differ.

A kink is the knot of a table, or the switching point of |x|, min, max, sign, a comparison or a
rounding. At a kink, the affected entries of A and B are the means of the slopes on both sides.
"""

from __future__ import annotations

from collections.abc import Sequence
from functools import lru_cache
from typing import NamedTuple

import casadi as ca
import numpy as np

from hfa_aircraft.layout import Layout, Linearization, components
from hfa_aircraft.model import Model
from hfa_support.native.bound import RowFunction

_ONE_ARGUMENT = {ca.OP_FABS, ca.OP_SIGN}
_TWO_ARGUMENTS = {ca.OP_FMIN, ca.OP_FMAX, ca.OP_LT, ca.OP_LE, ca.OP_EQ, ca.OP_NE}
_ROUNDING = {ca.OP_FLOOR, ca.OP_CEIL}
#: Step for the slopes, as a fraction of the nominal value.
STEP = 1e-6
#: Number of points near a switch at which slopes are compared together.
_AT_ONCE = 1_000
#: Largest difference of equal slopes, as a fraction of 1 + |derivative|, in scaled units.
_APART = 1e-4
#: Fraction of this difference that is significant in a column with a kink in another entry.
_FELT = 1e-2
#: Empty result: no points, no states and inputs.
_NOWHERE = (np.zeros(0, dtype=int), np.zeros(0, dtype=int))


class Smoothed(NamedTuple):
    """A and B at N points, with mean slopes at kinks.

    A: (N, n, n)
    B: (N, n, m)
    notes: index of a point -> a sentence for each entry of A or B at a kink or a jump
    """

    A: np.ndarray
    B: np.ndarray
    notes: dict[int, tuple[str, ...]]


def with_means_at_kinks(
    model: Model, x: np.ndarray, u: np.ndarray, p: np.ndarray, A: np.ndarray, B: np.ndarray
) -> Smoothed:
    """Return A and B at N points, with the mean of the slopes on both sides in each entry at a
    kink.

    x: (N, n), states
    u: (N, m), inputs
    p: (N, k), parameters
    A: (N, n, n), derivatives of the rates with respect to the states
    B: (N, n, m), derivatives of the rates with respect to the inputs

    An entry is at a kink if the finite-difference slopes are constant on each side, but differ from
    the derivative on at least one side. If the rate itself jumps, the entry is unchanged and gets a
    note. Points without a trim (nan) are skipped.
    """
    near, columns = near_switches(model, x, u, p)
    if not near.size:
        return Smoothed(A, B, {})
    jacobian = np.concatenate([A, B], axis=2)
    notes: dict[int, tuple[str, ...]] = {}
    for first in range(0, len(near), _AT_ONCE):
        points = near[first : first + _AT_ONCE]
        z = np.concatenate([x[points], u[points]], axis=1)
        means, words = _means(model, z, p[points], jacobian[points], columns)
        jacobian[points] = means
        notes |= {point: said for point, said in zip(points.tolist(), words, strict=True) if said}
    n = len(model.states)
    return Smoothed(jacobian[:, :, :n], jacobian[:, :, n:], notes)


def linearization_at(
    model: Model,
    x: np.ndarray,
    u: np.ndarray,
    outputs: Sequence[str] = (),
    disturbances: Sequence[str] = (),
) -> tuple[Linearization, tuple[str, ...]]:
    """Return the derivatives of a model at a point, with mean slopes at kinks, and notes on the
    kinks.

    x: (n,), state
    u: (m,), input
    outputs, disturbances: names of outputs and disturbances

    Raises BadInputError and FloatingPointError as `Model.at` does.
    """
    exact = model.at(x, u, outputs, disturbances)
    X, U = (np.asarray(vector, dtype=float)[None] for vector in (x, u))
    smoothed = with_means_at_kinks(model, X, U, model.p[None], exact.A[None], exact.B[None])
    if not smoothed.notes:
        return exact, ()
    return exact._replace(A=smoothed.A[0], B=smoothed.B[0]), smoothed.notes[0]


def near_switches(
    model: Model, x: np.ndarray, u: np.ndarray, p: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Return the indices of the points near a switch, and of the states and inputs that affect a
    switch.

    A point is near a switch if finite-difference steps of the states and inputs may reach the
    switch. There are two special cases:

    - If a switch depends on states and inputs in second order only, all states and inputs are
      returned.
    - If the equations call functions, all finite points and all states and inputs are returned. The
      operations in these functions are not visible.

    x: (N, n), states
    u: (N, m), inputs
    p: (N, k), parameters
    """
    steps = steps_of(model)
    switches = _switches(model.layout, steps)
    if switches is None:
        if not _calls_functions(model.layout):
            return _NOWHERE
        return np.flatnonzero(np.isfinite(x).all(axis=1)), np.arange(len(steps))
    distances, moves = switches(x, u, p)
    near = distances <= 0.0
    if not near.any():
        return _NOWHERE
    points = np.flatnonzero(near.any(axis=1))
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


def _slopes_around(model: Model, z: np.ndarray, p: np.ndarray, columns: np.ndarray) -> np.ndarray:
    """Return the slopes of the rates around N points along some states and inputs, (N, 6, n,
    columns).

    The six slopes are those between adjacent points at -3, -2, ..., 3 finite-difference steps.

    z: (N, n + m), states and inputs
    p: (N, k), parameters
    columns: indices of the states and inputs that are varied
    """
    n = len(model.states)
    count, size = z.shape
    steps = np.array(steps_of(model))
    offsets = np.arange(-3, 4)[:, None, None] * np.diag(steps)[columns]
    places = (z[:, None, None, :] + offsets).reshape(-1, size)
    parameters = np.repeat(p, 7 * len(columns), axis=0)
    (rates,) = _rate_rows(model.layout)(places[:, :n], places[:, n:], parameters)
    by_place = rates.reshape(count, 7, len(columns), n).swapaxes(2, 3)
    return np.diff(by_place, axis=1) / steps[columns]


@lru_cache(maxsize=16)
def _rate_rows(layout: Layout) -> RowFunction:
    """Return `rates_of(layout)` as a function of many rows."""
    vectors = layout.symbols("x", "u", "p")
    return RowFunction(ca.Function("rows", vectors, [ca.densify(rates_of(layout)(*vectors))]))


def _exact_sides(
    model: Model, z: np.ndarray, p: np.ndarray, columns: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Return the exact derivatives of the rates just below and just above N kinks, (N, n) each.

    The derivatives are extrapolated by 15 J(2 h) - 24 J(2.5 h) + 10 J(3 h) from exact derivatives J
    at multiples of a step h from the point. A kink may be up to one step from the point.
    The error is of the order of h³ J'''.

    z: (N, n + m), states and inputs
    p: (N, k), parameters
    columns: (N,), index of the state or input at a kink
    """
    n = len(model.states)
    directions = np.eye(z.shape[1])[columns]
    steps = directions * steps_of(model)
    derivative = _derivative_of(model.layout)

    def extrapolated(steps: np.ndarray) -> np.ndarray:
        """Return the derivatives on the side of the points to which the steps lead, (N, n)."""
        near, middle, far = (
            derivative(at[:, :n], at[:, n:], p, directions)[0]
            for at in (z + 2.0 * steps, z + 2.5 * steps, z + 3.0 * steps)
        )
        return 15.0 * near - 24.0 * middle + 10.0 * far

    return extrapolated(-steps), extrapolated(steps)


@lru_cache(maxsize=16)
def _derivative_of(layout: Layout) -> RowFunction:
    """Return the function (x, u, p, direction) -> derivatives of the rates along it, (N, n)."""
    rates = rates_of(layout)
    x, u, p = rates.sx_in()
    z = ca.vertcat(x, u)
    direction = ca.SX.sym("direction", z.numel())
    along = ca.densify(ca.jtimes(rates(x, u, p), z, direction))
    return RowFunction(ca.Function("along", [x, u, p, direction], [along]))


def _means(
    model: Model, z: np.ndarray, p: np.ndarray, jacobian: np.ndarray, columns: np.ndarray
) -> tuple[np.ndarray, list[tuple[str, ...]]]:
    """Return the Jacobians of N points with means of both slopes in the entries at a kink, and the
    notes of each point.

    Each note is a sentence on one entry at a kink. An entry at which the rate jumps also gets a
    note, but is not replaced.

    z: (N, n + m), states and inputs
    p: (N, k), parameters
    jacobian: (N, n, n + m)
    columns: indices of the states and inputs that affect a switch
    """
    n = len(model.states)
    names = (*model.states, *model.inputs)
    slopes = _slopes_around(model, z, p, columns)
    derivative = jacobian[:, :, columns]
    below = 2.5 * slopes[:, 1] - 1.5 * slopes[:, 0]
    above = 2.5 * slopes[:, 4] - 1.5 * slopes[:, 5]
    nominal = np.array(steps_of(model))[columns] / STEP
    scale = nominal / np.array([[model.rate_scale(name)] for name in model.states])
    allowed = _APART * (1 + np.abs(derivative) * scale) / scale
    smooth_below = np.abs(slopes[:, 1] - slopes[:, 0]) <= allowed
    smooth_above = np.abs(slopes[:, 5] - slopes[:, 4]) <= allowed
    differs = np.maximum(np.abs(below - derivative), np.abs(above - derivative)) > allowed
    # Across a kink, the two middle slopes are between the outer ones, or mixtures of them.
    across = np.abs(slopes[:, 2] + slopes[:, 3] - below - above)
    jumps = smooth_below & smooth_above & (across > 2 * np.abs(above - below) + allowed)
    kinks = smooth_below & smooth_above & differs & ~jumps
    # A kink in one rate is also one in other rates, even if its effect on them is small.
    felt = np.abs(above - below) > _FELT * allowed
    kinks |= kinks.any(axis=1, keepdims=True) & smooth_below & smooth_above & felt & ~jumps
    point, place = np.nonzero(kinks.any(axis=1))
    if point.size:
        sides = _exact_sides(model, z[point], p[point], columns[place])
        below[point, :, place], above[point, :, place] = sides
    means = jacobian.copy()
    notes: list[list[str]] = [[] for _ in z]
    for k, j, i in np.argwhere((kinks | jumps).swapaxes(1, 2)).tolist():
        column = int(columns[j])
        entry = f"{'A' if column < n else 'B'}({names[i]}, {names[column]})"
        if jumps[k, i, j]:
            notes[k].append(
                f"jump: the rate of {names[i]} jumps as {names[column]} passes its value; {entry} "
                f"is {jacobian[k, i, column] + 0.0:.5g}, without the jump"
            )
        else:
            means[k, i, column] = (below[k, i, j] + above[k, i, j]) / 2
            notes[k].append(
                f"kink: {entry} is {means[k, i, column] + 0.0:.5g}, the mean of the slopes below "
                f"and above, {below[k, i, j]:.5g} and {above[k, i, j]:.5g}"
            )
    return means, [tuple(words) for words in notes]
