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

from flint import arb, arb_mat

from hfa_prove.enclosure.balls import is_positive_definite
from hfa_prove.enclosure.polynomial import Key, Polynomial, monomials
from hfa_prove.fields import Rejected
from hfa_prove.statements.evidence import Evidence, Square


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
