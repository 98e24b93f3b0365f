"""Plants and gains of other tools, solved and checked; our tables in pandas and polars."""

from __future__ import annotations

import json
from importlib.util import find_spec
from pathlib import Path
from typing import Any

import control
import numpy as np
import pytest
from cli import assert_refused, hfa

TABLES = {
    "linearize": ("linearize", "--dihedral", "10"),
    "sweep": ("sweep", "--dihedral", "0:10:5"),
    "trim": ("trim", "--dihedral", "10"),
}


@pytest.fixture(scope="module")
def known() -> dict[str, Any]:
    """What `hfa solve` finds, without the print."""
    model = json.loads(hfa("linearize", "--dihedral", "10", "--json").out)
    return model | {"K": json.loads(hfa("solve", "--dihedral", "10", "--json").out)["K"]}


def assert_solved_and_checked(plant: Path, gain: Path, known: dict[str, Any]) -> None:
    solved = json.loads(hfa("solve", "--model", str(plant), "-q", "--json").out)
    np.testing.assert_allclose(solved["K"], known["K"], rtol=1e-8, atol=1e-10)
    assert (solved["states"], solved["inputs"]) == (known["states"], known["inputs"])
    result = hfa("verify", "--model", str(plant), "--weights", str(gain), "-q", "--json")
    assert (result.code, json.loads(result.out)["ok"]) == (0, True)


def test_a_system_of_python_control_as_json(known: dict[str, Any], tmp_path: Path) -> None:
    names = {"states": known["states"], "inputs": known["inputs"]}
    system = control.ss(known["A"], known["B"], np.eye(6), 0, **names)
    content = {name: getattr(system, name) for name in ("A", "B", "C", "D", "dt", "state_labels", "input_labels")}
    plant, gain = tmp_path / "plant.json", tmp_path / "gain.json"
    plant.write_text(json.dumps(content, default=np.ndarray.tolist), encoding="utf-8")
    gain.write_text(json.dumps({"K": known["K"]}), encoding="utf-8")
    assert_solved_and_checked(plant, gain, known)
    plant.write_text(json.dumps(content | {"dt": 0.1}, default=np.ndarray.tolist), encoding="utf-8")
    assert_refused(hfa("solve", "--model", str(plant)), 2, "dt is 0.1", "x' = A x + B u")


def test_plain_csv_files(known: dict[str, Any], tmp_path: Path) -> None:
    for name, columns in (("A", known["states"]), ("B", known["inputs"]), ("K", known["states"])):
        np.savetxt(tmp_path / f"{name}.csv", known[name], "%.17g", ",", header=",".join(columns), comments="")
    assert_solved_and_checked(tmp_path / "A.csv", tmp_path / "K.csv", known)


def test_our_own_csv_files(known: dict[str, Any], tmp_path: Path) -> None:
    plant, gain = tmp_path / "plant.csv", tmp_path / "gain.csv"
    assert hfa("linearize", "--dihedral", "10", "-o", str(plant)).code == 0
    assert hfa("solve", "--dihedral", "10", "-o", str(gain)).code == 0
    assert_solved_and_checked(plant, gain, known)


@pytest.mark.parametrize(
    ("name", "text", "said"),
    [
        ("plant.csv", "0,1\n1,0\n", "A.csv with B.csv beside it"),
        ("A.csv", "0,1\n1,0\n", "there is no B"),
        ("A.csv", "", "A has no entries"),
        ("A.csv", "a,b\n1,c\n", "A has an entry 'c'"),
    ],
)
def test_refusals_are_one_line(name: str, text: str, said: str, tmp_path: Path) -> None:
    (tmp_path / name).write_text(text, encoding="utf-8")
    assert_refused(hfa("solve", "--model", str(tmp_path / name)), 2, name, said)


@pytest.mark.parametrize("library", ["pandas", "polars"])
@pytest.mark.parametrize("command", TABLES)
def test_tables_are_read_as_they_are(command: str, library: str, tmp_path: Path) -> None:
    if find_spec(library) is None:
        pytest.skip(f"{library} is not installed")
    module = __import__(library)
    path = tmp_path / "table.csv"
    data = json.loads(hfa(*TABLES[command], "-o", str(path), "--json").out)
    table = module.read_csv(path)
    columns = {name: table[name].to_numpy() for name in table.columns}
    if command == "sweep":
        np.testing.assert_array_equal(columns["dihedral [rad]"], np.ravel(data["values"]))
        np.testing.assert_array_equal(columns["state speed [ft/s]"], np.array(data["operating_states"])[:, 0])
        return
    if command == "linearize":
        rows = columns["matrix"] == "A"
        np.testing.assert_array_equal(columns["value"][rows].reshape(6, 6), data["A"])
        assert columns["unit"][0] == "(ft/s^2)/(ft/s)"
        return
    rows = columns["name"] == "throttle"
    assert columns["value"][rows][0] == data["operating_point"]["inputs"]["throttle"]
    assert columns["unit"][columns["name"] == "alpha"][0] == "rad"
