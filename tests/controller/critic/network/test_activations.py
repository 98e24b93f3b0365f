"""Derivatives of activation functions."""

from __future__ import annotations

import math

import casadi as ca
import numpy as np
import pytest

from controller.critic.network.activations import ACTIVATIONS


@pytest.mark.parametrize("name", ["tanh", "sigmoid", "softplus", "gelu"])
def test_derivatives_of_smooth_activations_are_as_expected(name: str) -> None:
    """Smooth activations have the expected first and second derivative at 0.

    Both derivatives are finite at arguments of ±1e4.
    """
    x = ca.SX.sym("x")
    y = ACTIVATIONS[name](np.array([x], dtype=object))[0]
    f = ca.Function("f", [x], [ca.gradient(y, x), ca.gradient(ca.gradient(y, x), x)])
    at_zero = {
        "tanh": (1, 0),
        "sigmoid": (0.25, 0),
        "softplus": (0.5, 0.25),
        "gelu": (0.5, math.sqrt(2 / math.pi)),
    }
    assert [float(each) for each in f(0.0)] == pytest.approx(at_zero[name], abs=1e-12)
    assert all(math.isfinite(each) for far in (-1e4, 1e4) for each in map(float, f(far)))
