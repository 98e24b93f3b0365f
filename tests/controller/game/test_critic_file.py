"""Files with a critic over time: the same history from each format, one line for anything else."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from game_files import stored

from controller import Game, History
from controller.game.critic_file import StoredCritic, critic_in
from hfa_support import BadInputError

#: Two states, one input: 3 weights, 4 entries of P, 2 of K.
GAME = Game(np.array([[0.0, 1.0], [-1.0, -1.0]]), np.array([[0.0], [1.0]]), np.eye(2), np.eye(2), np.eye(1), 10.0)
TIMES = np.array([0.0, 0.1, 0.3])
W = np.arange(9.0).reshape(3, 3)
K = np.arange(6.0).reshape(3, 1, 2)


pytestmark = pytest.mark.usefixtures("folder")


def written(text: str) -> str:
    Path("h.csv").write_text(text, encoding="utf-8")
    return "h.csv"


def lines(values: np.ndarray, first: str = "") -> str:
    rows = np.column_stack([TIMES, values.reshape(3, -1)]).tolist()
    return first + "\n".join(",".join(map(repr, row)) for row in rows) + "\n"


@pytest.mark.parametrize("suffix", ["npz", "json"])
def test_arrays_by_name(suffix: str) -> None:
    for content in (
        {"times": TIMES, "weights": W, "other": 1.0},
        {"t": TIMES, "W": W, "K": K},
        {"time": TIMES, "W": W, "gains": np.moveaxis(K, 0, -1)},
        {"t": TIMES, "W": W, "K": K.reshape(3, 2)},
    ):
        history = critic_in(stored(f"h.{suffix}", **content), GAME)
        assert isinstance(history, History)
        np.testing.assert_array_equal(history.times, TIMES)
        np.testing.assert_array_equal(history.W, W)
        if "other" not in content:
            np.testing.assert_array_equal(history.K, K)


@pytest.mark.parametrize(
    ("values", "first", "name"),
    [(W, "", "W"), (W, "t [s],W1,W2,W3\n", "W"), (K, "time,K11,K12\n", "K"), (K, "", "K"), (W, "t,a,b,c\n", "W")],
)
def test_columns(values: np.ndarray, first: str, name: str) -> None:
    history = critic_in(written(lines(values, first)), GAME)
    np.testing.assert_array_equal(getattr(history, name), values)


def test_columns_of_other_things_are_left_out() -> None:
    """As `hfa learn -o run.csv` writes them, with its origin in the last column."""
    rows = [f"{t},9,{a},{b},{c},{{}}" for t, (a, b, c) in zip(TIMES, W, strict=True)]
    history = critic_in(written("\n".join(["time,residual,W1,W2,W3,about", *rows])), GAME)
    np.testing.assert_array_equal(history.W, W)


def test_a_file_without_times_is_a_single_critic() -> None:
    for times in ({}, {"t": TIMES}):
        assert isinstance(critic_in(stored("h.npz", W=W[0], P=np.eye(2), **times), GAME), StoredCritic)


def test_the_file_names_the_basis_unless_somebody_does() -> None:
    path = stored("h.npz", time=TIMES, weights=np.ones((3, 5)), basis="quadratic+linear")
    assert critic_in(path, GAME).basis == "quadratic+linear"
    with pytest.raises(BadInputError, match=r"W is 3 x 5; basis 'quadratic' on 2 states has 3 weights"):
        critic_in(path, GAME, "quadratic")


@pytest.mark.parametrize(
    ("text", "said"),
    [
        (lines(W).replace("0.1", "-0.1"), "h.csv: time goes from 0 to -0.1 s at row 2"),
        (lines(W).replace("4.0", "nan"), r"h.csv: W is not finite, or beyond 1e\+50, at row 2 \(t = 0.1 s\)"),
        (lines(W).replace("4.0", "four"), "h.csv: .*the table has 'four' in row 2 of numbers, column 3; give numbers"),
        (lines(K, "time,W1,W2\n"), "h.csv: W is 3 x 2; basis 'quadratic' on 2 states has 3 weights"),
        (lines(W, "W1,W2,W3,W4\n"), "h.csv: .*the first column is 'W1'; it must be the time"),
    ],
)
def test_what_is_no_history_is_refused_with_its_place(text: str, said: str) -> None:
    with pytest.raises(BadInputError, match="^" + said):
        critic_in(written(text), GAME)


def test_columns_that_fit_two_kinds_are_to_be_named() -> None:
    one = Game(-np.eye(1), np.eye(1), np.eye(1), np.eye(1), np.eye(1), 10.0)
    with pytest.raises(BadInputError, match="the 1 columns beside the time may be W or P or K; name them"):
        critic_in(written(lines(W[:, :1])), one)
    assert critic_in(written(lines(W[:, :1], "t,K1\n")), one).K.shape == (3, 1, 1)


# Histories made in Python ------------------------------------------------------------------------------------------

EVEN = np.array([0.0, 0.5, 1.0])
ROWS = np.arange(9.0).reshape(3, 3)


@pytest.mark.parametrize(
    ("content", "said"),
    [
        ({"times": [0.0, 1.0, 0.5], "W": ROWS}, "time goes from 1 to 0.5 s at row 3; it must increase"),
        ({"times": [-1.0, 0.0, 1.0], "W": ROWS}, "time is negative or not finite at row 1"),
        ({"times": EVEN, "W": ROWS * [[1.0], [np.inf], [1.0]]}, r"W is not finite, .* at row 2 \(t = 0.5 s\)"),
        ({"times": EVEN, "W": ROWS * [[1.0], [1.0], [1e60]]}, r"W is not finite, or beyond 1e\+50, at row 3"),
        ({"times": EVEN[:2], "W": ROWS}, "W has 3 rows and there are 2 times"),
        ({"times": EVEN, "K": np.eye(3)}, "a history needs W"),
    ],
)
def test_what_is_no_history_is_refused(content: dict[str, Any], said: str) -> None:
    with pytest.raises(BadInputError, match=said):
        History(**content)


def test_a_single_matrix_belongs_to_the_last_row() -> None:
    history = History(EVEN, W=ROWS, K=np.eye(3))
    assert (history.row(2).K, history.row(-1).P) == (None, None)
    np.testing.assert_array_equal(history.row(-1).K, np.eye(3))
    np.testing.assert_array_equal(history.row(1).W, ROWS[1])
    np.testing.assert_array_equal(history.row(-1).W, ROWS[2])
