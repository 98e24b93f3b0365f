"""Lags of engines as states of the model, compared with JSBSim, and their values in trim."""

import math

import numpy as np
import pytest
from constructs.airframe import driven
from constructs.jet import SLOTS, jet
from jsbsim_flights import difference, drawn, trimmed
from jsbsim_reference import responses
from small_aircraft import needs_jsbsim, written

from hfa import linearize, load_model, trim

SPOOLS = '<function name="N2SpoolUp"> <v>7</v> </function>'


@needs_jsbsim
@pytest.mark.slow
@pytest.mark.parametrize("name", ["c172p", "737", "DHC6"])
def test_simulations_of_jsbsim_converge_to_the_models_simulation(name):
    """JSBSim's simulations converge to the model's simulation as JSBSim's step decreases.

    With a quarter of the step the difference is four times smaller, within 15 %. Richardson's
    extrapolation to a step of 0 is ten times closer than the smaller step.
    """
    model, point = trimmed(f"jsbsim:{name}?filters=states&engines=states")
    flight = drawn(point, 6, seed=3)
    items = [
        {"aircraft": name, "point": flight | {"step": step}} for step in (1.0 / 120.0, 1.0 / 480.0)
    ]
    coarse, fine = responses(items)
    error = difference(model, flight, fine)
    assert difference(model, flight, coarse) / error == pytest.approx(4.0, rel=0.15)
    # If the error is proportional to the step, that of a quarter step is a third of the difference.
    limit = [
        {key: x[key] + (x[key] - x_coarse[key]) / 3.0 for key in x}
        for x_coarse, x in zip(coarse["states"], fine["states"], strict=True)
    ]
    assert difference(model, flight, fine | {"states": limit}) < 0.1 * error


@pytest.fixture
def path(tmp_path):
    """Return the path of a jet whose file limits the acceleration of its spool to 7 %/s.

    Its spool turns at 60 % at idle and at 100 % at full throttle.
    """
    return written(tmp_path, jet({"shares": f"{SLOTS['shares']} {SPOOLS}"}), "jet")


def trim_of(path, **held):
    """Return the model of a file and its trim, by default at 350 ft/s."""
    model = load_model(path)
    return model, trim(model, hold=held or {"speed": 350.0})


def test_a_spool_is_at_its_throttle_in_trim(path):
    """In trim, the spool speed is the commanded one, 60 % + 40 % of the throttle.

    Near it, JSBSim's spool reaches the commanded speed in one frame of 1/120 s: A has the entry
    -120 1/s.
    """
    model, point = trim_of(f"{path}?engines=states")
    assert point.states.spool0 == pytest.approx(60.0 + 40.0 * point.inputs.throttle)
    linear = linearize(model, point)
    row = model.linear.index("spool0")
    assert linear.A[row, row] == pytest.approx(-120.0)


def test_a_fast_fan_is_trimmed(tmp_path):
    """An electric fan with a diameter of 0.9 ft and no <maxrpm> is trimmed at about 42,000 rpm.

    At this speed, the fan absorbs C_P(J) ρ n³ D⁵, the power of the engine. C_P is given at the
    advance ratios J = V / (n D) of `tables`.
    """
    tables = "0 0.6\n 0.4 0.5\n 0.8 0.3\n 1.2 -0.02"
    watts = '<power unit="WATTS"> 300000 </power>'
    slots = driven("", tables, watts, "electric_engine")
    small = slots["thruster"].replace("<ixx> 1 <", "<ixx> 0.002 <").replace("> 6 <", "> 0.9 <")
    model, point = trim_of(written(tmp_path, jet({**slots, "thruster": small}), "jet"), kcas=100.0)
    assert 40_000.0 < point.states.rpm0 < 45_000.0
    n = point.states.rpm0 / 60.0
    speed = point.states.speed * math.cos(point.states.alpha)  # along the axis of the fan
    J, C_P = np.array(tables.split(), float).reshape(-1, 2).T
    # Density at 5000 ft in slug/ft^3, diameter in ft, and ft lbf/s of a horsepower.
    power = np.interp(speed / (0.9 * n), J, C_P) * 0.0020482 * n**3 * 0.9**5 / 550.0
    assert model.outputs_at(point.states, point.inputs)["power0"] == pytest.approx(power, rel=1e-3)
