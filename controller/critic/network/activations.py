"""Activation functions of CasADi expressions, which CasADi differentiates exactly."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from typing import Any

import casadi as ca

from hfa_support.errors import refuse_unknown


def _relu(x: Any) -> Any:
    return ca.fmax(x, 0.0)


def _leaky_relu(x: Any, alpha: float = 0.01) -> Any:
    return ca.fmax(x, 0.0) + alpha * ca.fmin(x, 0.0)


def _sigmoid(x: Any) -> Any:
    # 1 / (1 + exp(-x)) overflows for large -x, and its derivative is then nan.
    return 0.5 + 0.5 * ca.tanh(0.5 * x)


def _softplus(x: Any) -> Any:
    # log(1 + exp(x)); beyond 40 it is x to the last digit.
    return ca.if_else(x > 40.0, x, ca.log1p(ca.exp(ca.fmin(x, 40.0))))


def _elu(x: Any, alpha: float = 1.0) -> Any:
    return ca.fmax(x, 0.0) + alpha * ca.expm1(ca.fmin(x, 0.0))


def _gelu(x: Any, approximate: str = "none") -> Any:
    if approximate == "tanh":
        return 0.5 * x * (1.0 + ca.tanh(math.sqrt(2.0 / math.pi) * (x + 0.044715 * x**3)))
    return 0.5 * x * (1.0 + ca.erf(x / math.sqrt(2.0)))


def _selu(x: Any, alpha: float = 1.6732632423543772, gamma: float = 1.0507009873554805) -> Any:
    return gamma * (ca.fmax(x, 0.0) + alpha * ca.expm1(ca.fmin(x, 0.0)))


#: Activations by the names of `--set activation`: those of torch's classes, in lower case.
ACTIVATIONS: Mapping[str, Callable[..., Any]] = {
    "tanh": ca.tanh,
    "relu": _relu,
    "leaky_relu": _leaky_relu,
    "sigmoid": _sigmoid,
    "softplus": _softplus,
    "elu": _elu,
    "gelu": _gelu,
    "silu": lambda x: x * _sigmoid(x),
    "selu": _selu,
    "sin": ca.sin,
}


def activation_named(name: str) -> str:
    """Return the name of an activation in `ACTIVATIONS`: "relu" for "ReLU" and "relu".

    Raises BadInputError for an unknown activation.
    """
    plain = {each.replace("_", ""): each for each in ACTIVATIONS}
    found = plain.get(name.strip().lower().replace("_", ""), name)
    refuse_unknown("unknown activation", found, ACTIVATIONS)
    return found
