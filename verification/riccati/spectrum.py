"""Where the eigenvalues of a matrix lie with respect to the imaginary axis, and how surely."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np


class Spectrum(NamedTuple):
    """Eigenvalues of M and the relative distance of M to the nearest matrix with one on the imaginary axis.

    axis_distance = min_ω σ_min(M - jω I) / ‖M‖₂, taken over the imaginary parts ω of the eigenvalues and
    after M has been balanced by a diagonal similarity. Unlike |Re λ| it does not mislead when an eigenvalue
    is badly conditioned: a double eigenvalue on the axis is computed with |Re λ| of about 1e-8 ‖M‖, but its
    axis_distance is of the order of rounding, 1e-16.
    """

    eigenvalues: np.ndarray
    axis_distance: float

    @property
    def abscissa(self) -> float:
        """Largest real part, rad/s."""
        return float(self.eigenvalues.real.max())


def spectrum(matrix: np.ndarray) -> Spectrum:
    """Eigenvalues sorted by real part (then imaginary part) with the distance to the axis (Byers 1988)."""
    scaled, _ = balanced(matrix)
    eigenvalues = np.linalg.eigvals(scaled)
    eigenvalues = eigenvalues[np.lexsort((eigenvalues.imag, eigenvalues.real))]
    shifts = 1j * np.unique(np.abs(eigenvalues.imag))
    shifted = scaled - shifts[:, None, None] * np.eye(len(matrix))
    smallest = float(np.linalg.svd(shifted, compute_uv=False)[:, -1].min())
    norm = float(np.linalg.norm(scaled, 2))
    return Spectrum(eigenvalues, smallest / norm if norm > 0.0 else 0.0)


def is_hurwitz(matrix: np.ndarray) -> bool:
    """True when every eigenvalue has a negative real part."""
    return spectrum(matrix).abscissa < 0.0


def balanced(matrix: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """D⁻¹ M D, its rows and columns of similar size, and the diagonal of D, powers of two (LAPACK gebal).

    SciPy casts the scaling to integers in passing; where a scale exceeds 2^63 that cast warns, to no effect.
    """
    from scipy.linalg import matrix_balance

    with np.errstate(invalid="ignore"):
        scaled, (scaling, _) = matrix_balance(matrix, permute=False, separate=True)
    return scaled, scaling
