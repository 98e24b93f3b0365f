"""The checker of exact solutions: stored answers, Lyapunov equations and the number of bits."""

from dataclasses import replace

import numpy as np
import pytest
from flint import arb, arb_mat

from controller.riccati.balls import ball_matrix, precision
from controller.riccati.candidate import first_units
from controller.riccati.equation import Equation
from controller.riccati.refusal import half_plane_eigenvalues
from hfa import Game, solve

GAME = Game([[0.5, 1.0], [-0.3, 0.2]], [[1.0], [0.5]], Q=[1.0, 2.0], R=[2.0], delta=20.0)


@pytest.mark.parametrize("dt", [None, True])
@pytest.mark.parametrize("b", [0.1, 10.0])
def test_changes_of_a_scalar_game_are_within_their_bounds(dt, b):
    """The loop, the gain and the weight change with X by at most the bounds of the proof, up to half
    of the weight.
    """
    game = Game([[2.0]], [[b]], Q=[[1.0]], R=[[2.0]], dt=dt)
    with precision(200):
        equation = Equation(game, first_units(game, game.delta), game.delta)
        X = ball_matrix(np.array([[1.5]]))
        gains, weight = equation.gains_and_residual(X)[0], equation.weight(X)[0, 0]
        loop = equation.loop(gains)
        bounds = equation.sensitivity(X, loop)
        most = 0.5 / bounds.weight if dt else arb(1)
        of_Z = most if dt is None else most * abs(loop[0, 0])
        for Z in (-0.999 * most, 0.001 * most, most):
            at_Z = X + arb_mat([[Z]])
            changed = equation.gains_and_residual(at_Z)[0]
            assert abs((changed - gains)[0, 0]) <= bounds.gains * of_Z
            assert abs((equation.loop(changed) - loop)[0, 0]) <= bounds.loop * abs(Z)
            assert abs(equation.weight(at_Z)[0, 0] / weight - 1) <= bounds.weight * abs(Z) * 1.001


@pytest.mark.parametrize("dt", [None, True])
def test_doubles_and_bits_find_the_same_rates(dt):
    """The eigenvalues of states and costates in doubles are those in bits."""
    game = replace(GAME, dt=dt)
    with precision(200):
        equation = Equation(game, first_units(game, game.delta), game.delta)
        near, far = (half_plane_eigenvalues(equation, in_bits=each) for each in (False, True))
    np.testing.assert_allclose(np.sort_complex(far), np.sort_complex(near), rtol=1e-9)


def test_weights_that_are_symmetric_up_to_rounding_count_by_their_symmetric_part():
    """P and K are those of the symmetric parts of Q and R, with all digits of the enclosures."""
    last = 2.0**-51 * np.array([[0.0, 1.0], [0.0, 0.0]])
    weights = np.array([[2.0, 1.0], [1.0, 3.0]])
    rounded, exact = (
        solve(Game(GAME.A, np.eye(2), Q=weights + each, R=weights + each)).enclosure
        for each in (last, (last + last.T) / 2.0)
    )
    assert rounded.P.overlaps(exact.P)
    assert rounded.K.overlaps(exact.K)
