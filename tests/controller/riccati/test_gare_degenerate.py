"""Degenerate games: each is solved as accurately as claimed, or refused with the true cause.

The reference is a solution with 60 digits.
"""

from __future__ import annotations

import itertools
import math
from dataclasses import replace

import mpmath
import numpy as np
import pytest
from reference_riccati import reference_solution, relative_error

from controller.game.zero_sum import is_semidefinite
from controller.riccati.gare import unconfirmed_solution
from controller.riccati.normal_form import NormalForm
from hfa import Game, NoSolutionError, solve

#: Largest error of P in units in which its diagonal is 1.
EXACT = 1e-12
TURN = np.array([[0.0, 1.0], [-1.0, 0.0]])


def error(game: Game, P: np.ndarray | None = None) -> float:
    """Return the largest error of P compared with the 60-digit solution, in balanced units.

    The game must have a solution.

    P: the matrix to compare; by default that of `unconfirmed_solution`
    """
    reference = reference_solution(game)
    assert reference.exists
    size = np.sqrt(np.diag(reference.P))
    units = np.divide(1.0, size, out=np.ones_like(size), where=size > 0.0)
    candidate = unconfirmed_solution(game).P if P is None else P
    return float(np.abs((candidate - reference.P) * np.outer(units, units)).max())


def elsewhere(game: Game, seed: int) -> Game:
    """Return the game in random coordinates T z. The coordinates hide the structure of the
    matrices.
    """
    T = np.random.default_rng(seed).standard_normal(game.A.shape)
    inverse = np.linalg.inv(T)
    Q = inverse.T @ game.Q @ inverse
    return replace(game, A=T @ game.A @ inverse, B=T @ game.B, E=T @ game.E, Q=(Q + Q.T) / 2.0)


def chain(n: int, delta: float = 1000.0) -> Game:
    B = np.eye(n)[:, [-1]]
    return Game(np.eye(n, k=1), B, B, np.eye(n), [[1.0]], delta)


@pytest.mark.slow
@pytest.mark.parametrize("n", [2, 5, 8, 12])
def test_rotated_chains_of_integrators_are_solved(n: int) -> None:
    """Chains of n integrators in random coordinates are solved. An error of 1e-11 planted in P is
    detected.
    """
    for seed in range(2):
        game = elsewhere(chain(n), seed)
        assert error(game) <= EXACT
    P = solve(game).P
    with pytest.raises(AssertionError):
        assert error(game, P * (1.0 + 1e-11)) <= EXACT


@pytest.mark.slow
@pytest.mark.parametrize("delta", [pytest.param(math.inf, marks=pytest.mark.slow), 20.0])
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


@pytest.mark.parametrize("reach", [3e-6, 1e-8, 1e-11])
def test_a_barely_controllable_mode_has_true_bounds(
    reach: float,
) -> None:
    """If the input barely affects an unstable mode, the stated error bound of the slowest pole is
    true.

    The modes have the rates 0.5 and -1. The input affects the first only by the factor `reach`.
    """
    A = np.array([[-0.04, 0.72], [0.72, -0.46]])
    modes = np.array([[0.8, 0.6], [-0.6, 0.8]])
    game = Game(A, modes.T @ [[reach], [1.0]], np.zeros((2, 1)), np.eye(2), np.eye(1), math.inf)
    solution = solve(game)  # cost and L2 gain are checked, too
    assert error(game, solution.P) <= EXACT
    np.testing.assert_allclose(solution.K, reference_solution(game).K, rtol=EXACT)
    data = solution.to_dict()
    with mpmath.workdps(40):
        exact = mpmath.matrix(A.tolist()) - mpmath.matrix(game.B.tolist()) * mpmath.matrix(
            solution.K.tolist()
        )
        abscissa = float(max(value.real for value in mpmath.eig(exact, left=False, right=False)))
    assert (
        abs(abscissa - solution.closed_loop_eigenvalues[-1].real)
        <= data["closed_loop_abscissa_error"]
        <= 1e-14 / reach
    )


