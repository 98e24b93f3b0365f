"""Tables over the dihedral: linear between the angles, constant beyond their ends; for numbers and for symbols."""

from __future__ import annotations

from collections.abc import Sequence

import casadi as ca
import numpy as np

from hfa_model.vectors import Quantity


def shares(dihedrals: np.ndarray, at: float) -> np.ndarray:
    """Share of each angle of a table at η = `at`, (N,): two neighbours, or one end."""
    return np.array([np.interp(at, dihedrals, column) for column in np.eye(len(dihedrals))])


def interpolated(dihedrals: np.ndarray, rows: np.ndarray, at: Quantity) -> ca.SX | ca.DM:
    """row_0 + Σ_i (row_i+1 - row_i) sat((η - η_i)/(η_i+1 - η_i), 0, 1), (k,), at η = `at`, rad; rows: (N, k)."""
    value: ca.SX | ca.DM = ca.DM(rows[0])
    for low, high, difference in zip(dihedrals[:-1], dihedrals[1:], np.diff(rows, axis=0), strict=True):
        share = ca.fmin(ca.fmax((at - float(low)) / float(high - low), 0.0), 1.0)
        value = value + ca.sparsify(ca.DM(difference)) * share
    return value


class DihedralTable:
    """Matrices (N, rows, columns) each, looked up together: one function that is called and not written out."""

    def __init__(self, dihedrals: np.ndarray, stacks: Sequence[np.ndarray]) -> None:
        self._shapes = [stack.shape[1:] for stack in stacks]
        flat = np.hstack([stack.transpose(0, 2, 1).reshape(len(stack), -1) for stack in stacks])
        eta = ca.SX.sym("eta")
        looked_up = ca.densify(ca.SX(interpolated(dihedrals, flat, eta)))
        self._function = ca.Function("table", [eta], [looked_up], {"never_inline": True})

    def at(self, dihedral: ca.SX) -> tuple[ca.SX, ...]:
        """Each matrix at a dihedral, rad."""
        ends = np.cumsum([0, *(rows * columns for rows, columns in self._shapes)]).tolist()
        parts = ca.vertsplit(self._function(dihedral), ends)
        return tuple(ca.reshape(part, *shape) for part, shape in zip(parts, self._shapes, strict=True))
