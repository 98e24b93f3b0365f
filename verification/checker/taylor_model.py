"""Taylor models of second order in balls, and a CasADi function run on them: the arithmetic of the checker.

Source: Makino and Berz, Taylor models and other validated functional inclusion methods, IJPAM 4 (2003).
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from itertools import zip_longest
from typing import Any

import casadi as ca
from flint import arb, arb_mat, arb_series

from hfa_model.support.errors import NoSolutionError

#: {s : |s| <= 1} and {s² : |s| <= 1}.
_ALL, _SQUARE = arb(0, 1), arb(0.5, 0.5)
#: Control points of s² on the four quarters of [-1, 1]: their hull holds (s, s²).
_HULL = ((-1.0, 1.0), (-0.75, 0.5), (-0.25, 0.0), (0.25, 0.0), (0.75, 0.5), (1.0, 1.0))


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
        # What is kept of the product of the two aways is a1 b1 s².
        rest = rest * b0 + a0 * other_rest + self.away(0) * other.away() + _ALL * a1 * other.away(0)
        z = map(sum, zip_longest((x * b0 for x in za), (a0 * y for y in zb), fillvalue=0))
        return TaylorModel(a0 * b0, a0 * b1 + a1 * b0, a0 * b2 + a1 * b1 + a2 * b0, rest, *z)

    def transpose(self) -> TaylorModel:
        """Of a matrix."""
        return self.map(arb_mat.transpose)

    def away(self, s: Any = _ALL, square: Any = _SQUARE) -> Any:
        """Every value less c_0, at some s and s²."""
        _, c1, c2, rest, *z = self.parts
        return s * c1 + square * c2 + sum((_ALL * each for each in z), rest)

    def range(self) -> Any:
        """Every value on the box."""
        return self.parts[0] + self.away()

    def corners(self) -> list[Any]:
        """Enclosures whose convex hull holds every value."""
        return [self.parts[0] + self.away(arb(s), arb(square)) for s, square in _HULL]

    def through(self, function: Callable[[arb_series], arb_series]) -> TaylorModel:
        """f(c_0 + δ) = f + f' δ + f''/2 δ² + f'''(ξ)/6 δ³ with ξ in the range."""
        near = function(arb_series([self.parts[0], 1], prec=3))
        far = function(arb_series([self.range(), 1], prec=4))
        delta = TaylorModel(arb(0), *self.parts[1:])
        square = delta * delta
        last = TaylorModel(near[0], arb(0), arb(0), far[3] * square.range() * self.away())
        return delta.map(lambda part: part * near[1]) + square.map(lambda part: part * near[2]) + last


def _at_most(x: TaylorModel, y: TaylorModel) -> bool:
    """x <= y, when that is certain or its contrary is."""
    low, high = x.range(), y.range()
    if not (low <= high or low > high):
        raise Rejected("a branch of the equations is not decided")
    return bool(low <= high)


def _over(x: TaylorModel, y: TaylorModel) -> TaylorModel:
    return x * y.through(lambda series: 1 / series)


def _arctangent(y: TaylorModel, x: TaylorModel) -> TaylorModel:
    if not x.range() > 0:
        raise Rejected("atan2 outside the right half plane")
    return _over(y, x).through(arb_series.atan)


_OPERATIONS: dict[int, Callable[..., TaylorModel]] = {
    ca.OP_ADD: lambda x, y: x + y,
    ca.OP_SUB: lambda x, y: x - y,
    ca.OP_MUL: lambda x, y: x * y,
    ca.OP_DIV: _over,
    ca.OP_NEG: lambda x: -x,
    ca.OP_TWICE: lambda x: x + x,
    ca.OP_SQ: lambda x: x * x,
    ca.OP_SQRT: lambda x: x.through(arb_series.sqrt),
    ca.OP_EXP: lambda x: x.through(arb_series.exp),
    ca.OP_SIN: lambda x: x.through(arb_series.sin),
    ca.OP_COS: lambda x: x.through(arb_series.cos),
    ca.OP_ASIN: lambda x: x.through(arb_series.asin),
    ca.OP_ATAN2: _arctangent,
    ca.OP_CONSTPOW: lambda x, y: x.through(lambda series: series ** y.range()),
    ca.OP_FMIN: lambda x, y: x if _at_most(x, y) else y,
    ca.OP_FMAX: lambda x, y: y if _at_most(x, y) else x,
    ca.OP_LE: lambda x, y: TaylorModel(arb(_at_most(x, y))),
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
