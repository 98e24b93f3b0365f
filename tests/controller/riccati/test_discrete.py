"""The discounted game in discrete time: against value iteration, closed forms and continuous time;
refused input."""

import numpy as np
import pytest

from controller import Game
from controller.riccati.discrete import discounted_checks, sampled
from hfa_support import BadInputError, NoSolutionError
from verification import solve_discounted, solve_game


def _game(seed: int = 0, n: int = 4, delta: float = 20.0) -> Game:
    rng = np.random.default_rng(seed)
    A, B, E = (rng.standard_normal((n, size)) for size in (n, 2, 2))
    return Game(0.6 * A, B, E, np.eye(n), np.diag([1.0, 3.0]), delta)


@pytest.mark.parametrize(
    ("seed", "discount", "delta"), [(0, 0.9, 20.0), (1, 0.99, 40.0), (2, 1.0, np.inf)]
)
def test_the_value_is_that_of_value_iteration_one_step_at_a_time(seed, discount, delta):
    game = _game(seed, delta=delta)
    found = solve_discounted(game, discount)
    G = np.hstack([game.B, game.E / delta])
    W = np.diag([1.0, 3.0, -1.0, -1.0])
    P = np.zeros((4, 4))
    for _ in range(3000):
        P = (P + P.T) / 2.0
        crossed = discount * G.T @ P @ game.A
        P = (
            game.Q
            + discount * game.A.T @ P @ game.A
            - crossed.T @ np.linalg.solve(W + discount * G.T @ P @ G, crossed)
        )
    assert np.abs(found.P - P).max() <= 1e-12 * np.abs(P).max()
    assert found.certificate.ok


def test_one_state_without_disturbance_is_the_root_of_a_quadratic():
    a, b, q, r, discount = 1.02, 0.01, 2.0, 0.5, 0.98
    found = solve_discounted(Game([[a]], [[b]], [[1.0]], [[q]], [[r]], np.inf), discount)
    root = np.roots([discount * b * b, r - discount * (a * a * r + b * b * q), -q * r]).max()
    assert found.P[0, 0] == pytest.approx(root, rel=1e-13)
    assert found.K[0, 0] == pytest.approx(
        discount * a * b * root / (r + discount * b * b * root), rel=1e-13
    )
    assert found.disturbance_gain[0, 0] == 0.0


def test_fast_sampling_without_discount_is_continuous_time():
    game = _game(3)
    exact = solve_game(game)
    off = [np.abs(solve_discounted(game, 1.0, dt).P - exact.P).max() for dt in (2e-3, 1e-3)]
    assert off[1] < 0.01 * np.abs(exact.P).max()
    assert off[0] / off[1] == pytest.approx(2.0, rel=0.05)


def test_sampling_integrates_the_held_input_and_scales_the_weights():
    step = sampled(
        Game([[0.0, 1.0], [0.0, 0.0]], [[0.0], [1.0]], np.eye(2), np.eye(2), [[2.0]], 3.0), 0.5
    )
    assert step.A.tolist() == [[1.0, 0.5], [0.0, 1.0]]
    assert step.B.ravel() == pytest.approx([0.125, 0.5], rel=1e-15)
    assert (step.Q[0, 0], step.R[0, 0], step.delta) == (0.5, 1.0, pytest.approx(3.0 * np.sqrt(0.5)))


def test_units_of_the_states_do_not_matter():
    game, units = _game(4), np.array([1e-6, 1.0, 1e5, 30.0])
    other = Game(
        game.A * units / units[:, None],
        game.B / units[:, None],
        game.E / units[:, None],
        *(np.diag(units**2), game.R, game.delta),
    )
    P, turned = (
        solve_discounted(game, 0.95).P,
        solve_discounted(other, 0.95).P / np.outer(units, units),
    )
    assert np.abs(P - turned).max() <= 1e-12 * np.abs(P).max()


def test_a_wrong_value_fails():
    game = _game(5)
    P = solve_discounted(game, 1.0).P
    assert all(check.ok for check in discounted_checks(game, P))
    for wrong in (
        P * (1.0 + 1e-9),
        P + 1e-9 * np.eye(4),
        solve_discounted(game, 0.999999999).P,
        -P,
    ):
        assert not all(check.ok for check in discounted_checks(game, wrong))


def test_what_has_no_value_is_refused_by_name():
    with pytest.raises(NoSolutionError, match="no certified value of the discounted game"):
        solve_discounted(_game(6, delta=0.5), 0.99)
    unreached = Game([[1.2]], [[0.0]], [[1.0]], [[1.0]], [[1.0]], np.inf)
    assert solve_discounted(unreached, 0.6).P[0, 0] == pytest.approx(
        1.0 / (1.0 - 0.6 * 1.44), rel=1e-13
    )
    with pytest.raises(NoSolutionError):
        solve_discounted(unreached, 0.9)
    for discount, dt, name in (
        (0.0, None, "discount"),
        (1.1, None, "discount"),
        (0.9, -1.0, "dt"),
        (0.9, "1", "dt"),
    ):
        with pytest.raises(BadInputError, match=name):
            solve_discounted(unreached, discount, dt)
