"""Operations of a CasADi Function on vectors, as a list for other arithmetics than CasADi's."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import reduce
from itertools import pairwise
from typing import Any, NamedTuple

import casadi as ca
import numpy as np

#: Function x (N, n) -> y (N, k).
RowNetwork = Callable[[np.ndarray], np.ndarray]
#: Functions of each entry, by CasADi's number, and NumPy's functions of the same names.
_NAMES = {
    number: name
    for name in ("tanh", "exp", "expm1", "log", "log1p", "sin", "cos", "sqrt")
    for number in (getattr(ca, f"OP_{name.upper()}"),)
}
_NUMBERS = {number: name for name, number in vars(ca).items() if name.startswith("OP_")}


class NotListedError(Exception):
    """An operation is not one of those in an `Operation`; its message names the operation."""


class Operation(NamedTuple):
    """One operation, whose result is a vector.

    kind: "input"; "constant" data; "product" data @ x; "add" x + y; "times" x y of each entry;
        "relu"; or a function of each entry, such as "tanh"
    sources: places of x, y, ... in the list
    data: numbers of the operation, or None
    """

    kind: str
    sources: tuple[int, ...] = ()
    data: Any = None


class _Vector(NamedTuple):
    """A vector of the list, a row or a column, while a Function is read."""

    place: int
    shape: tuple[int, int]


_Value = np.ndarray | _Vector  # a constant matrix or a vector


def operations_of(function: ca.Function) -> list[Operation]:
    """Return the operations of a Function z (n,) -> (k,); the last one is its result.

    Maxima, minima and magnitudes are written by relu, so that they share it.

    Raises NotListedError for another operation.
    """
    reader = _Reader()
    n = function.numel_in(0)
    state = _Vector(reader.add("input"), (n, 1))
    (result,) = reader.read(function, [state])
    last = reader.placed(result)
    reader.operations.append(Operation("product", (last,), np.eye(function.numel_out(0))))
    return reader.operations


def row_function(function: ca.Function) -> RowNetwork | None:
    """Return a Function z (n,) -> (k,) for rows (N, n) -> (N, k) in NumPy, or None if it has an
    operation that is not listed.
    """
    try:
        operations = operations_of(function)
    except NotListedError:
        return None

    def on_rows(x: np.ndarray) -> np.ndarray:
        """Return the results of all rows."""
        values: list[np.ndarray] = []
        with np.errstate(all="ignore"):
            for operation in operations:
                parts = [x] if operation.kind == "input" else [values[i] for i in operation.sources]
                values.append(_on_rows(operation, parts))
        return np.broadcast_to(values[-1], (len(x), values[-1].shape[1]))

    return on_rows


def _on_rows(operation: Operation, sources: list[np.ndarray]) -> np.ndarray:
    """Return the result of an operation for rows, (N, k) or (1, k) of a constant."""
    kind, _, data = operation
    match kind:
        case "input":
            return sources[0]
        case "constant":
            return np.asarray(data)[None]
        case "product":
            return sources[0] @ data.T
        case "add":
            return sources[0] + sources[1]
        case "times":
            return sources[0] * sources[1]
        case "relu":
            return np.maximum(sources[0], 0.0)
    function: Callable[[np.ndarray], np.ndarray] = getattr(np, kind)
    return function(sources[0])


class _Reader:
    """Reads Functions into one list of operations, in which equal operations are one."""

    def __init__(self) -> None:
        self.operations: list[Operation] = []
        self._places: dict[Any, int] = {}

    def add(self, kind: str, *sources: int, data: Any = None) -> int:
        """Return the place of an operation, which is added unless it is there."""
        array = None if data is None else np.asarray(data)
        key = (kind, sources, None if array is None else (array.shape, array.tobytes()))
        if key not in self._places:
            self._places[key] = len(self.operations)
            self.operations.append(Operation(kind, sources, data))
        return self._places[key]

    def placed(self, value: _Value) -> int:
        """Return the place of a value, also of a constant."""
        if isinstance(value, _Vector):
            return value.place
        return self.add("constant", data=value.ravel(order="F"))

    def read(self, function: ca.Function, arguments: Sequence[_Value]) -> list[_Value]:
        """Return the results of a Function for arguments."""
        is_scalar = function.is_a("SXFunction")
        if not is_scalar and not function.is_a("MXFunction"):
            raise NotListedError(function.class_name().lower())
        cells: dict[int, _Value] = {}
        # Parts of each result, by the first entry: a part that is not written is 0.
        results: list[dict[int, Any]] = [
            dict.fromkeys(range(function.numel_out(i)) if is_scalar else (), np.zeros((1, 1)))
            for i in range(function.n_out())
        ]
        for k in range(function.n_instructions()):
            kind = function.instruction_id(k)
            read, written = function.instruction_input(k), function.instruction_output(k)
            if kind == ca.OP_OUTPUT:
                first = written[1] if is_scalar else function.instruction_MX(k).info()["offset"]
                results[written[0]][first] = cells[read[0]]
            elif is_scalar:
                cells[written[0]] = self._scalar(function, k, kind, read, cells, arguments)
            else:
                node = function.instruction_MX(k)
                made = self._vectors(node, kind, [cells.get(i) for i in read], arguments)
                cells |= dict(zip(written, made, strict=True))
        return [
            self._joined([parts[first] for first in sorted(parts)], function.size_out(i))
            for i, parts in enumerate(results)
        ]

    def _scalar(
        self,
        function: ca.Function,
        k: int,
        kind: int,
        read: list[int],
        cells: dict[int, _Value],
        arguments: Sequence[_Value],
    ) -> _Value:
        """Return the result of an instruction of an SX Function."""
        if kind == ca.OP_INPUT:
            return self._selected(arguments[read[0]], [read[1]], (1, 1))
        if kind == ca.OP_CONST:
            return np.full((1, 1), function.instruction_constant(k))
        return self._of_entries(kind, [cells[i] for i in read])

    def _vectors(
        self, node: ca.MX, kind: int, read: list[Any], arguments: Sequence[_Value]
    ) -> list[_Value]:
        """Return the results of an instruction of an MX Function."""
        if kind == ca.OP_CALL:
            return self.read(node.which_function(), read)
        if kind in (ca.OP_HORZSPLIT, ca.OP_VERTSPLIT):
            ends = node.info()["offset"]
            return [
                self._selected(
                    read[0], range(a, b), (1, b - a) if read[0].shape[0] == 1 else (b - a, 1)
                )
                for a, b in pairwise(ends)
            ]
        if not node.is_dense():
            raise NotListedError("of a sparse matrix")
        if kind == ca.OP_INPUT:
            info = node.info()
            argument = arguments[info["ind"]]
            first = info["offset"]
            places = range(first, first + node.numel())
            return [self._selected(argument, places, node.shape)]
        if kind == ca.OP_CONST:
            return [node.to_DM().full()]
        if kind == ca.OP_MTIMES:
            return [self._sum(self._product(read[1], read[2]), read[0])]
        if kind == ca.OP_DOT:
            return [self._product(self._turned(read[0]), read[1])]
        if kind in (ca.OP_TRANSPOSE, ca.OP_RESHAPE):
            if isinstance(read[0], _Vector):
                if 1 not in node.shape:
                    raise NotListedError("reshape")
                return [read[0]._replace(shape=node.shape)]
            if kind == ca.OP_TRANSPOSE:
                return [self._turned(read[0])]
            return [read[0].reshape(node.shape, order="F")]
        if kind in (ca.OP_HORZCAT, ca.OP_VERTCAT):
            return [self._joined(read, node.shape)]
        if kind == ca.OP_GETNONZEROS:
            info = node.info()
            if "nz" not in info:
                part = info["slice"]
                info["nz"] = range(part["start"], part["stop"], part["step"])
            return [self._selected(read[0], info["nz"], node.shape)]
        return [self._of_entries(kind, read)]

    @staticmethod
    def _turned(value: _Value) -> _Value:
        """Return a value transposed."""
        if isinstance(value, np.ndarray):
            return value.T
        return value._replace(shape=(value.shape[1], value.shape[0]))

    def _selected(self, value: _Value, places: Sequence[int], shape: tuple[int, int]) -> _Value:
        """Return some entries of a value, in the order of its columns."""
        if isinstance(value, np.ndarray):
            return value.ravel(order="F")[list(places)].reshape(shape, order="F")
        if list(places) == list(range(max(value.shape))):
            return value._replace(shape=shape)
        chosen = np.eye(max(value.shape))[list(places)]
        return _Vector(self.add("product", value.place, data=chosen), shape)

    def _joined(self, parts: Sequence[Any], shape: tuple[int, int]) -> _Value:
        """Return vectors joined to one."""
        if all(isinstance(part, np.ndarray) for part in parts):
            entries = [part.ravel(order="F") for part in parts]
            return np.concatenate(entries).reshape(shape, order="F")
        if 1 not in shape:
            raise NotListedError("join of matrices")
        if len(parts) == 1:
            return parts[0]
        ends = np.cumsum([0, *(part.shape[0] * part.shape[1] for part in parts)])
        whole = np.eye(ends[-1])
        spread: list[_Value] = [
            _Vector(self.add("product", self.placed(part), data=whole[:, a:b].copy()), shape)
            for part, (a, b) in zip(parts, pairwise(ends.tolist()), strict=True)
        ]
        return reduce(self._sum, spread)

    def _product(self, a: _Value, b: _Value) -> _Value:
        """Return the product of two matrices, at most one of which is not constant."""
        if isinstance(a, np.ndarray) and isinstance(b, np.ndarray):
            return a @ b
        shape = (a.shape[0], b.shape[1])
        if isinstance(b, _Vector) and isinstance(a, np.ndarray) and b.shape[1] == 1:
            return _Vector(self.add("product", b.place, data=a), shape)
        if isinstance(a, _Vector) and isinstance(b, np.ndarray) and a.shape[0] == 1:
            return _Vector(self.add("product", a.place, data=b.T.copy()), shape)
        if shape == (1, 1):  # the product of a row and a column
            terms = self._of_entries(ca.OP_MUL, [a, b])
            return _Vector(
                self.add("product", self.placed(terms), data=np.ones((1, a.shape[1]))), shape
            )
        raise NotListedError("product of two results")

    def _sum(self, a: _Value, b: _Value) -> _Value:
        """Return a + b."""
        return self._of_entries(ca.OP_ADD, [a, b])

    def _of_entries(self, kind: int, read: list[Any]) -> _Value:
        """Return the result of an operation on each entry, of one or two values."""
        if all(isinstance(value, np.ndarray) for value in read):
            function: Any = ca.MX.unary if len(read) == 1 else ca.MX.binary
            folded = function(kind, *(ca.MX(ca.DM(value)) for value in read))
            return np.array(ca.evalf(folded).full())
        shape = max((value.shape for value in read), key=lambda size: size[0] * size[1])

        def of(name: str, *values: _Value, data: Any = None) -> _Vector:
            return _Vector(
                self.add(name, *(self.placed(each) for each in values), data=data), shape
            )

        if max(shape) > 1:  # a single number counts for each entry
            read = [
                of("product", value, data=np.ones((max(shape), 1)))
                if isinstance(value, _Vector) and value.shape == (1, 1)
                else value
                for value in read
            ]
        x, y = read[0], read[-1]
        if isinstance(x, np.ndarray) and kind in (ca.OP_ADD, ca.OP_MUL, ca.OP_FMIN, ca.OP_FMAX):
            x, y = y, x  # a constant comes last

        def plus(a: Any, b: Any) -> Any:
            if isinstance(b, np.ndarray) and not b.any():
                return a
            return of("add", spread(a), spread(b))

        def spread(value: Any) -> Any:
            if isinstance(value, np.ndarray) and value.size == 1:
                return np.full(shape, value.item())
            return value

        def times(a: Any, b: Any) -> _Vector:
            if isinstance(b, np.ndarray):
                return of("product", a, data=np.diag(spread(b).ravel(order="F")))
            return of("times", a, b)

        def negative(a: Any) -> Any:
            return -a if isinstance(a, np.ndarray) else times(a, np.full((1, 1), -1.0))

        if kind == ca.OP_ADD:
            return plus(x, y)
        if kind == ca.OP_SUB:
            return plus(x, negative(y))
        if kind == ca.OP_NEG:
            return negative(x)
        if kind == ca.OP_TWICE:
            return plus(x, x)
        if kind == ca.OP_MUL:
            return times(x, y)
        if kind == ca.OP_SQ:
            return of("times", x, x)
        if kind == ca.OP_DIV and isinstance(y, np.ndarray):
            return times(x, 1.0 / y)
        if kind in (ca.OP_FMAX, ca.OP_FMIN) and isinstance(y, np.ndarray) and np.isinf(y).any():
            if not (y == (-np.inf if kind == ca.OP_FMAX else np.inf)).all():
                raise NotListedError("limit of some entries")
            return x
        if kind == ca.OP_FMAX:  # y + relu(x - y)
            return plus(of("relu", plus(x, negative(y))), y)
        if kind == ca.OP_FMIN:  # x - relu(x - y)
            return plus(x, negative(of("relu", plus(x, negative(y)))))
        if kind == ca.OP_FABS:  # 2 relu(x) - x
            return plus(plus(of("relu", x), of("relu", x)), negative(x))
        if kind in (ca.OP_CONSTPOW, ca.OP_POW) and isinstance(y, np.ndarray) and y.size == 1:
            power = y.item()
            if power in (1, 2, 3, 4):
                product = x
                for _ in range(int(power) - 1):
                    product = of("times", product, x)
                return product
        if kind == ca.OP_ASSIGN:
            return x
        if kind not in _NAMES:
            raise NotListedError(_NUMBERS[kind].removeprefix("OP_").lower())
        return of(_NAMES[kind], x)
