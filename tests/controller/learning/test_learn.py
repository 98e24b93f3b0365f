"""One entry to all laws: the same bits from the same seed, plain results, and certificates that see
planted errors."""

from __future__ import annotations

import json
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from learning_samples import PUBLISHED, QUADRATIC, published, stable_game
from planted_critics import other_root
from reference_riccati import reference_solution, relative_error

from controller import Game, basis, learn, random_pool
from controller.game.learning_result import Excitation, LearningResult
from controller.learning import certify
from controller.learning.bellman_equations import StackEquations
from controller.learning.certify import (
    Riccati,
    certificates,
    positivity,
    relative_correction,
    relative_residual,
)
from controller.learning.recording import choose
from hfa_model import INPUTS, LINEAR_STATES
from hfa_model.vectors import LINEAR_UNITS
from hfa_support import BadInputError
from verification import minimum_delta


def short_run(seed: int = 4, **more: Any) -> LearningResult:
    return learn(published("published-5")[0], seed=seed, tick=0.1, predefined_time=8.0, **more)


def test_progress_rises_to_one_and_nothing_is_printed(capsys: pytest.CaptureFixture[str]) -> None:
    seen: list[tuple[float, str]] = []
    short_run(progress=lambda fraction, _, message: seen.append((fraction, message)))
    fractions = [fraction for fraction, _ in seen]
    assert fractions == sorted(fractions)
    assert 5 <= len(fractions) <= 100
    assert fractions[-1] == 1.0
    assert all(
        "t = " in message and "residual" in message and "\n" not in message for _, message in seen
    )
    assert capsys.readouterr() == ("", "")


def test_the_seed_decides_every_bit() -> None:
    one, same, other = short_run(), short_run(), short_run(seed=2)
    for name in ("times", "weights", "residual_norm", "law_residual_norm", "P", "K"):
        assert getattr(one, name).tobytes() == getattr(same, name).tobytes(), name
    assert one.to_dict() == same.to_dict()
    assert one.weights.tobytes() != other.weights.tobytes()


def test_results_are_plain_json() -> None:
    result = short_run()
    plain = json.loads(json.dumps(result.to_dict(), allow_nan=False))
    assert plain["law"] == "certified"
    assert plain["status"] == result.outcome
    assert np.array_equal(np.array(plain["P"]), result.P)
    assert plain["settings"]["basis"] == "quadratic"
    assert [row["ok"] for row in plain["certificates"]] == [row.ok for row in result.certificates]
    assert plain["excitation"]["rank"] == 21
    units = result.report(LINEAR_STATES, INPUTS, state_units=LINEAR_UNITS).data["weight_units"]
    assert (len(units), units[:2]) == (21, ["1/((ft/s) (ft/s))", "1/((ft/s) (rad))"])


def test_the_samples_taken_by_default_are_enough_for_the_plant() -> None:
    """A stable chain of ten states with an input and a disturbance at its end: 55 weights."""
    A, end = np.diag(-np.linspace(0.5, 5.0, 10)) + np.diag(np.ones(9), 1), np.eye(10)[:, -1:]
    game = Game(A=A, B=end, E=end, Q=np.eye(10), R=np.eye(1), delta=50.0)
    result = learn(game, tick=0.1)
    assert result.converged
    assert relative_error(result.P, reference_solution(game).P) < 1e-9
    assert (result.settings["samples"], result.settings["pool_samples"]) == (83, 500)
    with pytest.raises(BadInputError, match="54 samples cannot determine 55 weights"):
        learn(game, samples=54)


def test_rows_are_kept_evenly_with_the_start_and_the_end(monkeypatch: pytest.MonkeyPatch) -> None:
    every = short_run()
    assert every.times == pytest.approx(0.1 * np.arange(81))
    monkeypatch.setattr(certify, "MOST_ROWS", 30)
    kept, rows = short_run(), [*range(0, 80, 3), 80]
    assert np.array_equal(kept.times, every.times[rows])
    assert np.array_equal(kept.weights, every.weights[rows])


