"""Exported loops of a linear aircraft, and the description of their FMU, computed by hand."""

from __future__ import annotations

import xml.etree.ElementTree as xml

import numpy as np
import pytest

import hfa
from hfa import Signal
from hfa_aircraft.signals import record
from hfa_flight import ActuatorBank, GainPolicy
from hfa_flight.export.exported_loop import exported_loop, following_a_reference
from hfa_flight.export.fmu import description
from hfa_support.provenance import Provenance

A = np.array([[-2.0, 0.1], [-10.0, -0.5]])
B = np.array([[3.0, 0.0], [0.5, 20.0]])
E = np.array([0.02, 1.0])
K = np.array([[0.4, 0.01], [-0.2, 0.05]])
X0, U0 = np.array([0.1, 100.0]), np.array([0.05, 0.5])


def rates(x, u, p, w):
    z, v = [x.alpha - X0[0], x.speed - X0[1]], [u.elevator - U0[0], u.throttle - U0[1]]
    names = ("alpha", "speed")
    return {
        name: sum(a * each for a, each in zip(A[row], z, strict=True))
        + sum(b * each for b, each in zip(B[row], v, strict=True))
        + E[row] * w.updraft
        for row, name in enumerate(names)
    }, {}


GLIDER = hfa.Model(
    "glider",
    {"alpha": Signal("rad", nominal=0.2), "speed": Signal("ft/s", nominal=100.0)},
    {"elevator": Signal("rad", nominal=0.1), "throttle": Signal("1", nominal=0.5)},
    rates,
    disturbances={"updraft": Signal("ft/s")},
    trim={"alpha": X0[0], "speed": X0[1]},
)
POINT = hfa.trim(GLIDER)
VALUES = record(("elevator", "throttle"))
ACTUATORS = ActuatorBank(
    VALUES(0.1, 0.5), VALUES(-9.0, -9.0), VALUES(9.0, 9.0), VALUES(0.3, 1e9), order=2, damping=0.6
)
X, U, W = np.array([0.15, 97.0]), np.array([0.02, 0.7]), np.array([4.0])
AIR = E * W[0]


def test_an_aircraft_takes_its_inputs_and_the_air() -> None:
    loop = exported_loop(GLIDER, POINT)
    found, outputs = loop.function(X, np.concatenate([W, U]))
    expected = A @ (X - X0) + B @ (U - U0) + AIR
    np.testing.assert_allclose(np.array(found).ravel(), expected, rtol=1e-10)
    assert outputs.numel() == 0
    assert [each.name for each in loop.inputs] == ["updraft", "elevator", "throttle"]
    assert [each.start for each in loop.inputs] == pytest.approx([0.0, *U0])
    assert [(each.unit, each.rate_unit, each.size) for each in loop.states] == [
        ("rad", "rad/s", 0.2),
        ("ft/s", "ft/s^2", 100.0),
    ]
    assert [each.start for each in loop.states] == pytest.approx(X0.tolist())
    assert loop.flown == 2


@pytest.mark.parametrize("order", [0, 2])
def test_a_gain_follows_its_reference_through_actuators(order: int) -> None:
    """u = U0 - K (x - X0 - r); the actuators of second order move within their rate limits."""
    bank = ACTUATORS if order else None
    loop = exported_loop(GLIDER, POINT, following_a_reference(GLIDER, GainPolicy("K", K)), bank)
    reference = np.array([0.01, -2.0])
    states = X
    command = -K @ (X - X0 - reference)
    applied = command
    if order:
        a, v = np.array([0.02, -0.1]), np.array([0.5, 0.2])
        states = np.concatenate([X, a, v])
        applied = a
    found, outputs = loop.function(states, np.concatenate([W, reference]))
    expected = A @ (X - X0) + B @ applied + AIR
    if order:
        omega = np.array([10.0, 2.0])
        expected = [*expected, 0.3, 0.2, *(omega**2 * (command - a) - 1.2 * omega * v)]
        assert [each.name for each in loop.states[2:]] == [
            *("elevator_actuator", "throttle_actuator"),
            *("elevator_actuator_rate", "throttle_actuator_rate"),
        ]
    np.testing.assert_allclose(np.array(found).ravel(), expected, rtol=1e-10)
    np.testing.assert_allclose(np.array(outputs).ravel(), U0 + applied)
    names = [each.name for each in loop.inputs]
    assert names == ["updraft", "reference_alpha", "reference_speed"]


def test_a_description_lists_states_rates_and_inputs() -> None:
    """Each variable has its place, unit and start; outputs and rates are those of the structure."""
    loop = exported_loop(GLIDER, POINT, following_a_reference(GLIDER, GainPolicy("K", K)))
    origin = Provenance("hfa export", date="2026-09-21T14:13:20Z")
    root = xml.fromstring(description(loop, origin, "abc"))
    assert (root.get("guid"), root.get("fmiVersion")) == ("abc", "2.0")
    found = []
    for place, variable in enumerate(root.iter("ScalarVariable")):
        assert variable.get("valueReference") == str(place)
        real = variable.find("Real")
        start = real.get("start")
        found.append(
            (
                variable.get("name"),
                variable.get("causality"),
                variable.get("initial"),
                real.get("unit"),
                None if start is None else float(start),
                real.get("derivative"),
            )
        )
    assert found == [
        ("alpha", "output", "exact", "rad", pytest.approx(0.1), None),
        ("speed", "output", "exact", "ft/s", pytest.approx(100.0), None),
        ("der(alpha)", "local", "calculated", "rad/s", None, "1"),
        ("der(speed)", "local", "calculated", "ft/s^2", None, "2"),
        ("elevator", "output", "calculated", "rad", None, None),
        ("throttle", "output", "calculated", "1", None, None),
        ("updraft", "input", None, "ft/s", 0.0, None),
        ("reference_alpha", "input", None, "rad", 0.0, None),
        ("reference_speed", "input", None, "ft/s", 0.0, None),
    ]
    structure = {
        each.tag: [one.get("index") for one in each] for each in root.find("ModelStructure")
    }
    assert structure == {
        "Outputs": ["1", "2", "5", "6"],
        "Derivatives": ["3", "4"],
        "InitialUnknowns": ["3", "4", "5", "6"],
    }
    units = {each.get("name"): each.find("BaseUnit") for each in root.iter("Unit")}
    assert set(units) == {"rad", "ft/s", "rad/s", "ft/s^2", "1"}
    foot = units["ft/s"]
    assert (foot.get("m"), foot.get("s"), float(foot.get("factor"))) == ("1", "-1", 0.3048)
