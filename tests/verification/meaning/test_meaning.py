"""The value means what it says: costs, deviations, gains and margins, each also with an error planted."""

from __future__ import annotations

import math
from dataclasses import replace

import control
import numpy as np
import pytest
from game_samples import INITIAL, game_models, random_game
from scipy.linalg import solve_continuous_lyapunov
from scipy.optimize import minimize

from controller.game.zero_sum import Game
from hfa_model.support.checks import Check, at_least, at_most, below
from hfa_model.support.errors import BadInputError, NoSolutionError
from verification.meaning.cost import cost_checks, cost_matrix, simulated_cost
from verification.meaning.linear_flight import simulate
from verification.meaning.margins import disk_margin, loop_margins, structured_bound
from verification.meaning.meaning import meaning_checks
from verification.meaning.saddle import CHANGE, RATIO, saddle_checks
from verification.riccati.delta_min import minimum_delta
from verification.riccati.existence import has_value
from verification.riccati.gare import solve_game
from verification.riccati.l2_gain import SweptGain, bounded_real_gain, gain_checks, gain_is_below, swept_gain

MODELS = sorted(game_models())


@pytest.fixture(params=MODELS)
def game(request: pytest.FixtureRequest) -> Game:
    return game_models()[request.param]


@pytest.fixture(scope="module")
def first() -> tuple[Game, np.ndarray]:
    game = game_models()[MODELS[0]]
    return game, solve_game(game).P


def _failed(checks: tuple[Check, ...]) -> set[str]:
    return {check.name for check in checks if not check.ok}


# One judged number ----------------------------------------------------------------------------------------------


def test_checks_judge_and_give_reasons() -> None:
    assert at_most("x", 1.0, 1.0, "too large") == Check("x", 1.0, 1.0, True, "")
    assert at_most("x", 1.1, 1.0, "too large") == Check("x", 1.1, 1.0, False, "too large")
    assert at_least("x", 1.0, 1.0, "small").ok
    assert not at_least("x", 0.9, 1.0, "small").ok
    assert not below("x", 1.0, 1.0, "not below").ok
    for judge in (at_most, at_least, below):
        assert not judge("x", math.nan, 1.0, "not a number").ok
    assert at_most("x", math.inf, 1.0, "infinite").to_dict()["value"] is None


# Everything together --------------------------------------------------------------------------------------------


def test_exact_solution_means_what_it_says(game: Game) -> None:
    checks = meaning_checks(game, solve_game(game).P, INITIAL)
    assert not _failed(checks), [check.reason for check in checks if not check.ok]
    assert {check.name for check in checks} == {
        "cost_lyapunov",
        "cost_simulated",
        "saddle_control_loses",
        "saddle_control_slope_error",
        "saddle_disturbance_loses",
        "saddle_disturbance_slope_error",
        "l2_gain",
        "l2_gain_methods_agree",
    }


def test_lqr_has_one_player() -> None:
    game = game_models()[MODELS[1]].with_delta(math.inf)
    checks = meaning_checks(game, solve_game(game).P, INITIAL)
    assert not _failed(checks)
    assert "saddle_disturbance_loses" not in {check.name for check in checks}


# Cost -----------------------------------------------------------------------------------------------------------


def test_cost_is_exact_far_beyond_its_limit(game: Game) -> None:
    for initial in (INITIAL, np.array([-3.0, 0.1, -0.2, 0.3, 0.05, -0.4])):
        lyapunov, simulated = cost_checks(game, solve_game(game).P, initial)
        assert lyapunov.value < 1e-12
        assert simulated.value < 1e-9


def test_cost_of_a_value_that_is_off_by_a_millionth_is_noticed(first: tuple[Game, np.ndarray]) -> None:
    game, P = first
    assert _failed(cost_checks(game, P * (1.0 + 1e-6), INITIAL)) == {"cost_lyapunov", "cost_simulated"}


def test_policies_that_do_not_come_to_rest_have_no_cost(first: tuple[Game, np.ndarray]) -> None:
    game, P = first
    checks = cost_checks(game, -P, INITIAL)
    assert _failed(checks) == {"cost_lyapunov", "cost_simulated"}
    assert "do not bring the state to rest" in checks[0].reason
    for cost in (cost_matrix, lambda *policies: simulated_cost(*policies, INITIAL)):
        with pytest.raises(NoSolutionError, match=r"abscissa \+.* cost of these policies is infinite"):
            cost(game, -game.gain(P), game.disturbance_gain(P))
    assert _failed(saddle_checks(game, -P, INITIAL, seed=0)) == {"saddle_finite_cost"}


