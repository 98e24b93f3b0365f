"""`hfa design`: a controller is made, written, printed again and checked; what is wrong is one line."""

from __future__ import annotations

import numpy as np
import pytest
from cli import answer, hfa
from scipy.io import loadmat

from controller import load_controller
from hfa_model import Aircraft


def test_a_design_becomes_a_file_that_prints_the_same_table() -> None:
    made = hfa("design", "--design", "simvfa-1", "--dihedral", "9:11:2", "-o", "servo.npz")
    assert made.code == 0
    again = hfa("design", "servo.npz")
    table = made.out.split("\n\n")[:-1]  # the last paragraph is the provenance
    assert again.out.split("\n\n")[:-1] == table
    assert "simvfa-1: state feedback, 2 states, 2 angles from 9 to 11 deg" in table[0]
    assert "smallest disk margin at sensors" in table[3]
    controller = load_controller("servo.npz")
    assert controller.about["provenance"]["command"].startswith("hfa design --design simvfa-1")
    data = answer("design", "servo.npz")
    np.testing.assert_array_equal(data["C"], controller.C)
    assert [row["dihedral"] for row in data["angles"]] == pytest.approx(controller.dihedrals)


def test_the_corners_decide_the_exit_code_and_matrices_go_to_other_tools(published_aircraft: Aircraft) -> None:
    found = hfa("design", "--design", "simvfa-1", "--dihedral", "11", "--corners", "-o", "servo.mat")
    assert found.code == 1
    assert "FAIL largest_abscissa: unstable at" in found.out
    assert loadmat("servo.mat")["D"].shape == (2, 11, 1) or loadmat("servo.mat")["D"].shape == (2, 11)
