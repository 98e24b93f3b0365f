"""Balancing of matrices and games, and eigenvalues of balanced matrices."""

from __future__ import annotations

import numpy as np

from hfa_support.matrices import balanced, spectral_abscissa, spectral_radius


def spectrum(matrix: np.ndarray) -> np.ndarray:
    """Return the eigenvalues of a matrix, (n,) complex, sorted by real, then by imaginary part."""
    return np.sort_complex(np.linalg.eigvals(matrix))  # LAPACK balances the matrix first


def is_stable_in_doubles(loop: np.ndarray, *, is_discrete: bool) -> bool:
    """Return whether the eigenvalues of a loop are stable in doubles, which proves nothing."""
    return spectral_radius(loop) < 1.0 if is_discrete else spectral_abscissa(loop) < 0.0


def hamiltonian(A: np.ndarray, S: np.ndarray, Q: np.ndarray) -> np.ndarray:
    """Return the Hamiltonian matrix [[A, -S], [-Q, -A']], (2n, 2n)."""
    rows = np.concatenate([A, -S], axis=1), np.concatenate([-Q, -A.T], axis=1)
    return np.concatenate(rows)  # half the time of np.block


def units_of(A: np.ndarray, S: np.ndarray, Q: np.ndarray) -> np.ndarray:
    """Return units u, (n,), in which the Hamiltonian is balanced: its states are y, z_i = u_i y_i.

    The units are powers of two, in which nothing rounds. They do not depend on P. If Q = 0, and A
    and S are not, the largest entries of S and A are also of similar size.

    A, S, Q: (n, n)

    Source: Benner, Symplectic balancing of Hamiltonian matrices, SIAM J. Sci. Comput. 22 (2001).
    """
    _, scaling = balanced(hamiltonian(A, S, Q))
    of_states, of_costates = np.split(np.log2(scaling), 2)
    # The nearest symplectic scaling: that of the costates is the inverse of that of the states.
    units = np.exp2(np.round(0.5 * (of_states - of_costates)))
    if not Q.any() and S.any() and A.any():
        S_in_units = S / np.outer(units, units)
        A_in_units = A * units / units[:, None]
        with np.errstate(all="ignore"):
            logarithm = np.log2(largest(S_in_units)) - np.log2(largest(A_in_units))
            units = units * np.exp2(np.round(0.5 * logarithm))
    return units


def largest(matrix: np.ndarray) -> float:
    """Return the largest magnitude of an entry of a matrix."""
    return float(np.abs(matrix).max())
