"""The judge of critics: the exact one passes, each planted mistake is refused, in any units."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from cli import answer, hfa
from game_files import AT_15, stored
from game_samples import failed_names, game_models
from planted_critics import other_root

from controller import Game, basis
from controller.game.basis import BASES
from controller.game.learning_result import Excitation, LearningResult
from hfa_cli.main import BAD_INPUT, DONE, FAILED
from hfa_support import BadInputError, NoSolutionError
from verification import check_critic, from_gain, from_value, from_weights, solve_game
from verification.critic import diagnosis
from verification.critic.candidate import Candidate
from verification.critic.critic_check import settling_time

QUADRATIC = basis("quadratic", 6)


@pytest.fixture
def game() -> Game:
    return game_models()["published-15"]


@pytest.fixture
def no_cause(monkeypatch: pytest.MonkeyPatch) -> None:
    """The search for a cause, which takes most of the time and no part in the verdict, is left out."""
    monkeypatch.setattr(diagnosis, "diagnose", lambda *_: "")


def failed(game: Game, candidate: Candidate, **how: Any) -> set[str]:
    return failed_names(check_critic(game, candidate, **how).checks)


@pytest.mark.parametrize("name", BASES)
def test_the_exact_weights_pass_in_every_basis(game: Game, name: str) -> None:
    functions = basis(name, 6)
    check = check_critic(game, from_weights(game, functions.weights(solve_game(game).P), functions))
    assert check.ok, failed_names(check.checks)
    assert max(check.P_rel_error, check.K_rel_error) <= 1e-12
    assert check.diagnosis == ""
    assert check.learned_margin is not None
    assert check.exact_margin is not None
    assert check.learned_margin.disk == pytest.approx(check.exact_margin.disk, rel=1e-6)


def test_the_value_of_a_state_that_costs_nothing_may_be_0() -> None:
    A, B, Q = np.diag([-1.0, -2.0]), np.array([[1.0], [0.0]]), np.diag([1.0, 0.0])
    game = Game(A=A, B=B, E=np.eye(2), Q=Q, R=np.eye(1), delta=100.0)
    P = solve_game(game).P
    assert P[1, 1] == pytest.approx(0.0, abs=1e-14)
    assert check_critic(game, from_value(game, P)).ok


def test_the_exact_critic_of_a_barely_controllable_plant_passes_and_a_wrong_one_does_not() -> None:
    """Unstable at +0.5, reached by 3e-6: the rounding of P moves the cost by more than the saddle checks allow."""
    A, B = np.array([[-0.04, 0.72], [0.72, -0.46]]), np.array([[-0.5999976], [0.8000018]])
    game = Game(A, B, np.zeros((2, 1)), np.eye(2), np.eye(1), math.inf)
    P = solve_game(game).P
    assert check_critic(game, from_value(game, P)).ok
    assert not check_critic(game, from_value(game, P * (1.0 + 1e-5))).ok


def test_a_gain_alone_passes_and_shows_no_error_of_a_value(game: Game) -> None:
    check = check_critic(game, from_gain(game, solve_game(game).K))
    assert check.ok
    assert check.to_dict()["P_rel_error"] is None
    assert not any(row.name.startswith(("P_", "saddle", "riccati")) for row in check.checks)


@pytest.mark.usefixtures("no_cause")
def test_the_limit_is_the_limit(game: Game) -> None:
    P = solve_game(game).P
    noise = np.random.default_rng(0).standard_normal(P.shape)
    noise = (noise + noise.T) * np.abs(P)
    off = from_value(game, P + 1e-5 * noise * np.linalg.norm(P) / np.linalg.norm(noise))
    assert "P_rel_error" in failed(game, off)
    assert "P_rel_error" not in failed(game, off, limit=2e-5)


def test_another_root_with_a_tiny_residual_is_refused(game: Game) -> None:
    P = other_root(game)
    assert np.abs(game.residual(P)).max() <= 1e-7 * np.abs(game.Q).max()
    check = check_critic(game, from_value(game, P))
    assert {"P_rel_error", "game_loop_abscissa"} <= failed_names(check.checks)
    assert "riccati_residual" not in failed_names(check.checks)
    assert "another root of the Riccati equation" in check.diagnosis


# A run.


def rank_deficient_weights(game: Game) -> tuple[np.ndarray, float]:
    """Weights whose Bellman residual vanishes on 15 samples, found by Newton steps of least norm from the LQR's."""
    z = np.random.default_rng(3).standard_normal((15, 6)) / np.sqrt(np.diag(solve_game(game).P))
    weights = QUADRATIC.weights(solve_game(game.with_delta(math.inf)).P * 1.2)
    for _ in range(30):
        P = QUADRATIC.matrix(weights)
        residual = np.einsum("ni,ij,nj->n", z, game.residual(P), z)
        sigma = np.einsum("nmi,ni->nm", QUADRATIC.gradient(z), z @ (game.A - game.S @ P).T)
        weights = weights - np.linalg.pinv(sigma) @ residual
    return weights, float(np.abs(residual).max() / np.abs(np.einsum("ni,ij,nj->n", z, game.Q, z)).max())


