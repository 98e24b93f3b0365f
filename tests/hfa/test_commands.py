"""Output of `hfa` commands: text, JSON with provenance, and exit codes."""

import re

import numpy as np
import pytest
from cli import answer, hfa
from game_files import AT_15
from project import ROOT

from hfa.main import DONE, FAILED
from hfa_model import INPUTS, LINEAR_STATES

PENDULUM = f"{ROOT / 'examples/pendulum.py'}:PENDULUM"


def text(*words, code=DONE):
    """Run `hfa` with these words and return the printed text.

    The function asserts the exit code, an empty standard error, no control characters and no
    trailing blanks.
    """
    result = hfa(*words)
    assert (result.code, result.err) == (code, "")
    assert not re.search(r"[\x00-\x08\x0b-\x1f\x7f]", result.out)
    assert all(line == line.rstrip() for line in result.out.splitlines())
    return result.out


def test_regenerate_fails_with_other_parameters():
    """With the parameters of the released simulation, `hfa regenerate` prints NO and fails."""
    assert "Both printed pairs regenerated: NO\n" in text(
        "regenerate", "--parameters", "gibson-2011-simulation", code=FAILED
    )


# Outputs, inputs and states by name.

CHOSEN = "--outputs load_factor,dihedral --inputs elevator_center,throttle --states dihedral,alpha"


def test_names_select_rows_and_columns_in_order():
    """--states, --inputs and --outputs select rows and columns of A to E in the given order."""
    whole = answer("linearize", *AT_15, "--outputs", "load_factor,dihedral")
    part = answer("linearize", *AT_15, *CHOSEN.split())
    rows = [LINEAR_STATES.index(name) for name in ("dihedral", "alpha")]
    columns = [INPUTS.index(name) for name in ("elevator_center", "throttle")]
    for name, pick in (
        ("A", (rows, rows)),
        ("B", (rows, columns)),
        ("C", ([0, 1], rows)),
        ("D", ([0, 1], columns)),
    ):
        np.testing.assert_array_equal(part[name], np.array(whole[name])[np.ix_(*pick)])
    np.testing.assert_array_equal(part["E"], np.array(whole["E"])[rows])
    assert (part["states"], part["outputs"]) == (["dihedral", "alpha"], ["load_factor", "dihedral"])
    assert part["output_units"] == ["1", "rad"]
    assert part["output_offsets"] == pytest.approx([1.0, np.radians(15.0)])
    assert "A_band" in whole
    assert not {"A_band", "printed"} & set(part)  # only for the complete model
    assert "printed" not in answer("linearize", *AT_15, "--hold", "speed=70")
