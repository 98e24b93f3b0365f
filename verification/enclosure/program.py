"""A CasADi function as nonlinear nodes and affine rows between them.

A row is a sum of coefficients times variables. The coefficients are rational numbers and therefore
exact. Variable 0 is the constant 1, followed by the inputs and the nodes. Layers of a network
become rows, which are evaluated as matrix products.

CasADi folds constants in doubles and stores 5 (0.2 x) as x. The proof covers the folded function,
which is also the function that is evaluated.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from fractions import Fraction
from itertools import groupby
from typing import Any, NamedTuple

import casadi as ca
import numpy as np
from scipy.sparse import csr_array

from hfa_support.errors import BadInputError


def operation_name(code: int) -> str:
    """Return the lower-case name of a CasADi operation code, or the code if it has no name."""
    for name in dir(ca):
        if name.startswith("OP_") and getattr(ca, name) == code:
            return name.removeprefix("OP_").lower()
    return str(code)


Row = Mapping[int, Fraction]
#: Largest number of operations of a function.
LARGEST = 40_000
#: Largest number of its nonlinear operations.
MOST_NODES = 4_000
_ONE = Fraction(1)
_LINEAR = {
    ca.OP_ASSIGN: (1, 0),
    ca.OP_ADD: (1, 1),
    ca.OP_SUB: (1, -1),
    ca.OP_NEG: (-1, 0),
    ca.OP_TWICE: (2, 0),
}
_UNIVARIATE = {
    ca.OP_TANH: "tanh",
    ca.OP_SIN: "sin",
    ca.OP_COS: "cos",
    ca.OP_EXP: "exp",
    ca.OP_LOG: "log",
    ca.OP_SQRT: "sqrt",
    ca.OP_INV: "inverse",
    ca.OP_ATAN: "atan",
}
#: Largest whole power that is a product.
_LARGEST_POWER = 12
#: Largest share of entries other than 0 in a matrix that is stored as a sparse one.
_SPARSE = 0.5


class Node(NamedTuple):
    """Nonlinear operation of a program.

    kind: "product", "relu" (max(t, 0)), "step" (1 where t > 0, else 0), or a function of one
        variable.
    rows: one affine row for each argument, one or two.
    level: 1 above the highest level of the nodes in `rows`.
    """

    kind: str
    rows: tuple[Row, ...]
    level: int


class Argument(NamedTuple):
    """Affine rows that compute one argument of all nodes of a group, in double precision.

    blocks: earlier group -> coefficients (nodes, variables of the earlier group), sparse if most
        are 0.
    sizes: earlier group -> absolute values of the coefficients
    """

    blocks: Mapping[int, Any]
    sizes: Mapping[int, Any]


class Group(NamedTuple):
    """Nodes of the same kind and level, which are evaluated together.

    kind: kind of the nodes, as in `Node`
    arguments: affine rows of each argument
    """

    kind: str
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
        if function.is_a("MXFunction"):
            function = function.expand()
        if function.n_instructions() > LARGEST:
            raise BadInputError(
                f"{name}: the function has {function.n_instructions()} operations, but at most "
                f"{LARGEST} are supported; simplify the function"
            )
        self.inputs = function.numel_in(0)
        self.name = name
        reader = _Reader(self.inputs, name)
        rows = reader.read(function)
        first = 1 + self.inputs
        self._places = {variable: (0, variable) for variable in range(first)}
        self.widths = [first]
        self.groups: list[Group] = []
        nodes = reader.nodes
        order = sorted(range(len(nodes)), key=lambda k: (nodes[k].level, nodes[k].kind))
        for (_, kind), members in groupby(order, lambda k: (nodes[k].level, nodes[k].kind)):
            indices = list(members)
            arguments = zip(*(nodes[k].rows for k in indices), strict=True)
            self.groups.append(Group(kind, tuple(self._argument(rows) for rows in arguments)))
            number = len(self.widths)
            self._places |= {first + k: (number, column) for column, k in enumerate(indices)}
            self.widths.append(len(indices))
        self.outputs = self._argument(rows)

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


class _Reader:
    """Converter of a CasADi function into affine rows and nonlinear nodes."""

    def __init__(self, inputs: int, name: str) -> None:
        self.nodes: list[Node] = []
        self._name = name
        self._first = 1 + inputs
        self._known: dict[tuple[Any, ...], int] = {}

    def read(self, function: ca.Function) -> list[Row]:
        """Return the affine row of each output of the function."""
        work: dict[int, Row] = {}
        outputs: dict[int, Row] = {}
        for index in range(function.n_instructions()):
            operation = function.instruction_id(index)
            sources = function.instruction_input(index)
            target, *entry = function.instruction_output(index)
            if operation == ca.OP_CONST:
                work[target] = self._constant(function.instruction_constant(index))
            elif operation == ca.OP_INPUT:
                work[target] = {1 + sources[1]: _ONE}
            elif operation == ca.OP_OUTPUT:
                outputs[entry[0]] = work[sources[0]]
            else:
                work[target] = self._result(operation, work[sources[0]], work[sources[-1]])
        return [outputs[index] for index in sorted(outputs)]

    def _constant(self, value: float) -> Row:
        if not math.isfinite(value):
            raise BadInputError(f"{self._name}: the function contains {value}; use finite numbers")
        return {0: Fraction(value)} if value else {}

    def _result(self, operation: int, first: Row, last: Row) -> Row:
        if operation in _LINEAR:
            of_first, of_last = _LINEAR[operation]
            scaled = first if of_first == 1 else _plus({}, first, Fraction(of_first))
            return _plus(scaled, last, Fraction(of_last)) if of_last else scaled
        if operation in _UNIVARIATE:
            return self._node(_UNIVARIATE[operation], first)
        if operation in _SPECIAL:
            return _SPECIAL[operation](self, first, last)
        raise BadInputError(
            f"{self._name}: the function uses {operation_name(operation)}, which is not supported; "
            "use only sums, products, quotients, powers, roots, exp, log, tanh, sin, cos, tan, "
            "asin, atan, atan2, min, max and abs"
        )

    def _maximum(self, first: Row, last: Row) -> Row:
        """Return the affine row of max(first, last) = last + max(first - last, 0)."""
        return _plus(last, self._relu(_plus(first, last, -_ONE)))

    def _minimum(self, first: Row, last: Row) -> Row:
        """Return the affine row of min(first, last) = last - max(last - first, 0)."""
        return _plus(last, self._relu(_plus(last, first, -_ONE)), -_ONE)

    def _absolute(self, first: Row, _: Row) -> Row:
        """Return the affine row of |first| = 2 max(first, 0) - first."""
        return _plus(_plus({}, first, -_ONE), self._relu(first), Fraction(2))

    def _relu(self, row: Row) -> Row:
        """Return the affine row of max(t, 0), with t the value of the given row.

        If max(-t, 0) is already a node, the result is t + max(-t, 0).
        """
        opposite = self._known.get(_key("relu", (_plus({}, row, -_ONE),)))
        if opposite is not None:
            return _plus(row, {opposite: _ONE})
        return self._node("relu", row)

    def _product(self, first: Row, last: Row) -> Row:
        for row, other in ((first, last), (last, first)):
            if set(row) <= {0}:
                return _plus({}, other, row.get(0, Fraction(0)))
        return self._node("product", first, last)

    def _quotient(self, first: Row, last: Row) -> Row:
        return self._product(first, self._node("inverse", last))

    def _power(self, first: Row, last: Row) -> Row:
        power = last.get(0, Fraction(0))
        if set(last) <= {0} and power.denominator == 1 and 0 < power <= _LARGEST_POWER:
            return self._whole_power(first, int(power))
        exponent = self._product(last, self._node("log", first))
        return self._node("exp", exponent)

    def _whole_power(self, row: Row, power: int) -> Row:
        if power == 1:
            return row
        half = self._whole_power(row, power // 2)
        square = self._product(half, half)
        return self._product(square, row) if power % 2 else square

    def _tangent(self, first: Row, _: Row) -> Row:
        return self._quotient(self._node("sin", first), self._node("cos", first))

    def _angle(self, first: Row, last: Row) -> Row:
        """Return the affine row of atan2(first, last).

        The function is computed as 2 atan(first / (sqrt(first² + last²) + last)). The row has no
        enclosure at first = 0 and last <= 0.

        Raises BadInputError if first is the constant 0.
        """
        if not first:
            raise BadInputError(
                f"{self._name}: atan2(0, x) is not supported; write the angle without atan2"
            )
        squares = _plus(self._product(first, first), self._product(last, last))
        below = _plus(self._node("sqrt", squares), last)
        return _plus({}, self._node("atan", self._quotient(first, below)), Fraction(2))

    def _arcsine(self, first: Row, _: Row) -> Row:
        """Return the affine row of asin t = atan(t / sqrt(1 - t²)), with t = first and |t| < 1."""
        below = self._node("sqrt", _plus({0: _ONE}, self._product(first, first), -_ONE))
        return self._node("atan", self._quotient(first, below))

    def _less(self, first: Row, last: Row) -> Row:
        """Return the affine row of the step that is 1 for first < last and 0 for first > last.

        The step is enclosed by [0, 1] where first and last may be equal.
        """
        return self._node("step", _plus(last, first, -_ONE))

    def _not(self, first: Row, _: Row) -> Row:
        return _plus({0: _ONE}, first, -_ONE)

    def _less_one(self, first: Row, _: Row) -> Row:
        """Return the affine row of expm1(first) = exp(first) - 1."""
        return _plus(self._node("exp", first), {0: _ONE}, -_ONE)

    def _of_one_more(self, first: Row, _: Row) -> Row:
        """Return the affine row of log1p(first) = log(1 + first)."""
        return self._node("log", _plus(first, {0: _ONE}))

    def _node(self, kind: str, *rows: Row) -> Row:
        """Return the affine row of a node with the given kind and arguments.

        If all arguments are the constant 0 and the function of 0 is 0, the row is empty. A node
        with the same kind and arguments is reused.

        Raises BadInputError if there are more than `MOST_NODES` nodes.
        """
        if all(not row for row in rows) and kind in ("sin", "tanh", "atan", "relu"):
            return {}
        key = _key(kind, rows)
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


_SPECIAL: Mapping[int, Callable[[_Reader, Row, Row], Row]] = {
    ca.OP_MUL: _Reader._product,
    ca.OP_SQ: _Reader._product,
    ca.OP_DIV: _Reader._quotient,
    ca.OP_FMAX: _Reader._maximum,
    ca.OP_FMIN: _Reader._minimum,
    ca.OP_FABS: _Reader._absolute,
    ca.OP_POW: _Reader._power,
    ca.OP_CONSTPOW: _Reader._power,
    ca.OP_TAN: _Reader._tangent,
    ca.OP_ATAN2: _Reader._angle,
    ca.OP_ASIN: _Reader._arcsine,
    ca.OP_LT: _Reader._less,
    ca.OP_LE: _Reader._less,
    ca.OP_NOT: _Reader._not,
    ca.OP_IF_ELSE_ZERO: _Reader._product,
    ca.OP_EXPM1: _Reader._less_one,
    ca.OP_LOG1P: _Reader._of_one_more,
}


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


def _key(kind: str, rows: Sequence[Row]) -> tuple[Any, ...]:
    return (kind, *(frozenset(row.items()) for row in rows))
