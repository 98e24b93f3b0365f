"""The check of critics. The exact critic passes, and each planted error is found, in any units."""

import math
from pathlib import Path

import numpy as np
import pytest
from cli import assert_refused, hfa
from game_files import AT_15, stored
from planted_critics import gain, solved, value, weights_of

from controller import basis
from hfa import (
    BadInputError,
    Critic,
    Game,
    from_gain,
    from_value,
    from_weights,
    read_critic,
    solve,
    verify,
)
from hfa.main import BAD_INPUT

pytestmark = pytest.mark.usefixtures("folder")


def over_the_box(game, candidate, box=None):
    """Return name -> value of the checks of a critic in a box."""
    checks = verify(game, candidate, box=box, flights=1, limit_seconds=0.0).checks
    return {check.name: check.value for check in checks}


# Numbers of extreme size, wrong shapes, games without a solution.


REFUSED = {
    "W": (lambda game: from_weights(game, np.ones(20)), "20 weights"),
    "P": (lambda game: from_value(game, np.eye(5)), "P is 5 x 5"),
    "K": (lambda game: from_gain(game, np.ones((6, 5))), "K is 6 x 5.*such as the transpose of K"),
    "complex": (
        lambda game: from_value(game, np.eye(6) + 1j),
        "P does not consist of rows of real",
    ),
    "constant": (
        lambda game: from_weights(game, np.ones(21), constant=math.nan),
        "constant is nan",
    ),
    "array": (lambda game: verify(game, np.ones((2, 3))), "shape .2, 3."),
    "limit": (
        lambda game: verify(game, from_gain(game, gain(game)), limit=-1),
        "limit is -1; give",
    ),
    "object": (lambda game: verify(game, 3.0), "critic is 3.0; give "),
    "box": (lambda game: verify(game, gain(game), box=[1.0] * 5), "box is .*; give 6 positive"),
    "negative box": (lambda game: verify(game, gain(game), box=[1, 1, 1, 1, 1, 0]), "6 positive"),
    "flights": (lambda game: verify(game, gain(game), flights=-1), "flights is -1"),
    "seconds": (lambda game: verify(game, gain(game), limit_seconds=-1.0), "limit_seconds is -1"),
    "time": (
        lambda game: verify(game, solve(game.sampled(0.1))),
        "in discrete time, but the game is in continuous time",
    ),
    "no file": (lambda game: read_critic("none.npz", game), "(?i)no such file"),
}


@pytest.mark.parametrize("case", REFUSED)
def test_wrong_shapes_and_numbers_are_named(game, case):
    """Each wrong argument of `REFUSED` is refused in one line that names it."""
    call, says = REFUSED[case]
    with pytest.raises(BadInputError, match=says) as refusal:
        call(game)
    assert "\n" not in str(refusal.value)


def test_a_value_is_read_from_a_file_only_with_its_game(game):
    """A gain can be read from a file without a game. For a value, or a gain with units, a game is
    required.
    """
    np.savez("K.npz", K=gain(game))
    np.savez("P.npz", P=value(game))
    for file in ("K.npz", "P.npz"):
        assert verify(game, read_critic(file, game)).ok
        assert verify(game, file).ok
        assert verify(game, Path(file)).ok
    assert np.array_equal(read_critic("K.npz").K, gain(game))
    np.savez("in_SI.npz", K=gain(game), state_units=["m/s", *game.names.state_units[1:]])
    for file in ("P.npz", "in_SI.npz"):
        with pytest.raises(BadInputError, match=f"{file} cannot be read without"):
            read_critic(file)


def test_contradicting_parts_are_refused(game):
    """W and P that differ by 1e-4 are refused, and those that differ by 1e-7 are accepted."""
    P = value(game)
    words = ("verify", *AT_15, "--weights")
    apart, near = ((1.0 + error) * weights_of(P) for error in (1e-4, 1e-7))
    assert_refused(hfa(*words, stored("wp.npz", W=apart, P=P)), BAD_INPUT, "wp.npz", "W and P")
    assert hfa(*words, stored("wp.npz", W=near, P=P)).code == 0


# Errors in weights that are not quadratic, in directions without inputs, and in small entries are
# found.


R = np.array([[4.0, 1.0], [1.0, 9.0]])
RNG = np.random.default_rng(8)
A, B, E = (RNG.standard_normal((3, size)) for size in (3, 2, 1))
#: Game whose R is not diagonal, and the half-widths of a box of its states.
COUPLED = Game(A, B, E=E, Q=np.diag([1.0, 1e4, 1e-3]), R=R, delta=1e3)
WIDTHS = np.array([2.0, 0.5, 3.0])


