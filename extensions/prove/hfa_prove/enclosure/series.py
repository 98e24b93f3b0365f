"""Taylor polynomials in several variables, with a remainder, whose coefficients are balls.

A product keeps the terms up to the order, and encloses the others. The sets on which functions are
enclosed are the unit ball, or a segment with errors of parameters. `BallFunction` accepts these
objects. Source: Makino and Berz, Taylor models and other validated functional inclusion methods,
IJPAM 4 (2003).
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable, Iterable, Sequence
from functools import cached_property
from typing import Any, Self

from flint import arb, arb_series

from hfa_prove.enclosure.ball_function import Undecided, tanh_of_series
from hfa_prove.enclosure.polynomial import (
    Key,
    Polynomial,
    exponents_of,
    key_of,
    power_of_length,
)

#: {s : |s| <= 1} and {s² : |s| <= 1}.
_ALL = arb(0, 1)
_SQUARE = arb(0.5, 0.5)
#: Control points of s² on the four quarters of [-1, 1]; their convex hull contains (s, s²).
_HULL = ((-1.0, 1.0), (-0.75, 0.5), (-0.25, 0.0), (0.25, 0.0), (0.75, 0.5), (1.0, 1.0))
#: Keys of s, s² and t_k. Variable 0 is s, followed by the errors.
_KEY_OF_S = key_of([1])
_KEY_OF_SQUARE = key_of([2])


def _key_of_error(k: int) -> Key:
    return key_of([*[0] * (k + 1), 1])


def _is_zero(value: Any) -> bool:
    """Return whether a value is exactly 0. The comparison != is true only if it is proved."""
    return bool(value == 0)


def _sum(terms: Iterable[Any]) -> Any:
    """Return the sum of the terms that are not None, or None without any."""
    total = None
    for term in terms:
        if term is not None:
            total = term if total is None else total + term
    return total


class Taylor(ABC):
    """Enclosure of a function on a set by a polynomial and a remainder.

    In sums and products, numbers and balls are constants. The coefficients may be matrices of
    balls. Operations that need a single value raise an error for them.

    order: highest degree of the terms that products keep
    polynomial: polynomial with balls or matrices of balls as coefficients
    remainder: enclosure of the rest, or None for 0
    """

    def __init__(self, order: int, polynomial: Polynomial, remainder: Any) -> None:
        self.order = order
        self.polynomial = polynomial
        self.remainder = remainder

    @property
    @abstractmethod
    def bounds(self) -> Sequence[Any]:
        """Enclosures of the polynomial's terms of each degree on the set, None for no term."""

    @staticmethod
    @abstractmethod
    def size(factor: Any) -> Any:
        """Return the number by which a constant factor multiplies a remainder."""

    @abstractmethod
    def range(self) -> Any:
        """Return an enclosure of all values on the set."""

    def _like(self, polynomial: Polynomial, remainder: Any) -> Self:
        """Return another enclosure on the same set."""
        other = object.__new__(type(self))
        Taylor.__init__(other, self.order, polynomial, remainder)
        return other

    def _of(self, value: Any) -> Self:
        """Return an enclosure unchanged, and a number or ball as a constant."""
        if isinstance(value, type(self)):
            return value
        constant = arb(value) if isinstance(value, (int, float)) else value
        return self._like(Polynomial.constant(constant), None)

    def _reach(self) -> Any:
        """Return an enclosure of the values minus the value of the polynomial at the center."""
        return _sum([*self.bounds[1:], self.remainder])

    @property
    def center(self) -> Any:
        """Value of the polynomial at the center."""
        return self.polynomial.constant_term

    def map(self, linear: Callable[[Any], Any], size: Callable[[Any], Any] | None = None) -> Self:
        """Return the image under a linear map of a ball or of a matrix of balls.

        size: map of the remainder, if another one
        """
        remainder = None if self.remainder is None else (size or linear)(self.remainder)
        return self._like(self.polynomial.map(linear), remainder)

    def __add__(self, other: Any) -> Self:
        other = self._of(other)
        polynomial = self.polynomial + other.polynomial
        return self._like(polynomial, _sum([self.remainder, other.remainder]))

    def __neg__(self) -> Self:
        return self.map(lambda part: -part, lambda rest: rest * self.size(-1))

    def __sub__(self, other: Any) -> Self:
        return self + -self._of(other)

    def __mul__(self, other: Any) -> Self:
        if not isinstance(other, Taylor):
            return self.map(lambda part: part * other, lambda rest: rest * self.size(other))
        first = self.bounds
        second = other.bounds
        rest = [_product(self.remainder, _sum([*second, other.remainder]))]
        rest.append(_product(_sum(first), other.remainder))
        for degree, bound in enumerate(first):
            above = second[max(0, self.order + 1 - degree) :]
            rest.append(_product(bound, _sum(above)))
        return self._like(self.polynomial.times(other.polynomial, self.order), _sum(rest))

    def __truediv__(self, other: Any) -> Self:
        return self * self._of(other).through(lambda series: 1 / series)

    def __radd__(self, other: Any) -> Self:
        return self + other

    def __rsub__(self, other: Any) -> Self:
        return self._of(other) - self

    def __rmul__(self, other: Any) -> Self:
        return self.map(lambda part: other * part, lambda rest: self.size(other) * rest)

    def __rtruediv__(self, other: Any) -> Self:
        return other * self.through(lambda series: 1 / series)

    def through(self, function: Callable[[arb_series], arb_series]) -> Self:
        """Return the enclosure of f(g) = Σ_k f_k(c) δ^k + f_(D+1)(ξ) δ^(D+1), k <= D.

        f_k is the k-th derivative over k!, c the value of the polynomial at the center, δ = g - c,
        and ξ is in the range of g.

        function: f on `arb_series`

        Raises Undecided unless f is proved smooth on the range of g.
        """
        order = self.order
        near = function(arb_series([self.center, 1], prec=order + 1))
        far = function(arb_series([self.range(), 1], prec=order + 2))
        slopes = [near[k] for k in range(order + 1)]
        last = far[order + 1]
        if not (last.is_finite() and all(slope.is_finite() for slope in slopes)):
            raise Undecided("a function is not proved to be smooth on the whole set")
        if self._reach() is None:
            return self._of(slopes[0])
        delta = self._like(self.polynomial.without_constant(), self.remainder)
        total = self._of(slopes[order])
        for slope in reversed(slopes[:order]):
            total = total * delta + slope
        rest = self.size(last)
        for _ in range(order + 1):
            rest = rest * self._reach()
        return self._like(total.polynomial, _sum([total.remainder, rest]))

    def tanh(self) -> Self:
        """Return the enclosure of tanh g."""
        return self.through(tanh_of_series)


