"""Cross weights N of the cost z'Qz + 2z'Nu + u'Ru: one elimination, right for every consumer."""

import control
import numpy as np
import pytest
from cli import answer, assert_refused, hfa
from scipy.linalg import block_diag, solve_continuous_are

from controller import minimum_delta
from hfa import (
    Game,
    solve,
)


def crossed(seed, n=4, m=2, delta=np.inf):
    """Return a random game whose [[Q, N], [N', R]] is positive definite."""
    rng = np.random.default_rng(seed)
    A = rng.standard_normal((n, n))
    B = rng.standard_normal((n, m))
    root = rng.standard_normal((n + m, n + m))
    W = root @ root.T
    E = rng.standard_normal((n, 2))
    return Game(A, B, E=E, Q=W[:n, :n], R=W[n:, n:], delta=delta, N=W[:n, n:])


def test_a_game_with_cross_weights_agrees_with_scipy():
    """P, K, L and the worst-case loop are those of SciPy's solution for both players.

    The L2 gain of 0.9 K is python-control's.
    """
    game = crossed(0)
    game = game.with_delta(1.5 * minimum_delta(game).value)
    solution = solve(game)
    n = len(game.A)
    k = game.E.shape[1]
    weights = block_diag(game.R, -(game.delta**2) * np.eye(k))
    both = np.hstack([game.N, np.zeros((n, k))])
    P = solve_continuous_are(game.A, np.hstack([game.B, game.E]), game.Q, weights, s=both)
    size = np.abs(P).max()
    assert np.allclose(solution.P, P, atol=1e-8 * size)
    K = np.linalg.solve(game.R, game.B.T @ P + game.N.T)
    assert np.allclose(solution.K, K, atol=1e-8 * np.abs(K).max())
    assert np.allclose(solution.disturbance_gain, game.E.T @ P / game.delta**2)
    worst = game.A - game.B @ K + game.E @ solution.disturbance_gain
    assert np.allclose(game.worst_case_loop(P), worst, atol=1e-7 * np.abs(worst).max())
    gain = 0.9 * K
    root = np.linalg.cholesky(np.block([[game.Q, game.N], [game.N.T, game.R]])).T
    C = root @ np.vstack([np.eye(n), -gain])
    loop = control.ss(game.A - game.B @ gain, game.E, C, 0)
    exact = control.norm(loop, p="inf", tol=1e-9)
    assert solution.closed_loops.l2_gain(gain).high == pytest.approx(exact, rel=2e-6)


def test_margins_open_the_loop_at_the_input_of_the_plant():
    """Margins are those of K (sI - A)^-1 B, not of the plant whose input is u + R^-1 N'z."""
    game = crossed(3, m=1)
    solution = solve(game)
    (margins,) = solution.loop_margins.values()
    loop = control.ss(game.A, game.B, solution.K, 0)
    sensitivity = control.feedback(1, loop)
    response = sensitivity(1j * np.logspace(-4, 4, 20001))
    disk = 1.0 / np.abs(response - 0.5).max()
    assert margins["disk"] == pytest.approx(disk, rel=1e-4)
    assert solution.disk_margin.disk == pytest.approx(disk, rel=1e-3)


def test_the_command_line_gives_cross_weights(tmp_path):
    """The K of --N is that of python-control; N of another shape is refused."""
    A, B, N = [[0.0, 1.0], [2.0, -0.3]], [[0.0], [1.0]], np.array([[-0.2], [0.1]])
    np.savez(tmp_path / "plant.npz", A=A, B=B, Q=np.eye(2), R=np.eye(1))
    K = control.lqr(A, B, np.eye(2), np.eye(1), N)[0]
    words = ("solve", "--model", str(tmp_path / "plant.npz"))
    assert np.allclose(answer(*words, "--N=-.2;.1")["K"], K)
    assert_refused(hfa(*words, "--N", "1,2;3"), 2, "--N")
