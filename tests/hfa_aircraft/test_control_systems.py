"""Conversion of models to and from nonlinear systems of python-control."""

import math

import control
import numpy as np
import pytest
from cli import refused

from hfa import linearize, trim
from hfa_aircraft import from_control, to_control
from trim import usual_condition


def pendulum(t, x, u, params):
    return [x[1], -params["stiffness"] * np.sin(x[0]) - 0.1 * x[1] + u[0]]


def system(update, **more):
    names = {
        "states": ["angle", "rate"],
        "inputs": ["torque"],
        "outputs": ["height"],
        "params": {"stiffness": 4.0},
    }
    return control.nlsys(
        update, lambda t, x, u, params: [1 - np.cos(x[0])], name="pendulum", **{**names, **more}
    )


def test_a_system_of_python_control_is_traced():
    """A nonlinear system of python-control becomes a model with its names, parameters and outputs, whose
    equations are symbolic.

    The linear model agrees with the finite differences of python-control. Converted back, the
    system has the same rates and outputs, also with another value of a parameter.
    """
    nlsys = system(pendulum)
    model = from_control(
        nlsys, {"angle": "rad", "rate": "rad/s", "height": "m"}, trim={"angle": 0.5}
    )
    point = trim(model, usual_condition(model))
    assert point.inputs.torque == pytest.approx(4.0 * math.sin(0.5), rel=1e-12)
    linear = linearize(model, point, outputs=("height",))
    peer = control.linearize(nlsys, [0.5, 0.0], [point.inputs.torque])
    for matrix in "ABCD":
        np.testing.assert_allclose(getattr(linear, matrix), getattr(peer, matrix), atol=1e-5)
    back = to_control(model)
    assert back.output_labels == ["angle", "rate", "height"]
    np.testing.assert_allclose(back.output(0.0, [0.5, 0.0], [0.0]), [0.5, 0.0, 1 - math.cos(0.5)])
    heavier = back.dynamics(0.0, [0.5, 0.0], [0.0], params={"stiffness": 8.0})
    np.testing.assert_allclose(
        heavier, nlsys.dynamics(0.0, [0.5, 0.0], [0.0], params={"stiffness": 8.0})
    )


@pytest.mark.parametrize(
    ("made", "words"),
    [
        (
            lambda: system(lambda t, x, u, p: [x[1], u[0] if x[0] > 0 else 0]),
            "pendulum: the equations fail",
        ),
        (
            lambda: system(lambda t, x, u, p: [x[1], math.sin(x[0])]),
            "uses float or math",
        ),
        (
            lambda: system(lambda t, x, u, p: [x[1], np.sin(t)]),
            "pendulum depends on time, which is not supported; declare",
        ),
        (
            lambda: system(pendulum, dt=0.1),
            "pendulum is in discrete time, which is not supported; give a system in continuous time",
        ),
    ],
)
def test_an_untraceable_system_is_refused(made, words):
    """A system that cannot be evaluated with symbols is refused with a one-line message."""
    assert words in refused(from_control, made(), {})
