"""The judge of critics: the exact one passes, every planted mistake is refused with its own reason."""

import math
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from cli import hfa
from game_files import stored
from game_samples import failed_names, game_models
from planted_critics import other_root

from controller import Game, basis
from controller.game.basis import BASES
from controller.game.learning_result import Excitation, LearningResult
from hfa_cli.main import DONE, FAILED
from hfa_support import BadInputError, NoSolutionError
from verification import check_critic, from_gain, from_value, from_weights, solve_game
from verification.critic import critic_check
from verification.critic.critic_check import settling_time

QUADRATIC = basis("quadratic", 6)


@pytest.fixture
def game():
    return game_models()["published-15"]


@pytest.mark.parametrize("name", BASES)
def test_the_exact_weights_pass_in_every_basis(game, name):
    functions = basis(name, 6)
    exact = solve_game(game)
    check = check_critic(game, from_weights(game, functions.weights(exact.P), functions))
    assert check.ok, failed_names(check.checks)
    assert check.P_rel_error <= 1e-12
    assert check.K_rel_error <= 1e-12
    assert check.diagnosis == ""
    assert check.learned_margin.disk == pytest.approx(check.exact_margin.disk, rel=1e-6)


def test_the_value_of_a_state_that_costs_nothing_may_be_0():
    A, B, Q = np.diag([-1.0, -2.0]), np.array([[1.0], [0.0]]), np.diag([1.0, 0.0])
    game = Game(A=A, B=B, E=np.eye(2), Q=Q, R=np.eye(1), delta=100.0)
    P = solve_game(game).P
    assert P[1, 1] == pytest.approx(0.0, abs=1e-14)
    assert check_critic(game, from_value(game, P)).ok


def test_the_exact_critic_of_a_barely_controllable_plant_passes_and_a_wrong_one_does_not():
    """Unstable at +0.5, reached by 3e-6: the rounding of P moves the cost by more than the saddle checks allow."""
    A, B = np.array([[-0.04, 0.72], [0.72, -0.46]]), np.array([[-0.5999976], [0.8000018]])
    game = Game(A, B, np.zeros((2, 1)), np.eye(2), np.eye(1), math.inf)
    P = solve_game(game).P
    assert check_critic(game, from_value(game, P)).ok
    assert not check_critic(game, from_value(game, P * (1.0 + 1e-5))).ok


def test_a_gain_alone_passes_and_shows_no_error_of_a_value(game):
    check = check_critic(game, from_gain(game, solve_game(game).K))
    assert check.ok
    assert math.isnan(check.P_rel_error)
    assert check.to_dict()["P_rel_error"] is None
    assert not any(row.name.startswith(("P_", "saddle", "riccati")) for row in check.checks)


def test_the_limit_is_the_limit(game):
    P = solve_game(game).P
    noise = np.random.default_rng(0).standard_normal(P.shape)
    noise = (noise + noise.T) * np.abs(P)
    off = P + 1e-5 * noise * np.linalg.norm(P) / np.linalg.norm(noise)
    assert "P_rel_error" in failed_names(check_critic(game, from_value(game, off)).checks)
    assert "P_rel_error" not in failed_names(check_critic(game, from_value(game, off), limit=2e-5).checks)


def test_another_root_with_a_tiny_residual_is_refused(game):
    P = other_root(game)
    assert np.abs(game.residual(P)).max() <= 1e-7 * np.abs(game.Q).max()
    check = check_critic(game, from_value(game, P))
    assert {"P_rel_error", "game_loop_abscissa"} <= failed_names(check.checks)
    assert "riccati_residual" not in failed_names(check.checks)
    assert "another root of the Riccati equation" in check.diagnosis


