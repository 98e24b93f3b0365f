"""Boxes of dihedral, and models with room."""

from __future__ import annotations

import flint
import pytest
from flint import arb

from verification.arithmetic.taylor_model import TaylorModel
from verification.enclosures.taylor import DihedralBox, roomy


@pytest.mark.parametrize(("low", "high"), [(0.0, 20.0), (14.1, 14.3), (-3.7, 2.9)])
def test_the_halves_of_a_box_cover_it_and_its_place_reaches_its_ends(low: float, high: float) -> None:
    flint.ctx.prec = 106  # as proofs have it: middle and radius are exact
    box = DihedralBox(low, high)
    left, right = box.halves()
    assert (left.low, right.high) == (low, high)
    assert left.high == right.low == pytest.approx((low + high) / 2)
    assert (box.middle - box.radius, box.middle + box.radius) == (arb(low), arb(high))
    assert box.degrees.contains(arb(low))
    assert box.degrees.contains(arb(high))


def test_a_roomy_model_is_the_same_but_for_a_larger_rest() -> None:
    model = TaylorModel(arb(1), arb(2), arb(3), arb(0, 0.25), arb(4))
    c0, c1, c2, rest, error = roomy(model).parts
    assert (c0, c1, c2, error) == (arb(1), arb(2), arb(3), arb(4))
    assert rest.contains(model.parts[3])
    assert float(rest.rad()) == pytest.approx(1.5)
