"""Statements about balls hold for certain, or are not made."""

from __future__ import annotations

import pytest
from flint import arb

from verification.arithmetic.balls import flint_or_refusal, inside

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
    flint_or_refusal()
    assert inside(inner, outer) is is_inside