def _product(a: Any, b: Any) -> Any:
    return None if a is None or b is None else a * b


for _name in ("sqrt", "exp", "log", "sin", "cos", "tan", "asin", "acos", "atan"):
    setattr(Taylor, _name, lambda self, _name=_name: self.through(getattr(arb_series, _name)))


class TaylorOnBall(Taylor):
    """Enclosure of functions g on the unit ball of y.

    |g(y) - polynomial(y)| <= remainder |y|^(order + 1) for |y| <= 1, with a nonnegative remainder.
    """

    @cached_property
    def bounds(self) -> Sequence[arb]:
        """Numbers N_k with |terms of degree k| <= N_k |y|^k."""
        return self.polynomial.norms()

    @staticmethod
    def size(factor: Any) -> Any:
        """Return an upper bound of the absolute value of a factor."""
        return abs(arb(factor)).upper()

    def reach(self) -> arb:
        """Return a bound m with |g(y) - g(0)| <= m |y| for |y| <= 1."""
        return (_sum([arb(0), self._reach()])).upper()

    def range(self) -> arb:
        """Return a ball that contains all values of g on the unit ball."""
        return self.center + _ALL * self.reach()

    def lowest(self, variables: int, degree: int) -> Polynomial:
        """Return a polynomial that is at most g for |y| <= 1.

        degree: degree of the polynomial, even and at most order + 1

        A term of a higher degree k is at least -norm |y|^k >= -norm |y|^degree.

        Raises ValueError for another degree.
        """
        if degree % 2 or degree > self.order + 1:
            raise ValueError(f"the degree {degree} is odd or above {self.order + 1}")
        rest = _sum([arb(0), *self.bounds[degree + 1 :], self.remainder])
        kept = Polynomial(self.polynomial.parts[: degree + 1])
        return kept - power_of_length(variables, degree).scaled(rest.upper())


