"""CasADi Functions with fixed memory for arguments and results, one copy for each thread."""

from __future__ import annotations

import threading
from typing import Any

import casadi as ca
import numpy as np

from hfa_support.native.columns import of_rows


class BoundFunction:
    """A dense CasADi Function with fixed memory. A call has an overhead of about a microsecond.

    inputs, results: a flat array for each argument and result, with matrices stored by columns. The
      arrays belong to this object, and each call overwrites the results.

    An object must not be shared by threads.
    """

    def __init__(self, function: ca.Function) -> None:
        self.inputs = tuple(np.zeros(function.numel_in(i)) for i in range(function.n_in()))
        self.results = tuple(np.zeros(function.numel_out(i)) for i in range(function.n_out()))
        if function.nnz_in() + function.nnz_out() != sum(
            array.size for array in (*self.inputs, *self.results)
        ):
            raise ValueError(f"{function.name()}: an argument or a result is sparse; call densify")
        buffer: Any
        buffer, self._evaluate = function.buffer()
        for index, array in enumerate(self.inputs):
            buffer.set_arg(index, array.data)
        for index, array in enumerate(self.results):
            buffer.set_res(index, array.data)
        self._buffer = buffer  # keeps the memory used by the evaluation alive

    def __call__(self) -> None:
        """Evaluate the Function with the values in `inputs` and write the results to `results`."""
        self._evaluate()

    def at(self, *arguments: Any) -> list[np.ndarray]:
        """Return copies of the Function's results, one flat array for each result.

        arguments: a number or a flat array for each argument
        """
        for memory, argument in zip(self.inputs, arguments, strict=True):
            memory[:] = argument
        self._evaluate()
        return [result.copy() for result in self.results]


#: Lock: expressions are built and compiled by one thread at a time.
MAKING = threading.RLock()
#: Numbers of rows in a block. The largest that is at most twice the number of rows is used.
_TOGETHER = (250, 16)
#: Number of rows, in all calls, above which `by_columns` is worthwhile. It takes 9 µs for an
#: operation and saves 4 ns for an operation and row.
_MANY = 2000

#: Bound Function for several rows, with views (rows, size) of its arguments and results.
Block = tuple[BoundFunction, list[np.ndarray], list[np.ndarray]]


class RowFunction(threading.local):
    """A dense CasADi Function that is evaluated at many points at once, one in each row of its
    arguments.

    A row contains the entries of one argument, with a matrix stored by columns. Each thread has its
    own memory.
    """

    def __init__(self, function: ca.Function) -> None:
        self.function = function
        self._rows = 0
        self._blocks: dict[int, Block] = {}

    def __reduce__(self) -> tuple[type[RowFunction], tuple[ca.Function]]:
        """Return the constructor and the Function, from which pickle restores the object without
        its memory.
        """
        return RowFunction, (self.function,)

    def __call__(self, *tables: Any) -> list[np.ndarray]:
        """Return the results at N points, a list with an array (N, entries of the result) for each
        result.

        tables: for each argument, an array (N, entries of the argument)
        """
        count = len(tables[0])
        together = self._together(count) if count > 1 else 1
        evaluate, inputs, results = self._blocks.get(together) or self._bind(together)
        if count == together:
            for memory, table in zip(inputs, tables, strict=True):
                memory[:] = table
            evaluate()
            return [rows.copy() for rows in results]
        tables_out = [np.empty((count, rows.shape[1])) for rows in results]
        for first in range(0, count, together):
            last = min(first + together, count)
            for memory, table in zip(inputs, tables, strict=True):
                memory[: last - first] = table[first:last]
                memory[last - first :] = table[last - 1]
            evaluate()
            for memory, table in zip(results, tables_out, strict=True):
                table[first:last] = memory[: last - first]
        return tables_out

    def _together(self, count: int) -> int:
        """Return the number of rows that are evaluated together, in a call with `count` rows."""
        # When `_MANY` rows have been evaluated in all calls, the stored blocks are discarded. New
        # blocks are made more slowly and evaluated faster.
        before = self._rows
        self._rows += count
        if before < _MANY <= self._rows:
            self._blocks.clear()
        return next((size for size in _TOGETHER if size <= 2 * count), 1)

    def _bind(self, together: int) -> Block:
        """Return the bound Function for several rows, its arguments and its results."""
        # An argument or result is an array (together, entries). The block is stored for later
        # calls.
        with MAKING:
            function, order = of_rows(self.function, together, self._rows >= _MANY)
            bound = BoundFunction(function)
            inputs, results = (
                [memory.reshape(together, -1, order=order) for memory in part]
                for part in (bound.inputs, bound.results)
            )
            block = self._blocks[together] = bound, inputs, results
        return block
