"""Sums of squares as evidence of positivity."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass

import numpy as np
from flint import arb

from hfa_prove.enclosure.balls import is_positive_definite, matrix
from hfa_prove.enclosure.polynomial import Key, Polynomial, monomials
from hfa_prove.fields import Fields, Rejected, require

#: Highest degree of the monomials of a Gram matrix.
_HIGHEST = 12


@dataclass(frozen=True, eq=False)
class Square:
    """Quadratic form m'Q m in a vector m of monomials.

    m contains all monomials of the degrees `low` to `high`, in the order of `monomials`.

    low, high: lowest and highest degree
    Q: (k, k), symmetric
    """

    low: int
    high: int
    Q: np.ndarray

    @classmethod
    def read(cls, entries: Fields, variables: int) -> Square:
        """Return the quadratic form stored in the entries `degrees` and `gram` of a certificate.

        variables: number of variables of the monomials

        Raises Malformed if one of these entries is invalid.
        """
        low, high = entries.pair("degrees", least=0.0)
        require(low == int(low) and high == int(high) <= _HIGHEST, entries.where, [low, high])
        size = len(monomials(variables, int(low), int(high)))
        return cls(int(low), int(high), entries.symmetric("gram", size))

    def check_definite(self, what: str) -> None:
        """Raise Rejected unless Q is proved positive definite.

        what: name of the claim, for the message
        """
        if not is_positive_definite(matrix(self.Q)):
            raise Rejected(f"{what}: a Gram matrix is not proved positive definite")

    def polynomial(self, variables: int) -> Polynomial:
        """Return m'Q m as a polynomial.

        variables: number of variables of the monomials
        """
        keys = monomials(variables, self.low, self.high)
        degrees = _degrees(variables, self.low, self.high)
        rows = self.Q.tolist()

        def terms() -> Iterator[tuple[Key, int, arb]]:
            for i, key in enumerate(keys):
                row = rows[i]
                yield 2 * key, 2 * degrees[i], arb(row[i])
                for j in range(i):
                    yield key + keys[j], degrees[i] + degrees[j], arb(2.0 * row[j])

        return Polynomial.of_terms(terms())


@dataclass(frozen=True, eq=False)
class Evidence:
    """Sum of squares that proves a polynomial positive.

    main: the quadratic form m'Q m
    multipliers: name of g_k -> σ_k
    """

    main: Square
    multipliers: Mapping[str, Square]

    @classmethod
    def read(cls, entries: Fields, variables: int, constraints: tuple[str, ...]) -> Evidence:
        """Return the sum of squares stored in a certificate.

        variables: number of variables
        constraints: names of the g_k that may have a multiplier

        Raises Malformed for the first wrong entry.
        """
        main = Square.read(entries, variables)
        stated = entries.fields("multipliers")
        multipliers = {}
        for name in constraints:
            if stated.has(name):
                square = stated.fields(name)
                multipliers[name] = Square.read(square, variables)
                square.close()
        stated.close()
        entries.close()
        return cls(main, multipliers)


def _degrees(variables: int, low: int, high: int) -> list[int]:
    """Return the degree of each monomial of `monomials`, for the same arguments."""
    degrees: list[int] = []
    for degree in range(low, high + 1):
        degrees += [degree] * len(monomials(variables, degree, degree))
    return degrees
