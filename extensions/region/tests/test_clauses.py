"""One quick forgery for each clause of the checker of regions: each is refused, by that clause."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from pendulum_regions import read_and_check

from hfa_aircraft.model import Model, Signal
from hfa_proof.checker.reading import Rejected
from hfa_region.check.statement import RegionStatement, SaturatedLoop

Content = dict[str, Any]


# V' = 0.


def _oscillator(x: Any, u: Any, p: Any, w: Any) -> Any:
    """x' = y, y' = -x: every trajectory goes round in a circle."""
    return {"x": x.y, "y": -x.x}, {}


OSCILLATOR = Model("oscillator", {"x": Signal(), "y": Signal()}, {}, _oscillator, trim={})


def _square(low: int, high: int, diagonal: list[float]) -> Content:
    return {"degrees": [low, high], "gram": np.diag(diagonal).tolist()}


def circle(smallest: float) -> Content:
    """A certificate that x² + y² <= 3 of the oscillator converges to 0.

    smallest: of V <= 3, times the multiplier smallest |y|², whose terms of degree 4 are positive;
        those of degree 2 lie within the rounding of V' = 0 in coordinates that are turned
    """
    inside = _square(0, 1, [5e-5, 5e-5, 5e-5]) | {
        "multipliers": {"outside": _square(0, 0, [1.0001])}
    }
    decrease = _square(2, 2, [smallest] * 3) | {
        "multipliers": {"level": _square(1, 1, [smallest] * 2)}
    }
    trim = {"x": 0.0, "y": 0.0}
    loop = SaturatedLoop(OSCILLATOR, {}, trim, {}, {}, np.zeros((0, 2)), {})
    terms = ((1.0, (2, 0)), (1.0, (0, 2)))
    statement = RegionStatement(loop, terms, 3.0, {"x": (-2.0, 2.0), "y": (-2.0, 2.0)})
    witness = {
        "T": [[1.04, -1.39], [1.39, 1.04]],
        "order": 4,
        "inside": inside,
        "parts": [{"inputs": [], "evidence": decrease}],
        "empty": [],
        "extents": {},
    }
    return {"kind": "region", "statement": statement.content(), "witness": witness}


@pytest.mark.parametrize("smallest", [1e-70, 1e-60, 1e-12])
def test_a_center_does_not_converge(smallest: float) -> None:
    """A coefficient of V' = 0 that is a ball about 0 does not count as 0."""
    with pytest.raises(Rejected, match="no such term"):
        read_and_check(circle(smallest), OSCILLATOR)
