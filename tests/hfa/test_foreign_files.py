"""Exchange of files with other tools: plants, gains, and tables for pandas and polars."""

import importlib.util

import numpy as np
import pytest
from cli import answer, assert_refused, hfa
from game_files import stored

from hfa.main import BAD_INPUT


@pytest.mark.parametrize("dt", [np.ones((2, 4)), -0.1, np.nan, "fast"], ids=str)
@pytest.mark.usefixtures("folder")
def test_an_entry_dt_that_is_no_sample_time_is_refused(dt):
    """`solve`, `linearize`, `verify` and `assess` refuse such a plant or gain in one line."""
    plant = {"A": [[0.0, 1.0], [2.0, -0.3]], "B": [[0.0], [1.0]], "Q": np.eye(2), "R": [[1.0]]}
    np.savez("right.npz", **plant)
    np.savez("plant.npz", **plant, dt=dt)
    np.savez("gain.npz", K=[[8.0, 4.0]], dt=dt)
    own = ("--model", "right.npz")
    commands = [
        ("solve", "--model", "plant.npz"),
        ("linearize", "--aircraft", "plant.npz"),
        ("verify", *own, "--weights", "gain.npz"),
    ]
    if importlib.util.find_spec("hfa_flight"):
        commands.append(("assess", "gain.npz", "--aircraft", "right.npz", "--sample-time", "0.1"))
    for words in commands:
        result = hfa(*words)
        assert (result.code, result.out) == (BAD_INPUT, "")
        assert len(result.err.splitlines()) == 1
        assert ".npz: dt " in result.err


@pytest.mark.usefixtures("folder")
def test_a_plant_of_the_papers_shape_has_no_weights_of_the_paper():
    """Six states and five inputs without the paper's names are another plant: Q is asked for."""
    values = np.random.default_rng(1)
    file = stored("foreign.npz", A=values.normal(size=(6, 6)), B=values.normal(size=(6, 5)))
    assert_refused(hfa("solve", "--model", file), 2, "there is no Q")


#: A plant without weights, and a game on it.
PLANT = {"A": [[0.0, 1.0], [2.0, -0.3]], "B": [[0.0], [1.0]]}
OF_GAME = ("--Q", "10,1", "--R", ".1", "--delta", "30")


@pytest.mark.usefixtures("folder")
def test_a_critics_file_has_its_game():
    """`verify` judges a learned file on its own Q, R and delta. Beside others, these are the reason."""
    plant = stored("plant.json", **PLANT)
    assert hfa("learn", "--model", plant, *OF_GAME, "-o", "learned.npz").code == 0
    words = ("verify", "--model", plant, "--weights", "learned.npz")
    own = answer(*words)
    assert (own["ok"], own["delta"]) == (True, 30.0)
    assert own["weights_from"] == dict.fromkeys(("Q", "R", "delta"), "critic")
    other = answer(*words, "--Q", "1,1", code=1)
    assert other["weights_from"]["Q"] == "given"
    assert other["diagnosis"] == "Q of the file is not that of the game"
    three = stored("K.npz", K=np.ones((1, 2)), Q=np.eye(3), R=np.eye(1))
    assert_refused(hfa(*words[:-1], three), 2, "Q")
