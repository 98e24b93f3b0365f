"""Games in discrete time: value iteration, closed forms, SciPy, and the limit of short samples."""

import math
from dataclasses import replace

import numpy as np
import pytest

import hfa
from hfa import Game, NoSolutionError

GOLDEN = (1.0 + math.sqrt(5.0)) / 2.0


def game_of(seed, **changes):
    """Return a random game with three states, two inputs and units from 1e-3 to 1e3."""
    random = np.random.default_rng(seed)
    units = 10.0 ** random.uniform(-3.0, 3.0, 3)
    A = 0.8 * random.standard_normal((3, 3)) * units[:, None] / units
    B, E = (random.standard_normal((3, 2)) * units[:, None] for _ in range(2))
    Q = np.diag(units**-2.0)
    N = 0.1 * random.standard_normal((3, 2)) / units[:, None]
    entries = {"A": A, "B": B, "E": E, "Q": Q, "R": np.eye(2), "N": N, "delta": 40.0}
    return Game(**(entries | {"dt": True, "discount": 0.95} | changes))


@pytest.mark.parametrize("changes", [{}, {"discount": 1.0, "dt": 0.1}, {"delta": math.inf}])
def test_the_value_is_that_of_a_saddle_point(changes):
    """u = -K x minimizes, and d = L x maximizes, the cost of one step plus the discounted value
    after it, which is x'P x.

    The worst-case loop is A - B K + E L.
    """
    game = game_of(0, **changes)
    solution = hfa.solve(game)
    units = np.sqrt(np.diag(game.Q))
    x = 1.0 / units

    def cost(du, dw):
        u = -solution.K @ x + du
        w = solution.disturbance_gain @ x + dw
        after = game.A @ x + game.B @ u + game.E @ w
        paid = x @ game.Q @ x + 2.0 * x @ game.N @ u + u @ game.R @ u
        earned = game.delta**2 * w @ w if math.isfinite(game.delta) else 0.0
        return float(paid - earned + game.discount * after @ solution.P @ after)

    value = solution.cost(x)
    assert cost(0.0, 0.0) == pytest.approx(value)
    assert min(cost(step, 0.0) for step in (-0.1, 0.1)) > value
    if math.isfinite(game.delta):
        assert max(cost(0.0, step) for step in (-0.1, 0.1)) < value
    loop = game.A - game.B @ solution.K + game.E @ solution.disturbance_gain
    across = units[:, None] / units  # to states in which the diagonal of Q is 1
    np.testing.assert_allclose(
        across * game.worst_case_loop(solution.P), across * loop, rtol=1e-6, atol=1e-6
    )


@pytest.mark.parametrize(
    ("A", "B", "Q", "R", "P"),
    [
        ([[4.0, 3.0], [-4.5, -3.5]], [[1.0], [-1.0]], [[9.0, 6.0], [6.0, 4.0]], [[1.0]],
         [[9.0 * GOLDEN, 6.0 * GOLDEN], [6.0 * GOLDEN, 4.0 * GOLDEN]]),
        ([[0.0, 1.0], [0.0, 0.0]], [[0.0], [1.0]], [[1.0, 2.0], [2.0, 4.0]], [[1.0]],
         [[1.0, 2.0], [2.0, 2.0 + math.sqrt(5.0)]]),
        ([[2.0, -1.0], [1.0, 0.0]], [[1.0], [0.0]], [[0.0, 0.0], [0.0, 1.0]], [[0.0]], np.eye(2)),
    ],
    ids=["DAREX 1", "DAREX 5", "DAREX 3: R = 0"],
)  # fmt: skip
def test_regulators_with_a_closed_form(A, B, Q, R, P):
    """P of regulators with a known solution is right to 1e-10; R may be 0."""
    solution = hfa.solve(Game(A, B, Q=Q, R=R, dt=True))
    np.testing.assert_allclose(solution.P, P, atol=1e-10 * np.abs(P).max())


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


def test_gain_and_margins_of_a_scalar_loop():
    """x⁺ = 0.8 x + u + w with u = -0.3 x has the closed-form L2 gain and disk margin, and the optimal
    gain has the closed-form upper gain margin.

    The largest response of x⁺ = 0.5 x + w is 1 / (1 - 0.5), at z = 1.
    """
    game = Game([[0.8]], [[1.0]], E=[[1.0]], Q=[[1.0]], R=[[4.0]], dt=0.2)
    K = np.array([[0.3]])
    output = math.sqrt(1.0 + 4.0 * 0.3**2)  # √(Q + R K²), the root of the cost at x = 1
    solution = hfa.solve(game)
    closed_loops = solution.closed_loops  # loops of any gain in states with value y'y
    low, high = closed_loops.l2_gain(K)
    assert low <= output / 0.5 * (1.0 + 1e-15)
    assert high == pytest.approx(output / 0.5, rel=1e-6)
    # f times the optimal gain k: stable for |.8 - f k| < 1, thus f up to 1.8 / k.
    assert solution.loops[0].gain_high == pytest.approx(1.8 / solution.K[0, 0], rel=1e-6)
    # S - 1/2 at z = -1 is the largest: |1 / (1 + l) - 1/2|, l = -.3 / 1.8.
    sensitivity = [abs(1.0 / (1.0 + 0.3 / (z - 0.8)) - 0.5) for z in (1.0, -1.0)]
    assert closed_loops.disk_margin(K).disk == pytest.approx(1.0 / max(sensitivity), rel=1e-6)
    assert closed_loops.disk_margin(K).frequency == pytest.approx(math.pi / 0.2, rel=1e-6)
