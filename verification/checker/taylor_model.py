"""Taylor models of second order in balls, and a CasADi function run on them: the arithmetic of the checker.

No part of the prover is used: it has its own instructions and another enclosure (power series, `ball_function.py`).
Source: Makino and Berz, Taylor models and other validated functional inclusion methods, IJPAM 4 (2003).
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from itertools import zip_longest
from typing import Any

import casadi as ca
from flint import arb, arb_mat, arb_series

from hfa_model.support.errors import NoSolutionError

#: {s² : |s| <= 1}; s⁴ has the same values.
_SQUARE = arb(0.5, 0.5)


class Rejected(NoSolutionError):
    """A box of the certificate does not prove what it states."""


class TaylorModel:
    """c_0 + c_1 s + c_2 s² + rest + Σ z_k t_k for every |s|, |t_k| <= 1, as parts (c_0, c_1, c_2, rest, z_1, ..).

    s: the place within the box. t: errors of the parameters. The parts are balls, or matrices of balls.
    """

    def __init__(self, *parts: Any) -> None:
        self.parts = parts + (0 * parts[0],) * (4 - len(parts))

    def map(self, linear: Callable[[Any], Any]) -> TaylorModel:
        """A linear map of every part."""
        return TaylorModel(*map(linear, self.parts))

    def __add__(self, other: TaylorModel) -> TaylorModel:
        return TaylorModel(*(a + b for a, b in zip_longest(self.parts, other.parts, fillvalue=0)))

    def __neg__(self) -> TaylorModel:
        return self.map(lambda part: -part)

    def __sub__(self, other: TaylorModel) -> TaylorModel:
        return self + -other

    def __mul__(self, other: TaylorModel) -> TaylorModel:
        (a0, a1, a2, rest, *za), (b0, b1, b2, other_rest, *zb) = self.parts, other.parts
        move, other_move = _ball(a1) + _SQUARE * a2, _ball(b1) + _SQUARE * b2
        errors, other_errors = self.errors(), other.errors()
        cut = (
            _ball(a1 * b2 + a2 * b1) + _SQUARE * (a2 * b2) + move * other_errors + errors * (other_move + other_errors)
        )
        rest = cut + rest * other.range() + (a0 + move + errors) * other_rest
        z = map(sum, zip_longest((x * b0 for x in za), (a0 * y for y in zb), fillvalue=0))
        return TaylorModel(a0 * b0, a0 * b1 + a1 * b0, a0 * b2 + a1 * b1 + a2 * b0, rest, *z)

    def transpose(self) -> TaylorModel:
        """Of a matrix."""
        return self.map(arb_mat.transpose)

    def errors(self) -> Any:
        """Every value of Σ z_k t_k."""
        return sum(map(_ball, self.parts[4:]), 0 * self.parts[0])

    def range(self) -> Any:
        """Every value on the box."""
        c0, c1, c2, rest = self.parts[:4]
        return c0 + _ball(c1) + _SQUARE * c2 + rest + self.errors()

    def through(self, function: Callable[[arb_series], arb_series]) -> TaylorModel:
        """f(c_0 + δ) = f + f' δ + f''/2 δ² + f'''(ξ)/6 δ³ with ξ in the range."""
        near = function(arb_series([self.parts[0], 1], prec=3))
        far = function(arb_series([self.range(), 1], prec=4))
        delta = TaylorModel(arb(0), *self.parts[1:])
        square = delta * delta
        last = TaylorModel(near[0], arb(0), arb(0), far[3] * square.range() * delta.range())
        return delta.map(lambda part: part * near[1]) + square.map(lambda part: part * near[2]) + last


def _ball(value: Any) -> Any:
    """{s value : |s| <= 1}, entry by entry."""
    return arb(0, 1) * value


def _inverse(x: TaylorModel) -> TaylorModel:
    return x.through(lambda series: 1 / series)


def _choice(x: TaylorModel, y: TaylorModel, first: TaylorModel, second: TaylorModel) -> TaylorModel:
    """The first where x <= y is certain, the second where x > y is."""
    low, high = x.range(), y.range()
    if not (low <= high or low > high):
        raise Rejected("a branch of the equations is not decided")
    return first if low <= high else second


def _arctangent(y: TaylorModel, x: TaylorModel) -> TaylorModel:
    if not x.range() > 0:
        raise Rejected("atan2 outside the right half plane")
    return (y * _inverse(x)).through(arb_series.atan)


_OPERATIONS: dict[int, Callable[..., TaylorModel]] = {
    ca.OP_ADD: lambda x, y: x + y,
    ca.OP_SUB: lambda x, y: x - y,
    ca.OP_MUL: lambda x, y: x * y,
    ca.OP_DIV: lambda x, y: x * _inverse(y),
    ca.OP_NEG: lambda x: -x,
    ca.OP_TWICE: lambda x: x + x,
    ca.OP_SQ: lambda x: x * x,
    ca.OP_INV: _inverse,
    ca.OP_SQRT: lambda x: x.through(arb_series.sqrt),
    ca.OP_EXP: lambda x: x.through(arb_series.exp),
    ca.OP_SIN: lambda x: x.through(arb_series.sin),
    ca.OP_COS: lambda x: x.through(arb_series.cos),
    ca.OP_ASIN: lambda x: x.through(arb_series.asin),
    ca.OP_ATAN2: _arctangent,
    ca.OP_CONSTPOW: lambda x, y: (y * x.through(arb_series.log)).through(arb_series.exp),
    ca.OP_FMIN: lambda x, y: _choice(x, y, x, y),
    ca.OP_FMAX: lambda x, y: _choice(x, y, y, x),
    ca.OP_LE: lambda x, y: _choice(x, y, TaylorModel(arb(1)), TaylorModel(arb(0))),
}


def evaluate(function: ca.Function, *arguments: Sequence[TaylorModel]) -> list[list[TaylorModel]]:
    """Instruction by instruction; a KeyError for an operation that is not known."""
    work: list[Any] = [None] * function.sz_w()
    results: list[list[Any]] = [[None] * function.nnz_out(i) for i in range(function.n_out())]
    for index in range(function.n_instructions()):
        code = function.instruction_id(index)
        out, source = function.instruction_output(index), function.instruction_input(index)
        if code == ca.OP_INPUT:
            work[out[0]] = arguments[source[0]][source[1]]
        elif code == ca.OP_OUTPUT:
            results[out[0]][out[1]] = work[source[0]]
        elif code == ca.OP_CONST:
            work[out[0]] = TaylorModel(arb(function.instruction_constant(index)))
        else:
            work[out[0]] = _OPERATIONS[code](*(work[place] for place in source))
    return results
