"""The closed loop of a statement, built from the linear model, the controller and the actuators.

    x' = A x + B S a,  y = (C x + D S a, a),      the aircraft (S selects the inputs that a moves)
    a' = ω (λ u - a)  or  a'' = ω² (λ u - a) - 2 d ω a',
    x_c' = A_c x_c + B_c y,  u = C_c x_c + D_c y.

Without actuators a = u. The state is ζ = (x, a, a'/ω of second-order actuators, x_c).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from flint import arb, arb_mat

from hfa_aircraft.model import Model
from hfa_prove.check.trims import LinearModelBox
from hfa_prove.enclosure.balls import matrix
from hfa_prove.enclosure.series import TaylorModel
from hfa_prove.fields import Rejected
from hfa_prove.statements.schedule import Actuators, Controller, FixedActuators, UncertainActuators


@dataclass(frozen=True, eq=False)
class LoopBox:
    """Closed loop ζ' = base ζ + ω (lag ζ + G v) on a box, with commands u = U ζ.

    v are the commands after delay and effectiveness. ω is the bandwidth of the actuators, a
    diagonal matrix if the bandwidths differ. n is the number of states ζ, and a the number of
    actuators.

    base: (n, n), the aircraft and the controller
    lag: (n, n), dynamics of actuators with a bandwidth of 1 rad/s
    G: (n, a), input matrix of the actuators
    U: (a, n), gain of the commands
    """

    base: TaylorModel
    lag: arb_mat
    G: arb_mat
    U: TaylorModel


def closed_loop(
    linear: LinearModelBox, model: Model, controller: Controller, actuators: Actuators | None
) -> TaylorModel:
    """Return F (n, n) of ζ' = F ζ on a box, without actuators or with fixed ones.

    Raises Rejected if a controller without actuators measures anything but states, or if the box is
    not between two breakpoints of the controller.
    """
    if isinstance(actuators, FixedActuators):
        apart = actuated_loop(linear, model, controller, actuators)
        count = len(actuators.order)
        bandwidths = np.zeros(apart.G.nrows())
        start = len(model.linear)
        bandwidths[start : start + count] = actuators.bandwidth
        second = [i for i, order in enumerate(actuators.order) if order == 2]
        rates = slice(start + count, start + count + len(second))
        bandwidths[rates] = actuators.bandwidth[second]
        arriving = matrix(np.diag(actuators.effectiveness)) * apart.U
        return apart.base + matrix(np.diag(bandwidths)) * (apart.G * arriving + apart.lag)
    if any(name not in model.linear for name in controller.measurements):
        raise Rejected(
            "a measurement of the controller is not a state, which is supported only with actuators"
        )
    A, B, C, D = controller_on(controller, linear.trim.low, linear.trim.high)
    n = len(model.linear)
    k = controller.A.shape[1]
    x = matrix(np.eye(n, n + k))
    x_c = matrix(np.eye(n + k)[n:])
    y = matrix(_selected(model.linear, controller.measurements)) * x
    u = C * x_c + D * y
    S = matrix(_selected(controller.inputs, tuple(model.inputs)))
    loop = x.transpose() * (linear.A * x + linear.B * S * u)
    if k:
        loop += x_c.transpose() * (A * x_c + B * y)
    return loop


def actuated_loop(
    linear: LinearModelBox,
    model: Model,
    controller: Controller,
    actuators: FixedActuators | UncertainActuators,
) -> LoopBox:
    """Return the closed loop on a box with the commands v of the actuators as separate inputs."""
    n = len(model.linear)
    a = len(actuators.order)
    second = [i for i, order in enumerate(actuators.order) if order == 2]
    k = controller.A.shape[1]
    size = n + a + len(second) + k
    eye = np.eye(size)
    x = matrix(eye[:n])
    positions = matrix(eye[n : n + a])
    x_c = matrix(eye[size - k :])

    S = matrix(_selected(controller.inputs, tuple(model.inputs)))
    A, B, C, D = controller_on(controller, linear.trim.low, linear.trim.high)
    y = _measured(linear, model, controller, x, positions)
    base = x.transpose() * (linear.A * x + linear.B * S * positions)
    U = D * y
    if k:
        base += x_c.transpose() * (A * x_c + B * y)
        U += C * x_c

    lag = np.zeros((size, size))
    G = np.zeros((size, a))
    for i, order in enumerate(actuators.order):
        position = n + i
        driven = position
        if order == 2:
            driven = n + a + second.index(i)
            lag[position, driven] = 1.0
            lag[driven, driven] = -2.0 * actuators.damping[i]
        lag[driven, position] = -1.0
        G[driven, i] = 1.0
    return LoopBox(base, matrix(lag), matrix(G), U)


def _measured(
    linear: LinearModelBox,
    model: Model,
    controller: Controller,
    x: arb_mat,
    positions: arb_mat,
) -> TaylorModel:
    """Return the measurements y of the controller as a function of ζ.

    A measurement is a state, an output or a part of one, or the position of an actuator.

    x: matrix from ζ to the states of the aircraft
    positions: matrix from ζ to the positions of the actuators
    """
    p = len(controller.measurements)
    outputs = controller.outputs(model)
    S = matrix(_selected(controller.inputs, tuple(model.inputs)))
    states = np.zeros((p, len(model.linear)))
    moved = np.zeros((p, len(controller.inputs)))
    y = TaylorModel(matrix(np.zeros((p, x.ncols()))))
    for row, name in enumerate(controller.measurements):
        whole, counted = model.part(name)
        if name in model.linear:
            states[row, model.linear.index(name)] = 1.0
        elif whole in outputs:
            selected = np.zeros((p, len(outputs)))
            selected[row, outputs.index(whole)] = 1.0
            kept = matrix(np.diag([float(state in counted) for state in model.linear]))
            y += matrix(selected) * (linear.C * kept * x + linear.D * S * positions)
        else:
            moved[row, controller.inputs.index(name.removesuffix("_position"))] = 1.0
    return y + (matrix(states) * x + matrix(moved) * positions)


def _selected(names: Sequence[str], wanted: Sequence[str]) -> np.ndarray:
    """Return a matrix (wanted, names) with entries 1 where the names are equal, otherwise 0."""
    return np.array([[float(name == row) for name in names] for row in wanted])


def controller_on(controller: Controller, low: float, high: float) -> list[TaylorModel]:
    """Return A, B, C and D of the controller on a box between two breakpoints.

    low, high: ends of the box, values of the scheduling variable
    """
    tables = (controller.A, controller.B, controller.C, controller.D)
    return [between(controller.breakpoints, table, low, high) for table in tables]


def between(breakpoints: np.ndarray, table: np.ndarray, low: float, high: float) -> TaylorModel:
    """Return the linear interpolation of a table of matrices, on a box between two breakpoints.

    breakpoints: values of the scheduling variable, (g,)
    table: matrices at the breakpoints, (g, rows, columns)
    low, high: ends of the box

    Raises Rejected if a breakpoint is inside the box or the box extends beyond the table.
    """
    holding = [
        i
        for i, (first, last) in enumerate(pairwise(breakpoints.tolist()))
        if first <= low and high <= last
    ]
    if not holding:
        raise Rejected("the box crosses a breakpoint of the table or extends beyond the table")
    i = holding[0]
    first = arb(float(breakpoints[i]))
    last = arb(float(breakpoints[i + 1]))
    start = matrix(table[i])
    slope = (matrix(table[i + 1]) - start) * (1 / (last - first))
    at_low = start + slope * (arb(low) - first)
    at_high = start + slope * (arb(high) - first)
    return TaylorModel((at_low + at_high) * 0.5, (at_high - at_low) * 0.5)
