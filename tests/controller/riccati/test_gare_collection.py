"""The collection of hard games against the 60-digit reference: none accepted wrongly, hardly one refused wrongly."""

from __future__ import annotations

import math
import warnings
from collections import Counter
from collections.abc import Callable
from contextlib import suppress

import numpy as np
import pytest
from game_collection import BARELY_REACHED, STRUCTURES, Sample, collection
from game_samples import random_game
from reference_riccati import reference_solution, relative_error
from scipy.linalg import LinAlgError, block_diag, solve_continuous_are

from controller import Game
from controller.riccati.certificate import certified_solution, iterated_solution, relative_residual
from controller.riccati.smallest_delta import lqr_obstacle
from hfa_support import NoSolutionError
from verification import minimum_delta, solve_game

#: A right answer may be refused where a delta this much smaller has none.
MARGIN = 1e-3
#: Largest error of an accepted P, relative in units that give it a unit diagonal.
WORST_ERROR = 1e-10
#: Of delta_min, relative, unless its uncertainty is stated: as the page of promises says.
CLOSE = 1e-6


def _verdict(sample: Sample, worst: float = WORST_ERROR) -> str:
    """How the solver does on a game; AssertionError when it accepts a wrong solution, or names a wrong cause."""
    game, label = sample.game, f"{sample.structure} {sample.number}"
    reference = reference_solution(game)
    try:
        P = solve_game(game).P
    except NoSolutionError:
        if _exists(game, math.inf):
            assert "is not certified" in lqr_obstacle(game, "why"), f"{label}: a cause that is none"
        if not reference.exists:
            return "refused, rightly"
        with_less = math.isfinite(game.delta) and not _exists(game, game.delta * (1.0 - MARGIN))
        return "refused at the edge" if with_less else "refused wrongly"
    assert reference.exists, f"{label}: accepted, and there is no solution"
    size = np.sqrt(np.diag(reference.P))
    units = np.divide(1.0, size, out=np.ones_like(size), where=size > 0.0)
    error = float(np.abs((P - reference.P) * np.outer(units, units)).max())
    assert error < worst, f"{label}: accepted with an error of {error:.2g}"
    return "accepted, rightly"


def _exists(game: Game, delta: float) -> bool:
    return reference_solution(game.with_delta(delta)).exists


def _bracket(sample: Sample) -> str:
    """How the bracket of delta_min does on a game."""
    game = sample.game
    try:
        found = minimum_delta(game)
    except NoSolutionError:
        return "not found, wrongly" if _exists(game, math.inf) else "none"
    if found.value == 0.0:
        return "right"
    if not _exists(game, found.value * (1.0 + CLOSE)):
        return "wrong"
    if found.refused > 0.0 and _exists(game, found.refused / (1.0 + CLOSE)):
        return "wrong"
    if found.uncertain:
        return "right, wide"
    return "right" if found.value <= found.refused * (1.0 + 2.0 * CLOSE) else "wrong"


def test_two_games_of_each_structure() -> None:
    verdicts = Counter(_verdict(sample) for sample in collection(2 * len(STRUCTURES), seed=1))
    assert not {"refused wrongly", "refused at the edge"} & set(verdicts)
    assert min(verdicts["accepted, rightly"], verdicts["refused, rightly"]) >= 2


@pytest.mark.slow  # of random games and of degenerate ones by name: test_existence.py, test_gare_degenerate.py
def test_smallest_delta_of_each_structure() -> None:
    brackets = Counter(_bracket(sample) for sample in collection(len(STRUCTURES), seed=1))
    assert set(brackets) <= {"right", "right, wide", "none"}
    assert brackets["right"] >= 6


