"""The verdict on a critic does not hang on the units of the states and inputs."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from cli import hfa
from game_files import stored
from game_samples import failed_names

from controller import Game, basis
from hfa_cli.main import DONE, FAILED
from verification import Candidate, CriticCheck, check_critic, from_gain, from_value, from_weights, solve_game
from verification.critic import critic_check

QUADRATIC = basis("quadratic", 2)
#: Units of the second state.
UNITS = [1e-8, 1.0, 1e8]


def game_in(state: float, of_input: float = 1.0) -> Game:
    """A plant of two states and two inputs with numbers near 1, the second of each in other units."""
    u, v = np.array([1.0, state]), np.array([1.0, of_input])
    A = np.array([[-1.0, 0.2], [0.1, -1.0]])
    weights = np.diag(u**-2), np.diag(v**-2)
    return Game(A * u[:, None] / u, np.diag(u / v), np.diag(u), *weights, 5.0)


def judged(game: Game, candidate: Candidate) -> CriticCheck:
    return check_critic(game, candidate)


@pytest.fixture
def no_cause(monkeypatch: pytest.MonkeyPatch) -> None:
    """The search for a cause, which takes most of the time and no part in the verdict, is left out."""
    monkeypatch.setattr(critic_check, "diagnose", lambda *_: "")


@pytest.mark.usefixtures("no_cause")
@pytest.mark.parametrize(
    ("state", "of_input"),
    [(1.0, 1.0), (1e-8, 1e3), (1e8, 1e-3), *(pytest.param(each, each, marks=pytest.mark.slow) for each in (1e-8, 1e8))],
)
def test_a_wrong_column_or_row_of_the_gain_is_seen(state: float, of_input: float) -> None:
    game = game_in(state, of_input)
    K = solve_game(game).K
    assert judged(game, from_gain(game, K)).ok
    for factor in (-1.0, 0.0, 1.0 + 1e-4):
        for change in ([1.0, factor], [factor, 1.0], [[1.0], [factor]], [[factor], [1.0]]):
            wrong = judged(game, from_gain(game, K * change))
            assert failed_names(wrong.checks) >= {"K_balanced_error", "policy_rel_error"}


@pytest.mark.usefixtures("no_cause")
@pytest.mark.parametrize("state", UNITS)
def test_a_wrong_entry_of_the_value_is_seen(state: float) -> None:
    game = game_in(state)
    P = solve_game(game).P
    for i, j in ((0, 0), (0, 1), (1, 1)):
        wrong = P.copy()
        wrong[i, j] = wrong[j, i] = P[i, j] * (1.0 + 1e-3)
        assert "P_balanced_error" in failed_names(judged(game, from_value(game, wrong)).checks)


@pytest.mark.parametrize("state", UNITS)
def test_mistakes_are_named_in_any_units(state: float) -> None:
    game = game_in(state)
    exact = solve_game(game)
    assert "LQR" in judged(game, from_value(game, solve_game(game.with_delta(np.inf)).P)).diagnosis
    assert "wrong sign" in judged(game, from_gain(game, -exact.K)).diagnosis
    assert judged(game, from_gain(game, exact.K * [1.0, -1.0])).diagnosis == "state 2 has the wrong sign"
    assert judged(game, from_gain(game, exact.K * [-1.0, 1.0])).diagnosis == "state 1 has the wrong sign"
    swapped = QUADRATIC.weights(exact.P)[[1, 0, 2]]
    assert "weights 1 and 2 are interchanged" in judged(game, from_weights(game, swapped, QUADRATIC)).diagnosis


def test_the_command_compares_policies_in_the_plants_own_units(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    game = game_in(1e8)
    plant = stored("plant.npz", A=game.A, B=game.B, E=game.E, Q=game.Q, R=game.R, delta=game.delta)
    K = solve_game(game).K
    assert hfa("verify", "--model", plant, "--weights", stored("right.npz", K=K)).code == DONE
    said = hfa("verify", "--model", plant, "--weights", stored("wrong.npz", K=K * [1.0, -1.0]))
    assert said.code == FAILED
    assert {"FAIL K_balanced_error:", "FAIL policy_rel_error:"} <= {
        " ".join(line.split()[:2]) for line in said.out.splitlines()
    }
