"""Diagonal similarity that makes the rows and columns of a matrix of similar size."""

from __future__ import annotations

import numpy as np


def balanced(matrix: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """D⁻¹ M D and the diagonal of D, powers of two (LAPACK gebal, no permutation).

    SciPy casts the scaling to integers in passing; where a scale exceeds 2^63 that cast warns, to no effect.
    """
    from scipy.linalg import matrix_balance

    with np.errstate(invalid="ignore"):
        scaled, (scaling, _) = matrix_balance(matrix, permute=False, separate=True)
    return scaled, scaling
