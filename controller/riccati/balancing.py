"""Balancing of matrices and games, and eigenvalues of balanced matrices."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np


class Spectrum(NamedTuple):
    """Eigenvalues of a matrix M.

    eigenvalues: (n,), sorted by real part, then by imaginary part
    balanced: (n, n), M after balancing by a diagonal similarity transformation
    """

    eigenvalues: np.ndarray
    balanced: np.ndarray

    @property
    def abscissa(self) -> float:
        """Largest real part of the eigenvalues, 1/s."""
        return float(self.eigenvalues.real.max())


def spectrum(matrix: np.ndarray) -> Spectrum:
    """Return the eigenvalues of a matrix (n, n) and the balanced matrix."""
    scaled, _ = balanced(matrix)
    eigenvalues = np.linalg.eigvals(scaled).astype(complex)
    return Spectrum(eigenvalues[np.lexsort((eigenvalues.imag, eigenvalues.real))], scaled)


def is_hurwitz(matrix: np.ndarray) -> bool:
    """Return whether every eigenvalue of the matrix has a negative real part."""
    return spectrum(matrix).abscissa < 0.0


def stability(matrix: np.ndarray, *, is_discrete: bool) -> tuple[float, float]:
    """Return the abscissa of a loop and 0, or in discrete time its spectral radius and 1.

    The loop is stable if the first number is below the second. It is inf if the loop is not finite.
    """
    limit = 1.0 if is_discrete else 0.0
    if not np.isfinite(matrix).all():
        return np.inf, limit
    found = spectrum(matrix)
    return float(np.abs(found.eigenvalues).max()) if is_discrete else found.abscissa, limit


def is_stable(loop: np.ndarray, *, is_discrete: bool) -> bool:
    """Return whether a loop is stable: Hurwitz, or in discrete time with spectral radius < 1."""
    value, limit = stability(loop, is_discrete=is_discrete)
    return value < limit


def balanced(matrix: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return the balanced form D⁻¹ M D of a matrix M, (n, n), and the diagonal of D, (n,).

    Rows and columns of the balanced form have similar size. The diagonal consists of powers of two.

    Raises ValueError if an entry is not finite.
    """
    from scipy.linalg.lapack import dgebal

    scaled, _, _, scaling, _ = dgebal(np.asarray_chkfinite(matrix), scale=1, permute=0)
    return scaled, scaling


def hamiltonian(A: np.ndarray, S: np.ndarray, Q: np.ndarray) -> np.ndarray:
    """Return the Hamiltonian matrix [[A, -S], [-Q, -A']], (2n, 2n)."""
    return np.vstack([np.hstack([A, -S]), np.hstack([-Q, -A.T])])


def units_of(A: np.ndarray, S: np.ndarray, Q: np.ndarray) -> np.ndarray:
    """Return units u (n,) for which the Hamiltonian in the coordinates y, z_i = u_i y_i, is
    balanced.

    The units are powers of two. The change of units therefore causes no rounding. The units do not
    depend on P, and an entry of P that is zero up to rounding therefore remains small. If Q = 0 and
    A and S are not 0, the units also make the largest entry of S in y about as large as the largest
    entry of A.

    A, S, Q: (n, n)

    Source: Benner, Symplectic balancing of Hamiltonian matrices, SIAM J. Sci. Comput. 22 (2001).
    """
    _, scaling = balanced(hamiltonian(A, S, Q))
    of_states, of_costates = np.split(np.log2(scaling), 2)
    units = np.exp2(np.round(0.5 * (of_states - of_costates)))
    if not Q.any() and S.any() and A.any():
        S_in_units = S / np.outer(units, units)
        with np.errstate(all="ignore"):
            logarithm = np.log2(largest(S_in_units)) - np.log2(largest(A))
            units = units * np.exp2(np.round(0.5 * logarithm))
    return units


def largest(matrix: np.ndarray) -> float:
    """Return the largest magnitude of an entry of a matrix."""
    return float(np.abs(matrix).max())


def largest_or_1(matrix: np.ndarray) -> float:
    """Return the largest magnitude of an entry of a matrix, or 1 if this is not positive."""
    size = largest(matrix)
    return size if size > 0.0 else 1.0


def norms(matrices: np.ndarray) -> np.ndarray:
    """Return the Frobenius norm of each matrix (..., n, m)."""
    entries = matrices.reshape(*matrices.shape[:-2], -1)
    return np.sqrt(np.vecdot(entries, entries).real)