def result_of(game: Game, weights: np.ndarray, rank: int) -> LearningResult:
    P, ends = QUADRATIC.matrix(weights), np.array([1.0, 1e-12])
    richness = Excitation(rank, 21, 50, 1e-3, 1e3, 1e-12)
    rows = np.array([0.0, 1.0]), np.array([1.1 * weights, weights]), ends, ends
    return LearningResult("certified", "quadratic", *rows, P, game.gain(P), richness, 1.0, (), {}, 0)


def test_a_critic_of_too_few_data_is_refused_however_small_its_residual(game: Game) -> None:
    weights, residual = rank_deficient_weights(game)
    assert residual < 1e-10
    run = result_of(game, weights, 15)
    check = check_critic(game, from_weights(game, weights), run=run, predefined_time=10.0)
    assert {"P_rel_error", "riccati_residual", "data_rank"} <= failed_names(check.checks)
    assert "rank 15 of 21" in check.diagnosis


def test_a_run_is_also_checked_for_its_settling_time_computed_anew(game: Game) -> None:
    weights = QUADRATIC.weights(solve_game(game).P)
    candidate, run = from_weights(game, weights), result_of(game, weights, 21)
    assert check_critic(game, candidate, run=run, predefined_time=2.0).ok
    late = check_critic(game, candidate, run=run, predefined_time=0.5)
    assert failed_names(late.checks) == {"settling_time"}
    assert late.diagnosis == ""  # the critic is the game's: no mistake of its numbers explains the delay
    boasting = replace(run, settling_time=0.0)
    for other, settled in (
        (np.array([1.1 * weights, weights]), 1.0),
        (np.array([weights, (1.0 + 1e-6) * weights]), math.inf),
        (np.array([weights, weights]), 0.0),
        (np.array([weights, np.nan * weights]), math.inf),
    ):
        assert settling_time(game, replace(boasting, weights=other), QUADRATIC) == settled


# Numbers of any size, wrong shapes, games without a solution.


@pytest.mark.filterwarnings("ignore:Input")  # SciPy, on a Lyapunov equation that rounding makes singular
@pytest.mark.usefixtures("no_cause")
def test_critics_that_overflow_or_are_no_numbers_fail(game: Game) -> None:
    exact = solve_game(game)
    for size in (1e40, 1e60, 1e300):  # finite, and P S P is not
        for candidate in (from_value(game, size * exact.P), from_gain(game, -size * exact.K)):
            assert "K_rel_error" in failed(game, candidate)
    for number in (np.nan, np.inf):
        weights = QUADRATIC.weights(exact.P)
        weights[2] = number
        with np.errstate(invalid="ignore"):
            assert {"K_rel_error", "control_loop_abscissa"} <= failed(game, from_weights(game, weights))
    P = exact.P.copy()
    P[0, 0] += 1e30  # the search for a perturbation that costs little went on for ever, or ended in a traceback
    assert {"saddle_control_loses", "saddle_control_slope_error"} <= failed(game, from_value(game, P))


def test_wrong_shapes_and_numbers_that_are_not_real_are_named(game: Game) -> None:
    """NumPy would drop the imaginary part, with a warning, and the rest would pass."""
    with pytest.raises(BadInputError, match="20 weights"):
        from_weights(game, np.ones(20), QUADRATIC)
    with pytest.raises(BadInputError, match="P is 5 x 5"):
        from_value(game, np.eye(5))
    with pytest.raises(BadInputError, match="K is 6 x 5"):
        from_gain(game, np.ones((6, 5)))
    for make, held, right in ((from_weights, "W", np.ones(21)), (from_value, "P", np.eye(6))):
        for wrong in (right + 1j, [[1.0], [1.0, 2.0]], right.astype(str)):
            with pytest.raises(BadInputError, match=f"{held} does not consist of rows of real numbers"):
                make(game, wrong)


def test_a_critic_of_a_game_without_a_solution_cannot_be_checked(game: Game) -> None:
    with pytest.raises(NoSolutionError, match="delta_min"):
        check_critic(game.with_delta(50.0), from_gain(game, np.zeros((5, 6))))


def test_the_report_shows_the_entries_that_are_farthest_off(game: Game) -> None:
    """Two wrong entries among 51 are in the table; files have all."""
    exact = solve_game(game)
    P, K = exact.P.copy(), exact.K.copy()
    P[1, 4] = P[4, 1] = P[1, 4] * 1.01
    K[3, 2] *= 1.01
    report = check_critic(game, replace(from_value(game, P), K=K)).report()
    said = report.text()
    assert "\nP(x2, x5) " in said
    assert "\nK(u4, x3) " in said
    assert "the 3 of 51 entries that are farthest off; -o FILE has all" in said
    assert len(report.records.rows) == 36 + 30