@pytest.mark.parametrize("count", [12, pytest.param(400, marks=pytest.mark.slow)])
def test_games_with_a_mode_that_the_input_barely_reaches(count: int) -> None:
    """Some of one state, others in absurd units, or at a delta near the smallest."""
    verdicts = Counter(_verdict(sample) for sample in collection(count, 4, BARELY_REACHED))
    assert verdicts["refused wrongly"] + verdicts["refused at the edge"] <= 0.01 * count, verdicts
    assert verdicts["accepted, rightly"] >= 0.7 * count


@pytest.mark.slow
@pytest.mark.parametrize("seed", [2, 3])
def test_two_thousand_games(seed: int) -> None:
    count = 1000
    verdicts, brackets = Counter[str](), Counter[str]()
    for sample in collection(count, seed):
        verdicts[_verdict(sample)] += 1
        brackets[_bracket(sample)] += 1
    print(f"\nseed={seed}: {dict(verdicts)}; delta_min {dict(brackets)}")
    assert verdicts["refused wrongly"] <= 0.005 * count
    assert verdicts["refused at the edge"] <= 0.005 * count
    assert min(verdicts["accepted, rightly"], verdicts["refused, rightly"]) >= 0.15 * count
    assert not brackets["wrong"]
    assert brackets["right, wide"] + brackets["not found, wrongly"] <= 0.03 * count


@pytest.mark.parametrize("scaled", [pytest.param(False, marks=pytest.mark.slow), True])
@pytest.mark.parametrize("count", [12, pytest.param(600, marks=pytest.mark.slow)])
def test_random_games_and_what_scipy_alone_says(count: int, scaled: bool) -> None:
    """Right to 1e-8 at the edge of existence; a bare call returns other roots without a word."""
    rng, verdicts, alone = np.random.default_rng(2 if count > 12 else 1), Counter[str](), Counter[bool]()
    for number in range(count):
        game = random_game(rng, scaled=scaled)
        verdicts[_verdict(Sample("random", number, game), 1e-8)] += 1
        inputs, weights = np.hstack([game.B, game.E]), block_diag(game.R, -(game.delta**2) * np.eye(game.E.shape[1]))
        with suppress(LinAlgError, ValueError), warnings.catch_warnings(action="ignore"):
            P = solve_continuous_are(game.A, inputs, game.Q, weights)
            wrong = relative_residual(game, P) > 1e-6 or np.linalg.eigvalsh(P)[0] < -1e-10 * np.abs(P).max()
            alone[bool(wrong)] += 1
    assert not verdicts["refused wrongly"]
    assert verdicts["refused at the edge"] <= 0.01 * count
    assert min(verdicts["accepted, rightly"], verdicts["refused, rightly"]) >= count // 4
    assert alone[True] >= count // 24


@pytest.mark.parametrize("games", [30, pytest.param(90, marks=pytest.mark.slow)])
def test_the_two_derivations_agree_on_existence(games: int) -> None:
    rng, verdicts = np.random.default_rng(3), Counter[tuple[bool, ...]]()
    for number in range(games):
        game = random_game(rng, scaled=number % 2 == 1)
        verdicts[tuple(_accepts(solver, game) for solver in (certified_solution, iterated_solution))] += 1
    assert set(verdicts) == {(True, True), (False, False)}
    assert min(verdicts.values()) >= 2 * games // 9


def _accepts(solver: Callable[[Game], object], game: Game) -> bool:
    try:
        solver(game)
    except NoSolutionError:
        return False
    return True


def test_the_reference_is_the_solution_of_a_scalar_game() -> None:
    game = Game([[-1.0]], [[2.0]], [[1.0]], [[3.0]], [[4.0]], 2.0)  # S = 1 - 1/4
    p = (-1.0 + math.sqrt(1.0 + 0.75 * 3.0)) / 0.75
    reference = reference_solution(game)
    assert reference.exists
    assert relative_error(reference.P, np.array([[p]])) < 1e-15
    assert relative_error(reference.K, np.array([[p / 2.0]])) < 1e-15
    assert not reference_solution(game.with_delta(0.8)).exists  # delta_min = 1/sqrt(1 + 1/3) = 0.866
