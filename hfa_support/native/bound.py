"""CasADi Functions bound to memory of our own, one copy for each thread.

Arguments are written and results are read in place.
"""

from __future__ import annotations

import threading
from typing import Any

import casadi as ca
import numpy as np


class BoundFunction:
    """Callable that evaluates a dense CasADi Function in place, in about a microsecond of overhead.

    inputs, results: one flat array for each argument and result (matrices column by column), owned
        here and overwritten by each call

    An object must not be shared by threads.
    """

    def __init__(self, function: ca.Function) -> None:
        self.inputs = tuple(np.zeros(function.numel_in(i)) for i in range(function.n_in()))
        self.results = tuple(np.zeros(function.numel_out(i)) for i in range(function.n_out()))
        if function.nnz_in() + function.nnz_out() != sum(
            array.size for array in (*self.inputs, *self.results)
        ):
            raise ValueError(
                f"{function.name()}: arguments and results must be dense to be bound to memory"
            )
        buffer: Any
        buffer, self._evaluate = function.buffer()
        for index, array in enumerate(self.inputs):
            buffer.set_arg(index, array.data)
        for index, array in enumerate(self.results):
            buffer.set_res(index, array.data)
        self._buffer = buffer  # keeps the memory that the evaluation points to

    def __call__(self) -> None:
        """Compute `results` from `inputs`."""
        self._evaluate()

    def at(self, *arguments: Any) -> list[np.ndarray]:
        """Return copies of the results for these arguments, numbers or flat arrays."""
        for memory, argument in zip(self.inputs, arguments, strict=True):
            memory[:] = argument
        self._evaluate()
        return [result.copy() for result in self.results]


#: Expressions are built and compiled by one thread at a time.
MAKING = threading.RLock()
#: Rows of a block: the most of which there are at least half.
_TOGETHER = (250, 16)
#: From this many rows on, of all calls, `by_columns_or_rows` saves more time than it takes: 9 µs an
#: operation, where each row saves 4 ns.
_MANY = 2000

#: A Function of some rows, with views (rows, size) of the memory of its arguments and results.
Block = tuple[BoundFunction, list[np.ndarray], list[np.ndarray]]


class RowFunction(threading.local):
    """Callable that evaluates a dense CasADi Function for each row of its arguments.

    A row contains a matrix column by column. Each thread has its own memory.

    function: the Function
    """

    def __init__(self, function: ca.Function) -> None:
        self.function = function
        self._rows = 0
        self._blocks: dict[int, Block] = {}

    def __reduce__(self) -> tuple[type[RowFunction], tuple[ca.Function]]:
        """Pickle the Function alone."""
        return RowFunction, (self.function,)

    def __call__(self, *tables: Any) -> list[np.ndarray]:
        """Return the results (N, size of the result) for arguments (N, size of the argument)."""
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
            evaluate()
            for memory, table in zip(results, tables_out, strict=True):
                table[first:last] = memory[: last - first]
        return tables_out

    def _together(self, count: int) -> int:
        """Return the rows of a block for a call with `count` rows."""
        before = self._rows
        self._rows += count
        if before < _MANY <= self._rows:
            self._blocks.clear()
        return next((size for size in _TOGETHER if size <= 2 * count), 1)

    def _bind(self, together: int) -> Block:
        """Return the Function of `together` rows, bound to its memory."""
        mapped = by_rows
        if self._rows >= _MANY:
            from hfa_support.native.columns import by_columns_or_rows as mapped
        with MAKING:
            function, order = mapped(self.function, together)
            bound = BoundFunction(function)
            inputs, results = (
                [memory.reshape(together, -1, order=order) for memory in part]
                for part in (bound.inputs, bound.results)
            )
            block = self._blocks[together] = bound, inputs, results
        return block


def by_rows(function: ca.Function, rows: int) -> Any:
    """Return the Function of some rows, evaluated row by row, and the order of their memory."""
    return function.map(rows) if rows > 1 else function, "C"
