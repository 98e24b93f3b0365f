"""Chain of linear layers, evaluated on many rows at once by matrix products in NumPy.

A network with a large layer is computed in single precision, as in training and deployment.
Other networks are computed in double precision.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import NamedTuple

import numpy as np

from controller.critic.network.activations import ACTIVATIONS, OF_CASADI, ON_ARRAYS

#: Function x (N, n) -> y (N, k).
RowNetwork = Callable[[np.ndarray], np.ndarray]
#: A network with a matrix of at least this many entries, those of 128 x 128, is wide.
_WIDE = 2**14
#: Number of rows per product. The values between the layers then fit into the cache.
_TOGETHER = 500


class Layer(NamedTuple):
    """Layer y = activation(weight x + bias).

    name: name in the file, without ".weight"
    weight: (k, n)
    bias: (k,)
    activation: name in `ACTIVATIONS`, or "" for none
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

    The result is None if only CasADi evaluates an activation.
    """
    if any(layer.activation in OF_CASADI for layer in layers):
        return None
    kind = precision_of(max((layer.weight for layer in layers), key=np.size))
    columns = [np.ascontiguousarray(layer.weight.T, dtype=kind) for layer in layers]
    biases = [layer.bias.astype(kind) for layer in layers]
    names = [layer.activation for layer in layers]

    def on_block(x: np.ndarray) -> np.ndarray:
        """Return the outputs for a few rows."""
        for weight, bias, name in zip(columns, biases, names, strict=True):
            x = x @ weight
            x += bias
            x = ACTIVATIONS[name](x, ON_ARRAYS) if name else x
        return x

    def on_rows(x: np.ndarray) -> np.ndarray:
        """Return the outputs for all rows, block by block."""
        x = x.astype(kind, copy=False)
        parts = [on_block(x[first : first + _TOGETHER]) for first in range(0, len(x), _TOGETHER)]
        return np.concatenate(parts).astype(float, copy=False)

    return on_rows
