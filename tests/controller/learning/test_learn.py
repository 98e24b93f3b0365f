"""The function `learn`: equal seeds, results as plain data, and an independent check."""

from __future__ import annotations

import json
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from learning_samples import published, stable_game
from reference_riccati import reference_solution, relative_error
from scipy.linalg import solve_continuous_lyapunov
from tolerances import FEW_ROUNDINGS

from controller import minimum_delta
from controller.critic.training_run import TrainingRun
from controller.learning import ticks
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


def test_a_run_returns_the_last_critic() -> None:
    """The critic of a run has the value P and the gain K of its last weights."""
    result = short_run()
    critic = result.critic(published("published-5")[0])
    assert pytest.approx(result.P, rel=FEW_ROUNDINGS) == critic.P
    assert pytest.approx(result.K, rel=1e-9) == critic.K


def test_a_training_run_is_strict_json() -> None:
    """A training run is written as strict JSON with its matrices and settings.

    Its report states the units of the weights.
    """
    result = short_run()
    plain = json.loads(json.dumps(result.to_dict(), allow_nan=False))
    assert plain["law"] == "certified"
    assert plain["status"] == result.outcome
    assert np.array_equal(np.array(plain["P"]), result.P)
    assert plain["settings"]["basis"] == "quadratic"
    assert plain["excitation"]["rank"] == 21
    units = result.report().data["weight_units"]
    assert (len(units), units[:2]) == (21, ["1/((ft/s) (ft/s))", "1/((ft/s) (rad))"])


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


def test_stored_rows_include_first_and_last(monkeypatch: pytest.MonkeyPatch) -> None:
    """If a history is too long, evenly spaced rows are stored, with the first and the last row."""
    every = short_run()
    assert every.time == pytest.approx(0.1 * np.arange(81))
    # Reaching the real number of rows would take a run of minutes.
    monkeypatch.setattr(ticks, "MOST_ROWS", 30)
    kept = short_run()
    rows = [*range(0, 80, 3), 80]
    assert np.array_equal(kept.time, every.time[rows])
    assert np.array_equal(kept.weights, every.weights[rows])


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


@pytest.mark.parametrize(("Q", "R"), [(1e-8, 1.0), (1.0, 1e-6), (1e-6, 1e6), (1e8, 1e-8)])
def test_a_correct_critic_settles_at_any_cost_size(Q: float, R: float) -> None:
    """The learning of a correct critic settles for small and large weights Q and R."""
    game = Game([[1.0]], [[1.0]], [[1.0]], [[Q]], [[R]], 2.0 * max(1.0, np.sqrt(R)))
    result = learn(game, tick=0.1)
    s = 1.0 / R - 1.0 / game.delta**2
    assert result.P[0, 0] == pytest.approx((1.0 + np.sqrt(1.0 + Q * s)) / s, rel=FEW_ROUNDINGS)
    assert result.settled
    assert result.settling_time <= 9.5


def shift_by_rounding(game: Game, exact: np.ndarray) -> float:
    """Return the relative change of P due to rounding of each term of the Riccati equation.

    To first order the change X solves (A - S P)'X + X (A - S P) = -w I, with w the sum of the
    magnitudes of the terms.
    """
    A, S = np.linalg.norm(game.A, 2), np.linalg.norm(game.S, 2)
    P = np.linalg.norm(exact, 2)
    terms = np.linalg.norm(game.Q, 2) + 2.0 * A * P + S * P**2
    loop = game.A - game.S @ exact
    shift = solve_continuous_lyapunov(loop.T, -terms * np.eye(len(loop)))
    return float(np.finfo(float).eps * np.linalg.norm(shift) / np.linalg.norm(exact))


def assert_learned(game: Game, share: float, tick: float) -> None:
    """Assert that the game with `share` times its smallest delta is learned."""
    game = game.with_delta(share * minimum_delta(game).value)
    result = learn(game, tick=tick)
    assert result.outcome == "settled", (game.A.shape, game.B.shape, game.E.shape)
    exact = reference_solution(game).P
    assert relative_error(result.P, exact) < min(1e-9, 10.0 * shift_by_rounding(game, exact))
    assert result.settling_time < 10.0


@pytest.mark.parametrize(("seed", "states"), [(9, 6), (7, 8)])
def test_games_with_many_disturbances_are_learned(seed: int, states: int) -> None:
    """Games with a single input and as many disturbances as states are learned."""
    rng = np.random.default_rng(seed)
    eye = np.eye(states)
    A = rng.standard_normal((states, states))
    B = rng.standard_normal((states, 1))
    assert_learned(Game(A, B, eye, eye, [[1.0]], 1.0), 2.0, tick=0.2)


@pytest.mark.parametrize("games", [4, pytest.param(30, marks=pytest.mark.slow)])
def test_random_games_need_no_looser_limit(games: int) -> None:
    """Random games with 1 to 8 states are learned within the error limit of `assert_learned`."""
    rng = np.random.default_rng(21)
    for _ in range(games):
        n = int(rng.integers(1, 9))
        m, k = (int(rng.integers(1, n + 1)) for _ in range(2))
        A, B, E = (rng.standard_normal((n, columns)) for columns in (n, m, k))
        assert_learned(
            Game(A, B, E, np.eye(n), np.eye(m) * 10.0 ** rng.uniform(-2.0, 2.0), 1.0), 1.2, tick=0.5
        )


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
