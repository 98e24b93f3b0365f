"""Sweeps that cannot be computed are refused, each with what is wrong."""

import numpy as np
import pytest
from cli import refused

import hfa
from hfa.paper import level_flight
from trim import load_condition, release, trim_points

HFA = hfa.aircraft()
LEVEL = level_flight(0.2)
CALLS = {
    "dihedral is -114.592 deg; give a value between -60 deg and 60 deg": lambda: hfa.sweep(
        HFA, speed=[60.0, 62.0], dihedral=[0.1, -2.0, 0.0]
    ),
    "throttle is 50; give a value between 0 and 40": lambda: hfa.sweep(
        HFA, {"throttle": [0.0, 50.0]}, condition=release(LEVEL, limits={"throttle": (0.0, 40.0)})
    ),
    "alpha is given for dihedral from 0 deg to 20 deg": lambda: hfa.sweep(
        HFA, {"dihedral": [0.1, 0.5]}, condition=load_condition("simvfa-64")
    ),
    "speed has masked entries": lambda: hfa.sweep(HFA, speed=np.ma.masked_less([60.0, 68.0], 65.0)),
    "panel_mass is -1 slug to 10 slug in the sweep; give values between 0 slug": lambda: hfa.sweep(
        HFA, panel_mass=[-1.0, 10.0]
    ),
    "no point of the sweep has a trim": lambda: hfa.sweep(HFA, speed=[5.0, 6.0]).plot(),
    "the columns of a list of points have": lambda: hfa.sweep(
        HFA, {"dihedral": [0.1, 0.2], "speed": [68.0]}, listed=True
    ),
    "the values of speed are 68.0; give a list": lambda: hfa.sweep(HFA, {"speed": 68.0}),
    "no variable is swept; choose from": lambda: hfa.sweep(HFA, {}),
    "dihedral is 80 deg; give a value between": lambda: hfa.sweep(
        HFA, dihedral=["0 deg", "80 deg"]
    ),
    "the sweep has 1,000,001,000,000 points": lambda: hfa.sweep(
        HFA, speed=np.linspace(60.0, 70.0, 1_000_000), dihedral=np.linspace(0.0, 0.1, 1_000_001)
    ),
    "(3,); give (N, 2), a column for each": lambda: trim_points(
        HFA, ("speed", "alpha"), np.ones(3)
    ),
    "(1, 3); give (N, 2)": lambda: trim_points(HFA, ("speed", "alpha"), np.ones((1, 3))),
    "cannot sweep 'sped'; did you mean speed": lambda: hfa.sweep(HFA, sped=[60.0]),
    "at and dihedral are the same": lambda: hfa.sweep(HFA, dihedral=[0.1], at=[0.1]),
}


@pytest.mark.parametrize("message", CALLS)
def test_faulty_sweeps_are_refused(message):
    assert message in refused(CALLS[message])
