"""A CasADi function, read once for every arithmetic, as nonlinear nodes and affine rows.

`Reading` evaluates a function one instruction at a time on values of any kind. `Program` reads it
on affine rows. A row is a sum of coefficients times variables. The coefficients are rational
numbers and therefore exact. Variable 0 is the constant 1, followed by the inputs and the nodes.
Layers of a network become rows, which are evaluated as matrix products.

CasADi folds constants in doubles and stores 5 (0.2 x) as x. The proof covers the folded function,
which is also the function that is evaluated.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from fractions import Fraction
from functools import partial
from itertools import chain, groupby, islice
from typing import Any, NamedTuple

import casadi as ca
import numpy as np
from scipy.sparse import csr_array

from hfa_prove.enclosure.splines import Spline, Table, is_table, tables_of
from hfa_support.errors import BadInputError

#: Operation of CasADi -> method of an `Arithmetic`.
OPERATIONS: Mapping[int, str] = {
    ca.OP_ASSIGN: "same",
    ca.OP_ADD: "add",
    ca.OP_SUB: "subtract",
    ca.OP_NEG: "negative",
    ca.OP_TWICE: "twice",
    ca.OP_MUL: "multiply",
    ca.OP_SQ: "square",
    ca.OP_DIV: "divide",
    ca.OP_INV: "inverse",
    ca.OP_POW: "power",
    ca.OP_CONSTPOW: "power",
    ca.OP_SQRT: "sqrt",
    ca.OP_EXP: "exp",
    ca.OP_EXPM1: "expm1",
    ca.OP_LOG: "log",
    ca.OP_LOG1P: "log1p",
    ca.OP_SIN: "sin",
    ca.OP_COS: "cos",
    ca.OP_TAN: "tan",
    ca.OP_ASIN: "asin",
    ca.OP_ACOS: "acos",
    ca.OP_ATAN: "atan",
    ca.OP_ATAN2: "atan2",
    ca.OP_TANH: "tanh",
    ca.OP_FMIN: "minimum",
    ca.OP_FMAX: "maximum",
    ca.OP_FABS: "absolute",
    ca.OP_SIGN: "sign",
    ca.OP_LT: "less",
    ca.OP_LE: "at_most",
    ca.OP_NOT: "negation",
    ca.OP_AND: "multiply",
    ca.OP_OR: "either",
    ca.OP_IF_ELSE_ZERO: "multiply",
}
#: Largest number of operations of a function.
LARGEST = 100_000
#: Largest number of its nonlinear operations.
MOST_NODES = 4_000
#: Largest share of entries other than 0 in a matrix that is stored as a sparse one.
_SPARSE = 0.5
_ONE = Fraction(1)
#: Kind of a node.
Kind = str | Spline


class Arithmetic:
    """Operations on values of one kind, with the formulas that all kinds share.

    A derived class defines `constant`, `add`, `subtract`, `negative`, `multiply`, `inverse`,
    `maximum`, `less`, `table`, and the functions sqrt, exp, log, sin, cos, atan and tanh.
    """

    constant: Callable[[float], Any]
    add: Callable[[Any, Any], Any]
    subtract: Callable[[Any, Any], Any]
    negative: Callable[[Any], Any]
    multiply: Callable[[Any, Any], Any]
    inverse: Callable[[Any], Any]
    #: 1 where a < b, else 0.
    less: Callable[[Any, Any], Any]
    maximum: Callable[[Any, Any], Any]
    sqrt: Callable[[Any], Any]
    exp: Callable[[Any], Any]
    log: Callable[[Any], Any]
    sin: Callable[[Any], Any]
    cos: Callable[[Any], Any]
    atan: Callable[[Any], Any]
    tanh: Callable[[Any], Any]
    #: Value of a `Spline` at an argument.
    table: Callable[[Spline, Any], Any]

    def same(self, a: Any) -> Any:
        """Return a."""
        return a

    def twice(self, a: Any) -> Any:
        """Return 2 a."""
        return self.add(a, a)

    def square(self, a: Any) -> Any:
        """Return a²."""
        return self.multiply(a, a)

    def divide(self, a: Any, b: Any) -> Any:
        """Return a / b."""
        return self.multiply(a, self.inverse(b))

    def power(self, a: Any, b: Any) -> Any:
        """Return a^b = exp(b log a), for a > 0."""
        return self.exp(self.multiply(b, self.log(a)))

    def expm1(self, a: Any) -> Any:
        """Return exp(a) - 1."""
        return self.subtract(self.exp(a), self.constant(1.0))

    def log1p(self, a: Any) -> Any:
        """Return log(1 + a)."""
        return self.log(self.add(a, self.constant(1.0)))

    def tan(self, a: Any) -> Any:
        """Return tan a."""
        return self.divide(self.sin(a), self.cos(a))

    def asin(self, a: Any) -> Any:
        """Return asin a = atan(a / sqrt(1 - a²)), for |a| < 1."""
        return self.atan(self.divide(a, self._opposite(a)))

    def acos(self, a: Any) -> Any:
        """Return acos a = 2 atan(sqrt(1 - a²) / (1 + a)), for |a| < 1."""
        below = self.add(self.constant(1.0), a)
        return self.twice(self.atan(self.divide(self._opposite(a), below)))

    def _opposite(self, a: Any) -> Any:
        return self.sqrt(self.subtract(self.constant(1.0), self.square(a)))

    def atan2(self, a: Any, b: Any) -> Any:
        """Return atan2(a, b) = 2 atan(a / (sqrt(a² + b²) + b)).

        There is no enclosure at a = 0 and b <= 0.
        """
        length = self.sqrt(self.add(self.square(a), self.square(b)))
        return self.twice(self.atan(self.divide(a, self.add(length, b))))

    def minimum(self, a: Any, b: Any) -> Any:
        """Return min(a, b) = -max(-a, -b)."""
        return self.negative(self.maximum(self.negative(a), self.negative(b)))

    def absolute(self, a: Any) -> Any:
        """Return |a| = max(a, -a)."""
        return self.maximum(a, self.negative(a))

    def sign(self, a: Any) -> Any:
        """Return the sign of a."""
        zero = self.constant(0.0)
        return self.subtract(self.less(zero, a), self.less(a, zero))

    def at_most(self, a: Any, b: Any) -> Any:
        """Return 1 for a <= b, else 0."""
        return self.negation(self.less(b, a))

    def negation(self, a: Any) -> Any:
        """Return 1 - a."""
        return self.subtract(self.constant(1.0), a)

    def either(self, a: Any, b: Any) -> Any:
        """Return a + b - a b, which is 1 if a or b is 1."""
        return self.subtract(self.add(a, b), self.multiply(a, b))

    def tables(self, tables: Sequence[Table], *values: Any) -> list[Any]:
        """Return the outputs of `casadi.interpolant` at its arguments."""
        return [self._of_table(table, values) for table in tables]

    def _of_table(self, table: Table, values: Sequence[Any]) -> Any:
        """Return Σ_I c_I Π φ_i(a_i), one argument at a time.

        Σ_i φ_i g_i is g_0 Σ φ_i + Σ_i (φ_i + φ_(i+1) + ..) (g_i - g_(i-1)): differences of
        neighbors remain small where few φ_i change.
        """
        if len(values) == 1:
            return self.table(table.spline(), values[0])
        total = self.constant(0.0)
        for spline, inner in table.layers():
            factor = self.table(spline, values[-1])
            total = self.add(total, self.multiply(factor, self._of_table(inner, values[:-1])))
        return total


class _Step(NamedTuple):
    """Instruction of a function.

    operation: value of a constant, or function of the values at `sources`
    sources, targets: places of the arguments and of the results
    """

    code: int
    operation: Any
    sources: Sequence[int]
    targets: Sequence[int]


class Reading:
    """A CasADi function, evaluated on the values of an arithmetic.

    function: the function
    arithmetic: the arithmetic
    name: name of the function for messages

    Raises BadInputError with the name of the operation if an operation is not supported, or if the
    function is too large or contains a constant that is not finite.
    """

    def __init__(self, function: ca.Function, arithmetic: Arithmetic, name: str) -> None:
        scalars = _in_scalars(function, name)
        count = scalars.n_instructions()
        if count > LARGEST:
            raise BadInputError(
                f"{name}: the function has {count} operations, but at most {LARGEST} are "
                "supported; simplify the function"
            )
        self.inputs = [scalars.nnz_in(index) for index in range(scalars.n_in())]
        self._outputs = [scalars.nnz_out(index) for index in range(scalars.n_out())]
        self._size = scalars.sz_w()
        self._name = name
        self._steps = []
        for index in range(count):
            code = scalars.instruction_id(index)
            operation: Any = None
            if code == ca.OP_CONST:
                operation = arithmetic.constant(self._finite(scalars.instruction_constant(index)))
            elif code == ca.OP_CALL:
                called = scalars.instructions_sx()[index].which_function()
                operation = _called(called, arithmetic, name)
            elif code in OPERATIONS:
                operation = getattr(arithmetic, OPERATIONS[code])
            elif code not in (ca.OP_INPUT, ca.OP_OUTPUT):
                raise _refusal(name, operation_name(code))
            sources = scalars.instruction_input(index)
            self._steps.append(_Step(code, operation, sources, scalars.instruction_output(index)))

    def _finite(self, value: float) -> float:
        if not math.isfinite(value):
            raise BadInputError(f"{self._name}: the function contains {value}; use finite numbers")
        return value

    def __call__(self, *arguments: Sequence[Any]) -> list[list[Any]]:
        """Return the outputs, each as a list of its nonzeros in CasADi's order (column by column).

        arguments: nonzeros of each input, in CasADi's order

        Raises ValueError if an argument has the wrong number of entries.
        """
        if [len(argument) for argument in arguments] != self.inputs:
            raise ValueError(f"the arguments of {self._name} must have {self.inputs} entries")
        work: list[Any] = [None] * self._size
        results: list[list[Any]] = [[None] * size for size in self._outputs]
        for code, operation, sources, targets in self._steps:
            if code == ca.OP_CONST:
                work[targets[0]] = operation
            elif code == ca.OP_INPUT:
                work[targets[0]] = arguments[sources[0]][sources[1]]
            elif code == ca.OP_OUTPUT:
                results[targets[0]][targets[1]] = work[sources[0]]
            elif code == ca.OP_CALL:
                values = operation(*(work[source] for source in sources))
                for target, value in zip(targets, values, strict=True):
                    if target >= 0:
                        work[target] = value
            elif len(sources) == 1:
                work[targets[0]] = operation(work[sources[0]])
            else:
                work[targets[0]] = operation(work[sources[0]], work[sources[1]])
        return results


def _in_scalars(function: ca.Function, name: str) -> ca.Function:
    """Return a function as an SX function. Raises BadInputError if CasADi cannot expand it."""
    if not function.is_a("MXFunction"):
        return function
    try:
        return function.expand()
    except RuntimeError as error:
        raise BadInputError(
            f"{name}: the proof needs {function.name()}, a derivative of a smooth table, whose "
            "coefficients CasADi rounds; use the method 'linear' of casadi.interpolant"
        ) from error


def _called(
    function: ca.Function, arithmetic: Arithmetic, name: str
) -> Callable[..., Sequence[Any]]:
    """Return the operation of a call, nonzeros of all arguments -> those of all results."""
    if is_table(function):
        return partial(arithmetic.tables, tables_of(function))
    if not function.is_a("SXFunction") and not function.is_a("MXFunction"):
        raise _refusal(name, f"the function {function.name()}")
    reading = Reading(function, arithmetic, name)

    def call(*values: Any) -> list[Any]:
        left = iter(values)
        arguments = [list(islice(left, size)) for size in reading.inputs]
        return list(chain.from_iterable(reading(*arguments)))

    return call


def _refusal(name: str, what: str) -> BadInputError:
    return BadInputError(
        f"{name}: the equations use {what}, which a proof does not support; use sums, products, "
        "quotients, powers, roots, exp, log, tanh, sin, cos, tan, asin, acos, atan, atan2, min, "
        "max, abs, conditions and tables of casadi.interpolant"
    )


def operation_name(code: int) -> str:
    """Return the lower-case name of a CasADi operation code, or the code if it has no name."""
    for name in dir(ca):
        if name.startswith("OP_") and getattr(ca, name) == code:
            return name.removeprefix("OP_").lower()
    return str(code)


Row = Mapping[int, Fraction]


class Node(NamedTuple):
    """Nonlinear operation of a program.

    kind: "product", or a function of one variable: a name in `lines.ENCLOSED`, or a table
    rows: one affine row for each argument, one or two
    level: 1 above the highest level of the nodes in `rows`
    """

    kind: Kind
    rows: tuple[Row, ...]
    level: int


class Argument(NamedTuple):
    """Affine rows that compute one argument of all nodes of a group, in double precision.

    blocks: earlier group -> coefficients (nodes, variables of the earlier group), sparse if most
        are 0
    sizes: earlier group -> absolute values of the coefficients
    """

    blocks: Mapping[int, Any]
    sizes: Mapping[int, Any]


class Group(NamedTuple):
    """Nodes of the same kind and level, which are evaluated together.

    kind: kind of the nodes, as in `Node`
    arguments: affine rows of each argument
    """

    kind: Kind
    arguments: tuple[Argument, ...]


class Program:
    """Groups of nodes in the order of evaluation, and the rows of the outputs.

    Group 0 contains the constant 1 and the inputs. Each coefficient is the double nearest to a
    rational number, with a relative error of at most 2⁻⁵³.

    function: SX or MX function of one vector
    name: name of the function, for messages

    Raises BadInputError if an operation cannot be enclosed or the function is too large.
    """

    def __init__(self, function: ca.Function, name: str) -> None:
        self.inputs = function.numel_in(0)
        self.name = name
        affine = _Rows(self.inputs, name)
        (rows,) = Reading(function, affine, name)(affine.symbols)
        self._nodes = nodes = affine.nodes
        first = 1 + self.inputs
        self._places = {variable: (0, variable) for variable in range(first)}
        self.widths = [first]
        self.groups: list[Group] = []

        def place(k: int) -> tuple[int, str]:
            return nodes[k].level, str(nodes[k].kind)

        for _, members in groupby(sorted(range(len(nodes)), key=place), place):
            indices = list(members)
            arguments = zip(*(nodes[k].rows for k in indices), strict=True)
            kind = nodes[indices[0]].kind
            self.groups.append(Group(kind, tuple(self._argument(rows) for rows in arguments)))
            number = len(self.widths)
            self._places |= {first + k: (number, column) for column, k in enumerate(indices)}
            self.widths.append(len(indices))
        self.outputs = self._argument(rows)

    def switches_on(self, index: int) -> bool:
        """Return whether the argument of a kink, a jump or a table depends on an input.

        Derivatives of CasADi in such an input do not contain its kinks and jumps.

        index: index of the input
        """
        reached = {1 + index}
        for variable, node in enumerate(self._nodes, start=1 + self.inputs):
            if any(reached & row.keys() for row in node.rows):
                if node.kind in ("relu", "step") or isinstance(node.kind, Spline):
                    return True
                reached.add(variable)
        return False

    def _argument(self, rows: Sequence[Row]) -> Argument:
        blocks: dict[int, np.ndarray] = {}
        for index, row in enumerate(rows):
            for variable, coefficient in row.items():
                group, column = self._places[variable]
                if group not in blocks:
                    blocks[group] = np.zeros((len(rows), self.widths[group]))
                blocks[group][index, column] = float(coefficient)
        stored = {group: _stored(block) for group, block in blocks.items()}
        return Argument(stored, {group: abs(block) for group, block in stored.items()})


def _stored(block: np.ndarray) -> Any:
    """Return the matrix in sparse form if few of its entries are nonzero, otherwise unchanged."""
    return csr_array(block) if np.count_nonzero(block) < _SPARSE * block.size else block


def _function(kind: str) -> Callable[[_Rows, Row], Row]:
    """Return the method that adds a node of a function of one variable."""
    return lambda rows, row: rows.node(kind, row)


class _Rows(Arithmetic):
    """Affine rows, whose other operations add nodes.

    inputs: number of inputs
    name: name of the function, for messages
    """

    def __init__(self, inputs: int, name: str) -> None:
        self.nodes: list[Node] = []
        self._name = name
        self._first = 1 + inputs
        self._known: dict[tuple[Any, ...], int] = {}

    @property
    def symbols(self) -> list[Row]:
        """Rows of the inputs."""
        return [{variable: _ONE} for variable in range(1, self._first)]

    def constant(self, value: float) -> Row:
        return {0: Fraction(value)} if value else {}

    def add(self, a: Row, b: Row) -> Row:
        return _plus(a, b)

    def subtract(self, a: Row, b: Row) -> Row:
        return _plus(a, b, -_ONE)

    def negative(self, a: Row) -> Row:
        return _plus({}, a, -_ONE)

    def multiply(self, a: Row, b: Row) -> Row:
        for row, other in ((a, b), (b, a)):
            if _is_constant(row):
                return _plus({}, other, row.get(0, Fraction(0)))
        return self.node("product", a, b)

    def divide(self, a: Row, b: Row) -> Row:
        if _is_constant(b) and b:
            return _plus({}, a, 1 / b[0])
        if self._has_both_sides(a, b):
            return a  # slope of max: [t >= 0] / ([t >= 0] + [t <= 0]), which is 1/2 at 0
        return self.multiply(a, self.inverse(b))

    inverse = _function("inverse")
    sqrt = _function("sqrt")
    exp = _function("exp")
    log = _function("log")
    sin = _function("sin")
    cos = _function("cos")
    atan = _function("atan")
    tanh = _function("tanh")

    def atan2(self, a: Row, b: Row) -> Row:
        if not a:
            raise BadInputError(
                f"{self._name}: atan2(0, x) is not supported; write the angle without atan2"
            )
        return super().atan2(a, b)

    def maximum(self, a: Row, b: Row) -> Row:
        """Return the row of max(a, b) = b + max(a - b, 0), with the constant of both as b."""
        if _is_constant(a) and not _is_constant(b):
            return self.maximum(b, a)
        return _plus(b, self._relu(_plus(a, b, -_ONE)))

    def absolute(self, a: Row) -> Row:
        """Return the row of |a| = 2 max(a, 0) - a."""
        return _plus(self.negative(a), self._relu(a), Fraction(2))

    def _relu(self, row: Row) -> Row:
        """Return the row of max(t, 0), with t the value of the given row.

        If max(-t, 0) is already a node, the result is t + max(-t, 0).
        """
        if _is_constant(row):
            return {0: row[0]} if row.get(0, 0) > 0 else {}
        opposite = self._known.get(("relu", _key(self.negative(row))))
        if opposite is not None:
            return _plus(row, {opposite: _ONE})
        return self.node("relu", row)

    def less(self, a: Row, b: Row) -> Row:
        """Return the row of a step, whose enclosure at a = b contains both values."""
        return self.node("step", _plus(b, a, -_ONE))

    at_most = less

    def _has_both_sides(self, step: Row, total: Row) -> bool:
        """Return whether two rows are the step of t, and the sum of the steps of t and -t."""
        first = self._stepped(step)
        other = self._stepped(_plus(total, step, -_ONE))
        return first is not None and other is not None and not _plus(first, other)

    def _stepped(self, row: Row) -> Row | None:
        """Return the argument of a row that is one step, or None for any other row."""
        variable = next(iter(row), 0)
        if row != {variable: _ONE} or variable < self._first:
            return None
        node = self.nodes[variable - self._first]
        return node.rows[0] if node.kind == "step" else None

    def table(self, spline: Spline, a: Row) -> Row:
        return self.node(spline, a)

    def node(self, kind: Kind, *rows: Row) -> Row:
        """Return the affine row of a node with the given kind and arguments.

        A node with the same kind and arguments is reused.

        Raises BadInputError if there are more than `MOST_NODES` nodes.
        """
        key = (kind, *map(_key, rows))
        if key not in self._known:
            if len(self.nodes) == MOST_NODES:
                raise BadInputError(
                    f"{self._name}: the function has more than {MOST_NODES} nonlinear operations; "
                    "simplify the function"
                )
            levels = [
                self.nodes[variable - self._first].level
                for row in rows
                for variable in row
                if variable >= self._first
            ]
            self._known[key] = self._first + len(self.nodes)
            self.nodes.append(Node(kind, rows, 1 + max(levels, default=0)))
        return {self._known[key]: _ONE}


def _is_constant(row: Row) -> bool:
    return row.keys() <= {0}


def _plus(a: Row, b: Row, factor: Fraction = _ONE) -> Row:
    """Return the affine row a + factor b of two affine rows."""
    total = dict(a)
    if not factor:
        return total
    for variable, coefficient in b.items():
        change = factor * coefficient
        new = total[variable] + change if variable in total else change
        if new:
            total[variable] = new
        else:
            del total[variable]
    return total


def _key(row: Row) -> frozenset[tuple[int, Fraction]]:
    return frozenset(row.items())
