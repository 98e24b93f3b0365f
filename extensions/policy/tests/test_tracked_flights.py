"""`hfa assess --reference`: a sampled policy that tracks a command, and refusals."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from cli import answer, hfa
from known_models import game_at

from hfa import solve

AT_15 = ("--dihedral", "15", "--dynamics", "newton")
COMMAND = ("--reference", "dihedral=1+0.5sin(0.3t)")


@pytest.fixture
def gain(folder: Path) -> str:
    np.savez(folder / "K.npz", K=solve(game_at(15.0, "newton")).K)
    return "K.npz"


@pytest.mark.slow
def test_a_fast_sampled_gain_tracks_as_the_continuous_one(gain: str) -> None:
    """With a short sample time, the errors with and without feedforward are those of `hfa fly`."""
    words = ("assess", gain, "--sample-time", "0.005", "--samples", "0", *AT_15, *COMMAND)
    sampled = answer(*words)
    flown = answer("fly", *AT_15, "--law", "exact", *COMMAND)
    for key in ("late_rms_errors", "late_rms_errors_without_feedforward"):
        assert np.array(sampled[key]) == pytest.approx(np.array(flown[key]), rel=0.02)
    assert sampled["tracking"]["reachable"] is True


def test_several_trims_and_unknown_states_are_refused(gain: str) -> None:
    words = ("assess", gain, "--sample-time", "0.01", "--samples", "0")
    for more in (("--dihedral", "10,15", *COMMAND), (*AT_15, "--reference", "gamma=1")):
        result = hfa(*words, *more)
        assert (result.code, result.out, result.err.count("\n")) == (2, "", 1)
        assert "--reference" in result.err
