"""Forms of Taylor over a box enclose what they stand for."""

from __future__ import annotations

import numpy as np
import pytest

from verification.arithmetic.balls import exact, matrix
from verification.balls.taylor import TaylorForm


@pytest.mark.parametrize("tau", [-0.25, -0.1, 0.0, 0.2, 0.25])
def test_a_form_times_an_affine_one_encloses_the_product(tau: float) -> None:
    first, second, last, constant, slope = np.random.default_rng(3).normal(size=(5, 2, 2))
    last *= 1e-3
    form = TaylorForm((matrix(first), matrix(second)), matrix(last), exact(0.25))
    found = form.times_affine(matrix(constant), matrix(slope))
    value = found.coefficients[0] + exact(tau) * (found.coefficients[1] + exact(tau) * found.last)
    expected = (first + second * tau + last * tau**2) @ (constant + slope * tau)
    for entry, whole, wanted in zip(value.entries(), found.range().entries(), expected.ravel().tolist(), strict=True):
        assert abs(float(entry.mid()) - wanted) <= float(entry.rad()) + 1e-12
        assert whole.contains(exact(wanted))
        assert float(entry.rad()) < 1e-4
