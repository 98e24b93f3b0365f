"""The conditions of examples/737_conditions.csv, each flown by JSBSim itself."""

import csv
import math

import numpy as np
import pytest
from cli import hfa as command
from jsbsim_reference import AXES, measured
from project import ROOT
from small_aircraft import needs_jsbsim

from hfa import load_model

pytestmark = [needs_jsbsim, pytest.mark.slow]
#: Radius of an almost flat Earth, ft: the model assumes a flat one.
FLAT = 1e12
#: Condition -> its result in the matrix; all others are "trimmed".
RESULTS = {"stall": "stalled", "too slow": "no trim"}


@pytest.fixture(scope="module")
def rows(tmp_path_factory):
    """Return name -> cells of the matrix of the conditions."""
    path = tmp_path_factory.mktemp("matrix") / "matrix.csv"
    given = ROOT / "examples/737_conditions.csv"
    words = ("--aircraft", "jsbsim:737", "--conditions", str(given))
    run = command("trim", *words, "-q", "-o", str(path))
    assert run.code == 1, run.err
    assert run.out.startswith("12 of 14 conditions are trimmed, 1 stalled, 1 without a trim\n")
    with path.open(encoding="utf-8", newline="") as stream:
        return {row["name"]: row for row in csv.DictReader(stream)}


def numbers_of(cells):
    """Return name -> number, in radians for an angle, of a row of the matrix."""
    found = {}
    for heading, text in cells.items():
        name, _, unit = heading.removeprefix("hold ").partition(" [")
        try:
            found[name] = float(text) * (math.radians(1.0) if unit.startswith("deg") else 1.0)
        except ValueError:
            continue
    return found


def test_each_row_balances_in_jsbsim(rows):
    """JSBSim's accelerations are 0 within 1e-5 g, also in a turn and a pull-up with steady rates.

    Its calibrated airspeed, weight and thrust are those of the row. The result of the condition
    `stall` is "stalled".
    """
    model = load_model("jsbsim:737")
    flown = {name: cells for name, cells in rows.items() if cells["results"] != "no trim"}
    points = []
    for cells in flown.values():
        numbers = numbers_of(cells)
        commands = {
            each: numbers[each] for each in (*model.inputs, *model.parameters) if each in numbers
        }
        state = {each: numbers[each] for each in model.states}
        points.append({"state": state, "commands": commands, "radius": FLAT})
    for (name, cells), answer in zip(flown.items(), measured("737", points), strict=True):
        rates = [answer[axis] for axis in AXES]
        np.testing.assert_allclose(rates, 0.0, atol=1e-5 * 32.174, err_msg=name)
        numbers = numbers_of(cells)
        assert numbers["calibrated airspeed"] == pytest.approx(answer["kcas"], rel=1e-5)
        assert numbers["weight"] == pytest.approx(answer["weight"], rel=1e-9)
        thrust = sum(answer[key] for key in answer if key.startswith("thrust"))
        assert numbers["thrust"] == pytest.approx(thrust, rel=1e-5, abs=1e-3)
        assert cells["results"] == RESULTS.get(name, "trimmed")