def test_cost_of_a_scalar_policy_in_closed_form() -> None:
    game = Game([[-1.0]], [[1.0]], [[1.0]], [[2.0]], [[3.0]], 2.0)  # u = -z/2, d = z/4: z' = -1.25 z
    exact = (2.0 + 3.0 / 4.0 - 4.0 / 16.0) / 2.5
    policies = np.array([[0.5]]), np.array([[0.25]])
    assert cost_matrix(game, *policies)[0, 0] == pytest.approx(exact, rel=1e-14)
    assert simulated_cost(game, *policies, np.array([3.0])) == pytest.approx(9.0 * exact, rel=1e-11)


def test_simulation_against_the_exponential(first: tuple[Game, np.ndarray]) -> None:
    from scipy.linalg import expm

    game, P = first
    K, L, times = game.gain(P), game.disturbance_gain(P), np.linspace(0.0, 3.0, 7)
    flight = simulate(game, lambda _, z: -K @ z, lambda _, z: L @ z, INITIAL, times)
    exact = np.array([expm((game.A - game.B @ K + game.E @ L) * t) @ INITIAL for t in times])
    np.testing.assert_allclose(flight.states, exact, atol=1e-10)
    np.testing.assert_allclose(flight.controls, -exact @ K.T, atol=1e-9)
    np.testing.assert_allclose(flight.disturbances, exact @ L.T, atol=1e-10)


def test_flight_that_leaves_every_bound_ends_in_one_line(monkeypatch: pytest.MonkeyPatch) -> None:
    game = Game([[1.0]], [[1.0]], [[1.0]], [[1.0]], [[1.0]], 1.0)

    def still(_: float, z: np.ndarray) -> np.ndarray:
        return 0.0 * z

    with pytest.raises(NoSolutionError, match=r"leaves every bound near t = 23\d"):
        simulate(game, still, still, np.array([1.0]), np.array([0.0, 1000.0]))
    failure = type("Result", (), {"success": False, "t": np.array([0.0, 3.0]), "message": "no more"})
    monkeypatch.setattr("scipy.integrate.solve_ivp", lambda *_, **__: failure)
    with pytest.raises(NoSolutionError, match=r"could not be integrated beyond t = 3 s: no more"):
        simulate(game, still, still, np.array([1.0]), np.array([0.0, 5.0]))


# Saddle point ---------------------------------------------------------------------------------------------------


def test_each_player_loses_to_second_order(game: Game) -> None:
    checks = {check.name: check for check in saddle_checks(game, solve_game(game).P, INITIAL, seed=5)}
    # The larger change lies between CHANGE / 4 and CHANGE, the smaller is RATIO² below.
    for player in ("control", "disturbance"):
        assert CHANGE / 5.0 < checks[f"saddle_{player}_loses"].value * RATIO**2 < 1.1 * CHANGE
    assert checks["saddle_control_slope_error"].value < 0.02
    assert checks["saddle_disturbance_slope_error"].value < 0.02


def test_one_percent_off_is_no_saddle_point(first: tuple[Game, np.ndarray]) -> None:
    game, P = first
    failed = _failed(saddle_checks(game, 1.01 * P, INITIAL, seed=0))
    assert "saddle_control_slope_error" in failed
    assert "saddle_control_loses" in failed


def test_lqr_value_is_no_saddle_point_of_a_hard_game() -> None:
    """Near the smallest delta the disturbance gains by leaving the policy that the LQR value gives it."""
    game = game_models()[MODELS[0]].with_delta(120.0)
    P = solve_game(game.with_delta(math.inf)).P
    failed = _failed(saddle_checks(game, P, INITIAL, seed=0))
    assert "saddle_disturbance_slope_error" in failed


def test_a_flight_that_costs_nothing_is_refused(first: tuple[Game, np.ndarray]) -> None:
    game, P = first
    with pytest.raises(BadInputError, match="costs nothing; choose another initial state"):
        saddle_checks(game, P, np.zeros(6), seed=0)


def test_a_player_who_does_not_matter_cannot_lose() -> None:
    """The disturbance does not reach the state: its own price is all that a deviation brings."""
    game = Game([[-1.0]], [[1.0]], [[0.0]], [[1.0]], [[1.0]], 3.0)
    assert not _failed(saddle_checks(game, solve_game(game).P, np.array([2.0]), seed=0))


# L2 gain --------------------------------------------------------------------------------------------------------


def test_gain_of_the_game_policy_is_below_delta_by_both_methods(game: Game) -> None:
    K = solve_game(game).K
    gain, swept = bounded_real_gain(game, K), swept_gain(game, K)
    assert gain < game.delta
    assert swept.gain == pytest.approx(gain, rel=1e-8)
    assert swept.gain <= gain * (1.0 + 1e-12)
    assert gain_is_below(game, K, game.delta)
    assert not gain_is_below(game, K, gain * (1.0 - 1e-8))


