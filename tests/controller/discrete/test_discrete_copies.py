"""Changes that must not affect whether a discrete-time game has a solution.

These are changes of last bits, and of the order, units or axes of the states.
"""

from __future__ import annotations

import numpy as np
import pytest
from copies import copies

from controller.discrete.solution import minimum_delta_discrete, sampled, solve_discrete
from controller.game.discrete_game import DiscreteGame
from hfa import Game, NoSolutionError

KINDS = ("ordinary", "without weights", "cheap", "sampled", "near the circle", "both poles")


def _problem(kind: str, seed: int) -> DiscreteGame:
    """Return a random game of the given kind with 2 to 5 states and δ = inf."""
    rng = np.random.default_rng([31, KINDS.index(kind), seed])
    n = int(rng.integers(2, 6))
    A = rng.standard_normal((n, n))
    A *= rng.uniform(0.5, 1.5) / np.abs(np.linalg.eigvals(A)).max()
    B, E = (rng.standard_normal((n, size)) for size in (2, 1))
    Q = np.eye(n)
    R = np.eye(2)
    if kind == "without weights":
        A *= 1.3 / np.abs(np.linalg.eigvals(A)).max()
        Q *= 0.0
    if kind == "cheap":
        R *= 1e-10
    if kind == "near the circle":
        A *= (1.0 - 1e-6) / np.abs(np.linalg.eigvals(A)).max()
    if kind == "both poles":
        A = np.diag(rng.choice([-1.0, 1.0], n)) + np.diag(np.ones(n - 1), 1)
    if kind == "sampled":
        return sampled(Game(A, B, E, Q, R, np.inf), 1e-4)
    return DiscreteGame(Game(A, B, E, Q, R, np.inf), rng.choice([1.0, 0.95]))


def _verdict(problem: DiscreteGame) -> bool:
    try:
        return solve_discrete(problem).certificate.ok
    except NoSolutionError:
        return False


def _changed(kind: str, seed: int, count: int) -> list[str]:
    """Return a sentence for each equivalent copy of a game with another verdict or delta_min.

    The verdict is compared at four values of δ. The brackets of δ_min must overlap.

    count: number of copies
    """
    problem = _problem(kind, seed)
    smallest = minimum_delta_discrete(problem)
    changed = []
    for share in (1.001, 3.0, 0.99, np.inf):
        if smallest.value == 0.0 and np.isfinite(share):
            continue
        delta = share * smallest.value if np.isfinite(share) else np.inf
        at_delta = DiscreteGame(
            problem.step.with_delta(delta), problem.discount, A_low=problem.A_low
        )
        verdict = _verdict(at_delta)
        assert verdict is (share > 1.0)
        for copy in copies(at_delta, seed, count):
            if _verdict(copy.problem) is not verdict:
                changed.append(f"{kind} {seed}: {copy.kind} at {share} delta_min")
    for copy in copies(problem, seed, count):
        other = minimum_delta_discrete(copy.problem)
        slack = 1.0 + 1e-6
        if not (
            other.refused <= slack * smallest.value and smallest.refused <= slack * other.value
        ):
            changed.append(f"{kind} {seed}: {copy.kind} has delta_min {other} not {smallest}")
    return changed


@pytest.mark.parametrize(
    "kind",
    [
        "sampled",
        pytest.param("without weights", marks=pytest.mark.slow),
        pytest.param("both poles", marks=pytest.mark.slow),
    ],
)
def test_copies_of_a_game_give_the_original_result(kind: str) -> None:
    """Transformed copies of a game have a solution exactly if the game has one."""
    assert _changed(kind, 0, 2) == []


@pytest.mark.slow
@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("seed", range(1, 9))
def test_copies_of_further_games_give_the_original_result(kind: str, seed: int) -> None:
    """Transformed copies of further games have a solution exactly if the game has one."""
    assert _changed(kind, seed, 24) == []
