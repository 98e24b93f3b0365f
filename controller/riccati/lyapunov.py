"""Lyapunov equations F'Z + Z F = C, and F'Z F - Z = C in discrete time, for many C."""

from __future__ import annotations

from typing import Self

import numpy as np


class Lyapunov:
    """Solver of F'Z + Z F = C for one F (n, n) and symmetric C (n, n), by the Schur form of F.

    Raises LinAlgError if the Schur form does not converge, and ValueError for infinite entries.
    Source: Bartels and Stewart, Communications of the ACM 15 (1972), 820-826.
    """

    def __init__(self, F: np.ndarray) -> None:
        from scipy.linalg.lapack import dgees

        self._T, _, _, _, self._U, _, failed = dgees(_unsorted, np.asarray_chkfinite(F))
        if failed:
            raise np.linalg.LinAlgError("the Schur form does not converge")
        self._into = np.eye(len(F))  # the right side is into'C into, see `of_steps`

    @classmethod
    def of_steps(cls, F: np.ndarray) -> Self:
        """Return the solver of F'Z F - Z = C, whose F must not have the eigenvalue -1.

        With W = (F + 1)⁻¹, it has the solution of F₁'Z + Z F₁ = 2 W'C W with F₁ = (F - 1) W.
        """
        one = np.eye(len(F))
        W = np.linalg.inv(F + one)
        solver = cls((F - one) @ W)
        solver._into = np.sqrt(2.0) * W
        return solver

    def solve(self, C: np.ndarray) -> tuple[np.ndarray, bool]:
        """Return Z (n, n), symmetric, and whether the equation is singular within rounding."""
        from scipy.linalg.lapack import dtrsyl

        into = self._into @ self._U
        Z, scale, singular = dtrsyl(self._T, self._T, into.T @ C @ into, trana="T")
        Z = self._U @ (Z / scale) @ self._U.T
        return (Z + Z.T) / 2.0, bool(singular)


def _unsorted(real: float, imaginary: float) -> None:
    """Leave the eigenvalues of a Schur form in any order."""
