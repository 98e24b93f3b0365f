"""The value is that of policies under which the state goes to 0, and the weights need not be
semidefinite.
"""

import math
from pathlib import Path

import numpy as np
import pytest

from controller import minimum_delta
from hfa import Game, NoSolutionError, solve

I2, I3 = np.eye(2), np.eye(3)


def test_a_saddle_point_is_no_value_without_a_lower_bound_of_the_cost():
    """P = 3 of z' = z + u + d is a saddle point with stable loops for δ² = 2 and q = -1.5, but
    u = -1.01 z costs less than 3 z², and without disturbance the cost has no lower bound.
    """
    game = Game([[1.0]], [[1.0]], Q=[[-1.5]], R=[[1.0]], delta=math.sqrt(2.0))
    for delta in (game.delta, math.inf):
        with pytest.raises(NoSolutionError, match="cost has no lower bound"):
            solve(game.with_delta(delta))
    with pytest.raises(NoSolutionError, match="cost has no lower bound"):
        minimum_delta(game)
    bounded = Game([[1.0]], [[1.0]], Q=[[-0.75]], R=[[1.0]], delta=math.sqrt(2.0))
    P = 2.0 * (1.0 + math.sqrt(1.0 - 0.375))  # P² / 2 - 2 P + 0.75 = 0
    assert solve(bounded).P[0, 0] == pytest.approx(P, rel=1e-14)
    assert minimum_delta(bounded).value == pytest.approx(1.0, rel=2e-6)


def test_an_input_that_gains_cost_has_no_value():
    """With R = -3, P of x⁺ = x / 2 + u satisfies P = q + P/4 - P²/4 / (R + P).

    For q = 5/8, P = 1 stabilizes, but the weight R + P = -2 of u is negative: there is no value.
    For q = 4, no real P exists. For q = 6.875, P is 5, and R + P is 2.
    """
    game = Game([[0.5]], [[1.0]], Q=[[0.625]], R=[[-3.0]], dt=True)
    with pytest.raises(NoSolutionError, match="an input gains cost"):
        solve(game)
    with pytest.raises(NoSolutionError, match="cost has no lower bound"):
        solve(Game([[0.5]], [[1.0]], Q=[[4.0]], R=[[-3.0]], dt=True))
    pays = solve(Game([[0.5]], [[1.0]], Q=[[6.875]], R=[[-3.0]], dt=True))
    assert pays.P[0, 0] == pytest.approx(5.0, rel=1e-14)


@pytest.mark.parametrize(("time", "dt"), [("continuous", None), ("discrete", True)])
def test_indefinite_weights_have_the_value_of_many_digits(time, dt):
    """P is that of 60 digits (by `exact_games.py` of commit 199915ecb), and the first line of the report
    says that the weights are indefinite.
    """
    stored = np.load(Path(__file__).with_name("sixty_digits.npz"))
    matrices = {name: stored[f"{time} {name}"] for name in "ABEQN"}
    game = Game(**matrices, R=I2, delta=9.0, dt=dt)
    solution = solve(game)
    exact = stored[f"{time} P"]
    np.testing.assert_allclose(solution.P, exact, rtol=0.0, atol=1e-14 * np.abs(exact).max())
    assert "weights indefinite" in str(solution.report()).splitlines()[0]


def test_weights_semidefinite_up_to_rounding_do_not_prove_that_the_loop_is_stable():
    """Q has the eigenvalues -9.5e-7 and 6e6, so A - B K may be unstable: its pole is 0.98 1/s at
    δ = 1, and there is no value.
    """
    low, high = 3145727.999999523, 3145728.000000477
    A = [[4194305.6875, 4194302.3125], [-6291458.3125, -6291453.6875]]
    game = Game(A, [[128.0], [128.0]], E=[[512.0], [512.0]], Q=[[low, high], [high, low]], R=[1.0])
    with pytest.raises(NoSolutionError, match="gain from the disturbance is at least 1"):
        solve(game.with_delta(1.0))


@pytest.mark.parametrize("unit", [1.0, 1e-6])
def test_a_disturbance_that_the_input_cancels_costs_nothing(unit):
    """x1⁺ = x1 / 2 + d and x2⁺ = x1 + x2 / 2 + u, with a cost of x2 alone: u = -x1 - x2 / 2 costs
    nothing from x1, and the smallest delta and the L2 gain are below any digit.
    """
    A, B, E = [[0.5, 0.0], [1.0, 0.5]], [[0.0], [1.0]], [[unit], [0.0]]
    solution = solve(Game(A, B, E=E, Q=[0.0, 1.0], R=[0.0], delta=2.0, dt=True))
    assert solution.P.tolist() == [[0.0, 0.0], [0.0, 1.0]]
    assert solution.K.tolist() == [[1.0, 0.5]]
    assert max(solution.delta_min, solution.l2_gain) < 1e-9 * unit
    assert solution.delta_min_bounds.refused == solution.l2_gain_bounds.low == 0.0


@pytest.mark.parametrize(
    ("dt", "A", "B"),
    [
        # The input reaches the mode 1 only by the last digits of B.
        (None, [[0, 0, 1], [0, -1, 0], [1, 0, 0]], [[1 + 2**-52], [1], [-1 + 2**-53]]),
        # The mode 1 - 2^-53, which no input reaches, is stable by the last digit.
        (True, [[1 - 2**-53, 0, 0], [0.1, 0.9, 0.2], [0, 0, 0.5]], [[0], [1], [0.3]]),
    ],
)
def test_last_digits_that_decide_are_said(dt, A, B):
    """The solution is right for the entries as they are, and the first line says what decides."""
    solution = solve(Game(A, B, Q=I3, R=[1.0], dt=dt))
    assert solution.certificate.data_change > 0.1
    assert "last digits of the data" in "".join(solution.certificate.proved)
    assert "last digits decide" in str(solution.report()).splitlines()[0]
