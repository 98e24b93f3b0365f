"""A plant that `hfa linearize` wrote keeps its names in every command that reads it."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest
from cli import hfa
from scipy.io import savemat

from hfa_model import INPUTS, LINEAR_STATES


@pytest.mark.parametrize(
    ("command", "suffix"), [("solve", "json"), ("solve", "npz"), ("solve", "mat"), ("learn", "npz"), ("verify", "mat")]
)
def test_a_linear_model_keeps_its_names(tmp_path: Path, command: str, suffix: str) -> None:
    plant = tmp_path / f"plant.{suffix}"
    assert hfa("linearize", "--dihedral", "12", "-o", str(plant)).code == 0
    found = json.loads(hfa(command, "--model", str(plant), "--json").out)
    assert (tuple(found["states"]), tuple(found["inputs"])) == (LINEAR_STATES, INPUTS)
    assert found["state_units"][:2] == ["ft/s", "rad"]
    assert found["plant_provenance"]["parameters"] == "identified"
    assert found["plant_provenance"]["command"].startswith("hfa linearize --dihedral 12 -o ")


def test_names_that_do_not_fit_are_left_aside(tmp_path: Path) -> None:
    plant = tmp_path / "plant.json"
    data = {"A": [[-1.0]], "B": [[1.0]], "Q": [[1.0]], "R": [[1.0]], "states": ["a", "b"], "inputs": [3]}
    plant.write_text(json.dumps(data), encoding="utf-8")
    result = hfa("solve", "--model", str(plant), "--json")
    found = json.loads(result.out)
    assert (found["states"], found["inputs"], found["state_units"]) == (["x1"], ["u1"], [""])
    for key, letter in (("states", "x"), ("inputs", "u")):
        assert f"hfa: note: {plant}: {key} has not one name for each; they are called {letter}1 and so on" in result.err


def test_a_structure_of_a_mat_file_is_read(tmp_path: Path) -> None:
    path, plain = tmp_path / "plant.mat", {"A": -np.eye(2), "B": np.ones((2, 1)), "Q": np.eye(2), "R": np.eye(1)}
    names = np.array(["height", "rate"], dtype=object)
    savemat(path, {"plant": {**plain, "states": names, "inputs": np.array(["flap"], dtype=object)}, "other": 3.0})
    result = hfa("solve", "--model", str(path), "--json")
    found = json.loads(result.out)
    assert (found["states"], found["inputs"]) == (["height", "rate"], ["flap"])
    assert f"{path}: A and B are read from its structure plant" in found["warnings"]
    savemat(path, {**plain, "tree": {"leaf": 1.0}})
    assert "tree not used" in hfa("solve", "--model", str(path)).err
