"""Trims of JSBSim's aircraft, and the reasons reported if no trim exists."""

import importlib.util
import re

import numpy as np
import pytest
from small_aircraft import glider, written

from hfa import BadInputError, linearize, trim
from hfa_aircraft.loading import load_model
from hfa_aircraft.rigid.atmosphere import air_at
from hfa_jsbsim.speeds import speed_and_density
from trim.point.condition import release, usual_condition
from trim.point.solve import TrimError, explained
from trim.sweeps.points import TRIMMED, trim_points

needs_jsbsim = pytest.mark.skipif(
    importlib.util.find_spec("jsbsim") is None, reason="JSBSim's data are not installed"
)


def condition_of(model, **held):
    return release(usual_condition(model), hold=held)


@needs_jsbsim
@pytest.mark.parametrize(
    ("name", "kcas", "altitude"),
    [("c172p", 90.0, 5000.0), ("sgs126", 60.0, 3000.0)],
)
def test_aircraft_are_trimmed_at_a_calibrated_airspeed(name, kcas, altitude):
    """A propeller aircraft and a glider are trimmed at the imposed calibrated airspeed.

    The flight path is level with a throttle, and descends without one.
    """
    model = load_model(f"jsbsim:{name}")
    point = trim(model, condition_of(model, kcas=kcas, altitude=altitude))
    outputs = model.outputs_at(point.states, point.inputs)
    assert outputs["kcas"] == pytest.approx(kcas, abs=1e-9)
    if "throttle" in model.inputs:
        assert outputs["gamma"] == pytest.approx(0.0, abs=1e-9)
    else:
        assert outputs["gamma"] < -0.02


@pytest.mark.parametrize("kcas", [250.0, 720.0])
def test_a_calibrated_airspeed_has_its_impact_pressure(kcas):
    """The impact pressure of a speed at altitude is that of its calibrated airspeed at sea level.

    Source: the formulas of Saint-Venant and Rayleigh, below and above Mach 1.
    """

    def ratio(mach):
        if mach < 1.0:
            return (1.0 + 0.2 * mach**2) ** 3.5 - 1.0
        return 166.92158 * mach**7 / (7.0 * mach**2 - 1.0) ** 2.5 - 1.0

    ground, air = air_at(0.0), air_at(20000.0)
    speed, density = speed_and_density({"kcas": kcas}, 20000.0)
    at_ground = float(ground.pressure) * ratio(kcas * 1.6878099 / float(ground.sound))
    found = float(air.pressure) * ratio(speed / float(air.sound))
    assert found == pytest.approx(at_ground, rel=1e-5)
    assert density == pytest.approx(float(air.density), rel=1e-9)


@needs_jsbsim
def test_yaw_that_only_switches_is_no_obstacle():
    """The F-16 is linearized, although its yaw enters the equations only as a switch condition.

    Linear models do not contain yaw.
    """
    model = load_model("jsbsim:f16")
    linear = linearize(model, trim(model))
    assert "yaw" not in linear.states
    assert np.isfinite(linear.A).all()


@needs_jsbsim
def test_trims_at_equal_kcas_mach_and_speed_agree():
    """Trims at the same kcas, Mach number or true airspeed have equal speeds, also in a sweep over
    kcas.
    """
    model = load_model("jsbsim:737")
    first = trim(model, condition_of(model, altitude=20000.0, kcas=250.0))
    speeds = [first.states.speed]
    mach = model.outputs_at(first.states, first.inputs)["mach"]
    for held in ({"mach": mach}, {"speed": speeds[0]}):
        point = trim(model, condition_of(model, altitude=20000.0, **held))
        speeds.append(point.states.speed)
    assert speeds == pytest.approx([speeds[0]] * 3, rel=1e-12)
    grid = np.array([[250.0, 20000.0], [260.0, 18000.0]])
    swept = trim_points(model, ("kcas", "altitude"), grid)
    assert (swept.status == TRIMMED).all()
    assert swept.states[0, 0] == pytest.approx(speeds[0], rel=1e-12)


@needs_jsbsim
def test_the_linear_model_contains_the_propeller_mode():
    """The linear model of a propeller aircraft contains the propeller mode beside the modes of the
    airframe.
    """
    model = load_model("jsbsim:c172p")
    point = trim(model, condition_of(model, kcas=90.0, altitude=5000.0))
    linear = linearize(model, point)
    modes = {mode.name: mode for mode in linear.modes}
    assert {"phugoid", "dutch roll", "short period", "roll", "spiral"} <= set(modes)
    rate = min(np.linalg.eigvals(linear.A).real, key=lambda value: abs(value + 1.75))
    assert rate == pytest.approx(-1.7517, abs=1e-3)


