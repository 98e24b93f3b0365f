"""A CasADi function as exact affine rows of its inputs and of its nonlinear operations, the nodes.

A row maps each variable to a rational coefficient. Variable 0 is the constant 1. The inputs
follow, then the nodes.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from fractions import Fraction
from typing import NamedTuple

import casadi as ca

#: Variable -> coefficient. Variable 0 is the constant 1, followed by the inputs and the nodes.
Row = Mapping[int, Fraction]
#: Largest numbers of instructions and nodes.
_INSTRUCTIONS = 100_000
_NODES = 2_000
_LARGEST_POWER = 8
#: Largest degree of a product of polynomials that is expanded to monomials.
_LARGEST_DEGREE = 4
_ONE = Fraction(1)
#: Operation s a + t b of its first and last argument -> (s, t).
_LINEAR = {
    ca.OP_ADD: (1, 1),
    ca.OP_SUB: (1, -1),
    ca.OP_NEG: (-1, 0),
    ca.OP_TWICE: (2, 0),
}


class NotReadError(Exception):
    """Error for a function that is too large, or contains an unsupported operation or constant."""


class Node(NamedTuple):
    """Nonlinear operation.

    kind: "tanh", "relu" (max(t, 0)), "step" (1 if t > 0, 0 if t < 0), "square" or "product".
    rows: rows of its one or two arguments.
    level: 1 plus the highest level of the nodes in its rows.
    """

    kind: str
    rows: tuple[Row, ...]
    level: int


def affine_rows(function: ca.Function) -> tuple[list[Row], list[Node]]:
    """Return the row of each output of a function x -> y, and the nodes in these rows.

    Products of polynomials of the inputs, up to a limiting degree, become combinations of
    monomials. Each monomial is one node, so common terms of two polynomials cancel. The rows
    represent the expression that CasADi stores, including simplifications that CasADi made.

    Raises NotReadError if the function is too large, contains a constant that is not finite, or has
    other operations than +, -, *, division by a constant, small integer powers, tanh, min, max,
    |t|, sign, comparisons, not and conditions.
    """
    if function.n_instructions() > _INSTRUCTIONS:
        raise NotReadError
    reader = _Reader(function.numel_in(0))
    work: dict[int, Row] = {}
    outputs: dict[int, Row] = {}
    for index in range(function.n_instructions()):
        operation = function.instruction_id(index)
        sources = function.instruction_input(index)
        target, *entry = function.instruction_output(index)
        if operation == ca.OP_CONST:
            constant = function.instruction_constant(index)
            if not math.isfinite(constant):
                raise NotReadError
            work[target] = _plus({}, {0: _ONE}, Fraction(constant))
        elif operation == ca.OP_INPUT:
            work[target] = {1 + sources[1]: _ONE}
        elif operation == ca.OP_OUTPUT:
            outputs[entry[0]] = work[sources[0]]
        else:
            work[target] = reader.result(operation, work[sources[0]], work[sources[-1]])
    return [outputs[index] for index in sorted(outputs)], reader.nodes


def _plus(a: Row, b: Row, factor: Fraction = _ONE) -> Row:
    """Return the row a + factor b."""
    total = dict(a)
    for variable, coefficient in b.items():
        change = factor * coefficient
        new = total[variable] + change if variable in total else change
        total[variable] = new
        if not new:
            del total[variable]
    return total


class _Reader:
    """Builder of affine rows and of their nodes from the operations of a function."""

    def __init__(self, inputs: int) -> None:
        self.nodes: list[Node] = []
        self._first_node = 1 + inputs
        self._known: dict[tuple[str, frozenset[tuple[int, Fraction]]], int] = {}
        self._powers: dict[int, tuple[int, ...]] = {0: ()}
        self._powers |= {variable: (variable,) for variable in range(1, self._first_node)}
        self._monomials = {powers: variable for variable, powers in self._powers.items()}

    def result(self, operation: int, first: Row, last: Row) -> Row:
        if operation in _LINEAR:
            of_first, of_last = _LINEAR[operation]
            scaled = first if of_first == 1 else _plus({}, first, Fraction(of_first))
            return _plus(scaled, last, Fraction(of_last)) if of_last else scaled
        if operation == ca.OP_TANH:
            return {self._node("tanh", first): _ONE}
        if operation == ca.OP_FMAX:  # max(a, b) = b + max(a - b, 0)
            return _plus(last, self._relu(_plus(first, last, -_ONE)))
        if operation == ca.OP_FMIN:  # min(a, b) = b - max(b - a, 0)
            return _plus(last, self._relu(_plus(last, first, -_ONE)), -_ONE)
        if operation == ca.OP_FABS:  # |t| = 2 max(t, 0) - t
            return _plus(_plus({}, first, -_ONE), self._relu(first), Fraction(2))
        if operation == ca.OP_SIGN:  # (1 if t > 0) - (1 if -t > 0)
            return _plus(self._step(first), self._step(_plus({}, first, -_ONE)), -_ONE)
        if operation in (ca.OP_LT, ca.OP_LE):  # of a and b; either value is permitted for a = b
            return self._step(_plus(last, first, -_ONE))
        if operation == ca.OP_NOT:
            return _plus({0: _ONE}, first, -_ONE)
        if operation in (ca.OP_MUL, ca.OP_SQ):
            return self._product(first, last)
        if operation == ca.OP_DIV and set(last) == {0}:
            return _plus({}, first, 1 / last[0])
        if operation == ca.OP_DIV and self._has_both_sides(first, last):
            return first  # slope of max: [t >= 0] / ([t >= 0] + [t <= 0]), which is 1/2 at 0
        if operation == ca.OP_IF_ELSE_ZERO:
            return self._product(first, last)
        if operation == ca.OP_CONSTPOW and set(last) == {0}:
            return self._power(first, last[0])
        raise NotReadError

    def _relu(self, row: Row) -> Row:
        """Return the row of max(t, 0), where `row` is the row of t.

        If max(-t, 0) is already a node, the result is t + max(-t, 0).
        """
        opposite = self._known.get(_key("relu", _plus({}, row, -_ONE)))
        if opposite is not None:
            return _plus(row, {opposite: _ONE})
        return {self._node("relu", row): _ONE}

    def _step(self, row: Row) -> Row:
        """Return the row of the step of t: 1 for t > 0, 0 for t < 0, any value in [0, 1] at t = 0.

        row: row of t
        """
        return {self._node("step", row): _ONE}

    def _has_both_sides(self, step: Row, total: Row) -> bool:
        """Return whether two rows are the steps of opposite arguments, t and -t.

        step: the first row
        total: sum of both rows
        """
        others = _plus(total, step, -_ONE)
        arguments = []
        for row in (step, others):
            variables = [*row]
            if len(variables) != 1 or row[variables[0]] != 1 or variables[0] < self._first_node:
                return False
            node = self.nodes[variables[0] - self._first_node]
            if node.kind != "step":
                return False
            arguments.append(node.rows[0])
        return not _plus(arguments[0], arguments[1])

    def _power(self, row: Row, power: Fraction) -> Row:
        if power.denominator != 1 or not 1 <= power <= _LARGEST_POWER:
            raise NotReadError
        result = row
        for _ in range(1, int(power)):
            result = self._product(result, row)
        return result

    def _product(self, first: Row, last: Row) -> Row:
        for row, other in ((first, last), (last, first)):
            if set(row) <= {0}:
                return _plus({}, other, row.get(0, Fraction(0)))
        if self._degree(first) + self._degree(last) <= _LARGEST_DEGREE:
            return self._polynomial(first, last)
        if first == last:
            return {self._node("square", first): _ONE}
        return {self._node("product", first, last): _ONE}

    def _degree(self, row: Row) -> float:
        """Return the degree of a row as a polynomial in the inputs, or inf for any other row."""
        if not row.keys() <= self._powers.keys():
            return math.inf
        return max(len(self._powers[variable]) for variable in row)

    def _polynomial(self, first: Row, last: Row) -> Row:
        """Return the row of the product of two polynomials in the inputs, given as rows."""
        total: dict[int, Fraction] = {}
        for left, factor in first.items():
            for right, other_factor in last.items():
                powers = sorted(self._powers[left] + self._powers[right])
                monomial = self._monomial(tuple(powers))
                total[monomial] = total.get(monomial, Fraction(0)) + factor * other_factor
        return {monomial: factor for monomial, factor in total.items() if factor}

    def _monomial(self, powers: tuple[int, ...]) -> int:
        """Return the variable of a monomial, and add its node if it does not exist.

        powers: indices of the inputs in the monomial, repeated for powers
        """
        if powers not in self._monomials:
            before = {self._monomial(powers[:-1]): _ONE}
            last = {powers[-1]: _ONE}
            rows = (before,) if before == last else (before, last)
            variable = self._node("square" if before == last else "product", *rows)
            self._monomials[powers] = variable
            self._powers[variable] = powers
        return self._monomials[powers]

    def _node(self, kind: str, *rows: Row) -> int:
        """Return the variable of a nonlinear operation.

        A node is added for the operation, unless it has one argument and its node exists.

        kind: kind of the `Node`
        rows: rows of its one or two arguments

        Raises NotReadError if there are too many nodes.
        """
        key = _key(kind, rows[0])
        if len(rows) == 1 and key in self._known:
            return self._known[key]
        if len(self.nodes) == _NODES:
            raise NotReadError
        levels = [
            self.nodes[variable - self._first_node].level
            for row in rows
            for variable in row
            if variable >= self._first_node
        ]
        variable = self._first_node + len(self.nodes)
        self.nodes.append(Node(kind, rows, 1 + max(levels, default=0)))
        if len(rows) == 1:
            self._known[key] = variable
        return variable


def _key(kind: str, row: Row) -> tuple[str, frozenset[tuple[int, Fraction]]]:
    return kind, frozenset(row.items())
