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


def test_options_are_in_degrees_and_json_in_radians():
    """Angles of --hold and --limit are read in degrees, and JSON output is in radians. A held parameter
    is that of the aircraft: heavier panels need more thrust.
    """
    held = ("--hold", "gamma=-1.5", "--hold", "aileron_center=2")
    words = ("--dihedral", "10", *held, "--limit", "elevator_outer=-25:25")
    point = answer("trim", *words)["operating_point"]
    assert point["states"]["dihedral"] == pytest.approx(np.radians(10.0), rel=1e-15)
    assert point["states"]["pitch"] - point["states"]["alpha"] == pytest.approx(
        np.radians(-1.5), rel=1e-12
    )
    assert point["inputs"]["aileron_center"] == pytest.approx(np.radians(2.0), rel=1e-15)
    margin = np.radians(25.0) - abs(point["inputs"]["elevator_outer"])
    assert answer("trim", *words)["variables"]["elevator_outer"]["margin"] == pytest.approx(
        margin, rel=1e-12
    )
    heavy = answer("trim", *words, "--hold", "panel_mass=11")["operating_point"]
    assert heavy["inputs"]["throttle"] > point["inputs"]["throttle"]


def test_the_start_of_a_search_is_typed_in_degrees():
    """--start angle=30 is 30 deg in rad in the provenance of the trim."""
    begun = answer("trim", "--aircraft", PENDULUM, "--free", "angle", "--start", "angle=30")
    begin = begun["provenance"]["condition"]["begin"]
    assert begin["angle"] == pytest.approx(np.radians(30.0), rel=1e-15)


def test_a_sweep_without_a_trim_fails():
    """At 20 ft/s, no point has a trim: exit code 1, also with a store."""
    found = hfa("sweep", "--dihedral", "0", "-o", "a.zarr", "--hold", "speed=20,21")
    assert found.code == 1
    assert ": no trim at any of 2 points" in found.out.partition("\n")[0]


def test_regenerate_fails_with_other_parameters():
    """With the parameters of the released simulation, `hfa regenerate` prints NO and fails."""
    assert "Both printed pairs regenerated: NO\n" in text(
        "regenerate", "--parameters", "gibson-2011-simulation", code=FAILED
    )


@pytest.mark.parametrize("typed", ["II", "2", "ii-l"])
def test_the_airplane_class_has_capitals_or_digits(typed):
    """A class II without a letter is II-L, of airplanes on land."""
    assert "class II-L" in text("trim", *AT_15, "--class", typed, "--full")


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
