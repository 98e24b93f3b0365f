"""Trims of JSBSim's own aircraft, where the package jsbsim is installed."""

import importlib.util

import pytest

from hfa_aircraft.loading import load_model
from trim import find_operating_point
from trim.point.condition import release, usual_condition

pytestmark = pytest.mark.skipif(
    importlib.util.find_spec("jsbsim") is None, reason="JSBSim's data are not installed"
)


@pytest.mark.parametrize(
    ("name", "kcas", "altitude"),
    [("737", 250.0, 15000.0), ("c172p", 90.0, 5000.0), ("sgs126", 60.0, 3000.0)],
)
def test_a_jet_a_propeller_aircraft_and_a_glider_fly_at_a_calibrated_speed(name, kcas, altitude):
    model = load_model(f"jsbsim:{name}")
    condition = release(usual_condition(model), hold={"kcas": kcas, "altitude": altitude})
    point = find_operating_point(model, condition)
    outputs = model.outputs_at(point.states, point.inputs)
    assert point.status == "trimmed"
    assert outputs["kcas"] == pytest.approx(kcas, abs=1e-6)
    level = "throttle" in model.inputs
    assert outputs["gamma"] == pytest.approx(0.0, abs=1e-9) if level else outputs["gamma"] < -0.02
