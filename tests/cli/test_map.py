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


def test_the_command_draws_the_map_of_both_sets_of_equations(tmp_path: Path) -> None:
    picture, table = tmp_path / "map.svg", tmp_path / "map.csv"
    result = hfa(*MAP, "--command", "dihedral=-10,10", "--picture", str(picture), "-o", str(table))
    assert (result.code, result.err) == (0, "")
    assert "published dynamics" in result.out
    assert "newton dynamics" in result.out
    assert "pitch_rate at" in result.out
    assert picture.read_text(encoding="utf-8").startswith("<?xml")
    assert len(table.read_text(encoding="utf-8").splitlines()) == 1 + 2 * 2 * 9


def test_the_map_needs_no_picture_and_takes_a_gain(tmp_path: Path, gain: np.ndarray) -> None:
    words = (*MAP[:3], *MAP[5:], "--command", "dihedral=0", "--weights", stored(tmp_path / "K.npz", K=gain))
    result = hfa(*words, "-o", str(tmp_path / "map.json"))
    told = result.out
    assert result.err == ""
    assert told.startswith(f"How far from trim u = -K z works, dihedral 15 deg, law gain of {tmp_path / 'K.npz'}\n")
    said = json.loads((tmp_path / "map.json").read_text(encoding="utf-8"))
    assert (said["schema"], said["warnings"]) == ("hfa.recoverable-map/1", [])
    assert said["maps"]["newton"]["nonlinear"]["held"][1] == [False, True, False]
