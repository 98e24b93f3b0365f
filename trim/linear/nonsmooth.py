"""Nonsmooth points of the equations: points at which the slopes on both sides differ.

It is the knot of a table, or the switching point of |x|, min, max, sign, a comparison or a
rounding. There, an entry of A or B is the mean of the slopes on both sides, as a central
difference is.
"""

from __future__ import annotations

from collections.abc import Sequence
from functools import lru_cache
from typing import NamedTuple

import casadi as ca
import numpy as np

from hfa_aircraft.layout import Layout, Linearization
from hfa_aircraft.model import Model
from hfa_support.native.bound import RowFunction

_ONE_ARGUMENT = {ca.OP_FABS, ca.OP_SIGN}
_TWO_ARGUMENTS = {ca.OP_FMIN, ca.OP_FMAX, ca.OP_LT, ca.OP_LE, ca.OP_EQ, ca.OP_NE}
_ROUNDING = {ca.OP_FLOOR, ca.OP_CEIL}
#: Step for the slopes, as a fraction of the nominal value. The slopes are exact, so the step needs
#: only to be resolved (ten digits of it are) and small beside the curvature.
STEP = 1e-6
#: Distance of the points on both sides, in steps. A switch is at most two steps away.
_DISTANCE = 3.0
#: Number of points near a switch at which slopes are computed together.
_AT_ONCE = 10_000
#: Largest difference of equal slopes, as a fraction of 1 + |slope|, in scaled units. Extrapolation
#: leaves (3 STEP)² J'', 1e-11 of a J'' of 1, and 1e-6 of one of 1e5.
_SLOPE_TOLERANCE = 1e-6
#: Smallest jump of a rate, as a fraction of the change due to the slopes, and of the rate's scale,
#: whose balance in a trim is 1e-10.
_JUMP, _LEAST_JUMP = 1e-2, 1e-9


class NearSwitches(NamedTuple):
    """Points near a switch of the equations, and the states and inputs that affect a switch.

    points: indices of the points
    columns: indices of the states and inputs, states first
    """

    points: np.ndarray
    columns: np.ndarray


class MeanSlopes(NamedTuple):
    """A and B at N points, with the mean slopes of both sides at nonsmooth points.

    A: (N, n, n)
    B: (N, n, m)
    notes: index of a point -> a sentence for each entry of A or B at a nonsmooth point or a jump
    """

    A: np.ndarray
    B: np.ndarray
    notes: dict[int, tuple[str, ...]]


def means_at_nonsmooth_points(
    model: Model, x: np.ndarray, u: np.ndarray, p: np.ndarray, A: np.ndarray, B: np.ndarray
) -> MeanSlopes:
    """Return A and B at N points, with the mean slope of both sides in each nonsmooth entry.

    If a rate jumps, the slope does not contain the jump, and a note names it. Points without a trim
    (nan) are skipped.

    x: (N, n), states
    u: (N, m), inputs
    p: (N, k), parameters
    A: (N, n, n), derivatives of the rates with respect to the states
    B: (N, n, m), derivatives of the rates with respect to the inputs
    """
    near, columns = near_switches(model, x, u, p)
    if not near.size:
        return MeanSlopes(A, B, {})
    jacobian = np.concatenate([A, B], axis=2)
    notes: dict[int, list[str]] = {}
    for first in range(0, len(near), _AT_ONCE):
        points = near[first : first + _AT_ONCE]
        z = np.concatenate([x[points], u[points]], axis=1)
        for column in columns.tolist():
            slopes = jacobian[points, :, column]
            jacobian[points, :, column], found = _mean_along(model, z, p[points], slopes, column)
            for place, sentences in found.items():
                notes.setdefault(int(points[place]), []).extend(sentences)
    n = len(model.states)
    notes_in_order = {point: tuple(notes[point]) for point in sorted(notes)}
    return MeanSlopes(jacobian[:, :, :n], jacobian[:, :, n:], notes_in_order)


