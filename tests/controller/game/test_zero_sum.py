"""Zero-sum games and bases: invalid input, policies, ψ(z) and its gradient, and W and P."""

import math
import re
from functools import partial

import numpy as np
import pytest
from cli import refused
from game_files import SMALL
from scipy.linalg import block_diag

from controller import basis
from controller.game.zero_sum import q_function
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
        ({"E": np.zeros((2, 0))}, "A, B or E is empty"),
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


@pytest.mark.parametrize("delta", [1.5, math.inf])
@pytest.mark.parametrize("dt", [None, 0.1])
def test_policies_are_stationary_points_of_the_game(dt, delta):
    """(u, d) = (-K z, L z) is the stationary point of the cost of a step and z'P z afterwards, or of the
    Hamiltonian, with cross weights N. Without N, the input v = u + F z has the gain K - F.
    """
    random = np.random.default_rng(2)
    A, B, E, N = (random.normal(size=(3, columns)) for columns in (3, 2, 1, 2))
    Q, P, R, N = 9.0 * np.eye(3), np.diag([3.0, 2.0, 1.0]), np.diag([2.0, 1.0]), 0.1 * N
    discount = 0.9 if dt else 1.0
    game = Game(A, B, E=E, Q=Q, R=R, N=N, delta=delta, dt=dt, discount=discount)
    players = [B, E] if delta < math.inf else [B]
    plant, n = np.hstack([A, *players]), 3
    weights = block_diag(np.block([[Q, N], [N.T, R]]), *[[[-(delta**2)]]] * (len(players) - 1))
    J = plant if dt else np.eye(*plant.shape)
    H = weights + (plant.T @ P @ plant if dt else J.T @ P @ plant + plant.T @ P @ J) * discount
    K, L = game.policies(P)
    assert (L == 0.0).all() == (delta == math.inf)
    np.testing.assert_allclose((H @ np.vstack([np.eye(n), -K, L])[: len(H)])[n:], 0.0, atol=1e-12)
    if dt:
        np.testing.assert_allclose(q_function(game, P), H, rtol=1e-12)
    other = game.without_cross_weights
    np.testing.assert_allclose(other.policies(P)[0], K - np.linalg.solve(R, N.T), atol=1e-12)
    assert not other.N.any()
    with pytest.raises(BadInputError, match="at least one state and one input"):
        game.select([])


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
    for name, states, said in (("paper", 4, "6 states"), ("quadratic", 0, "at least 1 state")):
        with pytest.raises(BadInputError, match=said):
            basis(name, states)


@pytest.mark.parametrize("discount", [0.0, -0.5, 1.0 + 2**-52, 1.5, 2.0, np.nan])
def test_a_discount_is_above_0_and_at_most_1(discount):
    """Costs of later steps count at most as much: another discount is refused."""
    game = partial(Game, [[0.5]], [[1.0]], Q=[1.0], R=[1.0], dt=0.1)
    assert game(discount=1.0).discount == 1.0
    with pytest.raises(BadInputError, match="discount is"):
        game(discount=discount)
