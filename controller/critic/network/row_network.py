"""Chain of linear layers, evaluated on many rows at once by matrix products in NumPy.

A network with a large layer is computed in single precision, as in training and deployment.
Other networks are computed in double precision.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from typing import NamedTuple

import numpy as np

#: Function x (N, n) -> y (N, k).
RowNetwork = Callable[[np.ndarray], np.ndarray]


def _sigmoid(x: np.ndarray) -> np.ndarray:
    return 0.5 + 0.5 * np.tanh(0.5 * x)


def _elu(x: np.ndarray) -> np.ndarray:
    return np.maximum(x, 0.0) + np.expm1(np.minimum(x, 0.0))


#: A network with a matrix of at least this many entries is wide.
_WIDE = 2**14
#: Number of rows per product. The values between the layers then fit into the cache.
_TOGETHER = 500
#: Activations that NumPy evaluates on arrays, which may be overwritten; "" means no activation.
ROW_ACTIVATIONS: Mapping[str, Callable[[np.ndarray], np.ndarray]] = {
    "": lambda x: x,
    "tanh": lambda x: np.asarray(np.tanh(x, out=x)),
    "relu": lambda x: np.asarray(np.maximum(x, 0.0, out=x)),
    "leaky_relu": lambda x: np.maximum(x, 0.0) + 0.01 * np.minimum(x, 0.0),
    "sigmoid": _sigmoid,
    "elu": _elu,
    "silu": lambda x: x * _sigmoid(x),
    "sin": lambda x: np.asarray(np.sin(x)),
}


class Layer(NamedTuple):
    """Layer y = activation(weight x + bias).

    name: name in the file, without ".weight".
    weight: (k, n).
    bias: (k,).
    activation: name in `ACTIVATIONS`, or "" for none.
    """

    name: str
    weight: np.ndarray
    bias: np.ndarray
    activation: str = ""

    @property
    def inputs(self) -> int:
        """Number of inputs."""
        return self.weight.shape[1]

    @property
    def outputs(self) -> int:
        """Number of outputs."""
        return len(self.weight)


def precision_of(matrix: np.ndarray) -> type[np.floating]:
    """Return the precision for products with a matrix: single for at least `_WIDE` entries."""
    return np.float32 if matrix.size >= _WIDE else np.float64


def row_network(layers: Sequence[Layer]) -> RowNetwork | None:
    """Return the function x (N, n) -> (N, k) of a chain of layers.

    The result is None if an activation is not in `ROW_ACTIVATIONS`.
    """
    if any(layer.activation not in ROW_ACTIVATIONS for layer in layers):
        return None
    kind = precision_of(max((layer.weight for layer in layers), key=np.size))
    columns = [np.ascontiguousarray(layer.weight.T, dtype=kind) for layer in layers]
    biases = [layer.bias.astype(kind) for layer in layers]
    activations = [ROW_ACTIVATIONS[layer.activation] for layer in layers]

    def on_some(x: np.ndarray) -> np.ndarray:
        for weight, bias, activation in zip(columns, biases, activations, strict=True):
            x = x @ weight
            x += bias
            x = activation(x)
        return x

    def on_rows(x: np.ndarray) -> np.ndarray:
        x = x.astype(kind, copy=False)
        parts = [on_some(x[first : first + _TOGETHER]) for first in range(0, len(x), _TOGETHER)]
        return np.concatenate(parts).astype(float, copy=False)

    return on_rows
