"""Airspeeds imposed in place of the speed, and air that is warmer than the standard atmosphere."""

import json
import math

import pytest
from cli import assert_refused, hfa, refused
from project import ROOT
from standard_airspeeds import KNOT, air, calibrated, equivalent

import hfa as tool
from hfa import trim

UAV = f"{ROOT}/examples/uav.toml"
#: Airspeed -> its formula: (true airspeed in m/s, air) -> airspeed in kt, or Mach.
FORMULAS = {
    "kcas": calibrated,
    "keas": equivalent,
    "ktas": lambda speed, at: speed / KNOT,
    "mach": lambda speed, at: speed / at.sound,
}


@pytest.fixture(scope="module")
def uav():
    return tool.load_model(UAV)


@pytest.mark.parametrize("name", FORMULAS)
def test_an_imposed_airspeed_gives_the_true_airspeed(name, uav):
    """The calibrated, equivalent or true airspeed, or the Mach number, of a flight at 33 m/s is computed by a
    formula of the tests and imposed: the trim is at 33 m/s, with its dynamic pressure and Mach number.

    The air is 15 K warmer than the standard atmosphere.
    """
    there = air(3000.0, warmer=15.0)
    value = FORMULAS[name](33.0, there)
    point = trim(uav.with_parameters(isa=15.0), hold={name: value, "altitude": 3000.0})
    assert point["speed"] == pytest.approx(33.0, rel=3e-5)
    outputs = point["dynamic_pressure"], point["mach"]
    expected = 0.5 * there.density * 33.0**2, 33.0 / there.sound
    assert outputs == pytest.approx(expected, rel=1e-4)


@pytest.mark.parametrize("source", ["HFA", "f16.py:F16"])
def test_other_aircraft_with_altitude_and_speed_have_airspeeds(source):
    """The paper's aircraft and the F-16, an aircraft in Python, have their usual speed in a trim with its
    equivalent airspeed imposed and, if they have a dynamic pressure, its calibrated airspeed.
    """
    model = tool.aircraft() if source == "HFA" else tool.load_model(f"{ROOT}/examples/{source}")
    usual = trim(model)
    speed = next(name for name in ("speed", "vt") if name in model.states)
    to_metres = 0.3048
    there = air(usual["altitude"] * to_metres)
    value = equivalent(usual[speed] * to_metres, there)
    point = trim(model, keas=value)
    assert point[speed] == pytest.approx(usual[speed], rel=5e-4)
    if "dynamic_pressure" in model.outputs:
        assert point.sheet["equivalent airspeed"].value == pytest.approx(value, rel=1e-9)
        again = trim(model, kcas=point.sheet["calibrated airspeed"].value)
        assert again[speed] == pytest.approx(point[speed], rel=1e-9)


#: 3000 ft of geopotential altitude, with the radius of the standard atmosphere, m.
AT_FL030 = 6356766.0 * 914.4 / (6356766.0 - 914.4)


def test_a_trim_reads_texts_with_units(uav):
    """A trim in Python and `hfa trim` read texts with units as the numbers that they are.

    A flight level is a pressure altitude: FL030 is 3000 ft of geopotential altitude.
    """
    typed = {"kcas": "70 mph", "altitude": "FL030", "gamma": "2 deg"}
    point = trim(uav, hold=typed)
    words = [f"--hold {name}={value.replace(' ', '')}" for name, value in typed.items()]
    run = hfa("trim", "--aircraft", UAV, "--json", *" ".join(words).split())
    found = json.loads(run.out)["operating_point"]["states"]
    assert found == pytest.approx(point.states._asdict(), rel=1e-12, abs=1e-15)
    kcas = 70.0 * 1609.344 / 1852.0
    in_numbers = trim(uav, kcas=kcas, altitude=AT_FL030, gamma=math.radians(2.0))
    assert point["speed"] == pytest.approx(in_numbers["speed"], rel=1e-12)


@pytest.mark.parametrize(
    ("held", "words"),
    [
        ({"kcas": 60.0, "keas": 60.0}, "kcas and keas are both imposed"),
        ({"kcas": float("nan")}, "kcas is nan; give a finite number"),
        ({"kcas": 0.0}, "give a positive speed"),
        ({"speed": "30 kg"}, "speed is '30 kg'; give a finite number, in m/s"),
    ],
)
def test_wrong_airspeeds_are_refused(held, words, uav):
    """Two speeds at one altitude, speeds that are not positive, and wrong units are refused."""
    assert words in refused(trim, uav, hold=held)


@pytest.mark.parametrize(
    ("words", "message"),
    [
        ("--isa 15 --hold isa=10", "--isa and --hold isa"),
        ("--isa 200", "isa is 200 K; give at most 100 K"),
    ],
)
def test_wrong_temperature_deviations_are_refused(words, message):
    """A temperature deviation given twice or beyond its limit is refused."""
    assert_refused(hfa("trim", "--aircraft", UAV, *words.split()), 2, message)


def test_a_temperature_deviation_is_refused_if_the_equations_compute_the_air():
    """--isa, a deviation from the standard temperature, is refused for the F-16, whose equations have their
    own air.
    """
    run = hfa("trim", "--aircraft", f"{ROOT}/examples/f16.py:F16", "--isa", "15")
    assert_refused(run, 2, "has air of its own")
