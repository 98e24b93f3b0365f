"""The discount on its way from the start to 0."""

from __future__ import annotations

import numpy as np
import pytest

from controller.laws.certified import discount_at


@pytest.mark.parametrize("start", [0.1, 7.0])
def test_the_discount_falls_from_its_start_to_zero(start: float) -> None:
    way = [discount_at(progress, start) for progress in np.linspace(0.0, 1.0, 11).tolist()]
    assert (way[0], way[-1]) == (start, 0.0)
    assert np.all(np.diff(way) < 0.0)
    assert way[5] == pytest.approx(0.5 * start / (1.0 + start))
