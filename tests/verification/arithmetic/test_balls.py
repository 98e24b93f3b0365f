"""Statements about balls hold for certain, or are not made."""

from __future__ import annotations

import pytest
from flint import arb

from verification.arithmetic.balls import inside, is_positive_definite, matrix, pivots

INFINITE = arb("inf")


@pytest.mark.parametrize(
    ("inner", "outer", "is_inside"),
    [
        ([arb(1, 0.1)], [arb(1, 0.2)], True),
        ([arb(1, 0.2)], [arb(1, 0.1)], False),
        ([arb(1, 0.1)], [arb(3, 0.1)], False),
        ([arb(1, 0.5)], [arb(1, 0.5)], False),
        ([arb(1, 0.1), arb(1, 0.1)], [arb(1, 0.2), arb(2, 0.2)], False),
        ([arb(0, INFINITE)], [arb(0, INFINITE)], False),
        ([arb(1, 0.1)], [arb(0, INFINITE)], True),
    ],
)
def test_inside_is_the_interior_of_every_partner(inner: list[arb], outer: list[arb], is_inside: bool) -> None:
    assert inside(inner, outer) is is_inside


@pytest.mark.parametrize(("off", "second"), [(1.0, 1.5), (2.0, 0.0), (3.0, -2.5)])
def test_pivots_are_those_of_elimination(off: float, second: float) -> None:
    found = pivots(matrix([[2.0, off], [off, 2.0]]))
    assert (found is None) == (second == 0.0)
    assert is_positive_definite(matrix([[2.0, off], [off, 2.0]])) == (second > 0.0)
    assert found is None or [float(each) for each in found] == [2.0, second]
