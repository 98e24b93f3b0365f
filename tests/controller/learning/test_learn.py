"""The function `learn`: equal seeds, results as plain data, and an independent check."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from learning_samples import published, stable_game
from reference_riccati import reference_solution, relative_error

from controller.critic.training_run import TrainingRun
from controller.learning.bellman_equations import Riccati, control_root
from hfa import BadInputError, Game, learn, verify


def short_run(seed: int = 4, **more: Any) -> TrainingRun:
    return learn(published("published-5")[0], seed=seed, tick=0.1, predefined_time=8.0, **more)


def test_the_progress_callback_receives_increasing_fractions(
    capsys: pytest.CaptureFixture[str],
) -> None:
    """The progress callback of `learn` receives increasing fractions up to 1 with one-line
    messages.

    Nothing is printed.
    """
    seen: list[tuple[float, str]] = []
    short_run(progress=lambda fraction, _, message: seen.append((fraction, message)))
    fractions = [fraction for fraction, _ in seen]
    assert fractions == sorted(fractions)
    assert len(fractions) >= 5
    assert fractions[-1] == 1.0
    assert seen[:2] == [(0.0, "choosing samples"), (0.0, "learning")]
    assert all(
        "t = " in message and "residual" in message and "\n" not in message
        for _, message in seen[2:]
    )
    assert capsys.readouterr() == ("", "")


def test_equal_seeds_give_identical_bits() -> None:
    """Training runs with equal seeds are bit-identical. Another seed changes the weights."""
    first = short_run()
    same = short_run()
    second = short_run(seed=2)
    for name in ("time", "weights", "residual_norm", "law_residual_norm", "P", "K"):
        assert getattr(first, name).tobytes() == getattr(same, name).tobytes(), name
    assert first.to_dict() == same.to_dict()
    assert first.weights.tobytes() != second.weights.tobytes()


def test_the_default_number_of_samples_is_enough() -> None:
    """The default number of samples is enough for the 55 weights of a game with ten states.

    One sample fewer than the weights is refused.
    """
    A = np.diag(-np.linspace(0.5, 5.0, 10)) + np.diag(np.ones(9), 1)
    end = np.eye(10)[:, -1:]
    game = Game(A=A, B=end, E=end, Q=np.eye(10), R=np.eye(1), delta=50.0)
    result = learn(game, tick=0.1)
    assert result.settled
    assert relative_error(result.P, reference_solution(game).P) < 1e-9
    assert (result.settings["samples"], result.settings["pool_samples"]) == (83, 500)
    with pytest.raises(BadInputError, match="54 samples cannot determine 55 weights"):
        learn(game, samples=54)


# Checks of learned critics by `verify`, which uses A.


def test_a_run_of_poor_data_is_not_settled() -> None:
    """A training run with rank-deficient data, or with a large residual, does not count as
    settled.
    """
    run = short_run()
    poor = replace(run, excitation=replace(run.excitation, rank=20))
    assert run.settled
    assert not poor.settled
    assert poor.outcome == "the data have rank 20 of 21"
    late = replace(run, settling_residual=np.ones_like(run.time))
    assert "does not settle: 1 at the end" in late.outcome


def test_singular_weights_are_learned_and_pass() -> None:
    """Games with a singular Q = C'C are learned and pass the check.

    The smallest eigenvalue of P is positive in some games, and 0 or negative by rounding in others.
    """
    rng = np.random.default_rng(18)
    signs = set()
    for _ in range(8):
        T = rng.standard_normal((3, 3))
        A = T @ np.diag([-1.0, -2.0, 0.5]) @ np.linalg.inv(T)
        C = np.linalg.inv(T)[1:]
        Q = C.T @ C
        game = Game(
            A, rng.standard_normal((3, 1)), np.zeros((3, 1)), (Q + Q.T) / 2.0, [[1.0]], np.inf
        )
        run = learn(game, tick=0.1)
        verdict = verify(game, run)
        assert verdict.ok, verdict.headline()
        signs.add(np.linalg.eigvalsh(run.P)[0] > 0.0)
    assert signs == {True, False}


def test_twelve_states_are_learned_without_a_disturbance() -> None:
    """A random LQR problem with 12 states and 78 weights is learned from data of full rank."""
    rng = np.random.default_rng(1)
    A = rng.standard_normal((12, 12)) - np.diag(np.geomspace(1.0, 1e3, 12))
    game = Game(A, rng.standard_normal((12, 3)), np.eye(12), np.eye(12), np.eye(3), np.inf)
    run = learn(game, tick=0.5)
    assert run.excitation.rank == run.excitation.size == 78
    assert verify(game, run).ok


def test_the_correction_is_the_next_policy_iteration() -> None:
    """The Newton correction of P solves the Lyapunov equation of the Riccati residual."""
    game = stable_game()
    exact = reference_solution(game).P
    P = exact + np.array([[0.02, 0.01], [0.01, -0.01]])
    equation = Riccati(game.A, control_root(game), game.E / game.delta, game.Q)
    N = equation.correction(P)
    closed = game.A - game.S @ P
    assert closed.T @ N + N @ closed == pytest.approx(equation.residual(P), abs=1e-13)
    assert equation.residual(P) == pytest.approx(game.residual(P), abs=1e-13)
