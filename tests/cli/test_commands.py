"""What `hfa` answers: text for people, JSON for scripts, and the exit codes of its checks."""

from __future__ import annotations

import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from cli import answer, hfa

from hfa_cli.main import COMMANDS, DONE, FAILED
from hfa_model import INPUTS, LINEAR_STATES, STATES, default_parameters, save_parameters
from hfa_model.aircraft import HFA
from hfa_model.vectors import INPUT_UNITS, STATE_UNITS
from trim.identification import ASSUMED

LINEAR_MODEL_KEYS = {
    *("schema", "dihedral_deg", "dynamics", "operating_point", "states", "inputs", "state_units", "input_units"),
    *("A", "B", "modes"),
}


def text(*words: str, code: int = DONE) -> str:
    """What `hfa words...` prints for a person: no escape codes, nothing on standard error."""
    result = hfa(*words)
    assert (result.code, result.err) == (code, "")
    assert not re.search(r"[\x00-\x08\x0b-\x1f\x7f]", result.out)
    assert all(line == line.rstrip() for line in result.out.splitlines())
    return result.out


def test_help_names_every_command_and_every_command_has_help() -> None:
    overview = text("--help")
    assert text() == overview
    for command in COMMANDS:
        assert re.search(rf"^  {command} +\w", overview, re.M)
        short, long = text(command, "--help"), text(command, "--help", "more")
        assert short.startswith(f"usage: hfa {command} ")
        assert short.count("\n") <= 48, "it fits on a screen"
        assert set(re.findall(r"--[a-z-]+", long)) <= set(re.findall(r"--[a-z-]+", short))


def test_trim_json() -> None:
    data = answer("trim", "--dihedral", "10")
    point = data["operating_point"]
    assert data["dihedral_deg"] == pytest.approx(10.0, rel=1e-15)
    assert data["dynamics"] == point["dynamics"] == "published"
    assert list(point["states"]) == list(point["state_units"]) == list(STATES)
    assert list(point["inputs"]) == list(point["input_units"]) == list(data["margins"]) == list(INPUTS)
    assert list(point["residuals"]) == list(data["scaled_residuals"]) == list(HFA.steady)
    assert max(map(abs, data["scaled_residuals"].values())) <= data["balance_limit"] == 1e-10
    assert (point["states"]["speed"], point["states"]["altitude"]) == (68.0, 40000.0)
    assert point["states"]["alpha"] == point["states"]["pitch"] == pytest.approx(np.radians(2.8), rel=1e-15)


def test_degrees_go_in_and_radians_come_out() -> None:
    held = ("--hold", "gamma=-1.5", "--hold", "aileron_center=2")
    words = ("--dihedral", "10", *held, "--limit", "elevator_outer=-25:25")
    point = answer("trim", *words)["operating_point"]
    assert point["states"]["dihedral"] == pytest.approx(np.radians(10.0), rel=1e-15)
    assert point["states"]["pitch"] - point["states"]["alpha"] == pytest.approx(np.radians(-1.5), rel=1e-12)
    assert point["inputs"]["aileron_center"] == pytest.approx(np.radians(2.0), rel=1e-15)
    margin = np.radians(25.0) - abs(point["inputs"]["elevator_outer"])
    assert answer("trim", *words)["margins"]["elevator_outer"] == pytest.approx(margin, rel=1e-12)


@pytest.mark.parametrize("command", ["trim", "linearize"])
def test_a_saved_point_starts_the_next_trim(command: str) -> None:
    assert hfa(command, "--dihedral", "14", "-o", "saved.json").code == DONE
    words = ("linearize", "--dihedral", "15")
    again, plain = answer(*words, "--start", "saved.json"), answer(*words)
    np.testing.assert_allclose(again["A"], plain["A"], atol=1e-9)
    inputs = (list(each["operating_point"]["inputs"].values()) for each in (again, plain))
    np.testing.assert_allclose(*inputs, rtol=1e-9, atol=1e-12)


