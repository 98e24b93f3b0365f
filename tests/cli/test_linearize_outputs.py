"""`hfa linearize --outputs, --inputs, --states`: the JSON, the text, the file as a plant, and unknown names."""

from __future__ import annotations

import numpy as np
import pytest
from cli import answer, hfa
from game_files import AT_15

from hfa_model import INPUTS, LINEAR_STATES, STATES, Aircraft
from hfa_model.aircraft import HFA
from trim import find_operating_point, level_flight, linearize

CHOSEN = ("--outputs", "load_factor,dihedral", "--inputs", "elevator_center,throttle", "--states", "dihedral,alpha")


def test_without_names_every_state_is_an_output() -> None:
    data = answer("linearize", *AT_15)
    assert (data["outputs"], data["output_units"]) == (data["states"], data["state_units"])
    np.testing.assert_array_equal(data["C"], np.eye(6))
    np.testing.assert_array_equal(data["D"], np.zeros((6, 5)))
    assert (data["disturbances"], set(data["disturbance_units"])) == (list(HFA.disturbances), {"ft/s"})
    assert (np.shape(data["E"]), data["F"]) == ((6, 7), [[0.0] * 7] * 6)
    full = answer("linearize", *AT_15, "--states", ",".join(STATES))
    assert (full["outputs"], np.shape(full["E"]), np.shape(full["C"])) == (full["states"], (7, 7), (7, 7))
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


def test_every_file_has_the_columns_of_all_winds(published_aircraft: Aircraft) -> None:
    assert "E  " not in hfa("linearize", *AT_15, *CHOSEN, "-o", "model.npz").out
    point = find_operating_point(published_aircraft, level_flight(np.radians(15.0)))
    winds = tuple(HFA.disturbances)
    model = linearize(published_aircraft, point, full=True, outputs=("load_factor", "dihedral"), disturbances=winds)
    with np.load("model.npz") as stored:
        assert tuple(stored["disturbances"]) == winds
        np.testing.assert_array_equal(stored["E"], model.E[[STATES.index(name) for name in ("dihedral", "alpha")]])
        np.testing.assert_array_equal(stored["F"], model.F)


def test_the_wind_in_a_file_is_not_the_disturbance_of_its_game() -> None:
    assert hfa("linearize", *AT_15, "--outputs", "gamma", "-o", "model.mat").code == 0
    assert answer("solve", "--model", "model.mat")["P"] == answer("solve", *AT_15)["P"]
