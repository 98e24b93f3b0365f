"""Zero-sum games and bases: invalid input, policies, ψ(z) and its gradient, and W and P."""

import math
import re
from functools import partial

import numpy as np
import pytest
from cli import refused
from game_files import SMALL

from controller import basis
from hfa import BadInputError, Game
from hfa_model import LINEAR_STATES

#: States with fourth powers in the paper's basis.
QUARTIC = ("speed", "alpha", "pitch_rate", "dihedral")


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"A": [[1.0, 2.0]]}, "A is 1 x 2; give a square matrix"),
        ({"A": [[1.0, 2.0], [3.0]]}, "A does not consist of rows of real numbers"),
        ({"A": np.ma.masked_equal(np.eye(2), 0.0)}, "A has masked entries"),
        ({"A": [[1.0, math.nan], [0.0, 1.0]]}, r"A\[0\]\[1\] is nan; give finite entries"),
        (
            {"A": [[1e150, 0.0], [0.0, 1.0]]},
            r"A\[0\]\[0\] is 1e\+150; give entries of at most 1e\+100",
        ),
        ({"A": np.zeros((0, 0))}, "a game needs at least one state and one input"),
        ({"B": [[1.0]]}, "B is 1 x 1; give 2 x 1, to match A and B"),
        ({"R": 1.0}, "the number of dimensions of R is 0"),
        ({"Q": [[1.0, 0.1], [0.0, 1.0]]}, "Q is not symmetric"),
        ({"B": np.eye(2), "R": [[1.0, 3.0], [3.0, 9.0]]}, "R is not positive definite"),
        ({"B": np.eye(2), "R": [[1e20, 1e10], [1e10, 1.0]]}, "R is not positive definite"),
        ({"R": None}, "Q or R is missing"),
        ({"E": np.zeros((2, 0))}, "E has no columns; leave E out for the identity"),
        ({"dt": -0.1}, "give the sample time"),
        ({"delta": 0.0}, "delta is 0.0; give a number from"),
        ({"delta": 1e-60}, "delta is 1e-60; give a number from"),
        ({"delta": 1e300}, r"delta is 1e\+300; .* from 1e-50 to 1e\+50, or inf"),
    ],
)
def test_ill_posed_games_are_refused(change, message):
    """A game with a wrong shape, sign or number is refused by one line."""
    assert re.search(message, refused(Game, **(SMALL | change)))


def test_exact_entries_decide_whether_R_is_positive_definite():
    """R with the determinant 2^-52 is accepted, with that of -2^-52 refused, in any units."""
    for units in (np.eye(2), np.diag([2.0**60, 2.0**-40])):
        for last_digits, is_positive in ((2.0**-52, True), (-(2.0**-53), False)):
            R = units @ np.array([[1.0, 1.0], [1.0, 1.0 + last_digits]]) @ units
            given = SMALL | {"B": np.eye(2), "R": R}
            if is_positive:
                assert Game(**given).R[0, 0] == R[0, 0]
            else:
                assert "R is not positive definite" in refused(Game, **given)


def test_a_game_cannot_be_changed_from_outside():
    """A game has read-only copies of its matrices, and `with_delta` does not change the game."""
    A = np.array(SMALL["A"])
    game = Game(**(SMALL | {"A": A}))
    A[0, 0] = 7.0
    assert game.A[0, 0] == -0.2
    with pytest.raises(ValueError, match="read-only"):
        game.A[0, 0] = 7.0
    assert (game.with_delta(2.0).delta, game.delta) == (2.0, 3.0)


# The basis of the value.


def test_quadratic_monomials_come_first_row_by_row():
    """The quadratic monomials of a basis come first, row by row, and the other monomials follow."""
    z = np.array([2.0, 3.0, 5.0])
    squares = [4.0, 6.0, 10.0, 9.0, 15.0, 25.0]
    assert basis("quadratic+linear", 3).psi(z).tolist() == [*squares, *z]
    assert basis("quadratic+quartic", 3).psi(z).tolist() == [*squares, 16.0, 81.0, 625.0]
    z = np.arange(1.0, 7.0)
    extra = [z[LINEAR_STATES.index(name)] ** 4 for name in QUARTIC]
    assert basis("paper", 6).psi(z)[21:].tolist() == extra
    with pytest.raises(BadInputError, match="6 states"):
        basis("paper", 4)


@pytest.mark.parametrize("discount", [0.0, -0.5, 1.0 + 2**-52, 1.5, 2.0, np.nan])
def test_a_discount_is_above_0_and_at_most_1(discount):
    """Costs of later steps count at most as much: another discount is refused."""
    game = partial(Game, [[0.5]], [[1.0]], Q=[1.0], R=[1.0], dt=0.1)
    assert game(discount=1.0).discount == 1.0
    with pytest.raises(BadInputError, match="discount is"):
        game(discount=discount)
