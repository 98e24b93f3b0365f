"""Search for the smallest delta, also with wrong or undecided results, and reasons for refusals."""

from __future__ import annotations

import math
import re
from collections.abc import Callable

import numpy as np
import pytest

from controller import minimum_delta
from controller.riccati.delta_search import Answer, smallest_delta
from hfa import Game, NoSolutionError, solve

EXACT = 0.6823938


def truth(delta: float) -> Answer:
    return Answer(True) if delta > EXACT else Answer(False, "shown", "of it")


def test_wrong_refusals_above_a_solution_are_ignored() -> None:
    """The search ignores wrong refusals from 8 to 11.38, because a smaller delta has a solution."""

    def existence_at(delta: float) -> Answer:
        return Answer(False, "rounding") if 8.0 < delta < 11.379426 else truth(delta)

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
    """A stiff plant whose modes are all controllable is solved, or refused with the accuracy.

    No message calls a mode unreachable without this limit, or states the eigenvalue 0.
    """
    game = chain(rates, coupling)
    refusals = refusal_of(lambda: solve(game)) + refusal_of(lambda: minimum_delta(game))
    for line in refusals.splitlines():
        assert "stabilizable" not in line or line.startswith("within 1e-10 of its largest rate")
    assert not re.search(r"eigenvalue 0\b(?!\.)", refusals)
    assert "for any delta" not in refusals


def refusal_of(call: Callable[[], object]) -> str:
    """Return the message of a NoSolutionError with a line end, or "" if none is raised."""
    try:
        call()
    except NoSolutionError as refusal:
        return f"{refusal}\n"
    return ""
