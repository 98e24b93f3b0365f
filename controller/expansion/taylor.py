"""Truncated power series of CasADi functions, with balls as coefficients.

A series of n variables is a dictionary: monomial -> coefficient. The exponents of a monomial are
digits of one integer, and its degree is the first digit, so that a product adds the integers.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from itertools import combinations_with_replacement
from typing import TYPE_CHECKING, TypeAlias

import casadi as ca

from hfa_support.errors import BadInputError

if TYPE_CHECKING:
    from flint import arb

Terms: TypeAlias = "dict[int, arb]"
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
        from flint import arb

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
        total = dict(one)
        for monomial, coefficient in other.items():
            total[monomial] = total[monomial] + coefficient if monomial in total else coefficient
        return total

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
        from flint import arb

        return [series.get(monomial, arb(0)) for monomial in self.monomials(degree)]

    def composed(self, name: str, inner: Terms) -> Terms:
        """Return f(s) of a series s and a function of one variable, a method of `arb_series`."""
        from flint import arb, arb_series

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
        from flint import arb

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


def _scaled(by: float) -> Callable[[PowerSeries, Terms], Terms]:
    """Return the operation that multiplies by a number."""
    return lambda ring, a: {key: coefficient * by for key, coefficient in a.items()}


def _minus(ring: PowerSeries, a: Terms, b: Terms) -> Terms:
    return ring.sum(a, _scaled(-1)(ring, b))


def _quotient(ring: PowerSeries, a: Terms, b: Terms) -> Terms:
    return ring.product(a, ring.composed("inv", b))


def _power(ring: PowerSeries, a: Terms, b: Terms) -> Terms:
    """Return a**b. An exponent that is no whole constant requires a base above 0."""
    from flint import arb

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
    up, down = ring.composed("exp", a), ring.composed("exp", _scaled(-1)(ring, a))
    return _scaled(0.5)(ring, ring.sum(up, _scaled(sign)(ring, down)))


def _tanh(ring: PowerSeries, a: Terms) -> Terms:
    return _quotient(ring, _hyperbolic(ring, a, -1), _hyperbolic(ring, a, 1))


def _atan2(ring: PowerSeries, y: Terms, x: Terms) -> Terms:
    """Return the angle of the point (x, y)."""
    from flint import arb

    if x.get(0, arb(0)) > 0:
        return ring.composed("atan", _quotient(ring, y, x))
    side = _sign(y, "atan2")
    if side == 0:
        raise _no_series("atan2")
    angle = ring.composed("atan", _quotient(ring, x, y))
    return _minus(ring, {0: side * arb.pi() / 2}, angle)


def _hypot(ring: PowerSeries, a: Terms, b: Terms) -> Terms:
    return ring.composed("sqrt", ring.sum(ring.product(a, a), ring.product(b, b)))


def _one(ring: PowerSeries, a: Terms) -> Terms:
    from flint import arb

    return ring.sum(a, {0: arb(1)})


def _asinh(ring: PowerSeries, a: Terms) -> Terms:
    root = ring.composed("sqrt", _one(ring, ring.product(a, a)))
    return ring.composed("log", ring.sum(a, root))


def _acosh(ring: PowerSeries, a: Terms) -> Terms:
    root = ring.composed(
        "sqrt", _scaled(-1)(ring, _one(ring, _scaled(-1)(ring, ring.product(a, a))))
    )
    return ring.composed("log", ring.sum(a, root))


def _atanh(ring: PowerSeries, a: Terms) -> Terms:
    less = _one(ring, _scaled(-1)(ring, a))
    return _scaled(0.5)(ring, ring.composed("log", _quotient(ring, _one(ring, a), less)))


def _compared(is_true: Callable[[int], bool]) -> Callable[[PowerSeries, Terms, Terms], Terms]:
    """Return the comparison of two series, 1 or 0, by the sign of their difference."""
    from flint import arb

    return lambda ring, a, b: (
        {0: arb(1)} if is_true(_sign(_minus(ring, a, b), "comparison")) else {}
    )


def _logical(is_true: Callable[[bool, bool], bool]) -> Callable[[PowerSeries, Terms, Terms], Terms]:
    from flint import arb

    return lambda ring, a, b: {0: arb(1)} if is_true(bool(a), bool(b)) else {}


def _chosen(sign: int) -> Callable[[PowerSeries, Terms, Terms], Terms]:
    """Return the operation that returns the larger (sign 1) or the smaller series."""
    return lambda ring, a, b: a if sign * _sign(_minus(ring, a, b), "min, max") >= 0 else b


def _absolute(ring: PowerSeries, a: Terms) -> Terms:
    return _scaled(_sign(a, "|.|"))(ring, a)


def _one_of_sign(ring: PowerSeries, a: Terms) -> Terms:
    from flint import arb

    return {0: arb(side)} if (side := _sign(a, "sign")) else {}


def _whole(name: str) -> Callable[[PowerSeries, Terms], Terms]:
    """Return the operation floor or ceil."""

    def rounded(ring: PowerSeries, a: Terms) -> Terms:
        from flint import arb

        value = getattr(a.get(0, arb(0)), name)()
        is_constant = all(coefficient == 0 for key, coefficient in a.items() if key)
        if not value.is_exact() or (not is_constant and a.get(0, arb(0)) == value):
            raise _no_series(name)
        return {0: value}

    return rounded


def _named(name: str) -> Callable[[PowerSeries, Terms], Terms]:
    return lambda ring, a: ring.composed(name, a)


_OPERATIONS: dict[int, Callable[..., Terms]] = {
    ca.OP_ASSIGN: lambda ring, a: a,
    ca.OP_ADD: lambda ring, a, b: ring.sum(a, b),
    ca.OP_SUB: _minus,
    ca.OP_MUL: lambda ring, a, b: ring.product(a, b),
    ca.OP_DIV: _quotient,
    ca.OP_NEG: _scaled(-1),
    ca.OP_TWICE: _scaled(2),
    ca.OP_SQ: lambda ring, a: ring.product(a, a),
    ca.OP_POW: _power,
    ca.OP_CONSTPOW: _power,
    ca.OP_HYPOT: _hypot,
    ca.OP_ATAN2: _atan2,
    ca.OP_SINH: lambda ring, a: _hyperbolic(ring, a, -1),
    ca.OP_COSH: lambda ring, a: _hyperbolic(ring, a, 1),
    ca.OP_TANH: _tanh,
    ca.OP_ASINH: _asinh,
    ca.OP_ACOSH: _acosh,
    ca.OP_ATANH: _atanh,
    ca.OP_LOG1P: lambda ring, a: ring.composed("log", _one(ring, a)),
    ca.OP_EXPM1: lambda ring, a: _scaled(-1)(
        ring, _one(ring, _scaled(-1)(ring, ring.composed("exp", a)))
    ),
    ca.OP_LT: _compared(lambda side: side < 0),
    ca.OP_LE: _compared(lambda side: side <= 0),
    ca.OP_EQ: _compared(lambda side: side == 0),
    ca.OP_NE: _compared(lambda side: side != 0),
    ca.OP_NOT: lambda ring, a: {} if a else _one(ring, a),
    ca.OP_AND: _logical(lambda a, b: a and b),
    ca.OP_OR: _logical(lambda a, b: a or b),
    ca.OP_IF_ELSE_ZERO: lambda ring, condition, a: a if condition else {},
    ca.OP_FABS: _absolute,
    ca.OP_SIGN: _one_of_sign,
    ca.OP_COPYSIGN: lambda ring, a, b: _scaled(_sign(b, "copysign"))(ring, _absolute(ring, a)),
    ca.OP_FMIN: _chosen(-1),
    ca.OP_FMAX: _chosen(1),
    ca.OP_FLOOR: _whole("floor"),
    ca.OP_CEIL: _whole("ceil"),
    ca.OP_INV: _named("inv"),
    **{
        getattr(ca, f"OP_{name.upper()}"): _named(name)
        for name in ("sqrt", "exp", "log", "sin", "cos", "tan", "asin", "acos", "atan", "erf")
    },
}