class TaylorModel(Taylor):
    """Taylor model c_0 + c_1 s + c_2 s² + remainder + Σ z_k t_k for all |s| <= 1, |t_k| <= 1.

    s is the position within a box, and t_k are errors of parameters, which count as terms of degree
    2. The remainder is a ball or a matrix of balls.

    parts: (c_0, c_1, c_2, remainder, z_1, ..), balls or matrices of balls, 0 if omitted
    """

    def __init__(self, *parts: Any) -> None:
        padded: list[Any] = list(parts) + [0] * (4 - len(parts))
        c0, c1, c2, remainder = padded[:4]
        errors = padded[4:]
        first = {} if _is_zero(c1) else {_KEY_OF_S: c1}
        second = {} if _is_zero(c2) else {_KEY_OF_SQUARE: c2}
        second |= {_key_of_error(k): z for k, z in enumerate(errors)}
        rest = None if _is_zero(remainder) else remainder
        super().__init__(2, Polynomial([{0: c0}, first, second]), rest)

    @classmethod
    def of(cls, value: Any) -> TaylorModel:
        """Return a Taylor model unchanged, and any other value as a constant model."""
        if isinstance(value, TaylorModel):
            return value
        return cls(arb(value) if isinstance(value, int) else value)

    @cached_property
    def parts(self) -> tuple[Any, ...]:
        """The parts c_0, c_1, c_2, remainder, z_1, .. with zeros up to the last one."""
        _, first, second = self._terms
        zero = 0 * self.center
        count = max((len(exponents_of(key)) for key in second), default=1) - 1
        keys = [_key_of_error(k) for k in range(count)]
        remainder = zero if self.remainder is None else self.remainder
        polynomial = (self.center, first.get(_KEY_OF_S, zero), second.get(_KEY_OF_SQUARE, zero))
        return (*polynomial, remainder, *(second.get(key, zero) for key in keys))

    @property
    def slope(self) -> Any:
        """Coefficient c_1 of s."""
        return self.parts[1]

    @property
    def bend(self) -> Any:
        """Coefficient c_2 of s²."""
        return self.parts[2]

    @property
    def errors(self) -> tuple[Any, ...]:
        """Coefficients z_k of the errors t_k."""
        _, _, _, _, *errors = self.parts
        return tuple(errors)

    @property
    def _terms(self) -> list[dict[Key, Any]]:
        """Terms of the degrees 0, 1 and 2."""
        parts = self.polynomial.parts
        return [*parts, *[{}] * (3 - len(parts))]

    @cached_property
    def bounds(self) -> Sequence[Any]:
        """Enclosures of the terms of the degrees 0, 1 and 2, None for no term."""
        zeroth, first, second = self._terms
        squares = [(_SQUARE if key == _KEY_OF_SQUARE else _ALL) * z for key, z in second.items()]
        return [zeroth.get(0), _sum(_ALL * c for c in first.values()), _sum(squares)]

    @staticmethod
    def size(factor: Any) -> Any:
        """Return the factor."""
        return factor

    def range(self) -> Any:
        """Return an enclosure of the model's values on the box."""
        return _sum([*self.bounds, self.remainder])

    def transpose(self) -> TaylorModel:
        """Return the transpose of a model of matrices."""
        return self.map(lambda part: part.transpose())

    def at(self, s: arb) -> TaylorModel:
        """Return the model at one position s, a model in the errors alone."""
        c0, c1, c2, remainder, *errors = self.parts
        return TaylorModel(c0 + s * c1 + s * s * c2, 0, 0, remainder, *errors)

    def corners(self) -> list[Any]:
        """Return enclosures whose convex hull contains all values of the model on the box."""
        return [self.near(arb(s), arb(square)) for s, square in _HULL]

    def near(self, s: arb, square: arb) -> Any:
        """Return an enclosure of c_0 + c_1 s + c_2 square + remainder + Σ z_k t_k.

        s: value of s
        square: value in place of s²
        """
        c0, c1, c2, remainder, *errors = self.parts
        return c0 + (s * c1 + square * c2 + _sum([remainder, *(_ALL * z for z in errors)]))
