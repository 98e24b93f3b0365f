"""The loop that a table of gains closes, on a box of dihedrals."""

from __future__ import annotations

from itertools import pairwise

import numpy as np

from controller.policy.gain_table import GainTable
from hfa_model.vectors import LINEAR_STATES
from hfa_support.errors import BadInputError
from verification.arithmetic.balls import exact, matrix
from verification.arithmetic.taylor_model import TaylorModel
from verification.enclosures.taylor import DihedralBox
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
