"""Costs of policies above the optimum: enclosed, of the worst state, and never more than proved."""

import math
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from flint import arb
from game_samples import game_models

from controller.riccati.balls import ball_matrix, precision
from controller.riccati.l2_gain import DisturbedLoop
from controller.riccati.lyapunov import FailedError, NotProvedError, stability_of
from controller.riccati.suboptimality import ratio_bounds, suboptimality_of
from hfa import Game, from_gain, solve, verify

GAME = game_models()["published-15"]
EXACT = solve(GAME)


def judged(game, K):
    return suboptimality_of(
        solve(game).enclosure, np.asarray(K, dtype=float), box=np.ones(len(game.A))
    )


#: Eight kinds of games, in continuous time and, with a discount, in discrete time, with and without a
#: disturbance; a gain off by 1e-3 to 1e-12, and its suboptimality with 60 digits, by `exact_games.py`
#: of commit 199915ecb.
SIXTY_DIGITS = np.load(Path(__file__).with_name("sixty_digits.npz"))


@pytest.mark.parametrize("number", range(8))
def test_a_suboptimality_contains_that_of_sixty_digits(number):
    """The bounds of the suboptimality of a gain contain that computed with 60 digits, which the worst
    state has.
    """
    K = SIXTY_DIGITS[f"{number} K"]
    delta, discount, is_discrete, reference = SIXTY_DIGITS[f"{number} numbers"].tolist()
    matrices = {name: SIXTY_DIGITS[f"{number} {name}"] for name in "ABEQRN"}
    game = Game(**matrices, delta=delta, discount=discount, dt=True if is_discrete else None)
    found = judged(game, K)
    assert found.is_known
    assert reference <= found.of_each * (1.0 + 1e-12)
    assert found.is_optimal or found.of_each <= reference * (1.0 + 1e-6)
    assert found.high <= found.of_each
    if not found.is_optimal:
        P, D = solve(game).P, found.matrix
        z, largest = found.worst / np.linalg.norm(found.worst), np.linalg.eigvalsh(P)[-1]
        assert z @ D @ z / largest == pytest.approx(found.high, rel=1e-6)


def loss(game, K):
    """Return D, with which z'Dz is the cost of u = -K z above the optimum z'Pz.

    Only the disturbance is free, so P + D is the value of the game without an input.
    """
    fixed = replace(game, A=game.A - game.B @ K, B=0.0 * game.B, Q=game.Q + K.T @ game.R @ K)
    return solve(fixed).P - solve(game).P


@pytest.mark.parametrize("delta", [6.0, math.inf])
def test_the_worst_and_mean_costs_are_eigenvalues_of_the_suboptimality(delta):
    """Over initial conditions on the ellipsoid within the box, z'Dz is at most the largest eigenvalue
    of D in units of the box, and on average their mean, relative to the largest one of P.
    """
    A, B = [[-1.0, 0.4, 0.0], [0.1, 0.5, 1.0], [0.3, 0.0, -2.0]], [[1.0], [0.5], [0.3]]
    game = Game(A, B, E=[[0.3], [0.1], [0.2]], Q=np.eye(3), R=[1.0], delta=delta)
    K = solve(game).K * [[1.1, 0.9, 1.2]]
    verdict = verify(game, from_gain(game, K))
    box = np.outer(verdict.box.half_widths, verdict.box.half_widths)
    largest = np.linalg.eigvalsh(solve(game).P * box)[-1]
    shares = np.linalg.eigvalsh(loss(game, K) * box) / largest
    cost = verdict.to_dict()["graded"]
    assert cost["cost_above_optimum_worst_percent"] == pytest.approx(100.0 * shares.max(), rel=1e-6)
    assert cost["cost_above_optimum_mean_percent"] == pytest.approx(100.0 * shares.mean(), rel=1e-6)


# States without cost, and modes that the input hardly reaches.


def test_a_gain_beyond_delta_has_infinite_cost():
    """The suboptimality is infinite if the L2 gain is above delta, and if K destabilizes."""
    tight = GAME.with_delta(151.0)  # delta_min is 114, and the L2 gain of 0.3 K 270
    beyond = judged(tight, 0.3 * solve(tight).K)
    assert (beyond.is_stable, beyond.low) == (True, math.inf)
    unstable = judged(GAME, -EXACT.K)
    assert (unstable.is_stable, unstable.low) == (False, math.inf)


def test_the_cost_of_a_gain_of_just_delta_is_not_decided():
    """With K = 0, x' = -x + d has the L2 gain 1 = delta, and costs x² under the worst disturbance.

    The proof of a bound needs a gain below delta, that of an infinite cost one above it. With K = -1,
    x' = d has the pole 0, of which no proof says whether it is stable.
    """
    game = Game([[-1.0]], [[1.0]], E=[[1.0]], Q=[1.0], R=[1.0], delta=1.0)
    found = judged(game, [[0.0]])
    assert (found.is_stable, found.low, found.high) == (True, 0.0, math.inf)
    assert judged(game, [[-1.0]]).low == 0.0
    report = verify(game, from_gain(game, [[0.0]]))
    assert not report.ok
    assert "cost not decided" in str(report)


