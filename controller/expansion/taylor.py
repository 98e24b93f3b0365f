"""Truncated power series of CasADi functions, with balls as coefficients.

A series of n variables is an array (M,) of the coefficients of all monomials, degree by degree: of
1, z1, z2, z1², z1 z2, z2² for n = 2.
"""

from __future__ import annotations

import operator
from collections.abc import Callable
from itertools import pairwise
from typing import TYPE_CHECKING, TypeAlias

import casadi as ca
import numpy as np

from controller.game.basis import monomials
from hfa_support.errors import BadInputError

if TYPE_CHECKING:
    from flint import arb, arb_series

Operation: TypeAlias = Callable[..., np.ndarray]
#: Number of an operation in CasADi -> its name.
_NAMES = {getattr(ca, name): name[3:].lower() for name in dir(ca) if name.startswith("OP_")}


class PowerSeries:
    """Arithmetic of power series of n variables up to a degree.

    n: number of variables
    degree: degree of the last terms
    exponents: (M, n), of each monomial
    of: slice of the monomials of each degree
    products: for each monomial, the places of its products with all monomials, as far as the degree
    """

    def __init__(self, n: int, degree: int) -> None:
        from flint import arb

        self.zero = arb(0)
        degrees = [monomials(n, each) for each in range(degree + 1)]
        ends = np.cumsum([0, *map(len, degrees)])
        self.n, self.degree, self.exponents = n, degree, np.vstack(degrees).astype(object)
        self.of = [slice(*each) for each in pairwise(ends)]
        places = {tuple(row): place for place, row in enumerate(self.exponents)}
        self.products = [
            [places[tuple(row)] for row in self.exponents[: ends[degree + 1 - sum(each)]] + each]
            for each in self.exponents
        ]

    def constant(self, value: arb | float) -> np.ndarray:
        """Return the series of a number."""
        series = np.full(len(self.exponents), self.zero)
        series[0] += value
        return series

    def variables(self) -> np.ndarray:
        """Return the variables z1, ..., zn, (n, M)."""
        series = np.full((self.n, len(self.exponents)), self.zero)
        series[:, self.of[1]][np.diag_indices(self.n)] += 1
        return series

    def product(self, one: np.ndarray, other: np.ndarray) -> np.ndarray:
        """Return the product of two series."""
        # An uncertain 0 is no 0.
        few, many = sorted((one, other), key=lambda each: -np.count_nonzero(each == 0))
        total = self.constant(0)
        for place in np.flatnonzero(~(few == 0)):
            to = self.products[place]
            total[to] += few[place] * many[: len(to)]
        return total

    def gradient(self, series: np.ndarray) -> np.ndarray:
        """Return the derivatives of a series by each variable, (n, M)."""
        slopes = np.full((self.n, len(series)), self.zero)
        for place in range(self.n):
            to = self.products[1 + place]
            slopes[place, : len(to)] = series[to] * self.exponents[to, place]
        return slopes

    def composed(self, f: Callable[[arb_series], arb_series], inner: np.ndarray) -> np.ndarray:
        """Return f(s) of a series s and a function of one variable."""
        from flint import arb_series

        rest, total = inner.copy(), self.constant(0)
        rest[0] = self.zero
        for coefficient in reversed(f(arb_series([inner[0], 1], self.degree + 1)).coeffs()):
            total = self.product(total, rest)
            total[0] += coefficient
        return total

    def values(self, function: ca.Function, arguments: np.ndarray) -> np.ndarray:
        """Return the results of a CasADi function of scalar instructions for series, (k, M).

        function: one vector (n,) -> one dense vector (k,)
        arguments: series, (n, M)

        Raises BadInputError if a function that it calls, or an operation at the values of the
        arguments at 0, has no power series, or if a coefficient is not finite.
        """
        memory: dict[int, np.ndarray] = {}
        results = np.full((function.numel_out(0), len(self.exponents)), self.zero)
        for index in range(function.n_instructions()):
            code = function.instruction_id(index)
            inputs, outputs = function.instruction_input(index), function.instruction_output(index)
            if code == ca.OP_CONST:
                memory[outputs[0]] = self.constant(function.instruction_constant(index))
            elif code == ca.OP_INPUT:
                memory[outputs[0]] = arguments[inputs[1]]
            elif code == ca.OP_OUTPUT:
                results[outputs[1]] = memory[inputs[0]]
            else:
                try:
                    if code not in _OPERATIONS:
                        raise ValueError
                    operands = [memory[place] for place in inputs]
                    memory[outputs[0]] = _OPERATIONS[code](self, *operands)
                except (ValueError, ZeroDivisionError):
                    raise BadInputError(
                        f"the equations have no finite power series at the trim ({_NAMES[code]}); "
                        "choose another trim, or leave out the order"
                    ) from None
        if not all(coefficient.is_finite() for coefficient in results.flat):
            raise BadInputError(
                f"the derivatives to order {self.degree} of the equations are not finite at the "
                "trim; choose a lower order or another trim"
            )
        return results


