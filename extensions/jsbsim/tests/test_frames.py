"""Simulations with JSBSim's integration frames, compared with JSBSim itself."""

import importlib.util
import json

import numpy as np
import pytest

import hfa
from hfa.main import main
from hfa_aircraft.waveform import Harmonic, Waveform
from hfa_flight.scenario import Scenario
from hfa_jsbsim import frame
from hfa_jsbsim.reader import read_model
from hfa_support.errors import BadInputError
from studies.jsbsim import frames
from studies.jsbsim.constructs.jet import component, jet
from studies.jsbsim.reference import responses

pytestmark = pytest.mark.skipif(
    importlib.util.find_spec("jsbsim") is None, reason="JSBSim is not installed"
)


@pytest.mark.parametrize("name", [pytest.param("737", marks=pytest.mark.slow), "c172p"])
def test_simulated_frames_agree_with_jsbsim(name):
    """Over 3 s, the states of a simulation with JSBSim's frames agree with JSBSim.

    The tolerance is 1e-9 of typical magnitudes.
    """
    miss, state = frames.largest(name, count=1, seconds=3)
    assert miss < 1e-9, state


@pytest.mark.slow
@pytest.mark.parametrize("name", ["A320", "f15", "T38", "c310", "pc7", "DHC6"])
def test_frames_of_special_components_agree_with_jsbsim(name):
    """Afterburner, governor, torque limiter, kinematics and autopilot agree with JSBSim to 1e-8."""
    miss, state = frames.largest(name, count=1)
    assert miss < 1e-8, state


def test_actuators_with_hysteresis_agree_with_jsbsim(tmp_path):
    """Speed and pitch rate agree with JSBSim for an actuator with hysteresis, also behind a filter.

    The equilibrium depends on the first frames, in which the output of filters begins at 0 and that
    of actuators at their input.
    """
    state = {"altitude": 4000.0, "speed": 320.0, "alpha": 0.05, "roll": 0.05}
    changes = [[0.2, {"elevator": 0.1, "aileron": 0.1}]]
    models, items = [], []
    for name, source in (("at_once", "attitude/phi-rad"), ("filtered", "fcs/slow")):
        path = tmp_path / "aircraft" / name / f"{name}.xml"
        path.parent.mkdir(parents=True)
        path.write_text(jet(played(source)))
        models.append(read_model(str(path)))
        flight = {"state": state, "commands": dict.fromkeys(models[-1].inputs, 0.0)}
        flight |= {"changes": changes, "step": 1.0 / 120.0, "rest": 10.0, "flight": 1}
        items.append({"aircraft": name, "root": str(tmp_path), "earth": "own", "point": flight})
    for model, item, answer in zip(models, items, responses(items), strict=True):
        ours = frames.simulated(model, item["point"], answer["start"])[-1]
        assert ours[0] == pytest.approx(answer["states"][-1]["speed"], rel=1e-11)
        pitch = list(model.states).index("pitch_rate")
        assert ours[pitch] == pytest.approx(answer["states"][-1]["pitch_rate"], rel=1e-9)


def played(source):
    """Return the XML of an actuator with hysteresis whose input is this property."""
    return component(
        '<lag_filter name="fcs/slow"> <input>attitude/phi-rad</input> <c1>5</c1> </lag_filter>'
        f' <actuator name="fcs/probe"> <input>{source}</input> <lag>30</lag>'
        " <rate_limit>0.3</rate_limit> <hysteresis_width>0.05</hysteresis_width> </actuator>"
    )


def test_frames_of_twice_the_duration_differ():
    """With frames of twice the duration, the pitch after an elevator step differs by more than
    1e-6 rad.
    """
    model = read_model("jsbsim:737")
    coarse = _pulled(model, 1.0 / 60.0)
    fine = _pulled(model, 1.0 / 120.0)
    assert np.abs(coarse - fine[::2]).max() > 1e-6


def _pulled(model, step):
    """Return the pitch in each frame during one second after an elevator step, rad.

    step: duration of a frame, s
    """
    point = hfa.trim(model, hold={"kcas": 250.0, "altitude": 10000.0})
    command = {"elevator": [(0.0, 0.1)]}
    flight = hfa.fly(model, point, command, 1.0, method="jsbsim", step=step, predict=False)
    return flight["pitch"]


def test_fly_accepts_the_method_jsbsim(capsys):
    """`hfa fly --method jsbsim` succeeds, and the JSON output contains the method and the step."""
    words = "fly --aircraft jsbsim:c172p --hold kcas=90 --law none --duration 0.2 --json"
    assert main([*words.split(), "--method", "jsbsim", "--step", "1/120"]) == 0
    data = json.loads(capsys.readouterr().out)
    assert data["method"] == "jsbsim"
    assert data["scenario"]["step"] == pytest.approx(1.0 / 120.0)


def test_other_aircraft_are_refused(capsys):
    """--method jsbsim is refused for the HFA and with --actuators.

    --step is refused without --method jsbsim.
    """
    assert main(["fly", "--method", "jsbsim"]) == 2
    assert "use --method runge-kutta" in capsys.readouterr().err
    assert main(["fly", "--step", "0.01"]) == 2
    assert "--step (step= in Python) applies only to --method jsbsim" in capsys.readouterr().err
    words = ["fly", "--aircraft", "jsbsim:c172p", "--method", "jsbsim", "--actuators", "0.05:60"]
    assert main(words) == 2
    assert "does not support --actuators" in capsys.readouterr().err


def test_engines_that_do_not_settle_are_reported(monkeypatch):
    """A warning is issued if engines or filters do not settle in the allowed time, here 0.1 s."""
    monkeypatch.setattr(frame, "_LONGEST", 0.1)
    model = read_model("jsbsim:c172p")
    point = hfa.trim(model, hold={"kcas": 90.0, "altitude": 3000.0})
    steps = model.equations.jsbsim_steps(1.0 / 120.0)
    with pytest.warns(UserWarning, match="not in steady state after 0.1 s"):
        steps.begin(point.states, model.p, point.inputs)


def test_disturbances_are_refused():
    """A sinusoidal disturbance is refused, although it is 0 at the start."""
    model = read_model("jsbsim:737")
    point = hfa.trim(model, hold={"kcas": 250.0, "altitude": 10000.0})
    amplitude = np.full(len(model.linear), 1e-3)
    nothing = np.zeros(len(model.linear))
    pushes = Waveform(nothing, nothing, (Harmonic(1.0, amplitude, nothing),))
    scenario = Scenario(duration=1.0, disturbance=pushes)
    with pytest.raises(BadInputError, match="does not support --disturbance"):
        hfa.fly(model, point, scenario=scenario, method="jsbsim")


def test_surfaces_as_inputs_are_refused():
    """JSBSim's frames are refused for an aircraft whose inputs are surfaces, such as the f16."""
    with pytest.raises(BadInputError, match="is a surface"):
        read_model("jsbsim:f16").equations.jsbsim_steps(1.0 / 120.0)
