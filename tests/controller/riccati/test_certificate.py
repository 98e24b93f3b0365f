"""What a certificate states, and games on the boundary of those that have a value."""

import numpy as np
import pytest

from hfa import Game, from_gain, solve, verify

I2 = np.eye(2)


def test_without_cost_the_value_is_the_stabilizing_one():
    """With Q = 0, P of x' = x + u is 2, which stabilizes, although P = 0 satisfies the Riccati
    equation 2 P - P² = 0, too. P and K of a stable plant are 0, and `verify` accepts no other K.
    """
    unstable = Game(np.eye(1), np.eye(1), Q=np.zeros((1, 1)), R=np.eye(1))
    assert solve(unstable).P[0, 0] == pytest.approx(2.0, rel=1e-12)
    stable = Game([[-1.0, 0.2], [0.1, -1.0]], [[1.0], [1.0]], E=I2, Q=0.0 * I2, R=[1.0], delta=2.0)
    assert "and P is positive semidefinite" in solve(stable).certificate.proved[1]
    for K, is_right in (([[0.0, 0.0]], True), ([[1e-3, 0.0]], False)):
        assert verify(stable, from_gain(stable, K)).ok == is_right


def test_the_change_of_the_data_is_that_of_changed_last_digits():
    """The stated change of P is above that of games with changed last digits, and at most 10 times.

    The largest change of P of twelve games with other last digits of A and B is 5.52e-12, with 60
    digits (by `exact_games.py` of commit 199915ecb).
    """
    A, modes = np.array([[-0.04, 0.72], [0.72, -0.46]]), np.array([[0.8, 0.6], [-0.6, 0.8]])
    game = Game(A, modes.T @ [[1e-4], [1.0]], Q=I2, R=[1.0])
    assert 1.0 <= solve(game).certificate.data_change / 5.52e-12 < 10.0
