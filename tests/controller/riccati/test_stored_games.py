"""Games of ten kinds and of all units have the answers of hundreds of digits (`stored_games.py`)."""

from __future__ import annotations

import math

import numpy as np
import pytest
from stored_games import EACH, KINDS, Stored, errors, stored

from controller import minimum_delta
from hfa import NoSolutionError, solve

EPS = float(np.finfo(float).eps)
#: Largest error of P and K where the last digits of the game's entries do not change them,
EXACT = 1e-10
#: and otherwise their number of changes by these digits.
CHANGES = 100.0
#: Relative error of delta_min.
CLOSE = 3e-6


#: Games that have answers but are refused, and a delta_min that is up to 0.4 % too high or 1e-5 too
#: low: cheap control at the last digits, and weak inputs within 1e-5 of delta_min.
KNOWN = {
    "cheap": {30, 37, 44, 61, 65, 123, 126, 141, 158, 179},
    "weak": {6, 68, 121, 142},
}


#: Games of the fast tests where the first ones show too little: those that only turned states solve.
FEW = {"cross": (30, 48, 155), "weak": (0, 12, 57), "stiff": (0, 19, 100), "cheap": (0, 28, 100)}


def mistake(game: Stored) -> str:
    """Return what is wrong with the answers to a game, or ""."""
    try:
        solution = solve(game.game)
    except NoSolutionError as refusal:
        if game.exists:
            return f"refused: {refusal}"
    else:
        if not game.exists:
            return "has no value, but is solved"
        error = max(errors(game, solution.P, solution.K))
        if not error <= max(EXACT, CHANGES * EPS * game.change):
            return f"error {error:.2g}, where last digits change {EPS * game.change:.2g}"
    try:
        smallest = minimum_delta(game.game).value
    except NoSolutionError as refusal:
        return "" if math.isnan(game.delta_min) else f"no delta_min: {refusal}"
    if smallest == pytest.approx(game.delta_min, rel=CLOSE, abs=1e-12):
        return ""
    return f"delta_min is {game.delta_min:.9g}, not {smallest:.9g}"


@pytest.mark.parametrize("kind", KINDS)
def test_a_few_games_have_their_answers(kind: str) -> None:
    """P, K, the existence of a value, and delta_min are those of the stored answers."""
    numbers = FEW.get(kind, (0, 100))
    assert [mistake(stored(kind, number)) for number in numbers] == [""] * len(numbers)


@pytest.mark.slow
@pytest.mark.parametrize("kind", KINDS)
def test_all_games_have_their_answers(kind: str) -> None:
    """P, K, the existence of a value, and delta_min are those of the stored answers, but for the
    games `KNOWN`.
    """
    mistakes = {number: mistake(stored(kind, number)) for number in range(EACH)}
    wrong = {number: what for number, what in mistakes.items() if what}
    assert {number: wrong[number] for number in set(wrong) - KNOWN.get(kind, set())} == {}