def _rank_deficient_weights(game):
    """Weights whose Bellman residual vanishes on 15 samples, found by Newton steps of least norm from the LQR's."""
    z = np.random.default_rng(3).standard_normal((15, 6)) / np.sqrt(np.diag(solve_game(game).P))
    weights = QUADRATIC.weights(solve_game(game.with_delta(math.inf)).P * 1.2)
    for _ in range(30):
        P = QUADRATIC.matrix(weights)
        residual = np.einsum("ni,ij,nj->n", z, game.residual(P), z)
        sigma = np.einsum("nmi,ni->nm", QUADRATIC.gradient(z), z @ (game.A - game.S @ P).T)
        weights = weights - np.linalg.pinv(sigma) @ residual
    return weights, float(np.abs(residual).max() / np.abs(np.einsum("ni,ij,nj->n", z, game.Q, z)).max())


def _result(game, weights, rank):
    P = QUADRATIC.matrix(weights)
    return LearningResult(
        law="certified",
        basis="quadratic",
        times=np.array([0.0, 1.0]),
        weights=np.array([1.1 * weights, weights]),
        residual_norm=np.array([1.0, 1e-12]),
        law_residual_norm=np.array([1.0, 1e-12]),
        P=P,
        K=game.gain(P),
        excitation=Excitation(rank, 21, 50, 1e-3, 1e3, 1e-12),
        settling_time=1.0,
        certificates=(),
        settings={},
        seed=0,
    )


def test_a_critic_of_too_few_data_is_refused_however_small_its_residual(game):
    weights, residual = _rank_deficient_weights(game)
    assert residual < 1e-10
    candidate = from_weights(game, weights, QUADRATIC)
    check = check_critic(game, candidate, run=_result(game, weights, 15), predefined_time=10.0)
    assert {"P_rel_error", "riccati_residual", "data_rank"} <= failed_names(check.checks)
    assert "rank 15 of 21" in check.diagnosis
    assert not check_critic(game, candidate).ok


def test_a_run_is_also_checked_for_its_settling_time(game):
    weights = QUADRATIC.weights(solve_game(game).P)
    candidate = from_weights(game, weights, QUADRATIC)
    run = _result(game, weights, 21)
    assert check_critic(game, candidate, run=run, predefined_time=2.0).ok
    late = check_critic(game, candidate, run=run, predefined_time=0.5)
    assert failed_names(late.checks) == {"settling_time"}
    assert late.diagnosis == ""  # the critic is the game's: no mistake of its numbers explains the delay


def test_the_settling_time_is_computed_anew(game):
    weights = QUADRATIC.weights(solve_game(game).P)
    run = replace(_result(game, weights, 21), settling_time=math.inf, residual_norm=np.ones(2))
    assert settling_time(game, run, QUADRATIC) == 1.0
    boasting = replace(run, weights=np.array([weights, (1.0 + 1e-6) * weights]), settling_time=0.0)
    assert settling_time(game, boasting, QUADRATIC) == math.inf
    assert settling_time(game, replace(run, weights=np.array([weights, weights])), QUADRATIC) == 0.0
    assert settling_time(game, replace(run, weights=np.array([weights, np.nan * weights])), QUADRATIC) == math.inf


@pytest.mark.parametrize("size", [1e40, 1e60, 1e300])
def test_a_critic_of_sizes_that_overflow_fails(game, size):
    """Its numbers are finite, and P S P is not."""
    exact = solve_game(game)
    for candidate in (from_value(game, size * exact.P), from_gain(game, -size * exact.K)):
        assert "K_rel_error" in failed_names(check_critic(game, candidate).checks)


@pytest.mark.filterwarnings("ignore:Input")  # SciPy, on a Lyapunov equation that rounding makes singular
@pytest.mark.parametrize(("state", "size"), [(0, 1e20), (0, 1e30)])
def test_a_value_that_rounding_alone_makes_ends_and_fails(game, state, size, monkeypatch):
    """The search for a perturbation that costs little went on for ever, or ended in a traceback."""
    monkeypatch.setattr(critic_check, "diagnose", lambda *_: "")  # the cause is sought elsewhere
    P = solve_game(game).P.copy()
    P[state, state] += size
    check = check_critic(game, from_value(game, P))
    assert {"saddle_control_loses", "saddle_control_slope_error"} <= failed_names(check.checks)


