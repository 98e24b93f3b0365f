"""Matrix products with twice the digits of double precision."""

from __future__ import annotations

from fractions import Fraction

import numpy as np
import pytest

from controller.riccati.double_double import product_of_doubles


@pytest.mark.parametrize("n", [0, 1, 6, 100])
def test_products_have_twice_the_digits(n: int) -> None:
    """The error of each entry is at most 2^-104 of the product of two numbers.

    The numbers are the largest magnitudes in the row of the first matrix and in the column of the
    second matrix.
    """
    random = np.random.default_rng(n)
    sizes = np.exp2(random.integers(-30, 30, (2, 3, n)))
    left, columns = random.normal(size=(2, 3, n)) * sizes
    products = product_of_doubles(left, columns.T)
    high, low = products.high, products.low
    for i, row in enumerate(left.tolist()):
        for j, column in enumerate(columns.tolist()):
            exact = sum(Fraction(a) * Fraction(b) for a, b in zip(row, column, strict=True))
            error = abs(exact - Fraction(high[i, j]) - Fraction(low[i, j]))
            scale = max(map(abs, row), default=0.0) * max(map(abs, column), default=0.0)
            assert error <= Fraction(scale) / 2**104
