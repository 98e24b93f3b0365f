"""CasADi Functions bound to memory of ours: arguments are written in place, results read in place."""

from __future__ import annotations

from typing import Any

import casadi as ca
import numpy as np


class BoundFunction:
    """Calls a dense CasADi Function without converting anything, about a microsecond of overhead a call.

    inputs, results: one flat array an argument and a result (columns of a matrix one after the other), owned
    here and overwritten by each call. Not for two threads at once.
    """

    def __init__(self, function: ca.Function) -> None:
        for kind, sparsities in (
            ("argument", [function.sparsity_in(i) for i in range(function.n_in())]),
            ("result", [function.sparsity_out(i) for i in range(function.n_out())]),
        ):
            if not all(sparsity.is_dense() for sparsity in sparsities):
                raise ValueError(f"{function.name()}: every {kind} must be dense to be bound to memory")
        self.inputs = tuple(np.zeros(function.numel_in(i)) for i in range(function.n_in()))
        self.results = tuple(np.zeros(function.numel_out(i)) for i in range(function.n_out()))
        buffer: Any
        buffer, self._evaluate = function.buffer()
        for index, array in enumerate(self.inputs):
            buffer.set_arg(index, array.data)
        for index, array in enumerate(self.results):
            buffer.set_res(index, array.data)
        self._buffer = buffer  # keeps the memory that the evaluation points to

    def __call__(self) -> None:
        """Evaluate: `results` follow from `inputs`."""
        self._evaluate()


class RowsFunction:
    """A Function of columns, called for many at once: (N, n) arrays, a row a call. Not for two threads at once."""

    def __init__(self, function: ca.Function) -> None:
        self._function = function
        self._bound: dict[int, BoundFunction] = {}

    def __call__(self, count: int, *arguments: np.ndarray | float) -> tuple[np.ndarray, ...]:
        """Its results, (count, m) each; arguments: (count, n), or what broadcasts to it."""
        if count not in self._bound:
            self._bound[count] = BoundFunction(self._function.map(count))
        bound = self._bound[count]
        for place, given in zip(bound.inputs, arguments, strict=True):
            place.reshape(count, place.size // count)[:] = given
        bound()
        return tuple(result.reshape(count, result.size // count).copy() for result in bound.results)
