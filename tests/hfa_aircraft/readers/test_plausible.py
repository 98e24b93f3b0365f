"""Tables with usual mistakes are doubted under the first line; right aircraft are not."""

from __future__ import annotations

import tomllib
from typing import Any

import pytest
from project import ROOT

import hfa


def changed(**values: Any) -> dict[str, Any]:
    """Return the table of the small aircraft with other values."""
    table = tomllib.loads((ROOT / "examples/uav.toml").read_text("utf-8"))
    flat: dict[str, Any] = {}
    for name, value in table.items():
        flat |= value if isinstance(value, dict) else {name: value}
    return flat | values


DEGREE = 3.141592653589793 / 180.0
#: Mistake -> changed entries, and a word of its doubt.
MISTAKES = {
    "mass in pounds as slugs": ({"mass": 13.5 / 32.174}, "weight"),
    "mass in slugs as kilograms": ({"mass": 13.5 * 14.594}, "weight"),
    "mass 32 times too large": ({"mass": 13.5 * 32.174}, "weight"),
    "static instability": ({"Cm_alpha": 0.38}, "Cm_alpha"),
    "no pitch damping": ({"Cm_q": 0.0}, "Cm_q"),
    "sign of the roll damping": ({"Cl_p": 0.26}, "Cl_p"),
    "a surface without derivatives": ({"flap": ["0 deg", "30 deg"]}, "flap"),
    "rates per degree": ({"Cl_p": -0.26 * DEGREE}, "Cl_p"),
    "per degree taken as per radian": ({"CL_alpha": 3.45 * DEGREE}, "CL_alpha"),
    "per radian taken as per degree": ({"CL_alpha": 3.45 / DEGREE}, "CL_alpha"),
    "lift coefficient of another alpha": ({"CL_0": 0.1, "alpha": "3 deg"}, "alpha"),
    "chord ten times too large": ({"chord": 1.9}, "chord"),
    "drag in counts": ({"CD_0": 4.3}, "CD_0"),
    "moment per radian taken as per degree": ({"Cm_alpha": -0.38 / DEGREE}, "static margin"),
}


@pytest.mark.parametrize("mistake", MISTAKES)
def test_a_planted_mistake_is_doubted(mistake: str) -> None:
    """Each mistake has one line, which names the entry, and the aircraft is still read."""
    values, word = MISTAKES[mistake]
    model = hfa.from_derivatives(changed(**values))
    (doubt,) = model.about.doubts
    assert word in doubt


@pytest.mark.parametrize("name", ["uav.toml", "cessna182.toml", "glider.toml"])
def test_right_tables_are_not_doubted(name: str) -> None:
    """No table of the examples is doubted."""
    assert hfa.load_model(f"{ROOT}/examples/{name}").about.doubts == ()
