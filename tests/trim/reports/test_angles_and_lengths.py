"""Figures of an aircraft in closed form, and handling qualities of a model in minutes."""

import math
from dataclasses import replace
from types import SimpleNamespace

import casadi as ca
import pytest
from sheet_values import values
from twins import AREA, PLANE

import hfa
from hfa import Model, Signal


def test_figures_of_a_sheet_follow_from_the_coefficients():
    """PLANE has CL_alpha = 4.9, Cm_alpha = -0.89, and at most 3000 N of thrust at 55 m/s.

    The rate of climb left is (T_max - T) V cos α / W.
    """
    point = hfa.trim(PLANE)
    found = values(point.report().data, "stability") | values(point.report().data)
    climb = (3000.0 - point["thrust"]) * 55.0 * math.cos(point["alpha"]) / point["weight"]
    exact = {
        "CL_alpha": 4.9,
        "Cm_alpha": -0.89,
        "static margin": 0.89 / 4.9,
        "rate of climb left": climb,
        "L/D": point["lift"] / point["drag"],
        "speed / stall speed": math.sqrt(1.5 * point["dynamic_pressure"] * AREA / point["weight"]),
        "lift coefficient": point["lift"] / (point["dynamic_pressure"] * AREA),
    }
    assert {name: found[name] for name in exact} == pytest.approx(exact, rel=1e-9)
    assert "speed / stall speed at n" not in found


def body_axes(factor):
    """Return PLANE with the states u and w in place of speed and alpha, and its lift times a factor."""

    def own(x, u, p, w):
        speed, alpha = ca.sqrt(x.u**2 + x.w**2), ca.atan2(x.w, x.u)
        state = SimpleNamespace(**x._asdict(), speed=speed, alpha=alpha)
        rates, outputs = PLANE.equations(state, u, p, w)
        along, across = rates.pop("speed"), speed * rates.pop("alpha")
        rates["u"] = along * ca.cos(alpha) - across * ca.sin(alpha)
        rates["w"] = along * ca.sin(alpha) + across * ca.cos(alpha)
        return rates, outputs | {"lift": factor * outputs["lift"]}

    states = {"u": Signal("m/s", 10.0, start=55.0), "w": Signal("m/s", 10.0)}
    states |= {name: PLANE.states[name] for name in ("pitch", "pitch_rate", "altitude")}
    others = {"linear": (*states,)[:4], "steady": (*states,), "schedule": "", "modes": {}}
    held = {"u": 55.0, "altitude": 1000.0}
    return replace(PLANE, states=states, equations=own, trim=held, **others)


def test_figures_do_not_depend_on_the_axes_of_the_velocity():
    """A sheet of PLANE in body axes has the figures of that in speed and alpha, and a wrong lift a warning."""
    point = hfa.trim(body_axes(1.0))
    known = hfa.trim(PLANE, speed=math.hypot(point["u"], point["w"])).report().data
    found = point.report().data
    assert "Check:" not in point.report().title
    assert "force across" in hfa.trim(body_axes(2.0)).report().title
    assert found["not_in_model"]["static margin"] == "no states speed and alpha"
    numbers, others = (
        {name: each for name, each in values(data).items() if not isinstance(each, str)}
        for data in (found, known)
    )
    for name in numbers.keys() & others.keys():
        assert numbers[name] == pytest.approx(others[name], rel=1e-6, abs=1e-9), name


#: A model in minutes: an angle of nominal size 2 rad, with ω = 3 rad/min.
SLOW = Model(
    "slow",
    {"angle": Signal("rad", 2.0), "rate": Signal("rad/min")},
    {"torque": Signal()},
    lambda x, u, p, w: ({"angle": x.rate, "rate": -9.0 * x.angle - x.rate + u.torque}, {}),
    trim={"torque": 0.0},
    modes={"short period": ("angle", "rate")},
)


def test_handling_qualities_are_per_second():
    """The frequency of a model in minutes, 3 rad/min, is 0.05 rad/s."""
    point = hfa.trim(SLOW)
    frequency, eigenvalue = (
        point.sheet[f"short period {name}"] for name in ("frequency", "eigenvalue")
    )
    assert (frequency.value, frequency.unit) == (pytest.approx(0.05), "rad/s")
    assert (abs(eigenvalue.value), eigenvalue.unit) == (pytest.approx(0.05), "1/s")
