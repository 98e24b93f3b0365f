"""Search for the smallest delta, also with wrong or undecided results, and reasons for refusals."""

from __future__ import annotations

import math
import re
from collections.abc import Callable

import numpy as np
import pytest

from controller import minimum_delta
from hfa import Game, NoSolutionError, solve


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
