"""Taylor models with ball coefficients.

The variables are the position within a box and the errors of parameters. Source: Makino and Berz,
Taylor models and other validated functional inclusion methods, IJPAM 4 (2003).
"""

from __future__ import annotations

import operator
from collections.abc import Callable
from functools import cached_property
from itertools import zip_longest
from typing import Any

from flint import arb, arb_series

from verification.enclosure.ball_function import Undecided
from verification.enclosure.polynomial import Polynomial, power_of_length


class Taylor:
    """Enclosure of functions g on the unit ball.

    |g(y) - polynomial(y)| <= remainder |y|^(order + 1) for |y| <= 1. In sums and products, numbers
    and balls are constants. `BallFunction` accepts these objects.

    order: highest degree D of the polynomial
    polynomial: polynomial with balls as coefficients
    remainder: a nonnegative number
    """

    def __init__(self, order: int, polynomial: Polynomial, remainder: arb) -> None:
        self.order = order
        self.polynomial = polynomial
        self.remainder = remainder

    def _of(self, value: Any) -> Taylor:
        """Return a Taylor polynomial unchanged, and a number or ball as a constant polynomial."""
        if isinstance(value, Taylor):
            return value
        return Taylor(self.order, Polynomial.constant(arb(value)), arb(0))

    def __add__(self, other: Any) -> Taylor:
        other = self._of(other)
        remainder = (self.remainder + other.remainder).upper()
        return Taylor(self.order, self.polynomial + other.polynomial, remainder)

    def __neg__(self) -> Taylor:
        return Taylor(self.order, -self.polynomial, self.remainder)

    def __sub__(self, other: Any) -> Taylor:
        return self + -self._of(other)

    def __mul__(self, other: Any) -> Taylor:
        if not isinstance(other, Taylor):
            factor = arb(other)
            remainder = (self.remainder * abs(factor).upper()).upper()
            return Taylor(self.order, self.polynomial.scaled(factor), remainder)
        product = self.polynomial.times(other.polynomial, self.order)
        first = self.polynomial.norms()
        second = other.polynomial.norms()
        remainder = self.remainder * (sum(second, arb(0)) + other.remainder)
        remainder += sum(first, arb(0)) * other.remainder
        for i, norm in enumerate(first):
            remainder += norm * sum(second[max(0, self.order + 1 - i) :], arb(0))
        return Taylor(self.order, product, remainder.upper())

    def __truediv__(self, other: Any) -> Taylor:
        if not isinstance(other, Taylor):
            return self * (1 / arb(other))
        return self * other.through(lambda series: 1 / series)

    def __radd__(self, other: Any) -> Taylor:
        return self + other

    def __rsub__(self, other: Any) -> Taylor:
        return self._of(other) - self

    def __rmul__(self, other: Any) -> Taylor:
        return self * other

    def __rtruediv__(self, other: Any) -> Taylor:
        return self.through(lambda series: 1 / series) * other

    @property
    def center(self) -> arb:
        """Value at y = 0, a ball."""
        parts = self.polynomial.parts
        return parts[0].get(0, arb(0)) if parts else arb(0)

    def reach(self) -> arb:
        """Return a bound m with |g(y) - g(0)| <= m |y| for |y| <= 1."""
        return (sum(self.polynomial.norms()[1:], arb(0)) + self.remainder).upper()

    def range(self) -> arb:
        """Return a ball that contains all values of g on the unit ball."""
        return self.center + arb(0, 1) * self.reach()

    def through(self, function: Callable[[arb_series], arb_series]) -> Taylor:
        """Return the enclosure of f(g(y)) = Σ_k f_k(c) δ^k + f_(D+1)(ξ) δ^(D+1), k <= D.

        f_k is the k-th derivative over k!, c = g(0), δ = g(y) - c, and ξ is in the range of g.

        Raises Undecided unless f is proved smooth on the range of g.
        """
        order = self.order
        near = function(arb_series([self.center, 1], prec=order + 1))
        far = function(arb_series([self.range(), 1], prec=order + 2))
        slopes = [near[k] for k in range(order + 1)]
        last = far[order + 1]
        if not (last.is_finite() and all(slope.is_finite() for slope in slopes)):
            raise Undecided("a function is not proved to be smooth on the whole set")
        delta = Taylor(order, Polynomial([{}, *self.polynomial.parts[1:]]), self.remainder)
        total = self._of(slopes[order])
        for slope in reversed(slopes[:order]):
            total = total * delta + slope
        rest = (abs(last) * self.reach() ** (order + 1)).upper()
        return Taylor(order, total.polynomial, (total.remainder + rest).upper())

    def lowest(self, variables: int, degree: int) -> Polynomial:
        """Return a polynomial that is at most g for |y| <= 1.

        degree: degree of the polynomial, even and at most order + 1

        A term of a higher degree k is at least -norm |y|^k >= -norm |y|^degree.

        Raises ValueError for another degree.
        """
        if degree % 2 or degree > self.order + 1:
            raise ValueError(f"the degree {degree} is odd or above {self.order + 1}")
        norms = self.polynomial.norms()
        rest = sum(norms[degree + 1 :], arb(0)) + self.remainder
        kept = Polynomial(self.polynomial.parts[: degree + 1])
        return kept - power_of_length(variables, degree).scaled(rest.upper())


