"""`hfa map`: the recoverable set of both sets of equations, and refused input."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest
from cli import hfa
from game_files import stored

from verification.flights import recoverable_map as recoverable

MAP = ("map", "--dihedral", "15", "--law", "exact", "--initial", "speed=-1:1:1", "--initial", "dihedral=-10:10:10")


@pytest.fixture(autouse=True)
def _coarse_edges(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(recoverable, "_SCAN", 6)
    monkeypatch.setattr(recoverable, "_HALVINGS", 3)  # test_recoverable_map.py has them as fine as they are


@pytest.mark.slow
def test_the_command_draws_the_map_of_both_sets_of_equations(tmp_path: Path, gain: np.ndarray) -> None:
    picture, table = tmp_path / "map.svg", tmp_path / "map.csv"
    words = (*MAP[:3], *MAP[5:], "--command", "dihedral=-10,10", "--weights", stored(tmp_path / "K.npz", K=gain))
    result = hfa(*words, "--picture", str(picture), "-o", str(table), "--json")
    assert (result.code, result.err) == (0, "")
    said = json.loads(result.out)
    assert (said["schema"], list(said["maps"])) == ("hfa.recoverable-map/1", ["published", "newton"])
    assert said["maps"]["newton"]["nonlinear"]["held"][1] == [False, True, False]
    assert "pitch_rate" in {edge["state"] for edge in said["maps"]["newton"]["edges"]}
    assert picture.read_text(encoding="utf-8").startswith("<?xml")
    assert len(table.read_text(encoding="utf-8").splitlines()) == 1 + 2 * 2 * 9
