"""Polynomial pieces of a set."""

from __future__ import annotations

from collections.abc import Sequence
from fractions import Fraction
from typing import Any, NamedTuple

import casadi as ca
import numpy as np

from hfa_prove.fields import Fields, Terms, require, rows_of

#: Highest degree of W.
HIGHEST = 12


class Polynomial(NamedTuple):
    """Polynomial W(y) = Σ coefficient Π y_i^power_i.

    n: number of variables y
    terms: pairs of a coefficient and its powers (n,)
    """

    n: int
    terms: Terms

    def expressions(self, y: ca.SX) -> tuple[ca.SX, ca.SX]:
        """Return expressions of W and its gradient (n,).

        Products of coefficients and powers are exact.
        """
        known: dict[tuple[int, ...], ca.SX] = {(0,) * self.n: ca.SX(1)}

        def monomial(powers: tuple[int, ...]) -> ca.SX:
            if powers not in known:
                first = next(i for i, power in enumerate(powers) if power)
                known[powers] = monomial(lowered(powers, first)) * y[first]
            return known[powers]

        parts = [ca.SX(0) for _ in range(self.n)]
        slopes = [ca.SX(0) for _ in range(self.n)]
        for coefficient, powers in self.terms:
            first = next(i for i, power in enumerate(powers) if power)
            parts[first] += coefficient * monomial(lowered(powers, first))
            for i, power in enumerate(powers):
                if power:
                    slopes[i] += (power * coefficient) * monomial(lowered(powers, i))
        return ca.dot(ca.vertcat(*parts), y), ca.vertcat(*slopes)

    def at(self, y: np.ndarray) -> np.ndarray:
        """Return W (N,) at points y (N, n), in double precision."""
        total = np.zeros(len(y))
        for coefficient, powers in self.terms:
            total += coefficient * np.prod(y ** np.array(powers), axis=1)
        return total


def lowered(powers: tuple[int, ...], index: int) -> tuple[int, ...]:
    """Return the powers of a monomial with the power of the variable `index` reduced by 1."""
    return (*powers[:index], powers[index] - 1, *powers[index + 1 :])


def is_exact(coefficient: float, powers: Sequence[int]) -> bool:
    """Return whether each product of the coefficient and a power is exact in double precision."""
    return all(Fraction(power) * Fraction(coefficient) == power * coefficient for power in powers)


class Piece(NamedTuple):
    """The set of deviations z with W(y) <= c and |y_i| < 1, y = M z.

    M: (n, n)
    W: polynomial in y without terms of degree 0 and 1
    c: level

    Products of coefficients and powers of W are exact in double precision.
    """

    M: np.ndarray
    W: Polynomial
    c: float

    @classmethod
    def read(cls, entries: Fields, n: int) -> Piece:
        """Return the piece stored in a certificate.

        entries: reader of the entry that stores the piece
        n: number of states

        Raises Malformed for the first wrong entry.
        """
        M = entries.array("M", n, n)
        terms = entries.terms("W", n, HIGHEST)
        c = entries.number("c", above=0.0)
        for number, (value, powers) in enumerate(terms):
            require(is_exact(value, powers), f"{entries.where}: W {number}", value)
        entries.close()
        return cls(M, Polynomial(n, terms), c)

    def content(self) -> dict[str, Any]:
        """Return the piece as stored in a file, in the form that `read` accepts."""
        rows = rows_of(self.W.terms)
        return {"M": self.M.tolist(), "W": rows, "c": self.c}
