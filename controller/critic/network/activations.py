"""Activation functions on NumPy arrays whose entries are CasADi scalars.

NumPy broadcasts, reshapes and multiplies such arrays. CasADi differentiates the result exactly.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from typing import Any

import casadi as ca
import numpy as np


def on_entries(function: Callable[..., Any]) -> Callable[..., np.ndarray]:
    """Return a function that applies `function` to each entry of an array of CasADi scalars.

    Keyword arguments are passed unchanged to each call.
    """
    return np.vectorize(function, otypes=[object])


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


#: Activations by the names of `--set activation`.
ACTIVATIONS: Mapping[str, Callable[..., np.ndarray]] = {
    "tanh": on_entries(ca.tanh),
    "relu": on_entries(_relu),
    "leaky_relu": on_entries(_leaky_relu),
    "sigmoid": on_entries(_sigmoid),
    "softplus": on_entries(_softplus),
    "elu": on_entries(_elu),
    "gelu": on_entries(_gelu),
    "silu": on_entries(lambda x: x * _sigmoid(x)),
    "selu": on_entries(_selu),
    "sin": on_entries(ca.sin),
}
