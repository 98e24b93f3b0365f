"""A critic over time: what is refused, and what belongs to which row."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from controller import History
from hfa_support import BadInputError

TIMES = np.array([0.0, 0.5, 1.0])
ROWS = np.arange(9.0).reshape(3, 3)


def changed(place: tuple[int, int], value: float) -> np.ndarray:
    rows = ROWS.copy()
    rows[place] = value
    return rows


@pytest.mark.parametrize(
    ("content", "said"),
    [
        ({"times": [0.0, 1.0, 0.5], "W": ROWS}, "time goes from 1 to 0.5 s at row 3; it must increase"),
        ({"times": [-1.0, 0.0, 1.0], "W": ROWS}, "time is negative, and a predefined time counts from 0, at row 1"),
        ({"times": [0.0, 0.0, 0.5], "W": ROWS}, "from 0 to 0 s at row 2"),
        ({"times": [0.0, np.nan, 0.5], "W": ROWS}, "time is not finite at row 2"),
        ({"times": TIMES, "W": changed((1, 2), np.nan)}, r"W is not finite at row 2 \(t = 0.5 s\)"),
        ({"times": TIMES, "W": changed((2, 0), np.inf)}, "W is not finite at row 3"),
        ({"times": TIMES, "W": changed((2, 0), 1e60)}, r"W has an entry beyond 1e\+50 at row 3"),
        ({"times": TIMES[:2], "W": ROWS}, "W has 3 rows and there are 2 times"),
        ({"times": ROWS, "W": ROWS}, "time has shape"),
        ({"times": [], "W": ROWS}, "time has shape"),
        ({"times": TIMES, "W": [[1.0], [1.0, 2.0]]}, "W does not consist of rows of real numbers"),
        ({"times": TIMES, "W": ROWS * 1j}, "W does not consist of rows of real numbers"),
        ({"times": TIMES, "K": np.eye(3)}, "a history needs W"),
    ],
)
def test_what_is_no_history_is_refused(content: dict[str, Any], said: str) -> None:
    with pytest.raises(BadInputError, match=said):
        History(**content)


def test_a_single_matrix_belongs_to_the_last_row() -> None:
    history = History(TIMES, W=ROWS, K=np.eye(3))
    assert (history.row(-1).K, history.last.P) == (None, None)
    np.testing.assert_array_equal(history.last.K, np.eye(3))
    np.testing.assert_array_equal(history.row(1).W, ROWS[1])
    np.testing.assert_array_equal(history.last.W, ROWS[2])
