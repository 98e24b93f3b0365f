"""Games in discrete time whose inputs have hardly a weight."""

from dataclasses import replace

import numpy as np
import pytest

import hfa
from hfa import Game, NoSolutionError


@pytest.mark.parametrize("share", [0.75, 1.0])  # products without rounding
def test_two_inputs_that_only_act_together_need_a_weight(share):
    """In x⁺ = A x + b (u1 + share u2), only the sum v = u1 + share u2 acts.

    With R = 0, many u give the same v: the gain is not unique, and none is given. With r > 0
    and R = r I, u = [1; share] v / (1 + share²) has the least cost for a v, r v² / (1 + share²).
    """
    A, b, shares = (
        [[0.9, 0.2], [0.1, 0.7]],
        np.array([[0.125], [0.75]]),
        np.array([[1.0], [share]]),
    )
    for R in (1e-15, 1e-30, 1e-40):
        game = Game(A, b @ shares.T, Q=np.eye(2), R=R * np.eye(2), dt=True)
        of_v = Game(A, b, Q=np.eye(2), R=[[R / (1.0 + share**2)]], dt=True)
        K = shares / (1.0 + share**2) @ hfa.solve(of_v).K
        np.testing.assert_allclose(hfa.solve(game).K, K, rtol=1e-14)
    with pytest.raises(NoSolutionError, match="not decided"):
        hfa.solve(replace(game, R=0.0 * np.eye(2)))
