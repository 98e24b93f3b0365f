"""Certificates of a solution and of a critic, checked; and spoiled ones, refused."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from known_models import game_at
from proof_cases import ORIGIN, scalar_game

from controller import Game, basis
from controller.game.critic_file import StoredCritic
from hfa_support import NoSolutionError
from verification import check_certificate, prove_critic, prove_solution
from verification.checker.checker import Rejected
from verification.proof.certificate_file import write_certificate
from verification.proof.proof_report import checked_report
from verification.proof.solution_proof import critic_claim, solution_claim

Content = dict[str, Any]


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
