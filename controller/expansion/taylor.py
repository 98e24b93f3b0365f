"""Truncated power series of CasADi functions, with balls as coefficients.

A series of n variables is a dictionary: monomial -> coefficient. The exponents of a monomial are
digits of one integer, and its degree is the first digit, so that a product adds the integers.
"""

from __future__ import annotations

import operator
from collections.abc import Callable, Sequence
from itertools import combinations_with_replacement
from typing import TypeAlias

import casadi as ca
from flint import arb, arb_series

from hfa_support.errors import BadInputError

Terms: TypeAlias = dict[int, arb]
Operation: TypeAlias = Callable[..., Terms]
#: Bits of an exponent.
_DIGIT = 4


class PowerSeries:
    """Arithmetic of power series of n variables up to a degree.

    n: number of variables
    degree: degree of the last terms
    """

    def __init__(self, n: int, degree: int) -> None:
        self.n, self.degree = n, degree
        self._end = (degree + 1) << _DIGIT * n

    def monomial(self, places: Sequence[int]) -> int:
        """Return the monomial z_i z_j ... of some places (i, j, ...)."""
        return sum(1 << _DIGIT * place for place in places) + (len(places) << _DIGIT * self.n)

    def monomials(self, degree: int) -> list[int]:
        """Return all monomials of a degree, z1², z1 z2, z2² for n = 2."""
        return [
            self.monomial(places) for places in combinations_with_replacement(range(self.n), degree)
        ]

    def exponent(self, monomial: int, place: int) -> int:
        """Return the exponent of a variable in a monomial."""
        return monomial >> _DIGIT * place & (1 << _DIGIT) - 1

    def variables(self) -> list[Terms]:
        """Return the variables z1, ..., zn."""
        return [{self.monomial([place]): arb(1)} for place in range(self.n)]

    def linear(self, row: Sequence[arb], parts: Sequence[Terms]) -> Terms:
        """Return the sum of some series, each times a number."""
        total: Terms = {}
        for factor, part in zip(row, parts, strict=True):
            if factor != 0:
                for monomial, coefficient in part.items():
                    term = coefficient * factor
                    total[monomial] = total[monomial] + term if monomial in total else term
        return total

    def sum(self, one: Terms, other: Terms) -> Terms:
        """Return the sum of two series."""
        return self.linear([arb(1), arb(1)], [one, other])

    def product(self, one: Terms, other: Terms) -> Terms:
        """Return the product of two series."""
        few, many = sorted((one, other), key=len)
        sorted_terms = sorted(many.items())  # by degree
        total: Terms = {}
        for monomial, coefficient in few.items():
            end = self._end - monomial
            for factor, by in sorted_terms:
                if factor >= end:
                    break
                key, term = monomial + factor, coefficient * by
                total[key] = total[key] + term if key in total else term
        return total

    def gradient(self, series: Terms) -> list[Terms]:
        """Return the derivatives of a series by each variable."""
        return [
            {
                monomial - self.monomial([place]): coefficient * power
                for monomial, coefficient in series.items()
                if (power := self.exponent(monomial, place))
            }
            for place in range(self.n)
        ]

    def of_degree(self, series: Terms, degree: int) -> list[arb]:
        """Return the coefficients of all monomials of a degree."""

        return [series.get(monomial, arb(0)) for monomial in self.monomials(degree)]

    def composed(self, name: str, inner: Terms) -> Terms:
        """Return f(s) of a series s and a function of one variable, a method of `arb_series`."""

        at = inner.get(0, arb(0))
        try:
            outer = getattr(arb_series([at, 1], self.degree + 1), name)().coeffs()
        except (ValueError, ZeroDivisionError):
            raise _no_series(name) from None
        rest = {monomial: coefficient for monomial, coefficient in inner.items() if monomial}
        total: Terms = {}
        for coefficient in reversed(outer):
            total = self.sum(self.product(total, rest), {0: coefficient})
        return total

    def values(self, function: ca.Function, arguments: Sequence[Terms]) -> list[Terms]:
        """Return the results of a CasADi function of scalar instructions for series.

        arguments: a series for each entry of the function's arguments

        Raises BadInputError if a function that it calls, or an operation at the values of the
        arguments at 0, has no power series, or if a coefficient is not finite.
        """

        begins = [0]
        for place in range(function.n_in()):
            begins.append(begins[-1] + function.numel_in(place))
        memory: dict[int, Terms] = {}
        results: dict[tuple[int, int], Terms] = {}
        for index in range(function.n_instructions()):
            code = function.instruction_id(index)
            inputs, outputs = function.instruction_input(index), function.instruction_output(index)
            if code == ca.OP_CONST:
                number = function.instruction_constant(index)
                memory[outputs[0]] = {0: arb(number)} if number else {}
            elif code == ca.OP_INPUT:
                memory[outputs[0]] = arguments[begins[inputs[0]] + inputs[1]]
            elif code == ca.OP_OUTPUT:
                results[outputs[0], outputs[1]] = memory[inputs[0]]
            elif code in _OPERATIONS:
                operands = [memory[place] for place in inputs]
                memory[outputs[0]] = _OPERATIONS[code](self, *operands)
            else:
                raise _no_series(f"operation {code}")
        found = [
            results.get((place, entry), {})
            for place in range(function.n_out())
            for entry in range(function.numel_out(place))
        ]
        for series in found:
            if not all(coefficient.is_finite() for coefficient in series.values()):
                raise BadInputError(
                    f"the derivatives to order {self.degree} of the equations are not finite at "
                    "the trim; choose a lower order or another trim"
                )
        return found


