"""Where the eigenvalues of a matrix lie with respect to the imaginary axis, and how surely."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np


class Spectrum(NamedTuple):
    """Eigenvalues of M, sorted by real part, then imaginary part, and M balanced by a diagonal similarity."""

    eigenvalues: np.ndarray
    balanced: np.ndarray

    @property
    def abscissa(self) -> float:
        """Largest real part, rad/s."""
        return float(self.eigenvalues.real.max())

    def axis_distance(self) -> float:
        """min_ω σ_min(M - jω I) / ‖M‖₂ of the balanced M, over the imaginary parts ω of the eigenvalues.

        How far M is, relative, from a matrix with an eigenvalue on the imaginary axis. Unlike |Re λ| it does not
        mislead when an eigenvalue is badly conditioned: a double eigenvalue on the axis is computed with |Re λ| of
        about 1e-8 ‖M‖, but its axis_distance is of the order of rounding, 1e-16. Source: Byers 1988.
        """
        shifts = 1j * np.unique(np.abs(self.eigenvalues.imag))
        shifted = self.balanced - shifts[:, None, None] * np.eye(len(self.balanced))
        smallest = float(np.linalg.svd(shifted, compute_uv=False)[:, -1].min())
        norm = float(np.linalg.norm(self.balanced, 2))
        return smallest / norm if norm > 0.0 else 0.0


def spectrum(matrix: np.ndarray) -> Spectrum:
    """The eigenvalues of a matrix, (n, n)."""
    scaled, _ = balanced(matrix)
    eigenvalues = np.linalg.eigvals(scaled)
    return Spectrum(eigenvalues[np.lexsort((eigenvalues.imag, eigenvalues.real))], scaled)


def is_hurwitz(matrix: np.ndarray) -> bool:
    """True when every eigenvalue has a negative real part."""
    return spectrum(matrix).abscissa < 0.0


def balanced(matrix: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """D⁻¹ M D, its rows and columns of similar size, and the diagonal of D, powers of two (LAPACK gebal)."""
    from scipy.linalg.lapack import dgebal  # SciPy's matrix_balance takes ten times as long around it

    scaled, _, _, scaling, _ = dgebal(np.asarray_chkfinite(matrix), scale=1, permute=0)
    return scaled, scaling
