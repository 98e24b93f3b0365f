"""Values and derivatives of activation functions, and chains of layers on rows."""

from __future__ import annotations

import math

import casadi as ca
import numpy as np
import pytest
from scipy.special import expit, ndtr

from controller.critic.network.activations import ACTIVATIONS
from controller.critic.network.row_network import ROW_ACTIVATIONS, row_network

X = np.array([-50.0, -3.0, -0.5, 0.0, 0.5, 3.0, 50.0])
ELU = np.where(X > 0.0, X, np.expm1(np.minimum(X, 0.0)))
#: The definitions of the activations, at X.
EXACT = {
    "tanh": np.tanh(X),
    "relu": X * (X > 0.0),
    "leaky_relu": np.where(X > 0.0, X, 0.01 * X),
    "sigmoid": expit(X),
    "softplus": np.logaddexp(0.0, X),
    "elu": ELU,
    "gelu": X * ndtr(X),
    "silu": X * expit(X),
    "selu": 1.0507009873554805 * np.where(X > 0.0, X, 1.6732632423543772 * ELU),
    "sin": np.sin(X),
}


@pytest.mark.parametrize("name", ACTIVATIONS)
def test_each_activation_has_the_values_of_its_definition(name: str) -> None:
    """As an expression, and on rows if there is such a version."""
    x = ca.SX.sym("x", len(X))
    y = ACTIVATIONS[name](np.array(ca.vertsplit(x), dtype=object))
    found = np.array(ca.Function("f", [x], [ca.vertcat(*y)])(X)).ravel()
    assert found == pytest.approx(EXACT[name], rel=1e-13, abs=1e-15)
    if name in ROW_ACTIVATIONS:
        assert ROW_ACTIVATIONS[name](X.copy()) == pytest.approx(EXACT[name], rel=1e-13, abs=1e-15)


@pytest.mark.parametrize("width", [4, 130])
def test_a_chain_of_layers_on_many_rows_equals_numpy(width: int) -> None:
    """More rows than one product takes; a wide layer is computed in single precision."""
    rng = np.random.default_rng(1)
    W, c = rng.standard_normal((width, width)) / width, rng.standard_normal(width)
    V, d = rng.standard_normal((2, width)), rng.standard_normal(2)
    x = rng.standard_normal((1234, width))
    chain = row_network([(W, c, "tanh"), (V, d, "")])
    assert chain is not None
    found = chain(x)
    assert (found.shape, found.dtype) == ((1234, 2), np.dtype(float))
    assert found == pytest.approx(
        np.tanh(x @ W.T + c) @ V.T + d, abs=1e-12 if width < 128 else 1e-4
    )
    assert row_network([(W, c, "gelu")]) is None


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
