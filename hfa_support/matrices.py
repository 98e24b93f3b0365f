"""Matrices: checks of those given by users, spectral radius and quadratic forms."""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from hfa_support.errors import BadInputError, numbers_in

#: Larger numbers (or numbers below its inverse) overflow in products and are meaningless in a
#: model.
LARGEST = 1e100
#: Relative error of a computed sum, compared with its largest term: ten roundings, of the user's
#: arithmetic or of the derivatives of a model. That of an eigenvalue algorithm is p(n) eps |A| with
#: p of this size (LAPACK Users' Guide, 4.8).
ROUNDING = 10.0 * float(np.finfo(float).eps)


def checked_matrix(name: str, value: Any, largest: float, ndim: int | None = 2) -> np.ndarray:
    """Return a matrix, given by the user, as a read-only array of floats.

    name: name of the matrix in messages
    value: the given value
    largest: largest permitted magnitude of an entry
    ndim: required number of dimensions, or None for any

    Raises BadInputError if the value does not consist of real numbers, if an entry is not finite or
    too large, or if the number of dimensions is not `ndim`.
    """
    array = numbers_in(name, value)
    if ndim not in (None, array.ndim):
        raise BadInputError(f"the number of dimensions of {name} is {array.ndim}; give {ndim}")
    for index in np.argwhere(~(np.abs(array) <= largest))[:1]:
        entry = array[tuple(index)]
        rule = "give finite entries"
        if np.isfinite(entry):
            rule = f"give entries of at most {largest:g} in magnitude"
        where = "".join(f"[{i}]" for i in index)
        raise BadInputError(f"{name}{where} is {entry:g}; {rule}")
    array.setflags(write=False)
    return array


def shape_text(shape: tuple[int, ...]) -> str:
    """Return a shape as text, (5, 6) as "5 x 6", () as "a number"."""
    return " x ".join(map(str, shape)) or "a number"


def spectral_radius(matrix: np.ndarray) -> float:
    """Return the largest magnitude of the eigenvalues of a square matrix."""
    return float(np.abs(np.linalg.eigvals(matrix)).max())


def spectral_abscissa(matrix: np.ndarray) -> float:
    """Return the largest real part of the eigenvalues of a square matrix."""
    return float(np.linalg.eigvals(matrix).real.max())


def quadratic_forms(rows: np.ndarray, matrix: np.ndarray) -> np.ndarray:
    """Return z'M z of each row z, (N,).

    rows: (N, n)
    matrix: M, (n, n)
    """
    return np.asarray(np.einsum("ki,ij,kj->k", rows, matrix, rows))


def balanced(matrix: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return the balanced form D⁻¹ M D of a matrix M, (n, n), and the diagonal of D, (n,).

    Row and column i of the balanced form have lengths within a factor of two, unless one is 0. The
    diagonal consists of powers of two. The algorithm is that of LAPACK's dgebal (James, Langou,
    Lowery 2014), with its limit: units that shorten row and column by less than 5 % stay.

    Raises ValueError if an entry is not finite.
    """
    scaled = np.array(np.asarray_chkfinite(matrix), dtype=float)
    units = np.ones(len(scaled))
    changed = True
    while changed:
        changed = False
        for i in range(len(scaled)):
            column, row = math.hypot(*scaled[:, i].tolist()), math.hypot(*scaled[i].tolist())
            if not column or not row:
                continue
            unit = 2.0 ** math.ceil((math.log2(row) - math.log2(column) - 1.0) / 2.0)
            if column * unit + row / unit < 0.95 * (column + row):
                scaled[:, i] *= unit
                scaled[i] /= unit
                units[i] *= unit
                changed = True
    return scaled, units


def power_of_two(sizes: np.ndarray) -> np.ndarray:
    """Return the power of two nearest to each size, and 1 for a size of 0."""
    positive = np.where(sizes > 0.0, sizes, 1.0)
    return np.asarray(np.exp2(np.round(np.log2(positive))))