def linearization_at(
    model: Model,
    x: np.ndarray,
    u: np.ndarray,
    outputs: Sequence[str] = (),
    disturbances: Sequence[str] = (),
) -> tuple[Linearization, tuple[str, ...]]:
    """Return derivatives of a model at a point, mean slopes where not smooth, and notes.

    x: (n,), state
    u: (m,), input
    outputs, disturbances: names of outputs and disturbances

    Raises BadInputError and NotFiniteError as `Model.at` does.
    """
    x, u = np.asarray(x, dtype=float), np.asarray(u, dtype=float)
    exact = model.at(x, u, outputs, disturbances)
    A, B = exact.A[None], exact.B[None]
    found = means_at_nonsmooth_points(model, x[None], u[None], model.p[None], A, B)
    if not found.notes:
        return exact, ()
    return exact._replace(A=found.A[0], B=found.B[0]), found.notes[0]


def near_switches(model: Model, x: np.ndarray, u: np.ndarray, p: np.ndarray) -> NearSwitches:
    """Return the points near a switch, and the states and inputs that affect a switch.

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
    steps = _steps(model)
    switches = _switches(model.layout, steps)
    if switches is None:
        return NearSwitches(np.flatnonzero(np.isfinite(x).all(axis=1)), np.arange(len(steps)))
    distances, changes = switches(x, u, p)
    is_near = distances <= 0.0
    points = np.flatnonzero(is_near.any(axis=1))
    changes_of_near = changes.reshape(*distances.shape, len(steps))[is_near]
    if not changes_of_near.any(axis=1).all():  # a switch of second order in all of them
        return NearSwitches(points, np.arange(len(steps)))
    return NearSwitches(points, np.flatnonzero(changes_of_near.any(axis=0)))


@lru_cache(maxsize=16)
def _steps(model: Model) -> tuple[float, ...]:
    """Return the finite-difference step of each state and input."""
    return (*(STEP * model.nominal((*model.states, *model.inputs))).tolist(),)


@lru_cache(maxsize=16)
def _rate_scales(model: Model) -> np.ndarray:
    """Return the typical magnitude of each rate, (n,)."""
    return np.array([model.rate_scale(state) for state in model.states])


@lru_cache(maxsize=16)
def rates_of(layout: Layout) -> ca.Function:
    """Return the CasADi Function (x, u, p) -> rates of the states."""
    vectors = layout.symbols("x", "u", "p")
    rates, _ = layout.expressions(vectors, ())
    return ca.Function("rates", vectors, [rates])


@lru_cache(maxsize=16)
def _switches(layout: Layout, steps: tuple[float, ...]) -> RowFunction | None:
    """Return a function that shows how near points (x, u, p) are to each switch of the rates, or
    None if the rates call functions, such as `casadi.interpolant`, whose switches are not visible.
    """
    # A switch |.|, sign, min, max, comparison or rounding is at the zeros of an expression s. A
    # step of state or input i changes s by m_i = |∂s/∂z_i| step_i. For each switch, the function
    # returns |s| - 2 Σ m_i, which is not positive near the switch, and all m_i.
    rates = rates_of(layout)
    operations = [rates.instruction_id(k) for k in range(rates.n_instructions())]
    if ca.OP_CALL in operations:
        return None

    # The rates are computed once more, operation by operation, to collect the expressions s.
    x, u, p = vectors = layout.symbols("x", "u", "p")
    switches = []
    memory = [ca.SX(0) for _ in range(rates.sz_w())]
    for k, operation in enumerate(operations):
        sources = rates.instruction_input(k)
        (target, *_) = rates.instruction_output(k)
        if operation == ca.OP_INPUT:
            vector, entry = sources
            memory[target] = vectors[vector][entry]
        elif operation == ca.OP_CONST:
            memory[target] = ca.SX(rates.instruction_constant(k))
        elif operation != ca.OP_OUTPUT:
            operands = [memory[source] for source in sources]
            if operation in _ONE_ARGUMENT:
                switches.append(operands[0])
            elif operation in _TWO_ARGUMENTS:
                switches.append(operands[0] - operands[1])
            elif operation in _ROUNDING:
                switches.append(ca.sin(ca.pi * operands[0]))  # 0 at every integer
            make = ca.SX.unary if len(operands) == 1 else ca.SX.binary
            memory[target] = make(operation, *operands)

    z = ca.vertcat(x, u)
    affected = [switch for switch in switches if ca.depends_on(switch, z)]
    s = ca.vertcat(ca.SX(0, 1), *affected)  # a column even without a switch
    changes = ca.fabs(ca.densify(ca.jacobian(s, z))) @ ca.diag(ca.DM(steps))
    distances = ca.fabs(s) - 2 * ca.sum2(changes)
    parts = [ca.densify(distances), ca.vec(ca.densify(changes).T)]
    return RowFunction(ca.Function("switches", [x, u, p], parts))


def _mean_along(
    model: Model, z: np.ndarray, p: np.ndarray, slopes: np.ndarray, column: int
) -> tuple[np.ndarray, dict[int, list[str]]]:
    """Return slopes (N, n) along a state or input, the mean where both sides differ, and notes by
    point.
    """
    name, signal = [*model.states.items(), *model.inputs.items()][column]
    rate_scales = _rate_scales(model)
    step = _DISTANCE * STEP * signal.nominal  # beyond a switch, which is at most two STEP away
    below = _side(model, z, p, column, -step)
    above = _side(model, z, p, column, step)
    curvature = below.changes + above.changes  # change of the slopes in a step

    # Where the rates are smooth, the slopes extrapolated from both sides differ by less than this:
    allowed = _SLOPE_TOLERANCE * (rate_scales / signal.nominal + np.abs(slopes)) + curvature
    differences = np.maximum(np.abs(below.slopes - slopes), np.abs(above.slopes - slopes))
    is_nonsmooth = differences > allowed
    mean = np.where(is_nonsmooth, (below.slopes + above.slopes) / 2.0, slopes)

    # A jump is a change of the rates between both sides that the slopes do not explain.
    gap = np.abs(above.rates - below.rates - step * (above.slopes + below.slopes))
    by_slopes = step * (np.abs(above.slopes) + np.abs(below.slopes))
    jumps = gap > _JUMP * by_slopes + step * curvature + _LEAST_JUMP * rate_scales

    matrix = "A" if column < len(model.states) else "B"
    notes: dict[int, list[str]] = {}
    for place, row in np.argwhere(is_nonsmooth | jumps).tolist():
        state = model.state_names[row]
        entry = f"{matrix}({state}, {name})"
        if jumps[place, row]:
            note = _note_on_jump(entry, state, name, mean[place, row])
        else:
            note = _note_on_sides(entry, below.slopes[place, row], above.slopes[place, row])
        notes.setdefault(place, []).append(note)
    return mean, notes


def _note_on_jump(entry: str, state: str, name: str, slope: float) -> str:
    """Return a sentence on a rate that jumps; the slope is that without the jump."""
    slope += 0.0  # without -0
    return (
        f"jump: the rate of {state} jumps as {name} passes its value; {entry} is {slope:.5g}, "
        "without the jump"
    )


def _note_on_sides(entry: str, below: float, above: float) -> str:
    """Return a sentence on an entry of A or B whose slopes below and above the trim differ."""
    return (
        f"nonsmooth point: {entry} is {below + 0.0:.5g} below and {above + 0.0:.5g} above the "
        "trim; their mean is used"
    )


class _Side(NamedTuple):
    """Rates and slopes on one side of N points, (N, n) each."""

    rates: np.ndarray  # a step away from the points
    slopes: np.ndarray  # of the rates at the points, extrapolated from this side
    changes: np.ndarray  # magnitudes of the change of the slopes in a step


def _side(model: Model, z: np.ndarray, p: np.ndarray, column: int, step: float) -> _Side:
    """Return rates and slopes along a state or input on the side to which a step leads."""
    # The slopes are 2 J(step) - J(2 step), with an error of the order of step² J''.
    n = len(model.states)
    direction = np.zeros(z.shape)
    direction[:, column] = 1.0
    along = _rates_along(model.layout)
    at, farther = z + step * direction, z + 2.0 * step * direction
    rates, near = along(at[:, :n], at[:, n:], p, direction)
    _, far = along(farther[:, :n], farther[:, n:], p, direction)
    return _Side(rates=rates, slopes=2.0 * near - far, changes=np.abs(near - far))


@lru_cache(maxsize=16)
def _rates_along(layout: Layout) -> RowFunction:
    """Return the function (x, u, p, direction) -> rates, their derivatives in the direction."""
    rates = rates_of(layout)
    x, u, p = rates.sx_in()
    z = ca.vertcat(x, u)
    direction = ca.SX.sym("direction", z.numel())
    f = rates(x, u, p)
    parts = [ca.densify(f), ca.densify(ca.jtimes(f, z, direction))]
    return RowFunction(ca.Function("along", [x, u, p, direction], parts))
