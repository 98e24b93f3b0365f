"""Figures of an aircraft in closed form, and handling qualities of a model in minutes."""

import math

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
        "lift coefficient": point["lift"] / (point["dynamic_pressure"] * AREA),
    }
    assert {name: found[name] for name in exact} == pytest.approx(exact, rel=1e-9)


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
