"""Taylor models of second order in balls, and a CasADi function run on them: the arithmetic of the checker.

No part of the prover is used: it has its own instructions and another enclosure (power series, `ball_function.py`).
Source: Makino and Berz, Taylor models and other validated functional inclusion methods, IJPAM 4 (2003).
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import casadi as ca
from flint import arb, arb_series

from hfa_model.support.errors import NoSolutionError


class Rejected(NoSolutionError):
    """A box of the certificate does not prove what it states."""


class TaylorModel:
    """c_0 + c_1 s + c_2 s² + rest for every |s| <= 1, with balls as coefficients."""

    __slots__ = ("c0", "c1", "c2", "rest")

    def __init__(self, c0: Any, c1: Any = 0, c2: Any = 0, rest: Any = 0) -> None:
        self.c0, self.c1, self.c2, self.rest = arb(c0), arb(c1), arb(c2), arb(rest)

    def __add__(self, other: Any) -> TaylorModel:
        o = as_model(other)
        return TaylorModel(self.c0 + o.c0, self.c1 + o.c1, self.c2 + o.c2, self.rest + o.rest)

    def __neg__(self) -> TaylorModel:
        return TaylorModel(-self.c0, -self.c1, -self.c2, -self.rest)

    __radd__ = __add__

    def __mul__(self, other: Any) -> TaylorModel:
        if isinstance(other, arb):
            return TaylorModel(self.c0 * other, self.c1 * other, self.c2 * other, self.rest * other)
        o = other
        cut = _ball(self.c1 * o.c2 + self.c2 * o.c1) + self.c2 * o.c2 * _SQUARE
        rest = cut + self.rest * o.range() + o.rest * self._polynomial()
        c2 = self.c0 * o.c2 + self.c1 * o.c1 + self.c2 * o.c0
        return TaylorModel(self.c0 * o.c0, self.c0 * o.c1 + self.c1 * o.c0, c2, rest)

    __rmul__ = __mul__

    def _polynomial(self) -> arb:
        return self.c0 + _ball(self.c1) + self.c2 * _SQUARE

    def range(self) -> arb:
        """Every value on the box."""
        return self._polynomial() + self.rest

    def through(self, function: Any) -> TaylorModel:
        """f(c_0 + δ) = f + f' δ + f''/2 δ² + f'''(ξ)/6 δ³ with ξ in the range."""
        near = function(arb_series([self.c0, 1], prec=3))
        far = function(arb_series([self.range(), 1], prec=4))
        delta = TaylorModel(0, self.c1, self.c2, self.rest)
        square = delta * delta
        total = delta * near[1] + square * near[2] + TaylorModel(near[0])
        return total + TaylorModel(0, 0, 0, far[3] * square.range() * delta.range())


#: {s² : |s| <= 1}.
_SQUARE = arb(0.5, 0.5)


def _ball(value: arb) -> arb:
    """{s value : |s| <= 1}."""
    return arb(0, 1) * value


def as_model(value: Any) -> TaylorModel:
    """A ball as a Taylor model; a Taylor model is its own."""
    return value if isinstance(value, TaylorModel) else TaylorModel(value)


def values_of(value: Any) -> arb:
    """Every value that a ball or a Taylor model takes."""
    return value.range() if isinstance(value, TaylorModel) else value


def _through(function: Any) -> Any:
    return lambda x: x.through(function) if isinstance(x, TaylorModel) else function(arb_series([x], prec=1))[0]


_inverse = _through(lambda x: 1 / x)


def _choice(x: Any, y: Any, first: Any, second: Any) -> Any:
    """The first where x <= y is certain, the second where x > y is."""
    if values_of(x) <= values_of(y):
        return first
    if values_of(x) > values_of(y):
        return second
    raise Rejected("a branch of the equations is not decided")


def _arctangent(y: Any, x: Any) -> Any:
    if not values_of(x) > 0:
        raise Rejected("atan2 outside the right half plane")
    return _through(lambda z: z.atan())(y * _inverse(x))


_OPERATIONS = {
    ca.OP_ADD: lambda x, y: x + y,
    ca.OP_SUB: lambda x, y: x + (-y),
    ca.OP_MUL: lambda x, y: x * y,
    ca.OP_DIV: lambda x, y: x * _inverse(y),
    ca.OP_NEG: lambda x: -x,
    ca.OP_TWICE: lambda x: x + x,
    ca.OP_SQ: lambda x: x * x,
    ca.OP_INV: _inverse,
    ca.OP_SQRT: _through(lambda x: x.sqrt()),
    ca.OP_EXP: _through(lambda x: x.exp()),
    ca.OP_SIN: _through(lambda x: x.sin()),
    ca.OP_COS: _through(lambda x: x.cos()),
    ca.OP_ASIN: _through(lambda x: x.asin()),
    ca.OP_ATAN2: _arctangent,
    ca.OP_CONSTPOW: lambda x, y: (y * x.log()).exp(),  # of the atmosphere alone: both are balls
    ca.OP_FMIN: lambda x, y: _choice(x, y, x, y),
    ca.OP_FMAX: lambda x, y: _choice(x, y, y, x),
    ca.OP_LE: lambda x, y: _choice(x, y, arb(1), arb(0)),
}


def evaluate(function: ca.Function, *arguments: Sequence[Any]) -> list[list[Any]]:
    """Instruction by instruction, on balls and Taylor models; a KeyError for an operation that is not known."""
    work: list[Any] = [None] * function.sz_w()
    results: list[list[Any]] = [[None] * function.nnz_out(index) for index in range(function.n_out())]
    for index in range(function.n_instructions()):
        code = function.instruction_id(index)
        out, source = function.instruction_output(index), function.instruction_input(index)
        if code == ca.OP_INPUT:
            work[out[0]] = arguments[source[0]][source[1]]
        elif code == ca.OP_OUTPUT:
            results[out[0]][out[1]] = work[source[0]]
        elif code == ca.OP_CONST:
            work[out[0]] = arb(function.instruction_constant(index))
        else:
            work[out[0]] = _OPERATIONS[code](*(work[place] for place in source))
    return results
