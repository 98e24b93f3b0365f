"""Several matrices over the dihedral, looked up together in a CasADi expression."""

from __future__ import annotations

from collections.abc import Sequence

import casadi as ca
import numpy as np

from hfa_support.linear_table import LinearTable


class DihedralTable:
    """Matrices (N, rows, columns) each, as a `LinearTable`: one function that is called and not written out."""

    def __init__(self, dihedrals: np.ndarray, stacks: Sequence[np.ndarray]) -> None:
        self._shapes = [stack.shape[1:] for stack in stacks]
        flat = np.hstack([stack.transpose(0, 2, 1).reshape(len(stack), -1) for stack in stacks])
        eta = ca.SX.sym("eta")
        looked_up = ca.densify(LinearTable(dihedrals, flat).expression(eta))
        self._function = ca.Function("table", [eta], [looked_up], {"never_inline": True})

    def at(self, dihedral: ca.SX) -> tuple[ca.SX, ...]:
        """Each matrix at a dihedral, rad."""
        ends = np.cumsum([0, *(rows * columns for rows, columns in self._shapes)]).tolist()
        parts = ca.vertsplit(self._function(dihedral), ends)
        return tuple(ca.reshape(part, *shape) for part, shape in zip(parts, self._shapes, strict=True))
