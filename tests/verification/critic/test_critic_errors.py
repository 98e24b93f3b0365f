"""No error hides: beyond the quadratic weights, in directions without inputs, or behind larger entries."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
from game_samples import failed_names, game_models

from controller import Game, basis
from controller.riccati.balancing import balanced_units
from hfa_model import INPUTS, LINEAR_STATES
from verification import check_critic, from_value, from_weights, solve_game
from verification.critic.candidate import Candidate
from verification.critic.critic_check import LIMIT
from verification.critic.critic_errors import (
    ORDINARY_DEVIATIONS,
    box_errors,
    entry_error,
    matrix_errors,
    ordinary_box,
)

GAME = game_models()["published-15"]
EXACT = solve_game(GAME)
BOX = np.array(ORDINARY_DEVIATIONS)


def failed(candidate: Candidate, game: Game = GAME) -> set[str]:
    return failed_names(check_critic(game, candidate).checks)


def over_the_box(candidate: Candidate, game: Game = GAME) -> dict[str, float]:
    exact = EXACT if game is GAME else solve_game(game)
    return {check.name: check.value for check in box_errors(game, candidate, exact, BOX, LIMIT)}


@pytest.mark.parametrize("name", ["quadratic+linear", "quadratic+quartic", "paper"])
def test_every_weight_beyond_the_quadratic_ones_is_seen(name: str) -> None:
    """B has zero rows for pitch and dihedral: a weight of the dihedral changes neither P, nor K, nor the policy."""
    functions = basis(name, 6)
    for place in range(21, functions.size):
        weights = functions.weights(EXACT.P)
        at_corner = functions.scaling(BOX)
        weights[place] = 1e-5 * np.abs(weights * at_corner).sum() / at_corner[place]
        found = over_the_box(from_weights(GAME, weights, functions))
        assert found["value_rel_error"] > LIMIT, place
    weights = functions.weights(EXACT.P)
    weights[24 if name == "paper" else 25] = 1e12
    unseen = from_weights(GAME, weights, functions)
    assert over_the_box(unseen)["policy_rel_error"] <= 1e-12
    assert failed(unseen) >= {"gradient_rel_error", "disturbance_rel_error"}


def test_a_wrong_entry_too_small_for_the_norms_is_refused() -> None:
    P = EXACT.P.copy()
    P[0, 4] = P[4, 0] = P[0, 4] * (1.0 + 1e-5)
    assert failed(from_value(GAME, P)) >= {"P_entry_error"}
    assert not {"P_rel_error", "P_balanced_error", "riccati_residual"} & failed(from_value(GAME, P))


def test_every_entry_of_the_value_and_of_the_gain_is_seen() -> None:
    for name, exact in (("P", EXACT.P), ("K", EXACT.K)):
        for i, j in np.ndindex(exact.shape):
            wrong = exact.copy()
            wrong[i, j] *= 1.0 + 1e-5
            found = {check.name: check for check in matrix_errors(GAME, name, wrong, exact, LIMIT)}
            assert not found[f"{name}_entry_error"].ok, (i, j)
        shares = [check.value for check in matrix_errors(GAME, name, 3.0 * exact, exact, LIMIT)]
        assert shares == pytest.approx([2.0] * 3)


@pytest.mark.parametrize("game", [GAME, replace(GAME, E=GAME.E[:, :2])], ids=["E = I", "two disturbances"])
@pytest.mark.parametrize("name", ["quadratic+linear", "quadratic+quartic", "paper"])
def test_the_bounds_hold_at_every_state_of_the_box(name: str, game: Game) -> None:
    """V, its slopes and both policies, sampled in the box: no error exceeds its bound."""
    functions, rng, solution = basis(name, 6), np.random.default_rng(0), solve_game(game)
    exact = functions.weights(solution.P)
    weights = exact * (1.0 + 0.1 * rng.standard_normal(exact.shape)) + rng.standard_normal(exact.shape)
    found = over_the_box(from_weights(game, weights, functions), game)
    z = rng.choice([-1.0, 1.0, 0.3], size=(2000, 6)) * BOX
    change = weights - exact
    V, slopes = functions.psi(z) @ change, np.swapaxes(functions.gradient(z), -1, -2) @ change
    sizes = np.abs(exact) * functions.scaling(BOX)
    assert np.abs(V).max() <= found["value_rel_error"] * sizes.sum()
    assert np.all(np.abs(slopes * BOX).max(axis=0) <= found["gradient_rel_error"] * (sizes @ functions.exponents))
    u = -0.5 * slopes @ game.R_inverse_B_transposed.T
    d = 0.5 * slopes @ game.E / game.delta**2
    assert np.all(np.abs(u).max(axis=0) <= found["policy_rel_error"] * (np.abs(solution.K) @ BOX))
    largest = np.abs(solution.disturbance_gain) @ BOX
    assert np.all(np.abs(d).max(axis=0) <= found["disturbance_rel_error"] * largest)


def test_an_entry_is_held_against_its_own_size() -> None:
    exact = np.array([1.0, 1e-3, 0.0])
    assert entry_error(np.array([0.0, 1e-6, 0.0]), exact) == pytest.approx(1e-3)
    assert entry_error(np.array([0.0, 0.0, 1e-11]), exact) == pytest.approx(1e-6)
    assert entry_error(np.array([0.0, np.nan, 0.0]), exact) == math.inf
    assert entry_error(np.zeros(3), np.zeros(3)) == 0.0
    assert entry_error(np.ones(3), np.zeros(3)) == math.inf


# The box: the aircraft's where the plant is named so, else a convention that is stated.

A6 = -np.diag(np.arange(1.0, 7.0))
NAMED_GAME = Game(A6, np.ones((6, 5)), np.eye(6), np.diag([1.0, 1e6, 1, 1, 1, 1]), np.eye(5), 5.0)
SMALL = Game(-np.eye(2), np.eye(2), np.eye(2), np.diag([1.0, 1e6]), np.eye(2), 5.0)
FEET, METRES = (f"{unit}/s" for unit in ("ft", "m"))
REST = ("rad", "rad", "rad/s", "rad", "rad/s")


@pytest.mark.parametrize(
    ("states", "inputs", "units", "speed"),
    [
        ((), (), (), 7.0),
        (LINEAR_STATES, INPUTS, (), 7.0),
        (LINEAR_STATES, INPUTS, (FEET, *REST), 7.0),
        (LINEAR_STATES, INPUTS, (METRES, *REST), 7.0 * 0.3048),
        (LINEAR_STATES, INPUTS, ("km/h", *REST), None),
        (tuple("abcdef"), INPUTS, (), None),
        (LINEAR_STATES[::-1], INPUTS, (), None),
        (LINEAR_STATES, tuple("abcde"), (), None),
    ],
)
def test_names_and_units_decide(
    states: tuple[str, ...], inputs: tuple[str, ...], units: tuple[str, ...], speed: float | None
) -> None:
    box = ordinary_box(NAMED_GAME, states, inputs, units)
    if speed is None:
        assert "a convention" in box.about
        assert box.half_widths.tolist() == balanced_units(NAMED_GAME).tolist()
    else:
        assert box.half_widths.tolist() == [speed, *ORDINARY_DEVIATIONS[1:]]
        assert box.about.startswith("ordinary deviations of the aircraft")
    assert ordinary_box(SMALL).half_widths.tolist() == balanced_units(SMALL).tolist()
