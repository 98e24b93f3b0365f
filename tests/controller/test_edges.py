"""Arguments at the edge of what functions accept, and functions without a file of their own."""

from __future__ import annotations

import math
import re
from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from game_files import SMALL, stored
from known_models import model_at

import hfa
from controller import basis
from controller.critic.critic import from_parts, from_q_function, polynomial_policy
from controller.critic.critic_file import critic_in
from controller.critic.reading import Reading
from controller.game.basis import monomials
from controller.game.weights import cost_text, nominal_weights
from controller.game.zero_sum import game_report
from controller.hfa_game import paper_game
from controller.reference import feedforward
from controller.riccati.loop_margins import loop_margins, margins
from hfa import BadInputError, Game, solve
from hfa_aircraft.names import PlantNames
from hfa_aircraft.waveform import Waveform
from hfa_model import LINEAR_STATES, published_models
from tests.support.steps_of import in_steps

pytestmark = pytest.mark.usefixtures("folder")
GAME = Game(**SMALL)
STEP = in_steps(replace(GAME, A=0.2 * GAME.A))
CROSSED = replace(GAME, N=[[0.1], [0.2]])


def of_file(**content: Any) -> Any:
    return critic_in(stored("critic.npz", **content), GAME, content.pop("reading", Reading()))


REFUSED: dict[str, tuple[Callable[[], Any], str]] = {
    "no critic": (lambda: from_parts(GAME, {}), "no critic is given; give W, P or K"),
    "monomials": (
        lambda: polynomial_policy(np.ones((1, 4)), np.ones(2)),
        "policy_weights is 1 x 4; give a column for each monomial of 2 states",
    ),
    "policy rows": (
        lambda: of_file(P=np.eye(2), policy_weights=np.ones((2, 2))),
        "policy_weights has 2 rows; give one for each of the 1 inputs",
    ),
    "functions without W": (
        lambda: critic_in(stored("P.npz", P=np.eye(2)), GAME, Reading(basis="x1**2, x2**2")),
        "--basis lists functions, but the file contains no W",
    ),
    "functions over time": (
        lambda: critic_in(
            stored("run.npz", W=np.ones((2, 3)), time=[0.0, 1.0]), GAME, Reading(basis="x1**2, x2")
        ),
        "W is a history over time; give the name of a basis",
    ),
    "no states": (lambda: basis("quadratic", 0), "a basis of 0 states does not exist"),
    "paper's basis": (lambda: basis("paper", 4), "basis 'paper' requires 6 states, not 4"),
    "shape of H": (
        lambda: from_q_function(STEP, np.eye(5)),
        "H is 5 x 5; give 3 x 3 over (x, u) or 4 x 4 over (x, u, w)",
    ),
    "skew H": (
        lambda: from_q_function(STEP, np.eye(3) + np.triu(np.ones((3, 3)), 1)),
        "H is not symmetric (row 1, column 2); give (H + H')/2",
    ),
    "singular H": (
        lambda: from_q_function(STEP, np.diag([1.0, 1.0, 0.0])),
        "the block of H over the inputs is singular",
    ),
}  # fmt: skip


@pytest.mark.parametrize("case", REFUSED)
def test_an_unsuitable_argument_is_refused_in_one_line(case: str) -> None:
    call, said = REFUSED[case]
    with pytest.raises(BadInputError, match=re.escape(said)) as refusal:
        call()
    assert "\n" not in str(refusal.value)


def test_margins_of_a_linear_model_are_those_of_its_inputs() -> None:
    """`margins` names the inputs in their order; the gain of the game gives the same margins."""
    linear = model_at(15.0)
    game = hfa.paper.published_game(linear)
    K = solve(game).K
    found = margins(linear, K)
    assert tuple(found) == tuple(linear.inputs)
    assert tuple(found.values()) == loop_margins(game, K)