def test_linearize_json_keeps_the_contract() -> None:
    data = answer("linearize", "--dihedral", "15")
    assert set(data) >= LINEAR_MODEL_KEYS
    assert {"states", "inputs", "residuals"} <= set(data["operating_point"])
    assert (data["states"], data["inputs"]) == (list(LINEAR_STATES), list(INPUTS))
    assert data["state_units"] == [getattr(STATE_UNITS, name) for name in LINEAR_STATES]
    assert data["input_units"] == list(INPUT_UNITS)
    assert (np.shape(data["A"]), np.shape(data["B"])) == ((6, 6), (6, 5))
    assert (np.shape(data["A_band"]), np.shape(data["B_band"])) == ((6, 6), (6, 5))
    assert np.abs(np.subtract(data["A"], data["printed"]["A"])).max() < 1.5e-4
    eigenvalues = np.linalg.eigvals(data["A"])
    for mode in data["modes"]:
        assert np.abs(eigenvalues - complex(*mode["eigenvalue"])).min() < 1e-9
    assert sum(2 if mode["eigenvalue"][1] else 1 for mode in data["modes"]) == 6
    assert "printed" not in answer("linearize", "--dihedral", "15", "--hold", "speed=70")


def test_sweep_text_and_json() -> None:
    said = text("sweep", "--dihedral", "0:15:5")
    assert said.startswith("Sweep, published dynamics: 4 of 4 points trimmed\n")
    assert re.search(
        r"^dihedral deg +short period 1/s +dihedral \(fast\) 1/s +phugoid 1/s +dihedral \(slow\) 1/s$", said, re.M
    )
    data = answer("sweep", "--dihedral", "0:15:5")
    np.testing.assert_allclose(np.degrees(data["values"]).ravel(), [0, 5, 10, 15], atol=1e-12)
    for A, pairs in zip(data["A"], data["eigenvalues"], strict=True):
        found = np.sort_complex([complex(*pair) for pair in pairs])
        np.testing.assert_allclose(found, np.sort_complex(np.linalg.eigvals(A)), rtol=1e-9, atol=1e-9)


def test_sweep_keeps_failed_points_as_rows() -> None:
    data = answer("sweep", "--dihedral", "0", "--hold", "speed=20,68")
    assert data["reasons"][0].startswith("no trim")
    assert data["reasons"][1] == ""
    assert {value for row in data["A"][0] for value in row} == {None}
    assert None not in {value for row in data["A"][1] for value in row}
    said = text("sweep", "--dihedral", "0", "--hold", "speed=20,68")
    assert "1 of 2 points trimmed" in said
    assert re.search(r"^0 +20( +-)+$", said, re.M)
    assert "20: no trim" in said


def test_regenerate_passes_with_the_shipped_parameters() -> None:
    said = text("regenerate")
    assert "\nBoth pairs regenerated: yes\n" in said
    assert said.count(" PASS\n") == 8
    assert "FAIL" not in said
    data = answer("regenerate")
    assert data["ok"] is True
    assert [case["dihedral_deg"] for case in data["cases"]] == [15.0, 5.0]
    assert [len(case["entries"]) for case in data["cases"]] == [66, 66]
    assert max(abs(entry["half_units"]) for case in data["cases"] for entry in case["entries"]) < 1.3


@pytest.mark.parametrize("name", ["panel_mass", *ASSUMED])  # the other identified ones: test_linear_model.py
def test_regenerate_fails_with_one_parameter_changed_by_one_percent(tmp_path: Path, name: str) -> None:
    shipped = default_parameters()
    changed = shipped.values._replace(**{name: 1.01 * getattr(shipped.values, name)})
    path = tmp_path / "changed.toml"
    save_parameters(replace(shipped, values=changed), path, "one parameter changed")
    result = hfa("regenerate", "--parameters", str(path))
    assert (result.code, result.err) == (FAILED, "")
    assert "FAIL" in result.out
    assert "\nBoth pairs regenerated: NO\n" in result.out
