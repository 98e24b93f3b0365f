"""Alternative variables in a trim condition, such as mach in place of speed."""

import pytest

import hfa
from trim.point.condition import stated_values


def test_a_rate_of_0_that_the_model_does_not_balance_is_stated():
    """A condition file states only what differs from the model's own trim. The flexible aircraft does not
    balance the altitude, so that an imposed climb rate of 0 is stated. The free gamma is then 0.
    """
    point = hfa.trim(hfa.aircraft(), altitude_dot=0.0, free="gamma")
    assert stated_values(point.trim_problem.asked).held == {"altitude_dot": 0.0}
    assert point["gamma"] == pytest.approx(0.0, abs=1e-12)
