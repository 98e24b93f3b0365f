"""Arguments at the edge of what functions accept, and functions without a file of their own."""

from __future__ import annotations

import re
from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from game_files import SMALL, stored
from known_models import model_at

import hfa
from controller import basis, critic_in
from hfa import BadInputError, Game, solve
from hfa.extend import Reading
from hfa_model import LINEAR_STATES
from tests.support.steps_of import in_steps

pytestmark = pytest.mark.usefixtures("folder")
GAME = Game(**SMALL)
STEP = in_steps(replace(GAME, A=0.2 * GAME.A))


def of_file(**content: Any) -> Any:
    return critic_in(stored("critic.npz", **content), GAME, content.pop("reading", Reading()))


def of_steps(H: Any) -> Any:
    return critic_in(stored("H.npz", H=H), STEP)


REFUSED: dict[str, tuple[Callable[[], Any], str]] = {
    "monomials": (
        lambda: of_file(P=np.eye(2), policy_weights=np.ones((1, 4))),
        "give a column for each monomial of 2 states",
    ),
    "policy rows": (
        lambda: of_file(P=np.eye(2), policy_weights=np.ones((2, 2))),
        "give one for each of the 1 inputs",
    ),
    "functions without W": (
        lambda: hfa.read_critic(stored("P.npz", P=np.eye(2)), GAME, basis="x1**2, x2**2"),
        "add W, or give --basis a name",
    ),
    "W over time": (lambda: of_file(W=np.ones((4, 3)), time=range(4)), "the last row"),
    "P over time": (lambda: of_file(P=np.ones((4, 2, 2))), "one for each time; give one"),
    "K over time": (lambda: of_file(K=np.ones((4, 1, 2))), "K has three dimensions"),
    "code in a list of functions": (
        lambda: hfa.read_critic(stored("W.npz", W=[1.0]), GAME, basis="__import__('os')"),
        "is not supported; use x1 to x2",
    ),
    "no states": (lambda: basis("quadratic", 0), "0 states"),
    "paper's basis": (lambda: basis("paper", 4), "requires 6 states, not 4"),
    "shape of H": (lambda: of_steps(np.eye(5)), "give 3 x 3 over (x, u) or 4 x 4 over (x, u, w)"),
    "skew H": (
        lambda: of_steps(np.eye(3) + np.triu(np.ones((3, 3)), 1)),
        "(row 1, column 2); give (H + H')/2",
    ),
    "singular H": (lambda: of_steps(np.diag([1.0, 1.0, 0.0])), "is singular"),
}


@pytest.mark.parametrize("case", REFUSED)
def test_an_unsuitable_argument_is_refused_in_one_line(case: str) -> None:
    call, said = REFUSED[case]
    with pytest.raises(BadInputError, match=re.escape(said)) as refusal:
        call()
    assert "\n" not in str(refusal.value)


def test_the_feedforward_of_both_players_is_stationary() -> None:
    """d = δ⁻² E's and u_d = -R⁻¹B's, with the costate s of a constant reference."""
    linear = hfa.LinearModel.of(GAME.A, GAME.B)
    solution = solve(GAME)
    P = solution.P
    found = hfa.track(linear, solution, {"x1": 1.0, "x2": -0.5}).exact
    r = GAME.A @ [1.0, -0.5]
    s = -np.linalg.solve((GAME.A - GAME.S @ P).T, P @ r)
    assert found.costate.at(3.0) == pytest.approx(s)
    assert found.disturbance.at(3.0) == pytest.approx(GAME.E.T @ s / GAME.delta**2)
    assert found.inputs.at(3.0) == pytest.approx(-np.linalg.solve(GAME.R, GAME.B.T @ s))
    rate = 2.0 * s @ r - s @ GAME.S @ s
    assert found.cost_per_second(2.0) == pytest.approx(rate)


def test_the_papers_game_of_a_plant_with_more_states_weighs_its_own() -> None:
    """Lag states of the unsteady aircraft, here the first, have no weight and no disturbance."""
    unsteady = model_at(15.0, "unsteady")
    lags = [name for name in unsteady.states if name not in LINEAR_STATES]
    game = hfa.paper.published_game(unsteady.select((*lags, *LINEAR_STATES)))
    usual = hfa.paper.published_game(model_at(15.0))
    states = game.names.states
    kept = [states.index(name) for name in LINEAR_STATES]
    others = [place for place in range(len(states)) if place not in kept]
    np.testing.assert_array_equal(game.Q[np.ix_(kept, kept)], usual.Q)
    np.testing.assert_array_equal(game.E[kept], usual.E)
    assert len(others) > 0
    assert not game.Q[others].any()
    assert not game.E[others].any()


def test_a_value_with_a_policy_of_its_own_keeps_both() -> None:
    """A polynomial policy in a file stands beside the value of its weights; so does a gain."""
    weights = np.array([[1.0, -2.0, 0.5, 0.0, 3.0]])
    z = np.array([0.4, -0.3])
    terms = [*z, z[0] ** 2, z[0] * z[1], z[1] ** 2]
    W = np.array([1.0, 0.2, 3.0])
    critic = of_file(W=W, policy_weights=weights)
    assert critic.u(z) == pytest.approx(weights @ terms)
    P = basis("quadratic", 2).matrix(W)
    assert float(critic.value(z)) == pytest.approx(z @ P @ z)
    K = np.array([[0.3, 0.7]])
    both = of_file(W=W, K=K)
    assert both.u(z) == pytest.approx(-K @ z)
    assert pytest.approx(P) == both.P
    assert float(both.value(z)) == pytest.approx(z @ P @ z)
