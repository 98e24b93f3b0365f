"""Reading of critic files with W, P and K, and refusal of faulty files."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from game_files import stored

from controller import basis, critic_in
from hfa import BadInputError, Game
from hfa.extend import Reading

#: Game with two states and two inputs: 3 weights, 4 entries of P and of K.
GAME = Game(
    [[0.0, 1.0], [-2.0, -3.0]],
    [[0.0, 1.0], [1.0, 3.0]],
    np.eye(2),
    [[2.0, 0.0], [0.0, 1.0]],
    [[4.0, 1.0], [1.0, 2.0]],
    10.0,
)
I2 = np.eye(2)
W = np.arange(9.0).reshape(3, 3)
K = np.arange(12.0).reshape(3, 2, 2)
pytestmark = pytest.mark.usefixtures("folder")


STEPS = replace(GAME, A=0.2 * GAME.A, dt=True)
SKEW = np.eye(4) + np.triu(np.ones((4, 4)), 1)


@pytest.mark.parametrize(
    ("game", "content", "message"),
    [
        (GAME, {"A": np.eye(2)}, r"the file contains no W, P or K; .* \(found: A\)"),
        (GAME, {"W": [[1.0, 2.0], [3.0, 4.0]]}, r"W has shape .2, 2., one for each time"),
        (GAME, {"P": [1.0, 2.0]}, "the number of dimensions of P is 1; give 2"),
        (GAME, {"P": np.ones((4, 2, 2))}, "one for each time; give one"),
        (GAME, {"K": np.ones((4, 2, 2))}, "K has three dimensions"),
        (GAME, {"P": I2, "policy_weights": np.ones((2, 4))}, "give a column for each monomial"),
        (GAME, {"P": I2, "policy_weights": np.ones((1, 2))}, "give one for each of the 2 inputs"),
        (GAME, {"W": [1.0], "basis": "__import__('os')"}, "is not supported; use x1 to x2"),
        (GAME, {"W": np.ones(5), "basis": ["quadratic", "paper"]}, "entry basis is not one name"),
        (STEPS, {"H": np.eye(5)}, r"give 4 x 4 over \(x, u\) or 6 x 6 over \(x, u, w\)"),
        (STEPS, {"H": SKEW}, r"\(row 1, column 2\); give \(H \+ H'\)/2"),
        (STEPS, {"H": np.diag([1.0, 1.0, 1.0, 0.0])}, "is singular"),
    ],
)
def test_bad_entries_are_refused_in_one_line(game: Game, content: Any, message: str) -> None:
    """Each faulty critic file is refused by one line that names the file and the fault."""
    with pytest.raises(BadInputError, match=f"^a.json: .*{message}") as refusal:
        critic_in(stored("a.json", **content), game)
    assert "\n" not in str(refusal.value)


@pytest.mark.parametrize(
    ("name", "n", "says"), [("quadratic", 0, "0 st"), ("paper", 4, "6 states")]
)
def test_a_basis_needs_its_states(name: str, n: int, says: str) -> None:
    with pytest.raises(BadInputError, match=says):
        basis(name, n)


@pytest.mark.parametrize("has_gain", [False, True])
def test_a_value_with_a_policy_of_its_own_keeps_both(has_gain: bool) -> None:
    """A polynomial policy in a file stands beside the value of its weights; so does a gain."""
    x, y = z = np.array([0.4, -0.3])
    rows = np.array([[1.0, -2.0, 0.5, 0.0, 3.0], [0.3, 0.7, 0.0, 0.0, 0.0]])
    policy = {"K": -rows[:, :2]} if has_gain else {"policy_weights": rows}
    critic = critic_in(stored("both.npz", W=np.array([1.0, 0.2, 3.0]), **policy), GAME)
    terms = np.array([x, y, x * x, x * y, y * y])
    assert critic.u(z) == pytest.approx(rows[:, :2] @ z if has_gain else rows @ terms)
    assert critic.value is not None
    assert float(critic.value(z)) == pytest.approx(terms[2:] @ [1.0, 0.2, 3.0])


def test_the_files_basis_applies_unless_another_is_named() -> None:
    """The basis named in a critic file applies unless the caller names another basis."""
    single = stored("w.npz", W=np.arange(5.0), basis="quadratic+linear")
    found = critic_in(single, GAME).basis
    assert found is not None
    assert found.name == "quadratic+linear"
    with pytest.raises(
        BadInputError, match="W has 5 weights, but basis 'quadratic' of 2 states has 3"
    ):
        critic_in(single, GAME, reading=Reading("quadratic"))
    listed = critic_in(stored("f.npz", W=[1.0, 2.0], basis="x1**2, x2**4"), GAME)
    assert listed.value is not None
    assert float(listed.value([3.0, 2.0])) == 9.0 + 32.0
    np.savez("P.npz", P=np.eye(2), basis=["of", "another", "program"])
    assert np.array_equal(critic_in("P.npz", GAME).P, np.eye(2))
    with pytest.raises(BadInputError, match="add W, or give --basis a name"):
        critic_in("P.npz", GAME, reading=Reading("x1**2, x2**2"))
