"""Alternative variables in a trim condition, such as mach in place of speed."""

import pytest

import hfa
from hfa import Model, Signal
from hfa.extend import Trimming
from trim.point.condition import stated_values


def equations(x, u, p, w):
    return {"speed": u.thrust - x.speed}, {"knots": 2.0 * x.speed, "mach": x.speed / 100.0}


MODEL = Model(
    "dart",
    {"speed": Signal()},
    {"thrust": Signal()},
    equations,
    outputs={"knots": Signal(), "mach": Signal()},
    trim={"speed": 7.0},
    trimming=Trimming(
        alternatives=(("speed", "knots", "mach"),),
        begin=lambda imposed: {
            "speed": imposed.get("knots", 0.0) / 2.0 + imposed.get("mach", 0.0) * 100.0
        },
    ),
)


@pytest.mark.parametrize(
    ("held", "speed"),
    [
        ({}, 7.0),
        ({"speed": 8.0}, 8.0),
        ({"knots": 6.0}, 3.0),
        ({"mach": 0.5}, 50.0),
        ({"knots": 6.0, "mach": 0.03}, 3.0),
    ],
)
def test_a_held_alternative_frees_the_speed(held, speed):
    """The trim of MODEL imposes the speed 7. Knots (2 x speed) or a Mach number (speed / 100) are declared as
    alternatives: if one or both are held, the speed follows from them. Its thrust equals the speed.
    """
    point = hfa.trim(MODEL, hold=held)
    assert (point["speed"], point["thrust"]) == pytest.approx((speed, speed))


def test_a_rate_of_0_that_the_model_does_not_balance_is_stated():
    """A condition file states only what differs from the model's own trim. The flexible aircraft does not
    balance the altitude, so that an imposed climb rate of 0 is stated. The free gamma is then 0.
    """
    point = hfa.trim(hfa.aircraft(), altitude_dot=0.0, free="gamma")
    assert stated_values(point.trim_problem.asked).held == {"altitude_dot": 0.0}
    assert point["gamma"] == pytest.approx(0.0, abs=1e-12)
