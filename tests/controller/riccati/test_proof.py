"""The checker of exact solutions: stored answers, Lyapunov equations and the number of bits."""

import numpy as np
import pytest

from controller.riccati.balls import ball_matrix, precision
from controller.riccati.candidate import first_units
from controller.riccati.equation import Equation
from hfa import Game


@pytest.mark.parametrize("seed", range(4))
def test_the_residual_in_discrete_time_contains_the_exact_one(seed):
    """The residual of the Riccati equation, with 53 bits, contains that with 500 bits, and its radius
    is below 1e-12 of it.

    R + B'XB, here R, has condition number 2^30: the gains lose half of their digits.
    """
    least, random = 2.0**-30, np.random.default_rng(seed)
    modes = np.linalg.qr(random.standard_normal((4, 4)))[0]
    R = modes @ np.diag([least, 1.0, 1.0, 1.0]) @ modes.T
    N = 0.1 * least * random.standard_normal((1, 4))
    game = Game([[0.0]], np.ones((1, 4)), Q=[[least]], R=(R + R.T) / 2.0, N=N, dt=True)

    def residual(bits):
        with precision(bits):
            equation = Equation(game, first_units(game, game.delta), game.delta)
            return equation.gains_and_residual(ball_matrix(np.zeros((1, 1))))[1][0, 0]

    found, exact = residual(53), residual(500)
    assert found.contains(exact)
    assert found.rad() < 1e-12 * exact
