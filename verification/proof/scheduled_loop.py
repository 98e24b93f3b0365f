"""The loop that a table of gains closes, on a box of dihedrals."""

from __future__ import annotations

from collections.abc import Mapping
from itertools import pairwise

import numpy as np

from controller.design.design import SHORT_PERIOD, Actuator
from controller.design.scheduled_controller import ScheduledController
from controller.policy.gain_table import GainTable
from hfa_model.vectors import INPUTS, LINEAR_STATES
from hfa_support.errors import BadInputError
from verification.arithmetic.balls import exact, matrix
from verification.arithmetic.taylor_model import TaylorModel
from verification.enclosures.dihedral_box import DihedralBox
from verification.enclosures.trim_branch import ModelForms

_STATES = len(LINEAR_STATES)


def segments(table: GainTable, low: float, high: float) -> list[DihedralBox]:
    """The interval, cut at the angles of the table, degrees. BadInputError when the table does not reach."""
    if len(table.dihedral_deg) < 2:
        raise BadInputError("a table of gains needs at least two dihedral angles, in increasing order")
    if not low < high:
        raise BadInputError(f"the interval goes from {low:g} to {high:g} deg; give the lower end first")
    first, last = float(table.dihedral_deg[0]), float(table.dihedral_deg[-1])
    if low < first or high > last:
        raise BadInputError(
            f"the table covers {first:g} to {last:g} deg, not {low:g} to {high:g} deg; prove it where it is"
        )
    cuts = [low, *(angle for angle in table.dihedral_deg.tolist() if low < angle < high), high]
    return [DihedralBox(a, b) for a, b in pairwise(cuts)]


def closed_loop(table: GainTable, forms: ModelForms) -> TaylorModel:
    """ζ' = (A x - B K ζ, 0) + N (A X ζ - B K ζ) + M ζ on a box that crosses no angle of the table."""
    box, n = forms.box, table.K.shape[-1]
    index = int(np.searchsorted(table.dihedral_deg, box.low, side="right")) - 1
    first, second = (exact(angle) for angle in table.dihedral_deg[index : index + 2].tolist())

    def affine(values: np.ndarray) -> TaylorModel:
        slope = (matrix(values[index + 1]) - matrix(values[index])) / (second - first)
        return TaylorModel(matrix(values[index]) + (box.middle - first) * slope, slope * box.radius)

    states, steered = matrix(np.eye(_STATES, n)), forms.B * affine(table.K)
    loop = states.transpose() * (forms.A * states - steered) + affine(table.M)
    return loop + affine(table.N) * (forms.A * affine(table.X) - steered) if table.N.any() else loop


_X = len(LINEAR_STATES)
#: Of the angles, deg: they were degrees before they became radians.
_DIGITS = 10
_ALPHA = LINEAR_STATES.index("alpha")
_ACCELERATION = f"vertical_acceleration{SHORT_PERIOD}"


def servo_table(controller: ScheduledController, actuators: Mapping[str, Actuator], speed: float) -> GainTable:
    """ζ = (x, a, x_c): the aircraft, its actuators, the controller, commands at rest.

    a: positions, then rates, of the actuators of the controller's inputs; every input needs one. Measured may be
    states and `vertical_acceleration_short_period`, V (A(α, α) α + B(α, ·) u) with V the speed of the trim, ft/s.
    BadInputError names what is missing or measured otherwise.
    """
    inputs = controller.inputs
    missing = [name for name in inputs if name not in actuators]
    if missing:
        raise BadInputError(f"controller {controller.name}: {missing[0]} has no actuator; name a design that has one")
    own = [actuators[name] for name in inputs]
    second = [i for i, each in enumerate(own) if each.order == 2]
    m, start = len(inputs), _X + len(inputs) + len(second)
    count, size = len(controller.dihedrals), start + len(controller.states)
    K, M = np.zeros((count, len(INPUTS), size)), np.zeros((count, size, size))
    N, X = np.zeros((count, size, _X)), np.zeros((count, _X, size))
    X[:, _ALPHA, _ALPHA] = 1.0
    measured, memory = np.zeros((len(controller.measurements), size)), slice(start, size)
    B, D = (each[..., : len(measured)] for each in (controller.B, controller.D))
    for row, name in enumerate(controller.measurements):
        if name in LINEAR_STATES:
            measured[row, LINEAR_STATES.index(name)] = 1.0
        elif name != _ACCELERATION:
            raise BadInputError(f"controller {controller.name}: a proof takes no measurement of {name}")
        elif D[..., row].any():
            raise BadInputError(f"controller {controller.name}: {name} reaches the inputs at once; filter it")
        else:
            N[:, memory, _ALPHA] = speed * B[..., row]
    asked = D @ measured
    asked[..., memory] += controller.C
    M[:, memory] = B @ measured
    M[:, memory, memory] += controller.A
    for i, (name, each) in enumerate(zip(inputs, own, strict=True)):
        K[:, INPUTS.index(name), _X + i] = -1.0
        row, w = _X + i, each.bandwidth
        if each.order == 2:
            rate = _X + m + second.index(i)
            M[:, row, rate] = 1.0
            M[:, rate, rate] = -2.0 * each.damping * w
            row, w = rate, w * w
        M[:, row, _X + i] -= w
        M[:, row] += w * each.effectiveness * asked[:, i]
    return GainTable(np.round(np.degrees(controller.dihedrals), _DIGITS), K, M, N, X)
