"""The exact game, proved: against sixty digits, at both sides of delta_min, and against spoiled critics."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from known_models import game_at
from proof_cases import ORIGIN, family, scalar_game
from reference_riccati import reference_solution

from controller import Game, basis
from controller.game.critic_file import StoredCritic
from controller.riccati.smallest_delta import DeltaMin
from hfa_model import LINEAR_STATES
from hfa_support import BadInputError, NoSolutionError
from verification import check_certificate, minimum_delta, prove_critic, prove_solution, solve_game
from verification.arithmetic import flint_or_refusal
from verification.arithmetic.balls import matrix
from verification.checker.checker import Rejected
from verification.enclosures.game_balls import BallGame, enclose_solution
from verification.proof.certificate_file import write_certificate
from verification.proof.proof_report import checked_report, solution_proof_report
from verification.proof.solution_proof import (
    critic_claim,
    distance,
    none_exists,
    prove_delta_min,
    solution_claim,
    value_is_proved,
)


@pytest.mark.parametrize("dynamics", ["published", "newton"])
def test_the_solution_of_the_paper_s_game_is_proved(dynamics: str) -> None:
    proof = prove_solution(game_at(15.0, dynamics), family(dynamics), 15.0)
    assert proof.proved
    assert ("A - S P is Hurwitz", "proved") in solution_proof_report(proof, LINEAR_STATES, "").parts[0].rows
    assert proof.radius < 1e-12
    assert proof.unstable == 2
    assert proof.delta is not None
    assert proof.delta.width <= 1e-6
    found = minimum_delta(game_at(15.0, dynamics))
    assert proof.delta.refused < found.value * (1 + 1e-6)
    assert proof.delta.value > found.refused * (1 - 1e-6)


def test_the_enclosure_holds_the_sixty_digits() -> None:
    flint_or_refusal()
    game = game_at(15.0)
    P = enclose_solution(BallGame.of(game)).P
    reference = reference_solution(game).P
    assert distance(reference, P).at_most < 1e-15  # the reference is rounded to doubles
    assert max(float(entry.rad()) for entry in P.entries()) < 1e-25


def test_a_root_that_does_not_stabilize_is_told() -> None:
    """p = 1 ± sqrt(2) solve p² - 2 p - 1 = 0 for a = 1: only the larger one stabilizes and is positive."""
    flint_or_refusal()
    one = np.eye(1)
    game = BallGame.of(Game(A=one, B=one, E=one, Q=one, R=one, delta=np.inf))
    right = enclose_solution(game, np.array([[2.4]]))
    wrong = enclose_solution(game, np.array([[-0.4]]))
    assert right.is_value
    assert right.P[0, 0].contains(1 + matrix(2 * one)[0, 0].sqrt())
    assert not wrong.stabilizing
    assert not wrong.is_value


@pytest.mark.parametrize("found", [4e-7, 4e-4])
def test_delta_min_of_a_scalar_game_is_bracketed(found: float) -> None:
    """p² s + 2 p - 1 = 0, s = 1 - 1/δ², has real roots as long as 1 + s >= 0: delta_min = 1/sqrt(2)."""
    flint_or_refusal()
    exact = 1.0 / np.sqrt(2.0)
    bracket = prove_delta_min(BallGame.of(scalar_game(2.0)), DeltaMin(exact * (1 + 3 * found), exact * (1 - found)))
    assert bracket is not None
    assert bracket.refused < exact <= bracket.value
    assert bracket.width <= 1e-6


@pytest.mark.parametrize("share", [1e-5, 1e-3, 0.1])
def test_above_and_below_delta_min_are_told_apart(share: float) -> None:
    flint_or_refusal()
    game = game_at(15.0)
    smallest = minimum_delta(game).value
    ours = BallGame.of(game)
    assert value_is_proved(ours.with_delta(smallest * (1 + share)))
    assert none_exists(ours.with_delta(smallest * (1 + share))) is None
    assert not value_is_proved(ours.with_delta(smallest * (1 - share)))
    assert none_exists(ours.with_delta(smallest * (1 - share))) is not None


def test_a_game_without_a_value_is_refused() -> None:
    with pytest.raises(NoSolutionError, match="delta_min"):
        prove_solution(game_at(15.0).with_delta(50.0))


@pytest.mark.parametrize("size", [1e-12, 1e-9, 1e-3])
def test_a_spoiled_critic_is_as_far_as_it_was_moved(size: float) -> None:
    game, functions = game_at(15.0), basis("quadratic", 6)
    exact = solve_game(game)
    stored = StoredCritic(functions.weights(exact.P) * (1 + size), exact.P * (1 + size), exact.K * (1 + size))
    proof = prove_critic(game, stored, functions, family(), 15.0)
    assert set(proof.distances) == {"W", "P", "K"}
    for found in proof.distances.values():
        assert found.at_least <= found.at_most
        np.testing.assert_allclose([found.at_least, found.at_most], size, rtol=1e-2 if size < 1e-11 else 1e-5)
    assert proof.stabilizes


def test_a_critic_of_another_size_is_refused() -> None:
    with pytest.raises(BadInputError, match="P has shape"):
        prove_critic(game_at(15.0), StoredCritic(None, np.eye(3), None), basis("quadratic", 6))


def test_a_plant_of_a_file_with_an_eigenvalue_on_the_axis_below_delta_min(tmp_path: Path) -> None:
    path = tmp_path / "scalar.json"
    proof = prove_solution(scalar_game(2.0))
    claim, boxes = solution_claim(proof)
    assert "axis" in boxes["refused"][0]
    write_certificate(path, ORIGIN, "game", claim, boxes)
    above, most = checked_report(check_certificate(path)).data["delta_min_above"], proof.delta
    assert most is not None
    assert above < np.sqrt(0.5) <= most.value
    forged = claim | {"delta_min": [0.5, above]}, boxes | {"value": boxes["refused"]}
    write_certificate(path, ORIGIN, "game", *forged)
    with pytest.raises(Rejected):
        check_certificate(path)


def test_a_gain_that_does_not_stabilize_is_certified_so(tmp_path: Path) -> None:
    path = tmp_path / "critic.json"
    proof = prove_critic(game_at(15.0), StoredCritic(None, None, np.zeros((5, 6))), basis("quadratic", 6))
    assert proof.stabilizes is False
    assert proof.distances["K"].at_least <= 1.0 <= proof.distances["K"].at_most
    write_certificate(path, ORIGIN, "game", *critic_claim(proof))
    data = checked_report(check_certificate(path)).data
    assert data["closed_loop_hurwitz"] is False


def test_a_loop_with_a_mode_on_the_axis_is_not_certified() -> None:
    one = np.eye(1)
    game = Game(A=one, B=one, E=one, Q=one, R=one, delta=np.inf)
    proof = prove_critic(game, StoredCritic(None, None, one), basis("quadratic", 1))
    assert proof.stabilizes is None
    with pytest.raises(NoSolutionError, match="may lie on the axis"):
        critic_claim(proof)