def test_the_feedforward_of_both_players_is_stationary() -> None:
    """d = δ⁻² E's and u_d = -R⁻¹B's, with the costate s of a constant reference."""
    reference = Waveform(np.array([1.0, -0.5]), np.zeros(2), ())
    P = solve(GAME).P
    found = feedforward(GAME, P, reference)
    r = GAME.A @ reference.constant
    s = -np.linalg.solve((GAME.A - GAME.S @ P).T, P @ r)
    assert found.costate.at(3.0) == pytest.approx(s)
    assert found.disturbance.at(3.0) == pytest.approx(GAME.E.T @ s / GAME.delta**2)
    assert found.inputs.at(3.0) == pytest.approx(-np.linalg.solve(GAME.R, GAME.B.T @ s))
    rate = 2.0 * s @ r - s @ GAME.S @ s
    assert found.cost_per_second(2.0) == pytest.approx(rate)


def test_weights_are_shown_with_their_source() -> None:
    """Weights of 1/nominal² are marked, others not; a game shows N if it has one."""
    model = hfa.aircraft()
    names = (*model.linear[:2], "aileron_outer")
    Q, R = nominal_weights(model, names[:2]), nominal_weights(model, names[2:])
    text = cost_text(model, names, Q, 2.0 * R)
    assert text.startswith("Q diag(")
    assert text.count("(default 1/nominal^2)") == 1
    assert text.index("default") < text.index("R diag(")
    assert "N" not in game_report(GAME).data
    assert game_report(CROSSED).data["N"].tolist() == CROSSED.N.tolist()
    assert "cost z'Qz + 2 z'Nu + u'Ru" in game_report(CROSSED).title


def test_the_papers_game_of_a_plant_with_more_states_weighs_its_own() -> None:
    """Further states have no weight and no disturbance, wherever they stand."""
    published = published_models()[0]
    states = (LINEAR_STATES[0], "more", *LINEAR_STATES[1:])
    A = np.insert(np.insert(published.A, 1, 0.0, axis=0), 1, 0.0, axis=1)
    A[1, 1] = -1.0
    B = np.insert(published.B, 1, 0.0, axis=0)
    game = paper_game(A, B, PlantNames(states), None, {})
    usual = hfa.paper.published_game(published.A, published.B)
    kept = [0, 2, 3, 4, 5, 6]
    np.testing.assert_array_equal(game.Q[np.ix_(kept, kept)], usual.Q)
    np.testing.assert_array_equal(game.E[kept], usual.E)
    assert not game.Q[1].any()
    assert not game.E[1].any()


def test_a_value_with_a_policy_of_its_own_keeps_both() -> None:
    """A polynomial policy in a file, in scaled states, beside the value of its weights."""
    weights = np.array([[1.0, -2.0, 0.5, 0.0, 3.0]])
    policy = polynomial_policy(weights, np.array([2.0, 10.0]))
    z = np.array([0.4, -0.3])
    scaled = z * [2.0, 10.0]
    terms = [scaled, [scaled[0] ** 2, scaled[0] * scaled[1], scaled[1] ** 2]]
    expected = weights @ np.concatenate(terms)
    assert np.array(policy(z)).ravel() == pytest.approx(expected)
    assert monomials(2, 2).tolist() == [[2, 0], [1, 1], [0, 2]]
    W = np.array([1.0, 0.2, 3.0])
    critic = from_parts(GAME, {"W": W}, "quadratic", policy)
    assert critic.u(z) == pytest.approx(expected)
    assert critic.value is not None
    assert float(critic.value(z)) == pytest.approx(z @ basis("quadratic", 2).matrix(W) @ z)
    K = np.array([[0.3, 0.7]])
    both = from_parts(GAME, {"W": W, "K": K})
    assert both.u(z) == pytest.approx(-K @ z)
    assert pytest.approx(basis("quadratic", 2).matrix(W)) == both.P
    assert math.isclose(float(both.value(z)), float(critic.value(z)))  # type: ignore[misc]
