"""A lower bound of the cost that is proved on boxes, as data."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from hfa_boxes.check.cost_statement import CostStatement
from hfa_boxes.check.plant import Plant
from hfa_proof.results import ProvedResult
from hfa_support.reporting.results import Matrix, Result, Vector


@dataclass(frozen=True, eq=False)
class BoundPiece(Result):
    """No flight costs less than the lesser of W(M z) and c where it begins with |(M z)_i| < 1, and
    none less than c where it begins elsewhere; z: deviations from the equilibrium.

    c: level.
    M: (n, n).
    coefficients: of the monomials of W.
    powers: (terms, n), of each monomial.
    boxes: on how many boxes it is proved.
    """

    c: float
    M: Matrix
    coefficients: Vector
    powers: Sequence[Sequence[int]]
    boxes: int


@dataclass(frozen=True, eq=False)
class LowerBound(ProvedResult):
    """A lower bound of the cost of every flight that is proved.

    statement: the proved statement.
    boxes: number of boxes of each piece.
    """

    json_keys = "proved states state_units trim parameters equilibrium limits Q R pieces"

    statement: CostStatement
    boxes: Sequence[int]

    @property
    def subject(self) -> Plant:
        """The aircraft."""
        return self.statement.plant

    @property
    def equilibrium(self) -> Mapping[str, float]:
        """State or input -> value at the equilibrium, which is enclosed near this."""
        return self.statement.equilibrium

    @property
    def Q(self) -> Matrix:
        """(n, n), of the states."""
        return self.statement.Q

    @property
    def R(self) -> Matrix:
        """(m, m), of the inputs."""
        return self.statement.R

    @property
    def pieces(self) -> Sequence[BoundPiece]:
        """Bounds, the largest of which holds."""
        found = []
        for piece, boxes in zip(self.statement.pieces, self.boxes, strict=True):
            values = np.array([value for value, _ in piece.W.terms])
            powers = [powers for _, powers in piece.W.terms]
            found.append(BoundPiece(piece.c, piece.M, values, powers, boxes))
        return found


@dataclass(frozen=True, eq=False)
class FoundLowerBound(LowerBound):
    """A bound that a search has found and proved.

    stopped: why no larger level is proved, or "" where all initial conditions are below the last.
    """

    schema = "hfa.lower-bound/1"
    made_by = "hfa prove cost"
    json_keys = f"{LowerBound.json_keys} stopped"

    stopped: str


@dataclass(frozen=True, eq=False)
class CheckedLowerBound(LowerBound):
    """A bound that a certificate proves.

    written: version, command and date in the file, which nothing verifies.
    not_given: parts of the subject that no option gave, so that they were not compared.
    """

    schema = "hfa.lower-bound-check/1"
    made_by = "hfa prove cost --check FILE"
    json_keys = f"{LowerBound.json_keys} written not_given"

    written: Mapping[str, str]
    not_given: Sequence[str] = ()
