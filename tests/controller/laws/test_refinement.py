"""The last digits of a learned value: games in which P is large in one direction, as few inputs make it."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from learning_samples import stable_game
from reference_riccati import reference_solution, relative_error

from controller import Game, learn
from controller.laws.certify import newton_correction, refine, riccati_residual
from verification import minimum_delta


def one_input(seed: int, states: int) -> Game:
    """Random A and one random input against a disturbance of every state, at twice the smallest delta."""
    rng = np.random.default_rng(seed)
    eye = np.eye(states)
    game = Game(rng.standard_normal((states, states)), rng.standard_normal((states, 1)), eye, eye, [[1.0]], 1.0)
    return game.with_delta(2.0 * minimum_delta(game).value)


def parts(game: Game) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """A, the roots of both parts of S, and Q; R is 1 x 1."""
    return game.A, game.B / np.sqrt(game.R[0, 0]), game.E / game.delta, game.Q


@pytest.mark.parametrize(("seed", "states"), [(9, 6), (1, 7), (2, 7), (7, 8)])
def test_few_inputs_against_many_disturbances(seed: int, states: int) -> None:
    game = one_input(seed, states)
    exact = reference_solution(game)
    result = learn(game, tick=0.2)
    assert result.status == "converged"
    assert relative_error(result.P, exact.P) < 1e-10
    assert result.settling_time < 10.0


@pytest.mark.parametrize("games", [10, pytest.param(30, marks=pytest.mark.slow)])
def test_random_games_need_no_looser_limit(games: int) -> None:
    rng = np.random.default_rng(21)
    for _ in range(games):
        n = int(rng.integers(1, 9))
        m, k = (int(rng.integers(1, n + 1)) for _ in range(2))
        A, B, E = (rng.standard_normal((n, columns)) for columns in (n, m, k))
        game = Game(A, B, E, np.eye(n), np.eye(m) * 10.0 ** rng.uniform(-2.0, 2.0), 1.0)
        game = game.with_delta(1.2 * minimum_delta(game).value)
        result = learn(game, tick=0.5)
        assert result.status == "converged", (n, m, k)
        assert relative_error(result.P, reference_solution(game).P) < 1e-9


def test_the_correction_is_the_next_policy_iteration() -> None:
    game = stable_game()
    exact = reference_solution(game).P
    P = exact + np.array([[0.02, 0.01], [0.01, -0.01]])
    N = newton_correction(*parts(game), P)
    closed = game.A - game.S @ P
    assert closed.T @ N + N @ closed == pytest.approx(riccati_residual(*parts(game), P), abs=1e-13)
    assert riccati_residual(*parts(game), P) == pytest.approx(game.residual(P), abs=1e-13)
    errors = [float(np.linalg.norm(X - exact)) for X in (P, P - N)]
    assert errors[1] < errors[0] ** 2


def test_refining_ends_at_rounding_and_counts_its_solves() -> None:
    game = stable_game()
    exact = reference_solution(game).P
    P, solves = refine(*parts(game), exact + 0.01 * np.eye(2))
    assert relative_error(P, exact) < 1e-14
    assert 3 <= solves <= 8


def test_where_there_is_no_correction_the_value_stays() -> None:
    game = replace(stable_game(), A=np.zeros((2, 2)))
    zero = np.zeros((2, 2))
    with pytest.raises(np.linalg.LinAlgError):
        newton_correction(*parts(game), zero)
    P, solves = refine(*parts(game), zero)
    assert (P.tolist(), solves) == (zero.tolist(), 0)
