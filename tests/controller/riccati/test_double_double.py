"""Matrix products with twice the digits of double precision."""

from __future__ import annotations

from fractions import Fraction

import mpmath
import numpy as np
import pytest

from controller.riccati.double_double import product_of_doubles
from controller.riccati.normal_form import precise_inverse


def test_an_orthogonal_matrix_is_inverted_with_twice_the_digits() -> None:
    """One step of Newton's method squares the rounding of W, 1e-16."""
    W = np.linalg.qr(np.random.default_rng(0).normal(size=(4, 4)))[0]
    high, low = precise_inverse(W)
    with mpmath.workdps(50):
        error = mpmath.matrix(W.T.tolist()) * (
            mpmath.matrix(high.tolist()) + mpmath.matrix(low.tolist())
        ) - mpmath.eye(4)
        assert max(abs(each) for each in error) < 1e-30


@pytest.mark.parametrize("n", [0, 1, 6, 100])
def test_products_have_twice_the_digits(n: int) -> None:
    """The error of each entry is at most 2^-104 of the product of two numbers.

    The numbers are the largest magnitudes in the row of the first matrix and in the column of the
    second matrix.
    """
    random = np.random.default_rng(n)
    sizes = np.exp2(random.integers(-30, 30, (2, 3, n)))
    left, columns = random.normal(size=(2, 3, n)) * sizes
    high, low = product_of_doubles(left, columns.T)
    for i, row in enumerate(left.tolist()):
        for j, column in enumerate(columns.tolist()):
            exact = sum(Fraction(a) * Fraction(b) for a, b in zip(row, column, strict=True))
            error = abs(exact - Fraction(high[i, j]) - Fraction(low[i, j]))
            scale = max(map(abs, row), default=0.0) * max(map(abs, column), default=0.0)
            assert error <= Fraction(scale) / 2**104
