"""Games of ten kinds and of all units have the answers of hundreds of digits (`stored_games.py`)."""

import math

import numpy as np
import pytest
from stored_games import EACH, KINDS, errors, stored

from controller import minimum_delta
from hfa import NoSolutionError, solve

EPS = float(np.finfo(float).eps)
#: Largest error of P and K, in units in which the diagonal of P is 1.
EXACT = 4.0 * EPS
#: Relative error of delta_min: 1e-6, and 5e-9 of the stored answers.
CLOSE = 1.01e-6


#: Numbers of the games of a kind in the fast test, where 0 and 100 show too little.
FEW = {
    "cross": (30, 48, 155),
    "weak": (6, 12, 121, 142),
    "stiff": (0, 19, 100),
    "cheap": (30, 65, 141),
}
#: Those of them whose delta_min takes seconds: it is left to the slow test.
LONG = {("cheap", 65), ("cheap", 141)}


def mistake(game):
    """Return what is wrong with the answers to a game, or ""."""
    return mistake_of_value(game) or mistake_of_delta_min(game)


def mistake_of_value(game):
    try:
        solution = solve(game.game)
    except NoSolutionError as refusal:
        if game.exists:
            return f"refused: {refusal}"
    else:
        if not game.exists:
            return "has no value, but is solved"
        error = max(errors(game, solution.P, solution.K))
        if not error <= EXACT:
            return f"error {error:.2g}"
    return ""


def mistake_of_delta_min(game):
    try:
        smallest = minimum_delta(game.game)
    except NoSolutionError as refusal:
        return "" if math.isnan(game.delta_min) else f"no delta_min: {refusal}"
    if not smallest.refused * (1.0 - CLOSE) <= game.delta_min <= smallest.value * (1.0 + CLOSE):
        return f"delta_min is {game.delta_min:.9g}, not in {smallest}"
    if not smallest.value <= smallest.refused * (1.0 + CLOSE) + 1e-12:
        return f"wide: {smallest}"
    return ""


@pytest.mark.parametrize("kind", KINDS)
def test_a_few_games_have_their_answers(kind):
    """P, K, the existence of a value, and delta_min of a few games of a kind are those that were
    stored, which hundreds of digits gave. delta_min is left out where it takes seconds.
    """
    for number in FEW.get(kind, (0, 100)):
        wrong = mistake_of_value if (kind, number) in LONG else mistake
        assert wrong(stored(kind, number)) == "", number


@pytest.mark.slow
@pytest.mark.parametrize("kind", KINDS)
def test_all_games_have_their_answers(kind):
    """P, K, the existence of a value, and delta_min are those that were stored, which hundreds of
    digits gave.
    """
    mistakes = {number: mistake(stored(kind, number)) for number in range(EACH)}
    assert {number: what for number, what in mistakes.items() if what} == {}
