"""Linear models of jets compared with those of JSBSim (`FGLinearization`)."""

import pytest
from jsbsim_reference import GRAVITY, RADIUS, measured
from small_aircraft import needs_jsbsim

from hfa import linearize, load_model, trim

pytestmark = needs_jsbsim
#: JSBSim's name -> name in the model.
STATES = {
    "Vt": "speed",
    "Alpha": "alpha",
    "Theta": "pitch",
    "Q": "pitch_rate",
    "Beta": "beta",
    "Phi": "roll",
    "P": "roll_rate",
    "R": "yaw_rate",
}
INPUTS = {"ThtlCmd": "throttle", "DaCmd": "aileron", "DeCmd": "elevator", "DrCmd": "rudder"}
#: Derivatives that are wrong in JSBSim: of the speed's rate with respect to roll.
FAULTS = {("Vt", "Phi")}


def differences(name, kcas):
    """Return the largest relative differences of the model's A and B from JSBSim's linear model.

    The result has the keys "A", "B" and "beta", the column of beta in A. A difference is relative to
    the entry, or absolute for entries below 1.

    kcas: calibrated airspeed, kt
    """
    altitude = 15000.0
    gravity = GRAVITY * (RADIUS / (RADIUS + altitude)) ** 2
    model = load_model(f"jsbsim:{name}").with_parameters(gravity=gravity)
    held = {"kcas": kcas, "altitude": altitude}
    point = trim(model, hold=held)
    linear = linearize(model, point)
    request = {
        "state": point.states._asdict(),
        "commands": point.inputs._asdict(),
        "linear": True,
    }
    (answer,) = measured(name, [request])
    states = list(model.linear)
    inputs = list(model.inputs)
    assert set(STATES) <= set(answer["x"])
    assert set(INPUTS) <= set(answer["u"])
    worst = {"A": 0.0, "B": 0.0, "beta": 0.0}
    for i, row in enumerate(answer["x"]):
        if row not in STATES:
            continue
        ours = states.index(STATES[row])
        for j, column in enumerate(answer["x"]):
            if column in STATES and (row, column) not in FAULTS:
                entry = linear.A[ours, states.index(STATES[column])]
                miss = abs(answer["A"][i][j] - entry) / max(1.0, abs(entry))
                part = "beta" if column == "Beta" else "A"
                worst[part] = max(worst[part], miss)
        for j, column in enumerate(answer["u"]):
            if INPUTS.get(column) in inputs:
                entry = linear.B[ours, inputs.index(INPUTS[column])]
                miss = abs(answer["B"][i][j] - entry) / max(1.0, abs(entry))
                worst["B"] = max(worst["B"], miss)
    return worst


@pytest.mark.slow
@pytest.mark.parametrize(
    ("name", "kcas"),
    [("737", 250.0), ("A4", 250.0), ("B747", 250.0), ("F4N", 300.0), ("T38", 300.0)],
)
def test_the_linear_model_agrees_with_jsbsims(name, kcas):
    """The linear model of a jet agrees with JSBSim's finite differences.

    The largest relative difference is below 1e-8 for A, and 2e-11 for B. The column of beta, of
    which JSBSim's differences have an error of second order, agrees to 1e-5.
    """
    worst = differences(name, kcas)
    assert worst["A"] < 1e-8
    assert worst["beta"] < 1e-5
    assert worst["B"] < 2e-11
