"""Exchange of files with other tools: plants, gains, and tables for pandas and polars."""

import importlib.util

import numpy as np
import pytest
from cli import hfa

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
