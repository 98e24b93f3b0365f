"""Warning about equations that compute the sine, cosine or tangent of a signal in degrees."""

import casadi as ca
import pytest

import hfa
from hfa import Model, Signal
from hfa_aircraft import in_si


def pendulum(torque):
    """Return a pendulum whose angle is declared in degrees.

    torque: function of the angle
    """

    def equations(x, u, _p, _w):
        rates = {"angle": x.rate, "rate": u.moment - torque(x.angle) - x.rate}
        return rates, {"height": x.angle * 0.1}

    return Model(
        "pendulum",
        states={"angle": Signal("deg"), "rate": Signal("deg/s")},
        inputs={"moment": Signal("1")},
        outputs={"height": Signal("ft")},
        equations=equations,
        trim={"angle": 10.0},
    )


@pytest.mark.parametrize(
    ("torque", "function"),
    [
        (ca.sin, "sin"),
        (lambda angle: ca.cos(-angle + 90.0), "cos"),
        (lambda angle: angle - ca.tan(angle), "tan"),
    ],
)
def test_a_sine_of_degrees_causes_a_warning(torque, function):
    """A trigonometric function of an angle in degrees causes a warning that names the function.

    The trim of the model in SI units has the same warning.
    """
    model = pendulum(torque)
    # The angle is held at 10 deg and its rate is free, so that the moment balances the torque.
    (note,) = hfa.trim(model, free="angle_dot").warnings
    assert note.startswith(
        f"the equations compute the {function} of angle, which is declared in deg"
    )
    assert hfa.trim(in_si(model), free="angle_dot").warnings == [note]


def test_converted_angles_cause_no_warning():
    """Equations that convert degrees to radians cause no warning."""
    model = pendulum(lambda angle: ca.sin(angle * ca.pi / 180))
    assert hfa.trim(model, free="angle_dot").warnings == []