def test_gain_agrees_with_python_control(game: Game) -> None:
    K = solve_game(game).K
    output = np.vstack([np.sqrt(game.Q), np.sqrt(game.R) @ K])  # Q and R are diagonal
    inputs = np.hstack([game.E, np.zeros((6, 5))])  # python-control 0.10 takes square systems only
    system = control.ss(game.A - game.B @ K, inputs, output, 0.0)
    assert bounded_real_gain(game, K) == pytest.approx(control.system_norm(system, "inf", tol=1e-9), rel=1e-7)


def test_gain_of_a_first_order_loop_in_closed_form() -> None:
    game = Game([[-1.0]], [[2.0]], [[3.0]], [[4.0]], [[5.0]], 10.0)
    exact = 3.0 * math.sqrt(4.0 + 5.0 * 0.25) / 2.0  # u = -z/2
    K = np.array([[0.5]])
    assert bounded_real_gain(game, K) == pytest.approx(exact, rel=2e-9)
    assert swept_gain(game, K) == SweptGain(pytest.approx(exact, rel=1e-12), 0.0)


def test_gain_of_an_unstable_loop_is_infinite(first: tuple[Game, np.ndarray]) -> None:
    game, P = first
    K = -game.gain(P)
    assert bounded_real_gain(game, K) == swept_gain(game, K).gain == math.inf
    assert not gain_is_below(game, K, 1e12)
    (check,) = gain_checks(game, K)
    assert not check.ok
    assert "not Hurwitz" in check.reason


def test_gain_without_disturbance_or_cost_is_zero() -> None:
    still = Game([[-1.0]], [[1.0]], [[0.0]], [[1.0]], [[1.0]], 1.0)
    hidden = Game(np.diag([-1.0, -2.0]), [[1.0], [0.0]], [[0.0], [1.0]], np.diag([1.0, 0.0]), [[1.0]], 1.0)
    for game, K in ((still, np.zeros((1, 1))), (hidden, np.zeros((1, 2)))):
        assert bounded_real_gain(game, K) == 0.0
        assert not _failed(gain_checks(game, K))


def test_a_weak_policy_has_too_much_gain(first: tuple[Game, np.ndarray]) -> None:
    game, P = first
    checks = gain_checks(game, 0.01 * game.gain(P))
    assert _failed(checks) == {"l2_gain"}
    assert "is not below delta = 200" in checks[0].reason


def test_a_sweep_that_misses_the_peak_is_noticed(
    first: tuple[Game, np.ndarray], monkeypatch: pytest.MonkeyPatch
) -> None:
    game, P = first
    monkeypatch.setattr("verification.riccati.l2_gain.swept_gain", lambda game, K: SweptGain(100.0, 0.1))
    assert _failed(gain_checks(game, game.gain(P))) == {"l2_gain_methods_agree"}


def test_the_smallest_delta_is_a_bound_on_the_gain() -> None:
    """K attains its own gain, so delta_min cannot be above it; and the game policy stays below its delta."""
    rng, tried = np.random.default_rng(6), 0
    while tried < 15:
        game = random_game(rng, scaled=False)
        if not has_value(game):
            continue
        gain = bounded_real_gain(game, solve_game(game).K)
        assert minimum_delta(game).refused < gain < game.delta
        tried += 1


# Margins --------------------------------------------------------------------------------------------------------


def test_margins_of_lqr_are_the_textbook_ones(game: Game) -> None:
    """|1 + L_i| >= 1 for each loop of an LQR with diagonal R: gain (1/2, inf), phase 60 degrees."""
    K = solve_game(game.with_delta(math.inf)).K
    for margin in loop_margins(game, K):
        assert margin.gain_low <= 0.5
        assert margin.gain_high == math.inf
        assert margin.phase >= 60.0 - 1e-9


def test_loop_margins_are_where_the_loop_loses_stability(game: Game) -> None:
    K = solve_game(game).K
    for i, margin in enumerate(loop_margins(game, K)):
        for factor, stable in (
            (margin.gain_low * 1.001, True),
            (margin.gain_low * 0.999, margin.gain_low == 0.0),
            (min(margin.gain_high * 0.999, 1e3), True),
        ):
            assert (_abscissa(game, K, np.eye(5)[i] * (factor - 1.0) + 1.0) < 0.0) == stable
        if math.isfinite(margin.phase):
            late, early = (np.exp(-1j * np.radians(margin.phase * part)) for part in (1.001, 0.999))
            assert _abscissa(game, K, np.eye(5)[i] * (early - 1.0) + 1.0) < 0.0
            worst = max(_abscissa(game, K, np.eye(5)[i] * (f - 1.0) + 1.0) for f in (late, late.conjugate()))
            assert worst > 0.0


