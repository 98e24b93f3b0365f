"""Files with a critic over time: the same history from each format, one line for what is none."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from game_files import stored

from controller import Game, History, load_history
from controller.game import critic_file
from controller.game.array_file import read_arrays
from controller.game.critic_file import critic_in
from controller.game.history import StoredCritic
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


@pytest.mark.parametrize("suffix", ["npz", "mat", "json"])
@pytest.mark.parametrize(
    "content",
    [
        {"time": TIMES, "W": W},
        {"times": TIMES, "weights": W, "other": 1.0},
        {"t": TIMES, "W": W, "K": K},
        {"t": TIMES, "W": W, "gains": np.moveaxis(K, 0, -1)},
        {"t": TIMES, "W": W, "K": K.reshape(3, 2)},
    ],
)
def test_arrays_by_name(suffix: str, content: dict[str, Any]) -> None:
    history = load_history(stored(f"h.{suffix}", **content), GAME)
    assert history is not None
    np.testing.assert_array_equal(history.times, TIMES)
    np.testing.assert_array_equal(history.W, W)
    if len(content) == 3 and "other" not in content:
        np.testing.assert_array_equal(history.K, K)


@pytest.mark.parametrize(
    ("values", "first", "name"),
    [(W, "", "W"), (W, "t [s],W1,W2,W3\n", "W"), (K, "time,K11,K12\n", "K"), (K, "", "K"), (W, "t,a,b,c\n", "W")],
)
def test_columns(values: np.ndarray, first: str, name: str) -> None:
    history = load_history(written(lines(values, first)), GAME)
    np.testing.assert_array_equal(getattr(history, name), values)


def test_columns_of_other_things_are_left_out() -> None:
    """As `hfa learn -o run.csv` writes them, with its origin in the last column."""
    rows = [f"{t},9,{a},{b},{c},{{}}" for t, (a, b, c) in zip(TIMES, W, strict=True)]
    history = load_history(written("\n".join(["time,residual,W1,W2,W3,about", *rows])), GAME)
    np.testing.assert_array_equal(history.W, W)


def test_a_file_without_times_is_a_single_critic() -> None:
    assert load_history(stored("h.npz", W=W[0], P=np.eye(2)), GAME) is None
    assert load_history(stored("h.npz", P=np.eye(2), t=TIMES), GAME) is None


def test_the_file_names_the_basis_unless_somebody_does() -> None:
    path = stored("h.npz", time=TIMES, weights=np.ones((3, 5)), basis="quadratic+linear")
    assert load_history(path, GAME).basis == "quadratic+linear"
    with pytest.raises(BadInputError, match=r"W is 3 x 5; basis 'quadratic' on 2 states has 3 weights"):
        load_history(path, GAME, "quadratic")


@pytest.mark.parametrize(
    ("text", "said"),
    [
        (lines(W).replace("0.1", "-0.1"), "h.csv: time goes from 0 to -0.1 s at row 2"),
        (lines(W).replace("4.0", "nan"), r"h.csv: W is not finite at row 2 \(t = 0.1 s\)"),
        (lines(W).replace("4.0", "four"), "h.csv: line 2, column 3 is 'four'; give a number"),
        (lines(W).replace("4.0,", ""), "h.csv: line 2 has 3 columns, the first one has 4"),
        (lines(W[:, :1]), "h.csv: there are 1 columns beside the time; K is 1 x 2; P is 2 x 2; basis 'quadratic'"),
        (lines(K, "time,W1,W2\n"), "h.csv: there are 2 columns beside the time; basis 'quadratic' on 2 states has 3"),
        (lines(W, "W1,W2,W3,W4\n"), "h.csv: the first column is 'W1'; it must be the time"),
        (",x1,x2\nx1,1,2\n", "h.csv: the first column is ''; .* a matrix without times goes into a file called P.csv"),
        ("1,2\n3,4\n5,6\n", "h.csv: there are 1 columns .* a matrix without times goes into a file called P.csv"),
        (lines(W).replace(",", ";"), "h.csv: the first column is '0.0;0.0;1.0;2.0'; it must be the time, with commas"),
        (lines(W, "t,W1,W2,K3\n"), "h.csv: the columns are of K and W; give one of them"),
        ("time,W1,W2,W3\n", "h.csv: there are no rows of numbers"),
        ("", "h.csv: there are no rows of numbers"),
    ],
)
def test_what_is_no_history_is_refused_with_its_place(text: str, said: str) -> None:
    with pytest.raises(BadInputError, match="^" + said):
        load_history(written(text), GAME)


def test_columns_that_fit_two_kinds_are_to_be_named() -> None:
    one = Game(-np.eye(1), np.eye(1), np.eye(1), np.eye(1), np.eye(1), 10.0)
    with pytest.raises(BadInputError, match="1 columns may be K or P or W; name them"):
        load_history(written(lines(W[:, :1])), one)
    assert load_history(written(lines(W[:, :1], "t,k\n")), one).K.shape == (3, 1, 1)


@pytest.mark.parametrize("name", ["none.csv", "none.npz", "."])
def test_no_file_is_one_line(name: str) -> None:
    with pytest.raises(BadInputError, match=r"there is no such file|is not known"):
        load_history(name, GAME)


def test_a_critic_is_read_once_whether_it_is_over_time_or_not(monkeypatch: pytest.MonkeyPatch) -> None:
    opened = []
    monkeypatch.setattr(critic_file, "read_arrays", lambda path: opened.append(path) or read_arrays(path))
    assert isinstance(critic_in(stored("once.npz", K=K[0]), GAME), StoredCritic)
    assert isinstance(critic_in(stored("rows.npz", K=K, time=TIMES), GAME), History)
    assert opened == ["once.npz", "rows.npz"]


@pytest.mark.parametrize(
    ("content", "said"),
    [
        ({"t": [[0.0], 1.0], "W": W.tolist()}, "time does not consist of rows of real numbers"),
        ({"t": TIMES.tolist(), "W": W.tolist(), "basis": []}, "basis must be one name, such as 'quadratic'"),
        ({"t": TIMES.tolist(), "W": W.tolist(), "basis": [["quadratic"], "a"]}, "basis must be one name"),
        ({"t": TIMES.tolist(), "W": W.tolist(), "basis": 5}, "basis must be one name"),
    ],
)
def test_times_and_a_basis_that_are_none_are_refused(content: dict[str, Any], said: str) -> None:
    with pytest.raises(BadInputError, match=f"^h.json: {said}"):
        load_history(stored("h.json", **content), GAME)
    if "basis" in content:
        assert load_history("h.json", GAME, "quadratic") is not None
