"""The bound on the effect of rounding on a value v'P v of a state v."""

import math
from dataclasses import replace

import numpy as np
import pytest
from game_samples import random_game

from controller import minimum_delta
from controller.plant.value_error import value_error
from controller.riccati.existence import ROUNDING
from controller.riccati.normal_form import NormalForm
from hfa import Game, solve


@pytest.mark.parametrize("games", [1, pytest.param(3, marks=pytest.mark.slow)])
@pytest.mark.parametrize("names", ["AB", "E", "Q"])
def test_the_error_of_a_value_bounds_changes(games: int, names: str) -> None:
    """If each entry of matrices changes by 1e-7, v'P v changes by less than the bound.

    The largest change is at least 0.1 % of the bound, which holds for all of A, B, E, Q.
    """
    rng = np.random.default_rng(11)
    part = 1e-7
    for number in range(games):
        game = random_game(rng, scaled=number % 2 == 0)
        game = game.with_delta(1.5 * minimum_delta(game).value)
        P = solve(game).P
        vector = rng.standard_normal(len(P)) / np.sqrt(np.diag(P))
        bound = value_error(NormalForm.of(game), P, vector) * part / (2 * len(P) * ROUNDING)
        changes = []
        for _ in range(20):
            moved = {}
            for name in names:
                signs = rng.choice([-1.0, 1.0], getattr(game, name).shape)
                signs = signs if name != "Q" else np.outer(signs[0], signs[0])
                moved[name] = getattr(game, name) * (1.0 + part * signs)
            solution = solve(replace(game, **moved)).P
            changes.append(abs(vector @ (solution - P) @ vector))
        assert max(changes) <= bound, number
        assert max(changes) >= 1e-3 * bound, number


def test_a_value_that_does_not_stabilize_is_unbounded() -> None:
    """The bound is infinite for a P that does not stabilize."""
    one = np.eye(1)
    form = NormalForm.of(Game(0.0 * one, one, one, one, one, 2.0))
    assert value_error(form, 0.0 * one, np.ones(1)) == math.inf