def entry(difference, right):
    """Return the largest error of an entry, relative to it or to 1e-5 of the largest one."""
    least = 1e-5 * np.abs(right).max()
    return float((np.abs(difference) / np.maximum(np.abs(right), least)).max())


def input_error(largest):
    """Return the largest error of an input of `COUPLED`, in units of 1/√R_ii, relative to the
    largest exact input in the box.

    largest: largest error of each input in the box, (2,)
    """
    root = np.sqrt(np.diag(R))
    return entry(root * largest, root * (np.abs(solved(COUPLED).K) @ WIDTHS))


def test_errors_of_matrices_are_those_of_their_definitions():
    """The errors of a wrong K and P are relative norms, norms in balanced units U (R^(1/2) K U and
    U P U), those of entries, and the largest of V, its slopes, the inputs and the worst disturbance
    in a box.
    """
    exact = solved(COUPLED)
    units = verify(COUPLED, exact).box.half_widths  # balanced ones
    K = exact.K + 0.1 * RNG.standard_normal((2, 3))
    change = RNG.uniform(0.1, 0.2, (3, 3)) * np.abs(exact.P)
    symmetric = exact.P + change + change.T  # z'Pz depends on the symmetric part alone
    P = symmetric + 0.1 * (change - change.T)

    def balanced_norm(matrix):
        """Return the norm of R^(1/2) K U."""
        return float(np.sqrt(np.trace(units[:, None] * (matrix.T @ R @ matrix) * units)))

    both = np.outer(units, units)
    of_rows = np.sqrt(np.diag(R))[:, None] * units
    norm, box = np.linalg.norm, WIDTHS
    expected = {
        "K_rel_error": norm(K - exact.K) / norm(exact.K),
        "K_balanced_error": balanced_norm(K - exact.K) / balanced_norm(exact.K),
        "K_entry_error": entry((K - exact.K) * of_rows, exact.K * of_rows),
        "P_rel_error": norm(P - exact.P) / norm(exact.P),
        "P_balanced_error": norm((P - exact.P) * both) / norm(exact.P * both),
        "P_entry_error": entry((P - exact.P) * both, exact.P * both),
        "policy_rel_error": input_error(np.abs(K - exact.K) @ box),
        "value_rel_error": (box @ (symmetric - exact.P) @ box) / (box @ np.abs(exact.P) @ box),
        "gradient_rel_error": entry(
            box * ((symmetric - exact.P) @ box), box * (np.abs(exact.P) @ box)
        ),
        "disturbance_rel_error": entry(
            np.abs(E.T @ (symmetric - exact.P)) @ box, np.abs(E.T @ exact.P) @ box
        ),
    }
    found = over_the_box(COUPLED, Critic(K, P, "P and K"), box)
    assert {name: found[name] for name in expected} == pytest.approx(expected, rel=1e-9)


def test_terms_that_are_not_quadratic_count_in_a_box_ten_times_as_large_or_small():
    """Errors hold in each box from 1/10 to 10 times the given one, relative to the quadratic V*: a
    term of degree 4 counts 10² times, in the largest one, and one of degree 1 ten times, in the
    smallest.
    """
    exact, box = solved(COUPLED), WIDTHS
    size = box @ np.abs(exact.P) @ box
    quartic = basis("quadratic+quartic", 3)
    weights = quartic.weights(exact.P)
    weights[-1] = 1e-3  # V has the term 1e-3 z⁴ of the last state, with the slope 4e-3 z³
    found = over_the_box(COUPLED, from_weights(COUPLED, weights, quartic), box)
    # At the edge of the box, z = 3; in the largest box, relative to V*, 10² times as large.
    slopes = 4e-3 * 3.0**3 * 10.0**2 * np.eye(3)[2]
    expected = {
        "policy_rel_error": input_error(np.abs(np.linalg.solve(R, B.T) @ slopes) / 2.0),
        "value_rel_error": 1e-3 * 3.0**4 * 10.0**2 / size,
        "gradient_rel_error": entry(box * slopes, 2.0 * box * (np.abs(exact.P) @ box)),
        "disturbance_rel_error": entry(np.abs(E.T @ slopes) / 2.0, np.abs(E.T @ exact.P) @ box),
    }
    assert {name: found[name] for name in expected} == pytest.approx(expected, rel=1e-9)
    linear = basis("quadratic+linear", 3)
    weights = linear.weights(exact.P)
    weights[-1] = 1e-3  # V has the term 1e-3 z of the last state
    found = over_the_box(COUPLED, from_weights(COUPLED, weights, linear), box)
    assert found["value_rel_error"] == pytest.approx(1e-3 * 3.0 * 10.0 / size, rel=1e-9)
