"""Notes that `fly`, `export` and `design` print: angles beyond the paper's range, and kinks."""

from __future__ import annotations

import json
from pathlib import Path

import pytest
from cli import hfa

NOTE = "dihedral 16 deg is beyond the paper's range, which ends at 15 deg"


@pytest.mark.parametrize("words", [(), ("--samples", "2")], ids=["flight", "members"])
def test_flight_beyond_range_of_paper_is_noted_once(words: tuple[str, ...]) -> None:
    """A flight at 16 deg prints one note that the angle is beyond the paper's range.

    A flight at 15 deg prints no note.
    """
    fly = ("fly", "--law", "exact", "--duration", "0.1", *words)
    for degrees, warnings in (("16", [NOTE]), ("15", [])):
        result = hfa(*fly, "--dihedral", degrees, "--json")
        assert result.err == "".join(f"hfa: note: {note}\n" for note in warnings)
        assert json.loads(result.out)["warnings"] == warnings


KINKED = """
import casadi as ca
from hfa import Model, Signal


def equations(x, u, p, w):
    return {"x": p.gain * u.u - 3.0 * ca.if_else(x.x < 1.0, x.x, 4.0 * x.x - 3.0)}, {}


PLANT = Model(
    "kinked", {"x": Signal("ft", 1.0, 0.0, 2.0)}, {"u": Signal("ft/s", 1.0, -50.0, 50.0)}, equations,
    parameters={"gain": Signal(start=1.0)}, trim={"x": 1.0}, schedule="x",
)
"""
KINK = "kink: A(x, x) is -3 below and -12 above the trim; the slope below is used"
DESIGN = """
inputs = ["u"]
integrals = []
disturbance = "states"
delta = inf
[weights.states]
x = 1.0
[weights.inputs]
u = 1.0
"""


@pytest.mark.parametrize(
    ("words", "where"),
    [
        ("fly --law exact --duration 0.1", ""),
        ("fly --law exact --duration 0.1 --error gain=0.1 --samples 2", ""),
        ("export -o folder", ""),
        ("design design.toml --at 0.5:1.5:0.5", " (1 of 3 places, the first at 1 ft)"),
    ],
)
@pytest.mark.usefixtures("folder")
def test_a_gain_at_a_kink_is_noted(words: str, where: str) -> None:
    """A gain computed at a kink prints one note with the matrix entry, its value and both slopes.

    `hfa design` adds the number of scheduling values with a kink, and the first of these values.
    """
    Path("kinked.py").write_text(KINKED)
    Path("design.toml").write_text(DESIGN)
    result = hfa(*words.split(), "--aircraft", "kinked.py:PLANT")
    assert (result.code, result.err) == (0, f"hfa: note: {KINK}{where}\n")
