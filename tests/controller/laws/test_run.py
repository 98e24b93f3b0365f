"""The runner of laws, with a law that is nobody's: what is kept of it, and what is said on the way."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
import pytest

from controller import run
from controller.laws import run as runner


class Counting:
    """x = 0, 1, 2, ..."""

    def __init__(self, ticks: int, **also: float) -> None:
        self.ticks, self._also = ticks, also

    def start(self) -> dict[str, np.ndarray]:
        return {"x": np.zeros(2)}

    def advance(self, tick: int, memory: dict[str, np.ndarray]) -> dict[str, np.ndarray]:
        assert memory["x"][0] == tick
        return {"x": memory["x"] + 1.0}

    def observe(self, tick: int, memory: dict[str, np.ndarray]) -> Mapping[str, Any]:
        return {"time": 0.5 * tick, "weights": memory["x"], **self._also}


def test_every_row_is_kept_with_the_start_and_the_end() -> None:
    found = run(Counting(10))
    assert sorted(found.history) == ["time", "weights"]
    np.testing.assert_array_equal(found.history["time"], 0.5 * np.arange(11))
    np.testing.assert_array_equal(found.history["weights"], np.tile(np.arange(11.0)[:, None], (1, 2)))
    np.testing.assert_array_equal(found.memory["x"], [10.0, 10.0])


def test_of_a_long_run_rows_are_kept_evenly_and_the_last_always(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(runner, "MOST_ROWS", 5)
    assert run(Counting(10)).history["time"].tolist() == [0.0, 1.5, 3.0, 4.5, 5.0]


@pytest.mark.parametrize(
    ("also", "line"),
    [({}, "t = 1 s"), ({"law_residual_norm": 0.25}, "t = 1 s, residual of the law 0.25")],
)
def test_the_progress_says_the_residual_where_a_law_has_one(also: dict[str, float], line: str) -> None:
    told: list[tuple[float, str]] = []
    run(Counting(2, **also), progress=lambda fraction, _, text: told.append((fraction, text)))
    assert told[-1] == (1.0, line)
    assert len(told) == 2