def _sign(series: np.ndarray) -> int:
    """Return the sign of a series near 0: that of its value at 0, or 0 of a series that is 0."""
    if (series == 0).all():
        return 0
    if not (series[0] > 0 or series[0] < 0):
        raise ValueError
    return 1 if series[0] > 0 else -1


_EXP, _LOG, _INV, _ATAN = map(operator.methodcaller, ("exp", "log", "inv", "atan"))


def _quotient(ring: PowerSeries, a: np.ndarray, b: np.ndarray) -> np.ndarray:
    return ring.product(a, ring.composed(_INV, b))


def _power(ring: PowerSeries, a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """Return a**b. An exponent that is not constant requires a base above 0."""
    if (b[1:] == 0).all():
        return ring.composed(lambda at: at ** b[0], a)
    return ring.composed(_EXP, ring.product(b, ring.composed(_LOG, a)))


def _tanh(ring: PowerSeries, a: np.ndarray) -> np.ndarray:
    """Return (exp(2a) - 1) / (exp(2a) + 1)."""
    square, one = ring.composed(_EXP, 2 * a), ring.constant(1)
    return _quotient(ring, square - one, square + one)


def _atan2(ring: PowerSeries, y: np.ndarray, x: np.ndarray) -> np.ndarray:
    """Return the angle of the point (x, y)."""
    from flint import arb

    if x[0] > 0:
        return ring.composed(_ATAN, _quotient(ring, y, x))
    angle = ring.composed(_ATAN, _quotient(ring, x, y))
    return ring.constant(_sign(y) * arb.pi() / 2) - angle


def _of_one(name: str) -> Operation:
    return lambda ring, a: ring.composed(operator.methodcaller(name), a)


def _comparison(name: str) -> Operation:
    holds = getattr(operator, name)
    return lambda ring, a, b: ring.constant(int(holds(_sign(a - b), 0)))


#: Functions of one variable by their names, which CasADi and FLINT share.
_OF_FLINT = ("inv", "sqrt", "exp", "log", "sin", "cos", "tan", "asin", "acos", "atan", "erf")
_OPERATIONS: dict[int, Operation] = {
    ca.OP_ASSIGN: lambda ring, a: a,
    ca.OP_ADD: lambda ring, a, b: a + b,
    ca.OP_SUB: lambda ring, a, b: a - b,
    ca.OP_MUL: PowerSeries.product,
    ca.OP_DIV: _quotient,
    ca.OP_NEG: lambda ring, a: -a,
    ca.OP_TWICE: lambda ring, a: 2 * a,
    ca.OP_SQ: lambda ring, a: ring.product(a, a),
    ca.OP_POW: _power,
    ca.OP_CONSTPOW: _power,
    ca.OP_ATAN2: _atan2,
    ca.OP_TANH: _tanh,
    **{getattr(ca, f"OP_{name.upper()}"): _comparison(name) for name in ("lt", "le", "eq", "ne")},
    # Of 0 and 1.
    ca.OP_NOT: lambda ring, a: ring.constant(1) - a,
    ca.OP_AND: PowerSeries.product,
    ca.OP_OR: lambda ring, a, b: a + b - ring.product(a, b),
    ca.OP_IF_ELSE_ZERO: lambda ring, holds, a: a if holds[0] == 1 else holds,
    ca.OP_FABS: lambda ring, a: _sign(a) * a,
    ca.OP_SIGN: lambda ring, a: ring.constant(_sign(a)),
    ca.OP_FMIN: lambda ring, a, b: a if _sign(a - b) <= 0 else b,
    ca.OP_FMAX: lambda ring, a, b: a if _sign(a - b) >= 0 else b,
    **{getattr(ca, f"OP_{name.upper()}"): _of_one(name) for name in _OF_FLINT},
}
