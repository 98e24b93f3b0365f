"""CasADi Functions with fixed memory for arguments and results, one copy for each thread."""

from __future__ import annotations

import threading
from typing import Any, Literal, NamedTuple

import casadi as ca
import numpy as np


def of_rows(
    function: ca.Function, rows: int, by_operation: bool
) -> tuple[ca.Function, Literal["C", "F"]]:
    """Return a Function that evaluates `function` for several rows, and the memory order, "F" or
    "C", of its arguments and results.

    function: dense Function of one row
    rows: number of rows
    by_operation: whether each operation is applied to all rows at once, if that is possible
        (`by_columns`), and not one row evaluated after the other
    """
    if rows == 1:
        return function, "C"
    # CasADi stores the columns of a matrix one after the other. In `by_columns`, a column has one
    # entry of all rows: order "F". In `map`, a column has all entries of one row: order "C".
    at_once = by_columns(function, rows) if by_operation else None
    return (function.map(rows), "C") if at_once is None else (at_once, "F")


def by_columns(function: ca.Function, rows: int) -> ca.Function | None:
    """Return a Function that applies each operation of `function` to all rows in one loop, or None.

    An argument or result of k numbers becomes a matrix (rows, k), whose entries equal those of
    `function` bit by bit. None is returned unless `function` is an SX Function of scalar
    operations.

    function: dense Function of one row
    rows: number of rows
    """
    count = function.n_instructions() if function.is_a("SXFunction") else 0
    operations = [function.instruction_id(k) for k in range(count)]
    if not count or ca.OP_CALL in operations:
        return None
    sizes = [function.numel_in(index) for index in range(function.n_in())]
    arguments = [ca.MX.sym("rows", rows, size) for size in sizes]
    columns = [ca.horzsplit(argument) if argument.numel() else [] for argument in arguments]
    results = [[ca.MX()] * function.numel_out(index) for index in range(function.n_out())]
    # An instruction has cells of the memory of `function` as sources and targets, or the numbers of
    # an argument or result and of its entry. Each cell becomes a column: its values in all rows.
    memory: dict[int, ca.MX] = {}
    for k, operation in enumerate(operations):
        sources = function.instruction_input(k)
        targets = function.instruction_output(k)
        if operation == ca.OP_OUTPUT:
            result, entry = targets
            (cell,) = sources
            results[result][entry] = memory[cell]
            continue
        (cell,) = targets
        if operation == ca.OP_INPUT:
            argument, entry = sources
            memory[cell] = columns[argument][entry]
        elif operation == ca.OP_CONST:
            memory[cell] = ca.MX(function.instruction_constant(k))
        elif len(sources) == 1:
            memory[cell] = ca.MX.unary(operation, memory[sources[0]])
        else:
            left, right = (memory[source] for source in sources)
            memory[cell] = ca.MX.binary(operation, left, right)
    tables = []
    for entries in results:  # columns (rows, 1), or (1, 1) of a constant
        full = [ca.repmat(column, rows // column.numel(), 1) for column in entries]
        tables.append(ca.densify(ca.horzcat(ca.MX(rows, 0), *full)))
    return ca.Function(function.name(), arguments, tables)


class BoundFunction:
    """A dense CasADi Function with fixed memory. A call has an overhead of about a microsecond.

    inputs, results: a flat array for each argument and result, with matrices stored by columns. The
      arrays belong to this object.
    evaluate: function without arguments that writes the results at `inputs` to `results`

    An object must not be shared by threads.
    """

    def __init__(self, function: ca.Function) -> None:
        """Allocate the memory of a dense Function. Raises ValueError for a sparse one."""
        self.inputs = tuple(np.zeros(function.numel_in(i)) for i in range(function.n_in()))
        self.results = tuple(np.zeros(function.numel_out(i)) for i in range(function.n_out()))
        if function.nnz_in() + function.nnz_out() != sum(
            array.size for array in (*self.inputs, *self.results)
        ):
            raise ValueError(f"{function.name()}: an argument or a result is sparse; call densify")
        buffer: Any
        buffer, self.evaluate = function.buffer()
        for index, array in enumerate(self.inputs):
            buffer.set_arg(index, array.data)
        for index, array in enumerate(self.results):
            buffer.set_res(index, array.data)
        self._buffer = buffer  # keeps the memory used by the evaluation alive

    def at(self, *arguments: Any) -> list[np.ndarray]:
        """Return copies of the Function's results, one flat array for each result.

        arguments: a number or a flat array for each argument
        """
        for memory, argument in zip(self.inputs, arguments, strict=True):
            memory[:] = argument
        self.evaluate()
        return [result.copy() for result in self.results]


#: Lock of threads that build and compile expressions: one at a time.
MAKING = threading.RLock()
#: Numbers of rows in a block. The largest that is at most twice the number of rows is used.
_BLOCK_SIZES = (250, 16)
#: Number of rows, in all calls, above which `by_columns` is worthwhile. It takes 9 µs for an
#: operation and saves 4 ns for an operation and row.
_MANY_ROWS = 2000


class _Block(NamedTuple):
    """Function that evaluates several rows, with views (rows, entries) of its arguments and
    results.
    """

    bound: BoundFunction
    inputs: list[np.ndarray]
    results: list[np.ndarray]


class RowFunction(threading.local):
    """A dense CasADi Function that is evaluated at many points at once, one in each row of its
    arguments.

    A row contains the entries of one argument, with a matrix stored by columns. Each thread has its
    own memory.
    """

    def __init__(self, function: ca.Function) -> None:
        self.function = function
        self._rows_so_far = 0  # in all calls with several rows
        self._blocks: dict[int, _Block] = {}  # number of rows in a block -> the block

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
        block_size = 1
        if count > 1:
            before = self._rows_so_far
            self._rows_so_far += count
            if before < _MANY_ROWS <= self._rows_so_far:
                self._blocks.clear()  # they are built again, now with `by_columns`
            # Each block but the last is full, and the last one is filled up: a block of more than
            # twice the rows would waste more than half of its evaluations.
            block_size = next((size for size in _BLOCK_SIZES if size <= 2 * count), 1)
        bound, inputs, results = self._blocks.get(block_size) or self._bind(block_size)
        if count == block_size:
            for memory, table in zip(inputs, tables, strict=True):
                memory[:] = table
            bound.evaluate()
            return [rows.copy() for rows in results]
        tables_out = [np.empty((count, rows.shape[1])) for rows in results]
        for first in range(0, count, block_size):
            last = min(first + block_size, count)
            for memory, table in zip(inputs, tables, strict=True):
                memory[: last - first] = table[first:last]
                memory[last - first :] = table[last - 1]  # fills up a last block
            bound.evaluate()
            for memory, table in zip(results, tables_out, strict=True):
                table[first:last] = memory[: last - first]
        return tables_out

    def _bind(self, rows: int) -> _Block:
        """Return a block of rows, which is stored for later calls."""
        with MAKING:
            by_operation = self._rows_so_far >= _MANY_ROWS
            function, memory_order = of_rows(self.function, rows, by_operation)
            bound = BoundFunction(function)
            inputs, results = (
                [memory.reshape(rows, -1, order=memory_order) for memory in part]
                for part in (bound.inputs, bound.results)
            )
            block = self._blocks[rows] = _Block(bound, inputs, results)
        return block
