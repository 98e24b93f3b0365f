"""Equations of motion of a rigid body compared with conservation laws."""

from __future__ import annotations

import casadi as ca
import numpy as np
import pytest
from project import ROOT

import hfa

INERTIA = np.array([[948.0, 0.0, -150.0], [0.0, 1346.0, 0.0], [-150.0, 0.0, 1967.0]])
VALUES = {
    **{"speed": 150.0, "alpha": 0.1, "beta": -0.2, "altitude": 5000.0},
    **{"roll_rate": 0.3, "pitch_rate": -0.4, "yaw_rate": 0.5},
    **{"roll": 0.6, "pitch": -0.7, "yaw": 0.8},
}


def turned(axis: int, angle: ca.SX) -> ca.SX:
    """Return the matrix of a rotation about an axis of the body."""
    c, s = ca.cos(angle), ca.sin(angle)
    matrix = ca.SX.eye(3)
    i, j = [k for k in range(3) if k != axis]
    sign = -1.0 if axis == 1 else 1.0
    matrix[i, i] = matrix[j, j] = c
    matrix[i, j], matrix[j, i] = -sign * s, sign * s
    return matrix


def quantities(x: object) -> tuple[ca.SX, ca.SX]:
    """Return velocity over ground and angular momentum, both in axes of the ground, (3,)."""
    body_to_ground = turned(2, x.yaw) @ turned(1, x.pitch) @ turned(0, x.roll)
    along = ca.cos(x.alpha) * ca.cos(x.beta), ca.sin(x.beta), ca.sin(x.alpha) * ca.cos(x.beta)
    spin = ca.vertcat(x.roll_rate, x.pitch_rate, x.yaw_rate)
    momentum = body_to_ground @ (ca.DM(INERTIA) @ spin)
    return body_to_ground @ (x.speed * ca.vertcat(*along)), momentum


def test_a_body_without_air_falls_and_keeps_its_angular_momentum() -> None:
    """Without coefficients and thrust, the velocity changes by gravity alone."""
    model = hfa.load_model(str(ROOT / "examples/cessna182.toml"))
    still = {name: 0.0 for name in model.parameters if name[0] == "C"}
    model = model.with_parameters(**still, Ixz=150.0)
    x, u = model.layout.symbols("x", "u")
    state = model.layout.record("x", ca.vertsplit(x))
    rates = model.equations(
        state,
        model.layout.record("u", ca.vertsplit(u)),
        model.layout.record("p", model.p.tolist()),
        model.layout.record("w", [0.0] * len(model.disturbances)),
    )[0]
    rate = ca.vertcat(*(rates[name] for name in model.states))
    velocity, momentum = (ca.jtimes(each, x, rate) for each in quantities(state))
    function = ca.Function("rates", [x, u], [velocity, momentum])
    point = [VALUES[name] for name in model.states]
    falling, kept = (np.array(each).ravel() for each in function(point, [0.0] * len(model.inputs)))
    gravity = model.parameters["gravity"].start
    np.testing.assert_allclose(falling, [0.0, 0.0, gravity], atol=1e-11)
    assert np.abs(kept).max() == pytest.approx(0.0, abs=1e-10)
