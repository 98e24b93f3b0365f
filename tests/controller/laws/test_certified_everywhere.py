"""The certified law against the exact solution at every dihedral angle from 0 to 20 deg, both sets of equations."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
import pytest
from known_models import game_at

from controller import LearningResult, learn
from hfa_model import VARIANTS
from verification import GameSolution, relative_error, solve_game

LIMIT = 1e-9
DEGREES = range(21)


class Judged(NamedTuple):
    """Errors of P and K, settling time and T_w (s), status."""

    P_error: float
    K_error: float
    settled: float
    predefined_time: float
    status: str


def judged(result: LearningResult, exact: GameSolution) -> Judged:
    return Judged(
        relative_error(result.P, exact.P),
        relative_error(result.K, exact.K),
        result.settling_time,
        result.settings["predefined_time"],
        result.status,
    )


def assert_learned(found: Judged) -> None:
    assert found.status == "converged"
    assert found.P_error <= LIMIT
    assert found.K_error <= LIMIT
    assert found.settled <= found.predefined_time


def learned(dynamics: str, degrees: float) -> Judged:
    """The law as it stands by default, on the aircraft trimmed at that dihedral."""
    game = game_at(degrees, dynamics)
    return judged(learn(game), solve_game(game))


@pytest.mark.parametrize("dynamics", VARIANTS)
@pytest.mark.parametrize(
    # docs/critics.md runs 0, 10 and 20.
    "degrees",
    [degrees if degrees % 10 == 5 else pytest.param(degrees, marks=pytest.mark.slow) for degrees in DEGREES],
)
def test_the_certified_law_finds_the_exact_solution(dynamics: str, degrees: int) -> None:
    assert_learned(learned(dynamics, degrees))


def test_a_result_that_is_off_late_or_uncertified_is_seen() -> None:
    good = learned("published", 15)
    assert_learned(good)
    for wrong in (
        good._replace(P_error=1.01 * LIMIT),
        good._replace(K_error=1.01 * LIMIT),
        good._replace(P_error=math.nan),
        good._replace(K_error=math.nan),
        good._replace(settled=good.predefined_time + 1e-6),
        good._replace(status="failed"),
    ):
        with pytest.raises(AssertionError):
            assert_learned(wrong)


def test_errors_are_measured_against_the_solution_of_the_same_game() -> None:
    game = game_at(15.0)
    other = solve_game(game.with_delta(210.0))
    found = judged(learn(game, tick=0.1), other)
    exact = solve_game(game)
    assert found.P_error == pytest.approx(np.linalg.norm(exact.P - other.P) / np.linalg.norm(other.P), rel=1e-6)
    assert found.P_error > 1e3 * LIMIT
