"""Degenerate games: each is solved as accurately as claimed, or refused with the true cause.

The reference is a solution with 60 digits.
"""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
from reference_riccati import reference_solution

from controller import minimum_delta
from hfa import Game, NoSolutionError, solve

#: Largest error of P in units in which its diagonal is 1.
EXACT = 1e-12
TURN = np.array([[0.0, 1.0], [-1.0, 0.0]])


def error(game: Game, P: np.ndarray | None = None) -> float:
    """Return the largest error of P compared with the 60-digit solution, in balanced units.

    The game must have a solution.

    P: the matrix to compare; by default that of `solve`
    """
    reference = reference_solution(game)
    assert reference.exists
    size = np.sqrt(np.diag(reference.P))
    units = np.divide(1.0, size, out=np.ones_like(size), where=size > 0.0)
    candidate = solve(game).P if P is None else P
    return float(np.abs((candidate - reference.P) * np.outer(units, units)).max())


def elsewhere(game: Game, seed: int) -> Game:
    """Return the game in random coordinates T z. The coordinates hide the structure of the
    matrices.
    """
    T = np.random.default_rng(seed).standard_normal(game.A.shape)
    inverse = np.linalg.inv(T)
    Q = inverse.T @ game.Q @ inverse
    return replace(game, A=T @ game.A @ inverse, B=T @ game.B, E=T @ game.E, Q=(Q + Q.T) / 2.0)


@pytest.mark.parametrize(
    ("rates", "coupling", "slow"),
    [
        ([-1e7, -2.0, 1e-3], 1e-4, "0.001"),
        ([-1e9, 1e-4], 1e-8, "0.0001"),
    ],
)
def test_a_slow_mode_of_a_stiff_plant_is_refused_within_an_accuracy(
    rates: list[float], coupling: float, slow: str
) -> None:
    """Each state drives the next, so that the input reaches the slow unstable mode, but within 1e-10
    of the fastest rate this cannot be told: the message names the mode and this accuracy.
    """
    n = len(rates)
    A = np.diag(rates) + np.diag(np.full(n - 1, coupling), -1)
    game = Game(A, np.eye(n)[:, :1], Q=np.eye(n), R=np.eye(1))
    for solver in (solve, minimum_delta):
        with pytest.raises(
            NoSolutionError, match=f"^within 1e-10 of its largest rate, .* eigenvalue {slow};"
        ):
            solver(game)


@pytest.mark.slow
@pytest.mark.parametrize("delta", [math.inf, 20.0])
def test_an_undamped_mode_needs_weight_in_Q(
    delta: float,
) -> None:
    """A plant with two undamped oscillators and an integrator is solved if Q weights all three
    modes.

    If Q does not weight a mode, the game is refused, and the message names this mode.
    """
    A = np.zeros((5, 5))
    A[:2, :2], A[2:4, 2:4] = TURN, 3.0 * TURN
    B = np.ones((5, 1))
    for seed in range(2):
        seen = elsewhere(
            Game(A, B, 0.1 * B, np.diag([1.0, 0.0, 1.0, 0.0, 1.0]), [[1.0]], delta), seed
        )
        assert error(seen) <= EXACT
        for left_out, named in ((0, "0 ± 1i"), (2, "0 ± 3i"), (4, "0")):
            paid = np.diag([1.0, 0.0, 1.0, 0.0, 1.0])
            paid[left_out, left_out] = 0.0
            unseen = Game(A, B, 0.1 * B, paid, [[1.0]], delta)
            assert not reference_solution(unseen.with_delta(math.inf)).exists
            with pytest.raises(
                NoSolutionError, match=f"not detectable: the undamped mode with eigenvalue {named} "
            ):
                solve(elsewhere(unseen, seed))


# The smallest delta of x' = a x + b u + e d is e / sqrt(b²/r + min(a, 0)²/q).


@pytest.mark.parametrize("q", [1.0, 1e-6, 1e-10, 1e-14])
def test_the_smallest_delta_is_right_where_q_is_small(q: float) -> None:
    """Of x' = -1.5 x + u + d it is 1 / sqrt(1 + 1.5²/q)."""
    game = Game([[-1.5]], [[1.0]], [[1.0]], [[q]], [[1.0]])
    assert minimum_delta(game).value == pytest.approx((1.0 + 2.25 / q) ** -0.5, rel=3e-6)


def test_weak_inputs_of_an_unstable_plant_hide_nothing() -> None:
    """A turned plant with one mode that the input barely reaches has the P and K of the reference."""
    game = elsewhere(
        Game(np.diag([1.0, -2.0, 0.5]), [[1e-6], [1.0], [1e-6]], Q=np.eye(3), R=[1.0]), 0
    )
    assert error(game) <= EXACT
    exact = reference_solution(game).K
    np.testing.assert_allclose(solve(game).K, exact, rtol=1e-9, atol=1e-9 * np.abs(exact).max())
