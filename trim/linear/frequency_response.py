"""Gains of systems over frequency, σ_max(C (jω I - A)⁻¹ B + D), in doubles.

They give margins.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from hfa_support.matrices import balanced


def hamiltonian(A: np.ndarray, S: np.ndarray, Q: np.ndarray) -> np.ndarray:
    """Return the Hamiltonian matrix [[A, -S], [-Q, -A']], (2n, 2n)."""
    rows = np.concatenate([A, -S], axis=1), np.concatenate([-Q, -A.T], axis=1)
    return np.concatenate(rows)  # half the time of np.block


def units_of(A: np.ndarray, S: np.ndarray, Q: np.ndarray) -> np.ndarray:
    """Return units u, (n,), in which the Hamiltonian is balanced: states z have the numbers z / u.

    The units are powers of two, in which nothing rounds.

    A, S, Q: (n, n)

    Source: Benner, Symplectic balancing of Hamiltonian matrices, SIAM J. Sci. Comput. 22 (2001).
    """
    _, scaling = balanced(hamiltonian(A, S, Q))
    of_states, of_costates = np.split(np.log2(scaling), 2)
    # The nearest symplectic scaling: that of the costates is the inverse of that of the states.
    return np.asarray(np.exp2(np.round(0.5 * (of_states - of_costates))))


class System(NamedTuple):
    """System C (s I - A)⁻¹ B + D.

    A: (n, n)
    B: (n, k)
    C: (p, n)
    D: (p, k)
    """

    A: np.ndarray
    B: np.ndarray
    C: np.ndarray
    D: np.ndarray


def in_continuous_time(steps: System) -> System:
    """Return the system in s = (z - 1) / (z + 1) of a system in z, C (z I - A)⁻¹ B + D.

    The unit circle becomes the imaginary axis, and stable poles remain stable. A must not have the
    eigenvalue -1.

    Source: Zhou, Doyle and Glover, Section 21.2.
    """
    A, B, C, D = steps
    one = np.eye(len(A))
    inverse_B = np.linalg.solve(A + one, B)  # (A + I)⁻¹ B
    C_inverse = np.linalg.solve((A + one).T, C.T).T  # C (A + I)⁻¹
    root = math.sqrt(2.0)  # the factor 2 of the transformation, shared by B and C
    return System(
        np.linalg.solve(A + one, A - one), root * inverse_B, root * C_inverse, D - C @ inverse_B
    )


def level_crossings(
    A: np.ndarray,
    B: np.ndarray,
    C: np.ndarray,
    D: np.ndarray,
    level: float,
) -> np.ndarray:
    """Return all frequencies at which a singular value of C (jω I - A)⁻¹ B + D may equal a level.

    The frequencies, in rad/s and ascending, are Im λ >= 0 of the eigenvalues λ of the bounded-real
    Hamiltonian.

    level: a number that is not a singular value of D

    Source: Zhou, Doyle and Glover, Section 4.7.
    """
    n, m = B.shape
    # With W = level² I - D'D, the Hamiltonian has the blocks A + B W⁻¹D'C, B W⁻¹B' and
    # C'(C + D W⁻¹D'C).
    W = level**2 * np.eye(m) - D.T @ D
    over_W = np.linalg.solve(W, np.hstack([D.T @ C, B.T]))
    D_C_over_W, B_over_W = over_W[:, :n], over_W[:, n:]
    loop, upper, lower = A + B @ D_C_over_W, B @ B_over_W, C.T @ (C + D @ D_C_over_W)
    # Every `ratio` gives the same eigenvalues. With this one, the blocks have similar size in any
    # unit of B.
    ratio = math.sqrt((np.linalg.norm(upper) or 1.0) / (np.linalg.norm(lower) or 1.0))
    roots = np.linalg.eigvals(hamiltonian(loop, -upper / ratio, lower * ratio))
    return np.sort(roots.imag[roots.imag >= 0.0])