# The certificates of a learned value see every planted error.


def failures(
    game: Game, weights: np.ndarray, richness: Excitation | None = None, name: str = "quadratic"
) -> list[str]:
    """Names of the certificates that do not hold for W'ψ(z)."""
    functions = basis(name, len(game.A))
    stack = choose(random_pool(game, 300, 0), functions, functions.size + 5)
    equations = StackEquations.build(game, functions, stack, stack.channel_scales())
    found = richness or equations.excitation(equations.scaled(weights))
    return [row.name for row in certificates(game, equations, weights, found) if not row.ok]


@pytest.mark.parametrize("name", PUBLISHED)
def test_the_exact_solution_passes_and_small_errors_of_P_are_seen_and_sized(name: str) -> None:
    game, exact = published(name)
    assert failures(game, QUADRATIC.weights(exact.P)) == []
    error = np.random.default_rng(0).normal(size=(6, 6)) * np.sqrt(
        np.outer(np.diag(exact.P), np.diag(exact.P))
    )
    error = 1e-7 * (error + error.T) * np.linalg.norm(exact.P) / np.linalg.norm(error)
    assert "next Newton correction over |P|" in failures(game, QUADRATIC.weights(exact.P + error))
    relative = np.linalg.norm(error) / np.linalg.norm(exact.P)
    assert relative_correction(game, exact.P + error, np.ones(6)) == pytest.approx(
        relative, rel=0.01
    )


@pytest.mark.parametrize("name", PUBLISHED)
def test_a_wrong_root_has_a_small_residual_and_fails(name: str) -> None:
    game, _ = published(name)
    wrong = other_root(game)
    assert relative_residual(game, wrong, np.ones(6)) < 1e-9
    found = failures(game, QUADRATIC.weights(wrong))
    assert "abscissa of A - S P [1/s]" in found
    assert "relative Riccati residual" not in found


def test_a_poor_stack_fails_whatever_the_residual() -> None:
    game, exact = published(PUBLISHED[0])
    poor = Excitation(
        rank=20, size=21, samples=50, smallest_eigenvalue=1e-30, condition=1e12, rounding=1e-27
    )
    assert failures(game, QUADRATIC.weights(exact.P), poor) == [
        "rank of the stack",
        "smallest eigenvalue of Sigma",
    ]


def test_indefinite_and_zero_values_fail() -> None:
    game = stable_game()
    assert "smallest eigenvalue of scaled P over the largest" in failures(
        game, np.array([1.0, 0.0, -1.0])
    )
    assert "smallest eigenvalue of scaled P over the largest" in failures(game, np.zeros(3))
    assert "next Newton correction over |P|" in failures(game, np.zeros(3))


def test_a_value_of_zero_is_allowed_where_nothing_costs() -> None:
    """Second state: no cost, not controlled. P = diag(p, 0) with 2 a p + q - p² = 0."""
    first = [[1.0], [0.0]]
    game = Game(
        A=np.diag([-1.0, -2.0]), B=first, E=first, Q=np.diag([3.0, 0.0]), R=[[1.0]], delta=np.inf
    )
    assert failures(game, np.array([1.0, 0.0, 0.0])) == []


def test_weights_beyond_the_quadratic_ones_fail() -> None:
    game, exact = published(PUBLISHED[0])
    functions = basis("paper", 6)
    weights = functions.weights(exact.P)
    assert failures(game, weights, name="paper") == []
    weights[-1] = 10.0
    assert failures(game, weights, name="paper") == ["largest weight beyond the quadratic ones"]


