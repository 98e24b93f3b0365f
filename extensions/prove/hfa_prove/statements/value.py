"""Statement of a certificate about the value of a nonlinear game about a trim, and its witness.

The checker interprets or refuses every entry. The digest covers all entries, and reports show them.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from itertools import combinations_with_replacement
from math import comb

import numpy as np

from hfa_prove.fields import Fields, Statement, Witness, entry, part, require
from hfa_prove.statements.flight import Line
from hfa_prove.statements.game import Weights
from hfa_prove.statements.plant import Plant

#: Highest degree of a value, and largest residual that a certificate may claim.
HIGHEST = 5
LARGEST_RESIDUAL = 1e-9


def powers_of(n: int, degrees: Iterable[int]) -> list[tuple[int, ...]]:
    """Return the exponents of all monomials of n variables, degree by degree, last index fastest.

    degrees: degrees of the monomials, such as range(2, 5)
    """
    return [
        tuple(indices.count(i) for i in range(n))
        for degree in degrees
        for indices in combinations_with_replacement(range(n), degree)
    ]


def _count(n: int, degrees: Iterable[int]) -> int:
    """Return the number of monomials of n variables with these degrees."""
    return sum(comb(n + degree - 1, degree) for degree in degrees)


@dataclass(frozen=True, eq=False)
class ValueStatement(Statement):
    """Claim that V and u satisfy the equation of the nonlinear game, degree by degree.

        min_u max_d  ∂V/∂z'(F(z, u) + E d) + z'Qz + u'Ru - delta² d'd = 0

    z are the deviations of the moving states from the trim, and F the rates of the equations minus
    their rates at the trim. The claim is:

    - the coefficients of degree 2 to D of this equation, with the worst d, and those of degree 1 to
      D - 1 of its derivative with respect to u are zero, up to the residual
    - the quadratic part of V is positive definite, and A - S P is Hurwitz

    The inputs are not limited.

    plant: the equations and the trim, without limits
    weights: Q, R, E and delta
    order: degree D of V
    V: weights of the monomials of degree 2 to D (`powers_of`)
    u: weights of the monomials of degree 1 to D - 1, (m, K)
    residual: largest coefficient along the tested directions, relative to the largest sum of the
        magnitudes of its terms
    """

    plant: Plant = part(Plant)
    weights: Weights = part(Weights)
    order: int = entry(lambda file, name, known: file.count(name, HIGHEST))
    V: np.ndarray = entry(
        lambda file, name, known: file.array(
            name, _count(len(known.plant.states), range(2, known.order + 1))
        ),
        subject="value",
    )
    u: np.ndarray = entry(
        lambda file, name, known: file.array(
            name,
            len(known.plant.inputs),
            _count(len(known.plant.states), range(1, known.order)),
        ),
        subject="value",
    )
    residual: float = entry(lambda file, name, known: file.number(name, least=0.0))

    def check_consistent(self) -> None:
        """Raise Malformed for limits, a degree below 2, or a residual that claims too little."""
        require(not self.plant.limits, "plant: limits", dict(self.plant.limits))
        require(self.order >= 2, "order", self.order)
        require(self.residual <= LARGEST_RESIDUAL, "residual", self.residual)

    @property
    def P(self) -> np.ndarray:
        """Matrix of the quadratic part z'P z of V, (n, n)."""
        n = len(self.plant.states)
        rows, columns = np.triu_indices(n)
        half = np.zeros((n, n))
        half[rows, columns] = 0.5 * self.V[: len(rows)]
        return half + half.T


@dataclass(frozen=True, eq=False)
class ValueWitness(Witness):
    """Data for the proof of a value, not part of the claim.

    loop: matrix for the proof that A - S P is Hurwitz
    """

    loop: Line

    @classmethod
    def read(cls, entries: Fields, statement: ValueStatement) -> ValueWitness:
        """Return the witness of a certificate.

        Raises Malformed for the first wrong entry.
        """
        line = Line.read(entries, len(statement.plant.states), rated=False)
        entries.close()
        return cls(line)