def test_a_poles_bound_is_its_largest_rounding_change() -> None:
    """To first order, the error bound of a pole is its largest change over all signs of rounding.

    The entries of A and K change by 2 n ε for two coordinates, and the entries of B by n ε. The
    closed loop has real poles.
    """
    B = np.array([[0.0], [1.0]])
    game = Game([[-3.0, 2.0], [0.7, 1.0]], B, np.zeros((2, 1)), np.eye(2), [[1.0]], math.inf)
    solution = solve(game)
    assert not solution.closed_loop_eigenvalues.imag.any()
    step = 1e-8
    largest = 0.0
    for signs in itertools.product((-2.0 * step, 2.0 * step), repeat=8):
        A = game.A * (1.0 + 2.0 * np.reshape(signs[:4], (2, 2)))
        K = solution.K * (1.0 + 2.0 * np.reshape(signs[4:6], (1, 2)))
        changed = np.linalg.eigvals(A - B * (1.0 + np.reshape(signs[6:], (2, 1))) @ K)
        moved = abs(changed.real.max() - solution.closed_loop_eigenvalues[-1].real)
        largest = max(largest, float(moved))
    roundings = solution.abscissa_error / np.finfo(float).eps
    assert roundings == pytest.approx(largest / step, rel=0.05)  # rounded to an integer
    for pole, is_stable in ((-0.5, False), (-2.0, True)):
        poles = np.array([pole * solution.abscissa_error], dtype=complex)
        assert replace(solution, closed_loop_eigenvalues=poles).is_stable is is_stable


# The smallest delta of x' = a x + b u + e d is e / sqrt(b²/r + min(a, 0)²/q).


def slow_mode(rate: float, weight: float, seed: int) -> Game:
    Q = np.diag([weight, 1.0, 1.0])
    plain = Game(np.diag([-rate, -1.0, -2.0]), np.ones((3, 1)), np.eye(3), Q, [[1.0]], math.inf)
    return elsewhere(plain, seed)


@pytest.mark.parametrize("seed", [1, 3])  # in these coordinates the first P is inaccurate
def test_a_slow_mode_with_small_weight_is_solved(seed: int) -> None:
    """A game with a slow mode and its relative weight 1e-14 is solved.

    Rounding of the entries cannot move the pole -1e-5 to the axis.
    """
    game = slow_mode(1e-5, 1e-14, seed)
    assert error(game) <= EXACT
    assert solve(game).closed_loop_eigenvalues[-1].real == pytest.approx(-1e-5, rel=1e-2)


def scalar(a: float, apart: float) -> Game:
    """Return a scalar game whose delta is 1 + `apart` times its exact smallest delta."""
    b = 0.7
    e = 1.3
    q = 2.0
    r = 0.4
    exact = e / math.sqrt(b * b / r + min(a, 0.0) ** 2 / q)
    return Game([[a]], [[b]], [[e]], [[q]], [[r]], exact * (1.0 + apart))


@pytest.mark.parametrize("a", [-1.0, 0.0, 2.0])
@pytest.mark.parametrize("apart", [1e-3, 1e-9, -1e-9, -1e-3])
def test_games_below_smallest_delta_are_never_solved(a: float, apart: float) -> None:
    """A scalar game is never solved below its smallest delta, and always 0.1 % above it.

    Closer to the smallest delta, P has the accuracy that its condition number 1/|apart| permits, or
    the message truthfully states how close delta is.
    """
    game = scalar(a, apart)
    exists = reference_solution(game).exists
    assert exists == (apart > 0.0)
    try:
        P = solve(game).P
    except NoSolutionError as refusal:
        message = str(refusal)
        assert not (exists and apart == 1e-3), message
        assert ("no value of the game" in message) <= (not exists), message
        assert ("is below delta_min" in message) <= (not exists), message
        assert any(
            text in message
            for text in ("is below delta_min", "% above delta_min", "too close to delta_min")
        ), message
    else:
        assert error(game, P) <= max(EXACT, 1e-15 / abs(apart))


@pytest.mark.parametrize("seed", [35, 62, 117])
def test_the_weights_of_one_output_stay_semidefinite(seed: int) -> None:
    """Q = c'c is accepted where a barely reached mode makes the solver change its coordinates."""
    rng = np.random.default_rng(seed)
    A = rng.standard_normal((6, 6))
    B = rng.standard_normal((6, 1))
    c = rng.standard_normal((1, 6))
    values, vectors = np.linalg.eig(A.T)
    left = vectors[:, [int(np.argmax(values.real))]].real
    B -= left @ (left.T @ B) / (left.T @ left) * (1.0 - 1e-7)
    game = Game(A, B, np.zeros((6, 1)), c.T @ c, np.eye(1), math.inf)
    assert not is_semidefinite(NormalForm.of(game).turned().Q)
    exact = reference_solution(game)
    assert relative_error(solve(game).P, exact.P) < 1e-8
