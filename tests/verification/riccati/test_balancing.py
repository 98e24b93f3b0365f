"""Eigenvalues at the axis."""

from __future__ import annotations

import numpy as np
import pytest

from verification.riccati.balancing import is_hurwitz


@pytest.mark.parametrize(("entry", "stable"), [(-1e-300, True), (0.0, False), (1e-300, False)])
def test_a_mode_on_the_axis_is_not_stable(entry: float, stable: bool) -> None:
    assert is_hurwitz(np.diag([-1.0, entry])) is stable