def test_singular_weights_are_distinguished_from_definite_ones_beyond_rounding() -> None:
    """Q = C'C that is not diagonal: its smallest eigenvalue is rounding of either sign, and so is
    that of P."""
    rng = np.random.default_rng(18)
    signs = set()
    for _ in range(8):
        T = rng.standard_normal((3, 3))
        A, C = T @ np.diag([-1.0, -2.0, 0.5]) @ np.linalg.inv(T), np.linalg.inv(T)[1:]
        Q = C.T @ C
        game = Game(
            A, rng.standard_normal((3, 1)), np.zeros((3, 1)), (Q + Q.T) / 2.0, [[1.0]], np.inf
        )
        result = learn(game, tick=0.1)
        assert result.converged, result.outcome
        row = positivity(game, result.P, np.ones(3))
        assert (row.relation, row.limit) == (">=", -1e-10)
        signs.add(row.value > 0.0)
    assert signs == {True, False}
    definite = replace(game, Q=np.diag([1.0, 1e-9, 1.0]))
    assert positivity(definite, np.eye(3), np.ones(3)).relation == ">"
    assert not positivity(definite, np.diag([1.0, 1.0, 0.0]), np.ones(3)).ok
    assert not positivity(game, np.diag([1.0, 1.0, -1e-9]), np.ones(3)).ok


@pytest.mark.parametrize(("Q", "R"), [(1e-8, 1.0), (1.0, 1e-6), (1e-6, 1e6), (1e8, 1e-8)])
def test_a_right_critic_settles_whatever_the_size_of_the_costs(Q: float, R: float) -> None:
    game = Game([[1.0]], [[1.0]], [[1.0]], [[Q]], [[R]], 2.0 * max(1.0, np.sqrt(R)))
    result = learn(game, tick=0.1)
    s = 1.0 / R - 1.0 / game.delta**2
    assert result.P[0, 0] == pytest.approx((1.0 + np.sqrt(1.0 + Q * s)) / s, rel=1e-14)
    assert result.converged
    assert result.settling_time <= 9.5


def assert_learned(game: Game, share: float, tick: float) -> None:
    """At `share` times its smallest delta."""
    game = game.with_delta(share * minimum_delta(game).value)
    result = learn(game, tick=tick)
    assert result.outcome == "converged", (game.A.shape, game.B.shape, game.E.shape)
    assert relative_error(result.P, reference_solution(game).P) < 1e-10
    assert result.settling_time < 10.0


@pytest.mark.parametrize(("seed", "states"), [(9, 6), (1, 7), (2, 7), (7, 8)])
def test_few_inputs_against_many_disturbances(seed: int, states: int) -> None:
    rng, eye = np.random.default_rng(seed), np.eye(states)
    A, B = rng.standard_normal((states, states)), rng.standard_normal((states, 1))
    assert_learned(Game(A, B, eye, eye, [[1.0]], 1.0), 2.0, tick=0.2)


@pytest.mark.parametrize("games", [4, pytest.param(30, marks=pytest.mark.slow)])
def test_random_games_need_no_looser_limit(games: int) -> None:
    rng = np.random.default_rng(21)
    for _ in range(games):
        n = int(rng.integers(1, 9))
        m, k = (int(rng.integers(1, n + 1)) for _ in range(2))
        A, B, E = (rng.standard_normal((n, columns)) for columns in (n, m, k))
        assert_learned(
            Game(A, B, E, np.eye(n), np.eye(m) * 10.0 ** rng.uniform(-2.0, 2.0), 1.0), 1.2, tick=0.5
        )


def test_the_correction_is_the_next_policy_iteration() -> None:
    game = stable_game()
    exact = reference_solution(game).P
    P = exact + np.array([[0.02, 0.01], [0.01, -0.01]])
    equation = Riccati.of(game, np.ones(2))
    N = equation.correction(P)
    closed = game.A - game.S @ P
    assert closed.T @ N + N @ closed == pytest.approx(equation.residual(P), abs=1e-13)
    assert equation.residual(P) == pytest.approx(game.residual(P), abs=1e-13)
    errors = [float(np.linalg.norm(X - exact)) for X in (P, P - N)]
    assert errors[1] < errors[0] ** 2
