"""The exact game's gain on a box, against the program's own."""

from __future__ import annotations

import numpy as np
import pytest
from known_models import exact_gain
from proof_cases import family

from verification.arithmetic.ball_function import Undecided
from verification.enclosures.taylor import DihedralBox
from verification.enclosures.trim_branch import TrimBranch
from verification.proof.lpv_grid import gain_form


@pytest.mark.parametrize("dynamics", ["published", "newton"])
@pytest.mark.parametrize("middle", [0.5, 14.5])
def test_the_program_s_gains_lie_in_the_enclosure(dynamics: str, middle: float) -> None:
    form = gain_form(TrimBranch(family(dynamics)).forms(DihedralBox(middle - 2.0**-7, middle + 2.0**-7)))
    for tau in (-(2.0**-7), 0.0, 2.0**-8):
        K = exact_gain(middle + tau, dynamics)
        near = form.coefficients[0] + tau * form.coefficients[1] + tau**2 * form.coefficients[2]
        assert np.all(np.abs(near - K) <= form.rest + 1e-11 * np.abs(K).max())
    assert np.linalg.norm(form.rest) < 1e-5 * np.linalg.norm(form.coefficients[0])


def test_the_rest_shrinks_with_the_third_power_or_faster() -> None:
    branch = TrimBranch(family())
    rests = [np.linalg.norm(gain_form(branch.forms(DihedralBox(14.5 - r, 14.5 + r))).rest) for r in (2.0**-6, 2.0**-7)]
    assert rests[0] / rests[1] > 7.0


def test_a_box_that_is_too_wide_is_left_open() -> None:
    with pytest.raises(Undecided):
        gain_form(TrimBranch(family()).forms(DihedralBox(14.0, 15.0)))
