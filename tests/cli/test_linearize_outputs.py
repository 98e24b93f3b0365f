"""`hfa linearize --outputs, --inputs, --states`: the JSON, the text, the file as a plant, and unknown names."""

from __future__ import annotations

import csv
from pathlib import Path

import numpy as np
import pytest
from cli import answer, hfa
from game_files import AT_15

from hfa_model import INPUTS, LINEAR_STATES, STATES

CHOSEN = ("--outputs", "load_factor,dihedral", "--inputs", "elevator_center,throttle", "--states", "dihedral,alpha")


def test_without_names_every_state_is_an_output() -> None:
    data = answer("linearize", *AT_15)
    assert (data["outputs"], data["output_units"]) == (data["states"], data["state_units"])
    np.testing.assert_array_equal(data["C"], np.eye(6))
    np.testing.assert_array_equal(data["D"], np.zeros((6, 5)))
    assert (data["disturbances"], data["disturbance_units"]) == (["updraft"], ["ft/s"])
    assert (np.shape(data["E"]), data["F"]) == ((6, 1), [[0.0]] * 6)
    full = answer("linearize", *AT_15, "--states", ",".join(STATES))
    assert (full["outputs"], np.shape(full["E"]), np.shape(full["C"])) == (full["states"], (7, 1), (7, 7))
    assert "C  " not in hfa("linearize", *AT_15).out


def test_names_choose_rows_and_columns_in_their_order() -> None:
    whole = answer("linearize", *AT_15, "--outputs", "load_factor,dihedral")
    part = answer("linearize", *AT_15, *CHOSEN)
    rows = [LINEAR_STATES.index(name) for name in ("dihedral", "alpha")]
    columns = [INPUTS.index(name) for name in ("elevator_center", "throttle")]
    for name, pick in (("A", (rows, rows)), ("B", (rows, columns)), ("C", ([0, 1], rows)), ("D", ([0, 1], columns))):
        np.testing.assert_array_equal(part[name], np.array(whole[name])[np.ix_(*pick)])
    np.testing.assert_array_equal(part["E"], np.array(whole["E"])[rows])
    assert (part["states"], part["outputs"]) == (["dihedral", "alpha"], ["load_factor", "dihedral"])
    assert part["output_units"] == ["1", "rad"]
    assert part["output_offsets"] == pytest.approx([1.0, np.radians(15.0)])
    assert "A_band" in whole
    assert not {"A_band", "printed"} & set(part)  # they are of the whole model


def test_the_text_and_the_csv_show_C_and_D_when_outputs_were_asked_for() -> None:
    result = hfa("linearize", *AT_15, *CHOSEN, "-o", "model.csv")
    assert "y = C x + D u" in result.out.splitlines()[0]
    assert {line.split()[0] for line in result.out.splitlines() if line[:2] in ("C ", "D ")} == {"C", "D"}
    lines = Path("model.csv").read_text(encoding="utf-8").splitlines()
    rows = list(csv.DictReader(line for line in lines if not line.startswith("#")))
    found = {(row["matrix"], row["row"], row["column"]): row for row in rows}
    data = answer("linearize", *AT_15, *CHOSEN)
    entry = found["C", "load_factor", "alpha"]
    assert (float(entry["value"]), entry["unit"]) == (data["C"][0][1], "(1)/(rad)")
    assert len(rows) == 4 + 4 + 4 + 4 + 2 + 2


def test_winds_are_columns_with_names() -> None:
    winds = ("--disturbances", "updraft,headwind_outer")
    data = answer("linearize", *AT_15, *CHOSEN, *winds)
    assert (data["disturbances"], data["disturbance_units"]) == (["updraft", "headwind_outer"], ["ft/s"] * 2)
    assert (np.shape(data["E"]), np.shape(data["F"])) == ((2, 2), (2, 2))
    default = answer("linearize", *AT_15, *CHOSEN)
    np.testing.assert_array_equal(np.array(data["E"])[:, :1], default["E"])
    text = hfa("linearize", *AT_15, *winds, "-o", "model.csv").out
    assert "x' = A x + B u + E w" in text
    assert "E              updraft  headwind_outer" in text
    assert "E  " not in hfa("linearize", *AT_15).out
    assert "E,speed,headwind_outer" in Path("model.csv").read_text(encoding="utf-8")
    hfa("linearize", *AT_15, *winds, "-o", "model.npz")
    with np.load("model.npz") as stored:
        assert (stored["E"].shape, stored["disturbances"].tolist()) == ((6, 2), ["updraft", "headwind_outer"])


@pytest.mark.parametrize("suffix", ["json", "npz", "mat"])
def test_the_wind_in_a_file_is_not_the_disturbance_of_its_game(suffix: str) -> None:
    assert hfa("linearize", *AT_15, "--outputs", "gamma", "-o", f"model.{suffix}").code == 0
    assert answer("solve", "--model", f"model.{suffix}")["P"] == answer("solve", *AT_15)["P"]
