"""Distance of a Hamiltonian matrix from the imaginary axis."""

from __future__ import annotations

import numpy as np

#: The search begins at 0 and at the frequencies of so many eigenvalues nearest to the axis.
STARTS = 8
#: Relative accuracy of the least singular value over all frequencies,
SHARP = 1e-6
#: unless it is below this fraction of the norm, where it is only rounding.
ROUNDING = 1e-14
#: Largest number of levels; three are usual.
MOST_LEVELS = 20
#: An eigenvalue with |Re λ| up to this fraction of the norm may be on the axis.
MAYBE_ON_AXIS = 1e-6


def axis_distance(H: np.ndarray, eigenvalues: np.ndarray) -> tuple[float, float]:
    """Return min_ω σ_min(H - jω I) / ‖H‖₂ of a Hamiltonian H, and this frequency ω >= 0, rad/s.

    The distance is the norm of the smallest change of H that puts an eigenvalue on the imaginary
    axis, relative to the norm of H. Unlike |Re λ|, it is reliable for an ill-conditioned
    eigenvalue: of a double eigenvalue on the axis the computed |Re λ| is about 1e-8 ‖H‖, but the
    computed distance is about 1e-16.

    With J = [[0, I], [-I, 0]], H J - jω J is Hermitian, and the magnitudes of its eigenvalues are
    the singular values of H - jω I. One of them equals a level only where jω is an eigenvalue of
    the Hamiltonian H + level J or H - level J.

    H: (2n, 2n)
    eigenvalues: of H, (2n,)

    Source: Byers, SIAM J. Scientific and Statistical Computing 9 (1988), 875-881; Boyd and
    Balakrishnan, Systems and Control Letters 15 (1990), 1-7.
    """
    n = len(H) // 2
    J = np.kron([[0.0, 1.0], [-1.0, 0.0]], np.eye(n))
    symmetric = H @ J
    symmetric = (symmetric + symmetric.T) / 2.0

    def least(frequencies: np.ndarray) -> tuple[float, float]:
        values = np.linalg.eigvalsh(symmetric - 1j * frequencies[:, None, None] * J)
        sizes = np.abs(values).min(axis=1)
        place = int(sizes.argmin())
        return float(sizes[place]), float(frequencies[place])

    norm = float(np.linalg.norm(H, 2))
    if norm == 0.0:
        return 0.0, 0.0
    nearest = np.argsort(np.abs(eigenvalues.real))[:STARTS]
    distance, frequency = least(np.unique(np.append(np.abs(eigenvalues.imag[nearest]), 0.0)))
    for _ in range(MOST_LEVELS):
        if distance <= ROUNDING * norm:
            break
        level = (1.0 - SHARP) * distance
        found = np.concatenate([np.linalg.eigvals(H + sign * level * J) for sign in (-1.0, 1.0)])
        on_axis = np.abs(found.real) <= MAYBE_ON_AXIS * norm
        shifts = np.unique(np.append(np.abs(found.imag[on_axis]), 0.0))
        lower, at = least(np.append((shifts[1:] + shifts[:-1]) / 2.0, shifts[-1]))
        if not lower < level:
            break
        distance, frequency = lower, at
    return distance / norm, frequency