def test_single_loop_disk_margin_is_that_of_python_control() -> None:
    game = Game([[0.0, 1.0], [0.0, -1.0]], [[0.0], [1.0]], np.eye(2), np.eye(2), [[1.0]], 10.0)
    K = np.array([[4.0, 0.5]])
    loop = control.ss(game.A, game.B, K, 0.0)
    alpha, gain_db, phase = control.disk_margins(loop, np.geomspace(1e-2, 1e3, 20001))
    one, (each,) = disk_margin(game, K), loop_margins(game, K)
    assert one.disk == pytest.approx(alpha, rel=1e-3)
    assert each.disk == pytest.approx(alpha, rel=1e-3)
    assert 20.0 * math.log10(one.gain) == pytest.approx(gain_db, rel=1e-3)
    assert one.phase == pytest.approx(phase, rel=1e-3)


def test_margin_of_a_double_integrator_in_closed_form() -> None:
    """L = 1.5 (s + 1)/s²: stable for every gain above zero, phase margin from |L| = 1."""
    game = Game([[0.0, 1.0], [0.0, 0.0]], [[0.0], [1.0]], np.eye(2), np.eye(2), [[1.0]], 10.0)
    (margin,) = loop_margins(game, np.array([[1.5, 1.5]]))
    omega = math.sqrt((2.25 + math.sqrt(2.25**2 + 9.0)) / 2.0)  # ω⁴ = 2.25 (1 + ω²)
    assert margin.phase == pytest.approx(math.degrees(math.atan(omega)), rel=1e-9)
    assert margin.gain_low == 0.0
    assert margin.gain_high == math.inf


def test_every_factor_within_the_disk_leaves_the_loop_stable(game: Game) -> None:
    K = solve_game(game).K
    alpha = disk_margin(game, K).disk
    rng = np.random.default_rng(7)
    for _ in range(300):
        disk = alpha * 0.999 * np.exp(2j * np.pi * rng.random(5)) * rng.choice([1.0, 0.9], 5)
        assert _abscissa(game, K, (2.0 + disk) / (2.0 - disk)) < 0.0


def test_disk_margin_is_tight(game: Game) -> None:
    """At its frequency, phases of the five factors exist that take the loop to the edge just outside the disk."""
    K, margin = solve_game(game).K, disk_margin(game, solve_game(game).K)
    closed = 1j * margin.frequency * np.eye(6) - game.A + game.B @ K
    M = 0.5 * np.eye(5) - K @ np.linalg.solve(closed, game.B)

    def radius(phases: np.ndarray) -> float:
        return -float(np.abs(np.linalg.eigvals(M * np.exp(1j * phases))).max())

    starts = np.random.default_rng(2).uniform(-np.pi, np.pi, (8, 5))
    largest = max(-minimize(radius, start, method="Nelder-Mead", options={"maxiter": 3000}).fun for start in starts)
    assert largest <= 1.0 / margin.disk * (1.0 + 1e-9)
    assert largest >= 0.97 / margin.disk


def test_disk_margin_of_a_loop_with_a_flat_top_is_that_of_its_peak(game: Game) -> None:
    """The policy of other weights: S - I/2 is as large over five decades of low frequencies before D is optimised."""
    K = solve_game(replace(game, Q=1000.0 * np.eye(6), delta=math.inf)).K
    learned = game.gain(solve_continuous_lyapunov((game.A - game.B @ K).T, -(game.Q + K.T @ game.R @ K)))
    margin = disk_margin(game, learned)
    closed = 1j * margin.frequency * np.eye(6) - game.A + game.B @ learned
    assert structured_bound(0.5 * np.eye(5) - learned @ np.linalg.solve(closed, game.B)) == pytest.approx(
        1.0 / margin.disk, rel=1e-6
    )


def test_structured_bound_is_exact_for_two_factors() -> None:
    rng = np.random.default_rng(9)
    for _ in range(5):
        M = rng.standard_normal((2, 2)) + 1j * rng.standard_normal((2, 2))
        phases = np.linspace(-np.pi, np.pi, 2001)
        exact = max(np.abs(np.linalg.eigvals(M @ np.diag([1.0, np.exp(1j * phase)]))).max() for phase in phases)
        assert structured_bound(M) == pytest.approx(exact, rel=1e-4)
        assert structured_bound(M) >= exact * (1.0 - 1e-9)
    assert structured_bound(np.array([[3.0 - 4.0j]])) == 5.0


def test_weak_gain_has_smaller_margins_and_unstable_loops_none(game: Game) -> None:
    K = solve_game(game).K
    assert disk_margin(game, 0.05 * K).disk < disk_margin(game, K).disk
    for margins in (loop_margins, disk_margin):
        with pytest.raises(NoSolutionError, match="an unstable loop has no margins"):
            margins(game, -K)


def _abscissa(game: Game, K: np.ndarray, factors: np.ndarray) -> float:
    return float(np.linalg.eigvals(game.A - (game.B * factors) @ K).real.max())
