"""A plant that is stable by itself, and nothing paid for: value 0 and no input, both certified."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from cli import answer
from game_files import checks_of, stored

from controller import Game
from hfa_cli.main import FAILED
from verification import solve_game

STABLE: dict[str, Any] = {
    "A": np.array([[-1.0, 0.2], [0.1, -1.0]]),
    "B": np.array([[1.0], [1.0]]),
    "E": np.eye(2),
    "Q": np.zeros((2, 2)),
    "R": np.eye(1),
    "delta": 2.0,
}


pytestmark = pytest.mark.usefixtures("folder")


def test_the_value_is_exactly_0() -> None:
    data = answer("solve", "--model", stored("plant.npz", **STABLE))
    assert np.array_equal(data["P"], np.zeros((2, 2)))
    assert np.array_equal(data["K"], np.zeros((1, 2)))
    assert data["certificate"]["ok"] is True
    assert (data["delta_min"], data["delta_margin"]) == (0.0, None)
    assert {"cost_lyapunov", "l2_gain"} <= {check["name"] for check in data["meaning"]}


@pytest.mark.parametrize("key", ["P", "K"])
def test_the_judge_takes_0_and_nothing_else(key: str) -> None:
    plant = stored("plant.npz", **STABLE)
    shape = (2, 2) if key == "P" else (1, 2)
    assert answer("verify", "--model", plant, "--weights", stored("zero.npz", **{key: np.zeros(shape)}))["ok"] is True
    wrong = stored("wrong.npz", **{key: 1e-3 * np.eye(*shape)})
    assert {"policy_rel_error", "K_rel_error"} <= {
        name
        for name, check in checks_of(answer("verify", "--model", plant, "--weights", wrong, code=FAILED)).items()
        if not check["ok"]
    }


def test_a_plant_that_must_be_stabilized_has_another_value() -> None:
    """0 is a root then too, but not the one whose policy brings the state to rest: a P = 2 a / s."""
    game = Game(np.eye(1), np.eye(1), np.zeros((1, 0)), np.zeros((1, 1)), np.eye(1), np.inf)
    assert solve_game(game).P[0, 0] == pytest.approx(2.0, rel=1e-12)