for _name in ("sqrt", "exp", "log", "sin", "cos", "tan", "asin", "acos", "atan"):
    setattr(Taylor, _name, lambda self, _name=_name: self.through(getattr(arb_series, _name)))
#: {s : |s| <= 1} and {s² : |s| <= 1}.
_ALL = arb(0, 1)
_SQUARE = arb(0.5, 0.5)
#: Control points of s² on the four quarters of [-1, 1]; their convex hull contains (s, s²).
_HULL = ((-1.0, 1.0), (-0.75, 0.5), (-0.25, 0.0), (0.25, 0.0), (0.75, 0.5), (1.0, 1.0))


class TaylorModel:
    """Taylor model c_0 + c_1 s + c_2 s² + remainder + Σ z_k t_k for all |s| <= 1, |t_k| <= 1.

    s is the position within a box, and t_k are errors of parameters. In sums and products, numbers
    and balls are constants. `ball_function.py` evaluates functions on scalar models.

    parts: (c_0, c_1, c_2, remainder, z_1, ..), balls or matrices of balls, 0 if omitted
    """

    def __init__(self, *parts: Any) -> None:
        missing = 4 - len(parts)
        self.parts = parts if missing <= 0 else parts + (0 * parts[0],) * missing

    @classmethod
    def of(cls, value: Any) -> TaylorModel:
        """Return a Taylor model unchanged, and any other value as a constant model."""
        if isinstance(value, TaylorModel):
            return value
        return cls(arb(value) if isinstance(value, int) else value)

    def map(self, linear: Callable[[Any], Any]) -> TaylorModel:
        """Return the image of the model under a linear map.

        linear: linear map of a ball or of a matrix of balls
        """
        return TaylorModel(*map(linear, self.parts))

    def __add__(self, other: Any) -> TaylorModel:
        if not isinstance(other, TaylorModel):
            return TaylorModel(self.parts[0] + other, *self.parts[1:])
        if len(self.parts) == len(other.parts):
            return TaylorModel(*map(operator.add, self.parts, other.parts))
        return TaylorModel(*(a + b for a, b in zip_longest(self.parts, other.parts, fillvalue=0)))

    def __neg__(self) -> TaylorModel:
        return self.map(operator.neg)

    def __sub__(self, other: Any) -> TaylorModel:
        return self + -TaylorModel.of(other)

    def __mul__(self, other: Any) -> TaylorModel:
        if not isinstance(other, TaylorModel):
            return self.map(lambda part: part * other)
        a0, a1, a2, a_remainder, *a_errors = self.parts
        b0, b1, b2, b_remainder, *b_errors = other.parts
        # Of the product of the deviations from the centers, a1 b1 s² is kept; the rest is enclosed.
        remainder = a_remainder * b0 + a0 * b_remainder
        remainder += self._beyond_slope * other._off_center
        remainder += _ALL * a1 * other._beyond_slope
        errors = []
        if a_errors or b_errors:
            from_a = [z * b0 for z in a_errors]
            from_b = [a0 * z for z in b_errors]
            errors = [x + y for x, y in zip_longest(from_a, from_b, fillvalue=0)]
        return TaylorModel(
            a0 * b0, a0 * b1 + a1 * b0, a0 * b2 + a1 * b1 + a2 * b0, remainder, *errors
        )

    def __truediv__(self, other: Any) -> TaylorModel:
        return self * TaylorModel.of(other).through(lambda series: 1 / series)

    def __radd__(self, other: Any) -> TaylorModel:
        return self + other

    def __rsub__(self, other: Any) -> TaylorModel:
        return TaylorModel.of(other) - self

    def __rmul__(self, other: Any) -> TaylorModel:
        return self.map(lambda part: other * part)

    def __rtruediv__(self, other: Any) -> TaylorModel:
        return TaylorModel.of(other) / self

    def transpose(self) -> TaylorModel:
        """Return the transpose of a model of matrices."""
        return self.map(lambda part: part.transpose())

    def polynomial_at(self, s: float) -> Any:
        """Return c_0 + c_1 s + c_2 s², without the remainder and the errors."""
        c0, c1, c2, *_ = self.parts
        return c0 + arb(s) * c1 + arb(s * s) * c2

    @cached_property
    def _errors(self) -> Any:
        """Enclosure of the remainder and of the terms Σ z_k t_k."""
        _, _, _, remainder, *errors = self.parts
        return sum((_ALL * z for z in errors), remainder)

    @cached_property
    def _beyond_slope(self) -> Any:
        """Enclosure of the model's values minus c_0 + c_1 s."""
        return _SQUARE * self.parts[2] + self._errors

    @cached_property
    def _off_center(self) -> Any:
        """Enclosure of the model's values minus c_0."""
        return _ALL * self.parts[1] + self._beyond_slope

    def range(self) -> Any:
        """Return an enclosure of the model's values on the box."""
        return self.parts[0] + self._off_center

    def corners(self) -> list[Any]:
        """Return enclosures whose convex hull contains all values of the model on the box."""
        return [self.near(arb(s), arb(square)) for s, square in _HULL]

    def near(self, s: arb, square: arb) -> Any:
        """Return an enclosure of c_0 + c_1 s + c_2 square + remainder + Σ z_k t_k.

        s: value of s
        square: value in place of s²
        """
        c0, c1, c2, *_ = self.parts
        return c0 + (s * c1 + square * c2 + self._errors)

    def through(self, function: Callable[[arb_series], arb_series]) -> TaylorModel:
        """Return a Taylor model of f of the model, f(c_0 + δ) = f + f' δ + f''/2 δ² + f'''(ξ)/6 δ³.

        The derivatives are those at c_0. δ is the model without c_0, and ξ is in the range of the
        model.

        function: f on `arb_series`
        """
        near = function(arb_series([self.parts[0], 1], prec=3))
        far = function(arb_series([self.range(), 1], prec=4))
        delta = TaylorModel(arb(0), *self.parts[1:])
        square = delta * delta
        cubic = far[3] * square.range() * self._off_center
        last = TaylorModel(near[0], arb(0), arb(0), cubic)
        return delta * near[1] + square * near[2] + last


for _name in ("sqrt", "exp", "log", "sin", "cos", "tan", "asin", "acos", "atan"):
    setattr(TaylorModel, _name, lambda self, _name=_name: self.through(getattr(arb_series, _name)))
