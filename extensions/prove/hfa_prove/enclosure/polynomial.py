"""Polynomials in n variables whose coefficients are balls."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from functools import cache, lru_cache
from itertools import combinations_with_replacement
from math import factorial
from typing import Any

from flint import arb, fmpq

import hfa_prove.enclosure.precision  # noqa: F401  # sets the precision of balls

#: Bits of the exponent of one variable in a key.
_BITS = 8
#: The exponents of a monomial in one number, Σ α_i 256^i. The key of a product is the sum of the
#: keys of its factors.
Key = int


def key_of(exponents: Sequence[int]) -> Key:
    """Return the integer key of the monomial y_1^α_1 .. y_n^α_n with the given exponents."""
    return sum(exponent << (_BITS * i) for i, exponent in enumerate(exponents))


def exponents_of(key: Key) -> list[int]:
    """Return the exponents of the monomial with an integer key, without trailing zeros."""
    exponents = []
    while key:
        exponents.append(key & (2**_BITS - 1))
        key >>= _BITS
    return exponents


@lru_cache(maxsize=64)
def monomials(variables: int, low: int, high: int) -> tuple[Key, ...]:
    """Return the keys of all monomials of the degrees low to high, in ascending order of degree."""
    keys = []
    for degree in range(low, high + 1):
        for chosen in combinations_with_replacement(range(variables), degree):
            keys.append(sum(1 << (_BITS * i) for i in chosen))
    return tuple(keys)


@cache
def _weight(key: Key) -> fmpq:
    """Return α! / |α|!, the weight of the squared coefficient of y^α in the Bombieri norm.

    key: key of the monomial y^α
    """
    exponents = exponents_of(key)
    product = 1
    for exponent in exponents:
        product *= factorial(exponent)
    return fmpq(product, factorial(sum(exponents)))


class Polynomial:
    """Polynomial Σ c_α y^α with balls as coefficients.

    parts: parts[k] maps the keys of monomials of degree k to coefficients. Zero coefficients may be
        omitted.
    """

    def __init__(self, parts: list[dict[Key, arb]]) -> None:
        self.parts = parts

    @classmethod
    def constant(cls, value: arb) -> Polynomial:
        """Return the constant polynomial with the given value."""
        return cls([{0: value}])

    @classmethod
    def linear(cls, slopes: Sequence[arb]) -> Polynomial:
        """Return the linear polynomial Σ slopes_i y_i."""
        return cls([{}, {1 << (_BITS * i): slope for i, slope in enumerate(slopes)}])

    @classmethod
    def of_terms(cls, terms: Iterator[tuple[Key, int, arb]]) -> Polynomial:
        """Return the sum of terms (key of a monomial, its degree, coefficient)."""
        parts: list[dict[Key, arb]] = []
        for key, degree, coefficient in terms:
            while len(parts) <= degree:
                parts.append({})
            part = parts[degree]
            part[key] = part[key] + coefficient if key in part else coefficient
        return cls(parts)

    @property
    def constant_term(self) -> Any:
        """Value at y = 0."""
        return self.parts[0].get(0, arb(0)) if self.parts else arb(0)

    def without_constant(self) -> Polynomial:
        """Return the terms of degree 1 and more."""
        return Polynomial([{}, *self.parts[1:]])

    @property
    def degree(self) -> int:
        """Highest degree of the stored terms."""
        return len(self.parts) - 1

    def terms(self) -> Iterator[tuple[Key, int, arb]]:
        """Yield key of the monomial, degree and coefficient of every term."""
        for degree, part in enumerate(self.parts):
            for key, coefficient in part.items():
                yield key, degree, coefficient

    def __add__(self, other: Polynomial) -> Polynomial:
        longer, shorter = self.parts, other.parts
        if len(longer) < len(shorter):
            longer, shorter = shorter, longer
        parts = [dict(part) for part in longer]
        for part, more in zip(parts, shorter, strict=False):
            for key, coefficient in more.items():
                part[key] = part[key] + coefficient if key in part else coefficient
        return Polynomial(parts)

    def __neg__(self) -> Polynomial:
        return self.scaled(arb(-1))

    def __sub__(self, other: Polynomial) -> Polynomial:
        return self + -other

    def map(self, linear: Callable[[Any], Any]) -> Polynomial:
        """Return the polynomial with the images of all coefficients under a linear map."""
        return Polynomial(
            [{key: linear(value) for key, value in part.items()} for part in self.parts]
        )

    def scaled(self, factor: arb) -> Polynomial:
        """Return the polynomial multiplied by a number."""
        return self.map(lambda value: factor * value)

    def times(self, other: Polynomial, highest: int | None = None) -> Polynomial:
        """Return the product with another polynomial, without terms of degree above `highest`.

        highest: highest degree that is kept, or None to keep all terms
        """
        degree = self.degree + other.degree
        if highest is not None:
            degree = min(degree, highest)
        parts: list[dict[Key, arb]] = [{} for _ in range(degree + 1)]
        for i, first in enumerate(self.parts[: degree + 1]):
            for j, second in enumerate(other.parts[: degree + 1 - i]):
                part = parts[i + j]
                for key, value in first.items():
                    for other_key, other_value in second.items():
                        together = key + other_key
                        product = value * other_value
                        known = part.get(together)
                        part[together] = product if known is None else known + product
        return Polynomial(parts)

    def norms(self) -> list[arb]:
        """Return, for the part h of each degree k, a number N with |h(y)| <= N |y|^k for every y.

        N is the Bombieri norm of h, sqrt(Σ c_α² α!/k!). h(y) is the product of y ⊗ .. ⊗ y and a
        symmetric tensor whose Frobenius norm is N. The norm of a product is at most the product of
        the norms.
        """
        results = []
        for part in self.parts:
            square = arb(0)
            for key, value in part.items():
                square += abs(value).upper() ** 2 * _weight(key)
            results.append(square.sqrt().upper() if part else arb(0))
        return results


@lru_cache(maxsize=64)
def power_of_length(variables: int, degree: int) -> Polynomial:
    """Return the polynomial |y|^degree for an even degree."""
    half = degree // 2
    part = {}
    for key in monomials(variables, half, half):
        count = factorial(half)
        for exponent in exponents_of(key):
            count //= factorial(exponent)
        part[2 * key] = arb(count)
    return Polynomial([*({} for _ in range(degree)), part])
