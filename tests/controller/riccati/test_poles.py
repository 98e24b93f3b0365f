"""Poles are right to the last digit, also multiple ones."""

import numpy as np
import pytest

from controller.riccati.balls import ball_matrix, precision
from controller.riccati.closed_loops import POLE_BITS, poles_of

#: An integer matrix with the determinant 1, and its inverse.
T = np.array([[1.0, 2.0, 1.0], [1.0, 3.0, 1.0], [0.0, 1.0, 1.0]])
T_INVERSE = np.array([[2.0, -1.0, -1.0], [-1.0, 1.0, 0.0], [1.0, -1.0, 1.0]])
#: Loops with the eigenvalues of their diagonals.
LOOPS = {
    "slow": np.diag([-1e-14, -1.0, -1e6]),
    "double": np.diag([-2.0, -2.0, -1.0]),
    "Jordan block": np.diag([1.0, 1.0], 1) - 2.0 * np.eye(3),
}


@pytest.mark.parametrize("name", LOOPS)
def test_poles_are_right_to_the_last_digit(name):
    """The loop is T M T⁻¹ with an integer T and an upper triangular M, whose diagonal has the poles.
    Rounding would move the triple pole of a Jordan block by 1e-5.
    """
    middle = LOOPS[name]
    exact = np.sort(np.diag(middle))

    with precision(POLE_BITS):
        found = poles_of(ball_matrix(T) * ball_matrix(middle) * ball_matrix(T_INVERSE))
    np.testing.assert_allclose(found, exact, rtol=2.0**-52)
    assert not found.imag.any()
