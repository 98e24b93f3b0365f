"""Search for the smallest delta, also with wrong or undecided results, and reasons for refusals."""

from __future__ import annotations

import math
import re
from collections.abc import Callable

import numpy as np
import pytest
from game_samples import random_game
from reference_riccati import reference_solution

from controller import minimum_delta
from controller.riccati.certificate import CLEAR_REACH
from controller.riccati.delta_search import Answer, smallest_delta
from controller.riccati.existence import shown_gain
from controller.riccati.normal_form import RANK, NormalForm
from controller.riccati.reach import least_reach
from hfa import Game, NoSolutionError, solve

EXACT = 0.6823938


def truth(delta: float) -> Answer:
    return Answer(True) if delta > EXACT else Answer(False, "shown", "of it")


def _deltas_evaluated(excess: Callable[[float], float]) -> int:
    """Return the number of deltas of a search with this excess, whose bracket is right."""
    evaluated = []

    def existence_at(delta: float) -> Answer:
        evaluated.append(delta)
        return truth(delta)._replace(excess=excess(delta))

    value, refused, _ = smallest_delta(existence_at, 20.0, 1e-6)
    assert refused <= EXACT < value <= refused * (1.0 + 1e-6)
    return len(evaluated)


@pytest.mark.parametrize("power", [0.1, 3.0, 9.0])
def test_a_bent_excess_leaves_the_bracket_right(power: float) -> None:
    """An excess far from linear takes at most twice the deltas of a bisection."""

    def bent(delta: float) -> float:
        return math.copysign(abs(delta / EXACT - 1.0) ** power, delta - EXACT)

    assert _deltas_evaluated(bent) <= 2 * _deltas_evaluated(lambda _: math.nan)


def test_wrong_refusals_above_a_solution_are_ignored() -> None:
    """The search ignores wrong refusals from 8 to 11.38, because a smaller delta has a solution."""

    def existence_at(delta: float) -> Answer:
        return Answer(False, "rounding") if 8.0 < delta < 11.379426 else truth(delta)

    value, refused, _ = smallest_delta(existence_at, 20.0, 1e-6)
    assert refused <= EXACT < value <= refused * (1.0 + 1e-6)


def test_the_smallest_delta_is_found_despite_undecided_deltas() -> None:
    """The smallest delta is found although existence is undecided for larger deltas, from 1 to
    9.
    """

    def existence_at(delta: float) -> Answer:
        return Answer(None, "rounding") if 1.0 < delta < 9.0 else truth(delta)

    value, refused, _ = smallest_delta(existence_at, 20.0, 1e-6)
    assert refused <= EXACT < value <= refused * (1.0 + 1e-6)


def test_the_bracket_is_zero_if_all_deltas_solve() -> None:
    """If every delta has a solution, the bracket is (0, 0).

    If no delta has a solution, the error states the reason.
    """
    assert smallest_delta(lambda _: Answer(True), 1.0, 1e-6)[:2] == (0.0, 0.0)
    with pytest.raises(
        NoSolutionError, match=r"^the game has no solution for any delta up to 2\.749e\+11: shown; "
    ):
        smallest_delta(lambda _: Answer(False, "shown"), 1.0, 1e-6)
    with pytest.raises(NoSolutionError, match=r"^rounding hides whether any delta up to 2\.7"):
        smallest_delta(lambda _: Answer(None, "near the axis"), 1.0, 1e-6)


@pytest.mark.slow
def test_no_delta_below_the_stated_gain_solves() -> None:
    """No delta below the gain that a refusal states has a solution, according to a 60-digit
    reference.
    """
    rng = np.random.default_rng(3)
    shown = 0
    for number in range(3):
        game = random_game(rng, scaled=number % 2 == 0)
        smallest = minimum_delta(game)
        gain, frequency = shown_gain(NormalForm.of(game.with_delta(0.9 * smallest.value)))
        assert gain <= smallest.value
        assert frequency >= 0.0
        if gain > 0.0:
            assert not reference_solution(game.with_delta(gain * (1.0 - 1e-9))).exists
            shown += 1
    assert shown >= 2


def chain(rates: list[float], coupling: float) -> Game:
    """Return a game on a chain of states with these rates, driven at its first state.

    Each state drives the next. The input therefore affects every mode.
    """
    n = len(rates)
    A = np.diag(rates) + np.diag(np.full(n - 1, coupling), -1)
    return Game(A, np.eye(n)[:, :1], np.eye(n), np.eye(n), np.eye(1), math.inf)


@pytest.mark.parametrize(
    ("rates", "coupling"),
    [([-1e8, 1e-2, -3.0], 1e-6), ([-1e7, -2.0, 1e-3], 1e-4), ([-1e9, 1e-4], 1e-8)],
)
def test_a_stiff_controllable_plant_is_not_called_uncontrollable(
    rates: list[float], coupling: float
) -> None:
    """A stiff plant whose modes are all controllable is solved, or refused because of rounding.

    No message calls a mode unreachable or states the eigenvalue 0.
    """
    game = chain(rates, coupling)
    refusals = refusal_of(lambda: solve(game)) + refusal_of(lambda: minimum_delta(game))
    assert "is not stabilizable" not in refusals
    assert not re.search(r"eigenvalue 0\b(?!\.)", refusals)
    assert "for any delta" not in refusals


@pytest.mark.parametrize("apart", [1.0, 1e-2, 1e-4, 1e-5])
def test_certificates_state_the_distance_to_uncontrollability(apart: float) -> None:
    """For two close unstable modes and one input, the certificate states the distance to
    uncontrollability.

    The stated distance is at most the least relative change found that makes a mode unreachable.
    """
    modes = np.diag([1.0, 1.0 + apart])
    game = Game(modes, np.ones((2, 1)), np.eye(2), np.eye(2), np.eye(1), math.inf)
    form = NormalForm.of(game)[None]
    least = least_reach(form.A, form.B)[0]
    checks = {check.name: check.value for check in solve(game).certificate.checks}
    assert 0.1 * apart < least < apart
    assert RANK < checks["reach"] <= least
    assert checks["reach"] == least or checks["reach"] > CLEAR_REACH


def refusal_of(call: Callable[[], object]) -> str:
    """Return the message of a NoSolutionError with a line end, or "" if none is raised."""
    try:
        call()
    except NoSolutionError as refusal:
        return f"{refusal}\n"
    return ""
