"""Proofs that a game has no value, asked of games that have one and of games that have none."""

import math
from fractions import Fraction

import numpy as np
import pytest
from stored_games import KINDS, stored

from controller.riccati.balls import BITS, precision
from controller.riccati.candidate import first_units
from controller.riccati.enclosure import decided, enclosed_in_bits
from controller.riccati.equation import Equation
from controller.riccati.refusal import refuse_modes, why_no_value, why_not_the_value
from hfa import Game


@pytest.mark.parametrize("kind", KINDS)
def test_no_proof_says_that_a_game_with_a_value_has_none(kind):
    """None of the proofs of no value succeeds for games that have one.

    `solve` would try these proofs only after another one has failed.
    """
    values = [each for each in (stored(kind, number) for number in range(12)) if each.exists]
    assert values
    for each in values:
        game = each.game
        found = enclosed_in_bits(decided(game, game.delta), 2 * BITS).proved
        with precision(2 * BITS):
            assert why_not_the_value(found) == why_no_value(found.equation, in_bits=False) == ""
        refuse_modes(game)


@pytest.mark.parametrize("n", [1, 2, 3])
@pytest.mark.parametrize("k", [1, 2])
@pytest.mark.parametrize("dt", [None, True])
def test_a_frequency_proves_that_the_disturbance_gains_too_much(n, k, dt):
    """x' = -x + d has the gain 1, and x⁺ = x / 2 + d the gain 2: there is no value for a smaller
    delta. d acts on the first of n such states, and is divided between k disturbances.
    """
    rate = -1.0 if dt is None else 0.5
    E = np.eye(n)[:, :1] @ np.ones((1, k)) / math.sqrt(k)
    gain = 1.0 if dt is None else 2.0
    for factor, is_refused in ((0.99, True), (1.01, False)):
        game = Game(
            rate * np.eye(n),
            np.zeros((n, 1)),
            E=E,
            Q=np.eye(n),
            R=[1.0],
            delta=factor * gain,
            dt=dt,
        )
        with precision(BITS):
            equation = Equation(game, first_units(game, game.delta), game.delta)
            reason = why_no_value(equation, in_bits=False)
        assert ("gain from the disturbance" in reason) == bool(reason) == is_refused
        assert ("rad/step)" if dt else "rad/s)") in reason or not reason


def test_the_root_of_a_discount_is_not_rounded():
    """√α A is below 1 by less than the rounding of √α: no input reaches the mode, which is stable."""
    A, discount = 1.8076723200297387, 0.3060275913619129
    assert Fraction(A) ** 2 * Fraction(discount) < 1 < Fraction(A) * Fraction(math.sqrt(discount))
    game = Game([[A]], [[0.0]], Q=[[1.0]], R=[[1.0]], dt=True, discount=discount)
    with precision(BITS):
        refuse_modes(game)
