"""Sum-of-squares proofs, in ball arithmetic, that a polynomial is positive on a set.

The set is defined by polynomials g_k >= 0. The proof is the identity

    target = Σ_k σ_k g_k + m'Q m,  σ_k = m_k'Q_k m_k,

with Q, Q_k positive definite and m, m_k vectors of monomials. Then target > 0 wherever every
g_k >= 0 and some monomial of m is not 0. Q comes from a numerical solver. The identity therefore
holds only approximately. The residual is added to entries of Q as balls, and the corrected Q is
proved positive definite.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from flint import arb, arb_mat

from hfa_proof.checker.reading import Fields, Rejected, require
from verification.enclosure.balls import is_positive_definite, matrix
from verification.enclosure.polynomial import Key, Polynomial, monomials

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

        def terms() -> object:
            for i, key in enumerate(keys):
                row = rows[i]
                yield 2 * key, 2 * degrees[i], arb(row[i])
                for j in range(i):
                    yield key + keys[j], degrees[i] + degrees[j], arb(2.0 * row[j])

        return Polynomial.of_terms(terms())  # type: ignore[arg-type]


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


def check_positive(
    what: str,
    target: Polynomial,
    constraints: Mapping[str, Polynomial],
    evidence: Evidence,
    variables: int,
) -> None:
    """Raise Rejected unless target > 0 is proved for every y != 0 where all constraints are >= 0.

    The proof includes y = 0 if the monomials of `main` begin at degree 0.

    what: name of the claim, for messages
    target: the polynomial
    constraints: name -> g_k. A constraint without a multiplier is not used.
    evidence: the sum of squares
    variables: number of variables n
    """
    residual = target
    for name, square in evidence.multipliers.items():
        square.check_definite(what)
        residual = residual - square.polynomial(variables).times(constraints[name])
    _check_gram(what, residual, evidence.main, variables)


def _check_gram(what: str, residual: Polynomial, main: Square, variables: int) -> None:
    """Raise Rejected unless a polynomial equals m'Q̃ m for a positive definite Q̃ near Q.

    A term of the polynomial that is not a product of two monomials of m must be exactly 0.

    what: name of the claim, for messages
    residual: the polynomial
    main: m and Q
    variables: number of variables
    """
    keys = monomials(variables, main.low, main.high)
    size = len(keys)
    places: dict[Key, list[tuple[int, int]]] = {}
    for i in range(size):
        for j in range(i + 1):
            places.setdefault(keys[i] + keys[j], []).append((i, j))
    rows = [[arb(entry) for entry in row] for row in main.Q.tolist()]
    missing = residual - main.polynomial(variables)
    for key, _, coefficient in missing.terms():
        if key not in places:
            if not coefficient.is_zero():
                raise Rejected(
                    f"{what}: a term of the polynomial is missing from the sum of squares"
                )
            continue
        shares = places[key]
        count = sum(1 if i == j else 2 for i, j in shares)
        share = coefficient / count
        for i, j in shares:
            rows[i][j] += share
    if not is_positive_definite(arb_mat(rows)):
        raise Rejected(f"{what}: the sum of squares is not proved positive")


def _degrees(variables: int, low: int, high: int) -> list[int]:
    """Return the degree of each monomial of `monomials`, for the same arguments."""
    degrees: list[int] = []
    for degree in range(low, high + 1):
        degrees += [degree] * len(monomials(variables, degree, degree))
    return degrees
