"""Recorded samples: exact data, well-conditioned selection, refusal of poor data, and residuals."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from learning_samples import PUBLISHED, QUADRATIC, build, published, stable_game
from tolerances import SAME_FORMULA

from controller import Stack, basis, random_pool, record
from controller.game.basis import BASES
from controller.learning.bellman_equations import GAME, LQ, PartialGame
from controller.learning.recording import choose, excitation, natural_spread
from hfa import BadInputError


def test_random_states_fill_the_box_reproducibly() -> None:
    """Random states fill the given box and are reproduced by the seed. The drifts are A z."""
    game = stable_game()
    pool = random_pool(game, 300, seed=2, half_widths=np.array([2.0, 0.1]))
    assert np.all(np.abs(pool.states) <= [2.0, 0.1])
    assert np.all(np.abs(pool.states).max(axis=0) > [1.9, 0.095])
    assert np.array_equal(pool.states, random_pool(game, 300, 2, np.array([2.0, 0.1])).states)
    assert not np.array_equal(pool.states, random_pool(game, 300, 3, np.array([2.0, 0.1])).states)
    assert pool.drifts == pytest.approx(pool.states @ game.A.T, rel=1e-13)


def test_a_list_that_contains_itself_is_refused() -> None:
    """A list that contains itself is refused as count, seed or box."""
    endless: list[Any] = []
    endless.append(endless)
    for count, seed, box in ((endless, 0, None), (9, endless, None), (9, 0, endless)):
        with pytest.raises(BadInputError, match=r"give a whole|rows of real numbers"):
            random_pool(stable_game(), count, seed, box)


def test_natural_spread_solves_its_equation() -> None:
    """The natural spread equals the integral of the covariance over time, computed in small
    steps.
    """
    game = stable_game()
    beta = 0.1 * np.abs(np.linalg.eigvals(game.A)).max()
    shifted = game.A - beta * np.eye(2)
    push = game.S_control + game.S_disturbance / game.delta**2
    times = np.linspace(0.0, 60.0, 12_001)
    step = (
        np.eye(2)
        + (times[1] - times[0]) * shifted
        + 0.5 * (times[1] - times[0]) ** 2 * shifted @ shifted
    )
    X = np.zeros((2, 2))
    current = np.eye(2)
    for _ in times:
        X = X + current @ push @ current.T * (times[1] - times[0])
        current = step @ current
    assert natural_spread(game) == pytest.approx(np.sqrt(np.diag(X)), rel=5e-3)


@pytest.mark.parametrize("name", PUBLISHED)
@pytest.mark.parametrize("functions", ["quadratic", "paper"])
def test_rounding_does_not_change_the_chosen_samples(name: str, functions: str) -> None:
    """The same samples are chosen from a pool whose states are changed by rounding.

    The states of a pool differ in this way between processors.
    """
    game, _ = published(name)
    pool = random_pool(game, 500, seed=0)
    rng = np.random.default_rng(1)
    chosen = choose(pool, basis(functions, 6), 50)
    for _ in range(3):
        rounded = Stack(
            pool.states * (1.0 + 1e-15 * rng.normal(size=pool.states.shape)), pool.drifts
        )
        assert choose(rounded, basis(functions, 6), 50).states == pytest.approx(
            chosen.states, rel=SAME_FORMULA
        )


def test_excitation_measures_equal_hand_computed_values() -> None:
    """Rank, smallest eigenvalue and condition number of three samples equal hand-computed
    values."""
    regressors = np.array([[3.0, 0.0], [0.0, 0.5], [0.0, 0.5]])
    richness = excitation(regressors, samples=np.array([[2.0, 0.0], [0.0, 1.0], [0.0, 7.0]]))
    assert (richness.rank, richness.size, richness.samples) == (2, 2, 3)
    assert richness.smallest_eigenvalue == pytest.approx(2.0 * 0.25 / 1.25)
    assert richness.condition == pytest.approx(np.sqrt(2.0))
    assert 0.0 < richness.rounding < 1e-28


def test_malformed_samples_are_refused() -> None:
    """Samples with wrong shapes, nan, or a state that is always 0 are refused by name.

    A box without width is refused too.
    """
    game = stable_game()
    with pytest.raises(BadInputError, match=r"give \(N_h, n\)"):
        Stack(np.zeros((4, 2)), np.zeros((4, 3)))
    with pytest.raises(BadInputError, match=r"stack drifts\[0\]\[0\] is nan; give finite entries"):
        Stack(np.zeros((1, 2)), np.array([[np.nan, 0.0]]))
    with pytest.raises(BadInputError, match=r"give \(N, 2\)"):
        record(game, np.zeros((4, 3)))
    with pytest.raises(BadInputError, match=r"half-widths are \[1.0, 0.0\]; give 2 positive"):
        random_pool(game, 10, 0, np.array([1.0, 0.0]))
    with pytest.raises(BadInputError, match="state 2 is 0 in every recorded sample"):
        record(game, np.array([[1.0, 0.0]])).channel_scales()


# Residuals: derivative, values along a step, and relation to the Riccati equation.


@pytest.mark.parametrize("name", BASES)
def test_regressor_is_the_derivative_of_the_residual(name: str) -> None:
    """For a quadratic value, the regressor σ_j is the derivative of the residual e_j by the
    weights.

    The remainder of the linear approximation is of second order. With a wrong regressor, the
    remainder is of a lower order.
    """
    game, exact = published(PUBLISHED[0])
    equations = build(game, name)
    weights = equations.scaled(equations.basis.weights(1.5 * exact.P))
    direction = np.random.default_rng(1).normal(size=equations.basis.size) * np.abs(weights).max()
    for problem in (GAME, LQ, PartialGame(0.7, 0.3)):
        residual = equations.at(weights, problem)
        moved = [
            equations.at(weights + h * direction, problem).residuals - residual.residuals
            for h in (1e-5, 1e-6)
        ]
        for error, lowest, highest in (
            (0.0, 1.99, 2.01),
            (0.1 * np.abs(residual.regressors).max(), 0.5, 1.9),
        ):
            slopes = (residual.regressors + error) @ direction
            coarse, fine = (
                np.linalg.norm(change - h * slopes)
                for h, change in zip((1e-5, 1e-6), moved, strict=True)
            )
            assert lowest < np.log10(coarse / fine) < highest


@pytest.mark.parametrize("name", BASES)
def test_residual_along_a_step_is_an_exact_parabola(name: str) -> None:
    """The Bellman residual predicted along a step of the weights equals the residual computed anew.

    The prediction is a parabola in the step size.
    """
    game, _ = published(PUBLISHED[1])
    equations = build(game, name)
    rng = np.random.default_rng(2)
    weights, step = rng.normal(size=(2, equations.basis.size)) * 100.0
    problem = PartialGame(0.4, 0.6)
    residual = equations.at(weights, problem)
    linear, quadratic = equations.along_step(weights, step, residual, problem)
    for f in (0.3, 1.0, -2.0):
        exact = equations.at(weights - f * step, problem).residuals
        assert np.linalg.norm(
            residual.residuals + f * linear + f * f * quadratic - exact
        ) < 1e-12 * np.linalg.norm(exact)


def test_bellman_residuals_equal_the_discounted_riccati_residual() -> None:
    """Each Bellman residual equals z'R z, for the residual R of the discounted Riccati equation."""
    game, exact = published(PUBLISHED[0])
    equations = build(game)
    P = 0.7 * exact.P
    problem = PartialGame(0.3, 0.4)
    S = game.S_control - 0.4 * game.S_disturbance / game.delta**2
    A = game.A - 0.3 * np.eye(6)
    residual = A.T @ P + P @ A + game.Q - P @ S @ P
    z = equations.states * equations.scales
    found = equations.at(equations.scaled(QUADRATIC.weights(P)), problem).residuals
    assert found == pytest.approx(np.sum((z @ residual) * z, axis=1), rel=1e-9)
