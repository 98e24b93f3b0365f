"""Results of lower-bound proofs for the cost, in the form written to JSON."""

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
    """Lower bound of the cost by one polynomial W(M z), with z the deviation from the equilibrium.

    A flight that begins with |(M z)_i| < 1 for all i costs at least min(W(M z), c). A flight that
    begins elsewhere costs at least c.

    c: level.
    M: (n, n).
    coefficients: coefficients of the monomials of W.
    powers: (terms, n), powers of each monomial.
    boxes: number of boxes that the proof of the piece evaluated.
    """

    c: float
    M: Matrix
    coefficients: Vector
    powers: Sequence[Sequence[int]]
    boxes: int


@dataclass(frozen=True, eq=False)
class LowerBound(ProvedResult):
    """Proved lower bound of the cost of every flight to the equilibrium.

    statement: the proved statement.
    boxes: number of boxes that the proof of each piece evaluated.
    """

    json_keys = "proved states state_units trim parameters equilibrium limits Q R pieces"

    statement: CostStatement
    boxes: Sequence[int]

    @property
    def subject(self) -> Plant:
        """The aircraft with its trim and limits."""
        return self.statement.plant

    @property
    def equilibrium(self) -> Mapping[str, float]:
        """State or input -> approximate value at the proved equilibrium."""
        return self.statement.equilibrium

    @property
    def Q(self) -> Matrix:
        """Weight of the states, (n, n)."""
        return self.statement.Q

    @property
    def R(self) -> Matrix:
        """Weight of the inputs, (m, m)."""
        return self.statement.R

    @property
    def pieces(self) -> Sequence[BoundPiece]:
        """Bounds by single polynomials. The cost is at least the largest of these bounds."""
        found = []
        for piece, boxes in zip(self.statement.pieces, self.boxes, strict=True):
            values = np.array([value for value, _ in piece.W.terms])
            powers = [powers for _, powers in piece.W.terms]
            found.append(BoundPiece(piece.c, piece.M, values, powers, boxes))
        return found


@dataclass(frozen=True, eq=False)
class FoundLowerBound(LowerBound):
    """Lower bound that a search has found and proved.

    stopped: reason why no larger level is proved, or "" if every level that was tried is proved.
    """

    schema = "hfa.lower-bound/1"
    made_by = "hfa prove cost"
    json_keys = f"{LowerBound.json_keys} stopped"

    stopped: str


@dataclass(frozen=True, eq=False)
class CheckedLowerBound(LowerBound):
    """Lower bound that a certificate proves.

    written: version, command and date in the file, not verified.
    not_given: parts of the statement that were not compared, because no option gave them.
    """

    schema = "hfa.lower-bound-check/1"
    made_by = "hfa prove cost --check FILE"
    json_keys = f"{LowerBound.json_keys} written not_given"

    written: Mapping[str, str]
    not_given: Sequence[str] = ()
