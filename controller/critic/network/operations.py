"""A CasADi Function of a network as a list of operations, for other arithmetics than CasADi's."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import partial
from typing import NamedTuple

import casadi as ca
import numpy as np

#: Function x (N, n) -> y (N, k).
RowNetwork = Callable[[np.ndarray], np.ndarray]
#: Functions of each entry by name, in NumPy, and CasADi's number of each.
_FUNCTIONS: dict[str, Callable[[np.ndarray], np.ndarray]] = {
    name: getattr(np, name)
    for name in ("tanh", "exp", "expm1", "log", "log1p", "sin", "cos", "sqrt")
}
_NAMES = {getattr(ca, f"OP_{name.upper()}"): name for name in _FUNCTIONS} | {ca.OP_SQ: "square"}
_FUNCTIONS |= {"square": np.square, "relu": lambda x: np.maximum(x, 0.0), "": lambda x: x}
_NUMBERS = [(name, number) for name, number in vars(ca).items() if name.startswith("OP_")]
#: Operations that are affine, at least for constants in all arguments but one.
_AFFINE = {
    getattr(ca, f"OP_{name}")
    for name in (
        *("INPUT", "CONST", "ADD", "SUB", "MUL", "DIV", "NEG", "TWICE", "MTIMES", "DOT", "ASSIGN"),
        *("RESHAPE", "TRANSPOSE", "HORZCAT", "VERTCAT", "HORZSPLIT", "VERTSPLIT", "GETNONZEROS"),
    )
}


class NotListedError(Exception):
    """An operation is not one of those in an `Operation`, as the message says."""


class Operation(NamedTuple):
    """The operation y = f(matrix x + constant), f a function of each entry.

    kind: name of f, "" for none, or "input" of the first operation
    sources: places in the list of the results that are joined to x
    matrix, constant: (k, K), (k,)
    """

    kind: str
    sources: tuple[int, ...] = ()
    matrix: np.ndarray = np.zeros((0, 0))
    constant: np.ndarray = np.zeros(0)


def operations_of(function: ca.Function) -> list[Operation]:
    """Return the operations of a Function z (n,) -> (k,) of MX symbols; the last is its result.

    Maxima, minima and magnitudes are written by relu, products of results by squares, and what is
    affine between two functions as one matrix.

    Raises NotListedError for another operation.
    """
    z = ca.MX.sym("z", function.numel_in(0))
    (result,) = function.call([z], True, False)
    graph = ca.Function("graph", [z], [ca.densify(result)])
    operations, symbols = [Operation("input")], [z]
    nodes: list[ca.MX] = []  # that are functions, and what replaces them
    replaced: list[ca.MX] = []

    def of(kind: str, argument: ca.MX) -> ca.MX:
        """Return the symbols of an operation on an expression, which is added unless listed."""
        column = ca.vec(ca.densify(argument))
        free = {symbol.__hash__() for symbol in ca.symvar(column)}
        places = [k for k, symbol in enumerate(symbols) if not k or symbol.__hash__() in free]
        used = [symbols[k] for k in places]
        slopes = ca.densify(ca.horzcat(*(ca.jacobian(column, symbol) for symbol in used)))
        if ca.symvar(slopes):
            raise NotListedError("a product of results has no bounds")
        zeros = [np.zeros(symbol.numel()) for symbol in used]
        matrix, constant = (
            np.array(part) for part in ca.Function("affine", used, [slopes, column])(*zeros)
        )
        added = Operation(kind, tuple(places), matrix, constant.ravel())
        for k, known in enumerate(operations):
            if known[:2] == added[:2] and all(map(np.array_equal, known[2:], added[2:])):
                return ca.reshape(symbols[k], argument.shape)
        operations.append(added)
        symbols.append(ca.MX.sym("y", len(matrix)))
        return ca.reshape(symbols[-1], argument.shape)

    def times(a: ca.MX, b: ca.MX) -> ca.MX:
        """Return the product of each entry."""
        return 0.25 * (of("square", a + b) - of("square", a - b))

    def now(parts: list[ca.MX]) -> list[ca.MX]:
        """Return expressions by the symbols of the operations."""
        return ca.graph_substitute(parts, nodes, replaced) if nodes else parts

    for k in range(graph.n_instructions()):
        kind = graph.instruction_id(k)
        node = None if kind == ca.OP_OUTPUT else graph.instruction_MX(k)
        if node is None or not node.n_dep():
            continue
        parts = now([node.dep(i) for i in range(node.n_dep())])
        variable = [bool(ca.symvar(part)) for part in parts]
        if not any(variable):
            continue
        x, y = parts[0], parts[-1]
        if not variable[0]:  # a constant comes last
            x, y = y, x
        if kind in _NAMES:
            by = of(_NAMES[kind], x)
        elif kind in (ca.OP_FMAX, ca.OP_FMIN):
            limits = np.zeros(1) if all(variable) else np.array(ca.evalf(y))
            by = x  # without limits
            if np.isfinite(limits).all():
                of_both = of("relu", x - y)
                by = y + of_both if kind == ca.OP_FMAX else x - of_both
            elif not (limits == (-np.inf if kind == ca.OP_FMAX else np.inf)).all():
                raise NotListedError("a limit of some entries has no bounds")
        elif kind == ca.OP_FABS:
            by = 2.0 * of("relu", x) - x
        elif kind == ca.OP_MUL and all(variable):
            by = times(x, y)
        elif kind == ca.OP_CONSTPOW and float(y) == 3.0:
            by = times(x, of("square", x))
        elif kind in _AFFINE:
            continue
        else:
            name = next(name for name, number in _NUMBERS if number == kind)
            raise NotListedError(f"operation {name[3:].lower()} has no bounds")
        nodes.append(node)
        replaced.append(by)
    of("", *now([graph(z)]))
    return operations


def on_rows(operations: Sequence[Operation], x: np.ndarray) -> np.ndarray:
    """Return the results of operations for rows x (N, n), (N, k)."""
    values = [x]
    with np.errstate(all="ignore"):
        for kind, sources, matrix, constant in operations[1:]:
            joined = np.hstack([values[i] for i in sources])
            values.append(_FUNCTIONS[kind](joined @ matrix.T + constant))
    return values[-1]


def row_function(function: ca.Function) -> RowNetwork | None:
    """Return a Function z (n,) -> (k,) for rows (N, n) -> (N, k) in NumPy, or None if it has an
    operation that is not listed.
    """
    try:
        return partial(on_rows, operations_of(function))
    except NotListedError:
        return None
