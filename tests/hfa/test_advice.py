"""The advice of a failed trim is obeyed, and leads to the flight that was asked for."""

import re
from pathlib import Path

import numpy as np
import pytest
from cli import answer, hfa as command
from project import ROOT

UAV = str(ROOT / "examples/uav.toml")
#: A point mass whose thrust is at most 5 and whose lift is at most 10 m/s².
GLIDER = """
import casadi as ca
from hfa import Model, Signal

def equations(x, u, p, w):
    turning = (u.lift * ca.cos(x.bank) - 9.81 * ca.cos(x.pitch)) / x.speed
    along = u.thrust - 1.0 - 9.81 * ca.sin(x.pitch)
    return {"speed": along, "pitch": turning, "bank": u.roll_rate}, {}

STATES = {"speed": Signal("m/s"), "pitch": Signal("rad"), "bank": Signal("rad")}
INPUTS = {"thrust": Signal("m/s^2", nominal=1.0, min=0.0, max=5.0)}
INPUTS["lift"] = Signal("m/s^2", nominal=1.0, min=0.0, max=10.0)
INPUTS["roll_rate"] = Signal("rad/s")
TRIM = {"speed": 50.0, "pitch": 0.0, "bank": 0.0}
GLIDER = Model("glider", STATES, INPUTS, equations, trim=TRIM)
"""


def heavy(folder):
    """Return a table of the small aircraft whose mass is in slug in place of kg."""
    text = (ROOT / "examples/uav.toml").read_text("utf-8")
    path = folder / "heavy.toml"
    path.write_text(text.replace("mass = 13.5", 'mass = "13.5 slug"'), "utf-8")
    return str(path)


def test_advice_of_a_point_mass_is_the_steepest_climb_and_no_fall(folder):
    """The climb at full thrust has sin(pitch) = (5 - 1) / 9.81, since along the path the thrust
    balances drag (1) and weight. A turn at 30 deg of bank needs a lift of 9.81 / cos(30 deg), more
    than 10; no rate is then freed, because the mass would fall.
    """
    Path("glider.py").write_text(GLIDER, "utf-8")
    words = ("trim", "--aircraft", "glider.py:GLIDER")
    climb = command(*words, "--hold", "pitch=45").err
    advice = re.search(r"with (.*) in place of --hold \(pitch (.*) deg\)", climb)
    assert advice is not None
    pitch = answer(*words, *advice[1].split())["operating_point"]["states"]["pitch"]
    assert pitch == pytest.approx(np.arcsin(4.0 / 9.81), rel=1e-6)
    assert np.degrees(pitch) == pytest.approx(float(advice[2]), rel=1e-4)
    turn = command(*words, "--hold", "bank=30")
    assert (turn.code, "_dot" in turn.err) == (1, False)


@pytest.mark.slow
@pytest.mark.parametrize("case", ["bank", "heavy", "climb"])
def test_no_advice_leads_to_a_falling_aircraft(case, tmp_path):
    """Advice never frees pitch_dot or another attitude rate, because the aircraft would fall.

    If the user frees pitch_dot, the first line of the trim says "accelerated" and the load factor; a
    climb of 45 deg has no such trim. Only the error of the heavy aircraft compares lift and
    weight of its table.
    """
    words = {
        "heavy": ["--aircraft", heavy(tmp_path)],
        "bank": ["--aircraft", UAV, "--hold", "roll=30"],
        "climb": ["--aircraft", UAV, "--hold", "gamma=45"],
    }[case]
    refused = command("trim", *words)
    assert (refused.code, "_dot" in refused.err) == (1, False)
    assert ("lift = weight at the condition" in refused.err) == (case == "heavy")
    freed = command("trim", *words, "--free", "pitch_dot")
    assert freed.code == (case == "climb")
    if case != "climb":
        first = freed.out.partition("unstable")[0]  # the second line begins with "unstable"
        assert "accelerated" in first
        assert "load_factor" in first


def test_inputs_held_at_their_start_values_are_freed(folder):
    """If the default trim holds all inputs, the advice frees those that are not held at 0.

    The thrust of the climb found balances drag (1) and weight along the path.
    """
    held = 'TRIM = {"thrust": 1.0, "lift": 9.81, "roll_rate": 0.0}'
    Path("glider.py").write_text(re.sub("TRIM = .*", held, GLIDER, count=1), "utf-8")
    words = ("trim", "--aircraft", "glider.py:GLIDER", "--hold", "pitch=5", "--hold", "speed=50")
    refused = " ".join(command(*words).err.split())
    advice = re.search(
        r"the trim holds the inputs at their start values; one exists with (.*)", refused
    )
    assert advice is not None, refused
    assert advice[1] == "--free thrust --free lift"
    inputs = answer(*words, *advice[1].split())["operating_point"]["inputs"]
    assert inputs["thrust"] == pytest.approx(1.0 + 9.81 * np.sin(np.radians(5.0)), rel=1e-9)
