"""Activation functions, of CasADi expressions, which CasADi differentiates exactly, and of arrays.

The functions of an activation are those of a module `f`: casadi, or `ON_ARRAYS` of NumPy.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from types import SimpleNamespace
from typing import Any

import casadi as ca
import numpy as np

from hfa_support.errors import refuse_unknown

#: NumPy's functions by CasADi's names. nan stays nan, where np.fmax would return the other number.
ON_ARRAYS = SimpleNamespace(
    tanh=np.tanh, sin=np.sin, expm1=np.expm1, fmax=np.maximum, fmin=np.minimum, fabs=np.abs
)


def _leaky_relu(x: Any, f: Any = ca, alpha: float = 0.01) -> Any:
    return f.fmax(x, 0.0) + alpha * f.fmin(x, 0.0)


def _sigmoid(x: Any, f: Any = ca) -> Any:
    # 1 / (1 + exp(-x)) overflows for large -x, and its derivative is then nan.
    return 0.5 + 0.5 * f.tanh(0.5 * x)


def _elu(x: Any, f: Any = ca, alpha: float = 1.0) -> Any:
    return f.fmax(x, 0.0) + alpha * f.expm1(f.fmin(x, 0.0))


def _selu(
    x: Any, f: Any = ca, alpha: float = 1.6732632423543772, gamma: float = 1.0507009873554805
) -> Any:
    return gamma * _elu(x, f, alpha)


def _softplus(x: Any) -> Any:
    # log(1 + exp(x)); beyond 40 it is x to the last digit.
    return ca.if_else(x > 40.0, x, ca.log1p(ca.exp(ca.fmin(x, 40.0))))


def _gelu(x: Any, approximate: str = "none") -> Any:
    if approximate == "tanh":
        return 0.5 * x * (1.0 + ca.tanh(math.sqrt(2.0 / math.pi) * (x + 0.044715 * x**3)))
    return 0.5 * x * (1.0 + ca.erf(x / math.sqrt(2.0)))


def hard_sigmoid(x: Any, f: Any = ca, alpha: float = 1.0 / 6.0, beta: float = 0.5) -> Any:
    """Return alpha x + beta limited to [0, 1]."""
    return f.fmin(f.fmax(alpha * x + beta, 0.0), 1.0)


#: Activations by the names of `--set activation`: those of torch's classes, in lower case.
ACTIVATIONS: Mapping[str, Callable[..., Any]] = {
    "tanh": lambda x, f=ca: f.tanh(x),
    "relu": lambda x, f=ca: f.fmax(x, 0.0),
    "leaky_relu": _leaky_relu,
    "sigmoid": _sigmoid,
    "softplus": _softplus,
    "elu": _elu,
    "gelu": _gelu,
    "silu": lambda x, f=ca: x * _sigmoid(x, f),
    "selu": _selu,
    "sin": lambda x, f=ca: f.sin(x),
    "identity": lambda x, f=ca: x,
    "hardtanh": lambda x, f=ca: f.fmin(f.fmax(x, -1.0), 1.0),
    "softsign": lambda x, f=ca: x / (1.0 + f.fabs(x)),
    "hardswish": lambda x, f=ca: x * hard_sigmoid(x, f),
    "mish": lambda x: x * ca.tanh(_softplus(x)),
}
#: Activations that only CasADi evaluates.
OF_CASADI = ("softplus", "gelu", "mish")


def activation_named(name: str) -> str:
    """Return the name of an activation in `ACTIVATIONS`: "relu" for "ReLU" and "relu".

    Raises BadInputError for an unknown activation.
    """
    by_letters = {each.replace("_", ""): each for each in ACTIVATIONS}
    known = by_letters.get(name.strip().lower().replace("_", ""), name)
    refuse_unknown("unknown activation", known, ACTIVATIONS)
    return known
