"""Taylor polynomials of several variables on the unit ball, with a bound of their remainder.

The remainder is scaled by |y|^(D+1) and is therefore 0 at y = 0 to this order. Every operation
returns an enclosure. If the operands enclose some functions, the result encloses the operation on
these functions, at every |y| <= 1.

Source: Makino and Berz, Taylor models and other validated functional inclusion methods, IJPAM 4
(2003).
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from flint import arb, arb_series

from hfa_proof.arithmetic.ball_function import Undecided
from hfa_region.check.polynomial import Polynomial, power_of_length


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
