"""What a pair of policies costs: by a Lyapunov equation, and flown."""

from __future__ import annotations

import numpy as np
import pytest
from game_samples import INITIAL, failed_names
from linear_flight import simulate

from controller import Game
from controller.analysis.cost import cost_checks, cost_matrix, saddle_checks, simulated_cost
from hfa_support import NoSolutionError
from verification import solve_game


def test_cost_is_exact_far_beyond_its_limit(game: Game) -> None:
    for initial in (INITIAL, np.array([-3.0, 0.1, -0.2, 0.3, 0.05, -0.4])):
        lyapunov, simulated = cost_checks(game, solve_game(game).P, initial)
        assert lyapunov.value < 1e-12
        assert simulated.value < 1e-9


def test_cost_of_a_value_that_is_off_by_a_millionth_is_noticed(first: tuple[Game, np.ndarray]) -> None:
    game, P = first
    assert failed_names(cost_checks(game, P * (1.0 + 1e-6), INITIAL)) == {"cost_lyapunov", "cost_simulated"}


def test_policies_that_do_not_come_to_rest_have_no_cost(first: tuple[Game, np.ndarray]) -> None:
    game, P = first
    checks = cost_checks(game, -P, INITIAL)
    assert failed_names(checks) == {"cost_lyapunov", "cost_simulated"}
    assert "do not bring the state to rest" in checks[0].reason
    for cost in (cost_matrix, lambda *policies: simulated_cost(*policies, INITIAL)):
        with pytest.raises(NoSolutionError, match=r"abscissa \+.* cost of these policies is infinite"):
            cost(game, -game.gain(P), game.disturbance_gain(P))
    assert failed_names(saddle_checks(game, -P, INITIAL)) == {"saddle_finite_cost"}


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