def _no_series(name: str) -> BadInputError:
    """Return the error for an operation without a power series at the trim."""
    return BadInputError(
        f"the equations have no finite power series at the trim ({name}); choose another trim, or "
        "leave out the order"
    )


def _sign(series: Terms, name: str) -> int:
    """Return the sign of a series near 0: that of its value at 0, which must be known unless the
    series is constant.
    """
    at = series.get(0, 0)
    if at > 0:
        return 1
    if at < 0:
        return -1
    if any(coefficient != 0 for coefficient in series.values()) or at != 0:
        raise _no_series(name)
    return 0


def _scaled(a: Terms, by: float) -> Terms:
    """Return a series times a number."""
    return {monomial: coefficient * by for monomial, coefficient in a.items()}


def _minus(ring: PowerSeries, a: Terms, b: Terms) -> Terms:
    return ring.sum(a, _scaled(b, -1))


def _quotient(ring: PowerSeries, a: Terms, b: Terms) -> Terms:
    return ring.product(a, ring.composed("inv", b))


def _power(ring: PowerSeries, a: Terms, b: Terms) -> Terms:
    """Return a**b. An exponent that is no whole constant requires a base above 0."""

    exponent = b.get(0, arb(0))
    if all(coefficient == 0 for key, coefficient in b.items() if key) and exponent.is_integer():
        whole = int(float(exponent))
        base = a if whole >= 0 else ring.composed("inv", a)
        total = {0: arb(1)}
        for _ in range(abs(whole)):
            total = ring.product(total, base)
        return total
    if _sign(a, "power") <= 0:
        raise _no_series("power")
    return ring.composed("exp", ring.product(b, ring.composed("log", a)))


def _hyperbolic(ring: PowerSeries, a: Terms, sign: int) -> Terms:
    """Return (exp(a) + sign exp(-a)) / 2."""
    up, down = ring.composed("exp", a), ring.composed("exp", _scaled(a, -1))
    return _scaled(ring.sum(up, _scaled(down, sign)), 0.5)


def _atan2(ring: PowerSeries, y: Terms, x: Terms) -> Terms:
    """Return the angle of the point (x, y)."""

    if x.get(0, arb(0)) > 0:
        return ring.composed("atan", _quotient(ring, y, x))
    side = _sign(y, "atan2")
    if side == 0:
        raise _no_series("atan2")
    angle = ring.composed("atan", _quotient(ring, x, y))
    return _minus(ring, {0: side * arb.pi() / 2}, angle)


def _if(is_true: bool) -> Terms:
    """Return 1 for true, and 0."""
    return {0: arb(1)} if is_true else {}


def _by_sign(name: str, chosen: Callable[[int, Terms, Terms], Terms]) -> Operation:
    """Return the operation that chooses a result by the sign of a - b, with b = 0 of one series."""

    def operation(ring: PowerSeries, a: Terms, b: Terms | None = None) -> Terms:
        return chosen(_sign(_minus(ring, a, b or {}), name), a, b or {})

    return operation


def _comparison(holds: Callable[[int, int], bool]) -> Operation:
    return _by_sign("comparison", lambda sign, a, b: _if(holds(sign, 0)))


def _named(name: str) -> Operation:
    return lambda ring, a: ring.composed(name, a)


#: Functions of one variable by their names, which CasADi and FLINT share.
_OF_FLINT = ("inv", "sqrt", "exp", "log", "sin", "cos", "tan", "asin", "acos", "atan", "erf")
_OPERATIONS: dict[int, Operation] = {
    ca.OP_ASSIGN: lambda ring, a: a,
    ca.OP_ADD: PowerSeries.sum,
    ca.OP_SUB: _minus,
    ca.OP_MUL: PowerSeries.product,
    ca.OP_DIV: _quotient,
    ca.OP_NEG: lambda ring, a: _scaled(a, -1),
    ca.OP_TWICE: lambda ring, a: _scaled(a, 2),
    ca.OP_SQ: lambda ring, a: ring.product(a, a),
    ca.OP_POW: _power,
    ca.OP_CONSTPOW: _power,
    ca.OP_ATAN2: _atan2,
    ca.OP_SINH: lambda ring, a: _hyperbolic(ring, a, -1),
    ca.OP_COSH: lambda ring, a: _hyperbolic(ring, a, 1),
    ca.OP_TANH: lambda ring, a: _quotient(ring, _hyperbolic(ring, a, -1), _hyperbolic(ring, a, 1)),
    **{
        getattr(ca, f"OP_{name.upper()}"): _comparison(getattr(operator, name))
        for name in ("lt", "le", "eq", "ne")
    },
    ca.OP_NOT: lambda ring, a: _if(not a),
    ca.OP_AND: lambda ring, a, b: _if(bool(a and b)),
    ca.OP_OR: lambda ring, a, b: _if(bool(a or b)),
    ca.OP_IF_ELSE_ZERO: lambda ring, condition, a: a if condition else {},
    ca.OP_FABS: _by_sign("|.|", lambda sign, a, b: _scaled(a, sign)),
    ca.OP_SIGN: _by_sign("sign", lambda sign, a, b: {0: arb(sign)} if sign else {}),
    ca.OP_FMIN: _by_sign("min", lambda sign, a, b: a if sign <= 0 else b),
    ca.OP_FMAX: _by_sign("max", lambda sign, a, b: a if sign >= 0 else b),
    **{getattr(ca, f"OP_{name.upper()}"): _named(name) for name in _OF_FLINT},
}