@needs_jsbsim
def test_a_governed_propeller_trims_at_lowest_blade_angle():
    """At low speed a governed propeller is trimmed at the lowest blade angle and below 2400 rpm.

    At high speed the propeller turns at 2400 rpm.
    """
    model = load_model("jsbsim:c182")
    fast = trim(model, condition_of(model, kcas=110.0, altitude=5000.0))
    slow = trim(model, condition_of(model, kcas=60.0, altitude=1000.0))
    assert fast.states.rpm0 == pytest.approx(2400.0)
    assert slow.states.rpm0 < 2400.0
    assert slow.states.blade0 == pytest.approx(model.states["blade0"].min, abs=1e-9)


@needs_jsbsim
@pytest.mark.parametrize(
    ("name", "held", "reason"),
    [
        pytest.param(
            "B17",
            {"kcas": 130.0, "altitude": 5000.0},
            r"full throttle gives 1563 lb from 4 x 520 hp: 214\d of 370\d lb of thrust missing",
            marks=pytest.mark.slow,
        ),
        (
            "mk82",
            {"kcas": 200.0, "altitude": 5000.0},
            "no input of the pilot changes a force or a moment",
        ),
        pytest.param(
            "fokker50",
            {"kcas": 130.0, "altitude": 5000.0},
            r"full throttle gives 11\d\d lb from 2 x 14\d hp: 10\d\d of 22\d\d lb of thrust missing",
            marks=pytest.mark.slow,
        ),
        pytest.param(
            "B747",
            {"kcas": 75.0, "altitude": 1000.0},
            r"the greatest lift is 2\d % of the weight, at alpha 13.5 deg",
            marks=pytest.mark.slow,
        ),
        (
            "C130",
            {"kcas": 160.0, "altitude": 8000.0},
            r"4 x 13 hp: .*; t56 is a turbine engine on a propeller; its thrust is interpreted as power",
        ),
    ],
)
def test_missing_trims_are_explained(name, held, reason):
    """The message on a missing trim states its physical reason for each aircraft."""
    model = load_model(f"jsbsim:{name}")
    message = explained_failure(model, **held)
    assert re.search(f"^no trim: .*{reason}", message)
    assert "\n" not in message


def explained_failure(model, **held):
    """Return the error text, with reasons, for a condition without a trim.

    held: imposed values
    """
    condition = condition_of(model, **held)
    with pytest.raises(TrimError) as caught:
        trim(model, condition)
    return str(explained(caught.value, model, condition))


@needs_jsbsim
def test_failed_engines_are_not_counted():
    """The message on missing thrust counts only the engines that run."""
    model = load_model("jsbsim:c310").with_parameters(engine1=0.0)
    message = explained_failure(model, speed=250.0, altitude=5000.0)
    assert re.search(r"full throttle gives \d+ lb from 1 x \d+ hp: ", message)


@needs_jsbsim
def test_an_empty_tank_is_noted():
    """An empty tank is noted, and the trim is a glide."""
    model = load_model("jsbsim:X15")
    assert any("tank of" in note and "the trim is a glide" in note for note in model.about.notes)
    assert "gamma" not in model.trim


def test_failed_slow_trims_report_the_greatest_lift(tmp_path):
    """A failed trim at low speed reports the greatest lift."""
    model = load_model(written(tmp_path, glider()))
    assert "greatest lift" in explained_failure(model, speed=15.0)


def test_missing_jsbsim_aircraft_are_refused(monkeypatch, tmp_path):
    """A missing aircraft folder is refused. An unknown name is refused with the aircraft that
    exist.

    An aircraft in the folder is read by its name.
    """
    monkeypatch.setenv("JSBSIM_ROOT", str(tmp_path))
    with pytest.raises(BadInputError, match="which contains no folder named aircraft"):
        load_model("jsbsim:737")
    written(tmp_path, glider())
    with pytest.raises(BadInputError, match="JSBSim has no aircraft '737'; choose from glider"):
        load_model("jsbsim:737")
    with pytest.raises(BadInputError, match="'Glyder'; did you mean glider"):
        load_model("jsbsim:Glyder")
    model = load_model("jsbsim:glider")
    assert (model.name, model.about.aliases["vc-kts"]) == ("glider", "kcas")
