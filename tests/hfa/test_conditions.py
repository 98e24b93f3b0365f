"""Trim conditions given by the same options to every command that trims one point or many."""

import numpy as np
import pytest
from cli import answer, hfa

#: A point mass without drag, whose altitude is a state, held in the trim. Inputs are per unit of mass.
CLIMBER = """
import casadi as ca
from hfa import Model, Signal

def equations(x, u, p, w):
    rates = {"speed": u.thrust - 9.81 * ca.sin(x.gamma), "gamma": u.lift / x.speed}
    return rates | {"altitude": x.speed * ca.sin(x.gamma)}, {"climb": x.speed * ca.sin(x.gamma)}

STATES = {"speed": Signal("m/s"), "gamma": Signal("rad"), "altitude": Signal("m")}
INPUTS = {"thrust": Signal("m/s^2"), "lift": Signal("m/s^2")}
TRIM = {"speed": 50.0, "altitude": 0.0}
CLIMBER = Model("climber", STATES, INPUTS, equations, outputs={"climb": Signal("m/s")}, trim=TRIM)
"""


@pytest.mark.parametrize("altitude", ["altitude", "z_up"])
def test_a_climb_of_a_model_with_altitude_is_advised_and_found(altitude, tmp_path):
    """The error of --hold gamma=4 advises --free altitude_dot, under either name of the altitude, and
    with it the climb is found. Without drag, the thrust per unit of mass then balances the weight
    along the path, 9.81 sin(4 deg).
    """
    text = CLIMBER.replace("altitude", altitude)
    (tmp_path / "climber.py").write_text(text, encoding="utf-8")
    words = ("trim", "--aircraft", str(tmp_path / "climber.py"), "--hold", "gamma=4")
    refused = hfa(*words)
    assert refused.code == 1
    assert f"--free {altitude}_dot" in refused.err
    found = answer(*words, "--free", f"{altitude}_dot")
    thrust = found["operating_point"]["inputs"]["thrust"]
    assert thrust == pytest.approx(9.81 * np.sin(np.radians(4.0)), rel=1e-9)
