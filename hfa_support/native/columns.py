"""CasADi Functions of many rows that apply each operation to all rows at once."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Literal

import casadi as ca


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
    at_once = by_columns(function, rows) if by_operation else None
    return (function.map(rows), "C") if at_once is None else (at_once, "F")


def by_columns(function: ca.Function, rows: int) -> ca.Function | None:
    """Return a Function that applies each operation of `function` to all rows in one loop, or None.

    An argument or result of k numbers becomes a matrix (rows, k). The results are equal to the
    results of `function` bit by bit. The result is None unless `function` is an SX Function of
    scalar operations.

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
    memory: dict[int, ca.MX] = {}  # cell -> column that it contains
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
    tables = [_side_by_side(result, rows) for result in results]
    return ca.Function(function.name(), arguments, tables)


def _side_by_side(columns: Sequence[ca.MX], rows: int) -> ca.MX:
    """Return the dense matrix (rows, k) of k columns, each (rows, 1), or (1, 1) if constant."""
    full = [ca.repmat(column, rows // column.numel(), 1) for column in columns]
    return ca.densify(ca.horzcat(ca.MX(rows, 0), *full))
