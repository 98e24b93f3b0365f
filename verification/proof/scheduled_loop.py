"""The loop that a table of gains closes, on a box of dihedrals."""

from __future__ import annotations

from itertools import pairwise
from typing import TYPE_CHECKING

import numpy as np

from controller.policy.gain_table import GainTable
from hfa_model.support.errors import BadInputError
from hfa_model.vectors import LINEAR_STATES
from verification.arithmetic.balls import exact, matrix, symmetric
from verification.balls.taylor import DihedralBox, TaylorForm
from verification.balls.trim_branch import ModelForms

if TYPE_CHECKING:
    from flint import arb_mat

_STATES = len(LINEAR_STATES)


def segments(table: GainTable, low: float, high: float) -> list[DihedralBox]:
    """The interval, cut at the angles of the table, degrees. BadInputError when the table does not reach."""
    if len(table.dihedral_deg) < 2:
        raise BadInputError("a table of gains needs at least two dihedral angles, in increasing order")
    first, last = float(table.dihedral_deg[0]), float(table.dihedral_deg[-1])
    if low < first or high > last:
        raise BadInputError(
            f"the table covers {first:g} to {last:g} deg, not {low:g} to {high:g} deg; prove it where it is"
        )
    cuts = [low, *(angle for angle in table.dihedral_deg.tolist() if low < angle < high), high]
    return [DihedralBox(a, b) for a, b in pairwise(cuts)]


def closed_loop(table: GainTable, forms: ModelForms) -> tuple[TaylorForm, list[arb_mat]]:
    """The closed loop on a box that crosses no angle of the table, and what the parameters' errors add to it."""
    from flint import arb_mat

    box, n = forms.box, table.K.shape[-1]
    index = int(np.searchsorted(table.dihedral_deg, box.low, side="right")) - 1
    first, second = (exact(angle) for angle in table.dihedral_deg[index : index + 2].tolist())

    def affine(values: np.ndarray) -> tuple[arb_mat, arb_mat]:
        slope = (matrix(values[index + 1]) - matrix(values[index])) / (second - first)
        return matrix(values[index]) + (box.middle - first) * slope, slope

    (K, K_slope), (M, M_slope), (N, N_slope), (X, X_slope) = map(affine, (table.K, table.M, table.N, table.X))
    states = matrix(np.eye(_STATES, n))
    up, zero = states.transpose(), matrix(np.zeros((n, n)))
    steered = forms.B.times_affine(-K, -K_slope)
    loop = (forms.A.map(lambda part: part * states) + steered).map(lambda part: up * part)
    loop += TaylorForm((M, M_slope, zero), zero, box.radius)
    K_all, N_all, X_all = (a + symmetric(box.radius) * b for a, b in ((K, K_slope), (N, N_slope), (X, X_slope)))
    errors = [
        up * (each.A * states - each.B * K_all) + N_all * (each.A * X_all - each.B * K_all) for each in forms.errors
    ]
    if table.N.any():
        seen = (forms.A.times_affine(X, X_slope) + steered).map(arb_mat.transpose)
        loop += seen.times_affine(N.transpose(), N_slope.transpose()).map(arb_mat.transpose)
    return loop, errors
