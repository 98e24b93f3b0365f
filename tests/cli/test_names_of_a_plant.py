"""A plant that `hfa linearize` wrote keeps its names in every command that reads it."""

from __future__ import annotations

import json
from pathlib import Path

import pytest
from cli import hfa

from hfa_model import INPUTS, LINEAR_STATES


@pytest.mark.parametrize("suffix", ["json", "npz"])
@pytest.mark.parametrize("command", ["solve", "learn", "verify"])
def test_a_linear_model_keeps_its_names(tmp_path: Path, command: str, suffix: str) -> None:
    plant = tmp_path / f"plant.{suffix}"
    assert hfa("linearize", "--dihedral", "12", "-o", str(plant)).code == 0
    found = json.loads(hfa(command, "--model", str(plant), "--json").out)
    assert (tuple(found["states"]), tuple(found["inputs"])) == (LINEAR_STATES, INPUTS)
    assert found["state_units"][:2] == ["ft/s", "rad"]


def test_names_that_do_not_fit_are_left_aside(tmp_path: Path) -> None:
    plant = tmp_path / "plant.json"
    data = {"A": [[-1.0]], "B": [[1.0]], "Q": [[1.0]], "R": [[1.0]], "states": ["a", "b"], "inputs": [3]}
    plant.write_text(json.dumps(data), encoding="utf-8")
    found = json.loads(hfa("solve", "--model", str(plant), "--json").out)
    assert (found["states"], found["inputs"], found["state_units"]) == (["x1"], ["u1"], [""])
