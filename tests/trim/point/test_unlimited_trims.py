"""Trims of aircraft that declare no limits. They remain in the usual range of flight."""

import casadi as ca
import numpy as np
import pytest

import hfa
from hfa import Model, Signal

_MASS = 10.0
_GRAVITY = 9.81


def turning(x, u, p, w):
    """Return the rates of a point mass in a turn, and its turn rate as an output.

    m V turn = L sin(bank), m g = L cos(bank), m V' = T - D.
    """
    lift = u.lift * x.speed**2
    drag = 0.02 * x.speed**2 + 0.1 * u.lift**2 * x.speed**2
    rates = {
        "speed": (u.thrust - drag) / _MASS,
        "climb": lift * ca.cos(x.bank) / _MASS - _GRAVITY,
        "bank": u.roll_rate,
    }
    return rates, {"turn": lift * ca.sin(x.bank) / (_MASS * x.speed)}


TURNING = Model(
    "turning",
    {
        "speed": Signal("m/s", nominal=10.0, start=30.0),
        "climb": Signal("m/s", nominal=10.0),
        "bank": Signal("rad"),
    },
    {
        "thrust": Signal("N", nominal=100.0, start=100.0),
        "lift": Signal("kg/m", start=0.1),
        "roll_rate": Signal("rad/s"),
    },
    turning,
    outputs={"turn": Signal("rad/s")},
    trim={"speed": 30.0, "climb": 0.0, "turn": 0.1},
)


@pytest.mark.parametrize(("speed", "turn"), [(30.0, 0.1), (300.0, 1.5), (1e3, 1.5)])
def test_an_unlimited_bank_stays_below_a_quarter_turn(speed, turn):
    """Without limits, the bank angle satisfies tan(bank) = V turn / g and is below 90 deg."""
    point = hfa.trim(TURNING, hold={"speed": speed, "turn": turn})
    assert point["bank"] == pytest.approx(np.arctan(speed * turn / _GRAVITY), rel=1e-9)
    assert point["lift"] > 0.0