# Values of loops.

#: Loops with one state: F, E, C, δ and the root D in closed form.
SCALAR = {
    # -2 D + 3/2 + D² / 2 = 0: 1 and 3
    "continuous": (-1.0, 1.0, 1.5, math.sqrt(2.0), 1.0),
    # the same at a hundredth of the speed, in other units of the cost
    "slow": (-0.01, 1e-11, 1.5e18, math.sqrt(2.0), 1e20),
    # D = D/4 + C + (D/2)² / (4 - D) with D = 1: C = 2/3
    "discrete": (0.5, 1.0, 2.0 / 3.0, 2.0, 1.0),
}


def scalar_loop(time, charge=1.0, radius=0.0):
    """Return a loop of `SCALAR` with the cost C times `charge`, of this relative radius, δ and D."""
    F, E, C, delta, root = SCALAR[time]
    F, E, C = (ball_matrix(np.array([[each]])) for each in (F, E, C * charge))
    C = C + ball_matrix([[arb(0, radius)]]) * C
    return DisturbedLoop(F, E, C, time == "discrete"), delta, root


@pytest.mark.parametrize("time", SCALAR)
@pytest.mark.parametrize("radius", [0.0, 1e-12, 1e-3])
def test_the_value_of_a_loop_contains_the_root(time, radius):
    """The ball D contains the root of the scalar Riccati equation for each cost C in a ball.

    The relative radius of D is at most ten times that of C, and below 1e-25 for an exact C.
    """
    with precision(128):
        loop, delta, root = scalar_loop(time, radius=radius)
        D = loop.value(delta).P[0, 0]
        assert D.contains(arb(root)) or abs(D - root) < 1e-15 * root
        assert D.rad() < (1e-25 if radius == 0.0 else 10.0 * radius) * root
        for end in (-0.99, 0.99):
            moved = scalar_loop(time, charge=1.0 + end * radius)[0].value(delta).P[0, 0]
            assert radius == 0.0 or D.contains(moved.mid())


@pytest.mark.parametrize(("time", "most"), [("continuous", 4.0 / 3.0), ("discrete", 1.5)])
def test_a_loop_whose_gain_is_delta_or_larger_has_no_value(time, most):
    """A loop is refused if its scalar Riccati equation has no real root D.

    -2 D + C + D²/2 = 0 has one up to C = 2, 4/3 of the C = 3/2 in `SCALAR`, and D = D/4 + C +
    (D/2)² / (4 - D) up to C = 1, 3/2 of the 2/3 there.
    """
    with precision(128):
        for factor in (1.0 + 1e-9, 1.001, 2.0):
            loop, delta, _ = scalar_loop(time, charge=most * factor)
            with pytest.raises((NotProvedError, FailedError)):
                loop.value(delta)
        loop, delta, _ = scalar_loop(time, charge=most * (1.0 - 1e-6))
        loop.value(delta)


def test_bounds_of_a_ratio_hold_for_any_direction_and_estimate():
    """The largest z'D z / z'P z with D = diag(3, 1) and P = diag(2, 1) is 3/2, and the smallest 1."""
    D, P = (ball_matrix(np.diag(each)) for each in ([3.0, 1.0], [2.0, 1.0]))
    with precision(128):
        for direction in ([1.0, 0.0], [1.0, 1e-3], [1.0, 1.0], [0.0, 1.0], [0.0, 0.0]):
            for estimate in (0.0, 0.1, 1.4999, 1.5 * (1.0 - 1e-10), 1.5, 1.6, 20.0):
                low, high = ratio_bounds(D, P, ball_matrix(np.array([direction]).T), estimate)
                assert any(direction) * (1.0 - 1e-12) <= low <= any(direction) * 1.5 <= 1.5 <= high


@pytest.mark.parametrize("is_discrete", [False, True])
@pytest.mark.parametrize("distance", [1e-9, 0.5, 1.5])
def test_stability_is_proved_in_both_directions(is_discrete, distance):
    """A loop with a pole 1e-9 or more from the boundary of stability, beside a fast stable one, is
    proved stable or unstable. With a pole on the boundary, neither is proved.
    """
    T = np.array([[1.0, 1.0], [0.0, 1.0]])  # mixes the states
    boundary, fast = (1.0, 0.25) if is_discrete else (0.0, -4.0)
    for change, expected in ((distance, False), (-distance, True), (0.0, None)):
        loop = T @ np.diag([boundary + change, fast]) @ np.array([[1.0, -1.0], [0.0, 1.0]])
        with precision(128):
            assert stability_of(ball_matrix(loop), is_discrete=is_discrete) is expected