# The verdict does not depend on the units of the states and inputs.

TWO_STATES = basis("quadratic", 2)
#: Units of the second state.
UNITS = [1e-8, 1.0, 1e8]


def game_in(state: float, of_input: float = 1.0) -> Game:
    """A plant of two states and two inputs with numbers near 1, the second of each in other units."""
    u, v = np.array([1.0, state]), np.array([1.0, of_input])
    A = np.array([[-1.0, 0.2], [0.1, -1.0]])
    weights = np.diag(u**-2), np.diag(v**-2)
    return Game(A * u[:, None] / u, np.diag(u / v), np.diag(u), *weights, 5.0)


@pytest.mark.usefixtures("no_cause")
@pytest.mark.parametrize(
    ("state", "of_input"),
    [(1.0, 1.0), (1e-8, 1e3), (1e8, 1e-3), *(pytest.param(each, each, marks=pytest.mark.slow) for each in (1e-8, 1e8))],
)
def test_a_wrong_part_of_the_gain_or_entry_of_the_value_is_seen(state: float, of_input: float) -> None:
    game = game_in(state, of_input)
    exact = solve_game(game)
    assert check_critic(game, from_gain(game, exact.K)).ok
    for factor in (-1.0, 0.0, 1.0 + 1e-4):
        for change in ([1.0, factor], [factor, 1.0], [[1.0], [factor]], [[factor], [1.0]]):
            assert failed(game, from_gain(game, exact.K * change)) >= {"K_balanced_error", "policy_rel_error"}
    for i, j in ((0, 0), (0, 1), (1, 1)):
        wrong = exact.P.copy()
        wrong[i, j] = wrong[j, i] = exact.P[i, j] * (1.0 + 1e-3)
        assert "P_balanced_error" in failed(game, from_value(game, wrong))


@pytest.mark.parametrize("state", UNITS)
def test_mistakes_are_named_in_any_units(state: float) -> None:
    game = game_in(state)
    exact = solve_game(game)
    assert "LQR" in check_critic(game, from_value(game, solve_game(game.with_delta(np.inf)).P)).diagnosis
    assert "wrong sign" in check_critic(game, from_gain(game, -exact.K)).diagnosis
    assert check_critic(game, from_gain(game, exact.K * [1.0, -1.0])).diagnosis == "state 2 has the wrong sign"
    swapped = TWO_STATES.weights(exact.P)[[1, 0, 2]]
    assert "weights 1 and 2 are interchanged" in check_critic(game, from_weights(game, swapped, TWO_STATES)).diagnosis


# A file that holds more than one of W, P and K: each is judged, none hides another.


@pytest.mark.usefixtures("folder")
@pytest.mark.parametrize(
    ("held", "factors", "said"),
    [
        ("WPK", {}, ""),
        ("PK", {"K": -1.0}, "the gain has the wrong sign"),
        ("WK", {"K": 1.0 + 1e-4}, "every entry of K is 1.0001 times the exact one"),
        ("PK", {"P": 1.1}, "every entry of P is 1.1 times the exact one"),
    ],
)
def test_no_part_of_a_file_hides_another(held: str, factors: dict[str, float], said: str) -> None:
    exact = solve_game(game := game_models()["published-15"])
    parts = {"W": QUADRATIC.weights(exact.P), "P": exact.P, "K": exact.K}
    plant = stored("plant.npz", A=game.A, B=game.B)
    file = stored("all.npz", **{key: factors.get(key, 1.0) * parts[key] for key in held})
    data = answer("verify", "--model", plant, "--weights", file, code=FAILED if said else DONE)
    assert data["diagnosis"].startswith(said)
    assert bool(data["diagnosis"]) == bool(said)
    for name in "PK":
        assert data[f"{name}_rel_error"] == pytest.approx(abs(factors.get(name, 1.0) - 1.0), rel=1e-6, abs=1e-12)


@pytest.mark.usefixtures("folder")
def test_parts_that_contradict_each_other_or_do_not_fit_are_refused() -> None:
    P = solve_game(game_models()["published-15"]).P
    words = ("verify", *AT_15, "--weights")
    said = hfa(*words, stored("wp.npz", W=(1.0 + 1e-4) * QUADRATIC.weights(P), P=P))
    assert (said.code, said.out) == (BAD_INPUT, "")
    assert said.err == "hfa: wp.npz: W and P are of different values; leave one of them out\n"
    assert "K is 6 x 5" in hfa(*words, stored("pk.npz", P=P, K=np.ones((6, 5)))).err