@pytest.mark.parametrize("number", [np.nan, np.inf])
def test_a_critic_that_is_not_finite_fails(game, number):
    weights = QUADRATIC.weights(solve_game(game).P)
    weights[2] = number
    with np.errstate(invalid="ignore"):
        check = check_critic(game, from_weights(game, weights, QUADRATIC))
    assert {"K_rel_error", "control_loop_abscissa"} <= failed_names(check.checks)


def test_wrong_shapes_are_named(game):
    with pytest.raises(BadInputError, match="20 weights"):
        from_weights(game, np.ones(20), QUADRATIC)
    with pytest.raises(BadInputError, match="P is 5 x 5"):
        from_value(game, np.eye(5))
    with pytest.raises(BadInputError, match="K is 6 x 5"):
        from_gain(game, np.ones((6, 5)))


def test_a_critic_of_a_game_without_a_solution_cannot_be_checked(game):
    with pytest.raises(NoSolutionError, match="delta_min"):
        check_critic(game.with_delta(50.0), from_gain(game, np.zeros((5, 6))))


def test_the_report_shows_the_entries_that_are_farthest_off(game):
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


# The verdict does not hang on the units of the states and inputs.

TWO_STATES = basis("quadratic", 2)
#: Units of the second state.
UNITS = [1e-8, 1.0, 1e8]


def game_in(state: float, of_input: float = 1.0) -> Game:
    """A plant of two states and two inputs with numbers near 1, the second of each in other units."""
    u, v = np.array([1.0, state]), np.array([1.0, of_input])
    A = np.array([[-1.0, 0.2], [0.1, -1.0]])
    weights = np.diag(u**-2), np.diag(v**-2)
    return Game(A * u[:, None] / u, np.diag(u / v), np.diag(u), *weights, 5.0)


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
    assert check_critic(game, from_gain(game, K)).ok
    for factor in (-1.0, 0.0, 1.0 + 1e-4):
        for change in ([1.0, factor], [factor, 1.0], [[1.0], [factor]], [[factor], [1.0]]):
            wrong = check_critic(game, from_gain(game, K * change))
            assert failed_names(wrong.checks) >= {"K_balanced_error", "policy_rel_error"}


@pytest.mark.usefixtures("no_cause")
@pytest.mark.parametrize("state", UNITS)
def test_a_wrong_entry_of_the_value_is_seen(state: float) -> None:
    game = game_in(state)
    P = solve_game(game).P
    for i, j in ((0, 0), (0, 1), (1, 1)):
        wrong = P.copy()
        wrong[i, j] = wrong[j, i] = P[i, j] * (1.0 + 1e-3)
        assert "P_balanced_error" in failed_names(check_critic(game, from_value(game, wrong)).checks)


@pytest.mark.parametrize("state", UNITS)
def test_mistakes_are_named_in_any_units(state: float) -> None:
    game = game_in(state)
    exact = solve_game(game)
    assert "LQR" in check_critic(game, from_value(game, solve_game(game.with_delta(np.inf)).P)).diagnosis
    assert "wrong sign" in check_critic(game, from_gain(game, -exact.K)).diagnosis
    assert check_critic(game, from_gain(game, exact.K * [1.0, -1.0])).diagnosis == "state 2 has the wrong sign"
    assert check_critic(game, from_gain(game, exact.K * [-1.0, 1.0])).diagnosis == "state 1 has the wrong sign"
    swapped = TWO_STATES.weights(exact.P)[[1, 0, 2]]
    assert "weights 1 and 2 are interchanged" in check_critic(game, from_weights(game, swapped, TWO_STATES)).diagnosis


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
