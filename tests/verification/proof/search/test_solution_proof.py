"""The exact game, proved: against sixty digits, at both sides of delta_min, and against spoiled
critics."""

from __future__ import annotations

from pathlib import Path

import casadi as ca
import numpy as np
import pytest
from known_models import game_at
from proof_cases import ORIGIN, content, family, forge, proved, scalar_game
from reference_riccati import reference_solution

from controller import Game, basis
from controller.critic.critic import from_gain, from_parts
from controller.critic.network import from_network
from controller.riccati.smallest_delta import DeltaMin
from hfa_support import BadInputError, NoSolutionError
from verification import check_certificate, minimum_delta, prove_critic, prove_solution, solve_game
from verification.proof.arithmetic.balls import matrix
from verification.proof.checker.checker import Rejected
from verification.proof.enclosures.matrix_balls import BallGame, enclose_solution
from verification.proof.search.proof_report import checked_report
from verification.proof.search.solution_proof import (
    distance,
    none_exists,
    prove_delta_min,
    value_is_proved,
)

ONE = np.eye(1)


@pytest.mark.parametrize("dynamics", ["published", pytest.param("newton", marks=pytest.mark.slow)])
def test_the_solution_of_the_paper_s_game_is_proved(dynamics: str) -> None:
    proof = prove_solution(game_at(15.0, dynamics), family(dynamics), 15.0)
    assert proof.proved
    assert ("A - S P is Hurwitz", "proved") in proof.report().parts[0].rows
    assert proof.data["relative_radius"] < 1e-12
    assert proof.data["unstable_modes"] == 2
    above, most = proof.data["delta_min_above"], proof.data["delta_min_at_most"]
    assert most - above <= 1e-6 * most
    found = minimum_delta(game_at(15.0, dynamics))
    assert above < found.value * (1 + 1e-6)
    assert most > found.refused * (1 - 1e-6)


def test_the_enclosure_holds_the_sixty_digits() -> None:
    game = game_at(15.0)
    P = enclose_solution(BallGame.of(game)).P
    assert (
        distance(reference_solution(game).P, P).at_most < 1e-15
    )  # the reference is rounded to doubles
    assert max(float(entry.rad()) for entry in P.entries()) < 1e-25


def test_a_root_that_does_not_stabilize_is_told() -> None:
    """p = 1 ± sqrt(2) solve p² - 2 p - 1 = 0 for a = 1: only the larger one stabilizes and is
    positive."""
    game = BallGame.of(Game(A=ONE, B=ONE, E=ONE, Q=ONE, R=ONE, delta=np.inf))
    right, wrong = (enclose_solution(game, np.array([[start]])) for start in (2.4, -0.4))
    assert right.is_value
    assert right.P[0, 0].contains(1 + matrix(2 * ONE)[0, 0].sqrt())
    assert (wrong.stabilizing, wrong.is_value) == (False, False)


@pytest.mark.parametrize("found", [4e-7, 4e-4])
def test_delta_min_of_a_scalar_game_is_bracketed(found: float) -> None:
    """p² s + 2 p - 1 = 0, s = 1 - 1/δ², has real roots as long as 1 + s >= 0: delta_min =
    1/sqrt(2)."""
    exact = 1.0 / np.sqrt(2.0)
    bracket = prove_delta_min(
        BallGame.of(scalar_game(2.0)), DeltaMin(exact * (1 + 3 * found), exact * (1 - found))
    )
    assert bracket is not None
    assert bracket.refused < exact <= bracket.value
    assert bracket.value - bracket.refused <= 1e-6 * bracket.value


@pytest.mark.parametrize("share", [1e-5, 1e-3, 0.1])
def test_above_and_below_delta_min_are_told_apart(share: float) -> None:
    game, smallest = BallGame.of(game_at(15.0)), minimum_delta(game_at(15.0)).value
    above, below = (game.with_delta(smallest * (1 + sign * share)) for sign in (1, -1))
    assert (value_is_proved(above), value_is_proved(below)) == (True, False)
    assert (none_exists(above) is None, none_exists(below) is None) == (True, False)


@pytest.mark.parametrize("size", [1e-12, 1e-9, 1e-3])
def test_a_spoiled_critic_is_as_far_as_it_was_moved(size: float) -> None:
    game, functions = game_at(15.0), basis("quadratic", 6)
    exact = solve_game(game)
    right = {"W": functions.weights(exact.P), "P": exact.P, "K": exact.K}
    critic = from_parts(game, {name: array * (1 + size) for name, array in right.items()})
    proof = prove_critic(game, critic, family(), 15.0)
    assert set(proof.data["distances"]) == {"W", "P", "K"}
    for found in proof.data["distances"].values():
        assert found["at_least"] <= found["at_most"]
        np.testing.assert_allclose([*found.values()], size, rtol=1e-2 if size < 1e-11 else 1e-5)
    assert proof.data["closed_loop_hurwitz"]


def test_what_has_no_value_or_does_not_fit_is_refused() -> None:
    with pytest.raises(NoSolutionError, match="delta_min"):
        prove_solution(game_at(15.0).with_delta(50.0))
    square = ca.Function("square", [x := ca.SX.sym("x", 6)], [x.T @ x])
    with pytest.raises(BadInputError, match="a network has no proof here"):
        prove_critic(game_at(15.0), from_network(game_at(15.0), square))


def test_a_plant_of_a_file_with_an_eigenvalue_on_the_axis_below_delta_min(tmp_path: Path) -> None:
    own = content(proved("scalar"))
    assert "axis" in own["boxes"]["refused"][0]
    data = checked_report(check_certificate(forge(tmp_path / "scalar.json", own))).data
    assert data["delta_min_above"] < np.sqrt(0.5) <= data["delta_min_at_most"]
    own["statement"]["delta_min"], own["boxes"]["value"] = (
        [0.5, data["delta_min_above"]],
        own["boxes"]["refused"],
    )
    with pytest.raises(Rejected):
        check_certificate(forge(tmp_path / "scalar.json", own))


def test_a_gain_that_does_not_stabilize_is_certified_so_and_one_on_the_axis_is_not(
    tmp_path: Path,
) -> None:
    proof = prove_critic(game_at(15.0), from_gain(game_at(15.0), np.zeros((5, 6))))
    assert proof.data["closed_loop_hurwitz"] is False
    assert (
        proof.data["distances"]["K"]["at_least"] <= 1.0 <= proof.data["distances"]["K"]["at_most"]
    )
    proof.write(tmp_path / "critic.json", ORIGIN)
    assert (
        checked_report(check_certificate(tmp_path / "critic.json")).data["closed_loop_hurwitz"]
        is False
    )
    game = Game(A=ONE, B=ONE, E=ONE, Q=ONE, R=ONE, delta=np.inf)
    proof = prove_critic(game, from_gain(game, ONE))
    assert proof.data["closed_loop_hurwitz"] is None
    with pytest.raises(NoSolutionError, match="may lie on the axis"):
        proof.write(tmp_path / "critic.json", ORIGIN)
