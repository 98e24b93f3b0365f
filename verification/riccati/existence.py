"""Does the game have a value? A test that stays sharp where P itself grows without bound."""

from __future__ import annotations

import numpy as np

from controller.game.zero_sum import Game
from verification.riccati.certificate import hamiltonian_checks
from verification.riccati.units import balanced_units, in_units

#: Rounding of the test, three orders above it: X1 and X2 come from one orthonormal basis.
SEMIDEFINITE = 1e-12


def has_value(game: Game) -> bool:
    """The Hamiltonian splits, and X1'X2 >= 0 for the basis [X1; X2] of its stable subspace.

    Where X1 is regular P = X2 X1⁻¹ is the stabilizing solution, and X1'X2 = X1'P X1 has its signs. As delta
    falls to its minimum P grows without bound while X1 and X2 stay within one: an eigenvalue of X1'X2 passes
    through zero. That makes the minimum visible to rounding, where the residual or the sign of P, which are
    lost some 1e-4 above it, would not do.
    Source: Basar and Bernhard, H-infinity Optimal Control, Section 4.5 (conjugate points).
    """
    from scipy.linalg import schur

    if not all(check.ok for check in hamiltonian_checks(game)):
        return False
    balanced = in_units(game, balanced_units(game))
    n = len(balanced.A)
    H = np.block([[balanced.A, -balanced.S], [-balanced.Q, -balanced.A.T]])
    _, basis, stable = schur(H, sort="lhp")
    if stable != n:
        return False
    product = basis[:n, :n].T @ basis[n:, :n]
    return bool(np.linalg.eigvalsh((product + product.T) / 2.0)[0] >= -SEMIDEFINITE)
